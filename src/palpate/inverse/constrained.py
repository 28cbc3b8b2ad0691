"""method="constrained": one penalised problem with its constraints, solved exactly.

The penalty is the first derivative of traction, evenly weighed; its weight and the noise come from marginal likelihood of the
linear model (`palpate.inverse.parameter`) where they are not given. Pressure never pulls, shear stays inside the friction cone.
It is solved over the cells where contact is possible (`palpate.inverse.cone`); cells are added until none is missing. This is
what `palpate.inverse.adaptive` starts from and what `palpate.tracking` repeats frame after frame.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._arrays import from_numpy, to_numpy
from palpate.elastic.half_space import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.account import Account, Errors, Level, Normal, detail_of, quantities, scattered, spread, spread_out
from palpate.inverse.cone import TOLERANCE, Cone, cholesky, minimise
from palpate.inverse.parameter import choose_parameter, shared_variance, tikhonov
from palpate.inverse.priors import DifferencePrior
from palpate.inverse.regularised import Estimate, Regularised
from palpate.inverse.stencil import Sparse
from palpate.inverse.whitening import Readings
from palpate.sensing.grids import Grid, block_means
from palpate.sensing.operator import Operator

__all__ = ["Constrained"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: Cells of less than this part of the peak pressure do not make a contact; cells so near to one are part of its problem.
FAINT, MARGIN = 0.05, 2
#: Most unknowns of one frame.
LARGEST_UNKNOWNS = 9000
#: Readings up to which the second derivative is tried too (its spectrum costs as much again to prepare).
SECOND_ORDER_READINGS = 4096
#: Gain in log evidence over noise alone below which a frame counts as empty.
CONTACT_EVIDENCE = 6.0
#: The same of a patch of pressure beside a larger one: there are many places where noise may look like one.
PATCH_EVIDENCE = 15.0
#: Size of shear next to pressure where friction is not known.
SHEAR = 0.7
#: Cells below this part of the largest local scale, and of the peak pressure, are outside the contact; more where there is
#: more noise (times noise over signal).
QUIET, NOISY = 1e-3, 0.3
#: A reading is left out if it is this many standard deviations, and this part of the largest reading, from what the
#: contact explains (a coarse cell alone explains a per cent); up to this part of all readings.
OUTLIER, GROSS, LARGEST_OUTLIERS = 6.0, 0.05, 0.2
#: The noise is learned again where the constrained misfit is this many times what the linear model called noise.
QUIETER = 1.2
#: Channels have each their own noise where their misfits differ by more than this (log) and by so many standard errors; changes of less
#: than the last are not followed.
UNEQUAL, UNEQUAL_ERRORS, SETTLED = 0.2, 3.0, 0.1
#: Channels' noise and contact are found in turn, so often at most.
TURNS = 4
#: Frames of a batch from which the channels' noise is learned.
PROBES = 4
#: No pad and no grid is known better than this part of the largest reading: the least noise that is assumed.
MODEL_ERROR = 2e-4
#: The same for the net force.
MODEL_FORCE = 5e-4
#: Contact that only pushes does not explain a frame if this many standard deviations of misfit remain, and this part of the signal.
UNEXPLAINED, UNEXPLAINED_SIGNAL = 3.0, 0.03


@dataclass(frozen=True)
class _Frame:
    """One frame's result."""

    traction: Floats
    errors: Errors
    parameter: float
    noise: Floats
    residual: float
    converged: bool
    contact: bool
    outliers: Flags
    draws: Floats | None
    pushed: bool = True
    sliding: float = math.nan


