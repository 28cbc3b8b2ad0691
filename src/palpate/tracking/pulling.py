"""Traction of either sign, for frames that pushing contact does not fit: adhesion, a hook, a hand that lifts the pad.

The same penalty without constraints, on the cells where the readings indicate traction:

    t = (A'A + penalty)^-1 A'y.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Solution
from palpate.inverse.constrained.faces import Face
from palpate.inverse.constrained.factors import Dense, cholesky
from palpate.inverse.constrained.model import ContactModel, Normal
from palpate.inverse.constrained.quadratic import Formed, Penalty
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.tracking.health import Flags, Index
from palpate.tracking.offsets import Marginal
from palpate.tracking.region import SMALLEST, NormalEquations
from palpate.tracking.search import LOST, TAKEN, around

__all__ = ["Pulling", "firm"]

#: Initial cells are those above this fraction of the highest score; cells are added in at most this many rounds.
LIKELY, ROUNDS = 0.2, 4


def firm(matrix: Floats) -> Floats:
    """Add a small diagonal to a normal matrix, in place, so that its smallest eigenvalues stay above rounding. Without
    noise there is almost no penalty.
    """
    matrix[np.diag_indices(len(matrix))] += SMALLEST * float(np.diagonal(matrix).max(initial=0.0))
    return matrix


class Pulling:
    """Traction of either sign on some cells, with a cached factor for them."""

    def __init__(self, estimator: ConstrainedEstimator, equations: NormalEquations) -> None:
        self._estimator, self._equations = estimator, equations
        self.clear()

    def clear(self) -> None:
        self.cells: Index | None = None
        self.traction: Floats = np.zeros((len(self._estimator.columns), 0))
        self.parameter = 0.0  # penalty
        self._kept: tuple[Flags, Floats, Floats] | None = None  # unused readings, factor, and A'B

    def solve(self, y: Floats, noise: float, unused: Flags, parameter: float, marginal: Marginal) -> None:
        """Solve for the traction of a frame."""
        equations = self._equations
        slope = equations.adjoint(y, unused).astype(np.float64)
        slope = slope - np.tensordot(marginal.gain @ marginal.sums, equations.shared(unused), 1)
        score = np.abs(equations.score(slope.astype(np.float32))) / noise
        likely = score > max(LOST, LIKELY * float(score.max()))
        likely[int(np.argmax(score))] = True  # with noise alone no cell may be likely
        wanted = around(self._estimator, likely)
        if self.cells is not None and np.isin(np.flatnonzero(likely), self.cells).all():
            kept = np.zeros(len(score), dtype=bool)
            kept[self.cells] = True
            if kept.sum() < 2 * max(wanted.sum(), 9):
                wanted = kept
        for _ in range(ROUNDS):
            self._on(np.flatnonzero(wanted), parameter, unused)
            self._solve(slope, marginal.gain)
            rest = np.where(unused, 0.0, y - equations.explained(self.cells, self.traction))
            left = np.abs(equations.score(equations.adjoint(rest, unused))) / noise
            missing = (left > max(TAKEN, 0.1 * float(score.max()))) & ~wanted
            if not missing.any():
                break
            wanted = wanted | around(self._estimator, missing)

    def _on(self, cells: Index, parameter: float, unused: Flags) -> None:
        kept = self._kept
        if (
            kept is not None
            and self.cells is not None
            and self.parameter == parameter
            and np.array_equal(kept[0], unused)
            and np.array_equal(self.cells, cells)
        ):
            return
        self.cells, self.parameter = cells, parameter
        shared = self._equations.shared(unused)[:, :, cells].reshape(-1, len(self._estimator.columns) * len(cells))
        factor = cholesky(firm(self._equations.penalised(cells, parameter, unused)))
        self._kept = unused.copy(), factor, shared

    def _solve(self, slope: Floats, gain: Floats) -> None:
        if self._kept is None or self.cells is None:
            raise RuntimeError("there are no cells")
        factor, shared = self._kept[1:]

        def inverse(b: Floats) -> Floats:
            return np.asarray(scipy.linalg.cho_solve((factor, True), b, check_finite=False))

        b = slope[:, self.cells].ravel()
        x, solved = inverse(b), inverse(shared.T)
        middle = gain @ np.linalg.inv(np.eye(len(gain)) - shared @ solved @ gain)
        x = x + solved @ (middle @ (shared @ x))
        if not np.isfinite(x).all():
            raise np.linalg.LinAlgError("traction of either sign has no finite result")
        self.traction = x.reshape(len(slope), len(self.cells))

    @property
    def contact(self) -> tuple[Index, Floats] | None:
        """The cells, and their traction (component, cell) [Pa]; None without any."""
        return None if self.cells is None else (self.cells, self.traction)

    def shared(self) -> Floats:
        """B'A t: contribution of the solution to the sums of each channel."""
        if self._kept is None:
            raise RuntimeError("there are no cells")
        return np.asarray(self._kept[2] @ self.traction.ravel())

    def model(self, data: Normal, parameter: float, traction: Floats) -> ContactModel:
        """``traction`` as a model in which every cell is free; ``data`` in units of the noise, penalty to match."""
        c, n = traction.shape
        penalty = Penalty(data.cells, self._estimator.precisions(data.level, 1, parameter), data.level.grid.shape)
        hessian = penalty.added(data.gram.copy())
        face = Face(np.broadcast_to(np.eye(c), (n, c, c)), np.ones((c, n)), False)
        solution = Solution(traction, 0.0, 1, True, face, Dense(cholesky(firm(hessian.copy()))))
        return ContactModel(data, Formed(hessian), penalty, solution, weight=1.0)
