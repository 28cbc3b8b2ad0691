"""Plot forces over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._extras import require
from palpate._numbers import plain_time
from palpate._plot.style import COLUMN, INK, journal, level_words, scaled

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_forces", "plot_forces"]

#: Events that are marked in the figure; marking the others would crowd it.
MARKED = ("contact", "slip", "incipient slip", "pull", "excess pressure", "excess force", "unexplained")

#: Height of a row of events [inch], and largest number of lines drawn through the panels.
ROW, MOST_LINES = 0.12, 20
#: Range of times, in seconds since 1970, that are shown as a date: 2001 to 2096.
EPOCH = (1e9, 4e9)
#: An axis shows intervals up to WIDE times the half-width that the fraction USUAL of the frames does not exceed.
WIDE, USUAL = 3.0, 0.9


def plot_forces(table: pandas.DataFrame, *, events: Sequence[Any] = (), title: str | None = None) -> Figure:
    """A figure, one column wide, of forces with their bands over time and, below, peak pressure and slip margin.

    ``table`` is that of `Touch.table`; ``events`` those of a `GraspMonitor`: one row above the forces for each kind. Time begins at the first frame.
    """
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    rows = [[t for t in table if _is_value(t, "force_")]]
    rows += [[t] for t in table if _is_value(t, ("peak_pressure", "slip_margin"))]
    rows = [row for row in rows if row and any(np.isfinite(table[t]).any() for t in row)] or rows[:1]
    clock = _clock(table)
    spans = _spans(events, clock)
    above = [ROW * len(spans)] if spans else []
    heights = [*above, 1.5, *[0.95] * (len(rows) - 1)]
    with journal():
        figure = Figure(figsize=(COLUMN, 0.6 + sum(heights)), layout="constrained")
        panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        data = panels[len(above) :]
        for panel, row in zip(data, rows):
            _draw(panel, table, row, clock)
            _guide(panel, spans)
        if spans:
            _name(panels[0], spans)
            _legend(data[0], panels[0], table)
        else:
            _legend(data[0], data[0], table)
        panels[-1].set_xlabel(clock.label)
        figure.align_ylabels(list(data))
        if title:
            figure.suptitle(title)
    return figure


def draw_forces(ax: Axes, table: pandas.DataFrame, *, events: Sequence[Any] = ()) -> None:
    """Draw the forces of a table with their bands and events into axes of the caller's figure."""
    clock = _clock(table)
    spans = _spans(events, clock)
    _draw(ax, table, [t for t in table if _is_value(t, "force_")], clock)
    _guide(ax, spans)
    _legend(ax, ax, table)
    if spans:
        # put the rows of events inside the axes, and extend the axis so that forces lie below them
        share = min(0.5, 0.09 * len(spans))
        low, high = ax.get_ylim()
        ax.set_ylim(low, low + (high - low) / (1.0 - share))
        rows = ax.inset_axes((0.0, 1.0 - share, 1.0, share), sharex=ax)
        _name(rows, spans, right=True)
    ax.set_xlabel(clock.label)


@dataclass(frozen=True)
class _Clock:
    """Positions of frames on the time axis, its offset, and its label."""

    when: Any
    zero: float
    label: str


def _clock(table: pandas.DataFrame) -> _Clock:
    if "frame" in table:
        return _Clock(np.asarray(table["frame"]), 0.0, "frame")
    time = np.asarray(table["time (s)"], dtype=np.float64)
    known = time[np.isfinite(time)]
    first = float(known[0]) if len(known) else 0.0
    if not len(known) or abs(first) <= 0.01 * float(np.ptp(known)):
        return _Clock(time, 0.0, "time [s]")
    said = f"{plain_time(first)} s"
    if EPOCH[0] <= first < EPOCH[1]:
        said = f"{datetime.fromtimestamp(first, tz=UTC):%Y-%m-%d %H:%M:%S} UTC"
    return _Clock(time - first, first, f"time [s]\nfrom {said}")


