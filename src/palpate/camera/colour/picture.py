"""Pictures of a relief, and of a calibration with a ball."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate.camera.colour.model import Relief, SlopeModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_colours", "draw_relief"]

#: Characters per line of the text.
WIDE = 120


def draw_relief(image: npt.NDArray[Any], relief: Relief) -> Figure:
    """The picture, its slopes along x and y, the depth and its standard deviation, side by side.

    Examples
    --------
    >>> from palpate.camera import draw_relief
    >>> # draw_relief(picture, model.relief(picture)).savefig("relief.png")
    """
    from palpate._plot.style import PAGE, journal

    with journal():
        figure = _figure((PAGE, 2.1))
        axes = figure.subplots(1, 5)
        reach = [1e3 * f(relief.places[i]) for i in (0, 1) for f in (np.min, np.max)]
        steep = max(float(np.abs(relief.slopes).max()), 1e-3)
        panels: list[tuple[str, Any, dict[str, Any]]] = [
            ("picture", np.asarray(image)[..., :3], {}),
            ("slope along x", relief.slopes[0], {"vmin": -steep, "vmax": steep, "cmap": "RdBu"}),
            ("slope along y", relief.slopes[1], {"vmin": -steep, "vmax": steep, "cmap": "RdBu"}),
            ("depth [um]", 1e6 * relief.depth, {"cmap": "viridis", "vmin": 0.0}),
            ("its std [um]", 1e6 * relief.std, {"cmap": "viridis", "vmin": 0.0}),
        ]
        for ax, (title, values, options) in zip(axes, panels):
            drawn = ax.imshow(values, extent=reach, **options)
            ax.set_title(title, fontsize=7)
            ax.tick_params(labelsize=5)
            if values.ndim == 2:
                figure.colorbar(drawn, ax=ax, orientation="horizontal", pad=0.18).ax.tick_params(labelsize=5)
        axes[0].set_xlabel("x [mm]", fontsize=6)
        axes[0].set_ylabel("y [mm]", fontsize=6)
        figure.subplots_adjust(left=0.07, right=0.99, top=0.92, bottom=0.12, wspace=0.3)
        return figure


def draw_colours(model: SlopeModel) -> Figure:
    """Draw the gel at rest, the change of colour with slope in its middle, and the cross-validation error of each press.

    Examples
    --------
    >>> from palpate.camera import draw_colours
    >>> # draw_colours(learn_slopes("presses/", view, ball_diameter=8e-3)).savefig("colours.png")
    """
    from palpate._plot.style import INK, PAGE, journal

    with journal():
        figure = _figure((PAGE, 2.8))
        rest, wheel, bars = figure.subplots(1, 3)
        rest.imshow(np.clip(model.rest, 0.0, 1.0))
        rest.set_title("gel at rest", fontsize=7)
        rest.set_axis_off()
        side = np.linspace(-1.0, 1.0, 81) * model.response.steepest
        gx, gy = np.meshgrid(side, side[::-1])
        rows, columns = model.rest.shape[:2]
        base = model.bases[(rows // 2) * columns + columns // 2]
        change = model.response.change(
            np.stack([gx.ravel(), gy.ravel()], axis=-1), np.broadcast_to(base, (gx.size, len(base)))
        )
        colours = model.rest[rows // 2, columns // 2] * (1.0 + change.reshape(*gx.shape, 3))
        colours[np.hypot(gx, gy) > model.response.steepest] = 1.0
        ends = [side[0], side[-1]]
        wheel.imshow(np.clip(colours, 0.0, 1.0), extent=[*ends, *ends])
        wheel.set_title("colour of slopes, in the middle", fontsize=7)
        wheel.set_xlabel("du_z/dx", fontsize=6)
        wheel.set_ylabel("du_z/dy", fontsize=6)
        names = [row[0].replace("picture ", "") for row in model.table]
        bars.bar(names, [100.0 * (row[2] - 1.0) for row in model.table], color=INK["z"])
        bars.axhline(0.0, color="0.4", linewidth=0.6)
        bars.set_title("slopes of a press that was left out", fontsize=7)
        bars.set_xlabel("picture", fontsize=6)
        bars.set_ylabel("off by [%]", fontsize=6)
        words = "\n".join(line for s in str(model).splitlines() for line in textwrap.wrap(s, WIDE))
        figure.subplots_adjust(left=0.02, right=0.98, top=0.92, bottom=0.35, wspace=0.35)
        figure.text(0.03, 0.2, words, fontsize=6, va="top")
        return figure


def _figure(size: tuple[float, float]) -> Figure:
    from palpate._extras import missing

    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise missing("pictures", error) from error
    return Figure(figsize=size)
