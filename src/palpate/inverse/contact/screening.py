"""What is said of a frame before any contact is sought: readings at a ceiling, rounding, broken taxels.

A pad blurs: what one taxel reads its neighbours nearly tell. A reading that they do not tell, whatever the contact, is broken: it is found by
leaving it out of a linear model of all readings (the mean-shift model of outliers; R. D. Cook, S. Weisberg, Residuals and Influence
in Regression, 1982, section 2.2.2), one at a time, the worst first. This comes before contact is sought, because one railed converter
looks like noise that hides everything.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.score import gain_of
from palpate.inverse.linear.evidence import LinearEvidence, linear_evidence, log_evidence
from palpate.inverse.linear.matrix_free.evidence import FrameAtSize
from palpate.inverse.linear.matrix_free.path import LinearModel
from palpate.inverse.linear.regularised import Decomposition
from palpate.inverse.linear.whitening import Readings

__all__ = [
    "Ceilings",
    "Screened",
    "ceilings",
    "linear_noise",
    "noise_at_size",
    "outermost",
    "screened",
    "shallow",
    "silent",
]

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Ceilings:
    """Readings at the end of their range, and the step that readings are rounded to (reading,), 0 where they are not.

    ``upper`` and ``lower``: the true reading is at least, or at most, what is read.
    """

    upper: Flags
    lower: Flags
    step: Floats

    @property
    def any(self) -> bool:
        """Whether some reading lies at an end."""
        return bool(self.upper.any() or self.lower.any())


def ceilings(
    data: Floats,
    index: npt.NDArray[np.intp],
    pairs: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
    policy: Policy,
    given: tuple[Flags, Flags] | None = None,
) -> Ceilings:
    """Of readings, ``index`` being the channel of each and ``pairs`` those that are neighbours; ``given``: those at a high and at a low end that is given.

    A frame shows its ceiling where several neighbours of a channel read exactly its largest reading; a single one cannot be told from a
    peak, but for an end that is given.
    """
    upper, lower = np.zeros(len(data), dtype=bool), np.zeros(len(data), dtype=bool)
    step = np.zeros(len(data))
    ends = np.searchsorted(index, np.arange(int(index[-1]) + 2))
    for a, b in itertools.pairwise(ends):
        values = data[a:b]
        size = float(np.abs(values).max(initial=0.0))
        if size == 0.0 or np.ptp(values) == 0.0:
            continue
        levels = np.unique(values)
        apart = np.diff(levels)
        smallest = float(apart[apart > 1e-9 * size].min(initial=math.inf))
        rounded = False
        if size / smallest <= policy.screening.steps and b - a >= 8:
            steps = (levels - levels[0]) / smallest
            rounded = bool(np.abs(steps - np.round(steps)).max() < 1e-6 * max(1.0, float(steps.max())))
        if rounded:
            step[a:b] = smallest
        if not rounded and _symmetric(values, size, policy):
            continue
        fewest = policy.screening.at_end_rounded if rounded else policy.screening.at_end
        for flags, end in ((upper, levels[-1]), (lower, levels[0])):
            there = np.abs(values - end) <= 1e-12 * size
            # an end on the other side of zero, or of next to nothing, is where nothing presses
            far = end > 0.05 * size if flags is upper else end < -0.05 * size
            if far and there.sum() >= fewest:
                flags[a:b] = there
    for flags in (upper, lower):
        beside = np.zeros(len(data), dtype=bool)
        both = flags[pairs[0]] & flags[pairs[1]]
        beside[pairs[0][both]] = beside[pairs[1][both]] = True
        flags &= beside
    if given is not None:
        upper, lower = upper | given[0], lower | given[1]
    return Ceilings(upper, lower, step)


def silent(
    data: Floats,
    index: npt.NDArray[np.intp],
    pairs: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
    policy: Policy,
) -> Flags:
    """Readings of exactly zero among neighbours that read as one: dead taxels, which noise would have moved. Zeros side by side are a sensor's
    threshold, below which it says nothing.
    """
    zero = data == 0.0
    out = np.zeros(len(data), dtype=bool)
    if not zero.any() or zero.all():
        return out
    largest = np.zeros(int(index[-1]) + 1)
    np.maximum.at(largest, index, np.abs(data))
    total, count, alike = np.zeros(len(data)), np.zeros(len(data)), np.zeros(len(data))
    for i, j in (pairs, pairs[::-1]):
        np.add.at(total, i, data[j])
        np.add.at(count, i, 1.0)
        np.add.at(alike, i, zero[j])
    out[zero] = (
        (np.abs(total) > policy.screening.dead * count * largest[index])[zero]
        & (alike <= policy.screening.dead_neighbours * count)[zero]
        & (count > 0)[zero]
    )
    # a channel most of which reads zero has a threshold, not dead taxels
    often = np.bincount(index, zero) > 0.5 * np.bincount(index)
    return out & ~often[index]


def loaded(
    wrong: Flags,
    data: Floats,
    explained: Floats,
    pairs: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
    policy: Policy,
) -> bool:
    """Whether several neighbours of those that are not explained read more than is explained, to the same side: something acts there that the
    model does not have, a pull or another contact. Broken taxels stand alone, or read too little.
    """
    more = wrong & (np.abs(data) > np.abs(explained))
    if more.sum() < policy.screening.neighbours:
        return False
    import scipy.sparse
    import scipy.sparse.csgraph

    i, j = pairs
    joined = more[i] & more[j] & (np.sign((data - explained)[i]) == np.sign((data - explained)[j]))
    n = len(data)
    graph = scipy.sparse.coo_array((np.ones(int(joined.sum())), (i[joined], j[joined])), shape=(n, n))
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    return bool(np.bincount(label[more]).max() >= policy.screening.neighbours)


def _symmetric(values: Floats, size: float, policy: Policy) -> bool:
    """Whether most readings between the ends have a twin, as those made without noise for a contact in the middle have: not a ceiling."""
    inner = np.sort(values[(values < values.max() - 1e-12 * size) & (values > values.min() + 1e-12 * size)])
    same = np.diff(inner) <= 1e-12 * size
    twin = np.append(same, False) | np.insert(same, 0, False)
    return bool(len(inner) >= policy.screening.fewest and twin.mean() > 0.5)


@dataclass(frozen=True)
class Screened:
    """Readings that no contact explains, and what the linear model says in their place."""

    broken: Flags
    explained: Floats


def linear_noise(
    linear: Decomposition,
    rows: Sequence[Floats],
    total: float,
    policy: Policy,
    patterns: Floats | None = None,
    projected: Floats | None = None,
) -> tuple[LinearEvidence, float, float]:
    """The linear model whose noise explains itself, that noise, and the degrees of freedom left; noise in units of the whitening."""
    c = np.asarray(linear.spectrum.project(rows)) if projected is None else projected
    values = linear.spectrum.eigenvalues
    known = 1.0 if linear.noise_known else policy.screening.first_noise * total
    for _ in range(policy.screening.rounds):
        found = linear_evidence(linear, rows, None, known, patterns, projected=c)
        w = found.parameter / (found.parameter + values)
        free = max(float(w.sum()) - (0 if patterns is None else len(patterns)), 1.0)
        left = math.sqrt(max(_misfit(linear, c, found, patterns), 0.0) / free)
        if left > known / policy.noise.again and (left < known * policy.noise.again or not linear.noise_known):
            break
        if linear.noise_known and left <= known:
            break
        known = max(left, 1e-6 * total, 1.0 if linear.noise_known else 0.0)
    return found, left, free


def noise_at_size(
    linear: FrameAtSize, rows: Sequence[Floats], total: float, policy: Policy
) -> tuple[LinearEvidence, float, float]:
    """`linear_noise` on a matrix-free system."""
    certain = linear.linear.noise_known
    known = 1.0 if certain else policy.screening.first_noise * total
    for _ in range(policy.screening.rounds):
        found, misfit, free = linear.noise(rows, None, known)
        left = math.sqrt(max(misfit, 0.0) / free)
        if left > known / policy.noise.again and (left < known * policy.noise.again or not certain):
            break
        if certain and left <= known:
            break
        known = max(left, 1e-6 * total, 1.0 if certain else 0.0)
    return found, left, free


def _misfit(linear: Decomposition, c: Floats, found: LinearEvidence, patterns: Floats | None) -> float:
    """Squared misfit of readings in the basis of the spectrum, in units of the whitening."""
    if patterns is not None:
        c = c - found.sizes @ patterns
    w = found.parameter / (found.parameter + linear.spectrum.eigenvalues)
    return float(((w * c) ** 2).sum())


def screened(
    linear: Decomposition,
    readings: Readings,
    data: Floats,
    observed: Flags,
    shifts: Floats,
    policy: Policy,
    patterns: Sequence[Floats] | None = None,
) -> Screened:
    """Broken readings of a frame; ``shifts`` (reading, pattern) are offsets that it may have besides, so that they break nothing; ``patterns`` are the same
    in the basis of the spectrum, where they are known.
    """
    return _Screening(linear, readings, data, shifts, policy).run(observed, patterns)


def outermost(linear: LinearModel) -> Flags:
    """Readings of taxels within `OUTERMOST` pitches of the array's edge."""
    parts = []
    for array in linear.operator.planes_of:
        points = array.points[array.valid.ravel()]
        low, high = array.points.min(axis=0), array.points.max(axis=0)
        near = np.zeros(len(points), dtype=bool)
        for axis, n in enumerate(
            array.shape if len(array.shape) == points.shape[1] else (len(points),) * points.shape[1]
        ):
            pitch = (high[axis] - low[axis]) / max(n - 1, 1)
            reach = pitch * (1.0 + 1e-9)
            near |= (points[:, axis] - low[axis] <= reach) | (high[axis] - points[:, axis] <= reach)
        parts.append(np.tile(near, len(array.channels)))
    return np.concatenate(parts)


