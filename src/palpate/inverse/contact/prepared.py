"""What is prepared once for a problem and its constraints: operator, whitening, linear models, grids, patterns of nuisances; and the numerics of one frame on them.

Nothing here decides what a frame is. It is handed to those that do (`search`, `proposals`, `solving`, `answer`), and holds nothing of a frame but what `rounds` keeps while one is
solved.
"""

from __future__ import annotations

import copy
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
from palpate.inverse.constrained.model import MAX_CACHED_UNKNOWNS, ContactModel, Level, Normal, Rounds, level_operator
from palpate.inverse.constrained.products import AT_SIZE, Products, can_be_applied
from palpate.inverse.constrained.quadratic import Penalty
from palpate.inverse.constrained.responses import Responses
from palpate.inverse.contact.edges import outside_taxels, ring_of
from palpate.inverse.contact.noise import ChannelNoise
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.posterior import Posterior, ambiguity_of
from palpate.inverse.contact.screening import outermost
from palpate.inverse.contact.start import LinearStart, linear_models
from palpate.inverse.contact.windows import Windows
from palpate.inverse.estimate import Errors
from palpate.inverse.fit import neighbours
from palpate.inverse.linear.evidence import LinearEvidence
from palpate.inverse.linear.matrix_free.path import LinearModel, contact_at_size
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.inverse.linear.priors import DifferencePrior
from palpate.inverse.linear.whitening import Readings
from palpate.inverse.observability import pressing
from palpate.inverse.problem import Problem
from palpate.sensing.limits import ends_of
from palpate.sensing.nuisance import nuisances

