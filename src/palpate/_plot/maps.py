"""Plot pressure and shear on the surface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from palpate._arrays import to_numpy
from palpate._extras import require
from palpate._plot.arrows import arrow_cells
from palpate._plot.over import plot_over
from palpate._plot.shown import Shown
from palpate._plot.space import draw_in_space, draw_taxels
from palpate._plot.style import COLUMN, INK, PAGE, journal, nice, scaled
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["plot_touch"]

#: Arrows are drawn down to this fraction of the largest.
WEAK = 0.12
#: Largest number of arrows across a panel.
ACROSS = 15
#: A map shows both signs if the pull exceeds this fraction of the largest pressure.
PULL = 0.02
#: The axes of a map for each view: z points into the pad, and x, y, z are right-handed.
VIEWS = {
    "inside": "seen from inside the pad (z towards the viewer)",
    "outside": "seen from outside (z away from the viewer)",
}


def plot_touch(
    touch: Shown,
    *,
    frame: int = 0,
    truth: Any = None,
    title: str | None = None,
    ax: Axes | None = None,
    seen_from: str = "inside",
    picture: Any = None,
    taxels: Sequence[Array] = (),
) -> Figure:
    """Plot one frame; see `Touch.plot`."""
    require("figures", "matplotlib")
    one = touch.frame(frame)
    if picture is not None:
        if truth is not None or ax is not None or seen_from != "inside" or len(taxels):
            raise InvalidInput(
                "over a picture there is neither truth, ax, seen_from nor taxels: leave them out (palpate.camera.overlay draws a truth beside)."
            )
        if not isinstance(picture, tuple):
            picture = (picture, one.view)
        if not (len(picture) == 2 and hasattr(picture[1], "pixels")):
            raise InvalidInput(
                "picture must be (image, view): the picture and where it lies, a palpate.camera.View; the image alone where the touch knows its view."
            )
        return plot_over(one, picture[0], picture[1], title=title)
    values = to_numpy(one.values).astype(np.float64)
    true = None if truth is None else to_numpy(truth).astype(np.float64)
    if true is not None and true.shape != values.shape:
        raise InvalidInput(f"truth must have shape {values.shape} like one frame of the touch; got {true.shape}.")
    if seen_from not in VIEWS:
        raise InvalidInput(f"seen_from must be {' or '.join(VIEWS)}; got {seen_from!r}.")
    if ax is not None and true is not None:
        raise InvalidInput("truth is drawn in panels of its own, which one ax cannot hold: leave out either.")
    with journal():
        if one.surface.dimensions == 1:
            figure = _plot_line(one, values, true, title, ax)
            for array in taxels:
                x = array.points[:, 0] * scaled(float(np.ptp(one.surface.x)), "m")[0]
                (ax or figure.axes[0]).plot(x, 0.0 * x, ls="none", marker="o", ms=1.6, mfc="white", mec="0.2", mew=0.4)
            return figure
        if ax is not None:
            figure = _plot_into(one, values, title, ax, seen_from)
            draw_taxels(ax, taxels, _width(one)[0])
            return figure
        return _plot_area(one, values, true, title, seen_from, taxels)


def _std(touch: Shown) -> Floats | None:
    """Standard deviation of the traction, if available."""
    if not touch.has_intervals:
        return None
    std = np.asarray(to_numpy(touch.std()), dtype=np.float64)
    return std if np.isfinite(std).any() else None


# -- lines -------------------------------------------------------------------------------------------------------------


def _plot_line(touch: Shown, values: Floats, true: Floats | None, title: str | None, ax: Axes | None) -> Figure:
    from matplotlib.figure import Figure

    factor, unit = scaled(float(np.nanmax(np.abs(values), initial=0.0)) or 1.0, "Pa")
    width, width_unit = scaled(float(np.ptp(touch.surface.x)), "m")
    if ax is None:
        axes = Figure(figsize=(COLUMN, 2.4), layout="constrained").subplots()
    else:
        axes = ax
    x = touch.surface.x * width
    bounds = touch.interval(0.95) if _std(touch) is not None else None
    for name, row in (("pressure", 1), ("shear", 0)):
        if touch.surface.components[row] not in touch.components:
            continue
        if bounds is not None:
            low, high = (np.asarray(to_numpy(b))[row] * factor for b in bounds)
            axes.fill_between(x, low, high, color=INK[name], alpha=0.22, linewidth=0, label=f"{name}, 95 %")
        if true is not None:
            axes.plot(x, true[row] * factor, color=INK["truth"], lw=0.9, ls="--" if row else ":", label=f"{name}, true")
        axes.plot(x, values[row] * factor, color=INK[name], label=f"{name}, recovered" if true is not None else name)
    axes.axhline(0.0, color="0.75", lw=0.5, zorder=0)
    axes.set_xlabel(f"x [{width_unit}]")
    axes.set_ylabel(f"traction [{unit}]")
    axes.margins(x=0)
    axes.legend(frameon=False, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderpad=0.1)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure = cast("Figure", axes.figure)
    if title and ax is None:
        figure.suptitle(title)
    elif title:
        axes.set_title(title, pad=40.0)
    return figure


# -- areas -------------------------------------------------------------------------------------------------------------


def _plot_area(
    touch: Shown,
    values: Floats,
    true: Floats | None,
    title: str | None,
    seen_from: str,
    taxels: Sequence[Array],
) -> Figure:
    """Draw panels of pressure, shear and uncertainty. With a truth, add a second row of panels, which shows the error
    instead of the uncertainty.
    """
    from matplotlib.figure import Figure

    pressure, sheared = "z" in touch.components, bool({"x", "y"} & set(touch.components))
    std = _std(touch)
    rows = [values] if true is None else [values, true]
    columns = [*(["pressure"] if pressure else []), *(["shear"] if sheared else [])]
    columns += ["error"] if std is not None or true is not None else []
    columns += ["space"] if touch.surface.bends and pressure else []
    lengths = [float(np.ptp(a)) + s for a, s in zip(touch.surface.axes, touch.surface.spacings)]
    tall = min(max(lengths[0] / lengths[1], 0.3), 2.0)
    across = PAGE / 3 if len(columns) > 1 else COLUMN
    figure = Figure(
        figsize=(across * len(columns), (0.78 * across * tall + 0.85) * len(rows) + 0.3), layout="constrained"
    )
    grid = figure.subplots(len(rows), len(columns), squeeze=False)
    largest = {"pressure": _top(*(r[2] for r in rows)), "shear": _top(*(np.hypot(r[0], r[1]) for r in rows))}
    missed = np.zeros(touch.surface.shape) if true is None else _misses(touch, values - true)
    largest["error"] = _top(missed, *([] if std is None else [_misses(touch, std)]))
    names = [""] if true is None else ["recovered: ", "true: "]
    for i, (row, name) in enumerate(zip(rows, names)):
        for axes, what in zip(grid[i], columns):
            if what == "pressure":
                _pressure(axes, touch, row[2], f"{name}pressure", largest["pressure"], rows, seen_from)
            elif what == "shear":
                _shear(axes, touch, row, f"{name}shear", largest["shear"], seen_from)
            elif what == "space":
                grid[i, -1] = axes = _in_space(figure, axes)
                force = touch.force if i == 0 else touch.surface.total_force(row)
                draw_in_space(axes, touch, row, force, largest["pressure"], taxels)
                continue
            elif i == 1 and true is not None:
                _size(axes, touch, missed, "recovered less true, size", largest["error"], seen_from)
            elif std is not None:
                _size(axes, touch, _misses(touch, std), "standard deviation", largest["error"], seen_from)
            else:
                axes.set_axis_off()
                continue
            draw_taxels(axes, taxels, _width(touch)[0])
    said = [title] if title else []
    figure.suptitle("\n".join([*said, VIEWS[seen_from]]), fontsize=8 if said else 7)
    return figure


def _in_space(figure: Figure, axes: Axes) -> Any:
    """Replace flat axes by axes in three dimensions."""
    place = axes.get_subplotspec()
    axes.remove()
    return figure.add_subplot(place, projection="3d", computed_zorder=False)


def _width(touch: Shown) -> tuple[float, str]:
    """Return factor and unit of lengths in a map."""
    return scaled(max(float(np.ptp(a)) for a in touch.surface.axes), "m")


def _plot_into(touch: Shown, values: Floats, title: str | None, ax: Axes, seen_from: str) -> Figure:
    """Draw one panel into the user's figure: pressure in colour and shear as arrows."""
    if "z" in touch.components:
        _pressure(ax, touch, values[2], title or "pressure", _top(values[2]), [values], seen_from)
        if {"x", "y"} & set(touch.components):
            _arrows(ax, touch, values, _top(np.hypot(values[0], values[1])), "#222222")
    else:
        _shear(ax, touch, values, title or "shear", _top(np.hypot(values[0], values[1])), seen_from)
    return cast("Figure", ax.figure)


