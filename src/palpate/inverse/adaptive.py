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
5. readings that no contact explains (dead, stuck or saturated taxels) are left out and named.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._arrays import from_numpy, to_numpy
from palpate.elastic.half_space import Floats
from palpate.errors import Unsupported
from palpate.inverse.cone import TOLERANCE, Cone, Solution, cholesky, minimise
from palpate.inverse.parameter import choose_parameter, shared_variance, tikhonov
from palpate.inverse.priors import DifferencePrior
from palpate.inverse.regularised import Estimate, Regularised
from palpate.inverse.stencil import Sparse, Stencil
from palpate.inverse.whitening import Readings
from palpate.sensing.grids import Grid, block_means, refined, repeated
from palpate.sensing.operator import Operator

__all__ = ["Adaptive", "Errors"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: Fine cells per surface cell on a line, by how many taxels stand for one degree of freedom of the data.
LINE_REFINEMENT = ((1.75, 5), (math.inf, 3))
#: The same on an area, per axis: where noise is high, detail finer than the taxels cannot be seen.
AREA_REFINEMENT = ((1.2, 3), (1.75, 2), (math.inf, 1))
#: Unknowns of one frame up to which the finer grid is used, and at all.
FINE_UNKNOWNS, LARGEST_UNKNOWNS = 4000, 9000
#: Readings up to which the second derivative is tried too (its spectrum costs as much again to prepare).
SECOND_ORDER_READINGS = 4096
#: Gain in log evidence over noise alone below which a frame counts as empty.
CONTACT_EVIDENCE = 6.0
#: Reach of the local mean of |grad t|^2, in depths (0: one fine cell), and whether posterior variance is added.
REACHES: tuple[tuple[float, bool], ...] = ((1.0 / 3.0, False), (0.0, True))
#: Size of shear next to pressure where friction is not known.
SHEAR = 0.7
#: Pressure below this many times noise over signal, as a part of the peak, is noise; never more than the second part.
TRIM, LARGEST_TRIM = 2.5, 0.05
#: Local weights are relearned this many times.
ROUNDS = 4
#: Relative residual of the rounds before the last.
ROUGH = 1e-4
#: Cells below this part of the largest local scale, and of the peak pressure, are outside the contact; more where there is
#: more noise (times noise over signal).
QUIET, NOISY = 1e-3, 0.3
#: Weight of a contact that ends on the surface against one that reaches twice as far, where the frame could be either.
ENDS = 0.35
#: Smallest local scale, as a part of the largest.
FLOOR = 1e-6
#: A reading is left out if it is this many standard deviations, and this part of the largest reading, from what the
#: contact explains (a coarse cell alone explains a per cent); up to this part of all readings.
OUTLIER, GROSS, LARGEST_OUTLIERS = 6.0, 0.05, 0.2
#: The noise is learned again where the constrained misfit is this many times what the linear model called noise.
QUIETER = 1.2
#: No pad and no grid is known better than this part of the largest reading: the least noise that is assumed.
MODEL_ERROR = 2e-4
#: The same for the net force.
MODEL_FORCE = 5e-4
#: Contact that only pushes does not explain a frame if this many standard deviations of misfit remain, and this part of the signal.
UNEXPLAINED, UNEXPLAINED_SIGNAL = 3.0, 0.03


@dataclass(frozen=True)
class Errors:
    """Standard deviations, in closed form, before calibration (`palpate.touch`).

    ``traction`` (*batch, component, *surface) [Pa]; ``force`` (*batch, component) [N or N/m]; ``moment`` (*batch, 3 or 1);
    ``center`` (*batch, 2 or 1) [m]; ``peak`` (*batch) [Pa]. ``detail`` is shaped like ``traction``: 1 - posterior over prior
    variance of each cell in contact, NaN elsewhere.
    """

    traction: Floats
    force: Floats
    moment: Floats
    center: Floats
    peak: Floats
    detail: Floats


@dataclass(frozen=True)
class _Frame:
    """One frame's result."""

    traction: Floats
    errors: Errors
    parameter: float
    noise_scale: float
    residual: float
    converged: bool
    contact: bool
    outliers: Flags
    draws: Floats | None
    pushed: bool = True


class _Level:
    """The operator and the differences on one grid."""

    def __init__(self, operator: Operator, ratio: int, columns: tuple[int, ...], readings: Readings) -> None:
        self.ratio, self.columns, self.readings = ratio, columns, readings
        self.grid = operator.surface if ratio == 1 else refined(operator.surface, ratio)
        self.operator = (
            operator if ratio == 1 else Operator(operator.pad, operator.planes_of, self.grid, operator.boundary)
        )
        self.stencil = Stencil(self.grid)

    def matrix(self, cells: Index, noise: Floats, heard: Flags) -> Floats:
        """Whitened columns (reading, component * cell) of the readings that are heard."""
        full = self.operator.columns(self.columns, cells)[heard]
        return self.readings.white(full.reshape(len(full), -1) / noise[heard, None], heard)


@dataclass
class _Normal:
    """Whitened columns of some cells of a level, their normal matrix and right-hand side (component, cell)."""

    level: _Level
    cells: Index
    matrix: Floats
    gram: Floats
    linear: Floats

    def part(self, position: Index) -> _Normal:
        """The same for some of the cells."""
        c, n = self.linear.shape
        picks = (np.arange(c)[:, None] * n + position[None, :]).ravel()
        return _Normal(
            self.level,
            self.cells[position],
            self.matrix[:, picks],
            self.gram[np.ix_(picks, picks)],
            self.linear[:, position],
        )


@dataclass
class _Member:
    """One account of a frame: a solution on some cells of a level."""

    data: _Normal
    hessian: Floats
    solution: Solution
    weight: float = 0.0

    @property
    def level(self) -> _Level:
        return self.data.level

    @property
    def cells(self) -> Index:
        return self.data.cells

    @property
    def pressure(self) -> Floats:
        """Pressure on the cells of the level's grid."""
        return _scattered(self.solution.traction[-1], self.cells, self.level.grid.shape)


class Adaptive:
    """The adaptive estimator, prepared once for an operator, the components sought and the constraints.

    ``surface``, where given, is the middle of the operator's grid that the result is cut to: a contact across the array's
    edge is explained by cells farther out than anyone wants to see.
    """

    def __init__(self, operator: Operator, columns: Sequence[int], cone: Cone, surface: Grid | None = None) -> None:
        if cone.free:
            raise Unsupported(
                'method="adaptive" lives on pressure that cannot pull: seek component z as well, or use method="tikhonov".'
            )
        self.operator, self.cone, self.columns = operator, cone, tuple(columns)
        grid = operator.surface
        self.surface = grid if surface is None else surface
        # the cells of the operator's grid that the result is made of
        self.window = tuple(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid.shape, self.surface.shape))
        self.inside = np.zeros(grid.shape, dtype=bool)
        self.inside[self.window] = True
        # shear varies less than pressure, by what friction allows, shared between its components
        shear = 0.5 * (cone.friction or SHEAR) ** 2
        self._variances = [1.0 if c == len(columns) - 1 else shear for c in range(len(columns))]
        readings = sum(int(a.valid.sum()) * len(a.channels) for a in operator.planes_of)
        orders = (1, 2) if readings <= SECOND_ORDER_READINGS else (1,)
        self.orders = {
            order: Regularised(
                operator, [DifferencePrior(grid, order, v) for v in self._variances], columns, tikhonov, "evidence"
            )
            for order in orders
        }
        self.scales, self.noise_known = self.orders[1].scales, self.orders[1].noise_known
        self.readings = Readings(operator, self.scales)
        self._levels: dict[int, _Level] = {1: self._make_level(1)}
        self.depth = max(min(a.depth for a in operator.planes_of), max(grid.spacings))
        self._taxels = max(int(a.valid.sum()) for a in operator.planes_of)

    def _level(self, ratio: int) -> _Level:
        if ratio not in self._levels:
            self._levels[ratio] = self._make_level(ratio)
        return self._levels[ratio]

    def _make_level(self, ratio: int) -> _Level:
        return _Level(self.operator, ratio, self.columns, self.readings)

    # -- batches -------------------------------------------------------------------------------------------------------

    def solve(self, readings: Sequence[Any], draws: int = 0, rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane."""
        like = readings[0]
        planes = self.operator.planes_of
        batch = tuple(like.shape[: -1 - len(planes[0].shape)])
        arrays = [
            to_numpy(r).astype(np.float64).reshape(-1, len(a.channels), *a.shape) for r, a in zip(readings, planes)
        ]
        known = self._shared_noise(arrays)
        frames = [self.frame([a[i] for a in arrays], draws, rng, known) for i in range(math.prod(batch))]

        def gathered(name: str) -> Floats:
            cut = self._cut if name in ("traction", "detail") else np.asarray
            parts = np.stack([cut(getattr(f.errors, name)) for f in frames])
            return np.asarray(parts.reshape((*batch, *parts.shape[1:])))

        def numbers(name: str, kind: type = np.float64) -> npt.NDArray[Any]:
            return np.array([getattr(f, name) for f in frames], dtype=kind).reshape(batch)

        values = np.stack([self._cut(f.traction) for f in frames])
        sampled = None
        if draws:
            sampled = np.stack([self._cut(f.draws) for f in frames if f.draws is not None])
            sampled = sampled.reshape((*batch, *sampled.shape[1:]))
        outliers = np.stack([f.outliers for f in frames])
        return Estimate(
            from_numpy(values.reshape((*batch, *values.shape[1:])), like),
            numbers("parameter"),
            numbers("noise_scale"),
            numbers("residual"),
            Errors(*(gathered(n) for n in ("traction", "force", "moment", "center", "peak", "detail"))),
            numbers("converged", bool),
            numbers("contact", bool),
            outliers.reshape((*batch, -1)),
            sampled,
            pushed=numbers("pushed", bool),
        )

    def _shared_noise(self, arrays: Sequence[Floats]) -> float | None:
        """The noise scale of all frames together, where it is not given and there is more than one."""
        if self.noise_known or len(arrays[0]) < 2:
            return None
        spectrum = self.orders[1].spectrum
        rows = self.operator.heard(arrays)
        power = np.abs(np.asarray(spectrum.project(rows))) ** 2
        if not power.any():
            return None
        variance = shared_variance(spectrum.eigenvalues, spectrum.multiplicity, power)
        return math.sqrt(variance)

    def _cut(self, field: Floats) -> Floats:
        """The part of a field (..., *grid) that lies on the surface."""
        place: tuple[Any, ...] = (..., *self.window)
        return np.asarray(field[place])

    # -- one frame -----------------------------------------------------------------------------------------------------

    def frame(
        self,
        readings: Sequence[Floats],
        draws: int = 0,
        rng: np.random.Generator | None = None,
        known: float | None = None,
    ) -> _Frame:
        """Contact in one frame of readings, (channel, *array) per plane; ``known`` is the noise scale learned elsewhere."""
        rows = self.operator.heard(readings)
        data = self.readings.flat(rows)
        heard = np.ones(len(data), dtype=bool)
        learned = 0
        for attempt in range(8):
            evidence = {order: self._evidence(linear, rows, known) for order, linear in self.orders.items()}
            gain, parameter, scale, linear = evidence[1]
            if not (gain > CONTACT_EVIDENCE and scale > 0):
                return self._nothing(parameter, scale, data, ~heard, draws)
            floor = MODEL_ERROR * float(np.abs(data / self.readings.std).max())
            noise = self.readings.std * max(scale, floor)
            first, explained = self._first(linear, data / noise, noise, heard, parameter / scale**2)
            wrong = self._outliers(data, explained, noise)
            if attempt < 4 and (wrong & heard).any() and (wrong | ~heard).mean() <= LARGEST_OUTLIERS:
                heard &= ~wrong
                # what is left out is filled with what the contact explains, so that the linear model can go on
                rows = self.readings.planes(np.where(heard, data, explained))
                continue
            if not first[-1].any():
                break
            members = self._members(first, data / noise, noise, heard, evidence)
            # what pressure that only pushes cannot follow is noise, even where a linear model could
            left = self._noise_left(members[0], first, data / noise, heard, parameter) * noise[0] / self.readings.std[0]
            if self.noise_known or learned == 2 or max(left, floor) < QUIETER * max(scale, floor):
                break
            known, learned = left, learned + 1
        signal = self.readings.white((data / noise)[heard], heard)
        left = float(np.sqrt(np.mean((signal - self.readings.white((explained / noise)[heard], heard)) ** 2)))
        pushed = left <= max(UNEXPLAINED, UNEXPLAINED_SIGNAL * float(np.sqrt(np.mean(signal**2))))
        if not first[-1].any():
            return replace(self._nothing(parameter, scale, data, ~heard, draws), pushed=pushed)
        return replace(self._combined(members, data / noise, heard, parameter, scale, draws, rng), pushed=pushed)

    def _noise_left(self, member: _Member, first: Floats, y: Floats, heard: Flags, parameter: float) -> float:
        """Root mean square of the whitened misfit, for the freedom that the contact took: the modes seen, over its area."""
        spectrum = self.orders[1].spectrum
        seen = float(spectrum.multiplicity @ (spectrum.eigenvalues / (spectrum.eigenvalues + parameter)))
        share = float(np.count_nonzero(first[-1])) / self._taxels
        free = max(float(heard.sum()) - min(share, 1.0) * seen, 1.0)
        misfit = member.data.matrix @ member.solution.traction.ravel() - self.readings.white(y[heard], heard)
        return float(np.sqrt((misfit**2).sum() / free))

    def _evidence(
        self, linear: Regularised, rows: Sequence[Floats], known: float | None
    ) -> tuple[float, float, float, Floats]:
        """Log marginal likelihood over that of noise alone, parameter, noise scale and traction of a linear model.

        ``known`` fixes the noise scale where it is not the arrays' own.
        """
        spectrum = linear.spectrum
        values, counts = spectrum.eigenvalues, spectrum.multiplicity
        coefficients = spectrum.project(rows) / (known or 1.0)
        power = np.abs(np.asarray(coefficients)) ** 2
        certain = self.noise_known or known is not None
        chosen, variance = choose_parameter("evidence", tikhonov, values, counts, power[None], noise_known=certain)
        parameter, scale = float(chosen[0]), math.sqrt(float(variance[0])) * (known or 1.0)
        ratio = values / parameter
        left, total = float((counts * power / (1.0 + ratio)).sum()), float((counts * power).sum())
        logdet = float(counts @ np.log1p(ratio))
        if total == 0.0:
            gain = 0.0
        elif certain:
            gain = 0.5 * (total - left - logdet)
        else:
            gain = 0.5 * (float(counts.sum()) * math.log(total / left) - logdet)
        phi = tikhonov(values, chosen)
        filtered = coefficients * np.where(values > 0, phi / np.sqrt(np.where(values > 0, values, 1.0)), 0.0)
        traction = np.asarray(spectrum.solve(filtered * (known or 1.0)))
        return gain, parameter, scale, traction[list(self.columns)]

    def _outliers(self, data: Floats, explained: Floats, noise: Floats) -> Flags:
        """Readings that the contact does not explain: far beyond the noise and beyond most other residuals."""
        residual = np.abs(data - explained) / noise
        typical = max(1.0, float(np.median(residual)) / 0.6745)
        gross = GROSS * float(np.abs(explained / noise).max())
        return np.asarray(residual > max(OUTLIER * typical, gross))

    def _nothing(self, parameter: float, scale: float, data: Floats, outliers: Flags, draws: int) -> _Frame:
        """No contact. The error is that of the pressure of a patch as wide as the depth, the least that would show."""
        grid, names = self.operator.surface, self.operator.surface.components
        shape = (len(names), *grid.shape)
        radius = np.zeros(grid.shape)
        for axis, x in enumerate(grid.axes):
            offset = x - x[len(x) // 2]
            radius = radius + (offset**2).reshape([-1 if a == axis else 1 for a in range(grid.dimensions)])
        patch = radius <= max(self.depth, max(grid.spacings)) ** 2
        response = self._levels[1].operator.columns(self.columns, np.flatnonzero(patch)).sum(axis=2)
        # from the readings themselves: the residual is all noise
        noise = self.readings.std * (
            scale if self.noise_known else float(np.sqrt(np.mean((data / self.readings.std) ** 2)))
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            sharp = np.where(noise[:, None] > 0, response / noise[:, None], np.inf)
        if np.isfinite(sharp).all():
            sharp = self.readings.white(sharp, np.ones(len(data), dtype=bool))
        amplitude = 1.0 / np.sqrt((sharp**2).sum(axis=0))
        area = float(patch.sum()) * grid.cell
        std, force = np.zeros(shape), np.zeros(len(names))
        for i, c in enumerate(self.columns):
            std[c], force[c] = amplitude[i], amplitude[i] * area
        reach = max(float(np.abs(x).max()) for x in grid.axes)
        errors = Errors(
            std,
            force,
            np.full(1 if grid.dimensions == 1 else 3, force.max() * reach),
            np.full(grid.dimensions, math.nan),
            np.asarray(std[-1].max()),
            np.full(shape, math.nan),
        )
        residual = float(np.sqrt(np.mean((data / self.readings.std) ** 2)))
        empty = np.zeros((draws, *shape)) if draws else None
        return _Frame(np.zeros(shape), errors, parameter, scale, residual, True, False, outliers, empty)

    def _first(self, linear: Floats, y: Floats, noise: Floats, heard: Flags, weight: float) -> tuple[Floats, Floats]:
        """The constrained solution on the surface grid (component, cell), and the readings that it explains.

        It is solved over cells where pressure is likely; cells are added until none is missing.
        """
        level = self._levels[1]
        grid = level.grid
        even = level.stencil.even(1, weight)
        precisions = [even / v for v in self._variances]
        pressure = linear[-1]
        region = _grown(pressure >= max(0.15 * float(pressure.max()), 1e-300), 1).ravel()
        region[int(np.argmax(pressure))] = True
        start = linear.reshape(len(linear), -1)
        slope = self._misfit_gradient(y, noise, heard)
        reference = self._quiet(y) * float(np.abs(slope).max())
        traction = np.zeros_like(start)
        explained = np.zeros_like(y)
        for _ in range(12):
            cells = np.flatnonzero(region)
            self._check(len(cells) * len(self.columns))
            member = self._member(self._normal(level, cells, y, noise, heard), precisions, start[:, cells])
            traction = np.zeros((len(self.columns), math.prod(grid.shape)))
            traction[:, cells] = member.solution.traction
            explained = self._explained(traction)
            # a cell left out is missing if pressure there would lower the objective
            slope = self._misfit_gradient(y - explained / noise, noise, heard) - np.stack(
                [q @ t for q, t in zip(precisions, traction)]
            )
            pull = np.abs(self.cone.project(slope * self.cone.scales[:, None])[-1])
            pull[region] = 0.0
            if not (pull > reference).any():
                break
            region |= pull > reference
            start = traction
        return traction, explained

    @staticmethod
    def _quiet(y: Floats) -> float:
        """The part of the peak below which pressure is not told from none, for whitened readings."""
        return float(np.clip(NOISY / max(float(np.abs(y).max()), 1e-300), QUIET, 0.03))

    def _explained(self, traction: Floats) -> Floats:
        grid = self.operator.surface
        full = np.zeros((len(grid.components), *grid.shape))
        full[list(self.columns)] = traction.reshape(len(traction), *grid.shape)
        return self.readings.flat(self.operator.forward(full))

    def _misfit_gradient(self, residual: Floats, noise: Floats, heard: Flags) -> Floats:
        """A' N^-1 residual for every surface cell, (component, cell); ``residual`` is in units of the noise."""
        white = np.zeros(len(residual))
        white[heard] = self.readings.white(self.readings.white(residual[heard], heard), heard)
        adjoint = self.operator.adjoint(self.readings.planes(white / noise))
        return np.asarray(adjoint.reshape(len(adjoint), -1)[list(self.columns)])

    def _check(self, unknowns: int) -> None:
        if unknowns > LARGEST_UNKNOWNS:
            raise Unsupported(
                f'the contact covers {unknowns} unknowns, too many for method="adaptive" (limit {LARGEST_UNKNOWNS}). Give a '
                'coarser surface (Skin(..., surface=...)), or use method="tikhonov".'
            )

    def _member(
        self,
        data: _Normal,
        precision: Sparse | Sequence[Sparse],
        start: Floats,
        *,
        keep_face: bool = False,
        tolerance: float = TOLERANCE,
    ) -> _Member:
        c, n = len(self.columns), len(data.cells)
        hessian = data.gram.copy()
        each = [precision] * c if isinstance(precision, scipy.sparse.csr_array) else list(precision)
        for i, q in enumerate(each):
            hessian[i * n : (i + 1) * n, i * n : (i + 1) * n] += q[data.cells][:, data.cells].toarray()
        solution = minimise(hessian, data.linear, self.cone, start, tolerance=tolerance, keep_face=keep_face)
        return _Member(data, hessian, solution)

    def _normal(self, level: _Level, cells: Index, y: Floats, noise: Floats, heard: Flags) -> _Normal:
        matrix = level.matrix(cells, noise, heard)
        return _Normal(
            level,
            cells,
            matrix,
            matrix.T @ matrix,
            (matrix.T @ self.readings.white(y[heard], heard)).reshape(-1, len(cells)),
        )

    def _ratio(self, parameter: float, unknowns: int) -> int:
        """How much finer than the surface the problem is worth solving."""
        spectrum = self.orders[1].spectrum
        seen = float(spectrum.multiplicity @ (spectrum.eigenvalues / (spectrum.eigenvalues + parameter)))
        d = self.operator.surface.dimensions
        spacing = (self._taxels * len(self.columns) / max(seen, 1.0)) ** (1.0 / d)
        table = LINE_REFINEMENT if d == 1 else AREA_REFINEMENT
        wanted = [r for limit, r in table if r == 1 or unknowns * r**d <= FINE_UNKNOWNS]
        return min(next(r for limit, r in table if spacing <= limit), max([*wanted, 1]))

    def _members(
        self,
        first: Floats,
        y: Floats,
        noise: Floats,
        heard: Flags,
        evidence: Mapping[int, tuple[float, float, float, Floats]],
    ) -> list[_Member]:
        """The accounts of a frame, with their weights.

        Where a contact that crosses the array's edge ends is not in the data (the objectives differ by a nat or less): some
        of the weight goes to accounts that end it on the surface.
        """
        size = np.abs(first[-1]).reshape(self.operator.surface.shape)
        region = _grown(size > self._quiet(y) * size.max(), 1)
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
    ) -> list[_Member]:
        """The accounts of a frame with contact in a region, with their weights."""
        grid = self.operator.surface
        level = self._level(self._ratio(evidence[1][1], int(region.sum()) * len(self.columns)))
        cells = np.flatnonzero(repeated(region, level.ratio))
        start = np.stack([repeated(t.reshape(grid.shape), level.ratio).ravel() for t in first])[:, cells]
        data = self._normal(level, cells, y, noise, heard)
        members = []
        best = max(e[0] for e in evidence.values())
        odds = {order: math.exp(max(e[0] - best, -50.0)) for order, e in evidence.items()}
        for order, (_, parameter, scale, _) in evidence.items():
            if order > 1 and odds[order] < 0.01:
                continue
            even = level.stencil.even(order, parameter / scale**2)
            precisions = [even / v for v in self._variances]
            member = self._trimmed(self._member(data, precisions, start), precisions, y)
            member.weight = odds[order]
            members.append(member)
        total = sum(m.weight for m in members)
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

    def _trimmed(self, member: _Member, precision: Sparse | Sequence[Sparse], y: Floats) -> _Member:
        """Without the cells whose pressure is not told from none: all of it pushes, so that noise there would add up."""
        pressure = member.solution.traction[-1]
        limit = min(TRIM / max(float(np.abs(y).max()), 1e-300), LARGEST_TRIM)
        position = np.flatnonzero(pressure > limit * pressure.max())
        return self._member(
            member.data.part(position), precision, member.solution.traction[:, position], keep_face=True
        )

    def _reaches(self, level: _Level) -> list[tuple[float, bool]]:
        """Widths in cells of the local means that differ on this grid; without the variance weak shear would be lost."""
        cell = min(level.grid.spacings)
        out = [(max(reach * self.depth / cell, 1.0), variance or len(self.columns) > 1) for reach, variance in REACHES]
        return out if out[0] != out[1] else out[:1]

    def _relearned(self, member: _Member, width: float, variance: bool, y: Floats) -> _Member:
        """The penalty learned from its own result, over and over."""
        level = member.level
        c = len(self.columns)
        precisions: list[Sparse] = []
        for i in range(ROUNDS):
            tau = self._local_scales(member, width, variance)
            loud = tau.max(axis=0).ravel()
            pressure = member.solution.traction[-1]
            keep = (loud[member.cells] > QUIET * loud.max()) | (pressure > self._quiet(y) * pressure.max())
            if not self.cone.coupled and c > 1:
                # no shear outside contact
                keep &= _grown(member.pressure > 0, 1).ravel()[member.cells]
            position = np.flatnonzero(keep)
            least = FLOOR * tau.max(axis=tuple(range(1, tau.ndim)), keepdims=True)
            precisions = [level.stencil.local(t) for t in np.maximum(tau, least)]
            last = i == ROUNDS - 1
            member = self._member(
                member.data.part(position),
                precisions,
                member.solution.traction[:, position],
                keep_face=variance and not last,
                tolerance=TOLERANCE if last else ROUGH,
            )
        return self._trimmed(member, precisions, y)

    def _local_scales(self, member: _Member, width: float, variance: bool) -> Floats:
        """tau (component, *grid): local mean of the squared gradient.

        Its course is common to all components, because shear has its edges where pressure has; so is its size, up to
        the fixed ratio of shear to pressure. Learned one by one, weak shear would learn that it is nothing.
        """
        import scipy.ndimage

        level, n = member.level, len(member.cells)
        total: Floats = np.zeros(level.grid.shape)
        for i, values in enumerate(member.solution.traction):
            field = _scattered(values, member.cells, level.grid.shape).ravel()
            squares = []
            for d in level.stencil.differences:
                square = (d @ field) ** 2
                if variance:
                    local = d[:, member.cells]
                    touched = np.flatnonzero(np.diff(local.indptr))
                    rows = np.zeros((len(touched), len(self.columns) * n))
                    rows[:, i * n : (i + 1) * n] = local[touched].toarray()
                    square[touched] += (_spread(member.solution, rows) ** 2).sum(axis=0)
                squares.append(square)
            total = total + level.stencil.energy(squares) / (self._variances[i] * len(self._variances))
        sigma = [width * min(level.grid.spacings) / dx for dx in level.grid.spacings]
        tau = scipy.ndimage.gaussian_filter(total, sigma, mode="constant")
        return np.stack([v * tau for v in self._variances])

    def _combined(
        self,
        members: Sequence[_Member],
        y: Floats,
        heard: Flags,
        parameter: float,
        scale: float,
        draws: int,
        rng: np.random.Generator | None,
    ) -> _Frame:
        grid = self.operator.surface
        parts = [_account(m, grid, self.inside) for m in members]
        weights = np.array([m.weight for m in members])

        def mixed(index: int) -> tuple[Floats, Floats]:
            """Mean and total variance of a quantity over the accounts."""
            values = np.stack([p[index][0] for p in parts])
            spread = np.stack([p[index][1] for p in parts])
            mean = np.tensordot(weights, values, 1)
            return mean, np.tensordot(weights, spread + (values - mean) ** 2, 1)

        mean, variance = mixed(0)
        shape = (len(grid.components), *grid.shape)
        traction, std = np.zeros(shape), np.zeros(shape)
        traction[list(self.columns)] = mean
        std[list(self.columns)] = np.sqrt(_spread_out(variance))
        force = np.zeros(len(grid.components))
        total, spread = mixed(1)
        force[list(self.columns)] = np.sqrt(spread + (MODEL_FORCE * total) ** 2)
        detail = np.full(shape, math.nan)
        detail[list(self.columns)] = _detail(members[0], grid)
        errors = Errors(
            detail=detail,
            traction=std,
            force=force,
            **{name: np.sqrt(mixed(i)[1]) for i, name in ((2, "moment"), (3, "center"), (4, "peak"))},
        )
        found = sum(w * (m.data.matrix @ m.solution.traction.ravel()) for w, m in zip(weights, members))
        misfit = found - self.readings.white(y[heard], heard)
        sampled = None
        if draws:
            sampled = self._draws(members, weights, draws, rng or np.random.default_rng(0))
        return _Frame(
            traction,
            errors,
            parameter,
            scale,
            float(np.sqrt(np.mean(misfit**2))),
            all(m.solution.converged for m in members),
            True,
            ~heard,
            sampled,
        )

    def _draws(self, members: Sequence[_Member], weights: Floats, count: int, rng: np.random.Generator) -> Floats:
        """Samples of the traction: each minimises the problem of one account with readings and prior perturbed.

        The minimiser of 1/2 x'Hx - (h + H^{1/2} z)'x over the cone is a projection of a Gaussian posterior sample onto
        the cone (J. M. Everink, Y. Dong, M. S. Andersen, SIAM/ASA J. Uncertainty Quantification 11, 2023), so that samples
        respect the constraints and leave cells empty with finite probability.
        """
        grid = self.operator.surface
        out = np.zeros((count, len(grid.components), *grid.shape))
        picks = rng.choice(len(members), size=count, p=weights / weights.sum())
        for i, member in enumerate(members):
            chosen = np.flatnonzero(picks == i)
            if not len(chosen):
                continue
            root = cholesky(member.hessian.copy())
            for j in chosen:
                linear = member.data.linear + (root @ rng.standard_normal(len(root))).reshape(member.data.linear.shape)
                x = minimise(member.hessian, linear, self.cone, member.solution.traction).traction
                for k, column in enumerate(self.columns):
                    out[j, column] = block_means(
                        _scattered(x[k], member.cells, member.level.grid.shape), member.level.ratio, grid.dimensions
                    )
        return out


