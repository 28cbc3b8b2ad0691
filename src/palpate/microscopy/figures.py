"""Pictures of a cell's traction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate._extras import require
from palpate._plot import arrow_cells, scaled
from palpate.elastic.pad import Floats
from palpate.microscopy.fields import Field

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ShownCell", "plot_error", "plot_field", "plot_traction", "scale_bar", "square_ends"]

#: Number of arrows along the longer side of a picture. Vectors smaller than SMALLEST times the largest get no arrow.
ARROWS, SMALLEST = 36, 0.08
WIDTH = 6.4
#: If a cell fills less than CLOSER of the view, the plot zooms in to the cell with a margin of ROOM times its length,
#: and to all traction above FAINT times the largest.
CLOSER, ROOM, FAINT = 0.5, 0.25, 0.05
#: An arrow is drawn where the traction is at least this many standard deviations from zero (95 %).
SURE = 1.96


class ShownCell(Protocol):
    """The part of `palpate.microscopy.CellForces` that figures and reports use, so that they need not import that class."""

    @property
    def field(self) -> Field: ...
    @property
    def pad(self) -> Any: ...
    @property
    def traction(self) -> Floats: ...
    @property
    def std(self) -> Floats: ...
    @property
    def inside(self) -> npt.NDArray[np.bool_]: ...
    @property
    def mask(self) -> Any: ...
    @property
    def masked(self) -> bool: ...
    @property
    def picture(self) -> Any: ...
    @property
    def samples(self) -> Any: ...
    @property
    def known(self) -> Any: ...
    @property
    def touch(self) -> Any: ...
    @property
    def quantities(self) -> Mapping[str, Any]: ...
    @property
    def principal(self) -> tuple[float, float, float]: ...
    @property
    def notes(self) -> tuple[str, ...]: ...


def _round(value: float) -> float:
    """Return the largest number of the form 1, 2 or 5 times a power of ten that is at most ``value``."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (5.0, 2.0, 1.0) if m * power <= value * (1 + 1e-9))


def _value_text(value: float, unit: str) -> str:
    factor, name = scaled(value, unit)
    return f"{value * factor:g} {name}"


def square_ends(field: Field) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top [px] of the area that the vectors' squares cover; rows count downwards."""
    rows, columns = field.shape
    half = 0.5 * field.step
    left, top = field.start[0] - half, field.start[1] - half
    return left, left + columns * field.step, top + rows * field.step, top


def _canvas(
    field: Field, picture: Any, near: npt.NDArray[np.bool_] | None = None
) -> tuple[Any, Any, tuple[float, float, float, float]]:
    """Return a figure, its axes in pixels of the picture (rows downwards), and the view: all of it, or only the
    squares ``near`` (row, column) if these cover a much smaller part.
    """
    from matplotlib.figure import Figure

    ends = square_ends(field)
    if picture is not None:
        ends = (-0.5, np.shape(picture)[1] - 0.5, np.shape(picture)[0] - 0.5, -0.5)
    if near is not None and near.any():
        ends = _closer(field, near, ends)
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


def _closer(
    field: Field, near: npt.NDArray[np.bool_], ends: tuple[float, float, float, float]
) -> tuple[float, float, float, float]:
    """Zoom in with a margin if the object fills only a small part of the view."""
    sides = []
    for axis, (low, high) in ((0, (ends[0], ends[1])), (1, (ends[3], ends[2]))):
        at = field.start[axis] + field.step * np.flatnonzero(near.any(axis=axis))
        sides.append((float(at[0]), float(at[-1]), low, high))
    room = ROOM * max(b - a for a, b, _, _ in sides) + 2 * field.step
    (left, right), (top, bottom) = ((max(a - room, low), min(b + room, high)) for a, b, low, high in sides)
    if (right - left) * (bottom - top) > CLOSER * (ends[1] - ends[0]) * (ends[2] - ends[3]):
        return ends
    return left, right, bottom, top


