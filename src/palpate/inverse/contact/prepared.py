"""Everything that is prepared once for a problem and its constraints: operator, whitening, linear models, grids,
nuisance patterns; and numerics that use them.

This file makes no decision about a frame. The modules that decide (`search`, `proposals`, `solving`, `answer`) receive
a `PreparedContact`. It stores nothing about a frame, except the cache `rounds` while that frame is solved.
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import cached_property
from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.constrained.cone import TOLERANCE, Cone, minimise
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.model import MAX_CACHED_UNKNOWNS, ContactModel, Level, Normal, Rounds
from palpate.inverse.constrained.products import AT_SIZE, Products, can_be_applied
from palpate.inverse.constrained.quadratic import Penalty
from palpate.inverse.constrained.responses import Responses
from palpate.inverse.contact.edges import outside_taxels, ring_of
from palpate.inverse.contact.noise import ChannelNoise
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.posterior import Posterior, ambiguity_of
from palpate.inverse.contact.screening import outermost
from palpate.inverse.contact.start import LinearStart
from palpate.inverse.estimate import Errors
from palpate.inverse.fit import neighbours
from palpate.inverse.linear.evidence import LinearEvidence
from palpate.inverse.linear.matrix_free.path import contact_at_size, linear_model
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.inverse.linear.priors import DifferencePrior
from palpate.inverse.linear.whitening import Readings
from palpate.inverse.observability import pressing
from palpate.inverse.problem import Problem
from palpate.sensing.grids import resampled
from palpate.sensing.limits import ends_of
from palpate.sensing.nuisance import DRIFTS, LATER, USUAL, Nuisance, groups, nuisances

__all__ = ["PreparedContact", "TooLarge"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


class TooLarge(Unsupported):
    """A contact has too many unknowns; an alternative that has is not tried."""


class PreparedContact(ABC):
    """A problem in which contact is sought, prepared once.

    The surface is the middle part of the operator's grid. Cells outside the surface explain a contact across the edge
    of the array and are not part of the result. ``parameter`` is the weight of the penalty (None: chosen by evidence),
    ``draws`` the number of posterior samples of each frame.
    """

    #: Orders of the derivatives whose penalties are compared by evidence.
    derivatives: tuple[int, ...] = (1,)
    #: Whether the method allows contact on a wider grid than the surface.
    past_the_surface = False
    #: For channels that cannot separate pressure from shear: effect of pressure relative to that of shear above which
    #: the error of the normal force needs no widening. With one model, and in the tracker, the normal force was 14 %
    #: low on average at a ratio of 0.3, 26 % at 0.16 and 60 % at 0.02.
    acts = 1.0

    def __init__(
        self,
        problem: Problem,
        cone: Cone,
        *,
        parameter: float | None = None,
        draws: int = 0,
        policy: Policy | None = None,
    ) -> None:
        self.policy = policy or Policy()
        self.parameter, self.draws = parameter, draws
        self.wide = self.past_the_surface and self.policy.parts.wide_surface and not problem.fixed
        self.surface = self.grid = problem.surface
        if self.past_the_surface:
            problem = problem.coarser(self.policy.work.unknowns)
        self.problem, self.columns = problem, problem.columns
        self.cone = cone if self.policy.parts.constraint else Cone(cone.components, tension=True)
        self.operator = problem.wide if self.wide else problem.operator
        #: Whether the linear model can fit any readings, noise included. It then gives no information on noise or
        #: offsets.
        self.ambiguous = problem.ambiguous
        #: Whether the linear model is matrix-free. Contact is matrix-free too if that is faster.
        self.at_size = contact_at_size(problem, wide=self.wide)
        self._describe_array()
        self._prepare_linear(cone.friction)
        self._responses = Responses(self.operator, self.columns, self.readings)
        self._levels: dict[int, Level] = {}
        self.rounds = Rounds()
        ambiguity = (0.0, 0.0, 0.0, 0.0)
        if problem.ambiguous:
            acting = pressing(problem.pad, problem.planes, problem.components[:-1])
            ambiguity = ambiguity_of(acting, self.acts, self.policy, coupled=cone.coupled)
        self.posterior = Posterior(
            self.operator, self.columns, cone, self.inside, self.outside, self.reach, self.policy, ambiguity=ambiguity
        )
        self._list_nuisances()
        self.start = LinearStart(self.orders, self.readings, parameter, self.rounds, self.policy)
        self.outermost = outermost(self.orders[1])
        #: Signs of contact to try (`proposals`): push (1), pull as a whole (-1), both (0; solved by the linear method).
        self.signs: tuple[int, ...] = (1,)

    def _describe_array(self) -> None:
        """What follows from the grid and the taxels alone."""
        operator, grid = self.operator, self.operator.surface
        # Cells of the operator's grid that belong to the result.
        inner = self.problem.surface.shape
        self.window = tuple(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid.shape, inner))
        self.inside = np.zeros(grid.shape, dtype=bool)
        self.inside[self.window] = True
        # Cells outside the outermost taxels.
        self.outside = outside_taxels(operator)
        self.ring = ring_of(self.outside)
        self.given_ends = ends_of(operator.planes_of)
        self.depth = max(min(a.depth for a in operator.planes_of), max(grid.spacings))
        self.taxels = max(int(a.valid.sum()) for a in operator.planes_of)
        #: Whether wide contacts are solved by products, so that each solution takes long.
        self.large = self.at_size or self.taxels >= self.policy.explanations.many_taxels
        #: Whether some readings decrease as slowly with distance as displacement does.
        self.far = any(find_channel(c).kind.absolute for a in operator.planes_of for c in a.channels)

    def _prepare_linear(self, friction: float | None) -> None:
        """The linear models, and the readings in units of their noise."""
        problem, operator = self.problem, self.operator
        # Prior variance of the shear components relative to pressure: friction squared, divided between two components.
        shear = 0.5 * (friction or self.policy.prior.shear) ** 2
        self.variances = [*[shear] * (len(self.columns) - 1), 1.0]
        readings = sum(int(a.valid.sum()) * len(a.channels) for a in operator.planes_of)
        second = readings <= self.policy.work.many_readings and self.policy.parts.second_derivative
        priors = {
            order: [DifferencePrior(operator.surface, order, v) for v in self.variances]
            for order in (self.derivatives if second else (1,))
        }
        self.orders = {order: linear_model(problem, each, wide=self.wide) for order, each in priors.items()}
        problem.prepare_doubts(wide=self.wide)
        self.scales, self.noise_known = self.orders[1].scales, self.orders[1].noise_known
        self.readings = Readings(operator, self.scales)
        self.zero = None if problem.zero is None else self.readings.flat(problem.zero)
        self.noise = ChannelNoise(operator, self.readings, self.noise_known, self.policy)
        units = np.array([find_channel(c).kind.unit for a in operator.planes_of for c in a.channels])
        #: Masks of the readings of each unit (unit, reading): of stress, strain, displacement.
        self.of_unit = np.array([(units == u)[self.noise.index] for u in np.unique(units)])

    def _list_nuisances(self) -> None:
        """List the nuisances that may be in the readings."""
        problem, planes = self.problem, self.operator.planes_of
        kinds = USUAL if problem.nuisance is None else problem.nuisance
        self.terms = nuisances(planes, kinds) if self.policy.parts.nuisances else []
        #: Whether a zero removed the offsets of stress and strain; an image may still have moved. They come last. If the
        #: user names a drift, it is one after the zero.
        self.removed = problem.zeroed and problem.nuisance is None
        self.terms.sort(key=lambda t: self.removed and not t.of_image)
        #: Number of terms, from the first, that may also occur together with noise alone. Ramps that the user did not
        #: name come after them: they are only tried together with contact, if the outermost taxels show one. Where
        #: channels do not separate pressure from shear, a ramp would explain what coarse cells of a wide contact leave: none is sought.
        self.usual = len(self.terms)
        if self.terms and problem.nuisance is None and not self.ambiguous:
            self.terms += [t for t in nuisances(planes, LATER) if t.of_image or not problem.zeroed]
            if not problem.zeroed and not self.large:
                self.terms += groups(planes)

    def edge_load(self, pressure: Floats) -> float:
        """Fraction of the cells above the outermost taxels that are loaded."""
        top = float(pressure.max(initial=0.0))
        return float((pressure.ravel()[self.ring] > self.policy.extent.faint * top).mean()) if top > 0 else 0.0

    def least_noise(self, data: Floats) -> float:
        """Smallest noise to assume, in units of the whitening: the accuracy of the model for these readings."""
        return MODEL_ERROR * float(np.abs(data / self.readings.std).max(initial=0.0))

    @property
    def reach(self) -> int:
        """Width in cells of the margin around the contact whose error bars include the uncertainty of its edge."""
        return self.policy.extent.margin

    @property
    def finds_sliding(self) -> bool:
        """Whether models of a sliding contact are among the candidates."""
        return False

    def level(self, ratio: int) -> Level:
        """The operator on cells ``ratio`` times finer; built once."""
        if ratio not in self._levels:
            operator = self.problem.kept.get(("level", self.wide, ratio), lambda: self.operator.finer(ratio))
            self._levels[ratio] = Level(operator, ratio, self.columns, self.readings)
        return self._levels[ratio]

    def precisions(self, level: Level, order: int, weight: float) -> list[Sparse]:
        """Even penalty of each component on a level, as precision matrices: of rough solutions, from whose residuals
        the noise and the explanation follow, and of the models of the chosen explanation.
        """
        return level.differences.even(order, [weight / v for v in self.variances])

    def taken(self, pressure: Floats, parameter: float) -> float:
        """Degrees of freedom that a solution with this pressure takes, estimated without its factor
        (`variances.taken_by`): those of the linear model, times the number of loaded cells per taxel. On a surface much
        larger than the array these are too many.
        """
        return min(float(np.count_nonzero(pressure)) / self.taxels, 1.0) * self.start.freedom(parameter)

    def resolution(self, parameter: float) -> float:
        """Finest detail that the data determine [m]: the side of the area (on a line, the length) per degree of
        freedom.
        """
        arrays = self.operator.planes_of
        points = np.concatenate([a.points for a in arrays])
        spans = np.ptp(points, axis=0) + np.asarray(self.operator.surface.spacings)
        return float(
            (np.prod(spans) * len(self.columns) / max(self.start.freedom(parameter), 1.0)) ** (1.0 / len(spans))
        )

    @cached_property
    def widest(self) -> int:
        """Unknowns of the largest matrix of a frame. For large contacts solved matrix-free, matrices are small, and
        one thread is faster than several (32 x 32 x 3 on two cores: 0.4 s instead of 1.6 s).
        """
        unknowns = self.inside.size * len(self.columns)
        return unknowns if self.ambiguous or not can_be_applied(self.operator) else min(unknowns, MAX_CACHED_UNKNOWNS)

    def cut(self, field: Floats) -> Floats:
        """The part of a field (..., *grid) that lies on the surface, on the surface's cells; a field already on them is
        returned unchanged.
        """
        d, inner = self.surface.dimensions, self.problem.surface.shape
        if field.shape[-d:] == self.surface.shape:
            return field
        place: tuple[Any, ...] = (..., *self.window)
        field = field if field.shape[-d:] == inner else field[place]
        return np.asarray(field if inner == self.surface.shape else resampled(field, self.surface.shape))

    @cached_property
    def settled(self) -> PreparedContact:
        """A copy without the nuisances that the zero removed; itself if there are none."""
        kept = [t for t in self.terms if t.of_image or not self.removed]
        if len(kept) == len(self.terms):
            return self
        return self._with_terms(kept, sum(t.of_image for t in self.terms[: self.usual]))

    @cached_property
    def seeks_no_drift(self) -> PreparedContact:
        """A copy that seeks none of the nuisances that the zero removed; its errors still allow for them."""
        return self._with_terms(self.terms, sum(t.of_image for t in self.terms[: self.usual])) if self.removed else self

    def _with_terms(self, terms: list[Nuisance], usual: int) -> PreparedContact:
        """A copy with other nuisances, the first ``usual`` of which may be present without contact."""
        out = copy.copy(self)
        out.terms, out.usual = terms, usual
        for made in ("shifts", "settled", "seeks_no_drift"):
            out.__dict__.pop(made, None)
        return out

    def as_they_are(self) -> PreparedContact:
        """A copy that takes all readings as they are: no saturation, no outliers, no offsets."""
        out = self._with_terms([], 0)
        out.policy = replace(self.policy, parts=replace(self.policy.parts, screening=False, outliers=False))
        out.given_ends = None
        even = out.__dict__.pop("even_noise", None)
        if even is not None:
            out.__dict__["even_noise"] = even.as_they_are()
        return out

    @property
    def since_zero(self) -> Flags:
        """Mask of the terms that a zero has removed: what is left of them arose after it."""
        return np.array([self.removed and not t.of_image for t in self.terms], dtype=bool)

    @cached_property
    def shifts(self) -> Floats:
        """Readings (reading, term) that each nuisance of size one adds."""
        n = len(self.readings.std)
        return np.stack([t.rows for t in self.terms], axis=1) if self.terms else np.zeros((n, 0))

    @cached_property
    def drifts(self) -> list[Nuisance]:
        """Offset and ramp of every channel."""
        return nuisances(self.operator.planes_of, DRIFTS)

    @cached_property
    def even_press(self) -> Floats:
        """Readings (reading, component sought) under a constant traction of 1 Pa that extends far beyond the array."""
        grid = self.operator.surface
        each = np.eye(len(self.columns))[:, :, None] * np.ones(math.prod(grid.shape))
        return np.stack([self.explained_by(t) for t in each], axis=1)

    @cached_property
    def pairs(self) -> tuple[Index, Index]:
        """Pairs of neighbouring readings."""
        return neighbours(self.operator.planes_of)

    def undetected(self, scale: float, data: Floats | None = None) -> Errors:
        """Errors of a frame without contact: the largest contact that would not be detected."""
        width = max(self.operator.surface.spacings)
        # Cells as coarse as the array cannot represent a place between shallow taxels.
        coarse = min(a.depth for a in self.operator.planes_of) < width and self.inside.sum() <= 2 * self.taxels
        finer = self.level(2).operator if coarse else None
        return self.posterior.undetected(self.readings, self.depth, scale, finer=finer, data=data)

    def quiet(self, y: Floats) -> float:
        """Fraction of the peak below which pressure cannot be distinguished from zero, for whitened readings ``y``."""
        policy = self.policy
        return float(
            np.clip(
                policy.extent.noisy / max(float(np.abs(y).max()), 1e-300), policy.extent.quiet, policy.extent.most_quiet
            )
        )

    def data_of(self, readings: Sequence[Floats]) -> tuple[Floats, Flags]:
        """Readings (reading,) of a frame, 0 if missing (NaN), and which are missing."""
        missing = np.isnan(self.readings.flat(readings))
        there = [np.nan_to_num(part) for part in readings] if missing.any() else readings
        return self.readings.flat(self.operator.observed(there)), missing

    def explained_by(self, traction: Floats) -> Floats:
        return self._responses.of(traction)

    def misfit_gradient(self, residual: Floats, noise: Floats, observed: Flags, *, last: bool = False) -> Floats:
        """A' N^-1 residual for every surface cell, (component, cell), or of the ``last`` component alone. ``residual``
        (reading,) is in units of the noise.
        """
        white = np.zeros(len(residual))
        white[observed] = self.readings.white(self.readings.white(residual[observed], observed), observed)
        return self._responses.back(white / noise, last=last)

    def check_size(self, unknowns: int) -> None:
        """Raise `TooLarge` if a contact has too many unknowns."""
        policy = self.policy
        if unknowns > policy.work.unknowns:
            raise TooLarge(
                f"the contact covers {unknowns} unknowns, too many (limit {policy.work.unknowns}). Give a "
                "coarser surface (Skin(..., surface=...)), or "
                + (f"seek {list(self.cone.components[:-1])} alone." if self.ambiguous else 'use method="tikhonov".')
            )

    def model(
        self,
        data: Normal,
        precision: Sparse | Sequence[Sparse],
        start: Floats,
        *,
        keep_face: bool = False,
        tolerance: float = TOLERANCE,
    ) -> ContactModel:
        each = [precision] * len(self.columns) if isinstance(precision, scipy.sparse.csr_array) else precision
        penalty = Penalty(data.cells, each, data.level.grid.shape)
        hessian = data.quadratic(penalty)
        if isinstance(hessian, Products):
            tolerance = max(tolerance, AT_SIZE)
        solution = minimise(hessian, data.linear, self.cone, start, tolerance=tolerance, keep_face=keep_face)
        return ContactModel(data, hessian, penalty, solution)

    def normal(
        self, level: Level, cells: Index, y: Floats, noise: Floats, observed: Flags, *, once: bool = False
    ) -> Normal:
        # Ambiguous channels make the system too badly conditioned for iterative products.
        kept = self.rounds.kept
        return level.normal(
            cells, y, noise, observed, kept, products=not self.ambiguous, once=once, slides=self.finds_sliding
        )

    @abstractmethod
    def models(
        self,
        first: Floats,
        y: Floats,
        noise: Floats,
        observed: Flags,
        evidence: Mapping[int, LinearEvidence],
        near: ContactModel | None = None,
    ) -> Iterator[ContactModel]:
        """Yield the models of a frame with their weights, from a rough solution ``first`` and readings ``y`` in units
        of the noise. ``near`` is a model of the same frame with other noise, from which solutions may start.
        """

    def models_over(
        self,
        region: Flags,
        first: Floats,
        y: Floats,
        noise: Floats,
        observed: Flags,
        evidence: Mapping[int, LinearEvidence],
        near: ContactModel | None = None,
    ) -> Iterator[ContactModel]:
        """The same as `models`, with contact only inside a ``region`` (*grid), if the method supports it."""
        raise NotImplementedError(f"{type(self).__name__} makes no models over a region")

    @property
    @abstractmethod
    def even_noise(self) -> PreparedContact:
        """A copy with one noise level for all channels of a kind, and one even penalty (`Problem.with_even_noise`)."""
