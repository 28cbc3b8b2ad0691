"""Maximum entropy: lambda sum p ln(p/m) - p + m, m the mean (J. Skilling, R. K. Bryan, Mon. Not. R. Astron. Soc. 211, 1984, 111-124)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.comparison.whole_map import Comparison, Frame, WholeMap
from palpate.inverse.method import number
from palpate.inverse.problem import Problem

__all__ = ["MaximumEntropy"]


@dataclass(frozen=True, kw_only=True)
class MaximumEntropy(Comparison):
    """Least squares with lambda times the negative entropy of the pressure, which is positive
    (J. Skilling, R. K. Bryan, Mon. Not. R. Astron. Soc. 211, 1984, 111-124).

    Examples
    --------
    >>> import palpate as pp
    >>> pp.comparison.MaximumEntropy().chosen  # lambda follows from the noise, given or estimated
    'discrepancy'
    """

    name: ClassVar[str] = "maxent"
    summary: ClassVar[str] = "for comparison: maximum entropy, pressure alone"
    rules: ClassVar[tuple[str, ...]] = ("discrepancy",)

    parameter: float | None = number(
        help="weight of the entropy (default: the largest that explains the readings to the noise)"
    )

    def prepare(self, problem: Problem) -> _MaximumEntropy:
        """Matrix and linear model of the whole map."""
        self.check(problem)
        if problem.components != ("z",):
            raise Unsupported('method="maxent" is for pressure alone, which is positive: components=["z"].')
        return _MaximumEntropy(problem, self.name, self.parameter)


class _MaximumEntropy(WholeMap):
    def minimised(self, p: Frame, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """Bounded quasi-Newton (L-BFGS-B) in the logarithm of pressure, which is positive by itself."""
        import scipy.optimize

        model = max(float(np.mean(start)), 1e-6 * float(np.abs(start).max()))
        scale = 1.0 / max(float(np.abs(p.linear).max()) * model, 1e-300)

        def objective(u: Floats) -> tuple[float, Floats]:
            t = model * np.exp(u)
            gradient = p.gram @ t - p.linear.ravel()
            value = 0.5 * float(t @ (gradient - p.linear.ravel())) + parameter * float((t * (u - 1.0) + model).sum())
            return scale * value, scale * t * (gradient + parameter * u)

        guess = np.log(np.maximum(start.ravel(), 1e-3 * model) / model)
        found = scipy.optimize.minimize(
            objective,
            guess,
            jac=True,
            method="L-BFGS-B",
            bounds=[(-30.0, 30.0)] * len(guess),
            options={"maxiter": 3000},
        )
        return model * np.exp(found.x).reshape(p.shape), bool(found.success)