def _spread(solution: Solution, rows: Any) -> Floats:
    """Z (free, row) with Z'Z the posterior covariance of rows' x, on the face of the cone that the solution lies on.

    ``rows`` (row, component * cell), dense or sparse.
    """
    import scipy.linalg

    if solution.face is None or solution.factor is None:
        raise RuntimeError("the solution was found without its face")
    dense = rows.toarray() if scipy.sparse.issparse(rows) else rows
    right = solution.face.columns(np.asarray(dense)).T
    return np.asarray(scipy.linalg.solve_triangular(solution.factor, right, lower=True, check_finite=False))


def _scattered(values: Floats, cells: Index, shape: tuple[int, ...]) -> Floats:
    out = np.zeros(math.prod(shape))
    out[cells] = values
    return out.reshape(shape)


def _grown(region: Flags, cells: int) -> Flags:
    import scipy.ndimage

    structure = np.ones((3,) * region.ndim, dtype=bool)
    return np.asarray(scipy.ndimage.binary_dilation(region, structure, iterations=cells))


def _spread_out(variance: Floats) -> Floats:
    """The error of where the contact ends belongs to the cells just outside it too."""
    import scipy.ndimage

    size = (1,) + (3,) * (variance.ndim - 1)
    return np.asarray(np.maximum(variance, scipy.ndimage.uniform_filter(variance, size, mode="nearest")))


