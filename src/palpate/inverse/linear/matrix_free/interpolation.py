"""Interpolate a function of one variable, such as log lambda, from its values and slopes at a few places."""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats

__all__ = ["between"]

#: Distance (in the unit of the places) beyond the outermost place over which the slope is continued.
REACH = 1.5


def between(x: Floats, places: Floats, values: Floats, slopes: Floats) -> Floats:
    """Values at ``x`` of a curve with the given ``values`` and ``slopes`` at ``places`` (in any order), by cubic
    Hermite interpolation. Beyond the outermost places the curve continues linearly for `REACH` and is then constant.
    """
    places, kept = np.unique(places, return_index=True)
    values, slopes = values[kept], slopes[kept]
    low, high = x < places[0], x > places[-1]
    out = np.full(np.shape(x), values[0])
    out = np.where(low, values[0] - slopes[0] * np.minimum(places[0] - x, REACH), out)
    out = np.where(high, values[-1] + slopes[-1] * np.minimum(x - places[-1], REACH), out)
    if len(places) > 1:
        from scipy.interpolate import CubicHermiteSpline

        inner = ~(low | high)
        out[inner] = CubicHermiteSpline(places, values, slopes)(x[inner])
    return np.asarray(out)
