"""Pictures of a cell's traction."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._extras import require
from palpate._plot import arrow_cells, scaled
from palpate.elastic.pad import Floats
from palpate.microscopy.fields import Field

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from palpate.microscopy.cell import CellForces

__all__ = ["plot_error", "plot_field", "plot_traction"]

#: Arrows along the longer side of a picture; vectors smaller than this part of the largest get none.
ARROWS, SMALLEST = 36, 0.08
WIDTH = 6.4


def _round(value: float) -> float:
    """1, 2 or 5 times a power of ten, at most ``value``."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (5.0, 2.0, 1.0) if m * power <= value * (1 + 1e-9))


def _said(value: float, unit: str) -> str:
    factor, name = scaled(value, unit)
    return f"{value * factor:g} {name}"


def _ends(field: Field) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of the vectors' squares [px], rows downwards."""
    rows, columns = field.shape
    half = 0.5 * field.step
    left, top = field.start[0] - half, field.start[1] - half
    return left, left + columns * field.step, top + rows * field.step, top


def _canvas(field: Field, picture: Any) -> tuple[Any, Any, tuple[float, float, float, float]]:
    """Figure and axes in pixels of the picture, rows downwards, and what is in view."""
    from matplotlib.figure import Figure

    ends = _ends(field)
    if picture is not None:
        ends = (-0.5, np.shape(picture)[1] - 0.5, np.shape(picture)[0] - 0.5, -0.5)
    high = (ends[2] - ends[3]) / (ends[1] - ends[0])
    figure = Figure(figsize=(WIDTH + 1.2, max(2.6, WIDTH * high + 0.5)), layout="constrained")
    axes = figure.subplots()
    axes.set_xlim(ends[0], ends[1])
    axes.set_ylim(ends[2], ends[3])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    if picture is not None:
        image = np.asarray(picture, dtype=np.float64)
        low, top = np.percentile(image, (1, 99.7))
        axes.imshow(image, cmap="gray", vmin=low, vmax=max(top, low + 1e-12), zorder=0)
    return figure, axes, ends


def _arrows(
    axes: Any, field: Field, vectors: Floats, unit: str, ends: tuple[float, float, float, float], color: str, show: Any
) -> None:
    """Arrows of a field, and one that says how long they are."""
    rows, columns = field.shape
    size = np.hypot(*vectors)
    shown = size[np.isfinite(size)]
    if not shown.size or shown.max() <= 0:
        return
    # few squares hold all traction of a sparse map
    largest = max(float(np.percentile(shown, 99.8)), 0.7 * float(shown.max()))
    stride = max(1, round(max(rows, columns) / ARROWS))
    # the strongest first, so that no adhesion falls between arrows
    i, j = arrow_cells(np.where(show, np.nan_to_num(size), 0.0), (stride, stride), SMALLEST * largest)
    length = 0.085 * (ends[1] - ends[0]) / largest
    style: dict[str, Any] = {
        "angles": "xy",
        "scale_units": "xy",
        "scale": 1.0,
        "width": 0.0035,
        "headwidth": 3.6,
        "headlength": 4.2,
    }
    axes.quiver(
        field.start[0] + field.step * j, field.start[1] + field.step * i, *(vectors[:, i, j] * length), color=color, zorder=3, **style
    )  # fmt: skip
    told = _round(largest)
    wide, high = ends[1] - ends[0], ends[2] - ends[3]
    corner = ends[0] + 0.04 * wide, ends[2] - 0.05 * high
    box = {"boxstyle": "round,pad=0.3", "facecolor": "black", "alpha": 0.65, "edgecolor": "none"}
    axes.text(
        corner[0],
        corner[1] - 0.025 * high,
        _said(told, unit),
        color="white",
        fontsize=8,
        ha="left",
        va="bottom",
        zorder=5,
        bbox=box,
    )
    axes.quiver(*corner, told * length, 0.0, color="white", zorder=6, **style)


def _bar(axes: Any, field: Field, ends: tuple[float, float, float, float]) -> None:
    """The scale bar."""
    wide, high = ends[1] - ends[0], ends[2] - ends[3]
    told = _round(0.22 * wide * field.pixel)
    length = told / field.pixel
    right, low = ends[1] - 0.04 * wide, ends[2] - 0.05 * high
    box = {"boxstyle": "round,pad=0.3", "facecolor": "black", "alpha": 0.65, "edgecolor": "none"}
    axes.plot([right - length, right], [low, low], color="white", lw=3, solid_capstyle="butt", zorder=6)
    axes.text(
        right - 0.5 * length,
        low - 0.025 * high,
        _said(told, "m"),
        color="white",
        fontsize=8,
        ha="center",
        va="bottom",
        zorder=5,
        bbox=box,
    )