__all__ = ["Prepared"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: What readings may hold besides contact where the user does not say.
DEFAULT_NUISANCES = ("offset", "rotation")


class Prepared(ABC):
    """A problem, prepared once.

    The surface is the middle of the operator's grid: a contact across the array's edge is explained by cells farther out than anyone wants
    to see. ``parameter`` is the weight of the penalty (None: by evidence), ``draws`` the number of posterior samples of each frame.
    """

    #: Derivatives whose penalties are compared by evidence.
    derivatives: tuple[int, ...] = (1,)
    #: Whether contact is sought on a wider grid than the surface.
    past_the_surface = False
    #: Where channels alone do not tell pressure from shear: how much pressure must act on them for the least error of the normal force to be no more. One
    #: model, and the tracker, read it 14 % low on average where pressure acts 0.3 times as shear does, 26 % at 0.16 and 60 % at 0.02.
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
        self.problem, self.columns = problem, problem.columns
        self.cone = cone if self.policy.parts.constraint else Cone(cone.components, tension=True)
        columns, operator = self.columns, problem.wide if self.wide else problem.operator
        self.operator = operator
        grid = operator.surface
        self.surface = self.grid = problem.surface
        # the cells of the operator's grid that the result is made of
        self.window = tuple(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid.shape, self.surface.shape))
        self.inside = np.zeros(grid.shape, dtype=bool)
        self.inside[self.window] = True
        # outside the outermost taxels
        self.outside = outside_taxels(operator)
        # shear varies less than pressure, by what friction allows, shared between its components
        shear = 0.5 * (cone.friction or self.policy.prior.shear) ** 2
        self.variances = [1.0 if c == len(columns) - 1 else shear for c in range(len(columns))]
        readings = sum(int(a.valid.sum()) * len(a.channels) for a in operator.planes_of)
        second = readings <= self.policy.work.second_order and self.policy.parts.second_derivative
        orders = self.derivatives if second else (1,)
        #: Whether the linear model is matrix-free, and so is contact where that is sooner.
        self.at_size = contact_at_size(problem, wide=self.wide)
        priors = {order: [DifferencePrior(grid, order, v) for v in self.variances] for order in orders}
        self.orders = linear_models(problem, priors, wide=self.wide)
        problem.prepare_doubts(wide=self.wide)
        self.scales, self.noise_known = self.orders[1].scales, self.orders[1].noise_known
        self.readings = Readings(operator, self.scales)
        self.given_ends = ends_of(operator.planes_of)
        self.zero = None if problem.zero is None else self.readings.flat(problem.zero)
        self.noise = ChannelNoise(operator, self.readings, self.noise_known, self.policy)
        self._responses = Responses(operator, columns, self.readings)
        self._levels: dict[int, Level] = {}
        self.rounds = Rounds()
        ambiguity = (0.0, 0.0, 0.0, 0.0)
        if problem.ambiguous:
            acting = pressing(problem.pad, problem.planes, problem.components[:-1])
            ambiguity = ambiguity_of(acting, self.acts, self.policy, coupled=cone.coupled)
        self.posterior = Posterior(
            operator, columns, cone, self.inside, self.outside, self.reach, self.policy, ambiguity=ambiguity
        )
        self.depth = max(min(a.depth for a in operator.planes_of), max(grid.spacings))
        self.taxels = max(int(a.valid.sum()) for a in operator.planes_of)
        #: Whether the linear model can follow any readings, noise too: it tells nothing of noise, nor of offsets.
        self.ambiguous = problem.ambiguous
        kinds = problem.nuisance or () if self.ambiguous or problem.nuisance is not None else DEFAULT_NUISANCES
        self.terms = nuisances(operator.planes_of, kinds) if self.policy.parts.nuisances else []
        if problem.zeroed:
            # the zero took the offsets of stress and strain out; an image may still have moved
            self.terms = [t for t in self.terms if t.kind == "rotation" or t.unit == "m"]
        #: Those that noise alone may stand about; a ramp that nobody named is sought with contact alone, where offsets leave doubt.
        self.usual = len(self.terms)
        if self.terms and problem.nuisance is None:
            self.terms += [t for t in nuisances(operator.planes_of, ("ramp",)) if not problem.zeroed or t.unit == "m/m"]
        windows = Windows(problem, self.columns, self.variances, kinds if self.terms else ())
        self.start = LinearStart(self.orders, self.readings, parameter, self.rounds, windows, self.policy)
        self.ring = ring_of(self.outside)
        self.outermost = outermost(self.orders[1])
        self.far = any(find_channel(c).kind.absolute for a in operator.planes_of for c in a.channels)
        #: What contact may do (`explanations`): push (1), pull as a whole (-1), both (0; the linear method's then).
        self.signs: tuple[int, ...] = (1,)

    def ring_load(self, pressure: Floats) -> float:
        """The part of the cells over the outermost taxels that are loaded."""
        top = float(pressure.max(initial=0.0))
        return float((pressure.ravel()[self.ring] > self.policy.extent.faint * top).mean()) if top > 0 else 0.0

    def least_noise(self, data: Floats) -> float:
        """The least noise that is assumed, in units of the whitening."""
        return MODEL_ERROR * float(np.abs(data / self.readings.std).max(initial=0.0))

    @property
    def reach(self) -> int:
        """Cells round those in contact beyond doubt that share their error."""
        return self.policy.extent.margin

    @property
    def finds_sliding(self) -> bool:
        """Whether models of a contact that slides are among those weighed."""
        return False

    def level(self, ratio: int) -> Level:
        """The operator on cells ``ratio`` times finer, made once."""
        if ratio not in self._levels:
            operator = self.problem.kept.get(("level", self.wide, ratio), lambda: level_operator(self.operator, ratio))
            self._levels[ratio] = Level(operator, ratio, self.columns, self.readings)
        return self._levels[ratio]

    def precisions(self, level: Level, order: int, weight: float) -> list[Sparse]:
        """The even penalty of each component on a level."""
        return level.differences.even(order, [weight / v for v in self.variances])

    def effective_freedom(self, parameter: float) -> float:
        """How many degrees of freedom of the traction the data tell, rather than the penalty."""
        return self.start.freedom(parameter)

    def resolution(self, parameter: float) -> float:
        """Finest detail that the data tell [m]: the side of the area (length on a line) that has one degree of freedom."""
        arrays = self.operator.planes_of
        points = np.concatenate([a.points for a in arrays])
        spans = np.ptp(points, axis=0) + np.asarray(self.operator.surface.spacings)
        return float(
            (np.prod(spans) * len(self.columns) / max(self.effective_freedom(parameter), 1.0)) ** (1.0 / len(spans))
        )

    @cached_property
    def widest(self) -> int:
        """Unknowns of the largest matrix of a frame. Where products serve large contacts matrices are small, and one thread is sooner than several that
        wait for each other (32 x 32 x 3 on two cores: 0.4 s against 1.6).
        """
        unknowns = self.inside.size * len(self.columns)
        return unknowns if self.ambiguous or not can_be_applied(self.operator) else min(unknowns, MAX_CACHED_UNKNOWNS)

    def cut(self, field: Floats) -> Floats:
        """The part of a field (..., *grid) that lies on the surface; a field of the surface's own grid is all of it."""
        if field.shape[-self.surface.dimensions :] == self.surface.shape:
            return field
        place: tuple[Any, ...] = (..., *self.window)
        return np.asarray(field[place])

    def as_they_are(self) -> Prepared:
        """The same estimator, for which no reading is at the end of its range, broken, or off by an offset."""
        out = copy.copy(self)
        out.policy = replace(self.policy, parts=replace(self.policy.parts, screening=False, outliers=False))
        out.given_ends, out.terms, out.usual = None, [], 0
        out.__dict__.pop("shifts", None)
        even = out.__dict__.pop("even_noise", None)
        if even is not None:
            out.__dict__["even_noise"] = even.as_they_are()
        return out

    @cached_property
    def shifts(self) -> Floats:
        """The nuisances over the readings (reading, term)."""
        n = len(self.readings.std)
        return np.stack([t.rows for t in self.terms], axis=1) if self.terms else np.zeros((n, 0))

    @cached_property
    def even_press(self) -> Floats:
        """Readings (reading, component sought) under an even traction of 1 Pa that reaches far beyond the array."""
        grid = self.operator.surface
        size = len(self.columns), int(np.prod(grid.shape))
        each = [np.where(np.arange(size[0])[:, None] == i, np.ones(size), 0.0) for i in range(size[0])]
        return np.stack([self.explained_by(t) for t in each], axis=1)

    @cached_property
    def pairs(self) -> tuple[Index, Index]:
        """Readings that are neighbours."""
        return neighbours(self.operator.planes_of)

    def evidence(self, linear: LinearModel, rows: Sequence[Floats], known: float | None) -> LinearEvidence:
        """What a linear model makes of a frame; ``known`` fixes the noise scale where it is not the arrays' own."""
        return self.start.evidence(linear, rows, known)

    def undetected(self, scale: float, data: Floats | None = None) -> Errors:
        """Errors of a frame without contact: what would not be noticed."""
        width = max(self.operator.surface.spacings)
        # cells that are not finer than the array do not tell a place between shallow taxels
        coarse = min(a.depth for a in self.operator.planes_of) < width and self.inside.sum() <= 2 * self.taxels
        finer = self.level(2).operator if coarse else None
        return self.posterior.undetected(self.readings, self.depth, scale, finer=finer, data=data)

    def quiet(self, y: Floats) -> float:
        """The part of the peak below which pressure is not told from none, for whitened readings."""
        policy = self.policy
        return float(
            np.clip(
                policy.extent.noisy / max(float(np.abs(y).max()), 1e-300), policy.extent.quiet, policy.extent.most_quiet
            )
        )

    def explained_by(self, traction: Floats) -> Floats:
        return self._responses.of(traction)

    def misfit_gradient(self, residual: Floats, noise: Floats, observed: Flags) -> Floats:
        """A' N^-1 residual for every surface cell, (component, cell); ``residual`` is in units of the noise."""
        white = np.zeros(len(residual))
        white[observed] = self.readings.white(self.readings.white(residual[observed], observed), observed)
        return self._responses.back(white / noise)

    def check_size(self, unknowns: int) -> None:
        """Refuse a problem that is too large."""
        policy = self.policy
        if unknowns > policy.work.unknowns:
            raise Unsupported(
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
        # what readings hardly tell apart is too badly conditioned for products
        kept = self.rounds.kept
        return level.normal(
            cells, y, noise, observed, kept, products=not self.ambiguous, once=once, slides=self.finds_sliding
        )

    @abstractmethod
    def models(
        self, first: Floats, y: Floats, noise: Floats, observed: Flags, evidence: Mapping[int, LinearEvidence]
    ) -> Iterator[ContactModel]:
        """The models of a frame, with their weights, from a rough solution ``first`` and readings ``y`` in units of the noise."""

    def models_over(
        self,
        region: Flags,
        first: Floats,
        y: Floats,
        noise: Floats,
        observed: Flags,
        evidence: Mapping[int, LinearEvidence],
    ) -> Iterator[ContactModel]:
        """The same with contact in a ``region`` (*grid) alone, where a method has such models."""
        raise NotImplementedError(f"{type(self).__name__} makes no models over a region")

    @property
    @abstractmethod
    def even_noise(self) -> Prepared:
        """The same with one noise for all channels of a kind, and one even penalty (`Problem.with_even_noise`)."""
