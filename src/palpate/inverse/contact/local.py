"""method="local": traction of either sign, concentrated in few places, without tuning.

Cells on gels and sticking pads pull as well as push, so the sign cannot show where traction ends; but traction is
still concentrated. Each component is Gaussian with the covariance

    cov(t(a), t(b)) = sqrt(v(a) v(b)) exp(-|a - b|^2 / 2 l^2),

with a local variance v: the square of Tikhonov's traction, averaged over about l. (This is one step of sparse Bayesian
learning, M. E. Tipping, J. Mach. Learn. Res. 1, 2001, 211-244, in which neighbours share their variance; more steps
would use the readings again and fit noise.) Cells of low variance are left out, so that a few hundred unknowns remain.
Lengths l from half a taxel pitch upwards are weighted by their marginal likelihood, which separates sharp patches from
smooth ones. The result is the weighted mean, and the spread is part of its error. Nuisances
(`palpate.sensing.nuisance`) are unknowns beside the traction: because traction ends somewhere, a drift of the image
can be separated from a net force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, to_numpy
from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.inverse.contact.edges import outside_taxels
from palpate.inverse.contact.places import Data, Member, Places, Start
from palpate.inverse.estimate import Errors, Estimate, Stated, among_frames, batch_of, frames_of
from palpate.inverse.fit import MODEL_DETAIL, POOR_FIT, misfit_probability, neighbours, rms, unfitted
from palpate.inverse.linear.matrix_free.path import Linear
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.parameter import TINY, tikhonov
from palpate.inverse.linear.patterns import SURE
from palpate.inverse.linear.posterior import UNEXPLAINED, LinearErrors, center_rows, moment_rows
from palpate.inverse.linear.regularised import Regularised
from palpate.inverse.linear.solution import BLIND
from palpate.inverse.linear.spectrum import in_components
from palpate.inverse.linear.stated import InDoubt, deviations
from palpate.inverse.problem import Problem

__all__ = ["LocalEstimator"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: Nuisances assumed for displacements by default: an image shifts and rotates.
DRIFT = ("offset", "rotation")
#: Outliers: residuals beyond BROKEN standard deviations and beyond DETAIL of the largest reading, at most MOST_BROKEN
#: of all readings, in at most ROUNDS_OF_BROKEN rounds.
BROKEN, DETAIL, MOST_BROKEN, ROUNDS_OF_BROKEN = 6.0, 0.03, 0.05, 3
#: A neighbour with a residual of the same sign and at least this fraction of the limit shows real traction, not an
#: outlier.
ALIKE = 0.3
#: If the shortest length fits best, patches may be narrower than the marker spacing: relative error of traction in
#: their cells, whatever the noise.
UNRESOLVED = 0.2
#: Relative error of the net force that no pad and no grid can beat.
MODEL_FORCE = 5e-4


class LocalEstimator:
    """The method, prepared for a problem: Tikhonov's method as its start, and the columns of the operator."""

    def __init__(self, problem: Problem, linear: Linear, *, draws: int = 0) -> None:
        self.problem, self.draws = problem, draws
        self.grid, self.columns, self.operator = linear.grid, problem.columns, problem.operator
        self.alone = linear.linear if isinstance(linear, InDoubt) else linear
        #: Tikhonov's method with all its errors, for frames in which traction is not concentrated.
        self.even: Linear = InDoubt(self.alone, problem, problem.doubts) if problem.doubts.any else self.alone
        image = all(find_channel(c).kind.absolute for a in self.operator.planes_of for c in a.channels)
        drift = problem.nuisance is None and image
        if drift:
            # Traction that ends somewhere can be separated from a drift of the image.
            if isinstance(self.alone, Regularised):
                self.alone = Regularised(self.alone.decomposition, tikhonov, "evidence", nuisance=DRIFT)
            else:
                self.alone = MatrixFree(self.alone.system, "evidence", nuisance=DRIFT)
        self.doubts = InDoubt(self.alone, problem, problem.doubts) if problem.doubts.any else None
        self.places = Places(problem, self.alone, applied=self.doubts is not None)
        self.readings, self.patterns = self.places.readings, self.places.patterns
        self.outside = outside_taxels(self.operator)
        self.pairs = neighbours(self.operator.planes_of)

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane; every frame is decided alone."""
        batch, rng = batch_of(readings, self.operator), rng or np.random.default_rng(0)
        frames: list[Frame | None] = []
        for planes in frames_of(readings, self.operator):
            # Solve each frame separately, because a batch has different rounding errors.
            start = self._starts(self.alone.solve([p[None] for p in planes]))[0]
            data = Data(planes, self.places.white(self.readings.flat(planes)[None])[0], self.places.every, start)
            frame = self._solved(data, rng)
            if frame is not None and (np.abs(frame.sizes) > SURE * frame.deviations).any():
                # The even penalty explained part of the drift by traction. Subtract the drift and solve again.
                data = replace(data, start=self._mended(data, frame))
                frame = self._solved(data, rng)
            for _ in range(ROUNDS_OF_BROKEN):
                broken = self._broken(frame, data)
                if frame is None or not broken.any():
                    break
                data = replace(data, observed=data.observed & ~broken)
                data = replace(data, start=self._mended(data, frame))
                frame = self._solved(data, rng)
            # A model that fits every reading exactly has no information on its errors.
            frames.append(frame if frame is not None and frame.told > UNEXPLAINED else None)
        # Compute errors due to the pad only if Tikhonov's method answers some frame.
        found = (self.even if any(f is None for f in frames) else self.alone).solve(readings)
        return self._gathered(replace(found, said=self._said(found, readings, batch, frames)), batch, frames)

    def _starts(self, found: Estimate) -> list[Start]:
        """Traction, noise and parameter of each frame from Tikhonov's method."""
        traction = to_numpy(found.traction).astype(np.float64).reshape(-1, len(self.grid.components), *self.grid.shape)
        noise, chosen = (np.ravel(np.asarray(v, dtype=np.float64)) for v in (found.noise_scale, found.parameter))
        return [Start(t[list(self.columns)], float(n) ** 2, float(p)) for t, n, p in zip(traction, noise, chosen)]

    def _mended(self, data: Data, frame: Frame) -> Start:
        """Repeat the start without the nuisances that were found, and with predicted values for outliers."""
        flat, lost = self.readings.flat(data.planes), ~data.observed
        flat[lost] -= (frame.left * self.readings.std)[lost]
        for pattern, size in zip(self.patterns, frame.sizes):
            flat -= size * pattern.rows
        return self._starts(self.alone.solve([p[None] for p in self.readings.planes(flat)]))[0]

    def _solved(self, data: Data, rng: np.random.Generator) -> Frame | None:
        """Result of one frame; None if its traction is not concentrated, or if there is none."""
        members = self.places.members(data)
        if not members:
            return None
        frame = self._frame(data, members, rng)
        if frame.fit < POOR_FIT and frame.shared > 1.0 and not self.places.known:
            # Noise that is correlated between neighbours is larger at the wavelengths of traction.
            again = self.places.members(
                replace(data, start=replace(data.start, noise=frame.noise**2 * frame.shared)), told=True
            )
            frame = self._frame(data, again, rng, shared=frame.shared) if again else frame
        return frame

    def _broken(self, frame: Frame | None, data: Data) -> Flags:
        """Mask of outliers: few residuals too large for noise. Only for independent readings."""
        none = np.zeros(len(data.y), dtype=bool)
        if frame is None or not self.readings.independent:
            return none
        usual = 1.4826 * float(np.median(np.abs(frame.left[data.observed])))
        largest = float(np.quantile(np.abs(data.y), 1.0 - MOST_BROKEN))
        off = np.abs(frame.left) * data.observed
        # The largest first: they distort the traction and so may cause the other residuals.
        limit = max(math.hypot(BROKEN * usual, DETAIL * largest), 0.5 * float(off.max()))
        broken = off > limit
        # An outlier stands alone. Neighbours with residuals of the same sign are traction that no cell covers.
        i, j = self.pairs
        alike = (frame.left[i] * frame.left[j] > 0) & (np.minimum(off[i], off[j]) > ALIKE * limit)
        broken[i[alike]] = broken[j[alike]] = False
        return broken if broken.sum() + (~data.observed).sum() <= MOST_BROKEN * len(data.y) else none

    # -- one frame

    def _frame(self, data: Data, members: list[Member], rng: np.random.Generator, shared: float = 1.0) -> Frame:
        """Weighted mean of the models of a frame, with errors, fit and nuisances."""
        weights = np.array([m.weight for m in members])
        traction = np.tensordot(weights, np.stack([m.traction for m in members]), 1)
        whole = self._everywhere(traction)
        stated = None
        if self.doubts is not None:
            directions = self.doubts.directions(data.planes, whole, lambda rows: self._again(members, rows))
            stated = deviations(directions, whole, self.grid)
        noise = float(weights @ [m.noise for m in members])
        left = weights @ np.stack([m.left for m in members])
        seen = left * data.observed
        mean = weights @ np.stack([m.sizes for m in members])
        spread = weights @ np.stack([m.spread + (m.sizes - mean) ** 2 for m in members])
        return Frame(
            traction=whole,
            errors=self._errors(members, weights, whole),
            stated=stated,
            noise=math.sqrt(noise / shared),
            told=1.0 - float(weights @ [m.taken for m in members]) / len(self.readings.std),
            shared=self._shared(seen) if shared == 1.0 else shared,
            fit=self._fit(data, seen, members, weights, whole, noise / shared),
            residual=rms(left[data.observed]) * math.sqrt(shared / max(noise, TINY)),
            left=left,
            broken=~data.observed,
            sizes=mean * self.places.units,
            deviations=np.sqrt(spread) * self.places.units,
            draws=self._drawn(members, weights, rng) if self.draws else None,
        )

    def _everywhere(self, sought: Floats, fill: float = 0.0) -> Floats:
        """Expand fields (..., component sought, *surface) to all components of the surface."""
        return np.asarray(in_components(sought, self.columns, len(self.grid.components), self.grid.dimensions, fill))

    def _again(self, members: list[Member], rows: list[Floats]) -> Floats:
        """Traction (row, component, *surface) that the models estimate from other readings (row, channel, *array) per
        plane.
        """
        count = len(rows[0])
        white = self.places.white(np.stack([self.readings.flat([r[i] for r in rows]) for i in range(count)]))
        out = np.zeros((count, len(self.columns), math.prod(self.grid.shape)))
        for m in members:
            out[:, :, m.cells] += m.weight * (white @ m.apply.T).reshape(count, len(self.columns), -1)
        return self._everywhere(out.reshape(count, len(self.columns), *self.grid.shape))

    def _fit(
        self, data: Data, left: Floats, members: list[Member], weights: Floats, whole: Floats, noise: float
    ) -> float:
        """Misfit probability of the residual ``left`` (`palpate.inverse.fit`)."""
        taken = float(weights @ [m.taken for m in members])
        columns, _ = self.problem.doubtful(self.problem.doubts, whole)
        if columns.shape[1]:
            # A residual that an inexactly known pad would cause is no misfit.
            rows = self.places.white(columns.T).T * data.observed[:, None]
            left = unfitted(left, rows)
            taken += columns.shape[1]
        detail = math.hypot(MODEL_DETAIL, self.problem.doubts.stated_gain) * float(
            np.abs(data.y[data.observed]).max(initial=0.0)
        )
        size = math.sqrt(noise)
        return misfit_probability(
            left / size, data.observed, self.pairs, taken=taken, known=self.places.known, detail=detail / size
        )

    def _shared(self, left: Floats) -> float:
        """Sum of the correlations of the residual between a taxel and its neighbours; 1 if the residual is white."""
        i, j = self.pairs
        if not len(i):
            return 1.0
        beside = 2.0 * len(i) / len(left)
        return max(1.0 + beside * float(np.mean(left[i] * left[j]) / np.mean(left**2)), 1.0)

    def _errors(self, members: list[Member], weights: Floats, whole: Floats) -> Errors:
        """Standard deviations of a frame: errors of each model, and the spread between models."""
        grid, c = self.grid, len(self.columns)
        pressure = whole[-1]
        presses = self.columns[-1] == len(grid.components) - 1
        force, axes = grid.force_rows(self.columns), list(grid.force_axes(self.columns))
        moment = moment_rows(grid)[:, list(self.columns)]
        center = np.zeros((grid.dimensions, c, *grid.shape))
        top = np.zeros((1, c, *grid.shape))
        if presses:
            center[:, -1] = center_rows(grid, pressure)
            top[0, -1].ravel()[int(pressure.argmax())] = 1.0
        sums = np.concatenate([force, moment, center, top]).reshape(-1, c, math.prod(grid.shape))
        mean = np.tensordot(sums, whole[list(self.columns)].reshape(c, -1), ([1, 2], [0, 1]))
        variance = np.zeros(len(sums))
        cells, told = np.zeros((c, math.prod(grid.shape))), np.full((c, math.prod(grid.shape)), math.nan)
        sought = whole[list(self.columns)]
        for w, m in zip(weights, members):
            here = sums[:, :, m.cells].reshape(len(sums), -1) @ m.root.T
            here = here + np.tensordot(sums, m.around.reshape(-1, *sums.shape[1:]), ([1, 2], [1, 2])) @ m.around_root.T
            value = np.tensordot(sums, m.traction.reshape(c, -1), ([1, 2], [0, 1]))
            variance += w * ((here**2).sum(axis=1) + (value - mean) ** 2)
            each = m.beyond.reshape(c, -1) + (m.traction - sought).reshape(c, -1) ** 2
            each[:, m.cells] += m.variance.reshape(c, -1)
            if m.length == self.places.lengths[0]:
                each += (UNRESOLVED * m.traction.reshape(c, -1)) ** 2
            cells += w * each
            if w == weights.max():
                told[:, m.cells] = np.clip(1.0 - m.variance.reshape(c, -1) / m.prior, 0.0, 1.0)
        std = np.sqrt(variance)
        split = np.split(std, np.cumsum([len(force), len(moment), grid.dimensions]))
        total = np.zeros(len(grid.components))
        total[axes] = np.hypot(split[0], MODEL_FORCE * np.abs(mean[: len(force)]))
        nothing = not presses or not pressure.max() > 0
        places = np.meshgrid(*grid.axes, indexing="ij")[::-1]
        return Errors(
            traction=self._everywhere(np.sqrt(cells).reshape(c, *grid.shape)),
            force=total,
            moment=split[1],
            center=np.full(grid.dimensions, math.nan) if nothing else split[2],
            peak=np.asarray(math.nan if not presses else split[3][0]),
            variance_reduction=self._everywhere(told.reshape(c, *grid.shape), math.nan),
            outside_traction=np.abs(whole) * self.outside,
            outside_force=np.abs(grid.total_force(whole * self.outside)),
            outside_moment=np.abs(np.tensordot(moment_rows(grid), whole * self.outside, grid.dimensions + 1)),
            outside_center=np.abs(
                np.zeros(len(places))
                if nothing
                else (center_rows(grid, pressure) * pressure * self.outside).reshape(len(places), -1).sum(axis=1)
            ),
            beyond_force=np.zeros(len(grid.components)),
            outside_peak=np.asarray((np.abs(pressure) * self.outside).ravel()[int(pressure.argmax())]),
        )

    def _drawn(self, members: list[Member], weights: Floats, rng: np.random.Generator) -> Floats:
        """Samples of the posterior (draw, component, *surface)."""
        out = np.zeros((self.draws, len(self.columns), math.prod(self.grid.shape)))
        for i, pick in enumerate(rng.choice(len(members), size=self.draws, p=weights)):
            m = members[pick]
            turn = rng.standard_normal(len(m.root))
            alone = np.sqrt(m.beyond) * rng.standard_normal(m.beyond.shape)
            out[i] = (m.traction + alone + np.tensordot(turn @ m.around_root, m.around, 1)).reshape(out[i].shape)
            out[i][:, m.cells] += (turn @ m.root).reshape(len(self.columns), -1)
        return self._everywhere(out.reshape(self.draws, len(self.columns), *self.grid.shape))

    # -- the batch

    def _gathered(self, found: Estimate, batch: tuple[int, ...], frames: Sequence[Frame | None]) -> Estimate:
        """One estimate for all frames; Tikhonov's result for frames without a model."""

        def joined(parts: Sequence[Any]) -> Any:
            values = np.stack([np.asarray(p) for p in parts])
            return values.reshape((*batch, *values.shape[1:]))

        given = to_numpy(found.traction).reshape(-1, len(self.grid.components), *self.grid.shape)
        traction = joined([g if f is None else f.traction for f, g in zip(frames, given)])
        there = np.array([f is not None for f in frames])
        scale = np.array(
            [f.noise if f else s for f, s in zip(frames, np.ravel(np.asarray(found.noise_scale, dtype=np.float64)))]
        )
        residual = np.array(
            [f.residual if f else r for f, r in zip(frames, np.ravel(np.asarray(found.residual, dtype=np.float64)))]
        )
        errors = [f.errors if f else _errors_of(found.errors, batch, i) for i, f in enumerate(frames)]
        stated = None
        if self.doubts is not None:
            parts = [f.stated if f else _picked(found.stated, batch, i) for i, f in enumerate(frames)]
            stated = Stated.gathered(parts, joined)
        draws = None
        if self.draws:
            empty = np.full((self.draws, *given.shape[1:]), math.nan)
            draws = joined([f.draws if f else empty for f in frames])
        nothing = np.zeros(len(self.patterns))
        sizes, spread = [], []
        for f in frames:
            sure = nothing if f is None else np.abs(f.sizes) > SURE * f.deviations
            sizes.append(nothing if f is None else f.sizes * sure)
            spread.append(nothing if f is None else f.deviations * sure)
        return Estimate(
            from_numpy(traction.astype(given.dtype), found.traction),
            None,
            scale.reshape(batch),
            residual.reshape(batch),
            errors=Errors.gathered(errors, joined),
            stated=stated,
            draws=draws,
            outliers=joined([f.broken if f else np.zeros(len(self.places.every), dtype=bool) for f in frames]),
            nuisance=joined(sizes) if self.patterns else None,
            nuisance_std=joined(spread) if self.patterns else None,
            nuisance_names=tuple((p.label, p.unit) for p in self.patterns),
            converged=None if found.converged is None else found.converged | there.reshape(batch),
            fit=np.array([f.fit if f else math.nan for f in frames]).reshape(batch),
            noise_std=scale.reshape(batch)[..., None] * np.concatenate(self.alone.scales),
            method=np.where(there, "local", "tikhonov").reshape(batch),
            said=found.said,
        )

    def _said(
        self, found: Estimate, readings: Sequence[Any], batch: tuple[int, ...], frames: Sequence[Frame | None]
    ) -> tuple[str, ...]:
        """Notes of the batch: drift from the local models, everything else from Tikhonov's method, on its own frames if it answers any."""
        said, there = list(found.said), np.array([f is not None for f in frames])
        if there.any() and not there.all():
            rows = [to_numpy(r).reshape(-1, *r.shape[len(batch) :])[~there] for r in readings]
            said = [among_frames(note, len(there)) for note in self.even.solve(rows).said]
        if there.all():
            # The local models report these nuisances frame by frame.
            said = [s for s in said if not s.startswith((BLIND, *(p.label for p in self.patterns)))]
        if not there.all():
            some = f" in {int((~there).sum())} of {len(there)} frames" if batch else ""
            said.append(
                f'traction acts in too many places or in none, or cannot be separated from noise{some}: method="tikhonov" was used there'
            )
        return tuple(said)


@dataclass
class Frame:
    """Result of one frame."""

    traction: Floats
    errors: Errors
    stated: Stated | None
    noise: float
    told: float
    shared: float
    fit: float
    residual: float
    left: Floats
    broken: Flags
    sizes: Floats
    deviations: Floats
    draws: Floats | None


def _picked(errors: Any, batch: tuple[int, ...], i: int) -> Any:
    """One frame ``i`` of `Errors` or `Stated`."""
    place = np.unravel_index(i, batch) if batch else ()
    kind = Stated if isinstance(errors, Stated) else Errors
    return kind(**{x.name: np.asarray(getattr(errors, x.name))[place] for x in fields(kind)})


def _errors_of(errors: Errors | None, batch: tuple[int, ...], i: int) -> Errors:
    """Tikhonov's errors of one frame, computed for this frame only."""
    if not isinstance(errors, LinearErrors):
        raise RuntimeError("a linear method works its errors out")
    place = np.unravel_index(i, batch) if batch else ()
    return _picked(errors.changed(lambda values: np.asarray(to_numpy(values))[place]), (), 0)
