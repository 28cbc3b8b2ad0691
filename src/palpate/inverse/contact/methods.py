"""The methods that assume contact: pressure only pushes, and shear stays within friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, to_numpy
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.contact import trace
from palpate.inverse.contact.adaptive import AdaptiveEstimator
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.gathered import gathered
from palpate.inverse.contact.local import LocalEstimator
from palpate.inverse.contact.notes import notes_of
from palpate.inverse.contact.policy import Policy
from palpate.inverse.estimate import Errors, Estimate, Stated, among_frames, batch_of
from palpate.inverse.linear.matrix_free.path import Linear
from palpate.inverse.linear.methods import Tikhonov
from palpate.inverse.linear.stated import with_offsets
from palpate.inverse.method import Method, Needs, Prepared, count, number
from palpate.inverse.problem import Problem

__all__ = ["Adaptive", "Automatic", "AutomaticEstimator", "Constrained", "Local", "cone_of"]

#: For a larger coefficient of friction the bound |q| <= mu p has no effect, and its scale harms the numerics.
LARGEST_FRICTION = 10.0
_FRICTION = "coefficient of friction mu: |shear| <= mu * pressure in every cell"
_DRAWS = "samples of the posterior kept with the result (slow: each is an optimisation)"


def cone_of(components: tuple[str, ...], friction: float | None) -> Cone:
    """The admissible set of the traction in each cell."""
    if friction is not None and components == ("z",):
        raise Unsupported(
            "friction ties shear to pressure, and only pressure is sought here. Leave friction out, or seek shear too, with "
            "channels that can tell it from pressure."
        )
    if friction is not None and friction > LARGEST_FRICTION:
        raise InvalidInput(
            f"friction = {friction:g} is no coefficient of friction: those of rubber and skin end below {LARGEST_FRICTION:g}. Where a contact cannot slip, leave friction out: shear is "
            "then not bounded by pressure."
        )
    return Cone(components, friction)


@dataclass(frozen=True, kw_only=True)
class Adaptive(Method):
    """Contact found from the readings alone, with calibrated error bars; see `palpate.inverse.contact.adaptive`.

    Parameters
    ----------
    friction : float, optional
        Coefficient mu: |shear| <= mu * pressure in every cell.
    draws : int
        Samples of the posterior kept in `Touch.draws`.

    Examples
    --------
    >>> import palpate as pp
    >>> pp.Adaptive(friction=0.6).friction
    0.6
    """

    name: ClassVar[str] = "adaptive"
    summary: ClassVar[str] = "learned from each frame, pressure cannot pull, error bars"
    needs: ClassVar[Needs] = Needs(free_boundary=True, pressure=True)
    error_bars: ClassVar[bool] = True
    narrows: ClassVar[bool] = True
    by_frame: ClassVar[bool] = True

    friction: float | None = number(help=_FRICTION)
    draws: int = count(help=_DRAWS)

    def prepare(self, problem: Problem) -> AdaptiveEstimator:
        """Prepare the estimator for a problem, including its linear models."""
        return self._prepared_by(problem, Policy())

    def _prepared_by(self, problem: Problem, policy: Policy) -> AdaptiveEstimator:
        """Prepare with another policy (`palpate.bench.ablation`)."""
        self.check(problem)
        return AdaptiveEstimator(problem, cone_of(problem.components, self.friction), draws=self.draws, policy=policy)


@dataclass(frozen=True, kw_only=True)
class Constrained(Method):
    """One even penalty with the same constraints: less sharp than `Adaptive`, but faster. `Tracker` uses this method.

    ``friction`` and ``draws`` as for `Adaptive`; ``parameter`` is the weight of the penalty (default: by evidence).

    Examples
    --------
    >>> import palpate as pp
    >>> pp.Constrained(friction=0.6).chosen  # the rule that chooses the weight of the penalty
    'evidence'
    """

    name: ClassVar[str] = "constrained"
    summary: ClassVar[str] = "one even penalty with the same constraints: faster, less sharp, error bars"
    needs: ClassVar[Needs] = Needs(free_boundary=True, pressure=True)
    error_bars: ClassVar[bool] = True
    narrows: ClassVar[bool] = True
    by_frame: ClassVar[bool] = True
    rules: ClassVar[tuple[str, ...]] = ("evidence",)

    friction: float | None = number(help=_FRICTION)
    parameter: float | None = number(help="weight of the penalty (default: by evidence in each frame)")
    draws: int = count(help=_DRAWS)

    def prepare(self, problem: Problem) -> ConstrainedEstimator:
        """Prepare the estimator for a problem, including its linear model."""
        self.check(problem)
        cone = cone_of(problem.components, self.friction)
        return ConstrainedEstimator(problem, cone, parameter=self.parameter, draws=self.draws)


@dataclass(frozen=True, kw_only=True)
class Local(Method):
    """Traction of either sign, concentrated in few places, such as cells on gels; see `palpate.inverse.contact.local`.

    Parameters
    ----------
    draws : int
        Samples of the posterior kept in `Touch.draws`.

    Notes
    -----
    It starts from the result of `Tikhonov`, regularised by evidence. It returns that result if traction is in too many
    cells (2400 unknowns; fewer with more than 16 000 readings) or in none, if Tikhonov's model explains the readings
    better, or if noise cannot be distinguished from traction; `Touch.methods` and a note say so. A frame takes one to five seconds.

    Examples
    --------
    >>> import palpate as pp
    >>> str(pp.Local(draws=8))
    'local(draws=8)'
    """

    name: ClassVar[str] = "local"
    summary: ClassVar[str] = "traction of either sign, strong in few places, error bars"
    needs: ClassVar[Needs] = Needs(free_boundary=True)
    error_bars: ClassVar[bool] = True
    by_frame: ClassVar[bool] = True

    draws: int = count(help=_DRAWS)

    def prepare(self, problem: Problem) -> LocalEstimator:
        """Prepare the estimator and Tikhonov's method, from which it starts."""
        self.check(problem)
        return LocalEstimator(problem, Tikhonov().prepare(problem), draws=self.draws)


