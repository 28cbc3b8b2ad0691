"""Recordings and results as CSV text.

A recording has the columns "time (s)", then "channel[taxel] (unit)" or "channel[row;column] (unit)". Lines that begin
with # are comments for other programs; palpate stores in them ``# meta``, ``# positions (m)`` of scattered taxels, and
at the end ``# palpate_crc32``, a checksum of all numbers. If a file of another program does not end with a line break,
`palpate.errors.UncheckedInput` warns that its last number may be cut.
"""

from __future__ import annotations

import csv
import json
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.elastic.channels import channel_unit, is_channel
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.checked import CHECKSUM, confirm_recording, json_object, recording_checksum, with_losses
from palpate.recordings.clock import Clock, read_clock
from palpate.recordings.columns import TableMapping
from palpate.recordings.dates import TimeCells
from palpate.recordings.formats import Format
from palpate.recordings.mapped import explained, read_mapped
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.opened import OpenRecording
from palpate.recordings.recording import Recording
from palpate.recordings.tabletext import Table, Titles, read_table_text
from palpate.recordings.textlines import cells, is_text, lines_of, number, text_of, warn_of_a_cut
from palpate.recordings.touchstream import Piece, TouchStream
from palpate.touch import Forces
from palpate.touch.table import write_table
from palpate.units import convert_factor

if TYPE_CHECKING:
    from palpate.touch import Touch

__all__ = ["Csv"]

_TITLE = "# palpate recording 2"
_EDITED = "If you edited it on purpose, delete its last line (# palpate_crc32 ...), and it is read as it is."
_NO_FRAMES = "{path}: no frames; a CSV recording has a header line and one line per frame."
_TRUNCATED = (
    "{path} is truncated: its last line, the checksum, is missing. palpate convert --salvage takes the whole lines; "
    f'if you deleted it on purpose, delete the first line ("{_TITLE}") too.'
)
#: Size in bytes from which a table is read into a temporary file of numbers instead of memory.
LONG = 1 << 26
_COLUMN = re.compile(r"^(?P<name>\w+?)(?:\[(?P<index>\d{1,7}(?:;\d{1,7})?)\])?(?:\s*\((?P<unit>[^)]*)\))?$", re.ASCII)


class Csv(Format):
    """Text that any program reads."""

    name = "csv"
    extensions = (".csv",)
    text = True

    def recognises(self, path: Path) -> bool:
        return is_text(path)

    def own(self, path: Path) -> bool:
        return is_palpate_csv(path)

    def columns(self, path: Path, wanted: Callable[[Titles], Sequence[int]]) -> Table:
        return read_table_text(path, wanted)

    def read_mapped(self, path: Path, mapping: TableMapping) -> Recording:
        return self.read(path) if is_palpate_csv(path) else read_mapped(path, mapping)

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        lines, ended = text_of(path)
        head = _Head(path)
        body = [(count, line) for count, line in enumerate(lines, 1) if not head.takes(count, line)]
        own, expected = lines[0].strip(" ,") == _TITLE, head.expected
        torn = not ended and salvage and bool(body) and body[-1][0] == len(lines)
        if torn:
            body.pop()  # torn within a line
        if len(body) < 2:
            raise InvalidInput(_NO_FRAMES.format(path=path))
        if expected is None and not salvage:
            if own:
                raise InvalidInput(_TRUNCATED.format(path=path))
            if not ended:
                warn_of_a_cut(path, lines[-1])
        recording = _table(path, body, head)
        if not salvage:
            return confirm_recording(recording, expected, path, _EDITED)
        lost = "the last line is torn and lost" if torn else "every line is whole"
        if own and expected is None:
            lost += ", and its end is missing: lines may have followed"
        return with_losses(recording, expected, path, lost)

    @contextmanager
    def opened(self, path: Path, *, mapping: TopicMapping | None = None) -> Iterator[OpenRecording]:
        if path.stat().st_size < LONG:
            yield OpenRecording.of(self.read(path), str(path))
            return
        with tempfile.TemporaryFile(prefix="palpate-") as held:
            yield _spooled(path, held)

    def write(self, recording: Recording, path: Path) -> None:
        if len(set(recording.channels)) != len(recording.channels):
            raise InvalidInput(
                f"{path}: a CSV names each column once, but the recording has one channel on several planes; write .nc or .npz."
            )
        readings = recording.readings
        with path.open("w", newline="", encoding="utf-8") as file:
            file.write(f"{_TITLE}\n# meta: {json.dumps(recording.meta)}\n")
            if recording.positions is not None:
                file.write(f"# positions (m): {json.dumps(recording.positions.tolist())}\n")
            writer = csv.writer(file)
            titles = [
                f"{c}[{';'.join(map(str, place))}] ({u})"
                for c, u in zip(recording.channels, recording.units)
                for place in np.ndindex(*readings.shape[2:])
            ]
            writer.writerow(["time (s)", *titles])
            for t, frame in zip(recording.time, readings.reshape(len(readings), -1)):
                writer.writerow([repr(float(t)), *("" if np.isnan(v) else repr(float(v)) for v in frame)])
            file.write(f"# {CHECKSUM} {recording_checksum(recording)}\n")

    def write_touch(self, touch: Touch, path: Path, record: Mapping[str, str]) -> None:
        """Forces over time: one line a frame, as `Touch.table` has them."""
        write_table(touch.table(), path)

    def _touches(self, path: Path, count: int, record: Mapping[str, str]) -> TouchStream:
        return _CsvStream(path, count, record)


