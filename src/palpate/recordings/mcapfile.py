"""MCAP: recordings written while they happen, and read from robots without ROS installed.

Written (``pip install palpate[live]``): readings as sensor_msgs/Image (32FC1, 32FC3, ... one plane of floats per channel, interleaved;
scattered taxels are one row), touches as foxglove.Grid (pressure, shear, standard deviation of the pressure) and
geometry_msgs/WrenchStamped (the sum of the traction: what presses on the pad, z into it; the moment about the surface's origin),
events as foxglove.Log. Readings are kept in single precision, time to the nanosecond. A chunk goes to the file when it is full, so that
a process that is killed loses less than a chunk.

Read: those, and messages of others whose numbers a `Mapping` picks out: sensor_msgs/Image 32FC*, and any message with lists of numbers
or of points, such as xela_server SensStream or tactile_msgs/TactileState. Their definitions are in the file.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.half_space import Floats
from palpate.elastic.quantities import AREA_CHANNELS
from palpate.errors import InvalidInput, Unsupported
from palpate.recordings.recording import Recording
from palpate.sensing.grids import AreaGrid
from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event

__all__ = ["READINGS", "Mapping", "McapRecorder", "frames", "read_mcap", "topics", "write_mcap"]

#: Topic of the readings that palpate writes, and of what it found in them.
READINGS, TOUCH, WRENCH, EVENTS = "/palpate/readings", "/palpate/touch", "/palpate/wrench", "/palpate/events"
#: Bytes after which a chunk is written: what a killed process can lose.
CHUNK = 64 * 1024
_IMAGE, _WRENCH = "sensor_msgs/msg/Image", "geometry_msgs/msg/WrenchStamped"


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """How the messages of one topic become readings.

    Parameters
    ----------
    topic : str
    channels : sequence of str
        What the numbers are, from `palpate.AREA_CHANNELS`, in the order of ``fields``.
    path : str
        Where the taxels are in the message, e.g. "sensors[0].taxels"; "" for an image.
    fields : sequence of str
        What to take of each taxel, e.g. ("x", "y", "z"); empty where the taxels are numbers.
    scale : float or sequence of float
        Multiplies the numbers (of each channel) to SI units; negative turns the sign.
    shape : (int, int), optional
        Rows and columns of the taxels; without it they are one row.
    """

    topic: str
    channels: Sequence[str]
    path: str = ""
    fields: Sequence[str] = ()
    scale: float | Sequence[float] = 1.0
    shape: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        unknown = [c for c in self.channels if c not in AREA_CHANNELS]
        if unknown or not self.channels:
            raise InvalidInput(
                f"channels must be names among {', '.join(AREA_CHANNELS)}; got {', '.join(unknown) or 'none'}."
            )
        if self.fields and len(self.fields) != len(self.channels):
            raise InvalidInput(f"{len(self.fields)} fields for {len(self.channels)} channels; name one field for each.")
        scale = np.atleast_1d(np.asarray(self.scale, dtype=np.float64))
        if scale.shape not in ((1,), (len(self.channels),)) or not (np.isfinite(scale).all() and (scale != 0).all()):
            raise InvalidInput(f"scale must be one number or one per channel, finite and not 0; got {self.scale!r}.")

    def readings(self, message: Any) -> Floats:
        """(channel, *array) of a message."""
        found = _at(message, self.path)
        if hasattr(found, "encoding") and hasattr(found, "step"):
            values = _image(found)
        elif self.fields:
            values = np.array([[float(_at(t, f)) for f in self.fields] for t in found], dtype=np.float64).T
        else:
            values = np.asarray(found, dtype=np.float64)
            values = values.reshape(1, -1) if values.ndim == 1 else values
        if len(values) != len(self.channels):
            raise InvalidInput(
                f"{self.topic}: messages hold {len(values)} channels, but {len(self.channels)} are named "
                f"({', '.join(self.channels)})."
            )
        if self.shape is not None:
            if values[0].size != math.prod(self.shape):
                raise InvalidInput(
                    f"{self.topic}: {values[0].size} taxels do not make a shape of {self.shape[0]} x {self.shape[1]}."
                )
            values = values.reshape(len(values), *self.shape)
        scale = np.broadcast_to(np.asarray(self.scale, dtype=np.float64), (len(values),))
        return np.asarray(values * scale.reshape(-1, *(1,) * (values.ndim - 1)))


def _at(message: Any, path: str) -> Any:
    """Follow a path like "sensors[0].taxels"."""
    found = message
    for name, index in re.findall(r"([A-Za-z_]\w*)|\[(\d+)\]", path):
        try:
            found = getattr(found, name) if name else found[int(index)]
        except (AttributeError, IndexError, TypeError) as error:
            there = ", ".join(n for n in getattr(found, "__dataclass_fields__", {}) if n != "__msgtype__")
            raise InvalidInput(
                f"the message has no {name or f'[{index}]'} on the way to {path!r}"
                + (f"; there is {there}." if there else ".")
            ) from error
    return found


def _image(message: Any) -> Floats:
    """(channel, y, x) of an image of floats."""
    matched = re.fullmatch(r"32FC(\d+)", message.encoding)
    if matched is None:
        raise InvalidInput(f"images must be 32FC1, 32FC3, ... (floats); got {message.encoding!r}.")
    count, rows, columns = int(matched[1]), int(message.height), int(message.width)
    data = np.asarray(message.data, dtype=np.uint8)
    need = int(message.step) * rows
    if message.step < 4 * count * columns or data.size < need:
        raise InvalidInput(f"an image of {columns} x {rows} x {count} floats has {data.size} bytes; it is truncated.")
    kind = ">f4" if message.is_bigendian else "<f4"
    lines = data[:need].reshape(rows, int(message.step))[:, : 4 * count * columns]
    values = np.ascontiguousarray(lines).view(kind).reshape(rows, columns, count)
    return np.asarray(np.moveaxis(values, -1, 0), dtype=np.float64)


def _libraries() -> Any:
    try:
        import mcap.writer
        import rosbags.typesys
    except ImportError as error:
        raise Unsupported('MCAP needs more packages: pip install "palpate[live]".') from error
    return mcap, rosbags.typesys


# -- writing -----------------------------------------------------------------------------------------------------------


class McapRecorder:
    """Writes readings, touches and events of a stream into an MCAP file while they come.

    Parameters
    ----------
    path : str or Path
        Must not exist yet: a recording is never overwritten.
    channels : sequence of str
        Of the readings.
    positions : array (taxel, 2) or (taxel,), optional
        Of scattered taxels [m].
    meta : mapping of str to str
        Anything worth keeping.
    chunk : int
        Bytes after which a chunk is written.
    """

    def __init__(
        self,
        path: str | Path,
        channels: Sequence[str],
        *,
        positions: Any = None,
        meta: dict[str, str] | None = None,
        chunk: int = CHUNK,
    ) -> None:
        mcap, typesys = _libraries()
        self.path, self.channels = Path(path), tuple(channels)
        self._types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        try:
            self._file = open(self.path, "xb")  # noqa: SIM115
        except FileExistsError as error:
            raise InvalidInput(f"{path} exists; a recording is not overwritten. Give another name.") from error
        except OSError as error:
            raise InvalidInput(f"{path}: cannot write there ({error.strerror}).") from error
        self._writer = mcap.writer.Writer(self._file, chunk_size=chunk)
        self._writer.start(profile="ros2", library="palpate")
        facts = {"channels": json.dumps(self.channels), "meta": json.dumps(meta or {})}
        if positions is not None:
            facts["positions"] = json.dumps(np.asarray(positions).tolist())
        self._writer.add_metadata("palpate", facts)
        self._file.flush()
        self._ids: dict[str, int] = {}
        self._count = 0

    def readings(self, time: float, values: Any) -> None:
        """One frame (channel, *array) at ``time`` [s]."""
        data = to_numpy(values)
        if len(data) != len(self.channels) or data.ndim not in (2, 3):
            raise InvalidInput(
                f"a frame must have shape (channel, taxel) or (channel, y, x) with {len(self.channels)} channels; got {data.shape}."
            )
        rows, columns = (1, data.shape[1]) if data.ndim == 2 else data.shape[1:]
        packed = np.ascontiguousarray(np.moveaxis(data.reshape(len(data), rows, columns), 0, -1), dtype="<f4")
        kind = self._types.types[_IMAGE]
        message = kind(
            header=self._header(time),
            height=rows,
            width=columns,
            encoding=f"32FC{len(data)}",
            is_bigendian=0,
            step=4 * len(data) * columns,
            data=packed.view(np.uint8).reshape(-1),
        )
        self._ros(READINGS, _IMAGE, message, time)

    def touch(self, touch: Touch, time: float | None = None) -> None:
        """What was found in one frame."""
        from foxglove import messages

        now = float(touch.time) if time is None else time  # type: ignore[arg-type]
        grid = touch.surface
        values = to_numpy(touch.values).astype("<f4")
        std = np.zeros_like(values[-1]) if touch.errors is None else to_numpy(touch.std.values).astype("<f4")[-1]
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
        message = messages.Grid(
            timestamp=messages.Timestamp(sec=_nanoseconds(now) // 10**9, nsec=_nanoseconds(now) % 10**9),
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
        )
        self._foxglove(TOUCH, message, now)
        wrench = self._types.types["geometry_msgs/msg/Wrench"]
        vector = self._types.types["geometry_msgs/msg/Vector3"]
        force, moment = to_numpy(touch.force), np.atleast_1d(to_numpy(touch.moment))
        if grid.dimensions == 1:
            force, moment = np.array([force[0], 0.0, force[1]]), np.array([0.0, moment[0], 0.0])
        stamped = self._types.types[_WRENCH](
            header=self._header(now),
            wrench=wrench(
                force=vector(**dict(zip("xyz", map(float, force)))),
                torque=vector(**dict(zip("xyz", map(float, moment)))),
            ),
        )
        self._ros(WRENCH, _WRENCH, stamped, now)

    def event(self, event: Event) -> None:
        """Something that a `GraspMonitor` noticed."""
        from foxglove import messages

        warning = event.began and event.kind != "contact"
        self._foxglove(
            EVENTS,
            messages.Log(
                timestamp=messages.Timestamp(
                    sec=_nanoseconds(event.time) // 10**9, nsec=_nanoseconds(event.time) % 10**9
                ),
                level=messages.LogLevel.Warning if warning else messages.LogLevel.Info,
                message=str(event),
                name="palpate",
            ),
            event.time,
        )

    def close(self) -> None:
        """Finish the file: index and summary."""
        if not self._file.closed:
            self._writer.finish()
            self._file.close()

    def __enter__(self) -> McapRecorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _header(self, time: float) -> Any:
        stamp = self._types.types["builtin_interfaces/msg/Time"]
        whole = _nanoseconds(time)
        return self._types.types["std_msgs/msg/Header"](
            stamp=stamp(sec=whole // 10**9, nanosec=whole % 10**9), frame_id="palpate"
        )

    def _ros(self, topic: str, kind: str, message: Any, time: float) -> None:
        if topic not in self._ids:
            text = self._types.generate_msgdef(kind, ros_version=2)[0]
            schema = self._writer.register_schema(name=kind, encoding="ros2msg", data=text.encode())
            self._ids[topic] = self._writer.register_channel(topic=topic, message_encoding="cdr", schema_id=schema)
        self._add(topic, bytes(self._types.serialize_cdr(message, kind)), time)

    def _foxglove(self, topic: str, message: Any, time: float) -> None:
        if topic not in self._ids:
            known = type(message).get_schema()
            schema = self._writer.register_schema(name=known.name, encoding=known.encoding, data=known.data)
            self._ids[topic] = self._writer.register_channel(topic=topic, message_encoding="protobuf", schema_id=schema)
        self._add(topic, message.encode(), time)

    def _add(self, topic: str, data: bytes, time: float) -> None:
        now = _nanoseconds(time)
        try:
            self._writer.add_message(self._ids[topic], log_time=now, data=data, publish_time=now, sequence=self._count)
            self._file.flush()  # whole chunks are then with the system, and survive this process
        except OSError as error:
            raise InvalidInput(
                f"{self.path}: writing failed ({error.strerror}); what was written before is readable with "
                "palpate convert --salvage."
            ) from error
        self._count += 1


def _nanoseconds(time: float) -> int:
    if not (math.isfinite(time) and time >= 0):
        raise InvalidInput(f"MCAP keeps times from 0 on; got {time!r} s.")
    return round(time * 1e9)


def write_mcap(recording: Recording, path: str | Path) -> None:
    """A whole recording (also `palpate convert`)."""
    if recording.time[0] < 0:
        raise InvalidInput("MCAP keeps times from 0 on; shift the recording's time.")
    with McapRecorder(path, recording.channels, positions=recording.positions, meta=recording.meta) as out:
        for time, values in zip(recording.time, recording.readings):
            out.readings(float(time), values)


# -- reading -----------------------------------------------------------------------------------------------------------


def _messages(path: Path, salvage: bool) -> Iterator[tuple[Any, Any, Any]]:
    """(schema, channel, message) in the file's order; the end of a torn file is its last whole message."""
    _libraries()
    import mcap.exceptions
    import mcap.reader

    with path.open("rb") as file:
        try:
            if salvage:
                yield from mcap.reader.NonSeekingReader(file).iter_messages(log_time_order=False)
            else:
                yield from mcap.reader.make_reader(file).iter_messages()
        except (mcap.exceptions.McapError, EOFError, ValueError, OSError) as error:
            if not salvage:
                raise InvalidInput(
                    f"{path}: cannot be read as MCAP; the file is torn or of another format. palpate convert --salvage takes what "
                    "is whole."
                ) from error
        except Exception as error:  # a decompressor at the torn end of a chunk
            if not salvage:
                raise InvalidInput(f"{path}: cannot be read as MCAP ({error}).") from error