def _detail(member: _Member, grid: Grid) -> Floats:
    """1 - posterior over prior variance of traction on the surface's cells (component, *surface); NaN out of contact."""
    import scipy.linalg

    face = member.solution.face
    c, n = member.solution.traction.shape
    out = np.full((c, math.prod(grid.shape)), math.nan)
    if face is None or not len(face.index):
        return out.reshape(c, *grid.shape)
    prior = cholesky(face.restrict(member.hessian - member.data.gram))
    share, surface_cells = _shares(member, grid)
    for i in range(c):
        rows = np.zeros((len(surface_cells), c * n))
        rows[:, i * n : (i + 1) * n] = share.toarray()
        before = scipy.linalg.solve_triangular(prior, face.columns(rows).T, lower=True, check_finite=False)
        with np.errstate(divide="ignore", invalid="ignore"):
            out[i, surface_cells] = 1.0 - (_spread(member.solution, rows) ** 2).sum(axis=0) / (before**2).sum(axis=0)
    return out.reshape(c, *grid.shape)


def _shares(member: _Member, grid: Grid) -> tuple[Sparse, Index]:
    """Means over the fine cells of each surface cell, and which surface cells those are."""
    level, ratio, n = member.level, member.level.ratio, len(member.cells)
    places = np.unravel_index(member.cells, level.grid.shape)
    flat = np.ravel_multi_index(tuple(p // ratio for p in places), grid.shape)
    surface_cells, inverse = np.unique(flat, return_inverse=True)
    share = scipy.sparse.csr_array(
        (np.full(n, 1.0 / ratio**grid.dimensions), (inverse, np.arange(n))), shape=(len(surface_cells), n)
    )
    return share, surface_cells


Quantity = tuple[Floats, Floats]


def _account(member: _Member, grid: Grid, inside: Flags) -> tuple[Quantity, Quantity, Quantity, Quantity, Quantity]:
    """(value, variance) of traction on the surface's cells, net force, moment, centre of pressure and peak pressure.

    The numbers are those of the cells ``inside``.
    """
    level = member.level
    c, n = member.solution.traction.shape
    places = np.unravel_index(member.cells, level.grid.shape)
    share, surface_cells = _shares(member, grid)
    mean, variance = np.zeros((2, c, math.prod(grid.shape)))
    for i in range(c):
        mean[i, surface_cells] = share @ member.solution.traction[i]
        rows = np.zeros((len(surface_cells), c * n))
        rows[:, i * n : (i + 1) * n] = share.toarray()
        variance[i, surface_cells] = (_spread(member.solution, rows) ** 2).sum(axis=0)
    kept = inside[tuple(p // level.ratio for p in places)].astype(np.float64)
    cell = level.grid.cell * kept
    axes = [axis[p] for axis, p in zip(level.grid.axes, places)][::-1]  # x, then y

    def linear(weights: Floats) -> Quantity:
        """Of sums of traction (quantity, component, cell)."""
        rows = weights.reshape(len(weights), -1)
        return rows @ member.solution.traction.ravel(), (_spread(member.solution, rows) ** 2).sum(axis=0)

    force_rows = np.zeros((c, c, n))
    force_rows[np.arange(c), np.arange(c)] = cell
    p = member.solution.traction[-1] * kept
    total = float(p.sum()) or 1.0
    center = np.array([float((x * p).sum()) / total for x in axes])
    center_rows = np.zeros((len(axes), c, n))
    for i, x in enumerate(axes):
        center_rows[i, -1] = kept * (x - center[i]) / total
    if len(axes) == 1:
        moment_rows = np.zeros((1, c, n))
        moment_rows[0, -1] = -axes[0] * cell
    else:
        moment_rows = np.zeros((3, c, n))
        moment_rows[0, -1], moment_rows[1, -1] = axes[1] * cell, -axes[0] * cell
        if c == 3:
            moment_rows[2, 0], moment_rows[2, 1] = -axes[1] * cell, axes[0] * cell
    top = int(np.argmax(np.where(inside.ravel(), mean[-1], -1.0)))
    return (
        (mean.reshape(c, *grid.shape), variance.reshape(c, *grid.shape)),
        linear(force_rows),
        linear(moment_rows),
        (center, linear(center_rows)[1]),
        (mean[-1, top], variance[-1, top]),
    )
