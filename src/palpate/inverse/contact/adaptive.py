"""method="adaptive": contact found from the readings alone, with nothing to tune.

What is known of contact before anything is measured: pressure never pulls, shear stays inside the friction cone, contact is
compact, and traction is smooth within it while it may jump at its edge. What is not known, the noise and how much traction
varies from place to place, is learned from the frame itself:

1. noise level and amplitude by marginal likelihood of the linear model (`palpate.inverse.linear.parameter`); a frame that noise alone
   explains as well is reported as no contact;
2. the penalised problem with its constraints, solved exactly over the cells where contact is possible
   (`palpate.inverse.constrained.cone`), on a grid finer than the surface, because where in a cell an edge lies matters;
3. the penalty relearned from its own result: |grad t|^2 is weighed by 1/tau, where tau(x) is the local mean square
   gradient of the solution before. This is majorisation of log tau (M. Fazel, H. Hindi, S. Boyd, Proc. American Control Conf.
   2003, 2156-2162; with the posterior variance kept, the EM iteration of sparse Bayesian learning, M. E. Tipping, J. Mach.
   Learn. Res. 1, 2001, 211-244): edges become sharp where there are edges, the outside becomes quiet, the inside
   stays smooth;
4. the mean over three models of the same readings: an even penalty on the first and second derivative (weighed by
   evidence), and local weights of a wide and a narrow reach. One frame cannot say which is right: their spread is part of the
   error bar;
5. where friction is known, the same models of a contact that slides as a whole (q in one proportion to p), weighed by evidence: the
   cone alone lets shear fall short wherever noise makes the pressure small, but never lets it exceed where noise makes it large;
6. readings that no contact explains (dead, stuck or saturated taxels) are left out and named.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.factors import cholesky
from palpate.inverse.constrained.model import ContactModel, Level, Normal, dilated
from palpate.inverse.constrained.variances import taken_by, variance_of
from palpate.inverse.contact.compact import Discs, discs
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.score import weights_by_evidence
from palpate.inverse.contact.sliding import expanded, in_blocks, ways_of_sliding
from palpate.inverse.linear.evidence import LinearEvidence
from palpate.inverse.observability import ACTS
from palpate.sensing.grids import repeated

__all__ = ["AdaptiveEstimator"]

Flags = npt.NDArray[np.bool_]


class AdaptiveEstimator(ConstrainedEstimator):
    """The adaptive estimator, prepared once for a problem and its constraints."""

    past_the_surface = True

    derivatives = (1, 2)
    acts = ACTS

    @property
    def reach(self) -> int:
        """Cells round those in contact that share their error."""
        return 1

    @property
    def finds_sliding(self) -> bool:
        """Where friction is given."""
        return self.cone.coupled

    def _ratio(self, places: float, freedom: float, unknowns: int) -> int:
        """How much finer than the surface the problem is worth solving, where the data tell ``freedom`` of ``places`` unknowns."""
        d = self.operator.surface.dimensions
        spacing = (places / max(freedom, 1.0)) ** (1.0 / d)
        policy = self.policy
        if not policy.parts.finer_grid:
            return 1
        limits = (
            (policy.grid.spacing, math.inf) if d == 1 else (policy.grid.fine_spacing, policy.grid.spacing, math.inf)
        )
        table = list(zip(limits, policy.grid.line if d == 1 else policy.grid.area))
        most = min(
            policy.grid.unknowns,
            max(policy.grid.few_unknowns, policy.grid.unknowns_per_reading * len(self.readings.std)),
        )
        wanted = [r for limit, r in table if r == 1 or unknowns * r**d <= most]
        return min(next(r for limit, r in table if spacing <= limit), max([*wanted, 1]))

    def _freedom_along(self, data: Normal, weight: float) -> float:
        """How many degrees of freedom of the pressure the data tell, by the even penalty of that weight."""
        import scipy.linalg

        even = self.precisions(data.level, 1, weight)[-1][data.cells][:, data.cells].toarray()
        factor = cholesky(data.gram + even)
        return float(np.trace(scipy.linalg.cho_solve((factor, True), data.gram, check_finite=False)))

    def models(
        self,
        first: Floats,
        y: Floats,
        noise: Floats,
        observed: Flags,
        evidence: Mapping[int, LinearEvidence],
    ) -> Iterator[ContactModel]:
        """The models of a frame, with their weights, each made when it is asked for.

        Where a contact that crosses the array's edge ends is not in the data (the objectives differ by a nat or less): some
        of the weight goes to models that end it on the surface. Nor is friction in the data, where the channels alone do not tell pressure
        from shear: half of the weight goes to models that friction bounds.
        """
        policy = self.policy
        size = np.abs(first[-1]).reshape(self.operator.surface.shape)
        region = dilated(size > self.quiet(y) * size.max(), 1)
        regions = [region]
        if (first[-1].reshape(size.shape)[~self.inside] > 0).any() and (region & self.inside).any():
            regions.append(region & self.inside)
        shares = [1.0] if len(regions) == 1 else [1.0 - policy.prior.ends, policy.prior.ends]
        ways = [self]
        if self.ambiguous and not self.cone.coupled:
            bounded = copy.copy(self)
            bounded.cone = Cone(self.cone.components, policy.prior.most_friction)
            ways.append(bounded)
        for way in ways:
            for r, share in zip(regions, shares):
                for member in way.models_over(r, first, y, noise, observed, evidence):
                    member.weight *= share / len(ways)
                    yield member

    def models_over(
        self,
        region: Flags,
        first: Floats,
        y: Floats,
        noise: Floats,
        observed: Flags,
        evidence: Mapping[int, LinearEvidence],
    ) -> Iterator[ContactModel]:
        """The models of a frame with contact in a region, with their weights."""
        policy = self.policy
        grid, c = self.operator.surface, len(self.columns)
        possible = int(region.sum())
        if not self.cone.free:
            # what the models would trim in any case makes them slow, and takes the share of finer cells: without this shear was 6 % worse
            pressure = first[-1].reshape(grid.shape)
            region = region & dilated(pressure > self._trim(y) * np.where(region, pressure, 0.0).max(), 1)
        count = int(region.sum())

        def refined(ratio: int) -> tuple[Normal, Floats]:
            cells = np.flatnonzero(repeated(region, ratio))
            start = np.stack([repeated(t.reshape(grid.shape), ratio).ravel() for t in first])[:, cells]
            return self.normal(self.level(ratio), cells, y, noise, observed), start

        parameter, scale = evidence[1].parameter, evidence[1].scale
        ratio = self._ratio(self.taxels * c, self.effective_freedom(parameter), count * c)
        data, start = refined(ratio)
        found = self._compact(data, first, y, noise, observed, parameter, possible)
        compact = self._compact_models(data, found)
        fields = 1.0 if found is None else 1.0 - found.weight
        if fields < 0.5:
            # the first model is the one that noise is learned from
            yield from compact
        slides: list[tuple[Floats, Floats, float]] = []
        if self.cone.coupled and policy.parts.sliding:
            coarse = data if ratio == 1 else refined(1)[0]
            precisions = self.precisions(coarse.level, 1, parameter / scale**2)
            given = coarse, first, precisions
            if coarse.at_size:
                given = in_blocks(*given, policy)
            slides = ways_of_sliding(given[0], given[1], self.cone, given[2], self.policy)
        rest = max(1.0 - sum(chance for _, _, chance in slides), 0.0)
        for m in self._members(data, start, y, evidence):
            m.weight *= rest * fields
            yield m
        alone = copy.copy(self)
        alone.columns, alone.cone, alone.variances = self.columns[-1:], Cone(self.cone.components[-1:]), [1.0]
        if slides and not coarse.at_size:
            # pressure alone has fewer unknowns than the data tell: a finer grid pays sooner
            freedom = alone._freedom_along(coarse.along(slides[0][0]), parameter / scale**2)
            finer = self._ratio(count, freedom, count)
            if (
                policy.parts.finer_sliding
                and finer > ratio
                and count * c * finer**grid.dimensions <= policy.work.unknowns
            ):
                data, start = refined(finer)
        for ray, changes, chance in slides:
            for one in alone._members(data.along(ray), start[-1:], y, evidence):
                member = expanded(one, data, ray, changes)
                member.weight = one.weight * chance * fields
                yield member
        if fields >= 0.5:
            yield from compact

    def _compact(
        self, data: Normal, first: Floats, y: Floats, noise: Floats, observed: Flags, parameter: float, possible: int
    ) -> Discs | None:
        """Discs that a contact of a few taxels may be (`palpate.inverse.contact.compact`); none where it is larger."""
        if not self.policy.parts.compact or data.at_size:
            return None
        white = self.readings.white(y[observed], observed)
        left = white - self.readings.white((self.explained_by(first) / noise)[observed], observed)
        share = min(float(np.count_nonzero(first[-1])) / self.taxels, 1.0)
        taken = share * self.effective_freedom(parameter)
        return discs(self, data, first, white, float(left @ left), taken, possible)

    def _compact_models(self, data: Normal, found: Discs | None) -> Iterator[ContactModel]:
        """The models that are discs, with their weights."""
        if found is None:
            return
        for disc in found.drawn:
            # gradients of the disc's own size at its edge are what is expected: of its pressure, or of its shear where it has none
            size = float(disc.traction[-1].max()) or float(np.abs(disc.traction).max())
            slope = size / min(data.level.grid.spacings)
            per_cell = [1.0 / (data.level.grid.cell * (v * slope**2 + 1e-300)) for v in self.variances]
            each = data.level.differences.even(1, per_cell)
            member = self.model(data.part(disc.position), each, disc.traction, keep_face=True)
            member.weight, member.compact = found.weight / len(found.drawn), True
            yield member

    def _members(
        self,
        data: Normal,
        start: Floats,
        y: Floats,
        evidence: Mapping[int, LinearEvidence],
    ) -> Iterator[ContactModel]:
        """The models on the cells of ``data``, with their weights."""
        policy = self.policy
        level = data.level
        odds = weights_by_evidence({order: e.gain for order, e in evidence.items()})
        chosen = [order for order in evidence if order == 1 or odds[order] >= policy.prior.improbable]
        total = sum(odds[order] for order in chosen)
        reaches = self._reaches(level)
        even = 1.0
        if reaches:
            # an even penalty gets its share, and half where the second derivative is what the frame speaks for
            smooth = sum(odds[order] for order in chosen[1:]) / total
            even = (1.0 - smooth) * policy.prior.even + smooth / 2.0 if policy.parts.even_model else 0.0
        first: ContactModel | None = None
        for order in chosen:
            weight = odds[order] * even / total
            if order > 1 and reaches and not weight > policy.prior.least_weight:
                continue
            found = evidence[order]
            precisions = self.precisions(level, order, found.parameter / found.scale**2)
            member = self._trimmed(self.model(data, precisions, start), precisions, y)
            member.weight = weight
            first = first or member
            if not reaches or weight > policy.prior.least_weight:
                yield member
        share = (1.0 - even) / max(len(reaches), 1)
        if first is None or not share > policy.prior.least_weight:
            return
        energies = {variance: self._energies(first, variance) for _, variance in reaches}
        for width, variance in reaches:
            member = self._relearned(first, width, variance, y, energies[variance])
            member.weight = share
            yield member

    def _trimmed(self, member: ContactModel, precision: Sparse | Sequence[Sparse], y: Floats) -> ContactModel:
        """Without the cells whose pressure is not told from none: all of it pushes, so that noise there would add up."""
        policy = self.policy
        pressure = member.solution.traction[-1]
        position = np.flatnonzero(pressure > self._trim(y) * pressure.max())
        if not len(position) or not policy.parts.trim or self.cone.free:  # nothing pushes, or not only
            position = np.arange(len(pressure))
        found = self.model(member.data.part(position), precision, member.solution.traction[:, position], keep_face=True)
        return self._without_faint(found, precision) if policy.parts.trim and not self.cone.free else found

    def _without_faint(self, member: ContactModel, precision: Sparse | Sequence[Sparse]) -> ContactModel:
        """Without faint pressure all round, where it makes up much of the force and the readings do not ask for it.

        Wide even pressure on a thin bonded layer is hardly felt, and costs no gradients; where friction is known, noise in shear asks for it: a
        twisted ball of 2.4 N was read as 3.5 N.
        """
        policy = self.policy
        pressure = member.solution.traction[-1]
        faint = pressure <= policy.extent.faint * pressure.max()
        if not pressure[faint].sum() > policy.extent.faint * pressure.sum():
            return member
        position = np.flatnonzero(~faint)
        traction = member.solution.traction[:, position]
        found = self.model(member.data.part(position), precision, traction, keep_face=True)
        return found if self._explains(found, member) else member

    def _trim(self, y: Floats) -> float:
        """The part of the peak below which pressure is noise, for whitened readings."""
        policy = self.policy
        return min(policy.extent.trim / max(float(np.abs(y).max()), 1e-300), policy.extent.faint)

    def _reaches(self, level: Level) -> list[tuple[float, bool]]:
        """Widths in cells of the local means that differ on this grid; without the variance weak shear would be lost."""
        policy = self.policy
        cell, shear = min(level.grid.spacings), len(self.columns) > 1
        wide = (max(policy.prior.reach * self.depth / cell, 1.0), shear)
        narrow = (1.0, True)
        chosen = [r for r, on in ((wide, policy.parts.wide_weights), (narrow, policy.parts.narrow_weights)) if on]
        return list(dict.fromkeys(chosen))

    def _relearned(
        self, member: ContactModel, width: float, variance: bool, y: Floats, energies: Floats
    ) -> ContactModel:
        """The penalty learned from its own result, over and over, beginning with the ``energies`` of the first."""
        policy = self.policy
        level, first = member.level, member
        precisions: list[Sparse] = []
        quiet, rounds = policy.extent.quiet, policy.prior.rounds
        for i in range(rounds):
            tau = self._local_scales(member, width, energies if i == 0 else self._energies(member, variance))
            loud = tau.max(axis=0).ravel()
            pressure = member.solution.traction[-1]
            keep = (loud[member.cells] > quiet * loud.max()) | (pressure > self.quiet(y) * pressure.max())
            position = np.flatnonzero(keep)
            if not len(position):
                break
            least = policy.prior.floor * tau.max()  # of all components: without friction shear is nothing
            last = i == rounds - 1
            for larger in policy.prior.larger:
                each = level.differences.local(larger * np.maximum(tau, least))
                found = self.model(
                    member.data.part(position),
                    each,
                    member.solution.traction[:, position],
                    keep_face=variance and not last,
                )
                if self._explains(found, first):
                    break
            else:
                break
            member, precisions = found, each
        return self._trimmed(member, precisions, y) if precisions else member

    def _explains(self, member: ContactModel, first: ContactModel) -> bool:
        """Whether a model leaves no more of the readings than the first: few readings leave local weights to shrink contact to nothing,
        each round from the smaller gradients of the one before.

        A model of fewer degrees of freedom leaves as many more squares of the noise, and by chance their deviation.
        """
        policy = self.policy
        if not policy.parts.explains or len(self.readings.std) > policy.work.hold:
            return True
        more = member.squares - first.squares
        if not more > policy.prior.left_more:
            return True
        fewer = taken_by(first)
        return more < fewer + policy.prior.left_more * math.sqrt(fewer)

    def _local_scales(self, member: ContactModel, width: float, energies: Floats) -> Floats:
        """tau (component, *grid): local mean of the squared gradient, of each component by itself."""
        import scipy.ndimage

        grid = member.level.grid
        sigma = [0.0, *(width * min(grid.spacings) / dx for dx in grid.spacings)]
        return np.asarray(scipy.ndimage.gaussian_filter(energies, sigma, mode="constant"))

    def _energies(self, member: ContactModel, variance: bool) -> Floats:
        """Squared gradient (component, *grid) of a model.

        Weak shear keeps its posterior variance: it must not learn from its own estimate that it is nothing.
        """
        level, c = member.level, len(self.columns)
        fields = np.zeros((c, math.prod(level.grid.shape)))
        fields[:, member.cells] = member.solution.traction
        squares = [d**2 for d in level.differences.across(fields)]
        if variance:
            touched, rows = level.differences.touching(member.cells)
            unsure = variance_of(member, rows.each(c, len(member.cells)), few=True).reshape(c, -1)
            parts = np.cumsum([len(edges) for edges in touched])[:-1]
            for square, edges, more in zip(squares, touched, np.split(unsure, parts, axis=1)):
                square[:, edges] += more
        return level.differences.energy(squares)
