"""Factors of normal matrices H = G'G + P on the free directions: solutions, square roots of the covariance, variances.

If there are few readings G, H is not formed. P, a penalty on neighbouring cells, is banded and has a block Cholesky
factor (`Chain`); readings are added by the Woodbury identity (W. W. Hager, SIAM Rev. 31, 1989, 221-239),

    H^-1 = P^-1 - P^-1 G' S^-1 G P^-1,    S = 1 + G P^-1 G'.

Variances of sums over neighbouring cells only need entries of P^-1 near the diagonal (K. Takahashi, J. Fagan, M.-S.
Chin, PICA Conf. 1973, 63-69).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property, give_way
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.rows import Rows

__all__ = ["Beside", "Bordered", "Chain", "Dense", "Factor", "FewReadings", "Part", "cholesky", "each_of"]

Index = npt.NDArray[np.intp]

#: Smallest number of rows of a block: for smaller ones, the calls cost more than the work.
BLOCK = 48
#: Number of rows of a block in the factor, whose neighbours are coupled only in a corner: half as many calls, and less
#: work.
WIDTH = 64
#: Entries that a triangular factor solves at a time: a millisecond, for which SciPy holds the lock of Python.
PIECE = 60_000
#: Added to the diagonal, relative to it, if rounding makes a matrix indefinite.
JITTERS = (0.0, 1e-14, 1e-12, 1e-10, 1e-8)


class Factor(Protocol):
    """Interface of a factor of H on n free directions."""

    def solve(self, right: Floats) -> Floats:
        """H^-1 right, for a vector (n,)."""

    def inverse(self, right: Floats) -> Floats:
        """H^-1 right, for an array (n, k)."""

    def squares(self, rows: Floats) -> Floats:
        """Diagonal of rows H^-1 rows', for an array (k, n)."""

    def variances(self, rows: Rows) -> Floats:
        """Diagonal of rows H^-1 rows', for sparse rows (k, n)."""


def cholesky(matrix: Floats) -> Floats:
    """Lower Cholesky factor. If rounding makes the matrix indefinite, add as little of the identity as necessary."""
    from scipy.linalg import lapack

    # Call LAPACK directly: SciPy's checks take as long as a factor of a hundred unknowns. A symmetric matrix equals its
    # transpose, which is in LAPACK's memory order.
    factor, wrong = lapack.dpotrf(matrix.T if matrix.flags.c_contiguous else matrix, lower=1)
    if not wrong:
        return np.asarray(factor)
    diagonal = np.diagonal(matrix).copy()
    for jitter in JITTERS[1:]:
        matrix[np.diag_indices(len(matrix))] = diagonal * (1.0 + jitter) + jitter * diagonal.max(initial=0.0)
        factor, wrong = lapack.dpotrf(matrix, lower=1)
        if not wrong:
            return np.asarray(factor)
    raise np.linalg.LinAlgError("the quadratic program is not positive definite")


