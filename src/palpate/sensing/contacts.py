"""Readings of a contact in closed form, accurate for any size of the surface cells.

A taxel at a distance r from a load cannot resolve details finer than r, so that cells of r/6 suffice, if their
traction has the moments of the contact's. The integral of a cell's influence is interpolated between its edges by a
polynomial through `STENCIL` + 1 of them. The transpose of that interpolation gives the weight of a piece of the
contact in each cell (as in J. R. Phillips, J. K. White, IEEE Trans. CAD 16, 1997, 1059-1072). The operator of the
surface serves all taxels farther away than six of its cells. For the others, cells near the contact are refined by a
factor of four in each step. The finest cells use the mean of the contact: on the surface itself, and under a very wide
contact at depths less than about a hundredth of its size. With apertures more than twice as wide as deep, cells are a
sixth of an aperture wide: under contacts wider than an aperture the error is up to 1 % of the largest reading of
pressure, and 2 % of shear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import irfftn, rfftn
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import AreaArray, Array, LineArray, ScatteredArray
from palpate.sensing.grids import Grid, LineGrid, refined
from palpate.sensing.operator import Operator, Periodic
from palpate.solutions import AreaContact, LineContact

__all__ = ["contact_readings", "sampled"]

Contact = LineContact | AreaContact
Index = npt.NDArray[np.intp]

#: Number of cells along each axis over which a piece of the contact is distributed, and smallest distance of a taxel in
#: cells.
STENCIL, AWAY = 10, 6.0
#: Pieces of the contact per cell along each axis, and smallest number across the contact; a concentrated load is three
#: pieces, each POINT of a cell wide.
PIECES, ACROSS, POINT = 6, 64, 1e-4
#: Largest number of pieces: more take seconds and a gigabyte.
MAX_PIECES = 3e7
#: Number of cells across a contact (line, area) at which refinement stops, below the surface and on it.
MOST, MOST_ON = {1: 4096, 2: 512}, {1: 1024, 2: 96}
#: Cells across the aperture of a taxel whose depth is less than half of it.
ACROSS_TAXEL = 6
#: Refinement factor of each step.
STEP = 4.0


def sampled(contact: Contact, grid: Grid) -> Floats:
    """Mean traction (component, *grid) [Pa] of a contact in each cell; parts outside the grid are dropped.

    Raises
    ------
    InvalidInput
        A line's contact on an area, or the other way round.
    """
    _check(contact, grid)
    if isinstance(contact, LineContact):
        return contact.averages(grid.edges)  # type: ignore[union-attr]
    return contact.averages(grid.x, grid.axes[0])


def contact_readings(operator: Operator, contact: Contact) -> list[Floats]:
    """Readings (channel, *array) of each plane.

    On a periodic surface the contact is repeated with it; on a free one it presses wherever it lies, also beyond the surface.

    Raises
    ------
    InvalidInput
        A line's contact on an area, or the other way round.
    Unsupported
        A concentrated load on taxels at depth 0.
    """
    _check(contact, operator.surface)
    if any(t.shape == "load" for t in contact.terms) and any(a.depth == 0.0 for a in operator.planes_of):
        raise Unsupported(
            "a concentrated load has no finite readings at depth 0. Use a small contact, such as strip() or patch()."
        )
    if operator.boundary == "periodic":
        found = [_periodic(operator, array, contact) for array in operator.planes_of]
    else:
        found = [_free(operator, i, contact) for i in range(len(operator.planes_of))]
    return [np.asarray(part) for part in operator.observed(found)]


def _check(contact: Contact, grid: Grid) -> None:
    if isinstance(contact, LineContact) != isinstance(grid, LineGrid):
        raise InvalidInput("a line contact needs a skin in line contact, and an area contact one in area contact.")
    widest, h = float(_place(contact)[1].max()), min(grid.spacings)
    pieces = math.prod(max(2.0 * float(a) * PIECES / dx, 1.0) for a, dx in zip(_place(contact)[1], grid.spacings))
    if pieces > MAX_PIECES:
        raise InvalidInput(
            f"the contact is {2.0 * widest:g} m wide, {2.0 * widest / h:.2g} times the surface's cells of {h:g} m: too many pieces to integrate. Check "
            "the unit of its radius, and of the pitch: lengths are in metres."
        )


# -- free ------------------------------------------------------------------------------------------------------------------


def _free(operator: Operator, plane: int, contact: Contact) -> Floats:
    pad, array, surface = operator.pad, operator.planes_of[plane], operator.surface
    center, half = _place(contact)
    points = array.points
    beside = np.maximum(np.abs(points - center) - half, 0.0)
    away = np.sqrt((beside**2).sum(axis=1) + array.depth**2)
    out = np.zeros((len(array.channels), len(points)))
    # Distant taxels use the surface unchanged.
    h = max(surface.spacings)
    spread = _spread(contact, surface)
    rest = array.valid.ravel() & (True if spread is None else away < AWAY * h * (1 - 1e-9))
    if spread is not None and not rest.all():
        out = np.asarray(operator.planes[plane].forward(spread)).reshape(out.shape).copy()
    elif spread is None:
        h *= STEP  # outside the surface: cells of the surface's width at its place
    least = array.depth / AWAY
    coarsest = 2.0 * float(half.max()) / (MOST if array.depth > 0.0 else MOST_ON)[surface.dimensions]
    if array.depth < 0.5 * max(array.apertures):  # its mean is cut at the ends of cells
        coarsest = max(coarsest, max(array.apertures) / ACROSS_TAXEL)
    while rest.any():
        h = max(h / STEP, least)
        here, smooth = rest & (away >= AWAY * h * (1 - 1e-9)), True
        if h < coarsest:  # at most so many cells across the contact
            h, here, smooth = coarsest, rest, False
        if not here.any():
            continue
        part, chosen = _part(array, here)
        grid = _about(array, contact, h, surface)
        traction = _spread(contact, grid) if smooth else sampled(contact, grid)
        found = np.asarray(Operator(pad, [part], grid).planes[0].forward(traction)).reshape(len(out), -1)
        out[:, here] = found[:, here[chosen]]
        rest = rest & ~here
    return out.reshape(len(array.channels), *array.shape)


def _place(contact: Contact) -> tuple[Floats, Floats]:
    """Middle and half-widths [m], in the order of the array axes."""
    if isinstance(contact, LineContact):
        return np.array([contact.center]), np.array([contact.half_width])
    return np.array(contact.center[::-1]), np.array(contact.size[::-1])


def _pieces(contact: Contact, widths: Sequence[float]) -> tuple[list[Floats], Floats]:
    """Cut the contact into pieces no wider than ``widths``: edges on each axis, and traction (component, *piece)."""
    center, half = _place(contact)
    edges = []
    for middle, a, width in zip(center, half, widths):
        count = max(ACROSS, math.ceil(2.0 * a / width)) if a > 0 else 3
        steps = np.linspace(-1.0, 1.0, count + 1)
        if len(half) == 1 and a > 0:  # closer to the ends, where traction may grow without bound
            steps = np.sin(0.5 * np.pi * steps)
        edges.append(middle + steps * (a if a > 0 else 1.5 * POINT * width))
    if isinstance(contact, LineContact):
        return edges, contact.averages(edges[0])
    middles = [0.5 * (e[1:] + e[:-1]) for e in edges]
    return edges, contact.averages(middles[1], middles[0])


def _spread(contact: Contact, grid: Grid) -> Floats | None:
    """Traction (component, *cell) with the contact's moments, for distant readings; None if the grid is too small."""
    edges, traction = _pieces(contact, [dx / PIECES for dx in grid.spacings])
    for axis, (e, x, dx) in enumerate(zip(edges, grid.axes, grid.spacings)):
        share = _shares((e - x[0]) / dx + 0.5, len(x))
        if share is None:
            return None
        traction = np.moveaxis(np.tensordot(share, traction, axes=(1, axis + 1)), 0, axis + 1)
    return traction


