"""Screen a frame before contact is sought: saturation, rounding, broken taxels.

A pad blurs, so neighbours nearly determine each reading. A reading that disagrees with its neighbours for any contact
is broken. Broken readings are found by leaving each out of a linear model of all readings (the mean-shift model of
outliers; R. D. Cook, S. Weisberg, Residuals and Influence in Regression, 1982, section 2.2.2), one at a time, worst
first. Screening precedes the search for contact, because one saturated converter looks like noise strong enough to hide any contact.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.score import gain_of
from palpate.inverse.fit import Pairs, rms
from palpate.inverse.linear.evidence import LinearEvidence, Marginal, linear_evidence, log_evidence
from palpate.inverse.linear.matrix_free.evidence import FrameAtSize
from palpate.inverse.linear.matrix_free.path import LinearModel
from palpate.inverse.linear.regularised import Decomposition
from palpate.inverse.linear.spectrum import in_components
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.operator import Operator

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
    "stuck",
]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Ceilings:
    """Saturated readings, and the rounding step of each reading (reading,), 0 if not rounded.

    ``upper``: the true reading is at least the value read. ``lower``: at most.
    """

    upper: Flags
    lower: Flags
    step: Floats

    @property
    def any(self) -> bool:
        """Whether any reading is saturated."""
        return bool(self.upper.any() or self.lower.any())


def ceilings(
    data: Floats,
    index: Index,
    pairs: Pairs,
    policy: Policy,
    given: tuple[Flags, Flags] | None = None,
) -> Ceilings:
    """Find saturated readings. ``index`` is the channel of each reading, ``pairs`` the pairs of neighbours; ``given``:
    readings at the given upper and lower limits.

    Saturation is detected if several neighbours of a channel read exactly its largest value. A single largest reading
    may be a peak, unless limits are given.
    """
    upper, lower = np.zeros(len(data), dtype=bool), np.zeros(len(data), dtype=bool)
    step = np.zeros(len(data))
    ends = np.searchsorted(index, np.arange(int(index[-1]) + 2))
    for a, b in itertools.pairwise(ends):
        values = data[a:b]
        size = float(np.abs(values).max(initial=0.0))
        if not np.ptp(values) > 1e-9 * size:  # equal but for rounding
            continue
        levels = np.unique(values)
        apart = np.diff(levels)
        smallest = float(apart[apart > 1e-9 * size].min(initial=math.inf))
        rounded = False
        if size / smallest <= policy.screening.steps and b - a >= policy.screening.rounded_from:
            steps = (levels - levels[0]) / smallest
            rounded = bool(np.abs(steps - np.round(steps)).max() < 1e-6 * max(1.0, float(steps.max())))
        if rounded:
            step[a:b] = smallest
        if not rounded and _symmetric(values, policy):
            continue
        fewest = policy.screening.at_end_rounded if rounded else policy.screening.at_end
        for flags, end in ((upper, levels[-1]), (lower, levels[0])):
            there = np.abs(values - end) <= 1e-12 * size
            # A limit on the other side of zero, or close to zero, is the reading of an unpressed taxel.
            outwards = end if flags is upper else -end
            far = outwards > policy.screening.near_zero * size
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
    index: Index,
    pairs: Pairs,
    policy: Policy,
) -> Flags:
    """Readings of exactly zero among neighbours with clear readings of one sign: dead taxels, or a dead band of the
    sensor. Neither says how much presses there; noise would have moved them.
    """
    zero = data == 0.0
    out = np.zeros(len(data), dtype=bool)
    if not zero.any() or zero.all():
        return out
    largest = np.zeros(int(index[-1]) + 1)
    np.maximum.at(largest, index, np.abs(data))
    total, count = np.zeros(len(data)), np.zeros(len(data))
    for i, j in (pairs, pairs[::-1]):
        np.add.at(total, i, data[j])
        np.add.at(count, i, 1.0)
    out[zero] = (np.abs(total) > policy.screening.dead * count * largest[index])[zero] & (count > 0)[zero]
    return out


def stuck(
    data: Floats,
    index: Index,
    pairs: Pairs,
    ends: Ceilings,
    policy: Policy,
) -> Flags:
    """Blocks of neighbours that read exactly the same, neither zero nor saturated: noise would have moved them.

    If a part p of the other pairs of neighbours is equal, e equal pairs of one block have the log odds e log(1/p), less
    the log of the number of readings. Rounded channels and channels without noise have equal neighbours anyway.
    """
    n, out = len(data), np.zeros(len(data), dtype=bool)
    alike = 1e-12 * float(np.abs(data).max(initial=0.0))  # a zero that was subtracted and added again rounds
    limited = ends.upper | ends.lower | (ends.step > 0.0) | (np.abs(data) <= alike)
    i, j = (side[~limited[pairs[0]] & ~limited[pairs[1]]] for side in pairs)
    same = np.abs(data[i] - data[j]) <= alike
    if not same.any():
        return out
    label = _connected(n, i[same], j[same])
    edges = np.bincount(label[i[same]], minlength=int(label.max()) + 1)
    others = (1.0 + same.sum() - edges) / (2.0 + len(same) - edges)
    part = np.bincount(label) / np.bincount(index)[index[np.unique(label, return_index=True)[1]]]
    found = (edges * np.log(1.0 / others) - math.log(n) > policy.detection.evidence) & (part <= policy.screening.most)
    out = found[label]
    for channel in np.unique(index[out]):
        if _symmetric(data[index == channel], policy):
            out &= index != channel
    return out


def loaded(
    wrong: Flags,
    data: Floats,
    explained: Floats,
    pairs: Pairs,
    policy: Policy,
) -> bool:
    """Whether several neighbouring residuals exceed the prediction in the same direction: a real load that the model
    lacks, such as a pull or another contact. Broken taxels are isolated or read too little.
    """
    more = wrong & (np.abs(data) > np.abs(explained))
    if more.sum() < policy.screening.neighbours:
        return False
    i, j = pairs
    joined = more[i] & more[j] & (np.sign((data - explained)[i]) == np.sign((data - explained)[j]))
    label = _connected(len(data), i[joined], j[joined])
    return bool(np.bincount(label[more]).max() >= policy.screening.neighbours)


def _connected(count: int, i: Index, j: Index) -> Index:
    """Number (reading,) of the block of each of ``count`` readings, if the pairs ``i``, ``j`` are connected."""
    import scipy.sparse
    import scipy.sparse.csgraph

    graph = scipy.sparse.coo_array((np.ones(len(i)), (i, j)), shape=(count, count))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1])


def _symmetric(values: Floats, policy: Policy) -> bool:
    """Whether most readings have an equal twin, as noise-free readings of a centred contact do. Equal largest values
    are then no sign of saturation.
    """
    size = float(np.abs(values).max())
    inner = np.sort(values[(values < values.max() - 1e-12 * size) & (values > values.min() + 1e-12 * size)])
    same = np.diff(inner) <= 1e-12 * size
    twin = np.append(same, False) | np.insert(same, 0, False)
    return bool(len(inner) >= policy.screening.fewest and twin.mean() > 0.5)


@dataclass(frozen=True)
class Screened:
    """Mask of broken readings, and the linear model's predictions for them."""

    broken: Flags
    explained: Floats


