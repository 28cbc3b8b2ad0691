"""Cells where contact is sought, and the inverse that is kept for them.

The normal matrix of the whole surface is made once. A region's part of it, with the penalty and rho added, is inverted once and
serves every frame until the region, the penalty or the readings that are used change.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.model import dilated
from palpate.tracking.health import Flags

__all__ = ["Index", "NormalEquations", "Region", "Single"]

Index = npt.NDArray[np.intp]
Single = npt.NDArray[np.float32]

#: Entries of the normal matrix of the whole surface that are kept: 160 MB in double precision.
LARGEST = 20_000_000
#: Columns of the matrix made at a time.
BLOCK = 1024
#: Smallest eigenvalue of the normal matrix over the largest, below which it is not told from zero: single precision (6e-8) and the
#: sum of some hundred products leave no more of the inverse.
SMALLEST = 1e-9
#: By so much the inverse is shrunk: rounding to single precision moves rho (H + rho)^-1, at most 1, by some 6e-8 times the square
#: root of its size (hundreds), and it must not grow anything.
SHRINK = 1e-6
#: Steps of the power method: a few per cent of an eigenvalue are near enough for rho.
POWER_STEPS = 20


@dataclass(frozen=True)
class Region:
    """Cells where contact is sought, and what solves their problem.

    ``border`` (cell) are those at the region's edge; ``inverse`` is (H + rho)^-1 with unknowns scaled as by `Cone.scales`; it holds for
    a ``parameter`` of the penalty and for the readings that are not ``unused``.
    """

    cells: Index
    border: Flags
    inverse: Single
    rho: float
    parameter: float
    unused: Flags


class NormalEquations:
    """A'A and A'y of whitened readings, prepared once for a tracker."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self.estimator = estimator
        self._std = estimator.readings.std
        self._cells = math.prod(estimator.operator.surface.shape)
        # in double precision: rounded to single it has negative eigenvalues, along which the iteration grows without end
        self._normal: Floats | None = None
        self.diagonal = self._prepare()
        self._rho: tuple[float, float] | None = None

    def _prepare(self) -> Floats:
        """The normal matrix of the whole surface where it fits; its diagonal, of pressure, in any case."""
        estimator, columns = self.estimator, self.estimator.columns
        level = estimator.level(1)
        everything = np.ones(len(self._std), dtype=bool)
        diagonal = np.empty(self._cells)
        unknowns = len(columns) * self._cells
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
        self._rho = None

    def adjoint(self, y: Floats, unused: Flags) -> Single:
        """A' y of whitened readings, (component, cell)."""
        estimator = self.estimator
        if not estimator.readings.independent:
            observed = ~unused
            white = np.zeros_like(y)
            white[observed] = estimator.readings.white(estimator.readings.white(y[observed], observed), observed)
            y = white
        adjoint = estimator.operator.adjoint(estimator.readings.planes(y / self._std))
        return np.asarray(adjoint.reshape(len(adjoint), -1)[list(estimator.columns)], dtype=np.float32)

    def score(self, adjoint: Single) -> Floats:
        """Pressure on each cell alone, in standard deviations of what unit noise would make of it."""
        return np.asarray(adjoint[-1] / np.sqrt(np.maximum(self.diagonal, 1e-300)))

    def explained(self, region: Region | None, traction: Floats) -> Floats:
        """The whitened readings that traction (component, cell) on a region's cells explains."""
        if region is None:
            return np.zeros(len(self._std))
        whole = np.zeros((len(self.estimator.columns), self._cells))
        whole[:, region.cells] = traction
        return self.estimator.explained_by(whole) / self._std

    def region(self, cells: Index, parameter: float, unused: Flags) -> Region:
        """The region of some cells: their normal matrix with the penalty, and the inverse that the iteration needs."""
        estimator = self.estimator
        grid, c, n = estimator.operator.surface, len(estimator.columns), len(cells)
        estimator.check_size(c * n)
        gram = self._gram(cells, unused)
        for i, q in enumerate(estimator.precisions(estimator.level(1), 1, parameter)):
            gram[i * n : (i + 1) * n, i * n : (i + 1) * n] += q[cells][:, cells].toarray()
        scale = np.repeat(estimator.cone.scales, n)
        gram *= scale[:, None] * scale[None, :]
        if self._rho is None or self._rho[0] != parameter:
            self._rho = parameter, _rho(gram)
        rho = self._rho[1]
        gram[np.diag_indices(c * n)] += rho
        inverse = _inverse(gram)
        if inverse is None:
            raise np.linalg.LinAlgError("the normal matrix of the region is not positive definite")
        # inverted in double precision and then rounded down: rounding must not let rho (H + rho)^-1 grow anything, since
        # the multipliers are carried from frame to frame
        single = (inverse * (1.0 - SHRINK)).astype(np.float32)
        inside = np.zeros(grid.shape, dtype=bool)
        inside.ravel()[cells] = True
        border = inside & dilated(~inside, 1)
        return Region(cells, border.ravel()[cells], single, rho, parameter, unused)

    def _gram(self, cells: Index, unused: Flags) -> Floats:
        """A'A of some cells, without the readings that are not used."""
        estimator = self.estimator
        level = estimator.level(1)
        if self._normal is None or (unused.any() and not estimator.readings.independent):
            matrix = level.matrix(cells, self._std, ~unused)
            return np.asarray(matrix.T @ matrix)
        picks = (np.arange(len(estimator.columns))[:, None] * self._cells + cells[None, :]).ravel()
        gram = self._normal[np.ix_(picks, picks)]
        if unused.any():
            lost = level.matrix(cells, self._std, unused)
            gram -= lost.T @ lost
        return gram


def _rho(matrix: Floats) -> float:
    """The square root of the smallest times the largest eigenvalue, at which the method converges fastest."""
    largest = _largest_eigenvalue(matrix)
    inverse = _inverse(matrix)
    # without noise next to nothing is penalised, and rounding decides about the smallest eigenvalue
    smallest = 0.0 if inverse is None else 1.0 / _largest_eigenvalue(inverse)
    return math.sqrt(largest * max(smallest, SMALLEST * largest))


def _inverse(matrix: Floats) -> Floats | None:
    """Of a symmetric positive matrix; None where it is not positive in double precision."""
    import scipy.linalg.lapack as lapack

    factor, failed = lapack.dpotrf(matrix, lower=True, clean=True)
    if failed:
        return None
    lower, failed = lapack.dpotri(factor, lower=True)
    if failed:
        return None
    return np.asarray(np.tril(lower) + np.tril(lower, -1).T)


def _largest_eigenvalue(matrix: Floats) -> float:
    """Of a positive matrix, by the power method."""
    x: Floats = np.random.default_rng(0).standard_normal(len(matrix))
    size = 1.0
    for _ in range(POWER_STEPS):
        x = np.asarray(matrix @ (x / np.linalg.norm(x)))
        size = float(np.linalg.norm(x))
    return size
