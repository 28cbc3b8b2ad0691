"""method="adaptive": contact found from the readings alone, with nothing to tune.

What is known of contact before anything is measured: pressure never pulls, shear stays inside the friction cone, contact is
compact, and traction is smooth within it while it may jump at its edge. What is not known, the noise and how much traction
varies from place to place, is learned from the frame itself:

1. noise level and amplitude by marginal likelihood of the linear model (`palpate.inverse.parameter`); a frame that noise alone
   explains as well is reported as no contact;
2. the penalised problem with its constraints, solved exactly over the cells where contact is possible
   (`palpate.inverse.cone`), on a grid finer than the surface, because where in a cell an edge lies matters;
3. the penalty relearned from its own result: |grad t|^2 is weighed by 1/tau, where tau(x) is the local mean square
   gradient of the solution before. This is majorisation of log tau (M. Fazel, H. Hindi, S. Boyd, Proc. American Control Conf.
   2003, 2156-2162; with the posterior variance kept, the EM iteration of sparse Bayesian learning, M. E. Tipping, J. Mach.
   Learn. Res. 1, 2001, 211-244): edges become sharp where there are edges, the outside becomes quiet, the inside
   stays smooth;
4. the mean over three accounts of the same readings: an even penalty on the first and second derivative (weighed by
   evidence), and local weights of a wide and a narrow reach. One frame cannot say which is right: their spread is part of the
   error bar;
5. where friction is known, the same accounts of a contact that slides as a whole (q in one proportion to p), weighed by evidence: the
   cone alone lets shear fall short wherever noise makes the pressure small, but never lets it exceed where noise makes it large;
6. readings that no contact explains (dead, stuck or saturated taxels) are left out and named.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.special

from palpate.elastic.half_space import Floats
from palpate.inverse.account import Account, Level, Normal, scattered, spread
from palpate.inverse.cone import TOLERANCE, Cone, Ray, cholesky, minimise
from palpate.inverse.constrained import LARGEST_UNKNOWNS, QUIET, Constrained, grown
from palpate.inverse.stencil import Sparse
from palpate.sensing.grids import repeated

__all__ = ["Adaptive"]

Flags = npt.NDArray[np.bool_]

#: Fine cells per surface cell on a line, by how many taxels stand for one degree of freedom of the data.
LINE_REFINEMENT = ((1.75, 5), (math.inf, 3))
#: The same on an area, per axis: where noise is high, detail finer than the taxels cannot be seen.
AREA_REFINEMENT = ((1.2, 3), (1.75, 2), (math.inf, 1))
#: Unknowns of one frame up to which the finer grid is used.
FINE_UNKNOWNS = 4000
#: Reach of the local mean of |grad t|^2, in depths (0: one fine cell), and whether posterior variance is added.
REACHES: tuple[tuple[float, bool], ...] = ((1.0 / 3.0, False), (0.0, True))
#: Pressure below this many times noise over signal, as a part of the peak, is noise; never more than the second part.
TRIM, LARGEST_TRIM = 2.5, 0.05
#: Local weights are relearned this many times.
ROUNDS = 4
#: Relative residual of the rounds before the last.
ROUGH = 1e-4
#: Smallest local scale, as a part of the largest.
FLOOR = 1e-6
#: Weight of a contact that ends on the surface against one that reaches twice as far, where the frame could be either.
ENDS = 0.2
#: Sliding less probable than this is not followed up.
SLIDES = 0.03
#: Rounds in which shear over pressure and the pressure are found in turn.
JOINTLY = 4


def _gain(hessian: Floats, linear: Floats, prior: Sequence[Floats]) -> float:
    """Log marginal likelihood over that of noise alone, of a Gaussian model with the given normal matrix and prior precisions."""
    import scipy.linalg

    factor = cholesky(hessian.copy())
    half = scipy.linalg.solve_triangular(factor, linear, lower=True, check_finite=False)
    wide = sum(float(np.log(np.diagonal(cholesky(p.copy()))).sum()) for p in prior)
    return 0.5 * float(half @ half) - float(np.log(np.diagonal(factor)).sum()) + wide


def _expanded(one: Account, data: Normal, ray: Floats, changes: Floats) -> Account:
    """An account of the pressure as one of the traction, ``ray`` times it, as uncertain as the readings leave both."""
    part = data.part(np.searchsorted(data.cells, one.cells))
    pressure = one.solution.traction[0]
    face = one.solution.face
    if face is None:
        raise RuntimeError("the solution was found without its face")
    free = face.free[0]
    turned = (changes[:, :, None] * pressure).reshape(len(changes), len(ray) * len(pressure))
    pull = (turned @ part.matrix.T) @ part.matrix
    border = np.einsum("c,kcn->kn", ray, pull.reshape(len(changes), len(ray), len(pressure)))[:, free]
    hessian = np.block([[one.hessian[np.ix_(free, free)], border.T], [border, pull @ turned.T]])
    solution = replace(
        one.solution, traction=ray[:, None] * pressure, face=Ray(ray, free, turned), factor=cholesky(hessian)
    )
    return Account(part, one.hessian, solution, ray=ray, changes=changes)


class Adaptive(Constrained):
    """The adaptive estimator, prepared once for an operator, the components sought and the constraints."""

    derivatives = (1, 2)
    reach = 1

    @property
    def tells_sliding(self) -> bool:
        """Where friction is given."""
        return self.cone.coupled

    def _ratio(self, places: float, seen: float, unknowns: int) -> int:
        """How much finer than the surface the problem is worth solving, where the data tell ``seen`` of ``places`` unknowns."""
        d = self.operator.surface.dimensions
        spacing = (places / max(seen, 1.0)) ** (1.0 / d)
        table = LINE_REFINEMENT if d == 1 else AREA_REFINEMENT
        wanted = [r for limit, r in table if r == 1 or unknowns * r**d <= FINE_UNKNOWNS]
        return min(next(r for limit, r in table if spacing <= limit), max([*wanted, 1]))

    def _seen_along(self, data: Normal, weight: float) -> float:
        """How many degrees of freedom of the pressure the data tell, by the even penalty of that weight."""
        import scipy.linalg

        even = self.precisions(data.level, 1, weight)[-1][data.cells][:, data.cells].toarray()
        factor = cholesky(data.gram + even)
        return float(np.trace(scipy.linalg.cho_solve((factor, True), data.gram, check_finite=False)))

    def accounts(
        self,
        first: Floats,
        y: Floats,
        noise: Floats,
        heard: Flags,
        evidence: Mapping[int, tuple[float, float, float, Floats]],
    ) -> list[Account]:
        """The accounts of a frame, with their weights.

        Where a contact that crosses the array's edge ends is not in the data (the objectives differ by a nat or less): some
        of the weight goes to accounts that end it on the surface.
        """
        size = np.abs(first[-1]).reshape(self.operator.surface.shape)
        region = grown(size > self.quiet(y) * size.max(), 1)
        regions = [region]
        if (first[-1].reshape(size.shape)[~self.inside] > 0).any() and (region & self.inside).any():
            regions.append(region & self.inside)
        shares = [1.0] if len(regions) == 1 else [1.0 - ENDS, ENDS]
        members = []
        for r, share in zip(regions, shares):
            for member in self._ensemble(r, first, y, noise, heard, evidence):
                member.weight *= share
                members.append(member)
        return members

    def _ensemble(
        self,
        region: Flags,
        first: Floats,
        y: Floats,
        noise: Floats,
        heard: Flags,
        evidence: Mapping[int, tuple[float, float, float, Floats]],
    ) -> list[Account]:
        """The accounts of a frame with contact in a region, with their weights."""
        grid, c = self.operator.surface, len(self.columns)
        if self.cone.coupled:
            # what the accounts would trim in any case makes them slow
            pressure = first[-1].reshape(grid.shape)
            region = region & grown(pressure > self._trim(y) * np.where(region, pressure, 0.0).max(), 1)
        count = int(region.sum())

        def refined(ratio: int) -> tuple[Normal, Floats]:
            cells = np.flatnonzero(repeated(region, ratio))
            start = np.stack([repeated(t.reshape(grid.shape), ratio).ravel() for t in first])[:, cells]
            return self.normal(self.level(ratio), cells, y, noise, heard), start

        _, parameter, scale, _ = evidence[1]
        ratio = self._ratio(self.taxels * c, self.seen(parameter), count * c)
        data, start = refined(ratio)
        slides = []
        if self.cone.coupled:
            coarse = data if ratio == 1 else refined(1)[0]
            slides = self._slides(coarse, first, evidence[1])
        rest = max(1.0 - sum(chance for _, _, chance in slides), 0.0)
        # what is as good as excluded is not worth its local weights
        members = self._members(data, start, y, evidence if rest >= SLIDES else {1: evidence[1]}, local=rest >= SLIDES)
        alone = copy.copy(self)
        alone.columns, alone.cone, alone.variances = self.columns[-1:], Cone(self.cone.components[-1:]), [1.0]
        for m in members:
            m.weight *= rest
        if slides:
            # pressure alone has fewer unknowns than the data tell: a finer grid pays sooner
            seen = alone._seen_along(coarse.along(slides[0][0]), parameter / scale**2)
            finer = self._ratio(count, seen, count)
            if finer > ratio and count * c * finer**grid.dimensions <= LARGEST_UNKNOWNS:
                data, start = refined(finer)
        for ray, changes, chance in slides:
            for one in alone._members(data.along(ray), start[-1:], y, evidence):
                member = _expanded(one, data, ray, changes)
                member.weight = one.weight * chance
                members.append(member)
        return members

    def _slides(
        self, data: Normal, first: Floats, evidence: tuple[float, float, float, Floats]
    ) -> list[tuple[Floats, Floats, float]]:
        """Ways in which the contact may slide as a whole: shear over pressure (component,), its changes (change, component), probability.

        At the friction given, in any direction, or at less (friction while sliding is less than at rest, and what is given may not be exact).
        By the marginal likelihood of Gaussian models without the constraints, against shear of its own; ``data`` is that of surface cells.
        """
        mu, cells = float(self.cone.friction or 0.0), data.cells
        _, parameter, scale, _ = evidence
        level = data.level
        blocks = [q[cells][:, cells].toarray() for q in self.precisions(level, 1, parameter / scale**2)]
        c, n = len(blocks), len(cells)
        pressure = first[-1:, cells]
        for turn in range(JOINTLY):
            # shear over pressure, and the pressure that goes with it, in turn
            explained = np.einsum(
                "i,cidj,j->cd", pressure[0], data.gram.reshape(c, n, c, n), pressure[0], optimize=True
            )
            pull = data.linear[:-1] @ pressure[0] - explained[:-1, -1]
            found = np.linalg.lstsq(explained[:-1, :-1], pull, rcond=None)[0]
            size = float(np.linalg.norm(found))
            if not size > 0:
                return []
            if turn < JOINTLY - 1:
                one = data.along(np.append(found * min(1.0, mu / size), 1.0))
                pressure = minimise(
                    one.gram + blocks[-1], one.linear, Cone(self.cone.components[-1:]), pressure
                ).traction
        full = mu * found / size
        turns = np.array([[-full[1], full[0]]]) if c == 3 else np.zeros((0, 1))
        ways = [
            (full, turns, math.log(2.0 * math.pi) if c == 3 else math.log(2.0)),
            (found * min(1.0, mu / size), np.eye(c - 1), math.log(math.pi * mu**2 if c == 3 else 2.0 * mu)),
        ]
        whole = data.gram.copy()
        for i, block in enumerate(blocks):
            whole[i * n : (i + 1) * n, i * n : (i + 1) * n] += block
        logs = [_gain(whole, data.linear.ravel(), blocks)]
        for ratio, changes, volume in ways:
            one = data.along(np.append(ratio, 1.0))
            told = changes @ explained[:-1, :-1] @ changes.T
            width = 0.5 * len(changes) * math.log(2.0 * math.pi) - 0.5 * float(np.linalg.slogdet(told)[1])
            logs.append(_gain(one.gram + blocks[-1], one.linear.ravel(), blocks[-1:]) + min(width, volume) - volume)
        chances = scipy.special.softmax(logs)
        kept = [(w, float(p)) for w, p in zip(ways, chances[1:]) if p >= SLIDES]
        return [(np.append(ratio, 1.0), np.pad(changes, ((0, 0), (0, 1))), p) for (ratio, changes, _), p in kept]

    def _members(
        self,
        data: Normal,
        start: Floats,
        y: Floats,
        evidence: Mapping[int, tuple[float, float, float, Floats]],
        *,
        local: bool = True,
    ) -> list[Account]:
        """The accounts on the cells of ``data``, with their weights; without ``local``, those of an even penalty alone."""
        level = data.level
        members = []
        best = max(e[0] for e in evidence.values())
        odds = {order: math.exp(max(e[0] - best, -50.0)) for order, e in evidence.items()}
        for order, (_, parameter, scale, _) in evidence.items():
            if order > 1 and odds[order] < 0.01:
                continue
            precisions = self.precisions(level, order, parameter / scale**2)
            member = self._trimmed(self.account(data, precisions, start), precisions, y)
            member.weight = odds[order]
            members.append(member)
        total = sum(m.weight for m in members)
        if not local:
            for m in members:
                m.weight /= total
            return members
        # an even penalty gets a third, and half where the second derivative is what the frame speaks for
        reaches = self._reaches(level)
        smooth = sum(m.weight for m in members[1:]) / total
        even = (1.0 - smooth) / 3.0 + smooth / 2.0
        for m in members:
            m.weight *= even / total
        for width, variance in reaches:
            member = self._relearned(members[0], width, variance, y)
            member.weight = (1.0 - even) / len(reaches)
            members.append(member)
        return [m for m in members if m.weight > 1e-3]

    def _trimmed(self, member: Account, precision: Sparse | Sequence[Sparse], y: Floats) -> Account:
        """Without the cells whose pressure is not told from none: all of it pushes, so that noise there would add up."""
        pressure = member.solution.traction[-1]
        position = np.flatnonzero(pressure > self._trim(y) * pressure.max())
        if not len(position):  # nothing pushes
            position = np.arange(len(pressure))
        return self.account(
            member.data.part(position), precision, member.solution.traction[:, position], keep_face=True
        )

    @staticmethod
    def _trim(y: Floats) -> float:
        """The part of the peak below which pressure is noise, for whitened readings."""
        return min(TRIM / max(float(np.abs(y).max()), 1e-300), LARGEST_TRIM)

    def _reaches(self, level: Level) -> list[tuple[float, bool]]:
        """Widths in cells of the local means that differ on this grid; without the variance weak shear would be lost."""
        cell = min(level.grid.spacings)
        out = [(max(reach * self.depth / cell, 1.0), variance or len(self.columns) > 1) for reach, variance in REACHES]
        return out if out[0] != out[1] else out[:1]

    def _relearned(self, member: Account, width: float, variance: bool, y: Floats) -> Account:
        """The penalty learned from its own result, over and over."""
        level = member.level
        c = len(self.columns)
        precisions: list[Sparse] = []
        for i in range(ROUNDS):
            tau = self._local_scales(member, width, variance)
            loud = tau.max(axis=0).ravel()
            pressure = member.solution.traction[-1]
            keep = (loud[member.cells] > QUIET * loud.max()) | (pressure > self.quiet(y) * pressure.max())
            if not self.cone.coupled and c > 1:
                # no shear outside contact
                keep &= grown(member.pressure > 0, 1).ravel()[member.cells]
            position = np.flatnonzero(keep)
            least = FLOOR * tau.max(axis=tuple(range(1, tau.ndim)), keepdims=True)
            precisions = [level.stencil.local(t) for t in np.maximum(tau, least)]
            if not len(position):
                break
            last = i == ROUNDS - 1
            member = self.account(
                member.data.part(position),
                precisions,
                member.solution.traction[:, position],
                keep_face=variance and not last,
                tolerance=TOLERANCE if last else ROUGH,
            )
        return self._trimmed(member, precisions, y)

    def _local_scales(self, member: Account, width: float, variance: bool) -> Floats:
        """tau (component, *grid): local mean of the squared gradient.

        Its course is common to all components, because shear has its edges where pressure has; so is its size, up to
        the fixed ratio of shear to pressure. Learned one by one, weak shear would learn that it is nothing.
        """
        import scipy.ndimage

        level, n = member.level, len(member.cells)
        total: Floats = np.zeros(level.grid.shape)
        for i, values in enumerate(member.solution.traction):
            field = scattered(values, member.cells, level.grid.shape).ravel()
            squares = []
            for d in level.stencil.differences:
                square = (d @ field) ** 2
                if variance:
                    local = d[:, member.cells]
                    touched = np.flatnonzero(np.diff(local.indptr))
                    rows = np.zeros((len(touched), len(self.columns) * n))
                    rows[:, i * n : (i + 1) * n] = local[touched].toarray()
                    square[touched] += (spread(member.solution, rows) ** 2).sum(axis=0)
                squares.append(square)
            total = total + level.stencil.energy(squares) / (self.variances[i] * len(self.variances))
        sigma = [width * min(level.grid.spacings) / dx for dx in level.grid.spacings]
        tau = scipy.ndimage.gaussian_filter(total, sigma, mode="constant")
        return np.stack([v * tau for v in self.variances])
