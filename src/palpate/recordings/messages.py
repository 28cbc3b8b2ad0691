"""Convert readings, touches and events to standard messages of robotics.

Readings are sensor_msgs/Image (32FC1, 32FC3, ...: one plane of floats per channel, interleaved; 64FC1, ... if single
precision would round them; scattered taxels are one row; values that are not finite are missing, NaN). Touches are
foxglove.Grid (pressure, shear, standard deviation of the pressure) and geometry_msgs/WrenchStamped (the force that
acts on the pad, z into it, and the moment about the surface's origin). Events are foxglove.Log.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._extras import missing
from palpate.errors import InvalidInput
from palpate.recordings.frame import frame_values
from palpate.sensing.grids import AreaGrid
from palpate.sensing.times import as_second
from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event

__all__ = ["EVENTS", "READINGS", "TOUCH", "WRENCH", "Encoder", "Kind", "nanoseconds", "ros_types"]

#: Topic of the readings, and of the results.
READINGS, TOUCH, WRENCH, EVENTS = "/palpate/readings", "/palpate/touch", "/palpate/wrench", "/palpate/events"
_IMAGE, _WRENCH = "sensor_msgs/msg/Image", "geometry_msgs/msg/WrenchStamped"


@dataclass(frozen=True)
class Kind:
    """The messages of a topic: name, definition, and packing."""

    topic: str
    name: str
    schema_encoding: str
    schema: bytes
    message_encoding: str


#: Messages count seconds in 31 bits: they end in 2038.
_END = 2**31


def nanoseconds(time: float) -> int:
    """Whole nanoseconds of a time [s] from 0 on."""
    seconds = as_second(time)
    if not 0 <= seconds < _END:
        raise InvalidInput(
            f"messages keep times from 0 on and below 2**31 s; got {seconds:g} s. Shift the time, or write .nc or .h5."
        )
    whole = math.floor(seconds)
    return whole * 10**9 + round((seconds - whole) * 1e9)


def ros_types() -> Any:
    """The module `rosbags.typesys`; a missing one raises an error that names the extra."""
    try:
        import rosbags.typesys
    except ImportError as error:
        raise missing("ROS messages", error) from error
    return rosbags.typesys


class Encoder:
    """Encodes readings, touches and events. ``channels`` are those of the readings."""

    def __init__(self, channels: Sequence[str] = ()) -> None:
        typesys = ros_types()
        self.channels = tuple(channels)
        self._types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._kinds: dict[str, Kind] = {}

    def readings(self, time: float, values: Any) -> tuple[Kind, bytes]:
        """One frame (channel, *array)."""
        data = frame_values(values, self.channels)
        rows, columns = (1, data.shape[1]) if data.ndim == 2 else data.shape[1:]
        planes = np.moveaxis(data.reshape(len(data), rows, columns), 0, -1).astype(np.float64)
        with np.errstate(over="ignore", under="ignore"):
            single = planes.astype("<f4")
        exact = np.array_equal(single, planes, equal_nan=True)
        values = np.ascontiguousarray(single if exact else planes.astype("<f8"))
        message = self._types.types[_IMAGE](
            header=self._header(time),
            height=rows,
            width=columns,
            encoding=f"{32 if exact else 64}FC{len(data)}",
            is_bigendian=0,
            step=values.itemsize * len(data) * columns,
            data=values.view(np.uint8).reshape(-1),
        )
        return self._ros(READINGS, _IMAGE, message)

    def touch(self, touch: Touch, time: float) -> Iterator[tuple[Kind, bytes]]:
        """The map and the wrench of one frame."""
        from foxglove import messages

        grid = touch.surface
        values = to_numpy(touch.values).astype("<f4")
        std = np.zeros_like(values[-1]) if not touch.has_intervals else to_numpy(touch.std()).astype("<f4")[-1]
        layers = {"pressure": values[-1], "shear_x": values[0], "std": std}
        if grid.dimensions == 2:
            layers["shear_y"] = values[1]
        fields = list(layers)
        packed = np.stack([layers[f] for f in fields], axis=-1)
        packed = packed.reshape(-1, packed.shape[-2], len(fields))
        dy, dx = (grid.spacings[0], grid.spacings[-1])
        left, low = (
            float(grid.x[0]) - dx / 2,
            float(grid.axes[0][0]) - dy / 2 if isinstance(grid, AreaGrid) else -dy / 2,
        )
        float32 = messages.PackedElementFieldNumericType.Float32
        yield self._foxglove(
            TOUCH,
            messages.Grid(
                timestamp=_timestamp(time),
                frame_id="palpate",
                pose=messages.Pose(
                    position=messages.Vector3(x=left, y=low, z=0.0), orientation=messages.Quaternion(x=0, y=0, z=0, w=1)
                ),
                column_count=packed.shape[1],
                cell_size=messages.Vector2(x=dx, y=dy),
                row_stride=4 * len(fields) * packed.shape[1],
                cell_stride=4 * len(fields),
                fields=[messages.PackedElementField(name=f, offset=4 * i, type=float32) for i, f in enumerate(fields)],
                data=np.ascontiguousarray(packed).tobytes(),
            ),
        )
        vector = self._types.types["geometry_msgs/msg/Vector3"]
        force, moment = to_numpy(touch.force), np.atleast_1d(to_numpy(touch.moment))
        if grid.dimensions == 1:
            force, moment = np.array([force[0], 0.0, force[1]]), np.array([0.0, moment[0], 0.0])
        wrench = self._types.types["geometry_msgs/msg/Wrench"](
            force=vector(**dict(zip("xyz", map(float, force)))), torque=vector(**dict(zip("xyz", map(float, moment))))
        )
        yield self._ros(WRENCH, _WRENCH, self._types.types[_WRENCH](header=self._header(time), wrench=wrench))

    def event(self, event: Event) -> tuple[Kind, bytes]:
        """An event of a `GraspMonitor`."""
        from foxglove import messages

        warning = event.began and event.kind != "contact"
        level = messages.LogLevel.Warning if warning else messages.LogLevel.Info
        return self._foxglove(
            EVENTS, messages.Log(timestamp=_timestamp(event.time), level=level, message=str(event), name="palpate")
        )

    def _header(self, time: float) -> Any:
        stamp = self._types.types["builtin_interfaces/msg/Time"]
        whole = nanoseconds(time)
        return self._types.types["std_msgs/msg/Header"](
            stamp=stamp(sec=whole // 10**9, nanosec=whole % 10**9), frame_id="palpate"
        )

    def _ros(self, topic: str, name: str, message: Any) -> tuple[Kind, bytes]:
        if topic not in self._kinds:
            text = self._types.generate_msgdef(name, ros_version=2)[0]
            self._kinds[topic] = Kind(topic, name, "ros2msg", text.encode(), "cdr")
        return self._kinds[topic], bytes(self._types.serialize_cdr(message, name))

    def _foxglove(self, topic: str, message: Any) -> tuple[Kind, bytes]:
        if topic not in self._kinds:
            known = type(message).get_schema()
            self._kinds[topic] = Kind(topic, known.name, known.encoding, known.data, "protobuf")
        return self._kinds[topic], message.encode()


def _timestamp(time: float) -> Any:
    from foxglove import messages

    whole = nanoseconds(time)
    return messages.Timestamp(sec=whole // 10**9, nsec=whole % 10**9)
