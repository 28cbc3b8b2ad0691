"""The surface grid that is used when none is given."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.elastic.channels import find_channel
from palpate.sensing.arrays import Array, LineArray, ScatteredArray
from palpate.sensing.grids import AreaGrid, Grid, LineGrid

__all__ = ["DEPTHS", "default_surface"]

#: The surface reaches past the array by this many times the greatest depth.
DEPTHS = 2.0

#: At most this many surface cells to a taxel pitch.
FINEST = 4
#: Displacement reaches far: the surface extends past the array by this part of the array's width.
FAR = 0.15


#: Contact is sought this many depths past the array, where no surface is given.
WIDE = 4.0


def default_surface(planes: Sequence[Array], *, depths: float = DEPTHS) -> Grid:
    """Cells no wider than the taxel pitch nor (down to a quarter of the pitch) than the depth, and a margin.

    Detail finer than the depth is damped by more than exp(-2 pi) and cannot be recovered, so finer cells would only
    cost time. A cell's centre lies above each taxel of the first plane. The grid reaches past the arrays by ``depths``
    times the greatest depth and at least one pitch, so that a contact beyond the edge is not pushed inside; where displacement
    is measured, also by 15 % of the array's width, because displacement reaches that far.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.sensing import default_surface
    >>> array = pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    >>> default_surface([array])  # two depths more on each side
    LineGrid(count=15, spacing=0.001, center=0.0)
    """
    first = planes[0]
    depth = min(p.depth for p in planes)
    far = any(find_channel(c).kind.absolute for p in planes for c in p.channels)
    counts, spacings, centers = [], [], []
    points = [p.points for p in planes]
    for axis in range(first.dimensions):
        low = min(float(p[:, axis].min()) for p in points)
        high = max(float(p[:, axis].max()) for p in points)
        pitch = _pitch(first, axis)
        ratio = 1 if depth == 0 else min(FINEST, max(1, math.ceil(pitch / depth - 1e-9)))
        spacing = pitch / ratio
        reach = max(depths * max(p.depth for p in planes), pitch, FAR * (high - low) if far else 0.0)
        margin = math.ceil(reach / spacing - 1e-9)
        inside = (high - low) / spacing
        if not isinstance(first, ScatteredArray) and abs(inside - round(inside)) < 1e-6:
            cells = round(inside)
        else:
            cells = math.ceil(inside)
        counts.append(cells + 1 + 2 * margin)
        spacings.append(spacing)
        centers.append(0.5 * (low + high))
    if first.dimensions == 1:
        return LineGrid(count=counts[0], spacing=spacings[0], center=centers[0])
    return AreaGrid(shape=(counts[0], counts[1]), spacing=(spacings[0], spacings[1]), center=(centers[1], centers[0]))


def _pitch(array: Array, axis: int) -> float:
    """Pitch along an axis; of scattered positions, that of a square grid with as many points."""
    if isinstance(array, ScatteredArray):
        extent = np.ptp(array.points, axis=0)
        return float((np.prod(extent) / len(array.points)) ** (1.0 / array.dimensions))
    if isinstance(array, LineArray):
        return array.pitch
    return array.grid.spacings[axis]
