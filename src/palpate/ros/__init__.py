"""A ROS 2 node: a tactile sensor's topic in, what touches it out. Needs rclpy, of ROS 2 itself or as wheels (``palpate[ros2]``).

`client` finds ROS, `intake` takes messages in, `outlet` sends what was found, `node` is the node.
"""

from palpate.ros.client import message_class, ros_client
from palpate.ros.intake import Header, Intake
from palpate.ros.node import TouchNode
from palpate.ros.outlet import Outlet

__all__ = ["Header", "Intake", "Outlet", "TouchNode", "message_class", "ros_client"]
