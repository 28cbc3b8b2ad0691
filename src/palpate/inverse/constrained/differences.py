"""Finite differences on a surface grid; traction is zero beyond its edge."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.rows import Rows
from palpate.sensing.grids import Grid

__all__ = ["Differences", "Sparse"]

Sparse: TypeAlias = Any  # scipy.sparse.csr_array, which has no types


#: Sets of cells whose edges are cached.
CACHE_SIZE = 4


class Differences:
    """Differences along each axis of a grid; traction is zero beyond its edge."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self._touched: dict[bytes, tuple[list[npt.NDArray[np.intp]], Rows]] = {}
        self.along: list[Sparse] = []
        for axis, dx in enumerate(grid.spacings):
            product = None
            for other, n in enumerate(grid.shape):
                if other == axis:
                    factor = scipy.sparse.diags_array([np.ones(n), -np.ones(n)], offsets=[0, -1], shape=(n + 1, n)) / dx
                else:
                    factor = scipy.sparse.eye_array(n)
                product = factor if product is None else scipy.sparse.kron(product, factor)
            self.along.append(scipy.sparse.csr_array(product))

    @cached_property
    def laplacian(self) -> Sparse:
        """Matrix of int |grad t|^2, without the factor of the cell area."""
        return scipy.sparse.csr_array(sum(d.T @ d for d in self.along))

    @cached_property
    def squared(self) -> Sparse:
        """Matrix of the penalty on second derivatives: the squared Laplacian."""
        return scipy.sparse.csr_array(self.laplacian @ self.laplacian)

    @cached_property
    def _entries(self) -> tuple[npt.NDArray[np.intp], list[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]]]:
        """Cells of the diagonal entries of the Laplacian; and for each axis, the off-diagonal entries and their edges."""
        row = np.repeat(np.arange(math.prod(self.grid.shape)), np.diff(self.laplacian.indptr))
        places = np.unravel_index(np.maximum(row, self.laplacian.indices), self.grid.shape)
        apart = np.abs(row - self.laplacian.indices)
        off = []
        for axis, n in enumerate(self.grid.shape):
            step = math.prod(self.grid.shape[axis + 1 :])
            there = np.flatnonzero(apart == step) if n > 1 else np.zeros(0, dtype=np.intp)
            shape = tuple(m + (a == axis) for a, m in enumerate(self.grid.shape))
            off.append((there, np.ravel_multi_index(tuple(p[there] for p in places), shape)))
        return np.flatnonzero(apart == 0), off

    def even(self, order: int, weights: Sequence[float]) -> list[Sparse]:
        """Matrix of weight * int |D^order t|^2 for each weight, of ``order`` 1 or 2. All share one sparsity pattern."""
        power = self.laplacian if order == 1 else self.squared
        return [_with_entries(power, power.data * (weight * self.grid.cell)) for weight in weights]

    def local(self, tau: Floats) -> list[Sparse]:
        """Matrix of the sum over edges of |difference|^2/tau, for each tau (component, *grid) given on cells. All
        share one sparsity pattern.
        """
        on, off = self._entries
        data = np.zeros((len(tau), self.laplacian.nnz))
        diagonal: Floats = np.zeros(tau.shape)
        for axis, (dx, edges) in enumerate(zip(self.grid.spacings, self.on_edges(tau))):
            weight = 1.0 / (edges * dx**2)
            first, second = _both_ends(axis + 1, tau.ndim)
            diagonal += weight[first] + weight[second]
            there, edge = off[axis]
            data[:, there] = -weight.reshape(len(tau), -1)[:, edge]
        data[:, on] = diagonal.reshape(len(tau), -1)
        return [_with_entries(self.laplacian, d) for d in data]

    def about(self, shape: Floats, weights: Sequence[tuple[float, float]]) -> list[Sparse]:
        """Matrix of a * sum over edges of (difference of t/s)^2 + b * sum of (t/s)^2 over the cells with a ``shape`` s > 0,
        for each (a, b) of ``weights``: t is s times a factor that varies slowly. All share one sparsity pattern.
        """
        row = np.repeat(np.arange(len(shape)), np.diff(self.laplacian.indptr))
        col, on = self.laplacian.indices, self._entries[0]
        inverse = np.divide(1.0, shape, out=np.zeros_like(shape), where=shape > 0.0)
        between = np.where(row == col, 0.0, -inverse[row] * inverse[col])
        neighbours = np.bincount(row[between < 0.0], minlength=len(shape))
        out = []
        for a, b in weights:
            data = a * between
            data[on] = (a * neighbours + b) * inverse**2
            out.append(_with_entries(self.laplacian, data))
        return out

    def touching(self, cells: npt.NDArray[np.intp]) -> tuple[list[npt.NDArray[np.intp]], Rows]:
        """Edges (flat, for each axis) that cells touch, and the differences across them from these cells only. The
        last results are cached, because rounds use the same cells.
        """
        key = cells.tobytes()
        known = self._touched.get(key)
        if known is None:
            while len(self._touched) >= CACHE_SIZE:
                self._touched.pop(next(iter(self._touched)), None)
            known = self._touched[key] = self._touching(cells)
        return known

    def _touching(self, cells: npt.NDArray[np.intp]) -> tuple[list[npt.NDArray[np.intp]], Rows]:
        places = np.unravel_index(cells, self.grid.shape)
        n = len(cells)
        touched, row, value, count = [], [], [], 0
        for axis, dx in enumerate(self.grid.spacings):
            shape = tuple(m + (a == axis) for a, m in enumerate(self.grid.shape))
            both = [tuple(p + int(k and a == axis) for a, p in enumerate(places)) for k in (0, 1)]
            flat = np.concatenate([np.ravel_multi_index(b, shape) for b in both])
            edges, inverse = np.unique(flat, return_inverse=True)
            touched.append(edges)
            row.append(count + inverse)
            value.append(np.repeat([1.0 / dx, -1.0 / dx], n))
            count += len(edges)
        rows = np.concatenate(row)
        order = np.argsort(rows, kind="stable")
        place = np.tile(np.arange(n), 2 * len(touched))
        return touched, Rows(rows[order], place[order], np.concatenate(value)[order], count)

    def across(self, fields: Floats) -> list[Floats]:
        """Differences of fields (component, cell) across the edges of each axis: (component, edge)."""
        out: list[Floats] = []
        for axis, dx in enumerate(self.grid.spacings, start=1):
            shape = [n + 2 * (a == axis) for a, n in enumerate((len(fields), *self.grid.shape))]
            wide = np.zeros(shape)
            wide[tuple(slice(1, -1) if a == axis else slice(None) for a in range(len(shape)))] = fields.reshape(
                len(fields), *self.grid.shape
            )
            first, second = _both_ends(axis, len(shape))
            out.append(((wide[second] - wide[first]) / dx).reshape(len(fields), -1))
        return out

    def energy(self, squares: Sequence[Floats]) -> Floats:
        """Mean over the axes of squared differences on edges (component, edge), interpolated to the cells (component,
        *grid).
        """
        total: Floats = np.zeros(1)
        for axis, s in enumerate(squares):
            edges = s.reshape(len(s), *(m + (a == axis) for a, m in enumerate(self.grid.shape)))
            first, second = _both_ends(axis + 1, edges.ndim)
            total = total + 0.5 * (edges[first] + edges[second])
        return np.asarray(total / len(squares))

    def on_edges(self, cells: Floats) -> list[Floats]:
        """Fields (component, *grid) on cells, interpolated to the edges of each axis."""
        out: list[Floats] = []
        for axis in range(1, cells.ndim):
            first, second = _both_ends(axis, cells.ndim)
            ends = cells.take([0], axis=axis), cells.take([-1], axis=axis)
            padded = np.concatenate([ends[0], cells, ends[1]], axis=axis)
            out.append(0.5 * (padded[first] + padded[second]))
        return out


def _both_ends(axis: int, dimensions: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices for all but the last entry along an axis, and for all but the first."""
    return tuple(
        tuple(part if a == axis else slice(None) for a in range(dimensions))
        for part in (slice(None, -1), slice(1, None))
    )  # type: ignore[return-value]


def _with_entries(matrix: Sparse, data: Floats) -> Sparse:
    """A sparse matrix with other values and the same, shared sparsity pattern; SciPy's own constructor checks and
    copies the pattern each time.
    """
    out = copy.copy(matrix)
    out.data = data
    return out
