"""Models of a contact of a few taxels: discs (strips on a line) of even traction, everywhere and of every size.

Between shallow taxels little is felt: readings of a small contact are those of a wide one of less force, and a penalty of gradients always says the
wide one. Here the places and radii that explain the readings are weighed by what they leave, and some of them, drawn in the order of their force,
become models of the frame: traction on their cells alone. How far they differ is then part of every error bar.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate.elastic.pad import Floats
from palpate.inverse.contact.model import Normal
from palpate.inverse.contact.products import Applied

if TYPE_CHECKING:
    from palpate.inverse.contact.constrained import ConstrainedEstimator

__all__ = ["Disc", "Discs", "discs"]

Index = npt.NDArray[np.intp]

#: Radii in cells of the finer grid, up to a pitch; where more than this part of the weight is at the largest, contact is larger.
RADII, AT_END = (0.5, 1.0, 1.5, 2.25, 3.25, 4.5, 6.0), 0.8
#: A contact is small where the first solution presses as hard as half of its peak on no more taxels than this (area, line).
TAXELS = {2: 6.0, 1: 3.0}
#: Discs that become models.
DRAWN = 8
#: Where noise is not given, what discs leave is no less than this part of the largest reading: their edges and places are not those of contact.
DETAIL = 0.015
#: Weight of all of them below which they are not worth solving, and at most: a disc is never all that is possible.
LEAST, MOST = 0.02, 0.67
#: Discs that leave this many times the noise, and what fields leave, are none.
WORSE = 2.0
#: Cells that places are sought among.
LARGEST = 4000
#: Places that discs of the third radius do best at, at which all radii are tried.
PLACES = 200
#: The best discs, about which places between cells are tried, and how many to a cell on either side.
BEST, STEPS = 24, 3


@dataclass(frozen=True)
class Disc:
    """Cells (their places among those of the data) and the traction on them (component, cell)."""

    position: Index
    traction: Floats


@dataclass(frozen=True)
class Discs:
    """Discs of equal weight, and the weight of all."""

    drawn: tuple[Disc, ...]
    weight: float


@dataclass(frozen=True)
class _Tried:
    """Shapes (shape, cell), the traction (shape, component) that explains most with each, and the squares that it leaves (shape,)."""

    shapes: scipy.sparse.csr_array
    traction: Floats
    left: Floats

    def part(self, some: Index) -> _Tried:
        return _Tried(self.shapes[some], self.traction[some], self.left[some])


def discs(
    estimator: ConstrainedEstimator, data: Normal, first: Floats, white: Floats, left: float, taken: float
) -> Discs | None:
    """The discs that explain the whitened readings ``white``; None where contact is no small one, or fields explain them better.

    ``first`` is the first solution (component, *surface), which leaves the sum of squares ``left`` and takes so many degrees of freedom.
    """
    import scipy.spatial

    grid, c, n = data.level.grid, len(data.linear), len(data.cells)
    pressure = first[-1]
    taxels_a_cell = estimator.taxels / max(float((~estimator.outside).sum()), 1.0)
    small = float((pressure > 0.5 * pressure.max()).sum()) * taxels_a_cell
    free, total = len(white) - c, float(white @ white)
    if isinstance(data.matrix, Applied) or small > TAXELS[grid.dimensions] or free < c + 2 or n > LARGEST:
        return None
    places = np.stack(np.unravel_index(data.cells, grid.shape), axis=1).astype(np.float64)
    matrix = np.ascontiguousarray(np.asarray(data.matrix).reshape(len(white), c, n).transpose(1, 2, 0))
    detail = 0.0 if estimator.noise_known else (DETAIL * float(np.abs(white).max())) ** 2
    floor = detail * len(white)

    def tried(shapes: scipy.sparse.csr_array) -> _Tried:
        columns = np.stack([shapes @ m for m in matrix], axis=1)  # (shape, component, reading)
        right, gram = columns @ white, columns @ columns.transpose(0, 2, 1)
        gram += 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(c)
        found = np.linalg.solve(gram, right[..., None])[..., 0]
        found = estimator.cone.nearest(found.T).T
        rest = total - 2.0 * (found * right).sum(axis=1) + np.einsum("pi,pij,pj->p", found, gram, found)
        return _Tried(shapes, found, np.maximum(rest, 0.0) + floor)

    tree = scipy.spatial.KDTree(places)
    pairs = tree.sparse_distance_matrix(tree, RADII[-1], output_type="coo_matrix")

    def discs_of(radius: float) -> scipy.sparse.csr_array:
        near = pairs.data <= radius
        row, col = pairs.row[near], pairs.col[near]
        return scipy.sparse.csr_array((np.ones(len(row)), (row, col)), shape=(n, n))

    whole = [discs_of(radius) for radius in RADII]
    some = np.argsort(tried(whole[2]).left, kind="stable")[:PLACES]
    coarse = tried(scipy.sparse.csr_array(scipy.sparse.vstack([w[some] for w in whole])))
    # between cells: the best, and their neighbours' share of them
    best = np.argsort(coarse.left, kind="stable")[:BEST]
    near = [_between(whole[k // len(some)], places, int(some[k % len(some)])) for k in best]
    fine = tried(scipy.sparse.csr_array(scipy.sparse.vstack(near)))
    theirs = max(len(white) - taken, 1.0)
    if (float(fine.left.min()) - floor) / free > max(WORSE**2 * max(left / theirs, 1.0), detail):
        return None
    # any radius up to the largest is as likely
    size = np.repeat(best // len(some), [s.shape[0] for s in near])
    log_weight = -0.5 * free * np.log(fine.left) + np.log(np.gradient(np.array(RADII)))[size]
    weight = np.exp(log_weight - log_weight.max())
    if weight[size == len(RADII) - 1].sum() > AT_END * weight.sum():
        return None
    # of all shapes, those as good as the best
    chance = float(weight.sum()) / (n * len(RADII) * len(fine.left) / len(best))
    mine = -0.5 * free * math.log(float(fine.left.min()) / free / total) + math.log(chance)
    other = -0.5 * theirs * math.log((left + floor) / theirs / total)
    share = 1.0 / (1.0 + math.exp(min(max(other - mine, -50.0), 50.0)))
    if share < LEAST:
        return None
    forces = fine.traction[:, -1] * np.asarray(fine.shapes.sum(axis=1)).ravel()
    order = np.argsort(forces, kind="stable")
    steps = np.cumsum(weight[order]) / weight.sum()
    drawn = []
    for pick in order[np.searchsorted(steps, (np.arange(DRAWN) + 0.5) / DRAWN)]:
        row = fine.shapes[[pick]]
        drawn.append(Disc(row.indices.astype(np.intp), fine.traction[pick][:, None] * row.data[None, :]))
    return Discs(tuple(drawn), min(share, MOST))


def _between(discs_: scipy.sparse.csr_array, places: Floats, centre: int) -> scipy.sparse.csr_array:
    """Discs (shape, cell) at places about a cell, by linear interpolation between those of its neighbours; and its own."""
    steps = np.linspace(-1.0, 1.0, 2 * STEPS + 1)
    d = places.shape[1]
    offsets = np.stack(np.meshgrid(*[steps] * d, indexing="ij"), axis=-1).reshape(-1, d)
    near = np.flatnonzero((np.abs(places - places[centre]) <= 1.0).all(axis=1))
    share = np.prod(np.maximum(1.0 - np.abs(offsets[:, None, :] - (places[near] - places[centre])[None]), 0.0), axis=2)
    kept = share.sum(axis=1) > 1.0 - 1e-9  # no neighbour is missing
    return scipy.sparse.csr_array(scipy.sparse.csr_array(share[kept]) @ discs_[near])
