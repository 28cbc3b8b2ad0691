"""Normal matrices H = G'G + P, for whitened readings G and a penalty P that couples neighbouring cells of each
component.

They are stored as a matrix if there are many readings, or as factors if there are few readings per cell (a finer grid
under a small array).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.factors import (
    BLOCK,
    Beside,
    Chain,
    Dense,
    Factor,
    FewReadings,
    Part,
    cholesky,
    each_of,
)

if TYPE_CHECKING:
    from palpate.inverse.constrained.faces import Face

__all__ = ["Formed", "Penalty", "Quadratic", "Unformed", "formed_or_not", "prior_factor", "work_of_few"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: Smaller systems are always formed as a matrix.
MIN_UNFORMED_UNKNOWNS = 150
#: Largest number of entries of a penalty for which direct sums are faster than building a sparse matrix.
SUMMED = 20_000


class Quadratic(Protocol):
    """A symmetric, positive definite matrix over (component, cell)."""

    @property
    def by_products(self) -> bool:
        """Whether only products are available."""

    @property
    def slow(self) -> bool:
        """Whether a solution by them was slow."""

    def product(self, x: Floats) -> Floats:
        """H x for x (component, cell)."""

    def diagonal(self) -> Floats:
        """Diagonal of H (component * cell,)."""

    def scaled(self, scales: Floats) -> Quadratic:
        """S H S, with one scale per component."""

    def factor(self, face: Face, more: Floats) -> Factor:
        """Factor of W'HW + diag(more) on the free directions W of a face."""

    def exactly(self) -> Quadratic:
        """Return the quadratic form in a representation that can be factorised exactly, if there is one."""

    def dense(self) -> Floats:
        """H as an array (component * cell, component * cell)."""


class Formed:
    """A quadratic form with an explicit matrix."""

    by_products = slow = False

    def __init__(self, matrix: Floats) -> None:
        self.matrix = matrix
        self._asked = False  # whether a factor with free shear was requested before
        self._shear: tuple[Floats, Floats, Floats] | None = None

    def _beside(self, pressing: Index, shear: int) -> Dense:
        """The factor if all shear is free and pressure only in some cells: shear is eliminated once, and the rest is
        small.
        """
        from scipy.linalg import blas

        if self._shear is None:
            factor = cholesky(self.matrix[:shear, :shear])
            tied = blas.dtrsm(1.0, factor, self.matrix[shear:, :shear].T, lower=1)
            self._shear = factor, tied, self.matrix[shear:, shear:] - tied.T @ tied
        factor, tied, left = self._shear
        return Beside(factor, tied, pressing, cholesky(left.take(pressing, axis=0).take(pressing, axis=1)))

    def product(self, x: Floats) -> Floats:
        return np.asarray(self.matrix @ x.ravel()).reshape(x.shape)

    def diagonal(self) -> Floats:
        return np.diagonal(self.matrix)

    def scaled(self, scales: Floats) -> Formed:
        out, n = self.matrix.copy(), len(self.matrix) // len(scales)
        for i, scale in enumerate(scales):
            if scale != 1.0:  # most components keep their scale
                out[i * n : (i + 1) * n] *= scale
                out[:, i * n : (i + 1) * n] *= scale
        return Formed(out)

    def factor(self, face: Face, more: Floats) -> Factor:
        c, n = face.free.shape
        if c > 1 and not face.mixed and face.free[:-1].all() and not more.any():
            pressing = np.flatnonzero(face.free[-1])
            # If some cells are fixed now, more steps of this kind follow: reuse the Schur complement of shear.
            if self._asked or n // 2 < len(pressing) < n:
                return self._beside(pressing, (c - 1) * n)
            self._asked = True
        reduced = face.restrict(self.matrix)
        if more.any():
            reduced[np.diag_indices(len(reduced))] += more
        return Dense(cholesky(reduced))

    def exactly(self) -> Formed:
        return self

    def dense(self) -> Floats:
        return self.matrix