def topics(path: str | Path) -> dict[str, str]:
    """Topics of a file and the names of their message types."""
    return {channel.topic: schema.name if schema else "" for schema, channel, _ in _messages(Path(path), True)}


class _Decoder:
    """Decodes ROS 2 messages by the definitions in the file."""

    def __init__(self) -> None:
        _, typesys = _libraries()
        self._typesys = typesys
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._known: set[str] = set()

    def __call__(self, schema: Any, channel: Any, message: Any) -> Any:
        if schema is None or channel.message_encoding != "cdr" or schema.encoding != "ros2msg":
            raise Unsupported(
                f"{channel.topic}: messages are {schema.name if schema else 'without a schema'} in {channel.message_encoding}; "
                "readings are taken from ROS 2 messages (cdr)."
            )
        name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/", 1)
        if name not in self._known:
            found = self._typesys.get_types_from_msg(schema.data.decode(), name)
            self._store.register({k: v for k, v in found.items() if k not in self._store.fielddefs})
            self._known.add(name)
        return self._store.deserialize_cdr(message.data, name)


def _own(path: Path) -> dict[str, str] | None:
    """What palpate wrote down about its own file."""
    import mcap.reader
    import mcap.records
    import mcap.stream_reader

    with path.open("rb") as file:
        try:
            for record in mcap.stream_reader.StreamReader(file).records:
                if isinstance(record, mcap.records.Metadata) and record.name == "palpate":
                    return dict(record.metadata)
                if isinstance(record, mcap.records.Message | mcap.records.Chunk):
                    return None
        except Exception:  # torn or foreign bytes, in the parser or a decompressor: the reading that follows says so
            return None
    return None


