"""Which way a linear method goes: a dense decomposition, or matrix-free. The only place that decides, by size alone."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.inverse.linear.matrix_free.memory import check_system, on_lattice, servable
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.memory import block_size
from palpate.inverse.linear.parameter import Filter, tikhonov
from palpate.inverse.linear.priors import DifferencePrior, Prior
from palpate.inverse.linear.regularised import Regularised
from palpate.inverse.problem import Problem
from palpate.sensing.operator import LARGEST_MATRIX

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
    if matrix_free(problem, filter_factors, priors):
        check_system(problem.pad, problem.planes, problem.surface, len(problem.columns))
        key = ("matrix-free system", problem.columns, tuple(p.key for p in priors))
        system = problem.kept.get(key, lambda: System(problem.operator, priors, problem.columns))
        return MatrixFree(system, parameter, absolute=absolute, nuisance=problem.nuisance)
    return Regularised(
        problem.decomposition(priors), filter_factors, parameter, absolute=absolute, nuisance=problem.nuisance
    )


def matrix_free(problem: Problem, filter_factors: Filter, priors: Sequence[Prior]) -> bool:
    """Whether the problem is too large for a dense decomposition, and can go without."""
    if problem.boundary != "free" or filter_factors is not tikhonov or not servable(problem.planes):
        return False
    regular = on_lattice(problem.planes, problem.surface)
    if not regular and not all(isinstance(p, DifferencePrior) for p in priors):
        return False
    size = block_size(problem.pad, problem.planes, problem.surface)
    return size > (LARGEST_DENSE_BLOCK if regular else LARGEST_MATRIX)