class Penalty:
    """Penalties of all components on the same cells: entries (row, col), values (component, entry).

    The penalties ``each`` of the components share one sparsity pattern.
    """

    def __init__(self, cells: Index, each: Sequence[Sparse], shape: tuple[int, ...]) -> None:
        self.cells, self.shape = cells, shape
        self.row, self.col, entry = _within(each[0], cells)
        for name in ("indices", "indptr"):
            first, *others = (getattr(q, name) for q in each)
            if not all(o is first or np.array_equal(o, first) for o in others):
                raise ValueError("the penalties of the components need one sparsity pattern")
        self.values = np.stack([q.data[entry] for q in each])
        self._order()

        #: Cached chains of free cells: the first one (with free shear) and the last.
        self._made: list[tuple[Flags, Floats, Chain]] = []

    def _order(self) -> None:
        """Order the cells so that the bandwidth is small."""
        n = len(self.cells)
        self.rank = np.arange(n)
        self.reach = int(np.abs(self.row - self.col).max(initial=0))
        if len(self.shape) == 2 and n:
            y, x = np.divmod(self.cells, self.shape[1])
            other = np.empty(n, dtype=np.intp)
            other[np.lexsort((y, x))] = np.arange(n)
            reach = int(np.abs(other[self.row] - other[self.col]).max(initial=0))
            if reach < self.reach:
                self.rank, self.reach = other, reach

    def scaled(self, scales: Floats) -> Penalty:
        out = copy.copy(self)
        out.__dict__.pop("_whole", None)
        out._made = []
        out.values = self.values * scales[:, None] ** 2
        return out

    @cached_property
    def _whole(self) -> Sparse:
        """Sparse matrix over (component, cell)."""
        c, n = len(self.values), len(self.cells)
        counts = np.tile(np.bincount(self.row, minlength=n), c)
        col = (self.col + n * np.arange(c)[:, None]).ravel()
        starts = np.concatenate([[0], np.cumsum(counts)])
        return scipy.sparse.csr_array((self.values.ravel(), col, starts), shape=(c * n, c * n))

    @cached_property
    def _lower(self) -> Flags:
        """Mask of the entries of the lower triangle, in the order of ranks."""
        return np.asarray(self.rank[self.row] >= self.rank[self.col])

    def product(self, x: Floats) -> Floats:
        """P x for x (component, cell)."""
        if self.values.size > SUMMED:
            return np.asarray(self._whole @ x.ravel()).reshape(x.shape)
        return np.asarray(np.add.reduceat(self.values * x.take(self.col, axis=1), self._starts, axis=1))

    @cached_property
    def _starts(self) -> Index:
        """The index of the first entry of each row; no row is empty."""
        return np.flatnonzero(np.diff(self.row, prepend=-1))

    def many(self, x: Any) -> Any:
        """P x for x (k, component, cell)."""
        return np.asarray((self._whole @ x.reshape(len(x), -1).T).T, dtype=x.dtype).reshape(x.shape)

    def perturbed(self, rng: np.random.Generator, count: int) -> Floats:
        """Samples (count, component, cell) of a Gaussian with covariance P."""
        n = len(self.cells)
        out = np.empty((count, len(self.values), n))
        order = np.argsort(self.rank)
        lower = self._lower
        row, col = self.rank[self.row[lower]], self.rank[self.col[lower]]
        chain: Chain | None = None
        for i, value in enumerate(self.values):
            if chain is None or not _in_proportion(self.values[0], value):
                chain, unit = Chain(n, row, col, value[lower]), value
            scale = np.sqrt(value[0] / unit[0]) if len(value) else 1.0
            out[:, i, order] = scale * chain.coloured(rng.standard_normal((count, n)))
        return out

    def diagonal(self) -> Floats:
        return self.values[:, self.row == self.col].ravel()

    def added(self, matrix: Floats) -> Floats:
        """Add the penalty to a matrix (component * cell, component * cell), in place."""
        n = len(self.cells)
        for i, value in enumerate(self.values):
            matrix[i * n + self.row, i * n + self.col] += value
        return matrix

    def dense(self) -> Floats:
        """P as an array (component * cell, component * cell)."""
        return self.added(np.zeros((self.values.shape[0] * len(self.cells),) * 2))

    def parts(self, face: Face, more: Floats) -> tuple[list[Part], Index]:
        """W'PW + diag(more) on the free directions of a face, as parts; and the order of the directions."""
        lower = self._lower
        row, col, values = self.row[lower], self.col[lower], self.values[:, lower]
        return self._mixed(face, more, row, col, values) if face.mixed else self._apart(face, more, row, col, values)

    def _apart(self, face: Face, more: Floats, row: Index, col: Index, values: Floats) -> tuple[list[Part], Index]:
        """Parts for each component by itself; components with proportional penalties share a factor."""
        parts: list[Part] = []
        orders: list[Index] = []
        n, start = len(self.cells), 0
        last: tuple[Flags, Index, Index, Flags, Index, Index] | None = None
        for free, value in zip(face.free, values):
            if last is None or not np.array_equal(last[0], free):
                cells = np.flatnonzero(free)
                ranked = np.argsort(self.rank[cells])
                place = np.full(n, -1)
                place[cells[ranked]] = np.arange(len(cells))
                kept = free[row] & free[col]
                last = free, cells, ranked, kept, place[row[kept]], place[col[kept]]
            _, cells, ranked, kept, r, c = last
            extra = more[start : start + len(cells)]
            orders.append(start + ranked)
            plain = not extra.any()
            same = next(
                (m for m in self._made if plain and np.array_equal(m[0], free) and _in_proportion(m[1], value)), None
            )
            if same is not None:
                parts.append(Part(start, same[2], float(value[0] / same[1][0])))
            else:
                v = value[kept]
                if not plain:
                    v = np.where(r == c, v + extra[ranked][r], v)
                chain = Chain(len(cells), r, c, v)
                parts.append(Part(start, chain))
                if plain and len(value):
                    self._made.append((free, value, chain))
                    del self._made[1:-1]
            start += len(cells)
        return parts, np.concatenate(orders)

    def _mixed(self, face: Face, more: Floats, row: Index, col: Index, values: Floats) -> tuple[list[Part], Index]:
        """One part for all components together, cell by cell."""
        c, n = face.free.shape
        direction, cell = np.divmod(face.index, n)
        order = np.argsort(self.rank[cell] * c + direction)
        place = np.full((c, n), -1)
        place[direction[order], cell[order]] = np.arange(len(order))
        blocks = np.zeros((len(row), c, c))
        blocks[:, np.arange(c), np.arange(c)] = values.T
        some = face.oblique[row] | face.oblique[col]
        left = face.basis[row[some]].transpose(0, 2, 1) * values.T[some][:, None, :]
        blocks[some] = left @ face.basis[col[some]]
        i = np.broadcast_to(place.T[row][:, :, None], blocks.shape)
        j = np.broadcast_to(place.T[col][:, None, :], blocks.shape)
        kept = (j >= 0) & (i >= j)
        i, j, value = i[kept], j[kept], blocks[kept]
        value = np.where(i == j, value + more[order][i], value)
        return [Part(0, Chain(len(order), i, j, value))], order