def frames(
    path: str | Path, mapping: Mapping | None = None, *, salvage: bool = False
) -> Iterator[tuple[float, Floats]]:
    """(time [s], readings (channel, *array)) of each message of a topic, as they come in the file.

    Without a ``mapping`` those that palpate wrote. A message that does not fit raises `InvalidInput`.
    """
    found = Path(path)
    if not found.is_file():
        raise InvalidInput(f"{found}: no such file.")
    own = _own(found)
    if mapping is None:
        if own is None:
            there = topics(found)
            raise InvalidInput(
                f"{found} was not written by palpate: name the topic and channels of its readings. It has "
                f"{', '.join(f'{t} ({k})' for t, k in there.items()) or 'no messages'}."
            )
        mapping = Mapping(topic=READINGS, channels=json.loads(own["channels"]))
    decode, any_found = _Decoder(), False
    for schema, channel, message in _messages(found, salvage):
        if channel.topic == mapping.topic:
            any_found = True
            yield message.log_time * 1e-9, mapping.readings(decode(schema, channel, message))
    if not any_found:
        there = topics(found)
        raise InvalidInput(
            f"{found} has no topic {mapping.topic}; it has {', '.join(f'{t} ({k})' for t, k in there.items()) or 'no messages'}."
        )


def read_mcap(path: str | Path, mapping: Mapping | None = None, *, salvage: bool = False) -> Recording:
    """A recording from an MCAP file; frames out of order or at the same time as another are left out.

    ``salvage`` reads a torn file as far as it goes.
    """
    stamps: list[float] = []
    parts: list[Floats] = []
    for time, values in frames(path, mapping, salvage=salvage):
        if stamps and time <= stamps[-1]:
            continue
        if parts and values.shape != parts[0].shape:
            raise InvalidInput(f"{path}: a frame of shape {values.shape} follows frames of {parts[0].shape}.")
        stamps.append(time)
        parts.append(values)
    own = _own(Path(path)) if mapping is None else None
    channels = tuple(mapping.channels) if mapping is not None else tuple(json.loads((own or {})["channels"]))
    readings = np.stack(parts).astype(np.float32)
    positions = None
    if own is not None and "positions" in own:
        positions = np.asarray(json.loads(own["positions"]))
        readings = readings.reshape(len(readings), readings.shape[1], -1)
    elif readings.ndim == 4 and readings.shape[2] == 1:
        readings = readings[:, :, 0]
    meta = json.loads(own["meta"]) if own is not None else {"source": Path(path).name}
    return Recording(readings=readings, channels=channels, time=np.array(stamps), positions=positions, meta=meta)