class _CsvStream(TouchStream):
    """Numbers of each frame, written at the end; maps are not kept."""

    def __init__(self, path: Path, count: int, record: Mapping[str, str]) -> None:
        super().__init__(path, count, record)
        self._forces = Forces()

    def _add(self, start: int, piece: Piece) -> None:
        self._forces.add(piece.touch())

    def _finish(self) -> None:
        self._forces.write(self.path)


def _positions(text: str, where: str) -> Any:
    problem = f'{where}: positions must be a list of [x, y] or of x, in metres, like "[[0.001, 0.002], [0.003, 0.004]]"'
    try:
        found = json.loads(text)
        if not isinstance(found, list):
            raise InvalidInput(f"{problem}; got {text[:40]!r}.")
        return np.array(found, dtype=np.float64)
    except InvalidInput:
        raise
    except (TypeError, ValueError, RecursionError, OverflowError) as error:
        raise InvalidInput(f"{problem}; got {text[:40]!r}.") from error


def is_palpate_csv(path: Path) -> bool:
    """Whether the table has palpate's column titles."""
    for line in lines_of(path):
        if line.strip(" ,\r\n") == _TITLE:
            return True
        if line.strip() and not line.startswith("#"):
            found = [_COLUMN.match(t.strip()) for t in cells(line.strip("\r\n"), str(path))]
            return (
                len(found) > 1
                and found[0] is not None
                and found[0]["name"] == "time"
                and all(m is not None and m["index"] is not None and is_channel(m["name"]) for m in found[1:])
            )
    return False


@dataclass(frozen=True)
class _Columns:
    """The parsed header of a table: channels, shape of a frame, place of each column in it, factors to SI units."""

    channels: tuple[str, ...]
    shape: tuple[int, ...]
    index: tuple[Any, ...]
    factors: list[float]
    unit: str  # of the time, unless it is a date
    clock: TimeCells

    @classmethod
    def of(cls, path: Path, count: int, line: str) -> _Columns:
        """Parse the header in line number ``count``."""
        start = f"{path}, line {count}"
        header = cells(line, start)
        columns = []
        for title in header:
            match = _COLUMN.match(title.strip())
            if match is None:
                raise InvalidInput(
                    f'{start}: column {title[:40]!r} is not like "stress_zz[0;1] (Pa)". {explained(path)}'
                )
            columns.append(match)
        if columns[0]["name"] != "time":
            raise InvalidInput(
                f'{start}: the first column must be "time (s)"; got {header[0][:40]!r}. {explained(path)}'
            )
        if len(columns) < 2:
            raise InvalidInput(f'{start}: no column of readings, like "stress_zz[0;1] (Pa)", follows the time.')
        channels: list[str] = []
        places: list[tuple[int, ...]] = []
        factors = [1.0]
        for match, title in zip(columns[1:], header[1:]):
            name = match["name"]
            if match["index"] is None or not is_channel(name):
                raise InvalidInput(
                    f'{start}: column {title[:40]!r} is not like "stress_zz[0;1] (Pa)". {explained(path)}'
                )
            if match["unit"] is None:
                raise InvalidInput(f'{start}: column {title!r} has no unit: write "{title} (Pa)" or the like.')
            if name not in channels:
                channels.append(name)
            place = tuple(int(i) for i in match["index"].split(";"))
            places.append((channels.index(name), *place))
            factors.append(convert_factor(match["unit"], channel_unit(name), f"{path}: {title}"))
        if len({len(p) for p in places}) != 1:
            raise InvalidInput(f"{path}: columns mix one and two indices.")
        shape = tuple(int(m) + 1 for m in np.max(places, axis=0))
        if len(set(places)) != len(places) or len(places) != int(np.prod(shape)):
            raise InvalidInput(
                f"{path}: {len(places)} columns do not fill {len(channels)} channels of {shape[1:]} taxels once each."
            )
        unit = columns[0]["unit"] or ""
        return cls(tuple(channels), shape, tuple(np.array(places).T), factors, unit, TimeCells(str(path)))

    def frame(self, line: str, where: str) -> tuple[float, Floats]:
        """Time and readings (channel, *array) of a line."""
        values = cells(line, where)
        if len(values) != len(self.factors):
            raise InvalidInput(
                f"{where}: {len(values)} values for {len(self.factors)} columns; the file may be truncated."
            )
        seconds = self.clock.value(values[0], where)
        if seconds is None:
            seconds = number(values[0], where) * convert_factor(self.unit, "s", f"{where}: time")
        readings = np.full(self.shape, np.nan)
        readings[self.index] = np.array([number(v, where) for v in values[1:]]) * self.factors[1:]
        return seconds, readings

    def time(self, path: Path, stamps: Sequence[float], expected: str | None) -> Clock:
        """Times of all lines. Times of a file with a checksum (``expected``) were repaired before: no new note."""
        values = self.clock.settled(np.array(stamps, dtype=np.float64))
        clock = read_clock(values, source=str(path), remedy="sort its lines by their first column")
        if expected is not None:
            return Clock(clock.time)
        clock.tell()
        return clock


