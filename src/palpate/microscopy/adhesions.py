"""Estimate traction as a sum of adhesions: draw samples of them (`palpate.microscopy.sampler`) and evaluate the
samples on the grid of the field.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import scipy.ndimage
import scipy.sparse

from palpate.elastic.pad import Floats, Pad
from palpate.errors import Unsupported
from palpate.inverse.estimate import Errors, Estimate
from palpate.inverse.linear.posterior import center_rows, moment_rows
from palpate.inverse.method import Method, Needs
from palpate.inverse.problem import Problem
from palpate.microscopy.blobs import PROFILES, Response, painted, profiled, work_of
from palpate.microscopy.fields import Field
from palpate.microscopy.noise import INDEPENDENT_SHARE, Noise, shared_variance
from palpate.microscopy.sampler import MOST, SIZE, Chain, Places
from palpate.microscopy.vectors import Vectors, find_doubtful, first_guess, noise_of, outliers, vectors_of
from palpate.sensing.grids import Grid

__all__ = ["Adhesions", "Maps", "Sample", "sampled"]

Flags = npt.NDArray[np.bool_]

#: Number of Markov chains, steps of each before its first sample (burn-in), and steps between two samples. Doubling the
#: steps changes the energy by 2 % (benchmarks/cells.py).
CHAINS, BURN, BETWEEN = 3, 1200, 40
#: A chain starts with blobs at the maxima of the first guess, and then at those of the residual in further rounds.
#: Here: number of rounds, steps after each round, and most maxima that a round uses.
ROUNDS, SETTLE, MAXIMA = 3, 150, 30
#: As fractions of the largest squared traction of the first guess: maxima below FAINT start no blob; where it is above
#: STRONG, single vectors are used instead of means over tiles.
FAINT, STRONG = 0.02, 0.04
#: Smallest and middle standard deviation of blobs [m], about those of an adhesion of 1.4 um. Where the vectors lie too
#: far apart to resolve such blobs, the two limits in pitches apply instead. LARGEST is the largest size as a fraction
#: of the field.
LEAST, MIDDLE, LEAST_PITCHES, MIDDLE_PITCHES, LARGEST = 0.08e-6, 0.35e-6, 0.04, 0.25, 0.12
#: The prior density of blobs outside the mask, and outside the field of view, is this fraction of the density inside.
OUTSIDE = 0.05
#: The noise is taken as at least this fraction of the largest displacements, because no model of a gel is more accurate
#: than that.
MODEL = 1e-3
#: A vector whose residual is LEFT times the noise is an outlier. A vector that the median test excluded is used again
#: if its residual is below BACK times the noise.
LEFT, BACK = 5.0, 3.0
#: Expected fraction of outliers, and the number of vectors that this expectation is worth. The outliers far from
#: traction determine the fraction of a field.
WRONG, COUNTED = 0.05, 20.0
#: The blobs reproduce the modelled displacement to within this fraction.
DETAIL = 0.2
#: A field with more vectors than this along a side is averaged over tiles.
WIDEST = 160
#: Neighbouring vectors count as sharing noise if their residuals correlate by more than this.
SHARED = 0.1


@dataclass(frozen=True, eq=False)
class Sample:
    """One sample: blobs at ``places`` (blob, 2) [m] from the first vector, their ``variance`` (blob,) [m^2],
    ``forces`` (blob, 2) [N], and the index of each blob's profile in `PROFILES`; ``score`` is the derivative of the log
    prior with respect to the middle of the log sizes.
    """

    places: Floats
    variance: Floats
    forces: Floats
    profiles: npt.NDArray[np.intp] | None = None
    score: float = 0.0

    def on(self, x: Floats, y: Floats, side: float) -> Floats:
        """Mean traction (2, y, x) [Pa] over squares of side ``side`` [m] centred on columns ``x``, rows ``y`` [m]."""
        places, variance, forces = self.places, self.variance, self.forces
        if self.profiles is not None:
            places, variance, part, number = profiled(places, variance, self.profiles, side)
            forces = forces[number] * part[:, None]
        columns, rows = (scipy.sparse.csr_array(part) for part in painted(places, variance, x, y, side))
        count = np.diff(columns.indptr)
        out = np.empty((2, len(y), len(x)))
        for component, f in zip(out, forces.T):  # a blob lies on few of the squares
            weighted = scipy.sparse.csr_array(
                (columns.data * np.repeat(f, count), columns.indices, columns.indptr), columns.shape
            )
            component[:] = (rows.T @ weighted).toarray()
        return out / side**2

    def work(self, response: Response, shift: Floats) -> Floats:
        """Work of each blob (blob,) [J]: half its force times the displacement there, less ``shift`` (2,) [m]."""
        return np.asarray(work_of(self.places, self.variance, self.forces, response) - 0.5 * self.forces @ shift)

    def share(self, x: Floats, y: Floats, side: float, where: Flags) -> Floats:
        """Fraction of each blob (blob,) that lies on the squares of side ``side`` [m] that ``where`` (y, x) marks."""
        columns, rows = painted(self.places, self.variance, x, y, side)
        return np.asarray(((rows @ where) * columns).sum(axis=1))

    def moved(self, places: Floats, variance: float, response: Response) -> Floats:
        """Displacement (2, n) [m] of the gel at ``places`` (n, 2) [m], a mean over a square of ``variance`` [m^2]."""
        apart = places[:, None, :] - self.places[None, :, :]
        xx, xy, yy = response.tensor(apart[..., 0], apart[..., 1], self.variance[None, :] + variance)
        fx, fy = self.forces.T
        return np.stack([xx @ fx + xy @ fy, xy @ fx + yy @ fy])


@dataclass(frozen=True, eq=False)
class Sampled:
    """Result of the chains: ``samples``, standard deviation of the noise [m], excluded vectors, notes."""

    samples: list[Sample]
    response: Response
    noise: float
    excess: float
    left_out: Flags
    notes: tuple[str, ...]


def sampled(
    field: Field,
    pad: Pad,
    *,
    depth: float = 0.0,
    noise: float | None = None,
    likely: Flags | None = None,
    drift: bool = True,
    draws: int = 120,
    seed: int = 0,
) -> Sampled:
    """Draw samples of the adhesions that explain a field. ``likely`` (row, column) marks where adhesions are expected.
    Pass ``drift=False`` if the picture cannot have moved as a whole.

    ``noise`` [m] overrides the standard deviations that the field states (``Field.std``, which overlapping windows
    share). If neither is given, one standard deviation for all vectors is estimated.
    """
    ratio = math.ceil(max(field.shape) / WIDEST)
    if ratio > 1:
        thinned, tiles_expected = _thinned(field, ratio, likely)
        coarse = sampled(
            thinned,
            pad,
            depth=depth,
            noise=None if noise is None else noise / ratio,
            likely=tiles_expected,
            drift=drift,
            draws=draws,
            seed=seed,
        )
        first = 0.5 * (ratio - 1) * field.pitch
        out = np.zeros(field.shape, dtype=bool)
        rows, columns = (n * ratio for n in thinned.shape)
        out[:rows, :columns] = np.repeat(np.repeat(coarse.left_out, ratio, axis=0), ratio, axis=1)
        note = f"{field.shape[1]} x {field.shape[0]} vectors are more than the traction needs: means of {ratio} x {ratio} of them are solved"
        shifted = [replace(s, places=s.places + first) for s in coarse.samples]
        of_mean = 1.0 / ratio if noise is not None or field.std is None else math.sqrt(_of_mean(ratio, field))
        return replace(
            coarse,
            samples=shifted,
            noise=coarse.noise / of_mean,
            left_out=out & field.valid,
            notes=(note, *coarse.notes),
        )
    pitch, window, shape = field.pitch, field.aperture, field.shape
    least = max(LEAST, LEAST_PITCHES * pitch)
    reach = 2.0 * pitch * math.hypot(*shape)
    response = Response.of(pad, depth, least, reach)
    # work is done by the displacement of the surface, however deep the beads lie
    surface = response if depth == 0 else Response.of(pad, 0.0, least, reach)
    valid = field.valid
    u = field.displacement - (np.nanmedian(field.displacement, axis=(1, 2), keepdims=True) if drift else 0.0)
    stated = noise is None and field.std is not None and bool(np.isfinite(field.std).any())
    shape_of_noise, level = Noise.even(shape), noise or 0.0
    if stated:
        shape_of_noise, level = Noise.of(field.std, window if window > pitch else 0.0)
    elif not level:
        level = noise_of(u)
        # outliers inflate the estimate: 3 % of them by a factor of 1.4
        level = noise_of(np.where(outliers(u, level), np.nan, u))
    level = max(level, MODEL * float(np.nanquantile(np.abs(u), 0.99)), 1e-300)
    bad = outliers(u, level * shape_of_noise.relative) & valid
    # an adhesion finer than the spacing of vectors looks like an outlier: the chain samples which of the two it is
    doubtful = find_doubtful(u, bad, valid, level)
    outlier_share = np.zeros(shape)
    bad &= ~doubtful
    u = np.where(valid, u, 0.0)
    notes: list[str] = []
    guess, margin = first_guess(u, valid & ~bad & ~doubtful, response, pitch, window, level)
    power = scipy.ndimage.gaussian_filter((guess**2).sum(axis=0), 0.7)
    inner = tuple(slice(m, m + n) for m, n in zip(margin, shape))
    weight = np.full(power.shape, OUTSIDE)
    weight[inner] = 1.0 if likely is None else np.where(likely, 1.0, OUTSIDE)
    if likely is not None:  # a cell that reaches the edge of the field may continue beyond it
        weight = np.pad(weight[inner], [(m, n - m - k) for m, n, k in zip(margin, weight.shape, shape)], mode="edge")
    proposal = power * weight / max(float((power * weight).sum()), 1e-300) + weight / weight.sum()
    places = Places(weight / weight.sum() / pitch**2, proposal / proposal.sum() / pitch**2, margin, pitch)
    largest = LARGEST * pitch * min(shape)
    sizes = least, min(max(MIDDLE, MIDDLE_PITCHES * pitch), 0.9 * largest), max(largest, 2.0 * least)
    strong = (power > STRONG * power.max())[inner] if power.max() > 0 else np.zeros(shape, dtype=bool)
    every = _every(field)
    noise_known = noise is not None
    rough = level
    samples: list[Sample] = []
    noises = []
    # standard deviations that the field states are a lower limit of the noise
    chain = partial(
        Chain, response=response, places=places, sizes=sizes, least_noise=level if stated else 0.0, drift=drift
    )

    def odds() -> float:
        """Return the log prior odds that a vector near traction is an outlier."""
        wrong = WRONG * COUNTED + float(bad.sum())
        return math.log(wrong / (COUNTED + float((valid & ~doubtful).sum()) - wrong))

    def burnt_in(rng: np.random.Generator) -> Chain:
        """Start a chain with the present noise and outliers, past its burn-in."""
        vectors = vectors_of(u, valid & ~bad, pitch, window, strong, shape_of_noise, doubtful)
        start = chain(vectors, noise=level, known=noise_known, odds=odds(), rng=rng)
        walk = _start_blobs(start, u, valid & ~bad, guess, margin, every, window)
        walk.walk(BURN)
        return walk

    for number in range(CHAINS):
        rng, shapes = np.random.default_rng([seed, number]), np.random.default_rng([seed, number, 1])
        walk = burnt_in(rng)
        if number == 0:
            residual = u - walk.modelled(every, walk.forces()[0]).reshape(2, *shape)
            flagged = (
                _find_outliers(residual, u - residual, walk.noise * shape_of_noise.relative, bad, valid) & ~doubtful
            )
            correlation = 1.0 if noise is not None or stated else _shared(residual, valid & ~flagged)
            if correlation > 1.0:
                # noise that neighbours share is this much larger at the wavelengths of traction
                level, noise_known = walk.noise * math.sqrt(correlation), True
                notes.append(
                    f"neighbouring vectors share noise, as windows that overlap do: it counts {math.sqrt(correlation):.2g} times in traction"
                )
            if correlation > 1.0 or (flagged != bad).any():
                bad = flagged
                walk = burnt_in(rng)
        for _ in range(math.ceil(draws / CHAINS)):
            walk.walk(BETWEEN)
            # the data cannot tell the profile of an adhesion smaller than the window: draw one at random
            profiles = shapes.integers(len(PROFILES), size=len(walk.blobs))
            x, y, size, _ = walk.blobs.T
            score = float((size - walk.middle).sum()) / SIZE**2
            samples.append(Sample(np.stack([x, y], axis=1), np.exp(2 * size), walk.forces()[1], profiles, score))
            noises.append(walk.noise)
            outlier_share[doubtful] += walk.wrong / (CHAINS * math.ceil(draws / CHAINS))
    bad |= outlier_share > 0.5
    level = float(np.mean(noises))
    if bad.any():
        notes.append(
            f"{int(bad.sum())} of {int(valid.sum())} vectors are left out as outliers: neither noise nor traction explains them"
        )
    if max(len(s.forces) for s in samples) >= MOST:
        notes.append(
            f'the traction is in more than {MOST} places, or the gel is not as described: method="tikhonov" (--method tikhonov) suits traction that is everywhere'
        )
    return Sampled(samples, surface, level, level / rough, bad, tuple(notes))


def _thinned(field: Field, ratio: int, likely: Flags | None) -> tuple[Field, Flags | None]:
    """Average a field over tiles of ``ratio`` x ``ratio`` vectors; mark tiles that are mostly ``likely``."""
    rows, columns = (n // ratio for n in field.shape)

    def tiles(values: Any) -> Any:
        return values[..., : rows * ratio, : columns * ratio].reshape(*values.shape[:-2], rows, ratio, columns, ratio)

    valid = tiles(field.valid).mean(axis=(1, 3))
    u = tiles(np.nan_to_num(field.displacement)).mean(axis=(2, 4)) / np.where(valid > 0.5, valid, np.nan)
    side = math.sqrt(field.aperture**2 + (ratio**2 - 1) * field.pitch**2)
    std = None
    if field.std is not None:
        s = np.where(field.valid, np.nan_to_num(field.std), 0.0)
        error_of_mean = np.sqrt(
            tiles(s**2).sum(axis=(2, 4)) / np.maximum(tiles(field.valid * 1.0).sum(axis=(1, 3)), 1.0)
        )
        std = np.where(np.isfinite(u), error_of_mean * math.sqrt(_of_mean(ratio, field)), np.nan)
    few = Field(
        displacement=u,
        std=std,
        start=(field.start[0] + 0.5 * (ratio - 1) * field.step, field.start[1] + 0.5 * (ratio - 1) * field.step),
        step=ratio * field.step,
        pixel=field.pixel,
        aperture=side,
    )
    return few, None if likely is None else np.asarray(tiles(likely).mean(axis=(1, 3)) >= 0.5)


def _of_mean(ratio: int, field: Field) -> float:
    """Return the variance of the mean of ``ratio`` x ``ratio`` vectors, relative to the variance of one vector."""
    lags = field.pitch * np.subtract.outer(np.arange(ratio), np.arange(ratio)).ravel()
    shared = shared_variance(lags[:, None], lags[None, :], field.aperture if field.aperture > field.pitch else 0.0)
    return float(((1.0 - INDEPENDENT_SHARE) * shared.mean()) + INDEPENDENT_SHARE / ratio**2)


def _every(field: Field) -> Vectors:
    """Return all vectors of a field without averaging any."""
    rows, columns = field.shape
    x, y = np.meshgrid(field.pitch * np.arange(columns), field.pitch * np.arange(rows))
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    count = len(places)
    return Vectors(places, np.zeros((2, count)), np.full(count, field.aperture**2 / 12), np.ones(count), field.aperture)


def _start_blobs(
    walk: Chain, u: Floats, valid: Flags, guess: Floats, margin: tuple[int, int], every: Vectors, window: float
) -> Chain:
    """Place blobs at the maxima of the first guess, then at those of the residual, and return the chain."""
    pitch, rng = walk.places.pitch, walk.rng
    for number in range(ROUNDS):
        if number:
            residual = u - walk.modelled(every, walk.forces()[0]).reshape(u.shape)
            guess, margin = first_guess(residual, valid, walk.response, pitch, window, walk.noise)
        power = scipy.ndimage.gaussian_filter((guess**2).sum(axis=0), 0.7)
        if not power.max() > 0:
            break
        if not number:
            walk.level = 0.5 * math.log(float(power.max()))
        peaks = np.argwhere((power == scipy.ndimage.maximum_filter(power, 3)) & (power > FAINT * power.max()))
        for row, column in sorted(peaks.tolist(), key=lambda p: -float(power[p[0], p[1]]))[:MAXIMA]:
            around = guess[:, max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
            force = math.hypot(*around.sum(axis=(1, 2))) * pitch**2
            size = math.log(0.4 * pitch) + 0.3 * rng.standard_normal()
            x, y = (pitch * (n - m + 0.2 * rng.standard_normal()) for n, m in ((column, margin[1]), (row, margin[0])))
            size = min(max(size, walk.least + 0.01), walk.largest - 0.01)
            walk.put(np.array([x, y, size, math.log(max(force, 1e-300))]))
        walk.walk(SETTLE, count=False)
    walk.prune()
    return walk


def _find_outliers(residual: Floats, modelled: Floats, noise: Floats, bad: Flags, valid: Flags) -> Flags:
    """Vectors whose residuals mark them as outliers; ``DETAIL`` allows for what blobs do not describe exactly."""
    size = np.abs(residual).max(axis=0) / (noise + DETAIL / LEFT * np.hypot(*modelled))
    return np.asarray(valid & ((size > LEFT) | (bad & (size > BACK))))


def _shared(residual: Floats, valid: Flags) -> float:
    """Sum of the correlations of each residual with its neighbours' residuals; 1 if residuals are independent."""
    r = np.where(valid, residual, 0.0)
    power = float((r**2).sum()) / max(float(valid.sum()), 1.0)

    def of(rows: int, columns: int) -> float:
        first: Any = (slice(0, r.shape[1] - rows), slice(0, r.shape[2] - columns))
        second: Any = (slice(rows, None), slice(columns, None))
        pairs = float((valid[first] & valid[second]).sum())
        return (
            float((r[(slice(None), *first)] * r[(slice(None), *second)]).sum()) / max(pairs, 1.0) / max(power, 1e-300)
        )

    beside = 0.5 * (of(0, 1) + of(1, 0))
    if beside < SHARED:
        return 1.0
    return 1.0 + 4.0 * beside + 4.0 * max(of(1, 1), 0.0) + 2.0 * max(of(0, 2) + of(2, 0), 0.0)


