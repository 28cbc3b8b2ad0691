"""Import ROS 2's client library, or say how to get it."""

from __future__ import annotations

import importlib
import platform
import re
import sys
from typing import Any

from palpate.errors import InvalidInput, Unsupported

__all__ = ["message_class", "ros_client"]

#: Packages of the message types that the node publishes and serves.
MESSAGES = ("diagnostic_msgs", "geometry_msgs", "sensor_msgs", "std_msgs", "std_srvs")
#: Platform for which ROS 2's client exists as wheels: manylinux_2_28, for Python 3.11 to 3.14.
WHEELS = ("linux", "x86_64")
_SOURCED = "with a system installation of ROS 2: source /opt/ros/DISTRO/setup.bash, and install palpate for its Python"


def ros_client() -> Any:
    """Return the module ``rclpy``.

    Raises
    ------
    Unsupported
        ``rclpy``, or a package of ROS message types, cannot be imported; the error says how to install it on this machine.
    """
    try:
        found = importlib.import_module("rclpy")
        for name in MESSAGES:
            importlib.import_module(f"{name}.srv" if name == "std_srvs" else f"{name}.msg")
    except ImportError as error:
        raise Unsupported(_remedy(error)) from error
    return found


def _remedy(error: ImportError) -> str:
    name = (error.name or "").split(".")[0]
    if name not in ("rclpy", *MESSAGES):
        # a library that rclpy needs is missing or belongs to another ROS or Python
        return f"ROS 2 nodes cannot be served: {error}. Was rclpy made for this Python ({platform.python_version()})? Run it {_SOURCED}."
    if (sys.platform, platform.machine()) != WHEELS:
        return (
            f"ROS 2 nodes need the package {name}: there are no wheels of it for {sys.platform} on {platform.machine()}. "
            f"Run it {_SOURCED}."
        )
    return f'ROS 2 nodes need the package {name}: pip install "palpate[ros2]"; or run it {_SOURCED}.'


def message_class(name: str) -> Any:
    """Return the class of messages with a name such as "sensor_msgs/msg/Image".

    Raises
    ------
    InvalidInput
        Not such a name, or a package that this environment does not have.
    """
    matched = re.fullmatch(r"(\w+)(?:/msg)?/(\w+)", name)
    if matched is None:
        raise InvalidInput(
            f"{name!r} is not the name of a message type: write package/msg/Name, e.g. sensor_msgs/msg/Image."
        )
    package, kind = matched.groups()
    try:
        module = importlib.import_module(f"{package}.msg")
    except ImportError as error:
        raise InvalidInput(
            f"messages of the type {name} are of the package {package}, which is not installed ({error}). Source the workspace it was built in "
            "(source install/setup.bash) before palpate ros."
        ) from error
    if not hasattr(module, kind):
        raise InvalidInput(f"the package {package} has no message {kind}.")
    return getattr(module, kind)