def _consistent(
    fitted: Callable[[float], tuple[LinearEvidence, float, float]], total: float, certain: bool, policy: Policy
) -> tuple[LinearEvidence, float, float]:
    """Go down with the noise to the first level that equals its residual. ``fitted`` takes a noise level and returns
    the model, the square of its residual and the degrees of freedom of that; ``certain``: the noise is given.
    """
    known = 1.0 if certain else policy.screening.first_noise * total
    for _ in range(policy.screening.rounds):
        found, misfit, free = fitted(known)
        left = math.sqrt(max(misfit, 0.0) / free)
        if left > known / policy.noise.again and (left < known * policy.noise.again or not certain):
            break
        if certain and left <= known:
            break
        known = max(left, 1e-6 * total, 1.0 if certain else 0.0)
    return found, left, free


def linear_noise(
    linear: Decomposition,
    rows: Sequence[Floats],
    total: float,
    policy: Policy,
    patterns: Floats | None = None,
    projected: Floats | None = None,
) -> tuple[LinearEvidence, float, float]:
    """The linear model with a noise level consistent with its residual; that level, in units of the whitening; and the
    degrees of freedom of the residual.
    """
    c = np.asarray(linear.spectrum.project(rows)) if projected is None else projected
    values, beside = linear.spectrum.eigenvalues, None
    if patterns is not None and len(patterns):
        beside = Marginal(values, c, patterns, linear.spectrum.tried)

    def fitted(known: float) -> tuple[LinearEvidence, float, float]:
        found = linear_evidence(linear, rows, None, known, beside, projected=c)
        w = found.parameter / (found.parameter + values)
        rest = w * (c if patterns is None else c - found.sizes @ patterns)
        return found, float((rest**2).sum()), max(float(w.sum()) - (0 if patterns is None else len(patterns)), 1.0)

    return _consistent(fitted, total, linear.noise_known, policy)