@dataclass(frozen=True, eq=False)
class Maps:
    """Maps of the samples on a surface: ``mean`` and ``std`` (2, y, x) [Pa], standard deviations (3,) of the total
    ``force`` [N] and ``moment`` [N m], and each sample within the field of view, ``draws`` (draw, 2, row, column)
    [Pa].
    """

    mean: Floats
    std: Floats
    force: Floats
    moment: Floats
    draws: Floats

    @classmethod
    def of(cls, found: Sampled, field: Field, grid: Any) -> Maps:
        """Compute the maps. Each sample is evaluated once, and only its part in the field of view is stored."""
        rows, columns = field.shape
        first = [c - 0.5 * field.pitch * (n - 1) for c, n in zip(field.center, (columns, rows))]
        y, x = (axis - at for axis, at in zip(grid.axes, first[::-1]))
        view = tuple(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid.shape, field.shape))
        turn = moment_rows(grid)[:, :2]
        count = len(found.samples)
        total, squares = np.zeros((2, 2, *grid.shape))
        sums = np.empty((count, 5))
        draws = np.empty((count, 2, rows, columns))
        # subtract the first sample before summing, so that rounding does not hide a small spread
        origin = found.samples[0].on(x, y, float(grid.spacings[0]))
        for k, sample in enumerate(found.samples):
            one = sample.on(x, y, float(grid.spacings[0]))
            total += one - origin
            squares += (one - origin) ** 2
            sums[k, :2] = one.sum(axis=(1, 2)) * grid.cell
            sums[k, 2:] = np.tensordot(turn, one, ([1, 2, 3], [0, 1, 2]))
            draws[k] = one[(slice(None), *view)]
        variance = np.maximum(squares - total**2 / count, 0.0) / max(count - 1, 1)
        force = np.append(sums[:, :2].std(axis=0, ddof=1), 0.0)
        return cls(origin + total / count, np.sqrt(variance), force, sums[:, 2:].std(axis=0, ddof=1), draws)