def _top(*images: Floats) -> float:
    return max(float(np.nanmax(np.abs(i), initial=0.0)) for i in images) or 1.0


def _misses(touch: Shown, field: Floats) -> Floats:
    """Return the magnitude (*surface) of ``field`` (component, *surface), an error or a standard deviation [Pa], from
    the components that were estimated.
    """
    sought = [touch.surface.components.index(c) for c in touch.components]
    return np.asarray(np.sqrt((field[sought] ** 2).sum(axis=0)))


def _show(
    axes: Axes, touch: Shown, image: Floats, cmap: str, low: float, high: float, label: str, seen_from: str, title: str
) -> None:
    width, width_unit = _width(touch)
    (y, x), (dy, dx) = touch.surface.axes, touch.surface.spacings
    image = np.where(touch.surface.areas > 0.0, image, np.nan)
    left, right, bottom, top = (
        float(v * width) for v in (x[0] - dx / 2, x[-1] + dx / 2, y[0] - dy / 2, y[-1] + dy / 2)
    )
    drawn = axes.imshow(
        image,
        extent=(left, right, bottom, top),
        origin="lower",
        cmap=cmap,
        vmin=low,
        vmax=high,
        interpolation="nearest",
        rasterized=True,
    )
    if seen_from == "outside":
        axes.invert_yaxis()
    axes.set_title(title, loc="left")
    along = " along the surface" if touch.surface.bends else ""
    axes.set_xlabel(f"x{along} [{width_unit}]")
    axes.set_ylabel(f"y{along} [{width_unit}]")
    axes.figure.colorbar(drawn, ax=axes, label=label, location="bottom", aspect=30, pad=0.02)


