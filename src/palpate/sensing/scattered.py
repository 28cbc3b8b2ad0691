"""Readings at many scattered positions: a regular lattice by FFT, interpolated, with corrections nearby (precorrected
FFT).

The influence of a cell is smooth some cells away, so that it can be interpolated from its values on the lattice of
cell centres. For the few cells next to a position the exact influence is used instead (J. R. Phillips, J. K. White,
IEEE Trans. CAD 16, 1997, 1059-1072).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, to_numpy
from palpate._memory import require
from palpate.elastic.pad import Floats, Pad
from palpate.sensing.arrays import Array
from palpate.sensing.grids import Grid
from palpate.sensing.kernels import aperture_rule, influence

__all__ = ["NEAR", "STENCIL", "Lattice", "near_memory"]

#: Lattice points along each axis for the interpolation, and distance in cells up to which influences are exact. The
#: relative error of the influence of farther cells is 1e-4, and that of a reading of a contact about 1e-5
#: (tests/sensing/test_scattered.py).
STENCIL, NEAR = 8, 5


def near_memory(array: Array, grid: Grid) -> float:
    """Peak bytes while the map of ``array`` is built: exact influences with indices, twice, and the lattice's."""
    d = grid.dimensions
    pairs = len(array.points) * (2 * NEAR + 1) ** d * len(array.channels) * len(grid.components)
    lags = math.prod(2 * (n + 2 * STENCIL) for n in grid.shape)
    return 44.0 * pairs + 8.0 * lags * (10 + 8 * len(array.channels))