def _triangle(factor: Floats, right: Floats, *, transposed: bool = False) -> Floats:
    """L^-1 right, or L'^-1 right, for a lower factor."""
    from scipy.linalg import lapack

    if not factor.size or not right.size:
        return np.asarray(right, dtype=np.float64)
    columns = max(PIECE // len(right), 1)
    if right.ndim > 1 and right.shape[1] > columns:
        out = np.empty(right.shape, order="F")
        for start in range(0, right.shape[1], columns):
            give_way()
            part = slice(start, start + columns)
            out[:, part] = _triangle(factor, right[:, part], transposed=transposed)
        return out
    if factor.flags.f_contiguous:
        found, wrong = lapack.dtrtrs(factor, right, lower=1, trans=int(transposed))
    else:
        found, wrong = lapack.dtrtrs(factor.T, right, lower=0, trans=int(not transposed))
    if wrong:
        raise np.linalg.LinAlgError(f"a triangular factor is singular at entry {wrong}")
    return np.asarray(found)


class Dense:
    """The lower Cholesky factor of H."""

    def __init__(self, lower: Floats) -> None:
        self._lower = lower

    @cached_property
    def lower(self) -> Floats:
        return self._lower

    def solve(self, right: Floats) -> Floats:
        from scipy.linalg import lapack

        return np.asarray(lapack.dpotrs(self.lower, right, lower=1)[0]) if right.size else np.zeros(right.shape)

    def inverse(self, right: Floats) -> Floats:
        return _triangle(self.lower, _triangle(self.lower, right), transposed=True)

    def half(self, right: Floats) -> Floats:
        """Z = L^-1 right, so that Z'Z = right' H^-1 right."""
        return _triangle(self.lower, right)

    def squares(self, rows: Floats) -> Floats:
        return np.asarray((self.half(rows.T) ** 2).sum(axis=0))

    @cached_property
    def _inverse(self) -> Floats:
        """The lower triangle of H^-1."""
        from scipy.linalg import lapack

        return np.asarray(lapack.dpotri(self.lower, lower=1)[0]) if len(self.lower) else self.lower

    def variances(self, rows: Rows) -> Floats:
        if not len(self.lower):
            return np.zeros(rows.count)
        return rows.variances(lambda i, j: np.asarray(self._inverse[i, j]))

    def trace(self, matrix: Floats) -> float:
        """Trace of H^-1 matrix, for a symmetric matrix."""
        if not len(self.lower):
            return 0.0
        inverse = self._inverse  # zero above its diagonal, as the factor was
        return float(2.0 * np.einsum("ij,ij", inverse, matrix) - np.diagonal(inverse) @ np.diagonal(matrix))


class Beside(Dense):
    """Factor for the free unknowns plus ``some`` of the columns of ``tied`` = L^-1 B: L (``first``) is the factor of
    the former, ``left`` that of the Schur complement. Solving uses these parts; the whole factor is assembled at first
    use.
    """

    def __init__(self, first: Floats, tied: Floats, some: Index, left: Floats) -> None:
        self.first, self.tied, self.some, self.left = first, tied, some, left

    @cached_property
    def lower(self) -> Floats:
        n, k = self.tied.shape[0], len(self.some)
        out = np.zeros((n + k, n + k), order="F")
        out[:n, :n] = self.first
        out[n:, :n] = self.tied.take(self.some, axis=1).T
        out[n:, n:] = self.left
        return out

    def solve(self, right: Floats) -> Floats:
        n = len(self.tied)
        upper = _triangle(self.first, right[:n])
        rest: Floats = right[n:] - (upper @ self.tied)[self.some]
        rest = _triangle(self.left, _triangle(self.left, rest), transposed=True)
        whole: Floats = np.zeros(self.tied.shape[1])
        whole[self.some] = rest
        return np.concatenate([_triangle(self.first, upper - self.tied @ whole, transposed=True), rest])


class Chain:
    """Block Cholesky factor of a banded symmetric matrix; only neighbouring blocks are coupled.

    The matrix is given by its entries of the lower triangle (each once).
    """

    def __init__(self, size: int, row: Index, col: Index, value: Floats) -> None:
        self.size = size
        #: Neighbouring blocks are coupled in a corner only: the first rows of one with the last columns of the one
        #: before.
        self.reach = max(int((row - col).max(initial=0)), 1)
        width = max(self.reach, WIDTH)
        self.width = max(size if size <= 2 * width else width, 1)
        self.slices = [slice(k, min(k + self.width, size)) for k in range(0, size, self.width)]
        if not size:
            return
        diagonal = value[row == col]
        for jitter in JITTERS:
            more = np.where(row == col, value + jitter * (value + diagonal.max()), value) if jitter else value
            try:
                self._factorise(row, col, more)
                return
            except np.linalg.LinAlgError:
                continue
        raise np.linalg.LinAlgError("a penalty is not positive definite")

    def _factorise(self, row: Index, col: Index, value: Floats) -> None:
        from scipy.linalg import blas, lapack

        width, count, reach = self.width, len(self.slices), self.reach
        on, below = np.zeros((count, width, width)), np.zeros((count - 1, reach, reach))
        block, r = np.divmod(row, width)
        other, c = np.divmod(col, width)
        same = block == other
        on[block[same], r[same], c[same]] = value[same]
        beside = ~same
        below[other[beside], r[beside], c[beside] - (width - reach)] = value[beside]
        #: Upper factors U_k (L_k = U_k'), and the corners below them.
        self.upper: list[Floats] = []
        self.below: list[Floats] = []
        for k, place in enumerate(self.slices):
            n = place.stop - place.start
            here = on[k, :n, :n]
            if k:
                tied = below[k - 1, :n]
                # A L_k'^-1, in the memory of A: it is zero before the corner.
                corner = self.upper[-1][width - reach :, width - reach :]
                tied = blas.dtrsm(1.0, corner, tied.T, trans_a=1, overwrite_b=1).T
                self.below.append(tied)
                here[: len(tied), : len(tied)] -= tied @ tied.T
            factor, wrong = lapack.dpotrf(here.T, lower=0, overwrite_a=1)
            if wrong:
                raise np.linalg.LinAlgError("a penalty is not positive definite")
            self.upper.append(factor)

    def forward(self, right: Floats) -> Floats:
        """right L'^-1, in place, for rows (k, size) in column-major order (order F)."""
        from scipy.linalg import blas

        out = right
        for k, place in enumerate(self.slices):
            here = out[:, place]
            if k:
                tied = self.below[k - 1]
                here[:, : len(tied)] -= out[:, place.start - self.reach : place.start] @ tied.T
            found = blas.dtrsm(1.0, self.upper[k], here, side=1, overwrite_b=1)
            if found is not here:
                here[...] = found
        return out

    def backward(self, right: Floats) -> Floats:
        """right L^-1, in place, for rows (k, size) in column-major order (order F)."""
        from scipy.linalg import blas

        out = right
        for k in range(len(self.slices) - 1, -1, -1):
            here = out[:, self.slices[k]]
            if k + 1 < len(self.slices):
                tied, start = self.below[k], self.slices[k + 1].start
                here[:, self.width - self.reach :] -= out[:, start : start + len(tied)] @ tied
            found = blas.dtrsm(1.0, self.upper[k], here, side=1, trans_a=1, overwrite_b=1)
            if found is not here:
                here[...] = found
        return out

    def coloured(self, white: Floats) -> Floats:
        """white L', for rows (k, size): samples with the covariance of the matrix from white ones."""
        out = np.empty_like(white)
        for k, place in enumerate(self.slices):
            out[:, place] = white[:, place] @ np.triu(self.upper[k])
            if k:
                tied = self.below[k - 1]
                before = white[:, place.start - self.reach : place.start]
                out[:, place.start : place.start + len(tied)] += before @ tied.T
        return out

    @cached_property
    def _near(self) -> tuple[Floats, Floats]:
        """Blocks of the inverse: on the diagonal, and below it."""
        from scipy.linalg import blas

        count, width, reach = len(self.slices), self.width, self.reach
        on, below = np.zeros((count, width, width)), np.zeros((max(count - 1, 0), width, width))
        after = np.zeros((0, 0))
        for k in range(count - 1, -1, -1):
            # five times as fast as LAPACK's own inverse of a triangle
            inverse = blas.dtrsm(1.0, self.upper[k], np.eye(len(self.upper[k]), order="F"), overwrite_b=1)
            here = inverse @ inverse.T
            if k + 1 < count:
                tied = self.below[k] @ inverse[:, width - reach :].T
                down = after[:, : len(tied)] @ tied
                here += tied.T @ down[: len(tied)]
                below[k, : len(down)] = -down
            n = len(here)
            on[k, :n, :n] = after = here
        return on, below

    def entries(self, i: Index, j: Index) -> Floats:
        """Entries (i, j), i >= j, of the inverse; NaN unless they belong to one block or to neighbouring ones."""
        on, below = self._near
        (block, r), (other, c) = np.divmod(i, self.width), np.divmod(j, self.width)
        out = on[block, r, c]
        beside = np.flatnonzero(block != other)
        if len(beside):
            out[beside] = below[other[beside], r[beside], c[beside]]
            out[beside[block[beside] > other[beside] + 1]] = np.nan
        return np.asarray(out)


@dataclass(frozen=True)
class Part:
    """Consecutive free directions, from ``start``, whose penalty is ``scale`` times that of a chain.

    Equal parts are of the same cells: a chain is built once for each set of free cells.
    """

    start: int
    chain: Chain
    scale: float = 1.0

    @property
    def place(self) -> slice:
        return slice(self.start, self.start + self.chain.size)

    @property
    def log_determinant(self) -> float:
        """Log determinant of the penalty."""
        half = sum(float(np.log(np.diagonal(u)).sum()) for u in self.chain.upper) if self.chain.size else 0.0
        return 2.0 * half + self.chain.size * math.log(self.scale)


def each_of(parts: Sequence[Part], rows: Sequence[Floats], *, back: bool = False) -> list[Floats]:
    """rows L'^-1 (or L^-1), P = L L', for the rows (k, size) of each part; parts of one chain are solved together."""
    out: list[Floats] = list(rows)
    for chain in {id(p.chain): p.chain for p in parts}.values():
        mine = [i for i, p in enumerate(parts) if p.chain is chain]
        ends = np.cumsum([0] + [len(rows[i]) for i in mine])
        together = np.empty((int(ends[-1]), chain.size), order="F")
        for i, a, b in zip(mine, ends, ends[1:]):
            together[a:b] = rows[i]
        found = chain.backward(together) if back else chain.forward(together)
        for i, a, b in zip(mine, ends, ends[1:]):
            out[i] = found[a:b] if parts[i].scale == 1.0 else found[a:b] / math.sqrt(parts[i].scale)
    return out


class FewReadings:
    """H = G'G + P by the Woodbury identity.

    ``parts`` make up P on the free directions in the order ``order``; ``blocks`` (reading, direction) are G L'^-1 of
    the parts, P = L L', and ``lower`` is the lower factor of S.
    """

    def __init__(self, parts: Sequence[Part], order: Index, blocks: Sequence[Floats], lower: Floats) -> None:
        self.parts, self.order, self.blocks, self.lower = parts, order, blocks, lower

    @cached_property
    def b(self) -> Floats:
        """G L'^-1 (reading, direction)."""
        return self.blocks[0] if len(self.blocks) == 1 else np.concatenate([b.T for b in self.blocks]).T

    def log_evidence(self, linear: Floats) -> float:
        """Log marginal likelihood, relative to noise alone, of the Gaussian model with normal equations H x =
        ``linear``.
        """
        return 0.5 * float(self.squares(linear[None])[0]) - float(np.log(np.diagonal(self.lower)).sum())

    def _split(self, rows: Floats) -> list[Floats]:
        return [rows[:, p.place] for p in self.parts]

    def solve(self, right: Floats) -> Floats:
        ordered = right[self.order]
        half = each_of(self.parts, [ordered[None, p.place] for p in self.parts])
        seen = _triangle(self.lower, sum(b @ h[0] for b, h in zip(self.blocks, half)))
        seen = _triangle(self.lower, seen, transposed=True)
        rest = each_of(self.parts, [h - (seen @ b)[None] for b, h in zip(self.blocks, half)], back=True)
        out = np.empty(len(right))
        out[self.order] = np.concatenate([r[0] for r in rest])
        return out

    @cached_property
    def _raised(self) -> Floats:
        """L + 1."""
        out = self.lower.copy(order="F")
        out.ravel(order="K")[:: len(out) + 1] += 1.0
        return out

    def inverse(self, right: Floats) -> Floats:
        return self.back(self.half(right))

    def squares(self, rows: Floats) -> Floats:
        return np.asarray((self.half(rows.T) ** 2).sum(axis=0))

    def half(self, right: Floats) -> Floats:
        """F right, with F'F = H^-1, by A. Andrews' square root (AIAA J. 6, 1968, 1165-1166): for 1 + B'B = L L', (1 -
        B L'^-1 (L + 1)^-1 B')' P^(-1/2).
        """
        rows = np.concatenate([r.T for r in each_of(self.parts, self._split(right[self.order].T))]).T
        seen = _triangle(self.lower, self.b @ rows.T)
        seen = _triangle(self._raised, seen, transposed=True)
        return np.asarray((rows - seen.T @ self.b).T)

    def back(self, half: Floats) -> Floats:
        """F' half."""
        seen = _triangle(self._raised, self.b @ half)
        seen = _triangle(self.lower, seen, transposed=True)
        out = np.empty_like(half)
        rest = each_of(self.parts, self._split(half.T - seen.T @ self.b), back=True)
        out[self.order] = np.concatenate([r.T for r in rest])
        return out

    def taken(self) -> Floats:
        """Degrees of freedom that H uses of each reading: the diagonal of G H^-1 G' = 1 - S^-1."""
        return 1.0 - (_triangle(self.lower, np.eye(len(self.lower))) ** 2).sum(axis=0)

    @cached_property
    def _seen(self) -> Floats:
        """Q (direction, reading) with P^-1 - Q Q' = H^-1, in the order of the parts."""
        out = np.empty((len(self.order), len(self.lower)))
        for part, block in zip(self.parts, self.blocks):
            here = out[part.place].T
            here[...] = _triangle(self.lower, block)
            part.chain.backward(here)
            if part.scale != 1.0:
                here /= math.sqrt(part.scale)
        return out

    def variances(self, rows: Rows) -> Floats:
        rank = np.empty(len(self.order), dtype=np.intp)
        rank[self.order] = np.arange(len(self.order))
        ordered = Rows(rows.row, rank[rows.col], rows.value, rows.count)
        ends = [p.start + p.chain.size for p in self.parts]

        def entries(i: Index, j: Index) -> Floats:
            if len(self.parts) == 1:
                return self.parts[0].chain.entries(i, j) / self.parts[0].scale
            part = np.searchsorted(ends, i, side="right")
            inside = part == np.searchsorted(ends, j, side="right")
            out = np.zeros(len(i))
            for k, p in enumerate(self.parts):
                mine = np.flatnonzero(inside & (part == k))
                out[mine] = p.chain.entries(i[mine] - p.start, j[mine] - p.start) / p.scale
            return out

        prior = ordered.variances(entries)
        if np.isnan(prior).any():
            return np.asarray((self.half(rows.times(np.eye(len(self.order))).T) ** 2).sum(axis=0))
        return np.maximum(prior - (ordered.times(self._seen) ** 2).sum(axis=1), 0.0)


@dataclass(frozen=True)
class Bordered:
    """Factor of H with a few more unknowns: ``moved`` (n, k) is H^-1 times their coupling, ``corner`` the lower factor
    of their Schur complement.
    """

    inner: Factor
    moved: Floats
    corner: Floats

    @classmethod
    def of(cls, inner: Factor, border: Floats, corner: Floats) -> Bordered:
        """Build the factor; ``border`` (n, k) and ``corner`` (k, k) are the other blocks of H."""
        moved = inner.inverse(border)
        tied = border.T @ moved
        return cls(inner, moved, cholesky(corner - 0.5 * (tied + tied.T)))

    def inverse(self, right: Floats) -> Floats:
        n = len(self.moved)
        lower = _triangle(self.corner, right[n:] - self.moved.T @ right[:n])
        lower = _triangle(self.corner, lower, transposed=True)
        return np.concatenate([self.inner.inverse(right[:n]) - self.moved @ lower, lower])

    def squares(self, rows: Floats) -> Floats:
        n = len(self.moved)
        left = rows[:, n:] - rows[:, :n] @ self.moved
        return self.inner.squares(rows[:, :n]) + (_triangle(self.corner, left.T) ** 2).sum(axis=0)

    def solve(self, right: Floats) -> Floats:
        return self.inverse(right[:, None])[:, 0]

    def variances(self, rows: Rows) -> Floats:
        own = replace(rows, others=None)
        if rows.others is None or not rows.others.size:
            return self.inner.variances(own)
        # Schur complement of the inner unknowns.
        left = rows.others - own.times(self.moved)
        return self.inner.variances(own) + (_triangle(self.corner, left.T) ** 2).sum(axis=0)