@dataclass(frozen=True, kw_only=True)
class Adhesions(Method):
    """Makes samples look like a reconstruction method, so that the result is a `palpate.touch.Touch`."""

    name: ClassVar[str] = "adhesions"
    summary: ClassVar[str] = "adhesions, sampled"
    needs: ClassVar[Needs] = Needs(free_boundary=True)
    error_bars: ClassVar[bool] = True

    found: Sampled
    maps: Maps

    def prepare(self, problem: Problem) -> _Prepared:
        """Check the problem. There is nothing to prepare, because the samples exist already."""
        self.check(problem)
        return _Prepared(problem, self.found, self.maps)


class _Prepared:
    """Evaluates the samples on the surface of a problem."""

    def __init__(self, problem: Problem, found: Sampled, maps: Maps) -> None:
        self.problem, self.found, self.maps = problem, found, maps
        self.grid: Grid = problem.surface
        self.notes: tuple[str, ...] = ()

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Return the estimate of the one frame that was sampled."""
        grid: Any = self.grid
        if np.ndim(readings[0]) != 3:
            raise Unsupported("one frame was sampled, and this is a batch.")
        traction, error = np.zeros((2, 3, *grid.shape))
        traction[:2], error[:2] = self.maps.mean, self.maps.std
        nothing = np.zeros(3)
        center = np.full(len(center_rows(grid, traction[2] + 1.0)), math.nan)
        errors = Errors(
            traction=error, force=self.maps.force, moment=self.maps.moment, center=center, peak=np.asarray(math.nan), variance_reduction=np.full(traction.shape, math.nan),
            outside_traction=np.zeros_like(traction), outside_force=nothing, outside_moment=nothing, outside_center=np.zeros(len(center)), outside_peak=np.asarray(0.0), beyond_force=nothing,
        )  # fmt: skip
        noise = np.asarray(self.found.noise)
        return Estimate(
            traction,
            None,
            noise,
            np.asarray(self.found.excess),
            errors=errors,
            converged=np.asarray(True),
            noise_std=np.full(2, self.found.noise),
        )