@dataclass
class _Span:
    """The times (began, ended) of one kind of event; kinds are ordered by their first beginning."""

    kind: str
    times: list[tuple[float, float]]


def _spans(events: Sequence[Any], clock: _Clock) -> list[_Span]:
    """Return the kinds to mark, each with all its times. An event without an end extends to the last frame."""
    last = float(np.nanmax(clock.when)) if len(clock.when) and np.isfinite(clock.when).any() else 0.0
    found: dict[str, _Span] = {}
    going_on: dict[str, float] = {}
    for event in sorted(events, key=lambda e: e.time):
        if event.kind not in MARKED:
            continue
        at = event.time - clock.zero
        span = found.setdefault(event.kind, _Span(event.kind, []))
        if event.began:
            if event.kind in going_on:
                span.times.append((going_on.pop(event.kind), at))
            going_on[event.kind] = at
        elif event.kind in going_on:
            span.times.append((going_on.pop(event.kind), at))
    for kind, began in going_on.items():
        found[kind].times.append((began, max(began, last)))
    return [span for span in found.values() if span.times]


def _is_value(title: str, begins: str | tuple[str, ...]) -> bool:
    name = title.split(" (")[0]
    return title.startswith(begins) and not name.endswith(("_low", "_high"))


def _draw(ax: Axes, table: pandas.DataFrame, titles: Sequence[str], clock: _Clock) -> None:
    when = clock.when
    low, high, cut = _limits([_numbers(table, t) for t in titles])
    unit = titles[0][:-1].split(" (")[1]
    size = max(abs(low), abs(high))
    factor, unit = (1.0, unit) if unit.startswith("N") and size >= 0.05 else scaled(max(size, 1e-12), unit)
    force = titles[0].startswith("force_")
    for title in titles:
        name = title.split(" (")[0]
        colour = INK[name[-1]] if force else INK["pressure" if name == "peak_pressure" else "other"]
        value, below, above = (factor * numbers for numbers in _numbers(table, title))
        there = np.concatenate([[False], np.isfinite(value), [False]])
        # a frame between frames without an answer has no line
        alone = np.flatnonzero(there[1:-1] & ~there[:-2] & ~there[2:])
        ax.fill_between(when, below, above, color=colour, alpha=0.25, linewidth=0)
        label = name[-1] if force else None
        ax.plot(when, value, color=colour, marker="o" if len(alone) else None, markevery=alone.tolist(), label=label)
    ax.axhline(0.0, color="0.75", linewidth=0.5, zorder=0)
    if force:
        ax.set_ylabel(f"net force [{unit}]")
    else:
        ax.set_ylabel(f"{titles[0].split(' (')[0].replace('_', ' ')}\n[{unit}]")
    _hatch_gaps(ax, when, np.asarray(table[titles[0]]))
    ax.margins(x=0)
    room = 0.05 * (high - low)
    ax.set_ylim(factor * (low - room), factor * (high + room))
    if cut:
        ax.annotate(
            "bands cut", (1.0, 0.0), xycoords="axes fraction", xytext=(-1, 1), textcoords="offset points",
            ha="right", va="bottom", fontsize=6, color="0.35",
        )  # fmt: skip
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def _numbers(table: pandas.DataFrame, title: str) -> tuple[Any, Any, Any]:
    """Return a column of the table, and both ends of its intervals."""
    names = (title, *(title.replace(" (", f"_{side} (") for side in ("low", "high")))
    value, low, high = (np.asarray(table[name], dtype=np.float64) for name in names)
    return value, low, high