def shallow(arrays: Sequence[Any], policy: Policy) -> Flags:
    """Readings of taxels that feel next to nothing of what their neighbours do."""
    each = [
        np.full(int(a.valid.sum()) * len(a.channels), a.depth < policy.screening.shallow * _pitch(a)) for a in arrays
    ]
    return np.concatenate(each)


def _pitch(array: Any) -> float:
    return float(np.ptp(array.points, axis=0).max()) / max(max(array.shape) - 1, 1)


class _Screening:
    """One frame's search for broken readings.

    Its noise is learned even where it was given, because what breaks the readings hides in it.
    """

    def __init__(self, linear: Decomposition, readings: Readings, data: Floats, shifts: Floats, policy: Policy) -> None:
        self.linear, self.readings, self.shifts = replace(linear, noise_known=False), readings, shifts
        self.policy = policy
        self.known, self.least = linear.noise_known, 1.0 if linear.noise_known else 0.0
        self.scaled = data / readings.std
        self.rows = readings.planes(data)
        self.coefficients = np.asarray(linear.spectrum.project(self.rows))
        self.outermost = outermost(linear)

    def pattern(self, values: Floats) -> Floats:
        """A pattern over the readings, in the basis of the spectrum."""
        return np.asarray(self.linear.spectrum.project(self.readings.planes(values)))

    def singles(self, places: Sequence[int]) -> Floats:
        """The patterns of some readings, each alone: together, as one product takes as long as another of many."""
        each = np.zeros((len(places), len(self.scaled)))
        each[np.arange(len(places)), list(places)] = self.readings.std[list(places)]
        planes = zip(*(self.readings.planes(values) for values in each))
        return np.asarray(self.linear.spectrum.project([np.stack(p) for p in planes]))

    def model(self, held: Sequence[Floats], total: float) -> tuple[LinearEvidence, float, float]:
        """The linear model with the patterns that are held, the noise that it leaves, and the freedom left."""
        patterns = np.stack(held) if held else None
        found, left, free = linear_noise(self.linear, self.rows, total, self.policy, patterns, self.coefficients)
        return found, max(left, self.least), free

    def _evidence(self, held: Sequence[Floats]) -> float:
        """Log evidence of the linear model with the noise that was given."""
        patterns = np.stack(held) if held else None
        found = linear_evidence(self.linear, self.rows, None, 1.0, patterns, projected=self.coefficients)
        return log_evidence(found.objective, found.logdet, found.freedom, 1.0)

    def run(self, observed: Flags, patterns: Sequence[Floats] | None) -> Screened:
        policy = self.policy
        n, scaled = len(self.scaled), self.scaled
        broken = np.zeros(n, dtype=bool)
        counted = int(observed.sum())
        total = math.sqrt(float(np.mean(scaled[observed] ** 2))) if counted else 0.0
        if not total > 0.0 or len(self.shifts.T) + n - counted > n // 2 or counted < policy.screening.fewest:
            return Screened(broken, np.zeros(n))
        held = [self.pattern(column) for column in self.shifts.T] if patterns is None else list(patterns)
        held += list(self.singles([int(i) for i in np.flatnonzero(~observed)])) if counted < n else []
        found, left, _ = self.model(held, total)
        explained = _explained(self.linear, self.readings, found, self.shifts)
        for _ in range(max(int(policy.screening.most * n), 1)):
            there = observed & ~broken
            # what presses beyond the array's edge is felt by the outermost taxels alone: they count as broken only if they read far too much
            others = np.where(there & ~self.outermost, np.abs(scaled), 0.0).max(initial=0.0)
            there &= ~self.outermost | (np.abs(scaled) > policy.screening.outermost * others)
            residual = np.where(there, np.abs(scaled - explained / self.readings.std), 0.0)
            places = list(np.argsort(residual)[::-1][: policy.screening.candidates])
            places.append(int(np.argmax(np.where(there, np.abs(scaled), 0.0))))
            singles = dict(zip((int(i) for i in places), self.singles(places)))
            chosen, size = self._worst(singles, held, found.parameter)
            if chosen < 0:
                break
            column = singles[chosen]
            after, rest, free = self.model([*held, column], total)
            gain = gain_of(free, left, rest)
            counts = observed & ~broken
            other = counts & (np.arange(n) != chosen)
            if abs(scaled[chosen]) > policy.screening.alone * float(np.abs(scaled[other]).max(initial=0.0)):
                # all readings' size with it and without: what is ten times the others is broken on the smallest array
                without = math.sqrt(float(np.mean(scaled[other] ** 2)))
                with_it = math.sqrt(float(np.mean(scaled[counts] ** 2)))
                gain = max(gain, gain_of(counted, with_it, without))
            if self.known:
                gain = max(
                    gain, self._evidence([*held, column]) - self._evidence(held) - math.log(3.0 * np.abs(scaled).max())
                )
            far = size > policy.screening.deviations * rest
            if not (far and gain > policy.screening.broken + math.log(n)) or self._local(
                chosen, held, total, left, rest
            ):
                break
            broken[chosen] = True
            held.append(column)
            found, left = after, rest
            explained = _explained(self.linear, self.readings, found, self.shifts)
        return Screened(broken, explained)

    def _worst(self, singles: Mapping[int, Floats], held: Sequence[Floats], parameter: float) -> tuple[int, float]:
        """The reading among ``singles`` that the others tell least, and how far it is from what they tell in units of the whitening."""
        weight = parameter / (parameter + self.linear.spectrum.eigenvalues)
        c = self.coefficients
        if held:
            b = np.stack(held)
            middle = np.linalg.pinv((b * weight) @ b.T)
            wc = weight * (c - b.T @ (middle @ (b @ (weight * c))))
        else:
            wc = weight * c
        chosen, best, far = -1, 0.0, 0.0
        for i, e in singles.items():
            we = weight * e
            size = float(e @ we)
            if held:
                side = b @ we
                size -= float(side @ middle @ side)
            if size > 1e-9:
                reduction = float(e @ wc) ** 2 / size
                if reduction > best:
                    chosen, best, far = i, reduction, math.sqrt(reduction / size)
        return chosen, far

    def _local(self, place: int, held: Sequence[Floats], total: float, left: float, rest: float) -> bool:
        """Whether a load right over a taxel says what its reading says: the taxel lies too near the surface for others to feel it."""
        policy = self.policy
        operator, start = self.linear.operator, 0
        for array in operator.planes_of:
            n = int(array.valid.sum())
            if place < start + n * len(array.channels):
                point = array.points[array.valid.ravel()][(place - start) % n]
                break
            start += n * len(array.channels)
        pitch = _pitch(array)
        # a taxel right under the surface feels little else than what lies over it and the next ones
        widths = (
            (0.5 * min(operator.surface.spacings), 0.5 * pitch, pitch)
            if array.depth < policy.screening.shallow * pitch
            else (0.0,)
        )
        away = [np.abs(x - point[a]) for a, x in enumerate(operator.surface.axes)]
        away = [x - x.min() for x in away]
        load = np.zeros(
            (len(widths) * len(self.linear.columns), len(operator.surface.components), *operator.surface.shape)
        )
        for w, width in enumerate(widths):
            inside = np.ix_(*[x <= width * (1.0 + 1e-9) + 1e-12 for x in away])
            for row, column in enumerate(self.linear.columns):
                load[(w * len(self.linear.columns) + row, column)][inside] = 1.0
        columns = [self.pattern(self.readings.flat([p[i] for p in operator.forward(load)])) for i in range(len(load))]
        useful = [c / size for c in columns if (size := float(np.linalg.norm(c))) > 0]
        loaded = self.model([*held, *useful], total)[1]
        return loaded < policy.screening.nearly * rest and left**2 - loaded**2 > policy.screening.explained * (
            left**2 - rest**2
        )


def _explained(linear: Decomposition, readings: Readings, found: LinearEvidence, shifts: Floats) -> Floats:
    """What the linear model, offsets included, says of every reading."""
    operator = linear.operator
    full = np.zeros((len(operator.surface.components), *operator.surface.shape))
    full[list(linear.columns)] = found.traction
    return readings.flat(operator.forward(full)) + shifts @ found.sizes[: shifts.shape[1]]