class Constrained:
    """The constrained estimator, prepared once for an operator, the components sought and the constraints.

    ``surface``, where given, is the middle of the operator's grid that the result is cut to: a contact across the array's
    edge is explained by cells farther out than anyone wants to see. ``parameter`` is the weight of the penalty, or "evidence".
    """

    #: Cells round those in contact beyond doubt that share their error.
    reach = MARGIN
    #: Derivatives whose penalties are compared by evidence.
    derivatives: tuple[int, ...] = (1,)

    def __init__(
        self,
        operator: Operator,
        columns: Sequence[int],
        cone: Cone,
        surface: Grid | None = None,
        parameter: float | str = "evidence",
    ) -> None:
        if cone.free:
            raise Unsupported(
                'this method lives on pressure that cannot pull: seek component z as well, or use method="tikhonov".'
            )
        if isinstance(parameter, str) and parameter != "evidence":
            raise Unsupported(f'method="constrained" takes a number or parameter="evidence"; got {parameter!r}.')
        if not isinstance(parameter, str) and not (math.isfinite(parameter) and parameter > 0):
            raise InvalidInput(f"parameter must be a positive number or a rule; got {parameter!r}.")
        self.parameter = None if isinstance(parameter, str) else float(parameter)
        self.operator, self.cone, self.columns = operator, cone, tuple(columns)
        grid = operator.surface
        self.surface = grid if surface is None else surface
        # the cells of the operator's grid that the result is made of
        self.window = tuple(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid.shape, self.surface.shape))
        self.inside = np.zeros(grid.shape, dtype=bool)
        self.inside[self.window] = True
        # beyond the outermost taxels
        points = np.concatenate([a.points[np.ravel(a.valid)] for a in operator.planes_of])
        self.beyond = np.zeros(grid.shape, dtype=bool)
        for axis, (x, dx) in enumerate(zip(grid.axes, grid.spacings)):
            low, high = points[:, axis].min() - 0.5 * dx, points[:, axis].max() + 0.5 * dx
            outside = (x < low - 1e-9 * dx) | (x > high + 1e-9 * dx)
            self.beyond |= outside.reshape([-1 if a == axis else 1 for a in range(grid.dimensions)])
        # shear varies less than pressure, by what friction allows, shared between its components
        shear = 0.5 * (cone.friction or SHEAR) ** 2
        self.variances = [1.0 if c == len(columns) - 1 else shear for c in range(len(columns))]
        readings = sum(int(a.valid.sum()) * len(a.channels) for a in operator.planes_of)
        orders = self.derivatives if readings <= SECOND_ORDER_READINGS else (1,)
        self.orders = {
            order: Regularised(
                operator, [DifferencePrior(grid, order, v) for v in self.variances], columns, tikhonov, "evidence"
            )
            for order in orders
        }
        self.scales, self.noise_known = self.orders[1].scales, self.orders[1].noise_known
        self.readings = Readings(operator, self.scales)
        # which channel each reading belongs to
        self.channel = np.repeat(
            np.arange(sum(len(a.channels) for a in operator.planes_of)),
            [n for a, n in zip(operator.planes_of, self.readings.sizes) for _ in a.channels],
        )
        self._levels: dict[int, Level] = {1: self._make_level(1)}
        self.depth = max(min(a.depth for a in operator.planes_of), max(grid.spacings))
        self.taxels = max(int(a.valid.sum()) for a in operator.planes_of)

    @property
    def tells_sliding(self) -> bool:
        """Whether accounts of a contact that slides are among those weighed."""
        return False

    def level(self, ratio: int) -> Level:
        """The operator on cells ``ratio`` times finer, made once."""
        if ratio not in self._levels:
            self._levels[ratio] = self._make_level(ratio)
        return self._levels[ratio]

    def _make_level(self, ratio: int) -> Level:
        return Level(self.operator, ratio, self.columns, self.readings)

    def precisions(self, level: Level, order: int, weight: float) -> list[Sparse]:
        """The even penalty of each component on a level."""
        even = level.stencil.even(order, weight)
        return [even / v for v in self.variances]

    def accounts(
        self,
        first: Floats,
        y: Floats,
        noise: Floats,
        heard: Flags,
        evidence: Mapping[int, tuple[float, float, float, Floats]],
    ) -> list[Account]:
        """The accounts of a frame, with their weights: here one, the constrained solution on the contact and a margin.

        What is farther from it is noise, of which pressure that only pushes would keep half; so are patches that explain no more
        of the readings than noise does.
        """
        import scipy.ndimage

        level = self.level(1)
        _, parameter, scale, _ = evidence[1]
        region = grown((first[-1] > FAINT * first[-1].max()).reshape(level.grid.shape), MARGIN)
        cells = np.flatnonzero(region)
        data = self.normal(level, cells, y, noise, heard)
        patches = scipy.ndimage.label(region, np.ones((3,) * region.ndim))[0].ravel()[cells]
        weight = {}
        for patch in np.unique(patches):
            alone = np.where(patches == patch, first[:, cells], 0.0)
            weight[patch] = 0.5 * float(((data.matrix @ alone.ravel()) ** 2).sum())
        largest = max(weight, key=lambda patch: weight[patch])
        kept = [patch for patch, w in weight.items() if w > PATCH_EVIDENCE or patch == largest]
        position = np.flatnonzero(np.isin(patches, kept))
        account = self.account(
            data.part(position),
            self.precisions(level, 1, parameter / scale**2),
            first[:, cells[position]],
            keep_face=True,
        )
        pressure = account.solution.traction[-1]
        sure = np.flatnonzero(pressure > FAINT * pressure.max())
        account.contact = self.account(
            account.data.part(sure),
            self.precisions(level, 1, parameter / scale**2),
            account.solution.traction[:, sure],
            keep_face=True,
        )
        account.weight = 1.0
        return [account]

    def seen(self, parameter: float) -> float:
        """How many degrees of freedom of the traction the data tell, rather than the penalty."""
        spectrum = self.orders[1].spectrum
        return float(spectrum.multiplicity @ (spectrum.eigenvalues / (spectrum.eigenvalues + parameter)))

    def resolution(self, parameter: float) -> float:
        """Finest detail that the data tell [m]: the side of the area (length on a line) that has one degree of freedom."""
        arrays = self.operator.planes_of
        points = np.concatenate([a.points for a in arrays])
        spans = np.ptp(points, axis=0) + np.asarray(self.operator.surface.spacings)
        return float((np.prod(spans) * len(self.columns) / max(self.seen(parameter), 1.0)) ** (1.0 / len(spans)))

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
        count = math.prod(batch)
        levels, done = self._shared_levels(arrays, draws, rng, known) if count > 1 else (None, {})
        frames = [
            done[i] if i in done else self.frame([a[i] for a in arrays], draws, rng, known, levels)
            for i in range(count)
        ]

        def stacked(parts: Sequence[Floats]) -> Floats:
            whole = np.stack(parts)
            if whole.ndim > self.operator.surface.dimensions + 1:  # a field
                whole = self._cut(whole)
            return np.asarray(whole.reshape((*batch, *whole.shape[1:])))

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
            np.stack([f.noise for f in frames]).reshape((*batch, -1)),
            numbers("residual"),
            Errors.gathered([f.errors for f in frames], stacked),
            numbers("converged", bool),
            numbers("contact", bool),
            outliers.reshape((*batch, -1)),
            sampled,
            pushed=numbers("pushed", bool),
            resolution=np.array([self.resolution(f.parameter) for f in frames]).reshape(batch),
            sliding=numbers("sliding") if self.tells_sliding else None,
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

    def _shared_levels(
        self, arrays: Sequence[Floats], draws: int, rng: np.random.Generator | None, known: float | None
    ) -> tuple[Floats | None, dict[int, _Frame]]:
        """The noise of each channel that some frames tell together, and those frames where it is one for all."""
        if self.noise_known or self.channel[-1] == 0:
            return None, {}
        count = len(arrays[0])
        probes = np.unique(np.linspace(0, count - 1, min(PROBES, count)).astype(int))
        done = {int(i): self.frame([a[i] for a in arrays], draws, rng, known) for i in probes}
        touching = [f for f in done.values() if f.contact]
        unequal = [f.noise for f in touching if np.ptp(f.noise) > 0]
        if 2 * len(unequal) <= len(touching):
            return None, done
        return np.sqrt(np.mean(np.square([f.noise for f in touching]), axis=0)), {}

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
        levels: Floats | None = None,
    ) -> _Frame:
        """Contact in one frame of readings, (channel, *array) per plane.

        ``known`` is the noise scale learned elsewhere, ``levels`` that of every channel.
        """
        rows = self.operator.heard(readings)
        data = self.readings.flat(rows)
        alive = self._alive(data)
        heard, learned, given = alive.copy(), 0, levels is not None
        for attempt in range(10):
            evidence = {order: self.evidence(linear, rows, known) for order, linear in self.orders.items()}
            gain, parameter, scale, linear = evidence[1]
            if not (gain > CONTACT_EVIDENCE + self._uneven(data, heard, known) and scale > 0):
                return self._nothing(parameter, scale, data, ~heard, draws)
            floor = MODEL_ERROR * float(np.abs(data / self.readings.std).max())
            noise = self.readings.std * np.maximum(scale if levels is None else levels[self.channel], floor)
            first, explained = self.fit(linear, data / noise, noise, heard, parameter / scale**2)
            wrong = self._outliers(data, explained, noise)
            few = (wrong | ~heard)[alive].mean() <= LARGEST_OUTLIERS
            found = few and (wrong & heard).any()
            if (attempt < 4 and found) or (attempt < 2 and not alive.all()):
                if few:
                    heard &= ~wrong
                # what is left out is filled with what the contact explains, so that the linear model can go on
                rows = self.readings.planes(np.where(heard, data, explained))
                continue
            if not first[-1].any():
                break
            members = self.accounts(first, data / noise, noise, heard, evidence)
            if self.noise_known or given:
                break
            own = self._levels_of(members[0], data / noise, noise, heard, unequal=levels is None)
            if own is not None:
                if levels is not None and (learned == TURNS or np.abs(np.log(own / levels)).max() < SETTLED):
                    break
                levels, learned = own, learned + 1
                continue
            # what pressure that only pushes cannot follow is noise, even where a linear model could
            left = self._noise_left(members[0], first, data / noise, heard, parameter) * noise[0] / self.readings.std[0]
            if learned == 2 or max(left, floor) < QUIETER * max(scale, floor):
                break
            known, learned = left, learned + 1
        signal = self.readings.white((data / noise)[heard], heard)
        left = float(np.sqrt(np.mean((signal - self.readings.white((explained / noise)[heard], heard)) ** 2)))
        limit = max(UNEXPLAINED, UNEXPLAINED_SIGNAL * float(np.sqrt(np.mean(signal**2))))
        pushed = left <= limit
        if not first[-1].any():
            return replace(self._nothing(parameter, scale, data, ~heard, draws), pushed=pushed)
        each = np.full(self.channel[-1] + 1, scale) if levels is None else levels
        result = self._combined(members, data / noise, heard, parameter, each, draws, rng)
        # the accounts may explain on a finer grid what cells of the surface cannot
        return replace(result, pushed=pushed or result.residual <= limit)

    def _alive(self, data: Floats) -> Flags:
        """False for the readings of a channel all of which are the same while others differ: it is broken."""
        ends = np.searchsorted(self.channel, np.arange(self.channel[-1] + 2))
        same = np.array([b - a > 3 and np.ptp(data[a:b]) == 0 for a, b in itertools.pairwise(ends)])
        return np.asarray(~same[self.channel] if not same.all() else np.ones(len(data), dtype=bool))

    def _uneven(self, data: Floats, heard: Flags, known: float | None) -> float:
        """Log likelihood of noise alone with a level for each channel, over that of one level: no contact explains what this does."""
        if self.noise_known or self.channel[-1] == 0:
            return 0.0
        channel = self.channel[heard]
        white = self.readings.white((data / self.readings.std)[heard], heard)
        power, count = np.bincount(channel, white**2), np.bincount(channel)
        power, count = power[power > 0], count[power > 0]
        if not len(power) or (count < 3).any():
            return 0.0
        common = power.sum() / count.sum() if known is None else known**2
        own = power / count
        return 0.5 * float((power / common - count + count * np.log(common / own)).sum())

    def _levels_of(self, member: Account, y: Floats, noise: Floats, heard: Flags, *, unequal: bool) -> Floats | None:
        """Noise of each channel in units of the whitening, from the misfit and the freedom that the contact took of each.

        With ``unequal``, None where the channels' noise is not told apart from one for all.
        """
        if self.channel[-1] == 0:
            return None
        channel = self.channel[heard]
        matrix = member.data.matrix
        misfit = matrix @ member.solution.traction.ravel() - self.readings.white(y[heard], heard)
        count = np.bincount(channel, minlength=self.channel[-1] + 1)
        alive = count > 0
        if (count[alive] < 3).any():
            return None
        power = np.bincount(channel, misfit**2, minlength=len(count))[alive]
        if unequal and np.ptp(np.log(np.maximum(power / count[alive], 1e-300))) < 2.0 * UNEQUAL:
            return None
        took = np.bincount(channel, (spread(member.solution, matrix) ** 2).sum(axis=0), minlength=len(count))
        free = np.maximum((count - took)[alive], 1.0)
        off = 0.5 * np.log(np.maximum(power / free, 1e-300) * free.sum() / power.sum())
        if unequal and not (np.abs(off) > UNEQUAL + UNEQUAL_ERRORS / np.sqrt(2.0 * free)).any():
            return None
        levels = (noise / self.readings.std)[np.searchsorted(self.channel, np.arange(len(count)))]
        levels[alive] *= np.sqrt(power / free)
        return np.asarray(levels)

    def _noise_left(self, member: Account, first: Floats, y: Floats, heard: Flags, parameter: float) -> float:
        """Root mean square of the whitened misfit, for the freedom that the contact took: the modes seen, over its area."""
        seen = self.seen(parameter)
        share = float(np.count_nonzero(first[-1])) / self.taxels
        free = max(float(heard.sum()) - min(share, 1.0) * seen, 1.0)
        misfit = member.data.matrix @ member.solution.traction.ravel() - self.readings.white(y[heard], heard)
        return float(np.sqrt((misfit**2).sum() / free))

    def evidence(
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
        if self.parameter is None:
            chosen, variance = choose_parameter("evidence", tikhonov, values, counts, power[None], noise_known=certain)
        else:
            chosen = np.array([self.parameter])
            left = float((counts * power * (1.0 - tikhonov(values, chosen))).sum())
            variance = np.array([1.0 if certain else left / counts.sum()])
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
        """No contact."""
        grid, names = self.operator.surface, self.operator.surface.components
        shape = (len(names), *grid.shape)
        # from the readings themselves: the residual is all noise
        rms = float(np.sqrt(np.mean((data / self.readings.std) ** 2)))
        errors = self.unnoticed(scale if self.noise_known else rms)
        empty = np.zeros((draws, *shape)) if draws else None
        noise = np.full(self.channel[-1] + 1, scale)
        return _Frame(np.zeros(shape), errors, parameter, noise, rms, True, False, outliers, empty)

    def unnoticed(self, scale: float) -> Errors:
        """What would not be noticed: the error of the pressure of a patch as wide as the depth, the least that would show."""
        grid, names = self.operator.surface, self.operator.surface.components
        shape = (len(names), *grid.shape)
        radius = np.zeros(grid.shape)
        for axis, x in enumerate(grid.axes):
            offset = x - x[len(x) // 2]
            radius = radius + (offset**2).reshape([-1 if a == axis else 1 for a in range(grid.dimensions)])
        patch = radius <= max(self.depth, max(grid.spacings)) ** 2
        response = self._levels[1].operator.columns(self.columns, np.flatnonzero(patch)).sum(axis=2)
        noise = self.readings.std * scale
        with np.errstate(divide="ignore", invalid="ignore"):
            sharp = np.where(noise[:, None] > 0, response / noise[:, None], np.inf)
        if np.isfinite(sharp).all():
            sharp = self.readings.white(sharp, np.ones(len(noise), dtype=bool))
        amplitude = 1.0 / np.sqrt((sharp**2).sum(axis=0))
        area = float(patch.sum()) * grid.cell
        std, force = np.zeros(shape), np.zeros(len(names))
        for i, c in enumerate(self.columns):
            std[c], force[c] = amplitude[i], amplitude[i] * area
        reach = max(float(np.abs(x).max()) for x in grid.axes)
        return Errors(
            std,
            force,
            np.full(1 if grid.dimensions == 1 else 3, force.max() * reach),
            np.full(grid.dimensions, math.nan),
            np.asarray(std[-1].max()),
            np.full(shape, math.nan),
            **self._outer(np.zeros(shape)),
        )

    def fit(self, linear: Floats, y: Floats, noise: Floats, heard: Flags, weight: float) -> tuple[Floats, Floats]:
        """The constrained solution on the surface grid (component, cell), and the readings that it explains.

        It is solved over cells where pressure is likely; cells are added until none is missing.
        """
        level = self._levels[1]
        grid = level.grid
        precisions = self.precisions(level, 1, weight)
        pressure = linear[-1]
        region = grown(pressure >= max(0.15 * float(pressure.max()), 1e-300), 1).ravel()
        region[int(np.argmax(pressure))] = True
        start = linear.reshape(len(linear), -1)
        slope = self.misfit_gradient(y, noise, heard)
        reference = self.quiet(y) * float(np.abs(slope).max())
        traction = np.zeros_like(start)
        explained = np.zeros_like(y)
        for _ in range(12):
            cells = np.flatnonzero(region)
            self.check_size(len(cells) * len(self.columns))
            member = self.account(self.normal(level, cells, y, noise, heard), precisions, start[:, cells])
            traction = np.zeros((len(self.columns), math.prod(grid.shape)))
            traction[:, cells] = member.solution.traction
            explained = self.explained_by(traction)
            # a cell left out is missing if pressure there would lower the objective
            slope = self.misfit_gradient(y - explained / noise, noise, heard) - np.stack(
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
    def quiet(y: Floats) -> float:
        """The part of the peak below which pressure is not told from none, for whitened readings."""
        return float(np.clip(NOISY / max(float(np.abs(y).max()), 1e-300), QUIET, 0.03))

    def explained_by(self, traction: Floats) -> Floats:
        grid = self.operator.surface
        full = np.zeros((len(grid.components), *grid.shape))
        full[list(self.columns)] = traction.reshape(len(traction), *grid.shape)
        return self.readings.flat(self.operator.forward(full))

    def misfit_gradient(self, residual: Floats, noise: Floats, heard: Flags) -> Floats:
        """A' N^-1 residual for every surface cell, (component, cell); ``residual`` is in units of the noise."""
        white = np.zeros(len(residual))
        white[heard] = self.readings.white(self.readings.white(residual[heard], heard), heard)
        adjoint = self.operator.adjoint(self.readings.planes(white / noise))
        return np.asarray(adjoint.reshape(len(adjoint), -1)[list(self.columns)])

    def check_size(self, unknowns: int) -> None:
        """Refuse a problem that is too large."""
        if unknowns > LARGEST_UNKNOWNS:
            raise Unsupported(
                f"the contact covers {unknowns} unknowns, too many (limit {LARGEST_UNKNOWNS}). Give a "
                'coarser surface (Skin(..., surface=...)), or use method="tikhonov".'
            )

    def account(
        self,
        data: Normal,
        precision: Sparse | Sequence[Sparse],
        start: Floats,
        *,
        keep_face: bool = False,
        tolerance: float = TOLERANCE,
    ) -> Account:
        c, n = len(self.columns), len(data.cells)
        hessian = data.gram.copy()
        each = [precision] * c if isinstance(precision, scipy.sparse.csr_array) else list(precision)
        for i, q in enumerate(each):
            hessian[i * n : (i + 1) * n, i * n : (i + 1) * n] += q[data.cells][:, data.cells].toarray()
        solution = minimise(hessian, data.linear, self.cone, start, tolerance=tolerance, keep_face=keep_face)
        return Account(data, hessian, solution)

    def normal(self, level: Level, cells: Index, y: Floats, noise: Floats, heard: Flags) -> Normal:
        matrix = level.matrix(cells, noise, heard)
        linear = matrix.T @ self.readings.white(y[heard], heard)
        return Normal(level, cells, matrix, linear.reshape(-1, len(cells)))

    def summed_up(self, members: Sequence[Account]) -> tuple[Floats, Errors]:
        """Mean traction (component, *grid) of the accounts by their weights, and the closed-form errors of every quantity."""
        grid = self.operator.surface
        parts = [quantities(m, grid, self.inside) for m in members]
        sure = [p if m.contact is None else quantities(m.contact, grid, self.inside) for p, m in zip(parts, members)]
        weights = np.array([m.weight for m in members])

        def mixed(index: int) -> tuple[Floats, Floats]:
            """Mean and total variance of a quantity over the accounts."""
            values = np.stack([p[index][0] for p in parts])
            spread = np.stack([p[index][1] for p in sure])
            mean = np.tensordot(weights, values, 1)
            return mean, np.tensordot(weights, spread + (values - mean) ** 2, 1)

        mean, variance = mixed(0)
        shape = (len(grid.components), *grid.shape)
        traction, std = np.zeros(shape), np.zeros(shape)
        traction[list(self.columns)] = mean
        std[list(self.columns)] = np.sqrt(spread_out(variance, self.reach))
        force = np.zeros(len(grid.components))
        total, spread = mixed(1)
        force[list(self.columns)] = np.sqrt(spread + (MODEL_FORCE * total) ** 2)
        detail = np.full(shape, math.nan)
        detail[list(self.columns)] = detail_of(members[0].contact or members[0], grid)
        errors = Errors(
            detail=detail,
            traction=std,
            force=force,
            **{name: np.sqrt(mixed(i)[1]) for i, name in ((2, "moment"), (3, "center"), (4, "peak"))},
            **self._outer(traction),
        )
        return traction, errors

    def _outer(self, traction: Floats) -> dict[str, Floats]:
        """What traction (component, *grid) and the numbers owe to cells beyond the outermost taxels."""
        grid = self.operator.surface
        cell = grid.cell * self.inside
        places = np.meshgrid(*grid.axes, indexing="ij")[::-1]  # x, then y
        outer = np.abs(traction) * self.beyond
        p = cell * traction[-1]
        total = float(p.sum()) or 1.0
        far = cell * traction * self.beyond
        if len(places) == 1:
            moment = [-(places[0] * far[-1]).sum()]
        else:
            x, y = places
            moment = [(y * far[-1]).sum(), -(x * far[-1]).sum(), (x * far[1] - y * far[0]).sum()]
        center = [((x - (x * p).sum() / total) * far[-1]).sum() / total for x in places]
        top = np.unravel_index(int(np.argmax(p)), p.shape)
        return {
            "outer_traction": outer,
            "outer_force": np.abs(far.reshape(len(far), -1).sum(axis=1)),
            "outer_moment": np.abs(moment),
            "outer_center": np.abs(center),
            "outer_peak": np.asarray(outer[-1][top]),
        }

    def _combined(
        self,
        members: Sequence[Account],
        y: Floats,
        heard: Flags,
        parameter: float,
        noise: Floats,
        draws: int,
        rng: np.random.Generator | None,
    ) -> _Frame:
        traction, errors = self.summed_up(members)
        weights = np.array([m.weight for m in members])
        found = sum(w * (m.data.matrix @ m.solution.traction.ravel()) for w, m in zip(weights, members))
        misfit = found - self.readings.white(y[heard], heard)
        sampled = None
        if draws:
            sampled = self._draws(members, weights, draws, rng or np.random.default_rng(0))
        return _Frame(
            traction,
            errors,
            parameter,
            noise,
            float(np.sqrt(np.mean(misfit**2))),
            all(m.solution.converged for m in members),
            True,
            ~heard,
            sampled,
            sliding=sum(m.weight for m in members if m.ray is not None),
        )

    def _draws(self, members: Sequence[Account], weights: Floats, count: int, rng: np.random.Generator) -> Floats:
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
            data, cone, start = member.data, self.cone, member.solution.traction
            if member.ray is not None:
                data, cone, start = data.along(member.ray), Cone(cone.components[-1:]), start[-1:]
            for j in chosen:
                linear = data.linear + (root @ rng.standard_normal(len(root))).reshape(data.linear.shape)
                x = minimise(member.hessian, linear, cone, start).traction
                if member.ray is not None:
                    x = self._turned(member, rng)[:, None] * x
                for k, column in enumerate(self.columns):
                    out[j, column] = block_means(
                        scattered(x[k], member.cells, member.level.grid.shape), member.level.ratio, grid.dimensions
                    )
        return out

    def _turned(self, member: Account, rng: np.random.Generator) -> Floats:
        """A sample of the traction over the pressure of a contact that slides."""
        ray, changes, factor = member.ray, member.changes, member.solution.factor
        if ray is None or changes is None or factor is None:
            raise RuntimeError("only a contact that slides has one traction over pressure")
        count = len(changes)
        if count:
            # the last entries of a Gaussian whose precision has this factor
            ray = ray + np.linalg.solve(factor[-count:, -count:].T, rng.standard_normal(count)) @ changes
        shear = float(np.linalg.norm(ray[:-1]))
        return np.append(ray[:-1] * min(1.0, float(self.cone.friction or shear) / max(shear, 1e-300)), 1.0)


def grown(region: Flags, cells: int) -> Flags:
    import scipy.ndimage

    structure = np.ones((3,) * region.ndim, dtype=bool)
    return np.asarray(scipy.ndimage.binary_dilation(region, structure, iterations=cells))
