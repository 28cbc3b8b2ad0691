"""Forces over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._extras import require
from palpate._plot.style import COLUMN, INK, column_size, journal, scaled

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_forces", "plot_forces"]

#: Events that begin something a reader looks for; others only fill the picture.
MARKED = ("contact", "slip", "incipient slip", "pull", "excess pressure", "excess force", "unexplained")


def plot_forces(table: pandas.DataFrame, *, events: Sequence[Any] = (), title: str | None = None) -> Figure:
    """A figure, one column wide, of forces with their 95 % bands over time and, below, peak pressure and slip margin.

    ``table`` is that of `Touch.table`; ``events`` those of a `GraspMonitor`.
    """
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    rows = [[t for t in table if _is_value(t, "force_")]]
    rows += [[t] for t in table if _is_value(t, ("peak_pressure", "slip_margin"))]
    rows = [row for row in rows if row and any(np.isfinite(table[t]).any() for t in row)] or rows[:1]
    with journal():
        figure = Figure(figsize=(COLUMN, 0.6 + 1.5 + 0.95 * (len(rows) - 1)), layout="constrained")
        panels = figure.subplots(
            len(rows), 1, sharex=True, squeeze=False, height_ratios=[1.6, *[1.0] * (len(rows) - 1)]
        )[:, 0]
        for panel, row in zip(panels, rows):
            _draw(panel, table, row)
            _mark(panel, events, named=panel is panels[0])
        panels[-1].set_xlabel(_clock(table)[1])
        figure.align_ylabels(panels)
        if title:
            figure.suptitle(title)
    return figure


def draw_forces(ax: Axes, table: pandas.DataFrame, *, events: Sequence[Any] = ()) -> None:
    """The forces of a table with their 95 % bands and events, into axes of a figure of your own."""
    _draw(ax, table, [t for t in table if _is_value(t, "force_")])
    _mark(ax, events, named=True)
    ax.set_xlabel(_clock(table)[1])


def _is_value(title: str, begins: str | tuple[str, ...]) -> bool:
    name = title.split(" (")[0]
    return title.startswith(begins) and not name.endswith(("_low", "_high"))


def _clock(table: pandas.DataFrame) -> tuple[Any, str]:
    if "frame" in table:
        return np.asarray(table["frame"]), "frame"
    return np.asarray(table["time (s)"]), "time [s]"


def _draw(ax: Axes, table: pandas.DataFrame, titles: Sequence[str]) -> None:
    when, _ = _clock(table)
    size = max(column_size(table, t) for t in titles)
    unit = titles[0][:-1].split(" (")[1]
    factor, unit = (1.0, unit) if unit.startswith("N") and size >= 0.05 else scaled(max(size, 1e-12), unit)
    force = titles[0].startswith("force_")
    for title in titles:
        name = title.split(" (")[0]
        colour = INK[name[-1]] if force else INK["pressure" if name == "peak_pressure" else "other"]
        low, high = (factor * np.asarray(table[title.replace(" (", f"_{s} (")]) for s in ("low", "high"))
        single = "o" if len(when) == 1 else None
        ax.fill_between(when, low, high, color=colour, alpha=0.25, linewidth=0)
        ax.plot(when, factor * np.asarray(table[title]), color=colour, marker=single, label=name[-1] if force else None)
    ax.axhline(0.0, color="0.75", linewidth=0.5, zorder=0)
    if force:
        ax.set_ylabel(f"net force [{unit}]")
        ax.legend(
            frameon=False,
            ncols=len(titles),
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderpad=0.1,
            handlelength=1.2,
        )
        ax.set_title("bands hold 95 %", loc="right", fontsize=7, color="0.35")
    else:
        ax.set_ylabel(f"{titles[0].split(' (')[0].replace('_', ' ')}\n[{unit}]")
    _unknown(ax, when, np.asarray(table[titles[0]]))
    ax.margins(x=0)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def _unknown(ax: Axes, when: Any, values: Any) -> None:
    """Hatch over the frames that have no answer; a margin has none where nothing touches, which is no gap."""
    missing = ~np.isfinite(values)
    if not missing.any() or missing.all() or ax.get_ylabel().startswith("slip"):
        return
    edges = np.concatenate([when[:1], 0.5 * (when[1:] + when[:-1]), when[-1:]])
    for i in np.flatnonzero(missing):
        ax.axvspan(edges[i], edges[i + 1], facecolor="none", edgecolor="0.6", hatch="////", linewidth=0)


def _mark(ax: Axes, events: Sequence[Any], *, named: bool) -> None:
    """A line where something begins, with its name beside the top."""
    shown: list[float] = []
    span = float(np.ptp(ax.get_xlim()))
    for event in events:
        if event.kind not in MARKED or not event.began:
            continue
        ax.axvline(event.time, color="0.35", linewidth=0.6, linestyle=(0, (3, 2)))
        if named:
            # names that would lie on each other go below each other
            lane = sum(1 for t in shown if abs(t - event.time) < 0.05 * span)
            shown.append(event.time)
            ax.annotate(
                event.kind,
                (event.time, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(-2 - 7 * lane, -2),
                textcoords="offset points",
                rotation=90,
                ha="right",
                va="top",
                fontsize=6,
                color="0.25",
                bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.5},
            )
