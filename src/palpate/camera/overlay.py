"""A result laid over its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._extras import require
from palpate._plot import INK, arrow_cells, scaled
from palpate.camera.view import View
from palpate.errors import InvalidInput
from palpate.touch import Touch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["overlay"]


def overlay(
    image: npt.NDArray[Any], touch: Touch, view: View, *, title: str | None = None, truth: Any = None
) -> Figure:
    """Pressure in colour and shear as arrows over the picture, in its own pixels.

    Parameters
    ----------
    image : array (row, column) or (row, column, 3)
    touch : Touch
        Of this picture: one frame.
    view : View
        Where the picture lies.
    truth : Touch, optional
        A known one, drawn beside.

    Raises
    ------
    InvalidInput
        Several frames, or a line.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.camera import View, overlay
    >>> grid = pp.AreaGrid(shape=(6, 8), spacing=1e-3)
    >>> touch = pp.Touch(np.ones((3, 6, 8)), grid, ("x", "y", "z"), "automatic")
    >>> figure = overlay(np.zeros((120, 160)), touch, View.scaled(0.1e-3, size=(160, 120)))
    >>> figure.savefig("touch.png")  # doctest: +SKIP
    """
    require("figures", "matplotlib")
    from matplotlib.figure import Figure

    shown = [touch] if truth is None else [touch, truth]
    if touch.batch or touch.surface.dimensions != 2:
        raise InvalidInput("overlay draws one frame of an area: pick one, touch[i].")
    values = [np.nan_to_num(to_numpy(one.values).astype(np.float64)) for one in shown]
    peak = max(float(np.abs(values[0][2]).max()), 1e-12)
    factor, unit = scaled(peak, "Pa")
    figure = Figure(figsize=(5.6 * len(shown), 4.8), layout="constrained")
    for axes, one, traction, name in zip(
        np.atleast_1d(figure.subplots(1, len(shown))), shown, values, ("found", "true")
    ):
        axes.imshow(np.asarray(image), cmap="gray")
        y, x = one.surface.axes
        places = np.stack(np.meshgrid(x, y), axis=-1)
        pixels = view.pixels(places)
        pressure = np.ma.masked_less(traction[2] * factor, 0.03 * peak * factor)
        map_ = axes.pcolormesh(
            pixels[..., 0],
            pixels[..., 1],
            pressure,
            shading="nearest",
            edgecolors="none",
            linewidth=0,
            rasterized=True,
            cmap="inferno",
            alpha=0.55,
            vmin=0,
            vmax=peak * factor,
        )
        shear = np.hypot(traction[0], traction[1])
        strong = shear > 0.1 * max(float(shear.max()), 1e-12)
        if float(shear.max()) > 0.02 * peak and strong.any():
            # tips through the view too: a picture may be tilted, and its rows go down
            length = 0.12 * float(np.ptp(x)) / float(shear.max())
            tips = view.pixels(places + length * np.moveaxis(traction[:2], 0, -1))
            step = max(1, round(len(x) / 24))
            pick = arrow_cells(shear, (step, step), 0.1 * float(shear.max()))
            axes.quiver(
                *pixels[pick].T,
                *(tips - pixels)[pick].T,
                angles="xy",
                scale_units="xy",
                scale=1,
                color=INK["shear"],
                width=0.004,
            )
        force = np.asarray(one.force, dtype=np.float64)
        axes.set_title(
            (f"{name}: " if truth is not None else "") + f"force {force[2]:.2f} N, across {np.hypot(*force[:2]):.2f} N",
            fontsize=10,
        )
        axes.set_xlim(-0.5, image.shape[1] - 0.5)
        axes.set_ylim(image.shape[0] - 0.5, -0.5)
        axes.set_xlabel("column [pixel]")
        axes.set_ylabel("row [pixel]")
    figure.colorbar(map_, ax=figure.axes, label=f"pressure [{unit}]", shrink=0.8)
    if title:
        figure.suptitle(title)
    return figure