def _arrows(
    axes: Any, field: Field, vectors: Floats, unit: str, ends: tuple[float, float, float, float], color: str, show: Any
) -> None:
    """Draw the arrows of a field and a scale arrow."""
    rows, columns = field.shape
    size = np.hypot(*vectors)
    shown = size[np.isfinite(size)]
    if not shown.size or shown.max() <= 0:
        return
    # in a sparse map all traction lies on a few squares
    largest = max(float(np.percentile(shown, 99.8)), 0.7 * float(shown.max()))
    stride = max(1, round(max(rows, columns) / ARROWS))
    # start at the strongest, so that no adhesion falls between two arrows
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
    key = _round(largest)
    wide, high = ends[1] - ends[0], ends[2] - ends[3]
    corner = ends[0] + 0.04 * wide, ends[2] - 0.05 * high
    box = {"boxstyle": "round,pad=0.3", "facecolor": "black", "alpha": 0.65, "edgecolor": "none"}
    axes.text(
        corner[0],
        corner[1] - 0.025 * high,
        _value_text(key, unit),
        color="white",
        fontsize=8,
        ha="left",
        va="bottom",
        zorder=5,
        bbox=box,
    )
    axes.quiver(*corner, key * length, 0.0, color="white", zorder=6, **style)


def scale_bar(axes: Any, field: Field, ends: tuple[float, float, float, float]) -> None:
    """Draw the scale bar."""
    wide, high = ends[1] - ends[0], ends[2] - ends[3]
    scale = _round(0.22 * wide * field.pixel)
    length = scale / field.pixel
    right, low = ends[1] - 0.04 * wide, ends[2] - 0.05 * high
    box = {"boxstyle": "round,pad=0.3", "facecolor": "black", "alpha": 0.65, "edgecolor": "none"}
    axes.plot([right - length, right], [low, low], color="white", lw=3, solid_capstyle="butt", zorder=6)
    axes.text(
        right - 0.5 * length,
        low - 0.025 * high,
        _value_text(scale, "m"),
        color="white",
        fontsize=8,
        ha="center",
        va="bottom",
        zorder=5,
        bbox=box,
    )


def _outline(axes: Any, forces: ShownCell) -> None:
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


def plot_traction(forces: ShownCell, *, title: str | None = None) -> Figure:
    """Plot the traction's magnitude in colour over the picture, its largest vectors, a scale arrow and a scale bar."""
    require("figures", "matplotlib")
    field = forces.field
    size = np.hypot(*forces.traction)
    peak = forces.quantities.get("traction_peak")
    # extend the colour scale to the largest traction, which is written beside the ring
    top = max(float(size.max()), 0.0 if peak is None else peak.value, 1e-12)
    factor, unit = scaled(top, "Pa")
    figure, axes, ends = _canvas(field, forces.picture, forces.inside | (size > FAINT * top) if forces.masked else None)
    over = forces.picture is not None
    # on a picture of the cell, weak traction is transparent
    alpha = np.clip(size / (0.35 * top), 0.12, 0.8) if over else None
    image = axes.imshow(
        size * factor, extent=square_ends(field), cmap="inferno", vmin=0.0, vmax=top * factor, alpha=alpha, interpolation="nearest", zorder=1
    )  # fmt: skip
    image.set_extent(square_ends(field))
    axes.set_xlim(ends[0], ends[1])
    axes.set_ylim(ends[2], ends[3])
    _outline(axes, forces)
    where = forces.inside if forces.masked else np.ones(field.shape, dtype=bool)
    sure = size > SURE * _along(forces)
    _arrows(axes, field, forces.traction, "Pa", ends, "#7fe3ff", where & sure)
    scale_bar(axes, field, ends)
    _peak(axes, forces, np.where(where, size, -1.0), ends)
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
    figure.supxlabel(_assumed(forces), fontsize=7.5, color="#444444", ha="left", x=0.02)
    return figure


def _along(forces: ShownCell) -> Floats:
    """Return the standard deviation (row, column) [Pa] of the traction along its own direction."""
    size = np.maximum(np.hypot(*forces.traction), 1e-300)
    return np.asarray(np.sqrt(((forces.std * forces.traction / size) ** 2).sum(axis=0)))


def _two(value: float) -> str:
    """Return a number with two digits, or with all digits before the decimal point."""
    return f"{value:#.2g}".rstrip(".") if abs(value) < 99.5 else f"{value:.0f}"


