"""A result laid over its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from palpate._plot import plot_over
from palpate.camera.view import View
from palpate.touch import Touch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["overlay"]


def overlay(
    image: npt.NDArray[Any],
    touch: Touch,
    view: View,
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
    touch : Touch
        Of this picture: one frame.
    view : View
        Where the picture lies.
    show : str
        "pressure" (default), "shear", "std", or "all": one panel each.
    truth : Touch, optional
        A known one, drawn beside.

    Raises
    ------
    InvalidInput
        Several frames, a line, a picture that is none, or what the touch does not hold.

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
    return plot_over(touch, image, view, show=show, title=title, truth=truth)
