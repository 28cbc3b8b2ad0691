"""method="constrained": one penalised problem with its constraints, solved exactly.

The penalty is the first derivative of traction, evenly weighed; its weight and the noise come from marginal likelihood of the
linear model (`palpate.inverse.linear.parameter`) where they are not given. Pressure never pulls, shear stays inside the friction cone.
It is solved over the cells where contact is possible (`palpate.inverse.constrained.cone`); cells are added until none is missing. This is
what `palpate.inverse.contact.adaptive` starts from and what `palpate.tracking` repeats frame after frame.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import cached_property, few_threads
from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.constrained.cone import TOLERANCE, Cone, minimise
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.model import LARGEST_KEPT, ContactModel, Level, Normal, Rounds, dilated, level_operator
from palpate.inverse.constrained.products import AT_SIZE, Products, can_be_applied
from palpate.inverse.constrained.quadratic import Penalty
from palpate.inverse.constrained.responses import Responses
from palpate.inverse.contact.cells import solved
from palpate.inverse.contact.edges import outside_taxels, ring_of
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.few_cells import contact_in_few_cells
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.gathered import gathered
from palpate.inverse.contact.misfit import drift_probability, fit_of, misfit_of, noise_ratio, proportional_part
from palpate.inverse.contact.no_contact import detection_limit, explained_by_noise
from palpate.inverse.contact.noise import ChannelNoise
from palpate.inverse.contact.notes import single_taxel_share, smallness
from palpate.inverse.contact.observed import Observed, observe
from palpate.inverse.contact.outliers import without_outliers
from palpate.inverse.contact.overload import in_range
from palpate.inverse.contact.policy import STATED, Policy
from palpate.inverse.contact.posterior import Posterior, ambiguity_of
from palpate.inverse.contact.proposals import explanation_of
from palpate.inverse.contact.rims import with_rims
from palpate.inverse.contact.rivals import with_rivals
from palpate.inverse.contact.rough import rough_fit
from palpate.inverse.contact.screening import outermost, shallow
from palpate.inverse.contact.solving import solve
from palpate.inverse.contact.start import LinearStart, linear_models
from palpate.inverse.contact.summary import Summary
from palpate.inverse.contact.systematic import doubtful, inflate_for_misfit, nuisance_errors, share
from palpate.inverse.contact.unbounded import goes_on_all_round, offset_as_load
from palpate.inverse.contact.windows import Windows
from palpate.inverse.estimate import Errors, Estimate, batch_of, frames_of
from palpate.inverse.fit import POOR_FIT, neighbours
from palpate.inverse.linear.evidence import LinearEvidence
from palpate.inverse.linear.matrix_free.path import LinearModel, contact_at_size
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.inverse.linear.priors import DifferencePrior
from palpate.inverse.linear.whitening import Readings
from palpate.inverse.observability import pressing
from palpate.inverse.problem import Problem
from palpate.sensing.limits import ends_of
from palpate.sensing.nuisance import nuisances

__all__ = ["ConstrainedEstimator"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: What readings may hold besides contact where the user does not say.
DEFAULT_NUISANCES = ("offset", "rotation")


class ConstrainedEstimator:
    """The constrained estimator, prepared once for a problem and its constraints.

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

    def models(
        self,
        first: Floats,
        y: Floats,
        noise: Floats,
        observed: Flags,
        evidence: Mapping[int, LinearEvidence],
    ) -> Iterator[ContactModel]:
        """The models of a frame, with their weights: here one, the constrained solution on the contact and a margin.

        What is farther from it is noise, of which pressure that only pushes would keep half; so are patches that explain no more
        of the readings than noise does.
        """
        import scipy.ndimage

        policy = self.policy
        level = self.level(1)
        parameter, scale = evidence[1].parameter, evidence[1].scale
        region = dilated(
            (first[-1] > policy.extent.faint * first[-1].max()).reshape(level.grid.shape), policy.extent.margin
        )
        cells = np.flatnonzero(region)
        data = self.normal(level, cells, y, noise, observed)
        patches = scipy.ndimage.label(region, np.ones((3,) * region.ndim))[0].ravel()[cells]
        weight = {}
        for patch in np.unique(patches):
            alone = np.where(patches == patch, first[:, cells], 0.0)
            weight[patch] = 0.5 * float(((data.matrix @ alone.ravel()) ** 2).sum())
        largest = max(weight, key=lambda patch: weight[patch])
        kept = [patch for patch, w in weight.items() if w > policy.detection.patch or patch == largest]
        position = np.flatnonzero(np.isin(patches, kept))
        model = self.model(
            data.part(position),
            self.precisions(level, 1, parameter / scale**2),
            first[:, cells[position]],
            keep_face=True,
        )
        pressure = model.solution.traction[-1]
        sure = np.flatnonzero(pressure > policy.extent.faint * pressure.max())
        model.contact = self.model(
            model.data.part(sure),
            self.precisions(level, 1, parameter / scale**2),
            model.solution.traction[:, sure],
            keep_face=True,
        )
        model.weight = 1.0
        yield model

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
    def _widest(self) -> int:
        """Unknowns of the largest matrix of a frame. Where products serve large contacts matrices are small, and one thread is sooner than several that
        wait for each other (32 x 32 x 3 on two cores: 0.4 s against 1.6).
        """
        unknowns = self.inside.size * len(self.columns)
        return unknowns if self.ambiguous or not can_be_applied(self.operator) else min(unknowns, LARGEST_KEPT)

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane; every frame is decided alone."""
        like, batch = readings[0], batch_of(readings, self.operator)
        frames = []
        for f in frames_of(readings, self.operator):
            with few_threads(self._widest, len(self.readings.std)), self.rounds:
                frames.append(in_range(self, f, rng))
                if math.prod(batch) > 1:
                    frames[-1] = replace(frames[-1], errors=frames[-1].known)

        return gathered(self, frames, batch, like)

    @cached_property
    def even_noise(self) -> ConstrainedEstimator:
        """The same estimator with one noise for all channels of a kind (`Problem.with_even_noise`)."""
        problem = self.problem.with_even_noise()
        out = ConstrainedEstimator(problem, self.cone, parameter=self.parameter, draws=self.draws, policy=self.policy)
        out.signs = tuple(sign for sign in self.signs if sign)
        return out

    def cut(self, field: Floats) -> Floats:
        """The part of a field (..., *grid) that lies on the surface; a field of the surface's own grid is all of it."""
        if field.shape[-self.surface.dimensions :] == self.surface.shape:
            return field
        place: tuple[Any, ...] = (..., *self.window)
        return np.asarray(field[place])

    def frame(self, readings: Sequence[Floats], rng: np.random.Generator | None = None) -> Frame:
        """Contact in one frame of readings, (channel, *array) per plane."""
        policy, observed = self.policy, observe(self, readings)
        filled, usable = observed.filled, observed.usable
        noise_alone = explained_by_noise(self, filled, usable)
        small = None if noise_alone is None else contact_in_few_cells(self, filled, usable)
        noise_alone = noise_alone if small is None else None
        h = noise_alone or explanation_of(
            self, filled, usable, self.terms, signs=self.signs, noise=None if small is None else small.left
        )
        counted = observed
        if policy.parts.outliers and noise_alone is None:
            h, fewer = without_outliers(self, h, filled, usable)
            if (usable & ~fewer).any():
                told = h.sign * h.rough.explained + self.shifts @ h.sizes
                counted = replace(observed, filled=np.where(fewer, filled, told), usable=fewer)
        if self.ambiguous and noise_alone is None:
            chance = rough_fit(self, h, counted.filled, counted.usable)
            everywhere = chance < 1.0 and np.mean(h.rough.traction[-1] > 0) > policy.explanations.everywhere
            if chance < policy.explanations.structured_chance or everywhere:
                return self.unexplained(observed.data, ~counted.usable, chance)
        run = solve(self, h, counted)
        frame = self.framed(run, observed, rng)
        frame = with_rims(self, run, frame, observed, rng) or frame
        return with_rivals(self, run, frame, observed, rng)

    def as_they_are(self) -> ConstrainedEstimator:
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

    def framed(self, run: Solved, observed: Observed, rng: np.random.Generator | None) -> Frame:
        """One frame of the explanation that it was solved with."""
        h = run.explanation
        deviation = nuisance_errors(self, run)
        at_limit = observed.limited
        left_out = ~run.observed & ~at_limit
        each = np.full(self.noise.count, run.scale) if run.levels is None else run.levels
        if not run.members:
            rest = np.where(run.observed, run.data / np.where(run.noise > 0, run.noise, 1.0), 0.0)
            # a reading that stands alone may be a small contact right over a shallow taxel
            alone = np.where(shallow(self.operator.planes_of, self.policy), observed.data, 0.0)
            nothing = self._nothing(run.parameter, run.scale, run.data, left_out, alone)
            fit = misfit_of(self, run, rest, 0.0, float(np.abs(rest).max(initial=0.0)))
            errors, unknown = detection_limit(self, run, fit, nothing.known)
            result = replace(nothing, errors=errors, pushed=run.pushed and h.sign == 1, fit=fit, unproven=unknown)
        else:
            run.doubtful = doubtful(self, run)
            run.drift = drift_probability(self, run)
            for m in run.members:
                share(self, m, run, deviation, at_limit)
            fit, left, free = fit_of(self, run)
            if fit < POOR_FIT:
                inflate_for_misfit(self, run, fit)
            result = self.combined(run, each, fit, left, rng)
            # the models may explain on a finer grid what cells of the surface cannot
            pushed = (run.pushed or result.residual <= run.limit) and h.sign == 1
            turned = result.draws if result.draws is None or h.sign >= 0 else -result.draws
            result = replace(
                result,
                traction=-result.traction if h.sign < 0 else result.traction,
                draws=turned,
                outliers=left_out,
                pushed=pushed,
                adrift=run.adrift > 0.5,
                free=free,
                discrepancy=proportional_part(self, run),
            )
        bounds = offset_as_load(self, h, result.traction)
        undecided = bounds is not None
        if bounds is None:
            bounds = goes_on_all_round(self, result.traction, h.sign)
        return replace(
            result,
            sign=h.sign,
            nuisance=h.sizes,
            nuisance_std=deviation,
            at_limit=at_limit,
            undecided=undecided,
            bounds=result.bounds if bounds is None else bounds,
        )

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

    def _nothing(self, parameter: float, scale: float, data: Floats, outliers: Flags, alone: Any = 0.0) -> Frame:
        """No contact; ``alone`` is what readings that are left out may yet say of it."""
        grid, names = self.operator.surface, self.operator.surface.components
        shape = (len(names), *grid.shape)
        # from the readings themselves: the residual is all noise
        rms = float(np.sqrt(np.mean((data / self.readings.std) ** 2)))
        errors = self.undetected(scale if self.noise_known else rms, np.where(outliers, alone, data))
        empty = np.zeros((self.draws, *shape)) if self.draws else None
        noise = np.full(self.noise.count, scale)
        return Frame(np.zeros(shape), errors, parameter, noise, rms, True, False, outliers, empty)

    def unexplained(self, data: Floats, outliers: Flags, chance: float) -> Frame:
        """A frame that no contact explains: nothing is known."""
        nothing = self._nothing(math.nan, math.nan, data, outliers)
        unknown = {f.name: np.full_like(getattr(nothing.known, f.name), math.nan) for f in fields(Errors)}
        gap, terms = math.nan * nothing.traction, np.full(len(self.terms), math.nan)
        return replace(
            nothing,
            traction=gap,
            errors=Errors(**unknown),
            contact=True,
            pushed=False,
            fit=chance,
            nuisance=terms,
            nuisance_std=terms,
            at_limit=np.zeros(len(data), dtype=bool),
        )

    def fit(
        self,
        linear: Floats,
        y: Floats,
        noise: Floats,
        observed: Flags,
        weight: float,
        near: Floats | None = None,
    ) -> tuple[Floats, Floats]:
        """The constrained solution on the surface grid (component, cell), and the readings that it explains (`cells.solved`)."""
        return solved(self, linear, y, noise, observed, weight, near)

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

    def combined(
        self,
        run: Solved,
        noise: Floats,
        fit: float,
        left: float,
        rng: np.random.Generator | None,
        also: Solved | None = None,
    ) -> Frame:
        """The mean of the models of a run, and of ``also`` another, with the errors of all."""
        policy = self.policy
        runs = [run] if also is None else [run, also]
        members = [m for r in runs for m in r.members]
        large = any(m.data.at_size for m in members)
        summary = Summary(members, self.posterior)
        limit = policy.fit.alike if len(self.readings.std) <= policy.fit.few else policy.fit.doubted
        summary.alike = self.readings.independent and self.problem.nuisance is None and fit < limit
        summary.noise_ratio = noise_ratio(self, run, left)
        summary.gain = self.problem.uncertainty.assumed_gain
        summary.whites = [
            self.readings.white((r.data / r.noise)[r.observed], r.observed) for r in runs for _ in r.members
        ]
        weights = np.array([m.weight for m in members])
        sampled = None
        if self.draws:
            sampled = self.posterior.draws(members, weights, self.draws, rng or np.random.default_rng(0))
        alone = single_taxel_share(
            self.operator.planes_of, run, np.abs(summary.mean[-1]), self.operator.surface, policy
        )
        summary.doubted = 0.5 / STATED * alone if policy.errors.much < alone < 1.0 - policy.errors.much else 0.0
        return Frame(
            summary.mean,
            summary if large else summary.errors(),
            run.parameter,
            noise,
            left,
            all(m.solution.converged for m in members),
            True,
            ~run.observed,
            sampled,
            sliding=sum(m.weight for m in members if m.ray is not None),
            fit=fit,
            small=smallness(members, self.operator.planes_of, run, policy),
            stated=summary.stated(),
            alone=alone,
            beyond=self.posterior.beyond(summary.mean),
            hangs=0.0 if self.given_ends or not self.readings.independent else summary.largest_part(),
        )
