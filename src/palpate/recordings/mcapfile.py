"""MCAP files: written during a stream, and read from robots without ROS installed.

Writing (``pip install palpate[bags]``): the messages of `palpate.recordings.messages`. Readings are stored unchanged,
time in nanoseconds. A chunk is written when it is full, so that a killed process loses less than a chunk. For a
camera, a metadata record before the first touch holds the position of the picture.

Reading: those messages, and messages of other programs whose numbers a `TopicMapping` selects: images of floats,
foxglove Grids, and any message with lists of numbers or of points, encoded by ROS 2 (cdr) or as Protobuf. Their
definitions are in the file.
"""

from __future__ import annotations

import json
import weakref
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._extras import missing
from palpate.errors import InvalidInput, PalpateError, Unsupported
from palpate.recordings.checked import CHECKSUM
from palpate.recordings.damage import DAMAGE_OF_PACKED
from palpate.recordings.heldfile import Apart, HeldFile
from palpate.recordings.locks import claim
from palpate.recordings.messages import READINGS, Encoder, Kind, nanoseconds, ros_types
from palpate.recordings.meta import plain_meta
from palpate.recordings.recording import Recording
from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event

__all__ = ["McapRecorder", "own", "read_messages", "topics", "write_mcap"]

#: Bytes in a chunk: the largest loss if the process is killed.
CHUNK = 64 * 1024
#: Name of the metadata record before the first readings with their shape, which a message with one row does not
#: contain: ``shape``, JSON.
SHAPE = "palpate.shape"
#: Name of the metadata record with the position of the picture for the following touches: ``view``, JSON for
#: `View.restored`.
VIEW = "palpate.view"


def _library() -> Any:
    try:
        import mcap.writer
    except ImportError as error:
        raise missing("MCAP files", error) from error
    return mcap


# -- writing -----------------------------------------------------------------------------------------------------------


class McapRecorder:
    """Writes readings, touches and events of a stream into an MCAP file as they arrive.

    Parameters
    ----------
    path : str or Path
        Must not exist yet: a recording is never overwritten.
    channels : sequence of str
        Channels of the readings.
    positions : array (taxel, 2) or (taxel,), optional
        Positions of scattered taxels [m].
    meta : mapping
        Anything worth keeping, as in `palpate.Recording`.
    """

    def __init__(
        self,
        path: str | Path,
        channels: Sequence[str],
        *,
        positions: Any = None,
        meta: Mapping[str, Any] | None = None,
    ) -> None:
        mcap = _library()
        self.path, self.channels = Path(path), tuple(channels)
        self._encoder = Encoder(self.channels)
        facts = {"channels": json.dumps(self.channels), "meta": json.dumps(plain_meta(meta))}
        if positions is not None:
            facts["positions"] = json.dumps(np.asarray(positions).tolist())
        facts[CHECKSUM] = str(_sum(facts))
        release = claim(self.path)
        try:
            self._file = HeldFile(self.path)
        except FileExistsError as error:
            release()
            raise InvalidInput(f"{path} exists; a recording is not overwritten. Give another name.") from error
        except OSError as error:
            release()
            raise InvalidInput(f"{path}: cannot write there ({error.strerror}).") from error
        # until the recording is closed or forgotten, at the latest until the process ends
        self._release = weakref.finalize(self, release)
        self._open = True
        self._apart = Apart()
        self._ids: dict[str, int] = {}
        self._count = self._frames = self._kept = 0
        self._view: dict[str, Any] | None = None
        self._writer = mcap.writer.Writer(self._file, chunk_size=CHUNK, enable_data_crcs=True)
        self._writer.start(profile="ros2", library="palpate")
        self._writer.add_metadata("palpate", facts)
        try:
            self._guarded(self._file.commit)
        except InvalidInput:
            self.path.unlink(missing_ok=True)
            raise

    def readings(self, time: float, values: Any) -> None:
        """One frame (channel, *array) at ``time`` [s]."""
        kind, data = self._encoder.readings(time, values)
        if self._open and not self._frames:
            self._describe(SHAPE, {"shape": json.dumps(np.shape(values)[1:])})
        self._add(kind, data, time)

    def touch(self, touch: Touch, time: float | None = None) -> None:
        """Write the result of one frame."""
        now = float(touch.time) if time is None else time  # type: ignore[arg-type]
        self._write_view(touch)
        for kind, data in self._encoder.touch(touch, now):
            self._add(kind, data, now)

    def event(self, event: Event) -> None:
        """Write an event of a `GraspMonitor`."""
        self._add(*self._encoder.event(event), event.time)

    def close(self) -> None:
        """Finish the file: index and summary."""
        if self._open:
            self._guarded(self._finish)
            self._open = False
            self._apart.end()
            self._release()

    def __enter__(self) -> McapRecorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write_view(self, touch: Touch) -> None:
        """Write the position of the picture: once, and again if it changes."""
        described = None if touch.view is None else touch.view.described()
        if self._open and described is not None and described != self._view:
            self._describe(VIEW, {"view": json.dumps(described)})
            self._view = described

    def _describe(self, name: str, facts: dict[str, str]) -> None:
        """Write a metadata record, which is not part of a chunk and goes to the disk directly."""

        def act() -> None:
            self._writer.add_metadata(name, facts)
            self._file.commit()

        self._guarded(act)

    def _add(self, kind: Kind, data: bytes, time: float) -> None:
        if not self._open:
            raise InvalidInput(f"{self.path}: this recording is closed.")
        now = nanoseconds(time)
        self._guarded(lambda: self._put(kind, data, now))

    def _put(self, kind: Kind, data: bytes, now: int) -> None:
        if kind.topic not in self._ids:
            schema = self._writer.register_schema(name=kind.name, encoding=kind.schema_encoding, data=kind.schema)
            self._ids[kind.topic] = self._writer.register_channel(
                topic=kind.topic, message_encoding=kind.message_encoding, schema_id=schema
            )
        self._writer.add_message(self._ids[kind.topic], log_time=now, data=data, publish_time=now, sequence=self._count)
        self._count += 1
        self._frames += kind.topic == READINGS
        # Whole chunks are handed to the system, and survive this process.
        if self._file.commit():
            self._kept = self._frames

    def _finish(self) -> None:
        self._writer.finish()
        self._file.commit()
        self._file.close()

    def _guarded(self, act: Callable[[], Any]) -> None:
        try:
            self._apart(act)
        except OSError as error:
            # Stop here: earlier chunks are intact, later ones would be damaged.
            self._open = False
            self._file.close()
            self._apart.end()
            self._release()
            what = (
                f"the {self._kept} frames before are readable with palpate convert --salvage"
                if self._kept
                else "no frame was kept"
            )
            raise InvalidInput(f"{self.path}: writing failed ({error.strerror or error}); {what}.") from error


