"""Write the touches of a long recording piece by piece; the complete file equals that of one result with all frames."""

from __future__ import annotations

import abc
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.heldfile import Apart
from palpate.recordings.labelled import RESULT_ATTRIBUTES, missing_value, touch_dataset, touch_of
from palpate.touch import Touch, joined
from palpate.touch.counted import Counted
from palpate.touch.outcome import Outcome, notes_with

if TYPE_CHECKING:
    import xarray

__all__ = ["Arrays", "Collected", "Piece", "TouchStream", "Whole", "Written", "along_time", "piece_of"]

#: Attributes common to all pieces of a run.
_COMMON = ("sought", "unobservable_force", "surface", "case", "nuisance_names", "friction")


@dataclass(frozen=True)
class Piece:
    """The touches of some frames in the form in which they are written, with their outcomes."""

    dataset: xarray.Dataset
    outcome: Outcome
    calibration: str

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.dataset.sizes["time"])

    @property
    def attrs(self) -> Mapping[str, Any]:
        """The attributes of the pieces."""
        return {str(k): v for k, v in self.dataset.attrs.items()}

    def touch(self) -> Touch:
        """Convert back to a result."""
        return touch_of(self.dataset)


@dataclass(frozen=True)
class Written:
    """A piece whose numbers another process has written; only its attributes are missing.

    ``crcs`` are `palpate.recordings.checked.block_crc` of each variable with a time axis.
    """

    frames: int
    attrs: Mapping[str, Any]
    outcome: Outcome
    calibration: str
    crcs: Mapping[str, tuple[int, int]]
    fixed: tuple[str, ...]


def along_time(piece: Piece, methods: Sequence[str], *, coded: bool) -> dict[str, xarray.Variable]:
    """Variables of a piece with a time axis; ``coded``: each frame's method as an index in ``methods``."""
    found = {str(n): v for n, v in piece.dataset.variables.items() if "time" in v.dims and n != "found_by"}
    names = json.loads(piece.attrs.get("methods", json.dumps([piece.attrs["method"]])))
    places = np.array([methods.index(n) for n in names], dtype=np.int8)
    held = piece.dataset.get("found_by")
    codes = places[np.zeros(piece.frames, dtype=int) if held is None else held.values]
    if coded or codes.any():
        found["found_by"] = found["time"].to_base_variable().copy(data=codes)
        found["found_by"].attrs = {"long_name": "place among the attribute methods"}
    return found


def piece_of(touch: Touch) -> Piece:
    """Convert a batch of touches (frame, component, *surface), with error bars, to a piece to write or send."""
    return Piece(touch_dataset(touch), Outcome.of(touch), touch.calibration_note)


class Whole:
    """The attributes of all pieces together."""

    def __init__(self) -> None:
        self.first: dict[str, Any] = {}
        self.methods: list[str] = []
        self._assumptions = Counted()
        self._names: dict[str, str] = {}
        self._meta: dict[str, Any] = {}
        self._outcome: Outcome | None = None
        self._calibration = ""

    def add(self, attrs: Mapping[str, Any], outcome: Outcome, calibration: str) -> None:
        """Add a piece: attributes of its data set, outcome of its frames, note on the constants of its error bars."""
        if not self.first:
            self.first = dict(attrs)
        if "common_std" in attrs:  # not in a piece without error bars
            self.first.setdefault("common_std", attrs["common_std"])
        for name in _COMMON:
            if attrs.get(name) != self.first.get(name):
                raise InvalidInput("results of different skins cannot be written as one; start a new file.")
        for name in json.loads(attrs.get("methods", json.dumps([attrs["method"]]))):
            if name not in self.methods:
                self.methods.append(name)
        self._assumptions.add(json.loads(attrs["assumptions"]), outcome.frames)
        self._names.update(json.loads(attrs["reading_names"]))
        self._meta.update(json.loads(attrs["meta"]))
        self._outcome = outcome if self._outcome is None else self._outcome + outcome
        self._calibration = self._calibration or calibration

    def attributes(self, record: Mapping[str, str]) -> dict[str, Any]:
        """The attributes of the whole, with the provenance."""
        own = {k: v for k, v in self.first.items() if k != "methods"}
        if len(self.methods) > 1:
            own["methods"] = json.dumps(self.methods)
        return {
            **{k: str(v) for k, v in {**self._meta, **record}.items() if k not in RESULT_ATTRIBUTES},
            **own,
            "notes": self.notes,
            "assumptions": json.dumps(list(self._assumptions.words())),
            "reading_names": json.dumps(self._names),
            "meta": json.dumps(self._meta),
        }

    @property
    def notes(self) -> str:
        """Assumptions and outcomes of the frames in words."""
        found = notes_with(self._assumptions.words(), self._outcome)
        return "\n".join((*found, *([self._calibration] if self._calibration else [])))