def _shares(edges: Floats, count: int) -> Floats | None:
    """Weights (cell, piece) of ``count`` cells for the pieces between ``edges``, in units of cells from the first
    one's edge.

    Let F be the integral of an influence, known at the cell edges m. A piece from s to t gives F(t) - F(s) = sum_m F_m
    [L_m(t) - L_m(s)], and F_m is the sum over the cells before m.
    """
    first = np.round(0.5 * (edges[1:] + edges[:-1])).astype(int) - STENCIL // 2
    if first.min() < 0 or first.max() + STENCIL > count:
        return None
    change = _lagrange(edges[1:] - first) - _lagrange(edges[:-1] - first)
    share = np.cumsum(change[:, ::-1], axis=1)[:, ::-1][:, 1:]
    out = np.zeros((count, len(first)))
    out[first[:, None] + np.arange(STENCIL), np.arange(len(first))[:, None]] = share
    return out


def _lagrange(x: Floats) -> Floats:
    """Lagrange's polynomials (point, node) of the nodes 0 ... STENCIL."""
    nodes = np.arange(STENCIL + 1)
    out = np.ones((len(x), len(nodes)))
    for i in nodes:
        for j in nodes:
            if i != j:
                out[:, i] *= (x - j) / (i - j)
    return out


def _about(array: Array, contact: Contact, h: float, surface: Grid) -> Grid:
    """Grid of cells no wider than ``h`` over a contact and around it; taxels of a regular array lie above centres."""
    counts, spacings, centers = [], [], []
    for axis, (middle, a) in enumerate(zip(*_place(contact))):
        if isinstance(array, ScatteredArray):
            width, start = h, float(middle)
        else:
            pitch = array.grid.spacings[axis]
            width = pitch / math.ceil(pitch / h * (1 - 1e-9))
            start = float(array.grid.axes[axis][0])
        low = math.floor((middle - a - start) / width) - STENCIL // 2
        high = math.ceil((middle + a - start) / width) + STENCIL // 2
        counts.append(high - low + 1)
        spacings.append(width)
        centers.append(start + 0.5 * (low + high) * width)
    if isinstance(surface, LineGrid):
        return LineGrid(count=counts[0], spacing=spacings[0], center=centers[0])
    return replace(
        surface, shape=(counts[0], counts[1]), spacing=(spacings[0], spacings[1]), center=(centers[1], centers[0])
    )