def write_mcap(recording: Recording, path: str | Path) -> None:
    """Write a whole recording (also used by `palpate convert`)."""
    if recording.time[0] < 0:
        raise InvalidInput("MCAP keeps times from 0 on; shift the recording's time.")
    stamps = np.array([nanoseconds(t) for t in recording.time])
    same = np.flatnonzero(np.diff(stamps) <= 0)
    if len(same):
        at = int(same[0])
        apart = recording.time[at + 1] - recording.time[at]
        raise InvalidInput(
            f"MCAP keeps whole nanoseconds, and frames {at} and {at + 1} are {apart:.3g} s apart; write .nc, .h5 or .npz."
        )
    with McapRecorder(path, recording.channels, positions=recording.positions, meta=recording.meta) as out:
        for time, values in zip(recording.time, recording.readings):
            out.readings(float(time), values)


# -- reading -----------------------------------------------------------------------------------------------------------


def _damage() -> tuple[type[Exception], ...]:
    import mcap.exceptions
    import zstandard

    return (mcap.exceptions.McapError, zstandard.ZstdError, *DAMAGE_OF_PACKED)


def _records(path: Path, salvage: bool, topic: str | None = None) -> Iterator[tuple[Any, Any, Any]]:
    """(schema, channel, message) of a topic, by the time of recording. With ``salvage``, and for files of palpate, in
    the order of the file, up to the last whole chunk of a damaged file.

    Checksums of chunks, data and index are verified if the file has them.
    """
    _library()
    import mcap.reader

    limit = path.stat().st_size
    ours = not salvage and own(path) is not None
    with path.open("rb") as file:
        try:
            if salvage or ours:  # the index is not needed; a torn file is read up to the damage
                reader = mcap.reader.NonSeekingReader(file, validate_crcs=True, record_size_limit=limit)
                yield from reader.iter_messages(topic, log_time_order=False)
            else:
                _confirm(file, limit)
                file.seek(0)
                reader = mcap.reader.make_reader(file, validate_crcs=True)
                yield from reader.iter_messages(topic)
        except _damage() as error:
            if not salvage:
                raise InvalidInput(
                    f"{path}: cannot be read as MCAP; the file is cut off, damaged or of another format ({_short(error)}). palpate convert "
                    "--salvage takes what is whole."
                ) from error


def whole(path: Path, topic: str) -> tuple[int, int]:
    """Messages of a topic in whole chunks, and bytes after the last one of a damaged file (0: undamaged)."""
    _library()
    import mcap.reader

    count = end = 0
    with path.open("rb") as file:
        reader = mcap.reader.NonSeekingReader(file, validate_crcs=True, record_size_limit=path.stat().st_size)
        try:
            for _ in reader.iter_messages(topic, log_time_order=False):
                count, end = count + 1, file.tell()
        except _damage():
            return count, path.stat().st_size - end
    return count, 0


def _short(error: Exception) -> str:
    return str(error)[:120] or type(error).__name__