class Lattice:
    """The map of an array at any positions; ``far`` is the convolution on the lattice."""

    def __init__(self, pad: Pad, array: Array, grid: Grid, convolution: Any) -> None:
        """``convolution(pad, array, grid)`` builds the map of a regular array."""
        require(
            near_memory(array, grid),
            f"{len(array.points)} scattered positions and {math.prod(grid.shape)} surface cells",
            "Give a coarser surface, or grid the recording (Recording.gridded, palpate convert --grid).",
        )
        self.taxels, self.cells = array.shape, grid.shape
        self.rows, self.count = len(array.channels), len(grid.components)
        self._of = (pad, array, grid)
        points = array.points
        half = STENCIL // 2
        # Nodes at the cell centres, and beyond them as far as stencils extend.
        firsts, counts, bases, weights = [], [], [], []
        for axis, (x, dx) in enumerate(zip(grid.axes, grid.spacings)):
            place = (points[:, axis] - x[0]) / dx
            base = np.floor(place).astype(int)
            low = int(base.min()) - half + 1
            firsts.append(low)
            counts.append(int(base.max()) + half + 1 - low)
            bases.append(base)
            weights.append(_lagrange(place - base, half))
        self.far = convolution(pad, _nodes(array, grid, firsts, counts), grid)
        self._stencil = _stencils(bases, weights, firsts, counts, half)
        self._near = self._corrections(pad, array, grid, bases, weights, firsts, half)
        self._copies: dict[Any, tuple[Any, Any]] = {}

    @property
    def kernel(self) -> Floats:
        """Influence of a cell on lattice points (channel, component, *lag)."""
        return np.asarray(self.far.kernel)

    @property
    def size(self) -> tuple[int, ...]:
        """Size of the lattice's FFT."""
        return tuple(self.far.size)

    def forward(self, traction: Any, among: Sequence[int] | None = None) -> Any:
        values = to_numpy(traction)
        d = len(self.cells)
        batch = values.shape[: -1 - d]
        stencil, near = self._like(values, among)
        lattice = self.far.forward(values, among).reshape(-1, self.rows, self._stencil.shape[1])
        out = np.stack([(stencil @ part.T).T for part in lattice])  # (frame, channel, taxel)
        flat = values.reshape(len(out), -1)
        out += (near @ flat.T).T.reshape(out.shape)
        return from_numpy(out.reshape(*batch, self.rows, *self.taxels), traction)

    def adjoint(self, readings: Any, among: Sequence[int] | None = None) -> Any:
        values = to_numpy(readings)
        batch = values.shape[: -1 - len(self.taxels)]
        stencil, near = self._like(values, among)
        rows = values.reshape(-1, self.rows, math.prod(self.taxels))
        lattice = np.stack([(stencil.T @ part.T).T for part in rows]).reshape(len(rows), self.rows, *self.far.taxels)
        out = self.far.adjoint(lattice, among)
        out = out + (near.T @ rows.reshape(len(rows), -1).T).T.reshape(out.shape)
        return from_numpy(out.reshape(*batch, *out.shape[1:]), readings)

    def dense(self) -> Floats:
        """(channel, *taxels, component, *cells)."""
        count = self.count * math.prod(self.cells)
        unit = np.eye(count).reshape(count, self.count, *self.cells)
        return np.asarray(
            np.moveaxis(self.forward(unit), 0, -1).reshape(self.rows, *self.taxels, self.count, *self.cells)
        )

    def columns(self, component: int, cells: npt.NDArray[np.intp]) -> Floats:
        """(channel, taxel, cell): readings of unit traction in some ``cells`` (flat indices)."""
        unit = np.zeros((len(cells), 1, math.prod(self.cells)))
        unit[np.arange(len(cells)), 0, cells] = 1.0
        out = self.forward(unit.reshape(len(cells), 1, *self.cells), [component])
        return np.asarray(np.moveaxis(out.reshape(len(cells), self.rows, -1), 0, -1))

    def _like(self, values: npt.NDArray[Any], among: Sequence[int] | None) -> tuple[Any, Any]:
        """Stencils, and corrections for the components present, in the precision of ``values``."""
        key = (values.dtype, None if among is None else tuple(among))
        if key not in self._copies:
            cells = math.prod(self.cells)
            near = self._near
            if among is not None:
                near = near[:, np.concatenate([np.arange(i * cells, (i + 1) * cells) for i in among])]
            self._copies[key] = self._stencil.astype(values.dtype), near.astype(values.dtype)
        return self._copies[key]

    def _corrections(
        self,
        pad: Pad,
        array: Array,
        grid: Grid,
        bases: Sequence[npt.NDArray[np.intp]],
        weights: Sequence[Floats],
        firsts: Sequence[int],
        half: int,
    ) -> Any:
        """Exact minus interpolated influence of the cells near each position: sparse (channel * taxel, component *
        cell).
        """
        import scipy.sparse

        d, points = grid.dimensions, array.points
        reach = np.arange(-NEAR, NEAR + 1)
        steps = [(w[:, half] > w[:, half - 1]).astype(int) for w in weights]
        nearest = [b + step for b, step in zip(bases, steps)]
        rules = [aperture_rule(w, array.depth, dx, None) for w, dx in zip(array.apertures, grid.spacings)]
        parts = []
        chunk = max(1, 400_000 // len(reach) ** d)
        for start in range(0, len(points), chunk):
            some = slice(start, start + chunk)
            cells = [n[some, None] + reach for n in nearest]  # (taxel, cell) along each axis
            offsets = [
                points[some, axis, None] - (grid.axes[axis][0] + c * grid.spacings[axis])
                for axis, c in enumerate(cells)
            ]
            exact = influence(pad, offsets, grid.spacings, array.depth, array.channels, rules)
            guess = self._interpolated([w[some] for w in weights], [step[some] for step in steps], firsts)
            inside = np.ones(exact.shape[2:], dtype=bool)
            flat: Any = 0
            for axis, (c, n) in enumerate(zip(cells, grid.shape)):
                shape = [len(c)] + [1] * d
                shape[1 + axis] = len(reach)
                inside &= ((c >= 0) & (c < n)).reshape(shape)
                flat = flat * n + c.reshape(shape)
            flat = np.broadcast_to(flat, inside.shape)
            taxel = np.broadcast_to(np.arange(start, start + len(inside)).reshape(-1, *[1] * d), inside.shape)
            parts.append((taxel[inside], flat[inside], (exact - guess)[:, :, inside]))
        taxel = np.concatenate([p[0] for p in parts])
        cell = np.concatenate([p[1] for p in parts])
        value = np.concatenate([p[2] for p in parts], axis=2)
        rows = np.arange(self.rows)[:, None, None] * len(points) + taxel
        columns = np.arange(self.count)[None, :, None] * math.prod(grid.shape) + cell
        whole = np.broadcast_shapes(rows.shape, columns.shape)
        return scipy.sparse.csr_array(
            (
                value.ravel(),
                (
                    np.broadcast_to(rows, whole).ravel().astype(np.int32),
                    np.broadcast_to(columns, whole).ravel().astype(np.int32),
                ),
            ),
            shape=(self.rows * len(points), self.count * math.prod(grid.shape)),
        )

    def _interpolated(
        self, weights: Sequence[Floats], steps: Sequence[npt.NDArray[np.intp]], firsts: Sequence[int]
    ) -> Floats:
        """Interpolated influence of the near cells: (channel, component, taxel, *cell).

        The nearest cell is at the base of a stencil or ``steps`` = 1 further, so that near cells and nodes have only a
        few relative positions.
        """
        kernel, half, d = self.far.kernel, STENCIL // 2, len(weights)
        few = 2 * NEAR + 1
        out = np.empty((*kernel.shape[:2], len(weights[0]), *[few] * d))
        for way in itertools.product((0, 1), repeat=d):
            here = np.all([s == w for s, w in zip(steps, way)], axis=0)
            if not here.any():
                continue
            # Lag between node and cell, for each pair, and its index in the kernel.
            index = [
                (np.arange(1 - half, half + 1) - (np.arange(-NEAR, NEAR + 1) + w)[:, None]) - first + n - 1
                for w, first, n in zip(way, firsts, self.far.cells)
            ]
            index = [np.clip(i, 0, size - 1) for i, size in zip(index, kernel.shape[2:])]
            if d == 1:
                out[:, :, here] = np.einsum("abcs,ns->abnc", kernel[:, :, index[0]], weights[0][here])
                continue
            table = kernel[:, :, index[0][:, None, :, None], index[1][None, :, None, :]].reshape(
                *kernel.shape[:2], few**2, -1
            )
            both = (weights[0][here][:, :, None] * weights[1][here][:, None, :]).reshape(int(here.sum()), -1)
            out[:, :, here] = np.swapaxes(table @ both.T, 2, 3).reshape(*kernel.shape[:2], -1, few, few)
        return out


def _lagrange(t: Floats, half: int) -> Floats:
    """Weights (point, stencil) of the nodes 1 - half ... half for positions t from 0 to 1."""
    nodes = np.arange(1 - half, half + 1)
    out = np.ones((len(t), len(nodes)))
    for i, node in enumerate(nodes):
        for other in nodes:
            if other != node:
                out[:, i] *= (t - other) / (node - other)
    return out


def _stencils(
    bases: Sequence[npt.NDArray[np.intp]],
    weights: Sequence[Floats],
    firsts: Sequence[int],
    counts: Sequence[int],
    half: int,
) -> Any:
    """The interpolation as a sparse matrix (taxel, node)."""
    import scipy.sparse

    flat: Any = 0
    value: Any = 1.0
    d = len(bases)
    for axis, (base, weight, first, count) in enumerate(zip(bases, weights, firsts, counts)):
        shape = [len(base)] + [1] * d
        shape[1 + axis] = STENCIL
        flat = flat * count + (base[:, None] - half + 1 + np.arange(STENCIL) - first).reshape(shape)
        value = value * weight.reshape(shape)
    rows = np.repeat(np.arange(len(bases[0])), STENCIL**d)
    return scipy.sparse.csr_array(
        (value.ravel(), (rows.astype(np.int32), flat.ravel().astype(np.int32))),
        shape=(len(bases[0]), math.prod(counts)),
    )


def _nodes(array: Array, grid: Grid, firsts: Sequence[int], counts: Sequence[int]) -> Array:
    """The regular array at the lattice's nodes."""
    from palpate.sensing.arrays import AreaArray, LineArray

    centers = [
        x[0] + (first + 0.5 * (count - 1)) * dx for x, first, count, dx in zip(grid.axes, firsts, counts, grid.spacings)
    ]
    if grid.dimensions == 1:
        return LineArray(
            count=counts[0],
            pitch=grid.spacings[0],
            depth=array.depth,
            channels=array.channels,
            aperture=array.apertures[0],
            center=centers[0],
        )
    return AreaArray(
        shape=(counts[0], counts[1]),
        pitch=(grid.spacings[0], grid.spacings[1]),
        depth=array.depth,
        channels=array.channels,
        aperture=(array.apertures[0], array.apertures[1]),
        center=(centers[1], centers[0]),
    )