def noise_at_size(
    linear: FrameAtSize, rows: Sequence[Floats], total: float, policy: Policy, *, given: bool = True
) -> tuple[LinearEvidence, float, float]:
    """`linear_noise` for a matrix-free system; ``given`` is False to estimate a noise that was given."""
    certain = given and linear.linear.noise_known
    return _consistent(lambda known: linear.noise(rows, None, known), total, certain, policy)


def screened(
    linear: Decomposition,
    readings: Readings,
    data: Floats,
    observed: Flags,
    shifts: Floats,
    policy: Policy,
    patterns: Sequence[Floats] | None = None,
) -> Screened:
    """Broken readings of a frame. ``shifts`` (reading, pattern) are possible offsets, which must not count as broken
    readings. ``patterns`` are the same in the basis of the spectrum, if known.
    """
    return _Screening(linear, readings, data, shifts, policy).run(observed, patterns)


def outermost(linear: LinearModel) -> Flags:
    """Mask of the readings of the taxels at the array's edge (within half a pitch of it)."""
    parts = []
    for array in linear.operator.planes_of:
        points = array.points[array.valid.ravel()]
        low, high = array.points.min(axis=0), array.points.max(axis=0)
        near = np.zeros(len(points), dtype=bool)
        for axis, n in enumerate(
            array.shape if len(array.shape) == points.shape[1] else (len(points),) * points.shape[1]
        ):
            pitch = (high[axis] - low[axis]) / max(n - 1, 1)
            near |= (points[:, axis] - low[axis] <= 0.5 * pitch) | (high[axis] - points[:, axis] <= 0.5 * pitch)
        parts.append(np.tile(near, len(array.channels)))
    return np.concatenate(parts)


def shallow(arrays: Sequence[Any], policy: Policy) -> Flags:
    """Mask of the readings of taxels so shallow that loads on their neighbours hardly affect them."""
    each = [
        np.full(int(a.valid.sum()) * len(a.channels), a.depth < policy.screening.shallow * _pitch(a)) for a in arrays
    ]
    return np.concatenate(each)


def _pitch(array: Any) -> float:
    return float(np.ptp(array.points, axis=0).max()) / max(max(array.shape) - 1, 1)


def loads_above(
    operator: Operator, columns: Sequence[int], readings: Readings, place: int, policy: Policy
) -> list[Floats]:
    """Readings (reading,) of unit loads directly above the taxel of one reading, for each component sought, pressure
    last. A shallow taxel is affected almost only by loads above it and above its neighbours: it gets loads of three
    widths.
    """
    start = 0
    for array in operator.planes_of:
        n = int(array.valid.sum())
        if place < start + n * len(array.channels):
            point = array.points[array.valid.ravel()][(place - start) % n]
            break
        start += n * len(array.channels)
    pitch = _pitch(array)
    widths: tuple[float, ...] = (0.0,)
    if array.depth < policy.screening.shallow * pitch:
        widths = (0.5 * min(operator.surface.spacings), 0.5 * pitch, pitch)
    away = [np.abs(x - point[a]) for a, x in enumerate(operator.surface.axes)]
    away = [x - x.min() for x in away]
    load = np.zeros((len(widths) * len(columns), len(operator.surface.components), *operator.surface.shape))
    for w, width in enumerate(widths):
        inside = np.ix_(*[x <= width * (1.0 + 1e-9) + 1e-12 for x in away])
        for row, column in enumerate(columns):
            load[(w * len(columns) + row, column)][inside] = 1.0
    felt = operator.forward(load)
    return [readings.flat([p[i] for p in felt]) for i in range(len(load))]