def _part(array: Array, wanted: npt.NDArray[np.bool_]) -> tuple[Array, Index]:
    """The smallest array of this kind that contains the ``wanted`` taxels, and the indices of its taxels."""
    if isinstance(array, ScatteredArray):
        some = np.flatnonzero(wanted)
        points = array.points
        if len(some) < 2:  # an array needs two or more
            some = np.unique(np.concatenate([some, points.argmin(axis=0), points.argmax(axis=0)]))
        mask = None if array.mask is None else np.asarray(array.mask)[some]
        return replace(array, positions=np.asarray(array.positions)[some], mask=mask, limits=None), some
    there = wanted.reshape(array.shape)
    ranges = []
    for axis, n in enumerate(array.shape):
        others = tuple(a for a in range(there.ndim) if a != axis)
        found = np.flatnonzero(there.any(axis=others))
        low, high = int(found[0]), int(found[-1])
        if low == high and n > 1:  # an array needs two or more
            low, high = (low, high + 1) if high + 1 < n else (low - 1, high)
        ranges.append(np.arange(low, high + 1))
    chosen = np.ravel_multi_index(np.meshgrid(*ranges, indexing="ij"), array.shape).ravel()
    centers = [0.5 * float(x[r[0]] + x[r[-1]]) for x, r in zip(array.grid.axes, ranges)]
    mask = None if array.mask is None else np.asarray(array.mask)[np.ix_(*ranges)]
    if isinstance(array, LineArray):
        return replace(array, count=len(ranges[0]), center=centers[0], mask=mask, limits=None), chosen
    area: AreaArray = replace(
        array, shape=(len(ranges[0]), len(ranges[1])), center=(centers[1], centers[0]), mask=mask, limits=None
    )
    return area, chosen


# -- periodic --------------------------------------------------------------------------------------------------------------


def _periodic(operator: Operator, array: Array, contact: Contact) -> Any:
    """Readings on a periodic surface, on cells finer by an odd factor: each taxel stays at the middle of a cell."""
    surface = operator.surface
    d, h = surface.dimensions, max(surface.spacings)
    center, half = _place(contact)
    least, most = array.depth / AWAY, (MOST if array.depth > 0.0 else MOST_ON)[d]
    finest = max(2.0 * float(half.max()), h * max(surface.shape) / 4) / most
    ratio = 2 * max(1, math.ceil(0.5 * (h / max(least, finest) - 1.0))) + 1
    grid = refined(surface, ratio)
    smooth = finest <= least
    # Loads beyond the surface act on its periodic copies.
    periods = [
        math.ceil(max(abs(m - 0.5 * (x[0] + x[-1])) + a + STENCIL * dx, 0.0) / (len(x) * dx) - 0.5)
        for m, a, x, dx in zip(center, half, surface.axes, surface.spacings)
    ]
    wide = _repeated(grid, periods)
    traction = _spread(contact, wide) if smooth else None
    if traction is None:
        traction, smooth = sampled(contact, wide), False
    for axis, (count, n) in enumerate(zip(periods, grid.shape)):
        shape = traction.shape
        traction = traction.reshape(*shape[: axis + 1], 2 * count + 1, n, *shape[axis + 2 :]).sum(axis=axis + 1)
    if smooth:  # traction that is even in cells
        spectrum = rfftn(traction, grid.shape)
        for axis, n in enumerate(grid.shape):
            waves = np.fft.rfftfreq(n) if axis == d - 1 else np.fft.fftfreq(n)
            spectrum = spectrum * np.sinc(waves).reshape([-1 if a == axis else 1 for a in range(d)])
        traction = irfftn(spectrum, grid.shape)
    found = Periodic(operator.pad, array, grid).forward(traction)
    return found[(..., *(slice(ratio // 2, None, ratio) for _ in range(d)))]


def _repeated(grid: Grid, periods: Sequence[int]) -> Grid:
    """The grid with ``periods`` copies on either side of each axis."""
    counts = [(2 * p + 1) * n for p, n in zip(periods, grid.shape)]
    if isinstance(grid, LineGrid):
        return replace(grid, count=counts[0])
    return replace(grid, shape=(counts[0], counts[1]))