class TouchStream(abc.ABC):
    """A file that receives the touches of ``count`` frames in pieces; `finish` completes it. Nothing else may write to
    it.

    `InvalidInput` if the disk does not accept a piece.

    A separate thread does the writing, so that Ctrl-C, which interrupts the main thread, cannot interrupt it.
    """

    def __init__(self, path: Path, count: int, record: Mapping[str, str]) -> None:
        self.path, self.count, self.record = path, count, dict(record)
        self.whole = Whole()
        #: written pieces: start -> number of frames
        self.done: dict[int, int] = {}
        self._apart = Apart()

    def add(self, start: int, piece: Piece | Written) -> None:
        """Write the frames from index ``start`` on."""
        self.whole.add(piece.attrs, piece.outcome, piece.calibration)
        self._written(lambda: self._add(start, piece) if isinstance(piece, Piece) else self._note(start, piece))

    def place(self) -> Any:
        """A `palpate.recordings.zarrpieces.Place` where another process may write a piece; None if not yet allowed."""
        return None

    def finish(self) -> None:
        """Complete the result after the last frame."""
        self._written(self._finish)
        self._apart.end()

    def _written(self, act: Callable[[], None]) -> None:
        try:
            self._apart(act)
        except OSError as error:
            raise InvalidInput(f"{self.path}: writing failed ({error.strerror or error}).") from error

    def part(self, start: int, stop: int) -> Touch:
        """Frames that an earlier run has written; only resumed streams have any."""
        raise InvalidInput(f"{self.path}: frames {start} to {stop - 1} are not there.")

    def abandon(self) -> None:
        """Release everything without writing."""
        self._apart(self._abandon)
        self._apart.end()

    @abc.abstractmethod
    def _add(self, start: int, piece: Piece) -> None: ...

    def _note(self, start: int, piece: Written) -> None:
        raise NotImplementedError  # nobody else writes if `place` returns None

    @abc.abstractmethod
    def _finish(self) -> None: ...

    def _abandon(self) -> None:  # noqa: B027  # most have nothing to let go of
        pass


class Collected(TouchStream):
    """For formats that write a result at once: the touches stay in memory until the end."""

    def __init__(self, path: Path, count: int, record: Mapping[str, str], write: Any) -> None:
        super().__init__(path, count, record)
        self._write = write
        self._parts: dict[int, Touch] = {}

    def _add(self, start: int, piece: Piece) -> None:
        self._parts[start] = piece.touch()

    def _finish(self) -> None:
        touch = joined([self._parts[start] for start in sorted(self._parts)])
        self._write(touch, self.path, {"method": touch.method, "notes": "\n".join(touch.notes), **self.record})


class Arrays(TouchStream):
    """For formats with named arrays: each grows piece by piece; one that appears late is filled backwards."""

    def __init__(self, path: Path, count: int, record: Mapping[str, str]) -> None:
        super().__init__(path, count, record)
        #: variables with a time axis -> shape of a frame, type
        self._long: dict[str, tuple[tuple[int, ...], Any]] = {}

    def _add(self, start: int, piece: Piece) -> None:
        if not self._long:
            fixed = {str(n): v for n, v in piece.dataset.variables.items() if "time" not in v.dims}
            self._begin(fixed, piece.frames)
        here = along_time(piece, self.whole.methods, coded="found_by" in self._long)
        for name, variable in here.items():
            shape = variable.shape[1:]
            if name not in self._long:
                self._create(name, variable)
                self._long[name] = shape, variable.dtype
                for begun, frames in self.done.items():
                    self._put(name, begun, self._nothing(name, frames))
            elif shape != self._long[name][0]:
                raise InvalidInput(
                    f"results of different kinds cannot be written as one: {name} has the shapes {self._long[name][0]} and {shape}."
                )
            self._put(name, start, variable.values)
        for name in set(self._long) - set(here):
            self._put(name, start, self._nothing(name, piece.frames))
        self.done[start] = piece.frames

    def _nothing(self, name: str, frames: int) -> Any:
        shape, dtype = self._long[name]
        return np.full((frames, *shape), missing_value(name), dtype=dtype)

    @abc.abstractmethod
    def _begin(self, fixed: Mapping[str, xarray.Variable], frames: int) -> None:
        """Create the file, with the variables without a time axis; most pieces will have ``frames`` frames."""

    @abc.abstractmethod
    def _create(self, name: str, like: xarray.Variable) -> None:
        """Create a variable over all frames, labelled like that of a piece."""

    @abc.abstractmethod
    def _put(self, name: str, start: int, values: Any) -> None:
        """Write some frames of a variable."""
