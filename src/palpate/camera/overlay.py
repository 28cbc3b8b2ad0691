"""Draw a result over its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._plot import plot_over
from palpate.errors import InvalidInput
from palpate.recordings.labelled import touch_of, view_of
from palpate.sensing.grids import AreaGrid
from palpate.sensing.view import View
from palpate.touch import Touch

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

__all__ = ["overlay"]


def overlay(
    image: npt.NDArray[Any],
    touch: Touch | xarray.Dataset,
    view: View | None = None,
    *,
    show: str = "pressure",
    title: str | None = None,
    truth: Any = None,
) -> Figure:
    """Pressure, shear or their standard deviation in colour, and shear as arrows, over the picture, in its own pixels.

    Two arrows in a corner show which way x and y of the numbers go, and how long a millimetre or so is.

    Parameters
    ----------
    image : array (row, column) or (row, column, 3)
    touch : Touch or xarray.Dataset
        Touch of this picture: one frame, or a frame from a file, ``read_touch("touch.nc").isel(time=7)``.
    view : View, optional
        Position of the picture; by default that of the touch or the file (`Touch.view`).
    show : str
        "pressure" (default), "shear", "std", or "all": one panel each.
    truth : Touch, optional
        A known one, drawn beside.

    Raises
    ------
    InvalidInput
        Several frames, a line, not a picture, a map that the touch lacks, or no view.

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
    std = None
    if not isinstance(touch, Touch):
        touch, std = _of_file(touch)
    lies = touch.view if view is None else view
    if lies is None:
        raise InvalidInput(
            "nothing says where the picture lies: the touch holds no view, which those of a camera do. Give view, such as View.scaled(0.06e-3, size=(320, 240))."
        )
    return plot_over(touch, image, lies, show=show, title=title, truth=truth, std=std)


def _of_file(dataset: xarray.Dataset) -> tuple[Touch, Any]:
    """One frame of a data set of touches, and the standard deviations that it contains."""
    if "traction" not in dataset or dataset["traction"].dims != ("component", "y", "x"):
        held = dict(dataset["traction"].sizes) if "traction" in dataset else ", ".join(map(str, dataset.variables))
        raise InvalidInput(
            f"overlay draws one frame of an area: pick one of a file of touches, such as read_touch(path).isel(time=0); got {held or 'nothing'}."
        )
    if "surface" in dataset.attrs:
        return touch_of(dataset), None
    y, x = (np.asarray(dataset[name].values, dtype=np.float64) for name in ("y", "x"))
    grid = AreaGrid(
        shape=(len(y), len(x)),
        spacing=(float(np.ptp(y)) / (len(y) - 1), float(np.ptp(x)) / (len(x) - 1)),
        center=(float(x.mean()), float(y.mean())),
    )
    values = dataset["traction"].values.astype(np.float64)
    # components that were not sought are 0 everywhere
    sought = tuple(c for c, field in zip(grid.components, values) if np.any(field != 0)) or grid.components
    std = dataset["std"].values if "std" in dataset else None
    return Touch(values, grid, sought, "recorded", view=view_of(dataset)), std
