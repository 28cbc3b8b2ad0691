"""A ROS 2 node: a tactile sensor's messages in, net force and slip margin out.

    python examples/ros2_node.py --ros-args -p skin:=skin.toml -p type:=sensor_msgs/msg/Image

skin.toml says in its section [stream] which topic it is and what its numbers mean. Needs ROS 2 (rclpy); palpate itself does not.
"""

from __future__ import annotations

import sys
from typing import Any

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rosidl_runtime_py.utilities import get_message
from std_msgs.msg import Float32, String

import palpate as pp
from palpate.recordings import read_stream


class Palpate(Node):  # type: ignore[misc]
    """Publishes ~/wrench, ~/slip_margin (1 at rest, 0 where all slides) and ~/event."""

    def __init__(self) -> None:
        super().__init__("palpate")
        skin_file = self.declare_parameter("skin", "skin.toml").value
        kind = self.declare_parameter("type", "sensor_msgs/msg/Image").value
        friction = float(self.declare_parameter("friction", 0.0).value) or None
        baseline = int(self.declare_parameter("baseline", 30).value)
        budget = float(self.declare_parameter("budget", 0.01).value)  # seconds that a frame may take
        mapping = read_stream(skin_file)
        if mapping is None:
            raise SystemExit(f"{skin_file} has no section [stream]: which topic, and what do its numbers mean?")
        self.mapping = mapping
        skin = pp.Skin.from_file(skin_file)
        self.tracker = skin.track(friction=friction, baseline=baseline, budget=budget)
        self.monitor = pp.GraspMonitor(
            friction=friction, callback=lambda event: self.events.publish(String(data=str(event)))
        )
        self.wrench = self.create_publisher(WrenchStamped, "~/wrench", 1)
        self.margin = self.create_publisher(Float32, "~/slip_margin", 1)
        self.events = self.create_publisher(String, "~/event", 10)
        # one message waits at most: the newest
        self.create_subscription(get_message(kind), mapping.topic, self.on_message, 1)

    def on_message(self, message: Any) -> None:
        now = self.get_clock().now()
        seconds = self.mapping.time(message, 1e-9 * now.nanoseconds)
        touch = self.tracker.step(self.mapping.readings(message), seconds)
        self.monitor.update(touch)
        out = WrenchStamped()
        out.header.stamp, out.header.frame_id = now.to_msg(), "palpate"
        for axis, value in zip("xyz", touch.force):
            setattr(out.wrench.force, axis, float(value))
        for axis, value in zip("xyz", touch.moment):
            setattr(out.wrench.torque, axis, float(value))
        self.wrench.publish(out)
        state = self.monitor.state
        if state is not None and state.touching:
            self.margin.publish(Float32(data=float(state.slip_margin)))


def main() -> None:
    rclpy.init(args=sys.argv)
    node = Palpate()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.tracker.close()
        node.destroy_node()


if __name__ == "__main__":
    main()
