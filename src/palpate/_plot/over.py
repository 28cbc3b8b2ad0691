"""Draw a result over the picture from which it was computed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._extras import require
from palpate._plot.arrows import arrow_cells
from palpate._plot.shown import Shown
from palpate._plot.style import nice, scaled
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.view import eight_bit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Lies", "plot_over"]

#: Quantity and colour map of each panel.
SHOWN = {"pressure": "inferno", "shear": "cividis", "std": "magma"}
#: Nothing is drawn below this fraction of the largest value, so that the picture shows through.
FAINT = 0.03
#: Opacity at the largest value, and largest width of the drawing [px].
OPAQUE, FINEST = 0.85, 800
#: Grey of red, green and blue (ITU-R BT.601).
LUMA = np.array([0.299, 0.587, 0.114])
#: Number of arrows across a picture.
ARROWS = 13


class Lies(Protocol):
    """Maps places to pixels of a picture; a `palpate.camera.View` is one."""

    def pixels(self, places: npt.ArrayLike) -> Floats:
        """Return pixels (column, row) of places (x, y) [m]."""
        ...

    def places(self, pixels: npt.ArrayLike) -> Floats:
        """Return places (x, y) [m] of pixels (column, row)."""
        ...


def plot_over(
    touch: Shown,
    image: npt.ArrayLike,
    view: Lies,
    *,
    show: str = "all",
    truth: Shown | None = None,
    title: str | None = None,
    std: npt.ArrayLike | None = None,
) -> Figure:
    """Plot one frame over its picture; see `palpate.camera.overlay`. ``std`` (component, y, x) is for a touch without
    error bars of its own.
    """
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    if touch.batch or touch.surface.dimensions != 2:
        raise InvalidInput("overlay draws one frame of an area: pick one, touch[i].")
    picture = np.asarray(image)
    if (
        picture.dtype.kind not in "biuf"
        or not picture.size
        or picture.ndim not in (2, 3)
        or picture.shape[2:] not in ((), (3,), (4,))
    ):
        raise InvalidInput(
            f"a picture must be (row, column) or (row, column, 3); got the shape {picture.shape} of {picture.dtype}. Of several, give the one of this frame."
        )
    picture = eight_bit(picture)
    if picture.ndim == 3:  # convert to grey, so that all colours belong to the field: a lit gel has colours of its own
        picture = (picture[..., :3] @ LUMA).astype(np.uint8)
    if show != "all" and show not in SHOWN:
        raise InvalidInput(f"show must be {', '.join(SHOWN)} or all; got {show!r}.")
    fields = {name: _field(touch, name, std) for name in SHOWN}
    if show != "all" and fields[show] is None:
        why = "its error bars were not asked for" if show == "std" else "it was not sought"
        raise InvalidInput(f"{show} cannot be drawn: {why}.")
    names = [n for n in SHOWN if fields[n] is not None] if show == "all" else [show]
    rows = [touch] if truth is None else [touch, truth]
    if truth is not None:
        names = [n for n in names if n != "std"]
    count = len(names) * len(rows)
    wide = 5.6 if count == 1 else 4.2 if count == 2 else 3.8
    figure = Figure(figsize=(wide * count, 0.86 * wide + 0.6), layout="constrained")
    panels: list[list[Axes]] = [list(p) for p in figure.subplots(1, count, squeeze=False).reshape(len(names), -1)]
    for name, beside in zip(names, panels):
        found = fields[name]
        top = max(float(np.nanmax(np.abs(found), initial=0.0)) if found is not None else 0.0, 0.0) or 1.0
        unit = scaled(top, "Pa")[1]
        for axes, one, label in zip(beside, rows, ("found", "true")):
            field = fields[name] if one is touch else _field(one, name)
            drawn = _panel(axes, one, np.zeros(one.surface.shape) if field is None else field, picture, view, name, top)
            said = f"{label}, {name}" if truth is not None else {"std": "standard deviation"}.get(name, name)
            axes.set_title(f"{said}: {_force(one)}" if name == names[0] else said, fontsize=9)
        label = "standard deviation" if name == "std" else name
        figure.colorbar(drawn, ax=beside, label=f"{label} [{unit}]", shrink=0.8, location="bottom", aspect=30)
    said = "arrows x and y: the axes of the numbers; z points into the pad"
    figure.suptitle(said if title is None else f"{title}\n{said}", fontsize=8)
    return figure


def _force(touch: Shown) -> str:
    force = np.asarray(touch.force, dtype=np.float64)
    names = list(touch.surface.components)
    sides = [float(force[names.index(c)]) if c in touch.components else 0.0 for c in ("x", "y")]
    across = math.hypot(*sides)
    if "z" not in touch.components:
        return f"across {across:.2f} N"
    return f"{force[names.index('z')]:.2f} N, across {across:.2f} N"


def _field(touch: Shown, name: str, known: npt.ArrayLike | None = None) -> Floats | None:
    values = np.nan_to_num(to_numpy(touch.values).astype(np.float64))
    if name == "pressure":
        return values[2] if "z" in touch.components else None
    if name == "shear":
        return np.asarray(np.hypot(values[0], values[1])) if {"x", "y"} & set(touch.components) else None
    if known is None and not touch.has_intervals:
        return None
    std = np.asarray(to_numpy(touch.std()) if known is None else known, dtype=np.float64)
    if not np.isfinite(std).any():
        return None
    sought = [touch.surface.components.index(c) for c in touch.components]
    return np.asarray(np.sqrt(np.nansum(std[sought] ** 2, axis=0)))


def _panel(
    axes: Axes, touch: Shown, field: Floats, picture: npt.NDArray[Any], view: Lies, name: str, top: float
) -> Any:
    """Draw the field in colour at the resolution of the picture, more opaque where it is stronger; draw shear as
    arrows.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    axes.imshow(picture, cmap="gray")
    factor, _ = scaled(top, "Pa")
    pull = name == "pressure" and float(field.min(initial=0.0)) < -FAINT * top
    scale = ScalarMappable(Normalize(-top * factor if pull else 0.0, top * factor), "RdBu_r" if pull else SHOWN[name])
    smooth, edges = _smooth(touch, field, picture.shape, view)
    part = np.clip(np.abs(smooth) / top, 0.0, 1.0)
    colours = scale.to_rgba(smooth * factor)
    colours[..., 3] = OPAQUE * np.sqrt(np.clip((part - FAINT) / (1.0 - FAINT), 0.0, None))
    axes.imshow(colours, extent=edges, interpolation="bilinear", label=name)
    values = np.nan_to_num(to_numpy(touch.values).astype(np.float64))
    shear = np.hypot(values[0], values[1])
    strongest = float(shear.max(initial=0.0))
    pressed = float(np.abs(values[2]).max(initial=0.0))
    if name != "std" and strongest > 0.02 * pressed and strongest > 0:
        starts, arrows = _arrows(touch, values[:2], picture.shape, view)
        axes.quiver(
            *starts.T,
            *arrows.T,
            angles="xy",
            scale_units="xy",
            scale=1,
            color="white",
            edgecolor="black",
            pivot="mid",
            linewidth=0.6,
            width=0.0065,
            minshaft=1.5,
            headwidth=3.4,
            headlength=3.6,
            headaxislength=3.2,
        )
    height, width = picture.shape[:2]
    _axes_of_the_numbers(axes, view, (width, height), float(np.ptp(touch.surface.x)))
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_xlabel("column [pixel]")
    axes.set_ylabel("row [pixel]")
    return scale


