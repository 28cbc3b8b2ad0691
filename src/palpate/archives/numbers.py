"""Store the numbers of all frames of a run: in memory if they are few, in an unnamed file if they are many."""

from __future__ import annotations

import math
import tempfile
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, cast

import numpy as np

from palpate.elastic.pad import Floats
from palpate.status import Status
from palpate.touch.table import table_of

if TYPE_CHECKING:
    import pandas

__all__ = ["MAX_FRAMES_IN_MEMORY", "Numbers"]

#: Recordings of more frames than this use a file: with thirty numbers a frame they would take 25 MB.
MAX_FRAMES_IN_MEMORY = 100_000


class Numbers:
    """Stores the numbers of frames, as `palpate.touch.table.columns` computes them, in any order of arrival.

    ``frames`` is their total number, counted from 0. If they are many, their numbers go column by column into a file
    in ``folder`` that has no name and vanishes with this object.

    Raises
    ------
    OSError
        The disk is full.
    """

    def __init__(self, frames: int, folder: Path) -> None:
        self._frames = frames
        self._parts: dict[int, dict[str, Any]] = {}
        self._file: BinaryIO | None = None
        if frames >= MAX_FRAMES_IN_MEMORY:
            self._file = cast(BinaryIO, tempfile.TemporaryFile(dir=folder, buffering=0))  # noqa: SIM115
            weakref.finalize(self, self._file.close)
        self._titles: list[str] = []
        self._status = np.zeros(frames if self._file else 0, dtype=np.int8)
        self._held: dict[int, tuple[int, tuple[str, ...]]] = {}
        self._kinds: dict[tuple[str, ...], tuple[str, ...]] = {}

    def add(self, start: int, numbers: dict[str, Any]) -> None:
        """Add the numbers of the frames from ``start`` on."""
        if self._file is None:
            self._parts[start] = numbers
            return
        count = len(numbers["status"])
        titles = tuple(numbers)
        self._held[start] = count, self._kinds.setdefault(titles, titles)  # pieces with equal titles share one object
        self._status[start : start + count] = [_CODES[s] for s in numbers["status"]]
        for title, values in numbers.items():
            if title == "status":
                continue
            if title not in self._titles:
                self._titles.append(title)
            self._file.seek(8 * (self._titles.index(title) * self._frames + start))
            left = memoryview(np.ascontiguousarray(values, dtype=np.float64).tobytes())
            while left:
                left = left[self._file.write(left) :]

    def __len__(self) -> int:
        """Number of frames that have been added."""
        if self._file is not None:
            return sum(count for count, _ in self._held.values())
        return sum(len(part["status"]) for part in self._parts.values())

    def untouched(self) -> Any:
        """Whether each frame is without contact."""
        if self._file is not None:
            return np.isin(self._status, [Status.NO_CONTACT, Status.UNDECIDED])
        labels = [Status.NO_CONTACT.label, Status.UNDECIDED.label]
        return np.concatenate([np.isin(self._parts[s]["status"], labels) for s in sorted(self._parts)])

    def table(self) -> pandas.DataFrame:
        """Return a table with one row for each frame; with many frames, columns stay in the file until they are used."""
        import pandas

        if self._file is None:
            return table_of([self._parts[start] for start in sorted(self._parts)])
        self._file.truncate(8 * len(self._titles) * self._frames)
        out: dict[str, Any] = {}
        for title in max(self._kinds, key=len):
            if title == "status":
                continue
            k = self._titles.index(title)
            column: Floats = np.memmap(cast(Any, self._file), np.float64, "c", 8 * k * self._frames, (self._frames,))
            for start, (count, titles) in self._held.items():
                if title not in titles:  # a frame that is missing may lack columns that need the friction
                    column[start : start + count] = math.nan
            out[title] = column
        labels = pandas.Categorical.from_codes(
            np.searchsorted(_ORDER, self._status), [Status.coded(int(c)).label for c in _ORDER]
        )
        time = out.pop("time (s)")
        head = {"frame": np.arange(self._frames)} if np.isnan(time).all() else {"time (s)": time}
        return pandas.DataFrame({**head, "status": labels, **out}, copy=False)


_CODES = {s.label: int(s) for s in Status}
_ORDER = np.sort(np.array(list(_CODES.values()), dtype=np.int8))