def _table(path: Path, body: list[tuple[int, str]], head: _Head) -> Recording:
    columns = _Columns.of(path, *body[0])
    frames = [columns.frame(line, f"{path}, line {count}") for count, line in body[1:]]
    clock = columns.time(path, [time for time, _ in frames], head.expected)
    return Recording(
        readings=np.stack([readings for _, readings in frames]),
        channels=columns.channels,
        time=clock.time,
        positions=head.positions,
        meta={**head.meta, **clock.meta()},
    )


class _Spooled:
    """Readings of all frames in a temporary file, as float64; indexing by a slice of frames reads only those."""

    def __init__(self, held: Any, shape: tuple[int, ...]) -> None:
        self._held, self._shape, self._size = held, shape, 8 * int(np.prod(shape))

    def __getitem__(self, frames: slice) -> Floats:
        self._held.seek(frames.start * self._size)
        data = np.frombuffer(self._held.read((frames.stop - frames.start) * self._size))
        return data.reshape(-1, *self._shape)


def _spooled(path: Path, held: Any) -> OpenRecording:
    """Open a table that is too long to be kept in memory: read it once, line by line, and write its readings to the
    temporary file ``held``, from which frames are then read as they are needed.
    """
    head = _Head(path)
    columns: _Columns | None = None
    times: list[float] = []
    for count, line in enumerate(lines_of(path), 1):
        if head.takes(count, line):
            continue
        if columns is None:
            columns = _Columns.of(path, count, line)
            continue
        time, readings = columns.frame(line, f"{path}, line {count}")
        times.append(time)
        held.write(readings.tobytes())
    if columns is None or not times:
        raise InvalidInput(_NO_FRAMES.format(path=path))
    head.check_end(path)
    spooled = _Spooled(held, columns.shape)
    clock = columns.time(path, times, head.expected)
    meta = {**head.meta, **clock.meta()}
    first = Recording(
        readings=spooled[0:1], channels=columns.channels, time=clock.time[:1], positions=head.positions, meta=meta
    )
    return OpenRecording(first, clock.time, spooled, head.expected, str(path), _EDITED)


class _Head:
    """The comments of a table, and whether its last line has a line break."""

    def __init__(self, path: Path) -> None:
        self._path, self._own, self._last = path, False, ""
        self.meta: dict[str, str] = {}
        self.positions: Any = None
        self.expected: str | None = None

    def takes(self, count: int, line: str) -> bool:
        """Parse a line that is a comment or empty; return whether it was."""
        where = f"{self._path}, line {count}"
        if count == 1:
            self._own = line.strip(" ,\n") == _TITLE
        self._last = line if line.strip() else self._last
        if line.startswith("# positions (m): "):
            self.positions = _positions(line.removeprefix("# positions (m): "), where)
        elif line.startswith("# meta: "):
            self.meta = json_object(line.removeprefix("# meta: "), f"{where}: meta")
        elif line.startswith(f"# {CHECKSUM} "):
            self.expected = line.removeprefix(f"# {CHECKSUM} ").strip(" ,\n")
        return not line.strip() or line.startswith("#")

    def check_end(self, path: Path) -> None:
        """Refuse a file of palpate without its checksum; warn about one of another program that may be cut."""
        if self.expected is None and self._own:
            raise InvalidInput(_TRUNCATED.format(path=path))
        if self.expected is None and not self._last.endswith("\n"):
            warn_of_a_cut(path, self._last)
