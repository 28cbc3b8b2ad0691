"""Faces of a cone: the directions in which the traction of each cell may move."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.rows import Rows

__all__ = ["Face", "Ray", "slanted", "straight"]

#: Eigenvalues of the projection's derivative below this count as zero: the direction is fixed.
FREE = 1e-10


@lru_cache(maxsize=16)
def straight(n: int, c: int) -> Floats:
    """Directions (cell, component, direction) equal to the components."""
    return np.broadcast_to(np.eye(c), (n, c, c))


def slanted(unit: Floats) -> Floats:
    """Directions (cell, component, direction) for cells on the cone |q| <= p at a unit shear (shear component, cell):
    the first is the generator, the second is normal to the cone, and the third (with two shears) is tangential around
    it.
    """
    c, root = len(unit) + 1, np.sqrt(0.5)
    basis = np.zeros((unit.shape[1], c, c))
    basis[:, :-1, 0], basis[:, -1, 0] = root * unit.T, root
    basis[:, :-1, 1], basis[:, -1, 1] = -root * unit.T, root
    if c == 3:
        basis[:, 0, 2], basis[:, 1, 2] = -unit[1], unit[0]
    return basis


class Face:
    """Free directions of every cell: some columns of an orthogonal matrix (cell, component, direction) that mixes the
    components of one cell.

    ``values`` (direction, cell) is the fraction of each direction that a projection keeps: directions with 0 are
    fixed.
    """

    def __init__(self, basis: Floats, values: Floats, mixed: bool) -> None:
        self.basis, self.free, self.mixed = basis, values > FREE, mixed
        self.index = np.flatnonzero(self.free.ravel())
        self.kept = values.ravel()[self.index]
        self.scales: Floats = np.ones(len(self.free))

    @cached_property
    def oblique(self) -> npt.NDArray[np.bool_]:
        """Cells whose directions are not the components."""
        if not self.mixed:
            return np.zeros(len(self.basis), dtype=bool)
        return np.asarray((self.basis != np.eye(len(self.free))).any(axis=(1, 2)))

    def spread(self, cells: Floats) -> Floats:
        """Expand a value per cell to one per free direction."""
        return np.asarray(cells[self.index % len(cells)])

    def rotate(self, x: Floats) -> Floats:
        """W'x for x (component, cell)."""
        return np.einsum("idk,di->ki", self.basis, x) if self.mixed else x

    def unrotate(self, x: Floats) -> Floats:
        """W x for x (direction, cell)."""
        return np.einsum("idk,ki->di", self.basis, x) if self.mixed else x

    def directions(self) -> Sparse:
        """W' (free direction, component * cell), without the cone's scales."""
        c, n = self.free.shape
        direction, cell = np.divmod(self.index, n)
        values = self.basis[cell, :, direction] * self.scales
        places = np.arange(c)[None, :] * n + cell[:, None]
        there = values != 0.0
        ends = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
        return scipy.sparse.csr_array((values[there], places[there], ends), shape=(len(cell), c * n))

    def columns(self, rows: Floats) -> Floats:
        """Product rows W for an array (m, component * cell)."""
        if not self.mixed:
            return np.asarray(rows[:, self.index])
        return np.asarray((self.directions() @ rows.T).T)

    def rows(self, rows: Rows) -> Rows:
        """Product rows W for sparse rows over (component, cell)."""
        c, n = self.free.shape
        if len(self.index) == c * n and not self.mixed and (self.scales == 1.0).all():
            return rows
        place = np.full((c, n), -1, dtype=np.intp)
        place.ravel()[self.index] = np.arange(len(self.index))
        if not self.oblique.any():
            col, row = place.ravel()[rows.col], rows.row
            value = rows.value * self.scales[rows.col // n]
            kept = col >= 0
        else:
            component, cell = np.divmod(rows.col, n)
            values = (rows.value * self.scales[component])[:, None] * self.basis[cell, component]
            col, value = place[:, cell].T.ravel(), values.ravel()
            row, kept = np.repeat(rows.row, c), (col >= 0) & (value != 0.0)
        return Rows(row[kept], col[kept], value[kept], rows.count)

    def gathered(self, columns: Floats, order: npt.NDArray[np.intp]) -> Floats:
        """W' columns for an array (component * cell, m), in a given order of the free directions."""
        places = self.index[order]
        out = np.ascontiguousarray(columns[places])
        if not self.mixed:
            return out
        c, n = self.free.shape
        direction, cell = np.divmod(places, n)
        turned = np.flatnonzero(self.oblique[cell])
        if len(turned):
            # Use a sparse product: one pass over the columns.
            weights = self.basis[cell[turned], :, direction[turned]]
            where = cell[turned][:, None] + n * np.arange(c)
            ends = np.arange(0, weights.size + 1, c)
            mixed = scipy.sparse.csr_array((weights.ravel(), where.ravel(), ends), shape=(len(turned), c * n))
            out[turned] = mixed @ columns
        return out

    def restrict(self, matrix: Floats) -> Floats:
        """W' matrix W of a symmetric matrix."""
        if not self.oblique.any():
            if len(self.index) == len(matrix):
                return matrix.copy()
            return np.asarray(matrix.take(self.index, axis=0).take(self.index, axis=1))
        every = np.arange(len(self.index))
        return self.gathered(np.ascontiguousarray(self.gathered(matrix, every).T), every)


class Ray(Face):
    """Free directions if the traction of all cells is one vector (component,) times a pressure, including changes of
    that vector.

    ``turned`` (change, component * cell) is the effect of the possible changes on the traction.
    """

    def __init__(self, ray: Floats, free: npt.NDArray[np.bool_], turned: Floats) -> None:
        c, n = len(ray), len(free)
        basis = np.zeros((n, c, c))
        basis[:, :, 0] = ray
        values = np.zeros((c, n))
        values[0] = free
        super().__init__(basis, values, True)
        self.turned = turned

    def directions(self) -> Sparse:
        return scipy.sparse.csr_array(scipy.sparse.vstack([super().directions(), scipy.sparse.csr_array(self.turned)]))

    def rows(self, rows: Rows) -> Rows:
        return replace(super().rows(rows), others=rows.times(self.turned.T))
