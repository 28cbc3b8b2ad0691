"""A ROS 2 node. Needs rclpy, of ROS 2 itself or as wheels (``palpate[ros2]``).

In: messages of a sensor's topic, as `[stream]` in skin.toml describes them, or pictures of a gel with dots.
Out: topics with wrench, centre, traction, utilisation of the friction and diagnostics.
Open first: `node.py`.
"""

from palpate.ros.client import message_class, ros_client
from palpate.ros.intake import Header, Intake
from palpate.ros.node import TouchNode
from palpate.ros.outlet import Outlet
from palpate.ros.pictures import PictureIntake

__all__ = ["Header", "Intake", "Outlet", "PictureIntake", "TouchNode", "message_class", "ros_client"]
