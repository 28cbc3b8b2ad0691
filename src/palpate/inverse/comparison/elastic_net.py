"""The elastic net: first norm and square of the traction (H. Zou, T. Hastie, J. R. Stat. Soc. B 67, 2005, 301-320), p >= 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.comparison.whole_map import Comparison, Frame, WholeMap
from palpate.inverse.constrained.cone import minimise
from palpate.inverse.method import number
from palpate.inverse.problem import Problem

__all__ = ["ElasticNet"]


@dataclass(frozen=True, kw_only=True)
class ElasticNet(Comparison):
    """Least squares with lambda times the first norm of the traction and lambda times its square, p >= 0
    (H. Zou, T. Hastie, J. R. Stat. Soc. B 67, 2005, 301-320).

    Examples
    --------
    >>> import palpate as pp
    >>> pp.comparison.ElasticNet().chosen  # lambda follows from the noise, given or estimated
    'discrepancy'
    """

    name: ClassVar[str] = "elastic_net"
    summary: ClassVar[str] = "for comparison: first norm and square of the traction"
    rules: ClassVar[tuple[str, ...]] = ("discrepancy",)

    parameter: float | None = number(
        help="weight of both norms (default: the largest that explains the readings to the noise)"
    )

    def prepare(self, problem: Problem) -> _ElasticNet:
        """Matrix and linear model of the whole map."""
        self.check(problem)
        return _ElasticNet(problem, self.name, self.parameter)


class _ElasticNet(WholeMap):
    def minimised(self, p: Frame, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """1/2 |A t - y|^2 + lambda |t|_1 + lambda |t|^2/(2 t0), with t0 the size of the traction, so that both count alike.

        With shear sought the first norm of a cell is p + |q|, by reweighting of |q|.
        """
        size = max(float(np.abs(start).max()), 1e-300)
        ridge = parameter / size
        x = start
        converged = True
        rounds = 1 if p.shape[0] == 1 else 8
        for _ in range(rounds):
            diagonal = np.full(p.shape, ridge)
            linear = p.linear.copy()
            linear[-1] -= parameter
            if p.shape[0] > 1:
                shear = np.sqrt((x[:-1] ** 2).sum(axis=0))
                diagonal[:-1] += parameter / np.maximum(shear, 1e-4 * size)
            solution = minimise(p.gram + np.diag(diagonal.ravel()), linear, self.cone, x)
            x, converged = solution.traction, solution.converged
        return x, converged