def _outline(axes: Any, forces: CellForces) -> None:
    if not forces.masked:
        return
    if forces.mask is not None and forces.mask.dtype != np.bool_:
        axes.plot(*np.concatenate([forces.mask, forces.mask[:1]]).T, color="white", lw=1.1, ls="--", zorder=4)
        return
    field, shape = forces.field, forces.inside.shape
    if forces.mask is not None and forces.mask.shape != shape:  # in pixels of the picture
        values, places = forces.mask, [np.arange(n, dtype=np.float64) for n in forces.mask.shape]
    else:
        values, places = forces.inside, [s + field.step * np.arange(n) for s, n in zip(field.start[::-1], shape)]
    if not values.all():
        style: dict[str, Any] = {"colors": "white", "linewidths": 1.1, "linestyles": "--", "zorder": 4}
        axes.contour(places[1], places[0], values.astype(float), levels=[0.5], **style)


def plot_traction(forces: CellForces, *, title: str | None = None) -> Figure:
    """Size of the traction in colour over the picture, its largest vectors as arrows, with a scale arrow and a scale bar."""
    require("figures", "matplotlib")
    field = forces.field
    size = np.hypot(*forces.traction)
    top = max(float(np.percentile(size, 99.9)), 0.8 * float(size.max()), 1e-12)
    factor, unit = scaled(top, "Pa")
    figure, axes, ends = _canvas(field, forces.picture)
    over = forces.picture is not None
    # where the picture shows the cell, the colour lets it through where little is pulled
    alpha = np.clip(size / (0.35 * top), 0.12, 0.8) if over else None
    image = axes.imshow(
        size * factor, extent=_ends(field), cmap="inferno", vmin=0.0, vmax=top * factor, alpha=alpha, interpolation="nearest", zorder=1
    )  # fmt: skip
    image.set_extent(_ends(field))
    axes.set_xlim(ends[0], ends[1])
    axes.set_ylim(ends[2], ends[3])
    _outline(axes, forces)
    _arrows(
        axes,
        field,
        forces.traction,
        "Pa",
        ends,
        "#7fe3ff",
        forces.inside if forces.masked else np.ones(field.shape, dtype=bool),
    )
    _bar(axes, field, ends)
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    figure.colorbar(
        ScalarMappable(Normalize(0.0, top * factor), "inferno"),
        ax=axes,
        label=f"traction [{unit}]",
        shrink=0.85,
        pad=0.02,
    )
    if title:
        axes.set_title(title, fontsize=10)
    return figure


def plot_field(field: Field, *, picture: Any = None) -> Figure:
    """Size of the displacements in colour and their arrows."""
    require("figures", "matplotlib")
    size = np.hypot(*field.displacement)
    top = float(max(np.nanpercentile(size, 99.9), 1e-15))
    factor, unit = scaled(top, "m")
    figure, axes, ends = _canvas(field, picture)
    image = axes.imshow(size * factor, extent=_ends(field), cmap="viridis", vmin=0.0, vmax=top * factor, alpha=0.85 if picture is not None else None, interpolation="nearest", zorder=1)  # fmt: skip
    axes.set_xlim(ends[0], ends[1])
    axes.set_ylim(ends[2], ends[3])
    _arrows(axes, field, field.displacement, "m", ends, "white", np.ones(field.shape, dtype=bool))
    _bar(axes, field, ends)
    figure.colorbar(image, ax=axes, label=f"displacement [{unit}]", shrink=0.85, pad=0.02)
    return figure


def plot_error(forces: CellForces) -> Figure:
    """Standard deviation of the traction."""
    require("figures", "matplotlib")
    field = forces.field
    size = np.sqrt((forces.std**2).sum(axis=0))
    factor, unit = scaled(float(max(size.max(), 1e-12)), "Pa")
    figure, axes, ends = _canvas(field, None)
    image = axes.imshow(size * factor, extent=_ends(field), cmap="cividis", vmin=0.0, interpolation="nearest", zorder=1)
    axes.set_xlim(ends[0], ends[1])
    axes.set_ylim(ends[2], ends[3])
    _outline(axes, forces)
    _bar(axes, field, ends)
    figure.colorbar(image, ax=axes, label=f"standard deviation [{unit}]", shrink=0.85, pad=0.02)
    return figure