def _pressure(
    axes: Axes, touch: Shown, image: Floats, title: str, largest: float, rows: list[Floats], seen_from: str
) -> None:
    factor, unit = scaled(largest, "Pa")
    # use two colours only if the map contains pull as well as push
    both = min(float(np.nanmin(r[2], initial=0.0)) for r in rows) < -PULL * largest
    _show(
        axes,
        touch,
        image * factor,
        "RdBu_r" if both else "viridis",
        -largest * factor if both else 0.0,
        largest * factor,
        f"pressure [{unit}]",
        seen_from,
        title,
    )


def _size(axes: Axes, touch: Shown, image: Floats, title: str, top: float, seen_from: str) -> None:
    factor, unit = scaled(top, "Pa")
    _show(axes, touch, image * factor, "magma", 0.0, top * factor, f"traction [{unit}]", seen_from, title)


def _shear(axes: Axes, touch: Shown, values: Floats, title: str, largest: float, seen_from: str) -> None:
    factor, unit = scaled(largest, "Pa")
    size = np.hypot(values[0], values[1])
    _show(axes, touch, size * factor, "cividis", 0.0, largest * factor, f"shear [{unit}]", seen_from, title)
    _arrows(axes, touch, values, largest, "white")


def _arrows(axes: Axes, touch: Shown, values: Floats, largest: float, colour: str) -> None:
    """Draw arrows on the strongest cells first, and a scale arrow."""
    from matplotlib.patheffects import withStroke

    size = np.nan_to_num(np.hypot(values[0], values[1]))
    if not size.any():
        return
    width, _ = _width(touch)
    (y, x), (dy, dx) = touch.surface.axes, touch.surface.spacings
    apart = max(float(np.ptp(x)), float(np.ptp(y))) / ACROSS
    std = _std(touch)
    # draw no arrows for insignificant shear
    doubt = 0.0 if std is None else 1.96 * np.hypot(std[0], std[1]) / np.sqrt(2.0)
    i, j = arrow_cells(size, (apart / dy, apart / dx), np.maximum(WEAK * largest, doubt))
    arrows = axes.quiver(
        x[j] * width,
        y[i] * width,
        values[0][i, j],
        values[1][i, j],
        color=colour,
        angles="xy",
        scale_units="xy",
        scale=largest / (1.6 * apart * width),
        width=0.008,
        pivot="mid",
    )
    arrows.set_path_effects([withStroke(linewidth=1.2, foreground="white" if colour != "white" else "0.2")])
    key = nice(largest)
    factor, unit = scaled(key, "Pa")
    axes.quiverkey(
        arrows,
        1.0 - 1.6 * apart / float(np.ptp(x)) * key / largest,
        1.035,
        key,
        f"{key * factor:g} {unit}",
        labelpos="W",
        coordinates="axes",
        color="0.2",
        labelsep=0.03,
        fontproperties={"size": 7},
    )