@dataclass(frozen=True, kw_only=True)
class Automatic(Method):
    """The default. It uses `Adaptive` for each frame if pressure is estimated, `Local` if it is not (cells on gels), and
    `Tikhonov` on periodic surfaces and for frames that pull.

    If pushing contact does not fit a frame, it tries contact with pull around it (adhesion). If that does not fit
    either (cells that pull), `Tikhonov` solves the frame, unless ``friction`` is given, which implies contact. Each
    frame is decided independently of the others.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
    >>> str(pp.Automatic().resolved(skin.problem(components=["x"])))  # no pressure is sought
    'local'
    """

    name: ClassVar[str] = "automatic"
    summary: ClassVar[str] = "the default: adaptive, local without pressure, and tikhonov for frames that pull"
    error_bars: ClassVar[bool] = True
    narrows: ClassVar[bool] = True
    by_frame: ClassVar[bool] = True

    friction: float | None = number(help=_FRICTION)
    draws: int = count(help=_DRAWS)

    def resolved(self, problem: Problem) -> Method:
        """The method that solves this problem: `Local` if pressure is not estimated, `Tikhonov` on a periodic surface."""
        free = problem.boundary != "periodic"
        if free and "z" in problem.components:
            return self
        other: Method = Local(draws=self.draws) if free else Tikhonov()
        for option in self.options():
            if getattr(self, option) and option not in other.options():
                raise Unsupported(
                    f'{option} belongs to methods that seek pressure on boundary="free"; here method="{other.name}" is used, which '
                    f"does not take {option}: leave it out, or seek z too."
                )
        return other

    def prepare(self, problem: Problem) -> Prepared:
        """Prepare the adaptive method; the linear method is prepared when a frame first needs it."""
        other = self.resolved(problem)
        return self._prepared_by(problem, Policy()) if other is self else other.prepare(problem)

    def _prepared_by(self, problem: Problem, policy: Policy) -> AutomaticEstimator:
        """Prepare with this policy, if pressure is sought."""
        adaptive = Adaptive(**{option: getattr(self, option) for option in self.options()})
        pushing = adaptive._prepared_by(problem, policy)
        linear = self.friction is None and not problem.ambiguous and policy.parts.pulls
        return AutomaticEstimator(
            pushing, (lambda: with_offsets(Tikhonov().prepare(problem), problem)) if linear else None
        )


