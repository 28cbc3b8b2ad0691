"""Forces over time, as recorded by a load cell or a gripper during a press."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.tabletext import Titles, read_table_text
from palpate.sensing.times import interpolated
from palpate.units import UNITS

__all__ = ["ForceTrace", "read_force_trace"]

#: Column names of times and of normal forces, in order of preference.
TIMES = ("time", "t", "timestamp", "stamp", "seconds", "sec")
FORCES = ("fz", "force_z", "normal_force", "fn", "force", "f", "load")


@dataclass(frozen=True)
class ForceTrace:
    """Normal force [N] at times [s], in their order; NaN where it is missing.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.camera import ForceTrace
    >>> trace = ForceTrace(np.array([0.0, 1.0, 2.0]), np.array([0.0, 3.0, 4.0]), "pull.csv")
    >>> [float(f) for f in trace.at(np.array([0.5, 5.0]))]
    [1.5, nan]
    """

    time: Floats
    force: Floats
    name: str

    def __post_init__(self) -> None:
        time, force = (np.asarray(v, dtype=np.float64) for v in (self.time, self.force))
        if time.ndim != 1 or time.shape != force.shape or len(time) < 2:
            raise InvalidInput(f"{self.name}: a trace has one force for each time, two or more; got {force.shape}.")
        if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
            raise InvalidInput(f"{self.name}: the times of a trace must rise from row to row.")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "force", force)

    def at(self, times: Floats) -> Floats:
        """Forces at these times by linear interpolation; NaN outside the trace and where its forces are missing."""
        return interpolated(np.asarray(times, dtype=np.float64), self.time, self.force)


def read_force_trace(path: str | Path) -> ForceTrace:
    """A table of times and normal forces, with their units in the titles: ``time (s),fz (N)``.

    Raises
    ------
    InvalidInput
        No such file, no column of times or forces, a unit that is missing or not known, times that go back.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.camera import read_force_trace
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/pull.csv").write_text("time (ms),fz (mN)\\n0,0\\n500,1200\\n")
    ...     trace = read_force_trace(f"{folder}/pull.csv")
    >>> trace.time.tolist(), trace.force.tolist()
    ([0.0, 0.5], [0.0, 1.2])
    """
    found = Path(path)
    if not found.is_file():
        raise InvalidInput(f"{found}: no such file.")
    factors: list[float] = []

    def wanted(titles: Titles) -> Sequence[int]:
        factors.clear()
        places = []
        for names, kind, example in ((TIMES, "time", "time (s)"), (FORCES, "force", "fz (N)")):
            place, unit = _column(titles, names)
            if place is None:
                raise InvalidInput(
                    f"{found}: no column of {kind}s; name it such as {example}, its unit with it. There are {titles.listed()}."
                )
            if unit not in UNITS[kind]:
                raise InvalidInput(
                    f"{found}: {titles.names[place]} does not say its unit: name the column such as {example}; accepted: {', '.join(UNITS[kind])}."
                )
            places.append(place)
            factors.append(UNITS[kind][unit])
        return places

    values = read_table_text(found, wanted).values
    values = values[np.isfinite(values[:, 0])]  # a missing force stays, so that none is interpolated there
    return ForceTrace(values[:, 0] * factors[0], values[:, 1] * factors[1], found.name)


def _column(titles: Titles, names: Sequence[str]) -> tuple[int | None, str]:
    """The first column with one of these names, and its unit: in brackets, or after the name."""
    split = []
    for place, title in enumerate(titles.names):
        match = re.fullmatch(r"\s*(.*?)\s*(?:[(\[]\s*([^()\[\]]*?)\s*[)\]]|[_ ](s|ms|us|ns|[mk]?N))?\s*", title)
        bare, unit = (title, "") if match is None else (match[1], match[2] or match[3] or "")
        split.append((bare.strip().lower().replace(" ", "_"), unit.replace("μ", "µ"), place))
    for name in names:
        for bare, unit, place in split:
            if bare == name and titles.titled:
                return place, unit
    return None, ""
