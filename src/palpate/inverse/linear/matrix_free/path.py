"""Choose between a dense decomposition and the matrix-free method, by size and free memory. The only place that
decides.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate.inverse.linear.matrix_free.evidence import LinearAtSize
from palpate.inverse.linear.matrix_free.memory import check_system, on_lattice, servable
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.memory import block_size, spectrum_fits
from palpate.inverse.linear.parameter import Filter, tikhonov
from palpate.inverse.linear.priors import DifferencePrior, Prior
from palpate.inverse.linear.regularised import Decomposition, Regularised
from palpate.inverse.linear.stated import InDoubt
from palpate.inverse.problem import Problem
from palpate.sensing.maps import body_of
from palpate.sensing.operator import LARGEST_MATRIX

__all__ = [
    "LARGEST_DENSE_BLOCK",
    "Linear",
    "LinearModel",
    "contact_at_size",
    "linear_method",
    "linear_model",
    "matrix_free",
    "system_of",
]

#: Largest symmetry block, in readings, for the dense decomposition: about ten seconds of preparation, once, after which a frame takes milliseconds
#: and is exact. Larger ones take minutes and gigabytes, and a matrix-free frame takes as long as a few hundred FFTs.
LARGEST_DENSE_BLOCK = 2048

Linear = Regularised | MatrixFree | InDoubt
#: The linear model from which constrained methods start.
LinearModel = Decomposition | LinearAtSize


def linear_method(
    problem: Problem,
    priors: Sequence[Prior],
    filter_factors: Filter,
    parameter: float | str,
    *,
    absolute: bool = False,
) -> Linear:
    """The method prepared for a problem, with one prior for each component sought."""
    linear: Regularised | MatrixFree
    if matrix_free(problem, filter_factors, priors):
        system = system_of(problem, priors)
        linear = MatrixFree(system, parameter, absolute=absolute, nuisance=problem.nuisance)
    else:
        decomposition = problem.decomposition(priors)
        linear = Regularised(decomposition, filter_factors, parameter, absolute=absolute, nuisance=problem.nuisance)
    return InDoubt(linear, problem, problem.stated) if problem.stated.any else linear


def system_of(problem: Problem, priors: Sequence[Prior], *, wide: bool = False) -> System:
    """The matrix-free system of a problem, with one prior for each component sought; it is cached."""
    surface = problem.wide_surface if wide else problem.surface
    check_system(problem.pad, problem.planes, surface, len(problem.columns))
    operator = problem.wide if wide else problem.operator
    key = ("matrix-free system", wide and not problem.fixed, problem.columns, tuple(p.key for p in priors))
    return problem.kept.get(key, lambda: System(operator, priors, problem.columns))


def contact_at_size(problem: Problem, *, wide: bool) -> bool:
    """Whether a contact method starts from a matrix-free system: for large regular arrays whose noise is independent."""
    surface = problem.wide_surface if wide else problem.surface
    if (
        body_of(problem.pad) is not None
        or problem.boundary != "free"
        or any(a.noise_correlation for a in problem.planes)
    ):
        return False
    regular = on_lattice(problem.planes, surface)
    return regular and block_size(problem.pad, problem.planes, surface) > LARGEST_DENSE_BLOCK


def linear_model(problem: Problem, priors: Sequence[Prior], *, wide: bool) -> LinearModel:
    """The linear model from which constrained methods start, with one prior for each component sought."""
    if not contact_at_size(problem, wide=wide):
        return problem.decomposition(priors, wide=wide)
    return LinearAtSize(system_of(problem, priors, wide=wide))


def matrix_free(problem: Problem, filter_factors: Filter, priors: Sequence[Prior]) -> bool:
    """Whether the problem is too large for a dense decomposition and the matrix-free method applies."""
    if (
        body_of(problem.pad) is not None
        or problem.boundary != "free"
        or filter_factors is not tikhonov
        or not servable(problem.planes)
    ):
        return False
    regular = on_lattice(problem.planes, problem.surface)
    if not regular and not all(isinstance(p, DifferencePrior) for p in priors):
        return False
    size = block_size(problem.pad, problem.planes, problem.surface)
    if not regular:  # up to `LARGEST_MATRIX` readings their map is a matrix in any case
        return size > LARGEST_MATRIX
    fits = spectrum_fits(problem.pad, problem.planes, problem.surface, len(problem.columns))
    return size > LARGEST_DENSE_BLOCK or not fits
