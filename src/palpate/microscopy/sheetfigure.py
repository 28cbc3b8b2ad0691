"""Picture of the tension in a sheet of cells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate._extras import require
from palpate._plot import scaled
from palpate.elastic.pad import Floats
from palpate.microscopy.figures import ShownCell, scale_bar, square_ends

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_tension"]

#: Lines along the longer side that show directions, where the two principal tensions differ by this many of the difference's standard deviations.
LINES, SURE = 24, 1.96
WIDTH = 10.5
#: Where the sheet is pressed by more than this part of the largest tension, colours have two sides.
PUSHED = 0.1


class ShownSheet(Protocol):
    """The part of `palpate.microscopy.SheetTension` that its picture uses, so that it need not import that class."""

    @property
    def forces(self) -> ShownCell: ...
    @property
    def tension(self) -> Floats: ...
    @property
    def draws(self) -> Floats: ...
    @property
    def inside(self) -> npt.NDArray[np.bool_]: ...
    @property
    def average(self) -> Floats: ...
    @property
    def labels(self) -> Mapping[str, npt.NDArray[np.bool_]] | None: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    def __getitem__(self, name: str) -> Any: ...


def plot_tension(sheet: ShownSheet, *, title: str | None = None) -> Figure:
    """Average tension, with lines along the larger principal tension if its direction is known, and the standard deviation beside it."""
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    field = sheet.forces.field
    ends = _view(sheet)
    high = (ends[2] - ends[3]) / (ends[1] - ends[0])
    figure = Figure(figsize=(WIDTH, max(2.8, 0.42 * WIDTH * high + 1.0)), layout="constrained")
    average = sheet.average
    error = (0.5 * (sheet.draws[:, 0] + sheet.draws[:, 1])).std(axis=0, ddof=1)
    top = max(float(np.nanmax(np.abs(average))), 1e-300)
    factor, unit = scaled(top, "N/m")
    low = min(0.0, float(np.nanmin(average)))
    colours: dict[str, Any] = {"cmap": "inferno", "vmin": low * factor, "vmax": top * factor}
    if low < -PUSHED * top:  # white is no tension
        colours = {"cmap": "RdBu_r", "vmin": -top * factor, "vmax": top * factor}
    panels: Any = figure.subplots(1, 2)
    for axes, values, name, style in (
        (panels[0], average, "average tension", colours),
        (panels[1], error, "its standard deviation", {"cmap": "cividis", "vmin": 0.0, "vmax": top * factor}),
    ):
        axes.set_facecolor("#d9d9d9")
        image = axes.imshow(values * factor, extent=square_ends(field), interpolation="nearest", **style)
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_aspect("equal")
        figure.colorbar(image, ax=axes, label=f"{name} [{unit}]", shrink=0.85, pad=0.02)
        _borders(axes, sheet)
        scale_bar(axes, field, ends)
        axes.set_xlim(ends[0], ends[1])
        axes.set_ylim(ends[2], ends[3])
    drawn = _directions(panels[0], sheet)
    q = sheet["average_tension"]
    low_end, high_end = (factor * e for e in q.interval)
    panels[0].set_title(f"mean {factor * q.value:.3g} {unit} (95 %: {low_end:.3g} to {high_end:.3g})", fontsize=9)
    if title:
        figure.suptitle(title, fontsize=10)
    lines = "lines: larger tension, where its direction is known; " if drawn else ""
    figure.supxlabel(lines + sheet.notes[-1], fontsize=7.5, color="#444444", ha="left", x=0.02, wrap=True)
    return figure


def _view(sheet: ShownSheet) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of the sheet and a margin [px], within the field of view."""
    field = sheet.forces.field
    left, right, bottom, top = square_ends(field)
    rows, columns = np.nonzero(sheet.inside)
    margin = max(2.0, 0.08 * max(np.ptp(rows), np.ptp(columns)))
    x, y = (
        (s + field.step * (n.min() - margin), s + field.step * (n.max() + margin))
        for s, n in zip(field.start, (columns, rows))
    )
    return max(left, x[0]), min(right, x[1]), min(bottom, y[1]), max(top, y[0])


def _directions(axes: Any, sheet: ShownSheet) -> bool:
    """Lines along the larger principal tension, where the difference of both is more than its error; whether there are any."""
    drawn = False
    field = sheet.forces.field
    xx, yy, xy = sheet.tension
    half = np.stack([0.5 * (xx - yy), xy])
    size = np.hypot(*half)
    each = np.stack([0.5 * (sheet.draws[:, 0] - sheet.draws[:, 1]), sheet.draws[:, 2]])
    spread = np.sqrt(0.5 * each.var(axis=1, ddof=1).sum(axis=0))
    stride = max(1, round(max(field.shape) / LINES))
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    length = 0.42 * stride * field.step
    for i in range(stride // 2, field.shape[0], stride):
        for j in range(stride // 2, field.shape[1], stride):
            if not sheet.inside[i, j] or not size[i, j] > SURE * spread[i, j]:
                continue
            x, y = field.start[0] + field.step * j, field.start[1] + field.step * i
            dx, dy = length * np.cos(angle[i, j]), length * np.sin(angle[i, j])
            axes.plot(
                [x - dx, x + dx],
                [y - dy, y + dy],
                color="black" if sheet.average[i, j] < 0 else "#20c0ff",
                lw=1.0,
                zorder=3,
            )
            drawn = True
    return drawn


def _borders(axes: Any, sheet: ShownSheet) -> None:
    """Outlines of the cells."""
    if sheet.labels is None:
        return
    for mask in sheet.labels.values():
        rows, columns = np.nonzero(mask)
        if not len(rows):
            continue
        window = slice(max(rows.min() - 1, 0), rows.max() + 2), slice(max(columns.min() - 1, 0), columns.max() + 2)
        part = np.pad(mask[window].astype(float), 1)
        x = np.arange(part.shape[1]) - 1 + window[1].start
        y = np.arange(part.shape[0]) - 1 + window[0].start
        axes.contour(x, y, part, levels=[0.5], colors="white", linewidths=0.5, alpha=0.8, zorder=2)