class _Screening:
    """Search for broken readings in one frame.

    The noise is estimated even if it is given, because broken readings are judged relative to it.
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
        """A pattern of readings in the basis of the spectrum."""
        return np.asarray(self.linear.spectrum.project(self.readings.planes(values)))

    def singles(self, places: Sequence[int]) -> Floats:
        """Patterns of single readings, computed together because one product takes as long as many."""
        each = np.zeros((len(places), len(self.scaled)))
        each[np.arange(len(places)), list(places)] = self.readings.std[list(places)]
        planes = zip(*(self.readings.planes(values) for values in each))
        return np.asarray(self.linear.spectrum.project([np.stack(p) for p in planes]))

    def model(self, held: Sequence[Floats], total: float) -> tuple[LinearEvidence, float, float]:
        """The linear model with the patterns ``held``, its residual noise, and its remaining degrees of freedom."""
        patterns = np.stack(held) if held else None
        found, left, free = linear_noise(self.linear, self.rows, total, self.policy, patterns, self.coefficients)
        return found, max(left, self.least), free

    def _evidence(self, held: Sequence[Floats]) -> float:
        """Log evidence of the linear model with the given noise."""
        patterns = np.stack(held) if held else None
        found = linear_evidence(self.linear, self.rows, None, 1.0, patterns, projected=self.coefficients)
        return log_evidence(found.objective, found.logdet, found.freedom, 1.0)

    def run(self, observed: Flags, patterns: Sequence[Floats] | None) -> Screened:
        policy = self.policy
        n, scaled, spread = len(self.scaled), self.scaled, self.readings.std
        broken = np.zeros(n, dtype=bool)
        counted = int(observed.sum())
        total = rms(scaled[observed])
        if not total > 0.0 or len(self.shifts.T) + n - counted > n // 2 or counted < policy.screening.fewest:
            return Screened(broken, np.zeros(n))
        held = [self.pattern(column) for column in self.shifts.T] if patterns is None else list(patterns)
        held += list(self.singles([int(i) for i in np.flatnonzero(~observed)])) if counted < n else []
        found, left, _ = self.model(held, total)
        explained = _explained(self.linear, self.readings, found, self.shifts)
        for _ in range(max(int(policy.screening.most * n), 1)):
            there = observed & ~broken
            # A load beyond the array's edge affects only the outermost taxels, so that they count as broken only if
            # they read far too much.
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
                # Compare the size of all readings with and without this one: a reading ten times the others is broken,
                # even on the smallest array.
                gain = max(gain, gain_of(counted, rms(scaled[counts]), rms(scaled[other])))
            if self.known:
                gain = max(
                    gain, self._evidence([*held, column]) - self._evidence(held) - math.log(3.0 * np.abs(scaled).max())
                )
            far = size > policy.screening.deviations * rest
            if not (far and gain > policy.screening.broken + math.log(n)) or self._local(
                chosen,
                column,
                held,
                total,
                left,
                rest,
                more=abs(scaled[chosen]) > abs(explained[chosen]) / spread[chosen],
            ):
                break
            broken[chosen] = True
            held.append(column)
            found, left = after, rest
            explained = _explained(self.linear, self.readings, found, self.shifts)
        return Screened(broken, explained)

    def _worst(self, singles: Mapping[int, Floats], held: Sequence[Floats], parameter: float) -> tuple[int, float]:
        """Index of the reading among ``singles`` that deviates most from the prediction of the others, and its
        deviation in units of the whitening.
        """
        weight = parameter / (parameter + self.linear.spectrum.eigenvalues)
        c = self.coefficients
        b = np.reshape(held, (-1, len(c)))
        middle = np.linalg.pinv((b * weight) @ b.T)
        wc = weight * (c - b.T @ (middle @ (b @ (weight * c))))
        chosen, best, far = -1, 0.0, 0.0
        for i, e in singles.items():
            we = weight * e
            side = b @ we
            size = float(e @ we - side @ middle @ side)
            if size > 1e-9:
                reduction = float(e @ wc) ** 2 / size
                if reduction > best:
                    chosen, best, far = i, reduction, math.sqrt(reduction / size)
        return chosen, far

    def _local(
        self, place: int, column: Floats, held: Sequence[Floats], total: float, left: float, rest: float, *, more: bool
    ) -> bool:
        """Whether a load directly above the taxel would explain its reading: shallow taxels do not share loads with
        their neighbours. ``more``: the reading is larger than the model's prediction.
        """
        policy = self.policy
        loads = loads_above(self.linear.operator, self.linear.columns, self.readings, place, policy)
        columns = [self.pattern(values) for values in loads]
        useful = [c / size for c in columns if (size := float(np.linalg.norm(c))) > 0]
        loaded = self.model([*held, *useful], total)[1]
        explained = policy.screening.explained
        if loaded < policy.screening.nearly * rest and left**2 - loaded**2 > explained * (left**2 - rest**2):
            return True
        # With a given noise the linear model may leave nothing but that; then the evidence tells, of a reading that is
        # larger than predicted (a dead taxel under a contact reads too little).
        if not self.known or not more:
            return False
        before = self._evidence(held)
        gains = [self._evidence([*held, *patterns]) - before for patterns in (useful, [column])]
        return gains[0] > explained * gains[1]


def _explained(linear: Decomposition, readings: Readings, found: LinearEvidence, shifts: Floats) -> Floats:
    """Predictions of the linear model, offsets included, for every reading."""
    surface = linear.operator.surface
    full = in_components(found.traction, linear.columns, len(surface.components), surface.dimensions)
    return readings.flat(linear.operator.forward(full)) + shifts @ found.sizes[: shifts.shape[1]]