class Unformed:
    """A matrix stored as readings and penalty."""

    by_products = slow = False

    def __init__(self, columns: Floats, penalty: Penalty) -> None:
        #: G' as ``columns`` (component * cell, reading).
        self.columns, self.penalty = columns, penalty
        #: The parts of the last factor, with their G L'^-1 and its Gram matrix: free shear does not change between
        #: steps.
        self._known: list[tuple[Part, Floats, Floats]] = []

    def product(self, x: Floats) -> Floats:
        return (self.columns @ (x.ravel() @ self.columns)).reshape(x.shape) + self.penalty.product(x)

    def diagonal(self) -> Floats:
        return np.einsum("ij,ij->i", self.columns, self.columns) + self.penalty.diagonal()

    def scaled(self, scales: Floats) -> Unformed:
        rows = np.repeat(scales, len(self.columns) // len(scales))
        return Unformed(self.columns * rows[:, None], self.penalty.scaled(scales))

    def factor(self, face: Face, more: Floats) -> FewReadings:
        parts, order = self.penalty.parts(face, more)
        known = [next((k for k in self._known if k[0] == p), None) for p in parts]
        new = [p for p, k in zip(parts, known) if k is None]
        found = iter(each_of(new, [face.gathered(self.columns, order[p.place]).T for p in new]))
        self._known = [k or (p, b := next(found), b @ b.T) for p, k in zip(parts, known)]
        total = np.eye(self.columns.shape[1])
        for *_, product in self._known:
            total += product
        return FewReadings(parts, order, [b for _, b, _ in self._known], cholesky(total))

    def exactly(self) -> Unformed:
        return self

    def dense(self) -> Floats:
        return self.penalty.added(self.columns @ self.columns.T)


def formed_or_not(
    columns: Callable[[], Floats], readings: int, gram: Callable[[], Floats], penalty: Penalty
) -> Quadratic:
    """H of ``readings`` readings and a penalty, formed or not, whichever is faster. ``columns()`` returns G'
    (component * cell, reading), ``gram()`` returns G'G.
    """
    size = len(penalty.values) * len(penalty.cells)
    # A factor and the variances: of a matrix, the inverse takes twice as long as the factor.
    few = work_of_few(size, readings, penalty.reach) + size * readings**2
    if size >= MIN_UNFORMED_UNKNOWNS and readings < size and few < size**3:
        return Unformed(np.ascontiguousarray(columns()), penalty)
    return Formed(penalty.added(gram().copy()))


def work_of_few(unknowns: int, readings: int, reach: int) -> float:
    """Number of multiplications for a factor of `Unformed`, if the penalty couples unknowns up to ``reach`` apart."""
    wide = max(reach, BLOCK)
    return unknowns * wide * (2.4 * wide + 2.0 * readings) + unknowns * readings**2 + readings**3 / 3.0


def prior_factor(penalty: Penalty, face: Face) -> Factor:
    """Factor of the penalty alone on the free directions of a face."""
    parts, order = penalty.scaled(face.scales).parts(face, np.zeros(len(face.index)))
    return FewReadings(parts, order, [np.zeros((0, p.chain.size)) for p in parts], np.zeros((0, 0)))


def _within(q: Sparse, cells: Index) -> tuple[Index, Index, Index]:
    """Entries of a sparse matrix between some rows and columns, row by row: their positions and storage indices."""
    n = len(cells)
    place = np.full(q.shape[1], -1, dtype=np.intp)
    place[cells] = np.arange(n)
    starts, counts = q.indptr[cells], np.diff(q.indptr)[cells]
    row = np.repeat(np.arange(n), counts)
    entry = np.arange(len(row)) + np.repeat(starts - (np.cumsum(counts) - counts), counts)
    col = place[q.indices[entry]]
    kept = col >= 0
    return row[kept], col[kept], entry[kept]


def _in_proportion(a: Floats, b: Floats) -> bool:
    return a is b or bool((np.abs(a * (b[0] / a[0]) - b) <= 1e-13 * np.abs(b)).all())
