"""method="adaptive": contact found from the readings alone, with nothing to tune.

The method assumes that pressure never pulls, shear stays inside the friction cone, contact is compact, and traction is
smooth within the contact but may jump at its edge. It learns the noise and the local variation of the traction from each frame:

1. noise level and amplitude by marginal likelihood of the linear model (`palpate.inverse.linear.parameter`); a frame that noise alone
   explains as well is reported as no contact;
2. the penalised problem with its constraints, solved exactly over the cells where contact is possible
   (`palpate.inverse.constrained.cone`), on a grid finer than the surface, because the place of an edge within a cell matters;
3. the penalty relearned from its own result: |grad t|^2 is weighed by 1/tau, where tau(x) is the local mean square gradient of the previous solution. This is majorisation of log tau (M. Fazel, H. Hindi, S. Boyd, Proc. American Control Conf.
   2003, 2156-2162; with the posterior variance kept, the EM iteration of sparse Bayesian learning, M. E. Tipping, J. Mach.
   Learn. Res. 1, 2001, 211-244): real edges become sharp, traction outside the contact vanishes, and traction inside stays smooth;
4. the mean over models of the same readings: an even penalty on the first and one on the second derivative (weighed by
   evidence), and local weights of a wide and a narrow reach; of contacts of a few taxels also discs (`compact`). One frame does not show which model is right,
   so their spread is part of the error bar;
5. if friction is given, the same models of a contact that slides as a whole (q proportional to p), weighted by evidence. Without these models shear is underestimated, because the cone limits shear where noise makes the pressure small;
6. readings that no contact explains (dead, stuck or saturated taxels) are left out and reported.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.factors import cholesky
from palpate.inverse.constrained.model import ContactModel, Level, Normal, dilated, scattered
from palpate.inverse.constrained.variances import taken_by, variance_of
from palpate.inverse.contact.compact import DISC, Discs, discs
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.score import odds_by_evidence
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
        """Number of cells around the contact whose error bars include the uncertainty of its edge."""
        return 1

    @property
    def finds_sliding(self) -> bool:
        """Sliding is a candidate only if friction is given."""
        return self.cone.coupled

    def _ratio(self, places: float, freedom: float, unknowns: int, *, joined: bool) -> int:
        """How many times finer than the surface grid to solve, if the data determine ``freedom`` of ``places``
        unknowns. ``joined``: shear is sought too, beside the pressure or in proportion to it.
        """
        d = self.operator.surface.dimensions
        spacing = (places / max(freedom, 1.0)) ** (1.0 / d)
        policy = self.policy
        if not policy.parts.finer_grid:
            return 1
        # Of large arrays no more than a tracker can hold.
        few = policy.work.again_unknowns if self.large else policy.grid.few_unknowns
        most = min(policy.grid.unknowns, max(few, policy.grid.unknowns_per_reading * len(self.readings.std)))
        limits = [(policy.grid.spacing, most), (math.inf, math.inf)]
        if d == 2:
            finest = policy.grid.fine_spacing if joined else policy.grid.spacing
            limits.insert(0, (finest, most if len(self.columns) == 1 else few))
        table = list(zip(policy.grid.line if d == 1 else policy.grid.area, limits))
        wanted = [r for r, (_, most) in table if r == 1 or unknowns * r**d <= most]
        return min(next(r for r, (limit, _) in table if spacing <= limit), max([*wanted, 1]))

    def _freedom_along(self, data: Normal, weight: float) -> float:
        """Degrees of freedom of the pressure that the data determine under an even penalty with that weight."""
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
        near: ContactModel | None = None,
    ) -> Iterator[ContactModel]:
        """Yield the models of a frame with their weights; each is computed when the caller asks for it.

        If the contact crosses the edge of the array, the data cannot tell where it ends (the objectives differ by at
        most one nat). Part of the weight therefore goes to models whose contact ends on the surface. If the channels
        cannot separate pressure from shear, half of the weight goes to models with a limit on friction.
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
                for member in way.models_over(r, first, y, noise, observed, evidence, near):
                    member.weight *= share / len(ways)
                    yield member

    def _loud(self, region: Flags, first: Floats, y: Floats) -> Flags:
        """The cells of a region without those that every model would trim anyway: they cost time and prevent a finer
        grid. Without this step the shear error grew by 6 %.
        """
        if self.cone.free:
            return region
        pressure = first[-1].reshape(region.shape)
        return np.asarray(pressure > self._trim(y) * np.where(region, pressure, 0.0).max())

    @property
    def _slides(self) -> bool:
        """Whether contact may slide as a whole."""
        return self.cone.coupled and self.policy.parts.sliding

    def _ways_of_sliding(self, coarse: Normal, first: Floats, weight: float) -> list[tuple[Floats, Floats, float]]:
        """Directions of sliding as a whole, their possible changes and probabilities, from the surface grid."""
        if not self._slides:
            return []
        given = coarse, first, self.precisions(coarse.level, 1, weight)
        if coarse.at_size:
            given = in_blocks(*given, self.policy)
        return ways_of_sliding(given[0], given[1], self.cone, given[2], self.policy)

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
        """The models of a frame with contact in a region, with their weights. Solutions start from ``near``, a model
        of the same frame with other noise, if it is on the same grid; this saves steps.
        """
        grid, c = self.operator.surface, len(self.columns)
        possible = int(region.sum())
        loud = self._loud(region, first, y)
        region = region & dilated(loud, 1)
        count = int(region.sum())

        def refined(ratio: int) -> tuple[Normal, Floats]:
            # One cell around the contact, on its own grid.
            cells = np.flatnonzero(repeated(region, ratio) & dilated(repeated(loud, ratio), 1))
            fields = np.stack([repeated(t.reshape(grid.shape), ratio).ravel() for t in first])
            if near is not None and near.level is self.level(ratio) and len(near.solution.traction) == c:
                fields[:, near.cells] = near.solution.traction
            start = fields[:, cells]
            return self.normal(self.level(ratio), cells, y, noise, observed), start

        parameter, weight = evidence[1].parameter, evidence[1].weight
        ratio = self._ratio(self.taxels * c, self.start.freedom(parameter), count * c, joined=c > 1)
        white = self.readings.white(y[observed], observed)
        data, start = refined(ratio)
        others = self._members(data, start, y, evidence)
        leading = next(others)
        found = discs(self, data, first, white, leading, possible) if self.policy.parts.compact else None
        compact = self._compact_models(data, found)
        fields = 1.0 if found is None else 1.0 - found.weight
        if fields < 0.5:
            # The noise is estimated from the first model, so the more probable kind comes first.
            yield from compact
        coarse = data if ratio == 1 or not self._slides else refined(1)[0]
        slides = self._ways_of_sliding(coarse, first, weight)
        rest = max(1.0 - sum(chance for _, _, chance in slides), 0.0)
        for m in itertools.chain([leading], others):
            m.weight *= rest * fields
            yield m
        alone = copy.copy(self)
        alone.columns, alone.cone, alone.variances = self.columns[-1:], Cone(self.cone.components[-1:]), [1.0]
        if slides and not coarse.at_size and self.policy.parts.finer_sliding:
            # Pressure alone has fewer unknowns than the data determine, so that a finer grid is worth its cost.
            freedom = alone._freedom_along(coarse.along(slides[0][0]), weight)
            finer = alone._ratio(count, freedom, count, joined=True)
            if finer > ratio and count * c * finer**grid.dimensions <= self.policy.work.unknowns:
                data, start = refined(finer)
        for ray, changes, chance in slides:
            for one in alone._members(data.along(ray), start[-1:], y, evidence):
                member = expanded(one, data, ray, changes)
                member.weight = one.weight * chance * fields
                yield member
        if fields >= 0.5:
            yield from compact

    def _compact_models(self, data: Normal, found: Discs | None) -> Iterator[ContactModel]:
        """One model for each disc, with its weight."""
        if found is None:
            return
        level = data.level
        for disc in found.drawn:
            # The size of the disc's pressure, or of its shear if it has no pressure, may change by itself over a radius.
            leading = max(disc.traction[::-1], key=lambda t: bool(t.any()))
            size, count = float(np.abs(leading).max()), len(disc.position)
            radius = 0.5 * count if level.grid.dimensions == 1 else math.sqrt(count / math.pi)
            shape = scattered(np.abs(leading) / size, data.cells[disc.position], level.grid.shape).ravel()
            each = level.differences.about(
                shape, [(radius**2 / (v * size**2), 1.0 / (count * v * size**2)) for v in self.variances]
            )
            member = self.model(data.part(disc.position), each, disc.traction, keep_face=True)
            member.weight, member.kind = found.weight / len(found.drawn), DISC
            yield member

    def _members(
        self,
        data: Normal,
        start: Floats,
        y: Floats,
        evidence: Mapping[int, LinearEvidence],
    ) -> Iterator[ContactModel]:
        """Yield the models on the cells of ``data``, with their weights."""
        policy = self.policy
        level = data.level
        odds = odds_by_evidence({order: e.gain for order, e in evidence.items()})
        chosen = [order for order in evidence if order == 1 or odds[order] >= policy.prior.improbable]
        total = sum(odds[order] for order in chosen)
        widths = self._widths(level)
        even = 1.0
        if widths:
            # The even penalty gets its prior weight, and half of the weight that the evidence gives to the second
            # derivative.
            smooth = sum(odds[order] for order in chosen[1:]) / total
            even = (1.0 - smooth) * policy.prior.even + smooth / 2.0 if policy.parts.even_model else 0.0
        share = (1.0 - even) / max(len(widths), 1)

        def solved(order: int) -> ContactModel:
            nonlocal data, start
            precisions = self.precisions(level, order, evidence[order].weight)
            whole = self.model(data, precisions, start)
            kept = self._trimmed(whole, precisions, y)
            # Other orders need only the cells near those that this one kept.
            near = np.zeros(level.grid.shape, dtype=bool)
            near.ravel()[kept.cells] = True
            position = np.flatnonzero(dilated(near, 1).ravel()[data.cells])
            data, start = data.part(position), whole.solution.traction[:, position]
            return kept

        first: ContactModel | None = None
        for order in chosen:
            weight = odds[order] * even / total
            if widths and not weight > policy.prior.least_weight:
                continue
            member = solved(order)
            which = "first" if order == 1 else "second"
            member.weight, member.kind = weight, f"uniform penalty on {which} derivatives"
            if order == 1:
                first = member
            yield member
        if not share > policy.prior.least_weight or not widths:
            return
        # The caller may discard these models after the first one, so solve what only the others need last.
        first = first or solved(1)
        energies = {variance: self._energies(first, variance) for _, variance in widths}
        for width, variance in widths:
            member = self._relearned(first, width, variance, y, energies[variance])
            kind = "wide local weights" if width > 1.0 else "narrow local weights"
            yield replace(member, weight=share, kind=kind)  # it may be the first model again

    def _trimmed(self, member: ContactModel, precision: Sparse | Sequence[Sparse], y: Floats) -> ContactModel:
        """The model without cells whose pressure is below the noise. Pressure is never negative, so noise in these cells would add up to a force."""
        policy = self.policy
        pressure = member.solution.traction[-1]
        position = np.flatnonzero(pressure > self._trim(y) * pressure.max())
        if not len(position) or not policy.parts.trim or self.cone.free:  # nothing pushes, or not only
            position = np.arange(len(pressure))
        found = self.model(member.data.part(position), precision, member.solution.traction[:, position], keep_face=True)
        return self._without_faint(found, precision) if policy.parts.trim and not self.cone.free else found

    def _without_faint(self, member: ContactModel, precision: Sparse | Sequence[Sparse]) -> ContactModel:
        """The model without faint pressure around the contact, if that makes up much of the force and the fit stays as
        good without it.

        Wide, even pressure on a thin bonded layer hardly changes the readings and costs no gradient. If friction is
        given, noise in the shear produces such pressure: a twisted ball of 2.4 N was read as 3.5 N.
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
        """Fraction of the peak below which pressure counts as noise, for whitened readings ``y``."""
        policy = self.policy
        return min(policy.extent.trim / max(float(np.abs(y).max()), 1e-300), policy.extent.faint)

    def _widths(self, level: Level) -> list[tuple[float, bool]]:
        """(width in cells, whether to include the posterior variance) of each distinct local mean on this grid. Weak
        shear needs the variance, or it would shrink to zero.
        """
        policy = self.policy
        cell, shear = min(level.grid.spacings), len(self.columns) > 1
        wide = (max(policy.prior.reach * self.depth / cell, 1.0), shear)
        narrow = (1.0, True)
        chosen = [r for r, on in ((wide, policy.parts.wide_weights), (narrow, policy.parts.narrow_weights)) if on]
        return list(dict.fromkeys(chosen))

    def _relearned(
        self, member: ContactModel, width: float, variance: bool, y: Floats, energies: Floats
    ) -> ContactModel:
        """Re-estimate the local penalty from the model's own gradients several times, starting from the ``energies``
        of the first model.
        """
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
            least = policy.prior.floor * tau.max()  # of all components: without friction the shear can be zero
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
        """Whether a model fits the readings as well as the first one. With few readings, local weights can shrink the
        contact to nothing: each round starts from the smaller gradients of the round before.

        A model with fewer degrees of freedom has a larger residual by chance; the test allows for this.
        """
        policy = self.policy
        if not policy.parts.explains or len(self.readings.std) > policy.work.many_readings:
            return True
        more = member.squares - first.squares
        if not more > policy.prior.left_more:
            return True
        fewer = taken_by(first)
        return more < fewer + policy.prior.left_more * math.sqrt(fewer)

    def _local_scales(self, member: ContactModel, width: float, energies: Floats) -> Floats:
        """tau (component, *grid): local mean of the squared gradient, for each component separately."""
        import scipy.ndimage

        grid = member.level.grid
        sigma = [0.0, *(width * min(grid.spacings) / dx for dx in grid.spacings)]
        return np.asarray(scipy.ndimage.gaussian_filter(energies, sigma, mode="constant"))

    def _energies(self, member: ContactModel, variance: bool) -> Floats:
        """Squared gradient (component, *grid) of a model, plus its posterior variance if ``variance``.

        Without the variance, weak shear would be driven to zero by its own small estimate.
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