def _peak(axes: Any, forces: ShownCell, size: Floats, ends: tuple[float, float, float, float]) -> None:
    """Draw a ring round the largest traction, and write its interval beside it."""
    q, field = forces.quantities.get("traction_peak"), forces.field
    if q is None or not size.max() > 0:
        return
    i, j = np.unravel_index(int(size.argmax()), size.shape)
    x, y = field.start[0] + field.step * j, field.start[1] + field.step * i
    wide, high = ends[1] - ends[0], ends[2] - ends[3]
    factor, unit = scaled(max(abs(q.interval[1]), 1e-12), "Pa")
    low, top = (max(e, 0.0) * factor for e in q.interval)
    said = f"largest {_two(q.value * factor)} {unit}\n95 %: {_two(low)} to {_two(top)}"
    axes.plot(x, y, marker="o", ms=13, mfc="none", mec="white", mew=1.2, zorder=5)
    # write in the nearer upper corner, unless the ring is there
    left = bool(x < 0.5 * (ends[0] + ends[1]))
    if abs(x - ends[0 if left else 1]) < 0.3 * wide and y - ends[3] < 0.15 * high:
        left = not left
    at = ends[0] + (0.03 if left else 0.97) * wide, ends[3] + 0.03 * high
    axes.annotate(
        said, (x, y), at, color="white", fontsize=8, ha="left" if left else "right", va="top", zorder=6,
        bbox={"boxstyle": "round,pad=0.3", "facecolor": "black", "alpha": 0.65, "edgecolor": "none"},
        arrowprops={"arrowstyle": "-", "color": "white", "lw": 0.8, "shrinkB": 7},
    )  # fmt: skip


def _assumed(forces: ShownCell) -> str:
    """Return two lines of text with the assumptions of the result."""
    field, pad = forces.field, forces.pad
    layers = getattr(pad, "layers", None)
    top = pad if layers is None else layers[-1]
    modulus, ratio = getattr(top, "youngs_modulus", None), getattr(top, "poissons_ratio", None)
    known = getattr(forces.known, "modulus", None)
    gel = "gel as described"
    if isinstance(modulus, float | int) and isinstance(ratio, float | int):
        factor, unit = scaled(float(modulus), "Pa")
        share = f" ± {100 * known:.0f} %" if known else ""
        gel = f"gel {modulus * factor:.3g} {unit}{share}, Poisson's ratio {ratio:g}"
    if layers is not None:
        gel += f", {1e6 * sum(one.thickness for one in layers):.3g} µm thick on a rigid base"
    else:
        gel += ", as thick as need be"
    window = f"windows of {1e6 * field.aperture:.3g} µm" if field.aperture else "vectors of points"
    method = "adhesions, sampled" if forces.samples is not None else "one even penalty (tikhonov)"
    mask = "dashed: mask" if forces.masked else "no mask"
    return f"{gel}; {window}, one every {1e6 * field.pitch:.3g} µm; pixel {1e6 * field.pixel:.4g} µm\ntraction: {method}, along the surface; arrows: traction that differs from zero at 95 %; {mask}"


def plot_field(field: Field) -> Figure:
    """Plot the magnitude of the displacements in colour, and arrows."""
    require("figures", "matplotlib")
    size = np.hypot(*field.displacement)
    top = float(max(np.nanpercentile(size, 99.9), 1e-15))
    factor, unit = scaled(top, "m")
    figure, axes, ends = _canvas(field, None)
    image = axes.imshow(size * factor, extent=square_ends(field), cmap="viridis", vmin=0.0, vmax=top * factor, interpolation="nearest", zorder=1)  # fmt: skip
    axes.set_xlim(ends[0], ends[1])
    axes.set_ylim(ends[2], ends[3])
    _arrows(axes, field, field.displacement, "m", ends, "white", np.ones(field.shape, dtype=bool))
    scale_bar(axes, field, ends)
    figure.colorbar(image, ax=axes, label=f"displacement [{unit}]", shrink=0.85, pad=0.02)
    return figure


def plot_error(forces: ShownCell) -> Figure:
    """Plot the standard deviation of the traction."""
    require("figures", "matplotlib")
    field = forces.field
    size = np.sqrt((forces.std**2).sum(axis=0))
    factor, unit = scaled(float(max(size.max(), 1e-12)), "Pa")
    figure, axes, ends = _canvas(field, None)
    image = axes.imshow(
        size * factor, extent=square_ends(field), cmap="cividis", vmin=0.0, interpolation="nearest", zorder=1
    )
    axes.set_xlim(ends[0], ends[1])
    axes.set_ylim(ends[2], ends[3])
    _outline(axes, forces)
    scale_bar(axes, field, ends)
    figure.colorbar(image, ax=axes, label=f"standard deviation [{unit}]", shrink=0.85, pad=0.02)
    return figure
