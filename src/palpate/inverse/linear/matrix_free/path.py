"""Which way a linear method goes: a dense decomposition, or matrix-free. The only place that decides, by size alone."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.inverse.linear.matrix_free.memory import check_system, servable
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.memory import block_size
from palpate.inverse.linear.parameter import Filter, tikhonov
from palpate.inverse.linear.priors import Prior
from palpate.inverse.linear.regularised import Regularised
from palpate.inverse.problem import Problem

__all__ = ["LARGEST_DENSE_BLOCK", "Linear", "linear_method", "matrix_free"]

Linear = Regularised | MatrixFree

#: Readings in the largest symmetry block up to which the decomposition is dense: about ten seconds of preparation, once, after which a frame
#: takes milliseconds and is exact. Beyond, it takes minutes and gigabytes, and a matrix-free frame takes as long as a few hundred FFTs.
LARGEST_DENSE_BLOCK = 2048


def linear_method(
    problem: Problem,
    priors: Sequence[Prior],
    filter_factors: Filter,
    parameter: float | str,
    *,
    absolute: bool = False,
) -> Linear:
    """The method prepared for a problem, with one prior for each component sought."""
    if matrix_free(problem, filter_factors):
        check_system(problem.pad, problem.planes, problem.surface, len(problem.columns))
        key = ("matrix-free system", problem.columns, tuple(p.key for p in priors))
        system = problem.kept.get(key, lambda: System(problem.operator, priors, problem.columns))
        return MatrixFree(system, parameter, absolute=absolute, nuisance=problem.nuisance)
    return Regularised(
        problem.decomposition(priors), filter_factors, parameter, absolute=absolute, nuisance=problem.nuisance
    )


def matrix_free(problem: Problem, filter_factors: Filter) -> bool:
    """Whether the problem is too large for a dense decomposition, and can go without."""
    return (
        problem.boundary == "free"
        and filter_factors is tikhonov
        and block_size(problem.pad, problem.planes, problem.surface) > LARGEST_DENSE_BLOCK
        and servable(problem.planes, problem.surface)
    )