def _confirm(file: Any, limit: int) -> None:
    """Read a file of another program once: verify that its records are consecutive and its checksums are right."""
    import mcap.records
    import mcap.stream_reader

    footer = None
    for record in mcap.stream_reader.StreamReader(
        file, emit_chunks=True, validate_crcs=True, record_size_limit=limit
    ).records:
        footer = record
    if isinstance(footer, mcap.records.Footer) and footer.summary_crc and footer.summary_start:
        # Up to the checksum itself: its 4 bytes, and 8 for the magic at the end, remain.
        file.seek(footer.summary_start)
        if zlib.crc32(file.read(limit - 12 - footer.summary_start)) != footer.summary_crc:
            raise ValueError("the checksum of its index is wrong")


def topics(path: Path) -> dict[str, str]:
    """Topics of a file and the names of their message types."""
    return {channel.topic: schema.name if schema else "" for schema, channel, _ in _records(path, True)}


def read_messages(path: Path, topic: str, *, salvage: bool = False) -> Iterator[tuple[float, Any]]:
    """(time [s], message) of a topic, in the order of the file."""
    decode = _Decoder()
    for schema, channel, message in _records(path, salvage, topic):
        try:
            decoded = decode(schema, channel, message)
        except PalpateError:
            raise
        except decode.damage() as error:
            if salvage:
                return
            raise InvalidInput(
                f"{path}: a message of {topic} cannot be read ({_short(error)}); it is damaged."
            ) from error
        yield message.log_time / 10**9, decoded


class _Decoder:
    """Decodes messages by the definitions in the file."""

    def __init__(self) -> None:
        self._typesys = ros_types()
        self._store = self._typesys.get_typestore(self._typesys.Stores.ROS2_HUMBLE)
        self._known: set[str] = set()
        self._protobuf: dict[int, Any] = {}

    def damage(self) -> tuple[type[Exception], ...]:
        """Exceptions of the libraries on damaged messages and definitions."""
        import rosbags.interfaces
        import rosbags.serde

        found = (
            *DAMAGE_OF_PACKED,
            AttributeError,
            AssertionError,
            RecursionError,
            rosbags.serde.SerdeError,
            self._typesys.TypesysError,
        )
        if self._protobuf:
            import google.protobuf.message

            return (*found, google.protobuf.message.Error)
        return found

    def __call__(self, schema: Any, channel: Any, message: Any) -> Any:
        if schema is not None and channel.message_encoding == "protobuf" and schema.encoding == "protobuf":
            if schema.id not in self._protobuf:
                try:
                    from mcap_protobuf.decoder import DecoderFactory
                except ImportError as error:
                    raise missing("Protobuf messages", error) from error
                self._protobuf[schema.id] = DecoderFactory().decoder_for("protobuf", schema)
            return self._protobuf[schema.id](message.data)
        if schema is None or channel.message_encoding != "cdr" or schema.encoding != "ros2msg":
            raise Unsupported(
                f"{channel.topic}: messages are {schema.name if schema else 'without a schema'} in {channel.message_encoding}; "
                "readings are taken from ROS 2 messages (cdr) and Protobuf."
            )
        name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/", 1)
        if name not in self._known:
            found = self._typesys.get_types_from_msg(schema.data.decode(), name)
            self._store.register({k: v for k, v in found.items() if k not in self._store.fielddefs})
            self._known.add(name)
        return self._store.deserialize_cdr(message.data, name)


def _sum(facts: Mapping[str, str]) -> int:
    return zlib.crc32(json.dumps({k: v for k, v in facts.items() if k != CHECKSUM}, sort_keys=True).encode())


def own(path: Path) -> dict[str, Any] | None:
    """palpate's own metadata in its file: channels, positions, meta, and the shape of a frame without its channels."""
    _library()
    import mcap.records
    import mcap.stream_reader

    facts: dict[str, Any] | None = None
    with path.open("rb") as file:
        try:
            for record in mcap.stream_reader.StreamReader(file, record_size_limit=path.stat().st_size).records:
                if isinstance(record, mcap.records.Metadata) and record.name == "palpate":
                    facts = _facts(record.metadata, path)
                elif isinstance(record, mcap.records.Metadata) and record.name == SHAPE and facts is not None:
                    facts["shape"] = tuple(int(n) for n in json.loads(record.metadata["shape"]))
                if isinstance(record, mcap.records.Message | mcap.records.Chunk):
                    return facts
        except PalpateError:
            raise
        except _damage():  # the following read reports it
            return facts
    return facts


def _facts(held: Mapping[str, str], path: Path) -> dict[str, Any]:
    """Channels, positions and meta as they were written, or `InvalidInput`."""
    damaged = InvalidInput(
        f"{path} was damaged: its names of channels, positions or meta do not agree with their checksum."
    )
    if CHECKSUM in held and held[CHECKSUM] != str(_sum(held)):
        raise damaged
    try:
        facts = {k: json.loads(held[k]) for k in ("channels", "positions", "meta") if k in held}
    except (ValueError, RecursionError) as error:
        raise damaged from error
    if not isinstance(facts.get("channels"), list) or not isinstance(facts.get("meta"), dict):
        raise damaged
    return facts
