"""Cells where contact is sought, and the inverse kept for them.

The normal matrix of the whole surface is computed once. A region's part of it, with the penalty and rho added, is
inverted once and serves every frame until the region, the penalty or the set of readings changes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import dilated
from palpate.inverse.constrained.products import Applied
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.tracking.gram import Grams, picked
from palpate.tracking.health import Flags, Float32, Index
from palpate.tracking.inverting import inverse
from palpate.tracking.pieces import lower_factor

__all__ = ["SMALLEST", "NormalEquations", "Region", "on_surface"]

#: Largest number of entries of a cached normal matrix of the whole surface: 160 MB in double precision.
LARGEST = 20_000_000
#: Columns of the matrix computed at a time.
BLOCK = 1024
#: Ratio of smallest to largest eigenvalue of the normal matrix below which it is indistinguishable from zero: single
#: precision (6e-8) and sums of some hundred products allow no more.
SMALLEST = 1e-9
#: Relative amount by which the inverse is reduced. Rounding to single precision changes rho (H + rho)^-1, at most 1, by
#: about 6e-8 times the square root of its size (hundreds), and must not make it exceed 1.
SHRINK = 1e-6
#: Largest change of the penalty without a new rho. rho goes at most with the root of the penalty, and within a factor
#: of 1.4 the iteration is as fast.
RHO_HOLDS = 2.0
#: Steps of Lanczos' method: an eigenvalue to a few per cent is enough for rho.
LANCZOS_STEPS = 8


@dataclass(frozen=True)
class Region:
    """Cells where contact is sought, and the matrices that solve for it.

    ``border`` (cell) marks those at the region's edge. ``inverse`` is (H + rho)^-1 with unknowns scaled as by
    `Cone.scales`, valid for a ``parameter`` of the penalty and for the readings that are not ``unused``. ``shared``
    (channel, unknown) is B'A, where B are the offsets of the channels; ``solved`` is (H + rho)^-1 A'B and ``overlap``
    B'A (H + rho)^-1 A'B, by which offsets are marginalised (M. A. Woodbury, Inverting modified matrices, 1950).
    """

    cells: Index
    border: Flags
    inverse: Float32
    rho: float
    parameter: float
    unused: Flags
    shared: Floats
    solved: Float32
    overlap: Floats

    def correction(self, gain: Floats) -> tuple[Float32, Float32]:
        """Factors (unknown, channel) and (channel, unknown) of the term added to ``inverse`` when offsets are
        marginalised with K = ``gain``.
        """
        middle = gain @ np.linalg.inv(np.eye(len(gain)) - self.overlap @ gain)
        return self.solved, middle.astype(np.float32) @ self.solved.T


class NormalEquations:
    """A'A and A'y of whitened readings, prepared once for a tracker."""

    def __init__(self, estimator: ConstrainedEstimator, columns: Floats) -> None:
        self.estimator = estimator
        self._columns = columns  # of the channels' offsets (reading, channel)
        self._shared: tuple[bytes, Floats] | None = None
        self._grams = Grams(estimator)
        self._adjoints: tuple[tuple[Floats, Flags, Floats], ...] = ()  # the last two
        self._std = estimator.readings.std
        self._cells = math.prod(estimator.operator.surface.shape)
        # Double precision: in single precision the matrix has negative eigenvalues, along which the iteration diverges.
        self._normal: Floats | None = None
        self.diagonal = self._prepare()
        self._norm = np.sqrt(np.maximum(self.diagonal, 1e-300))
        self._rho: tuple[float, float] | None = None
        self._last: Region | None = None

    def _prepare(self) -> Floats:
        """Compute the normal matrix of the whole surface if it fits in memory; the diagonal for pressure always."""
        estimator, columns = self.estimator, self.estimator.columns
        level = estimator.level(1)
        everything = np.ones(len(self._std), dtype=bool)
        diagonal = np.empty(self._cells)
        unknowns = len(columns) * self._cells
        if unknowns**2 > LARGEST and estimator.at_size:
            every = Applied(
                level.boxes, estimator.readings, level.grid.shape, np.arange(self._cells), self._std, everything
            )
            return np.asarray(every.squares.reshape(len(columns), -1)[-1])
        parts = []
        for start in range(0, self._cells, BLOCK):
            cells = np.arange(start, min(start + BLOCK, self._cells))
            matrix = level.matrix(cells, self._std, everything)
            diagonal[cells] = (matrix[:, -len(cells) :] ** 2).sum(axis=0)
            if unknowns**2 <= LARGEST:
                parts.append(matrix.reshape(len(matrix), len(columns), len(cells)))
        if parts:
            whole = np.concatenate(parts, axis=2).reshape(len(self._std), -1)
            self._normal = whole.T @ whole
        return diagonal

    def reset(self) -> None:
        """Forget rho, which was chosen for the first region of a penalty."""
        self._rho = self._last = None

    def adjoint(self, y: Floats, unused: Flags) -> Floats:
        """A' y of whitened readings, (component, cell)."""
        for kept in self._adjoints:  # the same frame is requested several times
            if np.array_equal(kept[0], y) and np.array_equal(kept[1], unused):
                return kept[2]
        kept = y.copy(), unused.copy(), self.adjoint_of(y, unused)
        self._adjoints = kept, *self._adjoints[:1]
        return kept[2]

    def adjoint_of(self, y: Floats, unused: Flags) -> Floats:
        """`adjoint` without a cache."""
        return self.estimator.misfit_gradient(y, self._std, ~unused)

    def shared(self, unused: Flags) -> Floats:
        """A'B, (channel, component, cell), for the readings in use."""
        key, kept = unused.tobytes(), self._shared
        if kept is None or kept[0] != key:
            kept = self._shared = key, np.stack([self.adjoint_of(b, unused) for b in self._columns.T])
        return kept[1]

    def of_offsets(self, offsets: Floats, unused: Flags) -> Floats:
        """A'B c, (component, cell), of offsets c (channel,)."""
        return np.asarray(np.tensordot(offsets, self.shared(unused), 1))

    def score(self, adjoint: Floats) -> Floats:
        """Pressure of each cell alone, in standard deviations under unit noise."""
        return np.asarray(adjoint[-1] / self._norm)

    def explained(self, cells: Index | None, traction: Floats, *, single: bool = False) -> Floats:
        """Whitened readings that a traction (component, cell) on some cells predicts; ``single`` takes half the time."""
        if cells is None:
            return np.zeros(len(self._std))
        whole = np.zeros((len(self.estimator.columns), self._cells), dtype=np.float32 if single else np.float64)
        whole[:, cells] = traction
        return self.estimator.explained_by(whole) / self._std

    def region(self, cells: Index, parameter: float, unused: Flags) -> Region:
        """The region of some cells: normal matrix with the penalty, and its inverse. The last one is cached."""
        last = self._last
        if (
            last is None
            or last.parameter != parameter
            or not np.array_equal(last.cells, cells)
            or not np.array_equal(last.unused, unused)
        ):
            last = self._last = self._region(cells, parameter, unused)
        return last

    def _region(self, cells: Index, parameter: float, unused: Flags) -> Region:
        estimator = self.estimator
        grid, c, n = estimator.operator.surface, len(estimator.columns), len(cells)
        gram = self.penalised(cells, parameter, unused)
        scale = np.repeat(estimator.cone.scales, n)
        give_way()
        gram *= scale[:, None] * scale[None, :]
        if self._rho is None or not self._rho[0] / RHO_HOLDS <= parameter <= self._rho[0] * RHO_HOLDS:
            self._rho = parameter, _rho(gram)
        rho = self._rho[1]
        gram[np.diag_indices(c * n)] += rho
        inverted = inverse(gram)
        if inverted is None:
            raise np.linalg.LinAlgError("the normal matrix of the region is not positive definite")
        # Invert in double precision, then reduce: rounding must not make rho (H + rho)^-1 exceed 1, because the
        # multipliers are carried from frame to frame.
        give_way()
        single = (inverted * (1.0 - SHRINK)).astype(np.float32)
        inside = np.zeros(grid.shape, dtype=bool)
        inside.ravel()[cells] = True
        border = inside & dilated(~inside, 1)
        shared = self.shared(unused)[:, :, cells].reshape(-1, c * n) * scale
        solved = inverted @ shared.T
        return Region(
            cells,
            border.ravel()[cells],
            single,
            rho,
            parameter,
            unused,
            shared,
            solved.astype(np.float32),
            np.asarray(shared @ solved),
        )

    def penalised(self, cells: Index, parameter: float, unused: Flags) -> Floats:
        """A'A of some cells plus the penalty, in units of traction."""
        estimator, c, n = self.estimator, len(self.estimator.columns), len(cells)
        estimator.check_size(c * n)
        gram = self.gram(cells, unused)
        give_way()
        for i, q in enumerate(estimator.precisions(estimator.level(1), 1, parameter)):
            gram[i * n : (i + 1) * n, i * n : (i + 1) * n] += q[cells][:, cells].toarray()
        return gram

    def known(self, cells: Index, unused: Flags) -> Floats | None:
        """A'A of some cells without the unused readings, if cached; None otherwise."""
        at_hand = self._normal is not None or self._grams.holds(cells)
        return self.gram(cells, unused) if at_hand and self.estimator.readings.independent else None

    def gram(self, cells: Index, unused: Flags) -> Floats:
        """A'A of some cells without the unused readings."""
        estimator = self.estimator
        level, components = estimator.level(1), len(estimator.columns)
        if self._normal is None or (unused.any() and not estimator.readings.independent):
            return self._grams.of(cells, unused)
        gram = picked(self._normal, components, self._cells, cells)
        if unused.any():
            lost = level.matrix(cells, self._std, unused)
            gram -= lost.T @ lost
        return gram


