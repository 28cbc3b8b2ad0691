"""Numbers of all frames of a run: in memory while they are few, in a file without a name when they are many."""

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

#: Recordings of more frames keep their numbers in a file: thirty numbers a frame are 25 MB here.
MAX_FRAMES_IN_MEMORY = 100_000


class Numbers:
    """What `palpate.touch.table.columns` gives of the frames of a run, which come in any order.

    ``frames`` is how many will come, the first of many with the number 0; their numbers go into a file in ``folder`` that has no name and is gone with this object, column by column.

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
        """Numbers of the frames from ``start`` on."""
        if self._file is None:
            self._parts[start] = numbers
            return
        count = len(numbers["status"])
        titles = tuple(numbers)
        self._held[start] = count, self._kinds.setdefault(titles, titles)  # one for all pieces that have the same
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
        """How many frames have come."""
        if self._file is not None:
            return sum(count for count, _ in self._held.values())
        return sum(len(part["status"]) for part in self._parts.values())

    def untouched(self) -> Any:
        """Whether each frame has no contact."""
        if self._file is not None:
            return np.isin(self._status, [Status.NO_CONTACT, Status.UNDECIDED])
        labels = [Status.NO_CONTACT.label, Status.UNDECIDED.label]
        return np.concatenate([np.isin(self._parts[s]["status"], labels) for s in sorted(self._parts)])

    def table(self) -> pandas.DataFrame:
        """One row a frame; columns of many frames stay in the file until they are looked at."""
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
                if title not in titles:  # a missing frame may lack values that need the friction
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