def _limits(columns: Sequence[tuple[Any, Any, Any]]) -> tuple[float, float, bool]:
    """Return the ends of an axis that shows all values and most intervals, and whether some interval does not fit.

    A very uncertain frame has an interval hundreds of times as wide as the values; an axis of that length would show
    nothing else.
    """
    values = np.concatenate([c[0] for c in columns])
    halves = [np.maximum(value - low, high - value) for value, low, high in columns]
    known = np.concatenate(halves)
    known = known[np.isfinite(known)]
    shown = values[np.isfinite(values)]
    if not len(shown):
        return 0.0, 1.0, False
    widest = (
        max(WIDE * float(np.quantile(known, USUAL)), 0.25 * float(np.ptp(np.append(shown, 0.0)))) if len(known) else 0.0
    )
    low, high = min(float(shown.min()), 0.0), max(float(shown.max()), 0.0)
    cut = False
    for value, below, above in columns:
        there = np.isfinite(value) & np.isfinite(below) & np.isfinite(above)
        if there.any():
            low = min(low, float(np.maximum(below, value - widest)[there].min()))
            high = max(high, float(np.minimum(above, value + widest)[there].max()))
    for _, below, above in columns:
        cut = cut or bool((below < low - 0.05 * (high - low)).any() or (above > high + 0.05 * (high - low)).any())
    return (low, high, cut) if high > low else (low - 0.5, high + 0.5, cut)


def _legend(ax: Axes, above: Axes, table: pandas.DataFrame) -> None:
    """Put the names of the forces in ``ax`` and the level of the bands above the axes ``above``."""
    handles, labels = ax.get_legend_handles_labels()
    above.legend(
        handles, labels, frameon=False, ncols=max(1, len(labels)), loc="lower left", bbox_to_anchor=(0.0, 1.0),
        borderpad=0.1, handlelength=1.2,
    )  # fmt: skip
    above.set_title(f"bands hold {level_words(table)}", loc="right", fontsize=7, color="0.35")


def _hatch_gaps(ax: Axes, when: Any, values: Any) -> None:
    """Hatch frames without an answer. Frames without contact have no slip margin, but that is not a gap."""
    missing = ~np.isfinite(values)
    if not missing.any() or missing.all() or ax.get_ylabel().startswith("slip"):
        return
    edges = np.concatenate([when[:1], 0.5 * (when[1:] + when[:-1]), when[-1:]])
    for i in np.flatnonzero(missing):
        ax.axvspan(edges[i], edges[i + 1], facecolor="none", edgecolor="0.6", hatch="////", linewidth=0)


def _guide(ax: Axes, spans: Sequence[_Span]) -> None:
    """Draw a faint line where an event begins, unless there are too many lines."""
    begun = [began for span in spans for began, _ in span.times]
    if len(begun) <= MOST_LINES:
        for began in begun:
            ax.axvline(began, color="0.6", linewidth=0.5, linestyle=(0, (3, 2)), zorder=0)


def _name(ax: Axes, spans: Sequence[_Span], *, right: bool = False) -> None:
    """Draw one row for each kind of event: its name beside the row, a bar while it lasts, a mark where it begins. Rows
    keep the names from overlapping.
    """
    for row, span in enumerate(spans):
        colour = "0.35" if span.kind == "contact" else INK["error"]
        for began, ended in span.times:
            ax.fill_betweenx([row - 0.28, row + 0.28], began, ended, color=colour, alpha=0.3, linewidth=0)
        ax.plot([began for began, _ in span.times], [row] * len(span.times), "|", color=colour, markersize=5)
        ax.annotate(
            span.kind, (1.0 if right else 0.0, row), xycoords=("axes fraction", "data"), xytext=(4 if right else -4, 0),
            textcoords="offset points", ha="left" if right else "right", va="center", fontsize=6, color=colour,
        )  # fmt: skip
    ax.set_ylim(len(spans) - 0.5, -0.5)
    ax.set_yticks([])
    ax.margins(x=0)
    ax.tick_params(axis="x", bottom=False, labelbottom=False)
    ax.patch.set_visible(False)
    for side in ("top", "right", "bottom", "left"):
        ax.spines[side].set_visible(False)