def _rho(matrix: Floats) -> float:
    """sqrt(smallest * largest eigenvalue), with which the iteration converges fastest."""
    import scipy.linalg.lapack as lapack

    largest, smallest = _largest_eigenvalue(len(matrix), lambda x: matrix @ x), 0.0
    # Without noise there is almost no penalty, and rounding determines the smallest eigenvalue.
    try:
        upper = lower_factor(matrix).T  # lets other threads run; in LAPACK's memory order
    except np.linalg.LinAlgError:
        pass
    else:
        smallest = 1.0 / _largest_eigenvalue(len(matrix), lambda x: lapack.dpotrs(upper, x, lower=False)[0])
    return math.sqrt(largest * max(smallest, SMALLEST * largest))


def _largest_eigenvalue(size: int, times: Callable[[Floats], Floats]) -> float:
    """Largest eigenvalue of a positive matrix to a few per cent, given its product ``times`` a vector."""
    from scipy.sparse.linalg import LinearOperator, eigsh

    if size < 3:
        return float(np.linalg.eigvalsh(np.stack([times(x) for x in np.eye(size)]))[-1])
    operator = LinearOperator((size, size), times, dtype=np.float64)
    return float(
        eigsh(
            operator,
            1,
            ncv=min(LANCZOS_STEPS, size),
            tol=0.1,
            v0=np.random.default_rng(0).standard_normal(size),
            return_eigenvectors=False,
        )[0]
    )


def on_surface(estimator: ConstrainedEstimator, cells: Index, values: Floats) -> Floats:
    """Values (component sought, cell) of some cells as a field (component, *surface), 0 elsewhere."""
    grid = estimator.operator.surface
    out = np.zeros((len(grid.components), math.prod(grid.shape)))
    out[np.asarray(estimator.columns)[:, None], cells[None, :]] = values
    return out.reshape(-1, *grid.shape)
