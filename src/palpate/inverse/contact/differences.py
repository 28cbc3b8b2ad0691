"""Finite differences on a surface grid, traction being zero beyond its edge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse

from palpate.elastic.pad import Floats
from palpate.sensing.grids import Grid

__all__ = ["Differences", "Sparse"]

Sparse: TypeAlias = Any  # scipy.sparse.csr_array, which has no types


class Differences:
    """Differences along each axis of a grid, traction being zero beyond its edge."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
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
        self.laplacian: Sparse = self._sum([d.T @ d for d in self.along])

    @staticmethod
    def _sum(terms: Sequence[Sparse]) -> Sparse:
        total = terms[0]
        for term in terms[1:]:
            total = total + term
        return scipy.sparse.csr_array(total)

    def even(self, order: int, weight: float) -> Sparse:
        """weight * int |D^order t|^2, as a matrix."""
        power = self.laplacian if order == 1 else self.laplacian @ self.laplacian
        return scipy.sparse.csr_array(power * (weight * self.grid.cell))

    def local(self, tau: Floats) -> Sparse:
        """sum over edges of |difference|^2/tau, tau being given on cells."""
        return self._sum(
            [d.T @ scipy.sparse.diags_array(1.0 / e.ravel()) @ d for d, e in zip(self.along, self.on_edges(tau))]
        )

    def energy(self, squares: Sequence[Floats]) -> Floats:
        """Mean over the axes of squared differences on edges, brought to the cells."""
        total: Floats = np.zeros(self.grid.shape)
        for axis, s in enumerate(squares):
            n = self.grid.shape[axis]
            edges = s.reshape(tuple(m + (a == axis) for a, m in enumerate(self.grid.shape)))
            total = total + 0.5 * (edges.take(range(n), axis=axis) + edges.take(range(1, n + 1), axis=axis))
        return total / len(squares)

    def on_edges(self, cells: Floats) -> list[Floats]:
        """A field on cells brought to the edges of each axis."""
        out: list[Floats] = []
        for axis, n in enumerate(cells.shape):
            width = [(0, 0)] * cells.ndim
            width[axis] = (1, 1)
            padded = np.pad(cells, width, mode="edge")
            out.append(0.5 * (padded.take(range(n + 1), axis=axis) + padded.take(range(1, n + 2), axis=axis)))
        return out
