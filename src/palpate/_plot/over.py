"""A result laid over the picture that it was found in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._extras import require
from palpate._plot.maps import arrow_cells
from palpate._plot.style import INK, nice, scaled
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from palpate.touch import Touch

__all__ = ["Lies", "plot_over"]

#: What a panel shows, and its colours.
SHOWN = {"pressure": "inferno", "shear": "cividis", "std": "magma"}
#: Below this part of the largest nothing is drawn, and the picture shows.
FAINT = 0.03


class Lies(Protocol):
    """Where a picture lies: a `palpate.camera.View`."""

    def pixels(self, places: npt.ArrayLike) -> Floats:
        """Pixels (column, row) of places (x, y) [m]."""
        ...


def plot_over(
    touch: Touch,
    image: npt.ArrayLike,
    view: Lies,
    *,
    show: str = "all",
    truth: Touch | None = None,
    title: str | None = None,
    std: npt.ArrayLike | None = None,
) -> Figure:
    """A figure of one frame over its picture; see `palpate.camera.overlay`. ``std`` (component, y, x): of a touch without error bars of its own."""
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    if touch.batch or touch.surface.dimensions != 2:
        raise InvalidInput("overlay draws one frame of an area: pick one, touch[i].")
    picture = np.asarray(image)
    if picture.ndim not in (2, 3) or (picture.ndim == 3 and picture.shape[2] not in (3, 4)):
        raise InvalidInput(
            f"a picture must be (row, column) or (row, column, 3); got the shape {picture.shape}. Of several, give the one of this frame."
        )
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
        top = max(float(np.nanmax(np.abs(found), initial=0.0)) if found is not None else 0.0, 1e-12)
        unit = scaled(top, "Pa")[1]
        for axes, one, label in zip(beside, rows, ("found", "true")):
            field = fields[name] if one is touch else _field(one, name)
            drawn = _panel(axes, one, np.zeros(one.surface.shape) if field is None else field, picture, view, name, top)
            said = f"{label}, {name}" if truth is not None else {"std": "standard deviation"}.get(name, name)
            axes.set_title(f"{said}: {_force(one)}" if name == names[0] else said, fontsize=9)
        label = "standard deviation" if name == "std" else name
        bar = figure.colorbar(drawn, ax=beside, label=f"{label} [{unit}]", shrink=0.8, location="bottom", aspect=30)
        if bar.solids is not None:
            bar.solids.set(alpha=1.0)
    said = "arrows x and y: the axes of the numbers; z points into the pad"
    figure.suptitle(said if title is None else f"{title}\n{said}", fontsize=8)
    return figure


def _force(touch: Touch) -> str:
    force = np.asarray(touch.force, dtype=np.float64)
    names = list(touch.surface.components)
    sides = [float(force[names.index(c)]) if c in touch.components else 0.0 for c in ("x", "y")]
    across = math.hypot(*sides)
    if "z" not in touch.components:
        return f"across {across:.2f} N"
    return f"{force[names.index('z')]:.2f} N, across {across:.2f} N"


def _field(touch: Touch, name: str, known: npt.ArrayLike | None = None) -> Floats | None:
    values = np.nan_to_num(to_numpy(touch.values).astype(np.float64))
    if name == "pressure":
        return values[2] if "z" in touch.components else None
    if name == "shear":
        return np.asarray(np.hypot(values[0], values[1])) if {"x", "y"} & set(touch.components) else None
    if known is None and touch.errors is None:
        return None
    std = np.asarray(touch.std.values if known is None else known, dtype=np.float64)
    if not np.isfinite(std).any():
        return None
    sought = [touch.surface.components.index(c) for c in touch.components]
    return np.asarray(np.sqrt(np.nansum(std[sought] ** 2, axis=0)))


def _panel(
    axes: Axes, touch: Touch, field: Floats, picture: npt.NDArray[Any], view: Lies, name: str, top: float
) -> Any:
    """The field in colour through the view, in the picture's own pixels; shear as arrows."""
    axes.imshow(picture, cmap="gray")
    y, x = touch.surface.axes
    dy, dx = touch.surface.spacings
    corners = np.stack(
        np.meshgrid(np.append(x - dx / 2, x[-1] + dx / 2), np.append(y - dy / 2, y[-1] + dy / 2)), axis=-1
    )
    at = view.pixels(corners)
    factor, _ = scaled(top, "Pa")
    pull = name == "pressure" and float(field.min(initial=0.0)) < -FAINT * top
    drawn = axes.pcolormesh(
        at[..., 0],
        at[..., 1],
        np.ma.masked_where(np.abs(field) < FAINT * top, field) * factor,
        shading="flat",
        edgecolors="none",
        linewidth=0,
        rasterized=True,
        cmap="RdBu_r" if pull else SHOWN[name],
        alpha=0.55,
        vmin=-top * factor if pull else 0.0,
        vmax=top * factor,
    )
    values = np.nan_to_num(to_numpy(touch.values).astype(np.float64))
    shear = np.hypot(values[0], values[1])
    strongest = float(shear.max(initial=0.0))
    pressed = float(np.abs(values[2]).max(initial=0.0))
    if name != "std" and strongest > 0.02 * pressed and strongest > 0:
        # tips through the view too: a picture may be tilted, and its rows go down
        places = np.stack(np.meshgrid(x, y), axis=-1)
        starts = view.pixels(places)
        tips = view.pixels(places + 0.12 * float(np.ptp(x)) / strongest * np.moveaxis(values[:2], 0, -1))
        step = max(1, round(len(x) / 24))
        pick = arrow_cells(shear, (step, step), 0.1 * strongest)
        axes.quiver(
            *starts[pick].T,
            *(tips - starts)[pick].T,
            angles="xy",
            scale_units="xy",
            scale=1,
            color=INK["shear"] if name == "pressure" else "white",
            width=0.005,
        )
    height, width = picture.shape[:2]
    _axes_of_the_numbers(axes, view, (width, height), float(np.ptp(x)))
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_xlabel("column [pixel]")
    axes.set_ylabel("row [pixel]")
    return drawn


def _axes_of_the_numbers(axes: Axes, view: Lies, size: tuple[int, int], extent: float) -> None:
    """x and y as arrows in a corner, of a length that is said."""
    from matplotlib.patheffects import withStroke

    length = nice(0.15 * extent)
    here = view.pixels(np.array([[0.0, 0.0], [length, 0.0], [0.0, length]]))
    arms = here[1:] - here[0]
    rim = 0.04 * min(size)
    # so that both arrows and their letters lie inside
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
