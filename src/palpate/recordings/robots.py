"""Read recordings of robots: MCAP files, ROS 2 bags (folders) and ROS 1 bags, without ROS installed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, PalpateError
from palpate.recordings import mcapfile
from palpate.recordings.checked import with_losses
from palpate.recordings.clock import Clock, read_clock
from palpate.recordings.formats import Format
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.messages import READINGS, ros_types
from palpate.recordings.recording import Recording
from palpate.recordings.touchstream import Piece, TouchStream

if TYPE_CHECKING:
    from palpate.recordings.sinks import Recorder
    from palpate.touch import Touch

__all__ = ["Bag", "Mcap", "frames", "is_bag", "messages", "read_robot", "topics"]

#: Message definitions for bags without any (ROS 2 before Iron), besides those of ROS itself.
DEFINITIONS = {"tactile_msgs/msg/TactileState": "std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors\n"}


def is_bag(path: Path) -> bool:
    """Whether this is a ROS 2 bag (a folder) or a ROS 1 bag."""
    return (path / "metadata.yaml").is_file() or path.suffix.lower() == ".bag"


def _bag(path: Path, definitions: str = "") -> Any:
    typesys = ros_types()
    from rosbags.highlevel import AnyReader, AnyReaderError

    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    known = {**DEFINITIONS, **_definitions(definitions)}
    for name, text in known.items():
        found = typesys.get_types_from_msg(text, name)
        store.register({k: v for k, v in found.items() if k not in store.fielddefs})
    try:
        reader = AnyReader([path], default_typestore=store)
        reader.open()
    except AnyReaderError as error:
        raise InvalidInput(f"{path}: cannot be read as a bag ({str(error).rstrip('.')}).") from error
    except Exception as error:  # exceptions on a torn database, YAML or index
        raise InvalidInput(
            f"{path}: cannot be read as a bag ({str(error).rstrip('.') or type(error).__name__})."
        ) from error
    return reader


def _definitions(folder: str) -> dict[str, str]:
    """Definitions from a folder of packages (package/msg/Name.msg)."""
    if not folder:
        return {}
    files = sorted(Path(folder).rglob("*.msg"))
    if not files:
        raise InvalidInput(f"definitions {folder}: no message definitions (package/msg/Name.msg) are there.")
    return {
        f"{(f.parent.parent if f.parent.name == 'msg' else f.parent).name}/msg/{f.stem}": f.read_text(
            encoding="utf-8-sig"
        )
        for f in files
    }


def messages(path: Path, topic: str, *, definitions: str = "", salvage: bool = False) -> Iterator[tuple[float, Any]]:
    """(time of recording [s], message) of a topic of an MCAP file or a bag, in order."""
    if is_bag(path):
        return _bag_messages(path, topic, definitions)
    return mcapfile.read_messages(path, topic, salvage=salvage)


def _bag_messages(path: Path, topic: str, definitions: str) -> Iterator[tuple[float, Any]]:
    reader = _bag(path, definitions)
    try:
        connections = [c for c in reader.connections if c.topic == topic]
        if not connections:
            return
        unknown = {c.msgtype for c in connections} - set(reader.typestore.fielddefs)
        if unknown:
            raise InvalidInput(
                f"{path}: the bag does not define {', '.join(sorted(unknown))} of {topic}; give the folder of its package "
                "(package/msg/Name.msg) as definitions."
            )
        for connection, stamp, raw in reader.messages(connections=connections):
            yield stamp / 10**9, reader.deserialize(raw, connection.msgtype)
    except PalpateError:
        raise
    except Exception as error:  # exceptions of a decoder on torn bytes
        raise InvalidInput(
            f"{path}: a message of {topic} cannot be read ({str(error) or type(error).__name__})."
        ) from error
    finally:
        reader.close()


def topics(path: str | Path) -> dict[str, str]:
    """Topics of a file or bag and the names of their message types."""
    found = Path(path)
    if not is_bag(found):
        return mcapfile.topics(found)
    reader = _bag(found)
    try:
        return {c.topic: c.msgtype for c in reader.connections}
    finally:
        reader.close()


def _own(path: Path) -> dict[str, Any] | None:
    if path.suffix.lower() == ".mcap":
        return mcapfile.own(path)
    # `ros2 bag record` may have recorded palpate's own topics.
    parts = sorted(path.glob("*.mcap")) if path.is_dir() else []
    return mcapfile.own(parts[0]) if len(parts) == 1 else None


def frames(
    path: str | Path, mapping: TopicMapping | None = None, *, salvage: bool = False
) -> Iterator[tuple[float, Floats]]:
    """(time [s], readings (channel, *array)) of each message of a topic, in order.

    Without a ``mapping``, the topic that palpate wrote. A message that does not fit raises `InvalidInput`.
    """
    for stamp, values in _frames(Path(path), mapping, salvage):
        yield stamp.time, values


@dataclass
class _Stamp:
    """Stamps of a frame, from its message and from the recorder, and rest positions of its markers."""

    mapping: TopicMapping
    message: Any
    recorded: float
    rest: Floats | None

    @property
    def time(self) -> float:
        return self.mapping.time(self.message, self.recorded)


def _frames(path: Path, mapping: TopicMapping | None, salvage: bool) -> Iterator[tuple[_Stamp, Floats]]:
    if not path.is_file() and not is_bag(path):
        raise InvalidInput(f"{path}: no such file.")
    if mapping is None:
        known = _own(path)
        if known is None:
            raise InvalidInput(
                f"{path} was not written by palpate: name the topic and channels of its readings. It has {_listed(path)}."
            )
        mapping = TopicMapping(topic=READINGS, channels=[str(c) for c in known["channels"]])
    taken = messages(path, mapping.topic, definitions=mapping.definitions, salvage=salvage)
    rest: Floats | None = None
    any_found = False
    for recorded, message in taken:
        any_found = True
        values = mapping.readings(message)
        if mapping.markers:
            rest = values if rest is None else rest
            if values.shape != rest.shape:
                raise InvalidInput(
                    f"{mapping.topic}: {values[0].size} markers follow {rest[0].size}; each message must hold all of them, in one order."
                )
            values = values - rest
        yield _Stamp(mapping, message, recorded, rest), values
    if not any_found:
        raise InvalidInput(f"{path} has no topic {mapping.topic}; it has {_listed(path)}.")


def _listed(path: Path) -> str:
    return ", ".join(f"{t} ({k})" for t, k in topics(path).items()) or "no messages"


def read_robot(path: str | Path, mapping: TopicMapping | None = None, *, salvage: bool = False) -> Recording:
    """A recording from an MCAP file or a bag: all frames in the order of recording (`palpate.recordings.clock`).

    Palpate's own files need no ``mapping``. ``salvage`` reads a damaged MCAP file up to the damage.
    """
    found = Path(path)
    known = _own(found) if mapping is None and (found.is_file() or is_bag(found)) else None
    stamps: list[tuple[float, float | None]] = []
    recorded: list[float] = []
    parts: list[Floats] = []
    rest: Floats | None = None
    for stamp, values in _frames(found, mapping, salvage):
        if parts and values.shape != parts[0].shape:
            raise InvalidInput(f"{path}: a frame of shape {values.shape} follows frames of {parts[0].shape}.")
        stamps.append(stamp.mapping.stamped(stamp.message, stamp.recorded))
        recorded.append(stamp.recorded)
        rest = stamp.rest
        parts.append(values)
    clock = _clock(found, mapping, stamps, recorded)
    clock.tell()
    channels = tuple(mapping.channels) if mapping is not None else tuple(map(str, (known or {})["channels"]))
    readings = np.stack(parts)
    if clock.order is not None:
        readings = readings[clock.order]
    with np.errstate(over="ignore", under="ignore"):
        single = readings.astype(np.float32)
    readings = single if np.array_equal(single, readings, equal_nan=True) else readings
    positions = None
    shape = (known or {}).get("shape", ())
    if known is not None and "positions" in known:
        positions = np.asarray(known["positions"])
        readings = readings.reshape(len(readings), readings.shape[1], -1)
    elif shape and np.prod(shape) == np.prod(readings.shape[2:]):
        readings = readings.reshape(*readings.shape[:2], *shape)
    elif readings.ndim == 4 and readings.shape[2] == 1 and (mapping is None or mapping.shape is None):
        readings = readings[:, :, 0]
    if rest is not None and readings.ndim == 3:
        positions = rest[:2].T
    meta = known["meta"] if known is not None else {"source": found.name}
    return Recording(
        readings=readings, channels=channels, time=clock.time, positions=positions, meta={**meta, **clock.meta()}
    )


def _clock(
    path: Path, mapping: TopicMapping | None, stamps: Sequence[tuple[float, float | None]], recorded: Sequence[float]
) -> Clock:
    """One time from the stamps of messages and the times at which they were recorded."""
    units = {unit for _, unit in stamps}
    unit = units.pop() if len(units) == 1 else 1.0
    values = [s if unit == u or u is None else s * u for s, u in stamps]
    stamped = mapping is not None and bool(mapping.stamp)
    return read_clock(
        values,
        source=str(path),
        unit=unit,
        recorded=recorded if stamped else None,
        sort=mapping is not None and mapping.sort,
        untimed='name the stamp of its messages (stamp = "header.stamp" in [stream] of the skin.toml)',
    )


def _losses(path: Path, mapping: TopicMapping | None, taken: int) -> str:
    """The losses of a damaged MCAP file, in words."""
    count, torn = mcapfile.whole(path, READINGS if mapping is None else mapping.topic)
    words = []
    if torn:
        frames = round(torn / max(path.stat().st_size - torn, 1) * count)
        words.append(f"{torn} bytes from the damage on, some {frames} frames by their size")
    if count > taken:
        words.append(f"{count - taken} frames that cannot be read")
    return f"{' and '.join(words)} are lost" if words else "nothing is lost"


class Mcap(Format):
    """MCAP files: palpate's own, and robots' with a `TopicMapping`. A CRC-32 protects each chunk and all data."""

    name = "mcap"
    libraries = ("mcap",)
    extensions = (".mcap",)

    def recognises(self, path: Path) -> bool:
        with path.open("rb") as file:
            return file.read(8) == b"\x89MCAP0\r\n"

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        if mapping is not None and mcapfile.own(path) is not None and mapping.topic not in topics(path):
            mapping = None  # the mapping of a robot's messages does not concern palpate's own
        recording = read_robot(path, mapping, salvage=salvage)
        return with_losses(recording, None, path, _losses(path, mapping, len(recording.time))) if salvage else recording

    def write(self, recording: Recording, path: Path) -> None:
        path.unlink(missing_ok=True)  # a recorder makes its own file
        mcapfile.write_mcap(recording, path)

    def write_touch(self, touch: Touch, path: Path, record: Mapping[str, str]) -> None:
        path.unlink(missing_ok=True)
        with mcapfile.McapRecorder(path, (), meta=dict(record)) as out:
            count = 1 if touch.values.ndim == 1 + touch.surface.dimensions else len(touch.values)
            for i in range(count):
                out.touch(touch.frame(i), float(i) if touch.time is None else float(np.atleast_1d(touch.time)[i]))

    def _touches(self, path: Path, count: int, record: Mapping[str, str]) -> TouchStream:
        return _McapStream(path, count, record)

    def recorder(
        self, path: Path, channels: Sequence[str], *, positions: Any, meta: Mapping[str, Any] | None
    ) -> Recorder:
        return mcapfile.McapRecorder(path, channels, positions=positions, meta=meta)


class _McapStream(TouchStream):
    """Messages of each frame. The file's meta is at its beginning: it names the method, not the frames' outcome."""

    _out: Any = None

    def _add(self, start: int, piece: Piece) -> None:
        touch = piece.touch()
        if self._out is None:
            self._out = mcapfile.McapRecorder(self.path, (), meta={"method": touch.method, **self.record})
        for one, time in zip(touch, piece.dataset["time"].values):
            self._out.touch(one, float(time))

    def _finish(self) -> None:
        self._out.close()

    def _abandon(self) -> None:
        if self._out is not None:
            self._out.close()


class Bag(Format):
    """A bag of ROS: a folder (ROS 2, with db3 or mcap inside) or a file (ROS 1). Its messages have no checksums."""

    name = "bag"
    libraries = ("rosbags",)
    extensions = (".bag",)
    folder = True

    def recognises(self, path: Path) -> bool:
        return is_bag(path)

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        return read_robot(path, mapping, salvage=salvage)
