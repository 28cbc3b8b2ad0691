"""The linear methods: each combines a prior for each component, a filter, and a parameter or a rule that chooses it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.inverse.linear.matrix_free.path import Linear, linear_method
from palpate.inverse.linear.parameter import RULES, tikhonov, truncate
from palpate.inverse.linear.priors import DifferencePrior, SpectralPrior, hilgers_prior
from palpate.inverse.method import Method, Needs, choice, function, number, rule
from palpate.inverse.problem import Problem

__all__ = ["Hilgers", "Tikhonov", "Truncated", "Wiener"]

_CUT_OFF_RULES = ("gcv", "lcurve", "discrepancy")
_PARAMETER = "regularisation parameter (default: chosen for each frame)"
_RULE = "how the parameter is chosen for each frame"

Density = Callable[[Floats], npt.ArrayLike]


@dataclass(frozen=True, kw_only=True)
class Tikhonov(Method):
    """Tikhonov's method: penalises a derivative of the traction (A. N. Tikhonov, Soviet Math. Dokl. 4, 1963,
    1035-1038).

    Parameters
    ----------
    order : 0, 1 or 2
        The derivative.
    parameter : float, optional
        lambda.
    rule : str, optional
        How lambda is chosen for each frame if it is not given: "evidence" (default), "gcv", "lcurve" or "discrepancy" (needs the
        array's noise).

    Raises
    ------
    InvalidInput
        An order other than 0, 1 or 2, a parameter that is not positive, a rule that does not exist, or both of these.

    Notes
    -----
    Up to 2048 readings in one symmetry block (4096 at scattered positions) the problem is decomposed. Beyond, it is solved by iteration, without any
    matrix: the same traction for the same parameter, to 1e-6 of its peak (1e-4 at scattered positions), a parameter chosen within a few per cent by
    "evidence", "gcv" and "discrepancy" and within 40 % by "lcurve", and standard deviations of cells from 32 draws, known to 6 to 13 %. A frame that did
    not converge says so in its status.

    Examples
    --------
    >>> import palpate as pp
    >>> pp.Tikhonov(order=2, rule="gcv")
    Tikhonov(order=2, parameter=None, rule='gcv')
    """

    name: ClassVar[str] = "tikhonov"
    summary: ClassVar[str] = "linear, milliseconds a frame; traction may pull"
    error_bars: ClassVar[bool] = True
    rules: ClassVar[tuple[str, ...]] = RULES

    order: int = choice(1, (0, 1, 2), help="order of the derivative that is kept small")
    parameter: float | None = number(help=_PARAMETER)
    rule: str | None = rule(RULES, help=_RULE)

    def prepare(self, problem: Problem) -> Linear:
        """Prepare the linear method with the difference prior."""
        self.check(problem)
        priors = [DifferencePrior(problem.surface, self.order)] * len(problem.components)
        return linear_method(problem, priors, tikhonov, self.chosen)


@dataclass(frozen=True, kw_only=True)
class Hilgers(Method):
    """Regularisation in a Sobolev space (J. W. Hilgers, SIAM J. Numer. Anal. 13, 1976, 172-184).

    ``length`` [m] is the correlation length (default: the depth, or the cell at depth 0); ``parameter`` and ``rule`` as for `Tikhonov`.

    Raises
    ------
    InvalidInput
        A length or parameter that is not positive, a rule that does not exist, or parameter and rule.

    Examples
    --------
    >>> import palpate as pp
    >>> pp.Hilgers(length=2e-3).chosen  # the rule that chooses the parameter
    'evidence'
    """

    name: ClassVar[str] = "hilgers"
    summary: ClassVar[str] = "linear, in the norm of a Sobolev space"
    error_bars: ClassVar[bool] = True
    rules: ClassVar[tuple[str, ...]] = RULES

    length: float | None = number(help="correlation length [m] (default: the depth)", unit="metres")
    parameter: float | None = number(help=_PARAMETER)
    rule: str | None = rule(RULES, help=_RULE)

    def prepare(self, problem: Problem) -> Linear:
        """Prepare the linear method with the Sobolev kernel."""
        self.check(problem)
        length = self.length or min(p.depth for p in problem.planes) or problem.surface.spacings[-1]
        priors = [hilgers_prior(problem.surface, float(length))] * len(problem.components)
        return linear_method(problem, priors, tikhonov, self.chosen)


@dataclass(frozen=True, kw_only=True)
class Truncated(Method):
    """Truncated singular value decomposition: singular values with s^2 above ``parameter`` are kept
    (P. C. Hansen, BIT 27, 1987, 534-553).

    Raises
    ------
    InvalidInput
        A parameter that is not positive, a rule that does not exist, or both.
    Unsupported
        The rule "evidence".

    Examples
    --------
    >>> import palpate as pp
    >>> pp.Truncated().chosen  # the rule that chooses the parameter
    'gcv'
    """

    name: ClassVar[str] = "truncated"
    summary: ClassVar[str] = "linear, the spectrum cut off"
    error_bars: ClassVar[bool] = True
    rules: ClassVar[tuple[str, ...]] = _CUT_OFF_RULES

    parameter: float | None = number(help=_PARAMETER)
    rule: str | None = rule(_CUT_OFF_RULES, help=_RULE)

    def prepare(self, problem: Problem) -> Linear:
        """Prepare the linear method with a white prior."""
        self.check(problem)
        priors = [DifferencePrior(problem.surface, 0)] * len(problem.components)
        return linear_method(problem, priors, truncate, self.chosen)


@dataclass(frozen=True, kw_only=True)
class Wiener(Method):
    """The Wiener filter for a traction with known power spectrum, and the array's noise.

    ``spectrum`` is a function of |k| [rad/m], or a mapping from component to function: power spectral density in Pa^2 m (line) or
    Pa^2 m^2 (area).

    Raises
    ------
    InvalidInput
        A spectrum that is no function, nor functions by component.

    Examples
    --------
    >>> import palpate as pp
    >>> method = pp.Wiener(spectrum=lambda k: 1e4 / (1.0 + (2e-3 * k) ** 2))  # features of about 2 mm
    >>> method.needs.noise  # the array must say its noise
    True
    """

    name: ClassVar[str] = "wiener"
    summary: ClassVar[str] = "linear, for a given power spectrum and noise"
    needs: ClassVar[Needs] = Needs(noise=True)
    error_bars: ClassVar[bool] = True

    spectrum: Density | Mapping[str, Density] = function(  # noqa: RUF009
        help="a function of wavenumber [rad/m] that returns the power spectral density of the traction.",
        accepts="a function of wavenumber [rad/m], or a mapping from component to function",
    )

    def prepare(self, problem: Problem) -> Linear:
        """Prepare the linear method with the given density."""
        density = self.spectrum
        if isinstance(density, Mapping):
            missing = [c for c in problem.components if c not in density]
            if missing:
                raise InvalidInput(f"spectrum lacks the component {', '.join(missing)}.")
            each = [density[c] for c in problem.components]
        else:
            each = [density] * len(problem.components)
        priors = [SpectralPrior(problem.surface, d) for d in each]
        self.check(problem)
        return linear_method(problem, priors, tikhonov, 1.0, absolute=True)