class AutomaticEstimator:
    """The adaptive method, and a linear method for frames that it does not fit."""

    def __init__(self, pushing: AdaptiveEstimator, pulling: Callable[[], Linear] | None) -> None:
        self.pushing, self.grid = pushing, pushing.grid
        self._pulling = pulling
        if (
            pushing.policy.parts.pulls and not pushing.ambiguous
        ):  # if channels cannot separate pressure from shear, the method needs the constraint that pressure only pushes
            pushing.signs = (1, -1) if pulling is None else (1, -1, 0)

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane; every frame is decided alone."""
        batch = batch_of(readings, self.pushing.operator)
        frames = self.pushing.frames(readings, rng)
        method = np.array([Constrained.name if f.one_penalty else Adaptive.name for f in frames]).reshape(batch)
        method = method.astype(f"<U{len(Constrained.name)}")
        found = replace(gathered(self.pushing, frames, batch, readings[0]), method=method)
        pulls = np.array([_needs_pull(f) for f in frames]).reshape(batch)
        # the linear method needs every reading
        if self._pulling is None or not pulls.any() or any(np.isnan(to_numpy(r)).any() for r in readings):
            return found
        trace.step("contact that only pushes does not fit: the linear method answers")
        if pulls.all():
            return replace(self._pulling().solve(readings), pushed=found.pushed, method=np.full(batch, Tikhonov.name))
        where = np.flatnonzero(pulls)
        rows = [_rows(r, batch, where) for r in readings]
        other = self._pulling().solve(rows)
        method[pulls] = Tikhonov.name
        pushed = notes_of([f for f, p in zip(frames, pulls.ravel()) if not p], batch, self.pushing.policy)
        said = (*pushed, *(among_frames(note, pulls.size) for note in other.said))
        return replace(_merged(found, other, pulls), method=method, said=said)


def _needs_pull(frame: Frame) -> bool:
    """Whether the linear method has to solve a frame. A frame that pulls as a whole is solved as a push with the
    opposite sign, and a push with pull around it is solved too.
    """
    answered = frame.pushed or frame.unexplained or frame.undecided or frame.overload
    return not answered and 0 <= frame.sign < 2


def _both_stated(mine: Stated | None, theirs: Stated | None, where: npt.NDArray[np.bool_]) -> Stated | None:
    """Errors stated for the pad: ``theirs``, of the frames ``where`` only, and ``mine`` for the others."""
    if mine is None and theirs is None:
        return None
    out = {}
    for f in fields(Stated):
        value = getattr(theirs, f.name, 0.0)
        whole = np.zeros((*where.shape, *np.shape(value)[1:])) if mine is None else np.array(getattr(mine, f.name))
        whole[where] = value
        out[f.name] = whole
    return Stated(**out)


def _rows(readings: Any, batch: tuple[int, ...], where: npt.NDArray[np.intp]) -> Any:
    """Selected frames of a batch as (frame, channel, *array), in the same kind of array."""
    values = to_numpy(readings)
    return from_numpy(values.reshape(-1, *values.shape[len(batch) :])[where], readings)


def _merged(found: Estimate, other: Estimate, pulls: npt.NDArray[np.bool_]) -> Estimate:
    """``found`` with the frames marked in ``pulls`` replaced by those of ``other``, whose arrays hold only these
    frames; fields missing in ``other`` become NaN.
    """

    def filled(mine: Any, theirs: Any, otherwise: Any = None) -> Any:
        if mine is None:
            return None
        values = np.array(to_numpy(mine))
        if theirs is not None:
            values[pulls] = to_numpy(theirs)
        elif otherwise is not None:
            values[pulls] = otherwise
        elif values.dtype.kind == "f":
            values[pulls] = np.nan
        return values

    def errors_of(name: str) -> Any:
        return filled(getattr(found.errors, name), getattr(other.errors, name, None))

    scale = None if other.noise_scale is None else other.noise_scale[..., None]
    both = {name: filled(getattr(found, name), getattr(other, name)) for name in ("parameter", "noise_std", "residual")}
    unknown = ("draws", "resolution", "sliding", "fit", "nuisance", "nuisance_std", "force_bounds")
    return replace(
        found,
        **both,
        **{name: filled(getattr(found, name), None) for name in unknown},
        traction=from_numpy(filled(found.traction, other.traction), found.traction),
        noise_scale=filled(found.noise_scale, scale),
        errors=None if found.errors is None else Errors(**{f.name: errors_of(f.name) for f in fields(Errors)}),
        stated=_both_stated(found.stated, other.stated, pulls),
        outliers=filled(found.outliers, None, False),  # the linear method uses every reading
        converged=filled(found.converged, other.converged, True),
        contact=filled(found.contact, None, True),
        discrepancy=filled(found.discrepancy, None, 0.0),  # that of a push is no error of the linear method
    )
