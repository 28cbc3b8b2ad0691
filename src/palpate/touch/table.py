"""Numbers over time: one row a frame, each number with its interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._numbers import plain_number
from palpate._plot import column_size, level_words, scaled
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.status import Status
from palpate.touch.counted import numberless
from palpate.touch.intervals import interval
from palpate.touch.numbers import Numbers
from palpate.touch.outcome import Outcome, notes_with
from palpate.touch.rounding import decimals, force_unit, open_interval

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


__all__ = ["Forces", "columns", "table_of", "table_words", "write_table"]

#: Largest number of rows of a printed table.
PRINTED = 20
#: Axes of quantities with one number per axis, by the dimensions of the surface.
_AXES = {"force": {1: ("x", "z"), 2: ("x", "y", "z")}, "moment": {1: ("y",), 2: ("x", "y", "z")}}


def columns(touch: Numbers, *, friction: float | None = None, level: float = 0.95) -> dict[str, Any]:
    """Time, status and numbers of each frame of a touch with their intervals, keyed by the titles of the table; see
    `Touch.table`.
    """
    if len(touch.batch) > 1:
        raise InvalidInput(
            f"a table has one row a frame, and this touch has the batch axes {touch.batch}: pick along the first, touch[0]."
        )
    friction = touch.friction if friction is None else friction
    d = touch.surface.dimensions
    line, count = d == 1, touch.batch[0] if touch.batch else 1
    per = "N/m" if line else "N"
    out: dict[str, Any] = {
        "time (s)": np.full(count, math.nan) if touch.time is None else np.ravel(touch.time).astype(np.float64),
        "status": [Status.coded(int(c)).label for c in np.ravel(touch.status)]
        if touch.status is not None
        else ["solved"] * count,
    }

    def put(name: str, unit: str, values: Any, of: str, names: Sequence[str], **given: Any) -> None:
        flat = np.asarray(to_numpy(values), dtype=np.float64).reshape(count, -1)
        low, high = _bounds(touch, level, of, flat.shape, **given)
        for i, axis in enumerate(names):
            title = f"{name}_{axis}" if axis else name
            for suffix, side in (("", flat), ("_low", low), ("_high", high)):
                out[f"{title}{suffix} ({unit})"] = side[:, i]

    axes = _AXES["force"][d]
    put("force", per, touch.force, "force", axes)
    for c in axes:
        if c not in touch.components and not touch.surface.bends:  # assumed zero, not measured
            for suffix in ("", "_low", "_high"):
                del out[f"force_{c}{suffix} ({per})"]
    both = set(touch.components) == set(touch.surface.components)
    pressure = "z" in touch.components
    if both:
        put("moment", "N" if line else "N m", touch.moment, "moment", _AXES["moment"][d])
    if pressure:
        put("center", "m", touch.center_of_pressure, "center_of_pressure", ("x",) if line else ("x", "y"))
        known = np.isfinite(np.asarray(to_numpy(touch.peak_pressure), dtype=np.float64)).reshape(count)
        area = np.asarray(to_numpy(touch.contact_area()), dtype=np.float64).reshape(count)
        out["contact_width (m)" if line else "contact_area (m^2)"] = np.where(known, area, math.nan)
        put("peak_pressure", "Pa", touch.peak_pressure, "peak_pressure", ("",))
    if both and friction is not None:
        put("slip_margin", "Pa", touch.slip_margin(friction), "slip_margin", ("",), friction=friction)
    out["fit"] = np.full(count, math.nan) if touch.fit is None else np.ravel(touch.fit).astype(np.float64)
    return out


def _bounds(touch: Numbers, level: float, of: str, shape: tuple[int, ...], **given: Any) -> tuple[Floats, Floats]:
    """The interval of each frame (frame, number), or NaN."""
    try:
        low, high = interval(touch, level, of, given.get("friction"))
    except Unsupported:  # a method without error bars
        return np.full(shape, math.nan), np.full(shape, math.nan)
    return (
        np.asarray(to_numpy(low), dtype=np.float64).reshape(shape),
        np.asarray(to_numpy(high), dtype=np.float64).reshape(shape),
    )


class Forces:
    """Numbers of each frame, gathered while touches come: forces over time without their maps.

    Parameters
    ----------
    friction : float, optional
        For the slip margin. Default: the friction that the touches were found with.
    level : float
        Part of the true values that the intervals hold.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.touch import Forces
    >>> touch = pp.Touch(np.ones((2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov", time=np.array(0.5))
    >>> forces = Forces()
    >>> forces.add(touch)
    >>> forces.table()["force_z (N/m)"].tolist(), len(forces)
    ([0.004], 1)
    """

    def __init__(self, *, friction: float | None = None, level: float = 0.95) -> None:
        self._friction, self._level = friction, level
        self._parts: list[dict[str, Any]] = []
        self._events: list[str] = []
        self._said: dict[
            str, tuple[str, int]
        ] = {}  # without its numbers: the first such note, and frames that have one
        self._outcome: Outcome | None = None
        self._kind: tuple[tuple[str, ...], tuple[str, ...]] | None = None

    def __len__(self) -> int:
        return len(self._events)

    def add(self, touch: Numbers, events: Sequence[object] = ()) -> None:
        """Add a frame, or frames (frame, ...), with its outcome.

        Raises
        ------
        InvalidInput
            Frames of another kind than those before.
        """
        kind = (touch.surface.components, touch.components)
        if self._kind not in (None, kind):
            raise InvalidInput(
                f"a table of the components {', '.join(touch.components)} cannot go on one of others; begin a new one."
            )
        self._kind = kind
        part = columns(touch, friction=self._friction, level=self._level)
        self._parts.append(part)
        found = Outcome.of(touch)
        self._outcome = found if self._outcome is None else self._outcome + found
        for note in touch.assumptions:
            key = numberless(note)
            first, frames = self._said.get(key, (note, 0))
            self._said[key] = first, frames + len(part["status"])
        count = len(part["status"])
        self._events += ["; ".join(map(_short, events)), *[""] * (count - 1)]

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions, notes on single frames with their counts, and the outcomes of the frames."""
        many = f" of {len(self)} frames)"
        said = [n if k == len(self) else f"{n} (in {k}{many}" for n, k in self._said.values()]
        return notes_with(said, self._outcome)

    def table(self) -> pandas.DataFrame:
        """One row a frame; see `Touch.table`."""
        if not self._parts:
            raise InvalidInput("there are no frames yet: add one first.")
        table = table_of(self._parts)
        table.attrs["level"] = self._level  # figures and words name it
        return table.assign(events=self._events) if any(self._events) else table

    def plot(self, *, events: Sequence[object] = (), title: str | None = None) -> Figure:
        """A figure of the forces over time, as `Touch.plot_forces` draws it."""
        from palpate._plot import plot_forces

        return plot_forces(self.table(), events=events, title=title)

    def write(self, path: str | Path) -> None:
        """Write CSV: a line of titles with units, then a line per frame. Unknown values are empty."""
        write_table(self.table(), path)


def table_of(parts: Sequence[dict[str, Any]]) -> pandas.DataFrame:
    """One table from the results of `columns` for several frames or batches."""
    import pandas

    longest = max(parts, key=len)  # a missing frame may lack values that need the friction
    held = {
        title: np.concatenate([np.asarray(p.get(title, [math.nan] * len(p["status"]))) for p in parts])
        for title in longest
    }
    if np.isnan(held["time (s)"]).all():  # frames that have no time are counted
        count = len(held["status"])
        held = {"frame": np.arange(count), **{k: v for k, v in held.items() if k != "time (s)"}}
    return pandas.DataFrame(held)


def write_table(table: pandas.DataFrame, path: str | Path) -> None:
    """Write a table of `Touch.table` as CSV."""
    exact = [title for title in ("time (s)",) if title in table]  # seconds since 1970 need all their digits
    table.assign(**{t: [repr(round(float(v), 9)) if math.isfinite(v) else "" for v in table[t]] for t in exact}).to_csv(
        path, index=False, float_format="%.6g", lineterminator="\n"
    )


def _short(event: object) -> str:
    kind, began = getattr(event, "kind", None), getattr(event, "began", None)
    return str(event) if kind is None else f"{kind} {'began' if began else 'ended'}"


def table_words(table: pandas.DataFrame, *, rows: int = PRINTED) -> str:
    """Format a table for printing: at most ``rows`` frames, evenly spread; each column has a number with its interval,
    with the same decimals throughout.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.touch.table import table_words
    >>> touch = pp.Touch(np.ones((3, 2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov", time=np.arange(3) / 10)
    >>> print(table_words(touch.table()))
    time [s]  force x [mN/m]  force z [mN/m]  peak pressure [Pa]  status
       0.000               4               4                   1  solved
       0.100               4               4                   1  solved
       0.200               4               4                   1  solved
    """
    count = len(table)
    step = max(1, math.ceil(count / rows))
    picked = table.iloc[::step]
    if "frame" in table:
        cells = [["frame", *map(str, picked["frame"])]]
    else:
        cells = [["time [s]", *(f"{t:.3f}" for t in picked["time (s)"])]]
    forces = [t for t in table if t.startswith("force_") and "_low" not in t and "_high" not in t]
    shown = [*forces, *(t for t in table if t.startswith(("peak_pressure (", "slip_margin (")))]
    strongest = max((column_size(table, t) for t in forces), default=0.0)
    for title in shown:
        name, unit = title[:-1].split(" (")
        factor, unit = (
            force_unit(strongest, unit) if title in forces else scaled(column_size(table, title) or 1.0, unit)
        )
        low, high = (factor * np.asarray(table[f"{name}_{side} ({title.split(' (')[1]}"]) for side in ("low", "high"))
        values = factor * np.asarray(table[title])
        values = np.where(table["status"] == Status.UNEXPLAINED.label, math.nan, values)
        half = 0.5 * (high - low)
        known = np.isfinite(half) & (half > 0) & np.isfinite(values)
        # the typical interval in frames with contact; single frames may be better or worse
        known = known & (values != 0) if (known & (values != 0)).any() else known
        n = decimals(float(np.median(half[known]))) if known.any() else None
        cells.append(
            [f"{name.replace('_', ' ')} [{unit}]", *(_cell(values[i], low[i], high[i], n) for i in picked.index)]
        )
    if np.isfinite(table["fit"]).any():
        cells.append(["fit", *(f"{v:.2f}" if math.isfinite(v) else "" for v in picked["fit"])])
    cells.append(["status", *picked["status"]])
    widths = [max(map(len, column)) for column in cells]
    last = len(cells) - 1
    lines = [
        "  ".join(c.ljust(w) if k == last else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths))).rstrip()
        for row in zip(*cells)
    ]
    hold = f"brackets hold {level_words(table)}"
    if step > 1:
        lines.append(f"(every {step}{_ordinal(step)} of {count} frames; {hold})")
    elif any("(" in c for column in cells for c in column[1:]):
        lines.append(f"({hold})")
    return "\n".join(lines)


def _cell(value: float, low: float, high: float, n: int | None) -> str:
    if not math.isfinite(value):
        return "-"
    if math.isinf(low) or math.isinf(high):
        return f"{plain_number(value, 4)}{open_interval(low, high)}"
    if n is None or not (math.isfinite(low) and math.isfinite(high)):
        return f"{plain_number(value, 4)}"
    half = 0.5 * (high - low)
    if half < 0.5 * 10.0**-n:  # much more exact than the typical one
        n = decimals(half)
    value, low, high = (round(float(v), n) + 0.0 for v in (value, low, high))
    return f"{value:.{n}f} ({low:.{n}f} to {high:.{n}f})"


def _ordinal(n: int) -> str:
    return "th" if n % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
