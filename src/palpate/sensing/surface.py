"""The default surface grid."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Pad
from palpate.errors import InvalidInput
from palpate.sensing.arrays import Array, LineArray, ScatteredArray
from palpate.sensing.grids import AreaGrid, Grid, LineGrid
from palpate.sensing.maps import body_of

__all__ = ["DEPTHS", "check_above", "check_depth", "check_thickness", "default_surface", "surface_of"]

#: The surface extends past the array by this many times the greatest depth.
DEPTHS = 2.0

#: Largest number of surface cells per taxel pitch; and per typical distance of markers scattered in a pad on a base
#: (camera dots, marker tables). For the latter, three determine a ball's force no better and take twice the time, four
#: six times, and one is too few for a tracker (benchmarks/markers.py).
FINEST, FINEST_MARKERS = 4, 2
#: A press moves markers up to one thickness away, so the margin is one thickness, at most this many marker distances,
#: which keeps large fields small. With a margin of 15 % of the array's width a ball at its corner read 0.82 of its
#: force, now 0.91.
MARKER_MARGIN = 2.0
#: A load changes displacement far away, so for displacement the surface extends past the array by this fraction of the
#: array's width.
DISPLACEMENT_MARGIN = 0.15


#: Smallest thickness of a pad as a fraction of the pitch: at 1e-2 a frame of 6 x 6 x 2 takes 8 s, at 1e-3 minutes.
THINNEST = 3e-3
#: For arrays deeper than DEEPEST times their extent, largest number of unknowns: 6 x 6 x 3 taxels 10 extents deep take
#: 5 s, 20 extents minutes.
DEEPEST, LARGE = 3.0, 200_000

#: The default surface extends this many depths past the array.
WIDE = 4.0


def default_surface(planes: Sequence[Array], *, depths: float = DEPTHS, thickness: float | None = None) -> Grid:
    """Cells no wider than the taxel pitch nor (down to a quarter of the pitch) than the depth, and a margin.

    Detail finer than the depth is damped by more than exp(-2 pi) and cannot be recovered, so finer cells would only
    cost time. A cell's centre lies above each taxel of the first plane. The grid extends past the arrays by ``depths``
    times the greatest depth and at least one pitch, so that a contact beyond the edge is not moved inside. For
    displacement, it also extends by 15 % of the array's width, because loads change displacement that far away. If all
    readings are displacements of markers scattered in a pad of this ``thickness`` on a base (None: no base), cells are
    no finer than half the markers' typical distance, and the grid extends a thickness past them, or two of these
    distances.

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
        depth = first.depth  # a surface map beside them needs no other cells
    counts, spacings, centers = [], [], []
    points = [p.points for p in planes]
    for axis in range(first.dimensions):
        low = min(float(p[:, axis].min()) for p in points)
        high = max(float(p[:, axis].max()) for p in points)
        pitch = _pitch(first, axis)
        ratio = 1 if depth == 0 else min(finest, max(1, math.ceil(pitch / depth - 1e-9)))
        spacing = pitch / ratio
        reach = max(depths * max(p.depth for p in planes), pitch, DISPLACEMENT_MARGIN * (high - low) if far else 0.0)
        if markers:
            reach = max(reach, min(thickness or 0.0, MARKER_MARGIN * pitch))
        margin = math.ceil(reach / spacing - 1e-9)
        middle, cells = 0.5 * (low + high), math.ceil((high - low) / spacing)
        if not isinstance(first, ScatteredArray):  # whole cells from the taxels of the first plane to those of others
            own = first.grid.axes[axis]
            below, above = (math.ceil(far / spacing - 1e-6) for far in (own[0] - low, high - own[-1]))
            cells = (len(own) - 1) * ratio + below + above
            middle = 0.5 * float(own[0] + own[-1]) + 0.5 * (above - below) * spacing
        counts.append(cells + 1 + 2 * margin)
        spacings.append(spacing)
        centers.append(middle)
    if first.dimensions == 1:
        return LineGrid(count=counts[0], spacing=spacings[0], center=centers[0])
    return AreaGrid(shape=(counts[0], counts[1]), spacing=(spacings[0], spacings[1]), center=(centers[1], centers[0]))


def surface_of(pad: Pad, planes: Sequence[Array], *, depths: float = DEPTHS) -> Grid:
    """The surface of the traction: the patch of a pad that can be touched, or `default_surface` of an endless one."""
    body = body_of(pad)
    if body is not None:
        return body.patch(planes)
    return default_surface(planes, depths=depths, thickness=pad.thickness)


def check_thickness(planes: Sequence[Array], thickness: float | None) -> None:
    """Refuse a pad too thin for its taxels: a press above one would not reach the next, after minutes of work."""
    if thickness is None:
        return
    for array in planes:
        pitch = min(_pitch(array, axis) for axis in range(array.dimensions))
        if thickness < THINNEST * pitch:
            raise InvalidInput(
                f"the pad is {thickness:g} m thick, {thickness / pitch:.2g} of the pitch of {pitch:g} m (at least {THINNEST:g}). Check the unit of "
                "the thickness: lengths are in metres."
            )


def check_depth(planes: Sequence[Array], surface: Grid) -> None:
    """Raise an error for a large surface due to an excessive depth, at which readings contain almost no information."""
    unknowns = len(surface.components) * math.prod(surface.shape)
    for array in planes:
        extent = float(np.ptp(array.points, axis=0).max())
        if array.depth > DEEPEST * extent and unknowns > LARGE:
            raise InvalidInput(
                f"depth = {array.depth:g} m is {array.depth / extent:.3g} times the array's extent of {extent:.3g} m, and asks for a surface of "
                f"{' x '.join(map(str, surface.shape))} cells of which the readings determine almost none. Check the unit of the depth, or give a "
                "surface= of fewer cells."
            )


def check_above(planes: Sequence[Array], surface: Grid) -> None:
    """Raise an error for a surface that lies beside the arrays."""
    for axis, cells in enumerate(surface.axes):
        low = min(float(a.points[:, axis].min()) for a in planes)
        high = max(float(a.points[:, axis].max()) for a in planes)
        if cells[-1] < low or cells[0] > high:
            name = "x" if axis == surface.dimensions - 1 else "y"
            raise InvalidInput(
                f"the surface lies beside the array: its cells go from {name} = {cells[0]:g} to {cells[-1]:g} m, and the taxels from {low:g} to {high:g} m. "
                "Give the surface's center= in the array's coordinates, in metres."
            )


def _pitch(array: Array, axis: int) -> float:
    """Pitch along an axis; for scattered positions, of a square grid of as many: n p^2 = (a + p) (b + p)."""
    if isinstance(array, ScatteredArray):
        extent, n = np.ptp(array.points, axis=0), len(array.points)
        if array.dimensions == 1 or n == 1:
            return float(extent[0]) / max(n - 1, 1)
        half = 0.5 * float(extent.sum()) / (n - 1)
        return half + math.sqrt(half**2 + float(np.prod(extent)) / (n - 1))
    if isinstance(array, LineArray):
        return array.pitch
    return array.grid.spacings[axis]
