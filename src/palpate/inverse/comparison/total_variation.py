"""Total variation: the integral of the size of grad t (L. Rudin, S. Osher, E. Fatemi, Physica D 60, 1992, 259-268), p >= 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.comparison.whole_map import Comparison, Frame, WholeMap
from palpate.inverse.constrained.cone import minimise
from palpate.inverse.method import number
from palpate.inverse.problem import Problem

__all__ = ["TotalVariation"]

#: Reweighted least squares: smallest gradient, as a part of the largest, and rounds.
SMALLEST_GRADIENT, ROUNDS = 1e-4, 30


@dataclass(frozen=True, kw_only=True)
class TotalVariation(Comparison):
    """Least squares with lambda times the integral of the size of the gradient, p >= 0
    (L. Rudin, S. Osher, E. Fatemi, Physica D 60, 1992, 259-268).

    Examples
    --------
    >>> import palpate as pp
    >>> pp.comparison.TotalVariation().chosen  # lambda follows from the noise, given or estimated
    'discrepancy'
    """

    name: ClassVar[str] = "tv"
    summary: ClassVar[str] = "for comparison: total variation"
    rules: ClassVar[tuple[str, ...]] = ("discrepancy",)

    parameter: float | None = number(
        help="weight of the total variation (default: the largest that explains the readings to the noise)"
    )

    def prepare(self, problem: Problem) -> _TotalVariation:
        """Matrix and linear model of the whole map."""
        self.check(problem)
        return _TotalVariation(problem, self.name, self.parameter)


class _TotalVariation(WholeMap):
    def minimised(self, p: Frame, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """Iteratively reweighted least squares with the constraints solved exactly in each round."""
        grid, n = self.grid, p.shape[1]
        x = start
        converged = False
        solution = None
        for _ in range(ROUNDS):
            hessian = p.gram.copy()
            size = np.sqrt(grid.dimensions * self.differences.energy([d**2 for d in self.differences.across(x)]))
            largest = size.max(axis=tuple(range(1, size.ndim)), keepdims=True)
            size = np.maximum(size, SMALLEST_GRADIENT * np.maximum(largest, 1e-300))
            for i, penalty in enumerate(self.differences.local(size)):
                hessian[i * n : (i + 1) * n, i * n : (i + 1) * n] += (parameter * grid.spacings[-1] * penalty).toarray()
            solution = minimise(hessian, p.linear, self.cone, x, tolerance=1e-6)
            change = float(np.abs(solution.traction - x).max()) / max(float(np.abs(x).max()), 1e-300)
            x = solution.traction
            if change < 1e-3:
                converged = solution.converged
                break
        return x, converged