def _at(touch: Shown, fields: Floats, places: Floats, order: int) -> Floats:
    """Interpolate fields (..., y, x) at places (..., 2) [m]; 0 beyond the surface."""
    from scipy.ndimage import map_coordinates

    (y, x), (dy, dx) = touch.surface.axes, touch.surface.spacings
    at = np.stack([(places[..., 1] - y[0]) / dy, (places[..., 0] - x[0]) / dx])
    return np.asarray(map_coordinates(fields, at, order=order, mode="constant"))


def _smooth(
    touch: Shown, field: Floats, shape: tuple[int, ...], view: Lies
) -> tuple[Floats, tuple[float, float, float, float]]:
    """Return a field (y, x) at the pixels of a picture (at every n-th pixel of a large one) by cubic splines limited
    to the range of its values, and its edges.
    """
    step = max(1, max(shape[:2]) // FINEST)
    rows, columns = (np.arange(0, n, step) + 0.5 * (step - 1) for n in shape[:2])
    values = _at(touch, field, view.places(np.stack(np.meshgrid(columns, rows), axis=-1)), 3)
    half = 0.5 * step
    edges = (columns[0] - half, columns[-1] + half, rows[-1] + half, rows[0] - half)
    return np.clip(values, min(field.min(), 0.0), max(field.max(), 0.0)), edges


def _arrows(touch: Shown, shear: Floats, shape: tuple[int, ...], view: Lies) -> tuple[Floats, Floats]:
    """Return middles (n, 2) and arrows (n, 2) [px] of shear (2, y, x): strongest first, none longer than the distance
    to the next.
    """
    apart = max(shape[:2]) / ARROWS
    fine = apart / 3.0
    rows, columns = (np.arange(0.5 * min(fine, n - 1), n, fine) for n in shape[:2])
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
    places = view.places(pixels)
    found = np.stack([_at(touch, part, places, 1) for part in shear], axis=-1)
    size = np.hypot(found[..., 0], found[..., 1])
    strongest = max(float(size.max(initial=0.0)), 1e-300)
    # transform arrows by the view too: a picture may be tilted, and its rows count downwards
    small = 1e-3 * float(np.ptp(touch.surface.x))
    arrows = view.pixels(places + small * found / strongest) - pixels
    arrows *= 0.95 * apart / max(float(np.hypot(*np.moveaxis(arrows, -1, 0)).max()), 1e-300)
    pick = arrow_cells(size, (3, 3), 0.12 * strongest)
    return pixels[pick], arrows[pick]


def _axes_of_the_numbers(axes: Axes, view: Lies, size: tuple[int, int], extent: float) -> None:
    """Draw x and y as arrows in a corner, and write their length."""
    from matplotlib.patheffects import withStroke

    length = nice(0.15 * extent)
    here = view.pixels(np.array([[0.0, 0.0], [length, 0.0], [0.0, length]]))
    arms = here[1:] - here[0]
    rim = 0.04 * min(size)
    # choose the corner so that both arrows and their letters lie inside
    column = 2.2 * rim - min(0.0, float(arms[:, 0].min()))
    row = size[1] - 1 - 3.4 * rim - max(0.0, float(arms[:, 1].max()))
    outline = [withStroke(linewidth=2.5, foreground="black")]
    for arm, name in zip(arms, "xy"):
        axes.annotate(
            "",
            xy=(column + arm[0], row + arm[1]),
            xytext=(column, row),
            arrowprops={"arrowstyle": "->", "color": "white", "lw": 1.4, "path_effects": outline, "shrinkA": 0},
        )
        tip = arm * (1.0 + 1.2 * rim / max(float(np.hypot(*arm)), 1e-9))
        axes.text(
            column + tip[0],
            row + tip[1],
            name,
            color="white",
            ha="center",
            va="center",
            fontsize=9,
            path_effects=outline,
        )
    factor, unit = scaled(length, "m")
    axes.text(
        column,
        row + max(0.0, float(arms[:, 1].max())) + 1.8 * rim,
        f"{length * factor:g} {unit}",
        color="white",
        fontsize=7,
        va="center",
        path_effects=outline,
    )
