"""Models of a contact of a few taxels: the contacts of balls (cylinders on a line), at any place and of any size.

Between shallow taxels the sensitivity is low: a small contact gives the same readings as a wide one with less force,
and a penalty on gradients always prefers the wide one. Here each place and radius that fits the readings is weighted
by its residual. Discs drawn from that distribution become models of the frame, with traction on their cells only: that
of a ball, sqrt(1 - (r / a)^2) (Hertz). The spread between them is part of every error bar.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.model import ContactModel, Normal
from palpate.inverse.constrained.variances import log_determinant
from palpate.inverse.contact.policy import Discs as Rules
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.score import share_of
from palpate.inverse.linear.evidence import log_evidence

__all__ = ["DISC", "Disc", "Discs", "discs"]

#: `ContactModel.kind` of a disc.
DISC = "disc"

Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Disc:
    """Cells of a disc (indices into the cells of the data) and the traction on them (component, cell)."""

    position: Index
    traction: Floats


@dataclass(frozen=True)
class Discs:
    """Discs of equal weight, and their total weight."""

    drawn: tuple[Disc, ...]
    weight: float


@dataclass(frozen=True)
class _Tried:
    """Candidate shapes: the best traction of each (shape, component), and its squared residual (shape,)."""

    traction: Floats
    left: Floats


class _Fit:
    """Fits traction on a shape to the whitened readings ``white``."""

    def __init__(self, estimator: PreparedContact, data: Normal, white: Floats) -> None:
        self.c, n = len(data.linear), len(data.cells)
        self.white, self._nearest = white, estimator.cone.nearest
        #: Whitened columns (cell, component, reading).
        self.columns = np.ascontiguousarray(np.asarray(data.matrix.T).reshape(self.c, n, -1).transpose(1, 0, 2))
        self.total = float(white @ white)
        self.least = float(np.finfo(np.float64).eps) * self.total

    def of(self, gram: Floats, right: Floats) -> _Tried:
        """Fit of shapes with normal equations ``gram`` (..., component, component) and ``right`` (..., component)."""
        gram, right = gram.reshape(-1, self.c, self.c), right.reshape(-1, self.c)
        least = 1e-9 * np.trace(gram, axis1=1, axis2=2) + np.finfo(np.float64).tiny
        gram = gram + least[:, None, None] * np.eye(self.c)  # cells beside a pad that ends read nothing
        found = np.linalg.solve(gram, right[..., None])[..., 0]
        found = self._nearest(found.T).T
        rest = self.total - 2.0 * (found * right).sum(axis=1)
        rest = rest + (found * (gram @ found[..., None])[..., 0]).sum(axis=1)
        return _Tried(found, np.maximum(rest, self.least))


class _Shapes(NamedTuple):
    """Shapes that were tried. Those of a group share their cells, of which each has its ``shares`` (shape, cell), and the
    index ``size`` of their radius; ``extent`` (shape,) is the total traction of each over that of its centre, in cells.
    """

    groups: list[tuple[Index, Floats, int]]
    extents: list[Floats]
    tried: _Tried

    @property
    def sizes(self) -> Index:
        """Index of the radius of each shape."""
        return np.repeat([size for *_, size in self.groups], [len(extent) for extent in self.extents])

    def drawn(self, pick: int, places: _Neighbours, radii: tuple[float, ...]) -> Disc:
        """One of the shapes as a disc."""
        ends = np.cumsum([len(extent) for extent in self.extents])
        group = int(np.searchsorted(ends, pick, side="right"))
        cells, shares, size = self.groups[group]
        shape = places.summed(cells, radii[size], shares[pick - ends[group]])
        position = np.flatnonzero(shape)
        return Disc(position, self.tried.traction[pick][:, None] * shape[position])


class _Neighbours:
    """Distances between the cells of a region, for looking up discs."""

    def __init__(self, cells: Index, shape: tuple[int, ...], rules: Rules) -> None:
        steps, self.far, next_to, self.shares = _steps(len(shape), rules.radii[-1], rules.steps)
        # Index of every cell within the region, with a border of -1 around it.
        reach = int(rules.radii[-1])
        wide = tuple(n + 2 * reach for n in shape)
        self.count = len(cells)
        self.first = np.ravel_multi_index(tuple(p + reach for p in np.unravel_index(cells, shape)), wide)
        self.number = np.full(math.prod(wide), -1)
        self.number[self.first] = np.arange(len(cells))
        along = np.cumprod((1, *wide[:0:-1]))[::-1]
        self.steps, self.next_to = steps @ along, next_to @ along

    def found(self, centres: Index, radius: float) -> tuple[Index, Floats]:
        """Cells (centre, neighbour) at most ``radius`` from each centre, in cells; -1 for a missing one. And the traction of
        each neighbour under a ball, whose contact ends half a cell beyond ``radius``, over that of the centre.
        """
        within = np.searchsorted(self.far, radius, side="right")
        traction = np.sqrt(1.0 - (self.far[:within] / (radius + 0.5)) ** 2)
        return np.asarray(self.number[self.first[centres][:, None] + self.steps[None, :within]]), traction

    def of(self, centres: Index, radius: float) -> Sparse:
        """Sparse matrix (centre, cell) with the traction of each disc."""
        found, traction = self.found(centres, radius)
        there = found >= 0
        ends = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
        each = np.broadcast_to(traction, found.shape)[there]
        return scipy.sparse.csr_array((each, found[there], ends), shape=(len(centres), self.count))

    def sums(self, centres: Index, radius: float, rows: Floats) -> tuple[Floats, Floats]:
        """Sums (centre, component, reading) of ``rows`` (cell, component, reading) over discs, and their total traction."""
        disc = self.of(centres, radius)
        sums = np.asarray(disc @ rows.reshape(self.count, -1)).reshape(-1, *rows.shape[1:])
        return sums, np.asarray(disc.sum(axis=1))

    def normal(self, centres: Index, radii: Sequence[float], rows: Floats, white: Floats) -> tuple[Floats, Floats]:
        """Gram matrix (radius, centre, component, component) and product with ``white`` (radius, centre, component) of the
        same sums.
        """
        columns = np.stack([self.sums(centres, r, rows)[0] for r in radii])
        c = rows.shape[1]
        gram = np.empty((*columns.shape[:2], c, c))
        for i, j in itertools.combinations_with_replacement(range(c), 2):
            gram[..., i, j] = gram[..., j, i] = np.einsum("rpm,rpm->rp", columns[:, :, i], columns[:, :, j])
        return gram, columns @ white

    def summed(self, centres: Index, radius: float, weights: Floats) -> Floats:
        """Weighted sum of discs (cell,)."""
        return np.asarray(weights @ self.of(centres, radius))

    def next_to_each(self, centres: Sequence[int]) -> Index:
        """Adjacent cells of each cell (cell, neighbour), including the cell itself; -1 for a missing one."""
        return np.asarray(self.number[self.first[list(centres)][:, None] + self.next_to])

    def about(self, centre: int) -> tuple[Index, Floats]:
        """Adjacent cells of a cell, including itself, and the weights (place, neighbour) of linear interpolation at
        places between them, `steps` per cell.
        """
        near = self.next_to_each([centre])[0]
        share = self.shares[:, near >= 0]
        return near[near >= 0], share[share.sum(axis=1) > 1.0 - 1e-9]  # no neighbour is missing


@functools.cache
def _steps(dimensions: int, radius: float, between_cells: int) -> tuple[Index, Floats, Index, Floats]:
    """Offsets to cells within the largest radius, nearest first, and their distances; offsets to adjacent cells, and
    their interpolation weights at places in between.
    """

    reach = int(radius)
    steps = _lattice(np.arange(-reach, reach + 1), dimensions)
    far = np.sqrt((steps**2).sum(axis=1))
    order = np.argsort(far, kind="stable")
    order = order[far[order] <= radius]
    between = _lattice(np.linspace(-1.0, 1.0, 2 * between_cells + 1), dimensions)
    return steps[order], far[order], _lattice(np.arange(-1, 2), dimensions), _shares(between)


def _lattice(steps: npt.NDArray[Any], dimensions: int) -> npt.NDArray[Any]:
    """All places (place, axis) whose coordinates are among the ``steps``."""
    return np.stack(np.meshgrid(*[steps] * dimensions, indexing="ij"), axis=-1).reshape(-1, dimensions)


def _shares(places: Floats) -> Floats:
    """Linear interpolation weights (place, neighbour) of adjacent cells at places (place, axis), given in cells from
    the middle of the central cell.
    """
    next_to = _lattice(np.arange(-1, 2), places.shape[1])
    return np.asarray(np.prod(np.maximum(1.0 - np.abs(places[:, None, :] - next_to[None]), 0.0), axis=2))


def _between(each: Floats, white: Floats) -> tuple[Floats, Floats]:
    """Gram matrices (..., k * k, component * component) between the readings ``each`` (..., k, component, reading) of a
    few shapes, and their product with ``white`` (..., k, component).
    """
    *batch, k, c, m = each.shape
    flat = each.reshape(*batch, k * c, m)
    gram = (flat @ np.swapaxes(flat, -1, -2)).reshape(*batch, k, c, k, c)
    return np.swapaxes(gram, -3, -2).reshape(*batch, k * k, c * c), each @ white


def _blended(share: Floats, between: Floats, told: Floats) -> tuple[Floats, Floats]:
    """Gram matrices (..., shape, component * component) and products with the readings (..., shape, component) of shapes
    that are the ``share`` (..., shape, k) of those of `_between`.
    """
    pairs = (share[..., :, None] * share[..., None, :]).reshape(*share.shape[:-1], -1)
    return pairs @ between, share @ told


def discs(
    estimator: PreparedContact,
    data: Normal,
    first: Floats,
    white: Floats,
    field: ContactModel,
    possible: int,
) -> Discs | None:
    """The discs that fit the whitened readings ``white``. None if the contact is not small, or if a smooth field is
    likelier: log evidence of both, with a Gaussian prior of the size found on the traction of a disc.

    ``first`` is the first solution (component, *surface), ``field`` the leading model on the cells of ``data``;
    ``possible`` is the number of surface cells on which a contact may lie.
    """
    rules, dimensions = estimator.policy.discs, data.level.grid.dimensions
    free = len(white) - len(data.linear)
    if data.at_size or free < len(data.linear) + 2 or len(data.cells) > rules.cells or not _small(estimator, first[-1]):
        return None
    fit, places = _Fit(estimator, data, white), _Neighbours(data.cells, data.level.grid.shape, rules)
    every = fit.of(*places.normal(np.arange(len(data.cells)), rules.radii[2:3], fit.columns, white))
    some = np.argsort(every.left, kind="stable")[: rules.places]
    coarse = fit.of(*places.normal(some, rules.radii, fit.columns, white)).left.reshape(len(rules.radii), -1)
    parts = [_around_the_best(fit, places, rules, some, coarse)]
    usual, volume = len(parts[0].tried.left), np.zeros(len(parts[0].tried.left))
    finest = _halving_steps(fit, places, rules, some[np.argmin(coarse, axis=1)], dimensions)
    if finest is not None:
        parts.append(finest)
        step = 0.5**rules.halvings  # of two cells
        more = np.full(len(finest.tried.left), dimensions * math.log(step * rules.steps))
        volume = np.concatenate([volume, more])
    shapes = _Shapes(
        [group for part in parts for group in part.groups],
        [extent for part in parts for extent in part.extents],
        _Tried(*(np.concatenate([getattr(p.tried, name) for p in parts]) for name in ("traction", "left"))),
    )
    found, sizes, least = shapes.tried, shapes.sizes, float(shapes.tried.left.min())
    # Prior: every radius up to the largest is equally likely.
    top = -0.5 * free * math.log(least)
    log_weight = -0.5 * free * np.log(found.left) + np.log(np.gradient(np.array(rules.radii)))[sizes] + volume
    weight = np.exp(log_weight - top) * found.traction.any(axis=1)
    if not weight.any():
        return None
    # Fraction of all shapes that fit as well as the best.
    anywhere = max(possible * data.level.ratio**dimensions, len(data.cells))
    chance = float(weight.sum()) / (anywhere * len(rules.radii) * usual / min(rules.best, coarse.size))
    # The log determinant is that of the traction's size, which is its prior, in units of its error.
    logdet = len(data.linear) * math.log(free * fit.total / least)
    mine = log_evidence(least, logdet, len(white), None) + math.log(chance)
    share_of_all = share_of(mine - _evidence_of(field, white))
    if share_of_all < rules.least:
        return None
    order = np.argsort(found.traction[:, -1] * np.concatenate(shapes.extents), kind="stable")
    steps = np.cumsum(weight[order]) / weight.sum()
    picks = order[np.searchsorted(steps, (np.arange(rules.drawn) + 0.5) / rules.drawn)]
    drawn = tuple(shapes.drawn(int(pick), places, rules.radii) for pick in picks)
    return Discs(drawn, min(share_of_all, rules.most))


def _evidence_of(field: ContactModel, white: Floats) -> float:
    """Log evidence of a smooth field, with the noise that suits it."""
    left, traction = float(((field.explained - white) ** 2).sum()), field.solution.traction
    energy = float((traction * field.penalty.product(traction)).sum())
    return log_evidence(left + energy, log_determinant(field), len(white), None)


def _small(estimator: PreparedContact, pressure: Floats) -> bool:
    """Whether pressure above half its peak covers few taxels."""
    taxels_a_cell = estimator.taxels / max(float((~estimator.outside).sum()), 1.0)
    covered = float((pressure > 0.5 * pressure.max()).sum()) * taxels_a_cell
    return covered <= estimator.policy.discs.taxels[estimator.surface.dimensions - 1]


def _around_the_best(fit: _Fit, places: _Neighbours, rules: Rules, some: Index, coarse: Floats) -> _Shapes:
    """Shapes at places between cells, around the best of ``coarse``, the squared residuals (radius, place) of discs at the
    cells ``some``: interpolated between the adjacent cells.
    """
    best = np.argsort(coarse.ravel(), kind="stable")[: rules.best]
    sizes = best // len(some)
    near = [places.about(int(some[k % len(some)])) for k in best]
    normal: dict[int, tuple[Floats, Floats]] = {}
    extents: dict[int, Floats] = {}
    for size in np.unique(sizes):
        those = np.flatnonzero(sizes == size)
        centres, inverse = np.unique(np.concatenate([near[k][0] for k in those]), return_inverse=True)
        each, counts = places.sums(centres, rules.radii[size], fit.columns)
        parts = np.split(inverse, np.cumsum([len(near[k][0]) for k in those])[:-1])
        for k, part in zip(those.tolist(), parts):
            normal[k] = _blended(near[k][1], *_between(each[part], fit.white))
            extents[k] = near[k][1] @ counts[part]
    order = range(len(best))
    grams, rights = zip(*(normal[k] for k in order))
    groups = [(*near[k], int(sizes[k])) for k in order]
    return _Shapes(groups, [extents[k] for k in order], fit.of(np.concatenate(grams), np.concatenate(rights)))


def _halving_steps(fit: _Fit, places: _Neighbours, rules: Rules, best_of: Index, dimensions: int) -> _Shapes | None:
    """Shapes around the best place of each radius, sought by halving steps from the cells ``best_of`` (radius,), for all
    radii together. None if all of them are at the edge of the region.
    """
    around = places.next_to_each(best_of.tolist())
    missing = around < 0
    each, counts = np.zeros((*around.shape, fit.c, len(fit.white))), np.zeros(around.shape)
    for size, (cells, gone) in enumerate(zip(around, missing)):
        each[size, ~gone], counts[size, ~gone] = places.sums(cells[~gone], rules.radii[size], fit.columns)
    between, told = _between(each, fit.white)
    at, here = np.zeros((len(best_of), dimensions)), np.arange(len(best_of))
    axes, aside = _lattice(np.arange(-1.0, 2.0), dimensions), np.arange(-rules.aside, rules.aside + 1.0)
    for turn in range(rules.halvings + 1):
        step = 0.5 ** (turn + 1)
        moves = _lattice(aside, dimensions) * 2.0 * step if turn == rules.halvings else axes * step
        there = np.clip(at[:, None] + moves, -1.0, 1.0)
        share = _shares(there.reshape(-1, dimensions)).reshape(*there.shape[:2], -1)
        whole = ((share * missing[here, None]).sum(axis=2) < 1e-9).all(axis=1)  # else at the region's edge
        here, there, share = here[whole], there[whole], share[whole]
        if not len(here):
            return None
        one = fit.of(*_blended(share, between[here], told[here]))
        at = there[np.arange(len(here)), np.argmin(one.left.reshape(len(here), -1), axis=1)]
    groups = [(around[k, ~missing[k]], part[:, ~missing[k]], int(k)) for k, part in zip(here, share)]
    return _Shapes(groups, [part @ counts[k] for k, part in zip(here, share)], one)
