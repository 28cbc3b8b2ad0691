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

#: At most this many surface cells to a taxel pitch; to the typical distance of markers scattered in a pad on a base (dots of cameras, markers of tables): three of these
#: tell a ball's force no better and take twice the time, four six times, and one is too few for a tracker (benchmarks/markers.py).
FINEST, FINEST_MARKERS = 4, 2
#: Markers are moved by what presses up to a thickness past them: with 15 % of the array's width a ball at its corner read 0.82 of its force, now 0.91. No more than
#: this many of the markers' distances, which keeps large fields small.
BEYOND = 2.0
#: Displacement reaches far: the surface extends past the array by this part of the array's width.
FAR = 0.15


#: Contact is sought this many depths past the array, where no surface is given.
WIDE = 4.0


def default_surface(planes: Sequence[Array], *, depths: float = DEPTHS, thickness: float | None = None) -> Grid:
    """Cells no wider than the taxel pitch nor (down to a quarter of the pitch) than the depth, and a margin.

    Detail finer than the depth is damped by more than exp(-2 pi) and cannot be recovered, so finer cells would only
    cost time. A cell's centre lies above each taxel of the first plane. The grid reaches past the arrays by ``depths``
    times the greatest depth and at least one pitch, so that a contact beyond the edge is not pushed inside; where displacement
    is measured, also by 15 % of the array's width, because displacement reaches that far. Where all that is measured is displacement of markers
    scattered in a pad of this ``thickness`` on a base (None: no base), cells are no finer than half the markers' typical distance, and the grid reaches a
    thickness past them, or two of these distances.

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
    absolute = [find_channel(c).kind.absolute for p in planes for c in p.channels]
    far = any(absolute)
    markers = isinstance(first, ScatteredArray) and first.dimensions == 2 and all(absolute) and thickness is not None
    finest = FINEST_MARKERS if markers else FINEST
    if markers:
        depth = first.depth  # a map of the surface beside them needs no other cells
    counts, spacings, centers = [], [], []
    points = [p.points for p in planes]
    for axis in range(first.dimensions):
        low = min(float(p[:, axis].min()) for p in points)
        high = max(float(p[:, axis].max()) for p in points)
        pitch = _pitch(first, axis)
        ratio = 1 if depth == 0 else min(finest, max(1, math.ceil(pitch / depth - 1e-9)))
        spacing = pitch / ratio
        reach = max(depths * max(p.depth for p in planes), pitch, FAR * (high - low) if far else 0.0)
        if markers:
            reach = max(reach, min(thickness or 0.0, BEYOND * pitch))
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
    """Pitch along an axis; of scattered positions, that of a square grid of as many points with their extents: n p^2 = (a + p) (b + p)."""
    if isinstance(array, ScatteredArray):
        extent, n = np.ptp(array.points, axis=0), len(array.points)
        if array.dimensions == 1 or n == 1:
            return float(extent[0]) / max(n - 1, 1)
        half = 0.5 * float(extent.sum()) / (n - 1)
        return half + math.sqrt(half**2 + float(np.prod(extent)) / (n - 1))
    if isinstance(array, LineArray):
        return array.pitch
    return array.grid.spacings[axis]
