"""What a frame is taken to be before it is solved: contact that pushes, that pulls, or both; with offsets of the readings or without.

Each hypothesis is solved roughly (one even penalty, cells of the surface) with the largest noise that explains itself, and is worth

    gain = free log(total/left),

where ``total`` is the root mean square of the readings, ``left`` that of what it leaves, and ``free`` how many readings remain when those
that the traction uses up are taken away: an account that bends to every reading leaves nothing and is worth nothing. Contact
leaves most of a surface empty, which is what tells an offset, which nothing on the surface is empty under, from contact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.inverse.contact.policy import Policy
from palpate.inverse.fit import FEWEST, misfit_probability
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.nuisance import Nuisance

if TYPE_CHECKING:
    from palpate.inverse.contact.constrained import ConstrainedEstimator

__all__ = [
    "Hypothesis",
    "Rough",
    "exceeded",
    "hypothesis_of",
    "reach_of_kind",
    "rough",
    "rough_fit",
    "without_outliers",
    "worth_of",
]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Rough:
    """A rough solution: its gain, the noise that it leaves, degrees of freedom left, traction (component, cell), loaded part of the ring."""

    gain: float
    left: float
    free: float
    traction: Floats
    explained: Floats
    ring: float


@dataclass(frozen=True)
class Hypothesis:
    """What a frame is taken to be.

    ``sign`` is 1 where contact pushes, -1 where it pulls, 0 where it does both; ``sizes`` are those of the nuisances (0: absent), ``present``
    says which are. ``rivals`` are the others with nuisances, the best first. ``noise`` is what contact in a few cells leaves, where the linear model takes the readings for noise (`palpate.inverse.contact.sharp`).
    """

    sign: int
    rough: Rough
    sizes: Floats
    present: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool))
    noise: float | None = None
    rivals: tuple[Hypothesis, ...] = ()


def rough(
    estimator: ConstrainedEstimator,
    data: Floats,
    observed: Flags,
    total: float,
    used: int = 0,
    noise_at_first: float | None = None,
    near: Floats | None = None,
    beat: float = -math.inf,
) -> Rough:
    """A rough solution of readings that push: the largest noise that explains itself, and is no more than ``noise_at_first``; ``used``
    degrees of freedom have gone to nuisances; ``near`` is that of `ConstrainedEstimator.fit`. Less noise is not tried where that gains
    less, and less than ``beat``.
    """
    policy = estimator.policy
    readings, certain = estimator.readings, estimator.noise_known
    floor = estimator.least_noise(data)
    known = 1.0 if certain else noise_at_first or policy.screening.first_noise * total
    filled = data.copy()
    linear = estimator.orders[1]
    cells = estimator.operator.surface.shape
    first: Floats = np.zeros((len(estimator.columns), math.prod(cells)))
    explained = np.zeros_like(data)
    left, free, gain = total, float(observed.sum() - used), -math.inf
    for turn in range(policy.screening.rounds):
        found = estimator.evidence(linear, readings.planes(filled), known)
        noise = readings.std * known
        first, explained = estimator.fit(
            found.traction, data / noise, noise, observed, found.parameter / found.scale**2, near
        )
        near = first
        misfit = readings.white(((data - explained) / readings.std)[observed], observed)
        share = min(float(np.count_nonzero(first[-1])) / estimator.taxels, 1.0)
        free = max(float(observed.sum()) - used - share * estimator.effective_freedom(found.parameter), 1.0)
        left = math.sqrt(float((misfit**2).sum()) / free)
        # what is left out is filled with what the contact explains
        filled = np.where(observed, data, explained)
        if left > known / policy.noise.again and (left < known * policy.noise.again or not certain):
            break
        if (certain and left <= known) or left <= floor:
            break
        before, gain = gain, free * math.log(total / max(left, floor, 1e-300))
        if (certain and turn >= 2) or gain < min(before, beat):
            break
        known = max(left, floor, 1.0 if certain else 0.0)
    gain = free * math.log(total / max(left, floor, 1e-300)) if total > 0 else 0.0
    return Rough(gain, left, free, first, explained, estimator.ring_load(first[-1]))


def _quiet_levels(values: Floats, points: Floats, scattered: bool) -> list[float]:
    """Levels of a channel where little happens: of the outermost taxels, on a line the end that reads less, and then either end: shear reaches
    far along a line, and of two ends that it takes in opposite directions the one that reads less is the farther off.
    """
    if points.shape[1] == 1:
        order = np.argsort(points[:, 0])
        k = max(1, min(2, len(values) // 6))
        ends = [float(values[order[:k]].mean()), float(values[order[-k:]].mean())]
        return [min(ends, key=abs), *ends]
    return [float(np.median(values[_outermost(points, scattered)]))]


def _outermost(points: Floats, scattered: bool) -> Flags:
    """Which taxels of an area lie at its edge."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.15 if scattered else 1e-6
    return np.asarray(np.any((points - low < margin * (high - low)) | (high - points < margin * (high - low)), axis=1))


def _touched(estimator: ConstrainedEstimator, term: Nuisance) -> tuple[Array, Index]:
    """The array that an offset is of, and the readings of its channel there."""
    first, start = int(np.argmax(term.rows != 0)), 0
    for array in estimator.operator.planes_of:
        n = int(array.valid.sum())
        for _ in array.channels:
            if first < start + n:
                return array, np.arange(start, start + n)
            start += n
    raise IndexError(first)


def quiet_levels(
    estimator: ConstrainedEstimator, data: Floats, observed: Flags, terms: Sequence[Nuisance]
) -> list[Floats]:
    """First sizes of offsets, from the outermost taxels, each to be tried; 0 for other nuisances."""
    starts = [np.zeros(len(terms)) for _ in range(3 if estimator.operator.surface.dimensions == 1 else 1)]
    for i, term in enumerate(terms):
        if term.kind != "offset":
            continue
        array, place = _touched(estimator, term)
        here = observed[place]
        if here.any():
            points = array.points[array.valid.ravel()][here]
            levels = _quiet_levels(data[place][here], points, isinstance(array, ScatteredArray))
            for start, level in zip(starts, levels):
                start[i] = level
    return [s for k, s in enumerate(starts) if not any(np.array_equal(s, before) for before in starts[:k])]


def lowest_levels(
    estimator: ConstrainedEstimator, data: Floats, observed: Flags, terms: Sequence[Nuisance], sign: int
) -> list[Floats]:
    """First sizes of offsets on a line whose contacts reach its ends, none or one: what neighbours between them read least, where contact of this sign
    makes none read less than nothing and the ends read more.
    """
    if estimator.far or estimator.operator.surface.dimensions > 1:
        return []
    start = np.zeros(len(terms))
    for i, term in enumerate(terms):
        if term.kind != "offset":
            continue
        array, place = _touched(estimator, term)
        here = observed[place]
        points = array.points[array.valid.ravel()][here]
        values = sign * data[place][here][np.argsort(points[:, 0])]
        width = 2 * max(1, min(2, len(values) // 6))
        if len(values) > 2 * width:
            least = float(np.convolve(values, np.full(width, 1.0 / width), mode="valid").min())
            ends = min(float(values[: width // 2].mean()), float(values[-(width // 2) :].mean()), 0.0)
            start[i] = sign * least if least < ends + estimator.policy.explanations.half * least else 0.0
    return [start] if start.any() else []


def edge_drift(estimator: ConstrainedEstimator, data: Floats, observed: Flags, terms: Sequence[Nuisance]) -> Floats:
    """First sizes of offsets and ramps together, from the outermost taxels by least absolute deviations, which a contact across a part of the edge hardly
    moves (weighed least squares in turn; E. J. Schlossmacher, J. American Statistical Association 68, 1973, 857-859); 0 for other nuisances.
    """
    sizes = np.zeros(len(terms))
    for offset in terms:
        if offset.kind != "offset":
            continue
        array, place = _touched(estimator, offset)
        points = array.points[array.valid.ravel()]
        if points.shape[1] == 1:
            k = max(1, min(2, len(points) // 6))
            order = np.argsort(points[:, 0])
            edge = np.isin(np.arange(len(points)), [*order[:k], *order[-k:]])
        else:
            edge = _outermost(points, isinstance(array, ScatteredArray))
        edge &= observed[place]
        of = [j for j, t in enumerate(terms) if t.kind in ("offset", "ramp") and t.rows[place].any()]
        if edge.sum() < len(of):
            continue
        rows = np.stack([terms[j].rows[place][edge] for j in of], axis=1)
        scale = np.abs(rows).max(axis=0)
        y = data[place][edge]
        weight = np.ones(len(y))
        for _ in range(estimator.policy.work.reweighed):
            found = np.linalg.lstsq(rows / scale * weight[:, None], y * weight, rcond=1e-9)[0]
            left = np.abs(y - rows / scale @ found)
            weight = 1.0 / np.sqrt(np.maximum(left, 1e-3 * max(float(np.abs(y).max()), 1e-300)))
        sizes[of] = found / scale
    return sizes


def with_nuisance(
    estimator: ConstrainedEstimator,
    data: Floats,
    observed: Flags,
    total: float,
    terms: Sequence[Nuisance],
    sign: int,
    start: Floats,
    noise_at_first: float | None = None,
    beat: float = -math.inf,
) -> tuple[Rough, Floats, Floats] | None:
    """The rough solution with the nuisances that are there, their sizes, and their standard deviations given the contact; None where it is as good as
    certain that its gain stays below ``beat``: rounds that go on as the best of them so far do not bring it there.

    Sizes and contact are found in turn: the sizes from what the contact leaves, by least squares. Where displacement is felt far away each
    turn goes only a quarter of the way: then most of the steps' geometric series is summed (A. C. Aitken, Proc. R. Soc. Edinburgh 46, 1926, 289-305).
    """
    policy = estimator.policy
    readings = estimator.readings
    columns = np.stack([term.rows for term in terms], axis=1)
    unit = np.sqrt((readings.white((columns / readings.std[:, None])[observed], observed) ** 2).sum(axis=0))
    sizes, present = start.copy(), np.ones(len(terms), dtype=bool)
    best: Rough | None = None
    deviation, last = np.zeros(len(terms)), np.zeros(len(terms))
    near: Floats | None = None
    step = 0.0
    for turn in range(policy.explanations.nuisance_rounds):
        clean = sign * (data - columns @ sizes)
        found = rough(estimator, clean, observed, total, int(present.sum()), noise_at_first, near, beat)
        near = found.traction
        deviation = np.maximum(found.left, estimator.least_noise(data)) / np.maximum(unit, 1e-300)
        if best is not None:
            if found.gain < best.gain:
                break
            step = max(step, found.gain - best.gain)
            if found.gain + (policy.explanations.nuisance_rounds - 1 - turn) * step < beat:
                return None
        best, kept = found, sizes.copy()
        left = sign * (clean - found.explained) / readings.std
        allowed = readings.allowing(columns[:, present])
        change = np.zeros(len(terms))
        change[present] = allowed.sizes_of(left, observed)
        ratio = np.divide(change, last, out=np.zeros_like(change), where=last != 0.0)
        slow = (ratio > policy.work.slow) & (ratio < 1.0)
        last = np.where(slow, 0.0, change)
        change = np.where(
            slow,
            change * (1.0 + policy.work.series * ratio / np.maximum(1.0 - ratio, 1.0 / policy.work.farthest)),
            change,
        )
        sizes = sizes + change
        present = np.abs(sizes) > policy.explanations.nuisance * deviation
        sizes = np.where(present, sizes, 0.0)
        if not present.any() or (np.abs(change) < 0.3 * deviation).all():
            break
    if best is None:
        raise RuntimeError("no round of nuisances was made")
    present = np.abs(kept) > policy.explanations.nuisance * deviation
    return best, np.where(present, kept, 0.0), deviation


def hypothesis_of(
    estimator: ConstrainedEstimator,
    data: Floats,
    observed: Flags,
    terms: Sequence[Nuisance],
    *,
    signs: Sequence[int],
    noise: float | None = None,
) -> Hypothesis:
    """What a frame is taken to be.

    ``terms`` are the nuisances that may be there; ``signs``: what contact may do (`Hypothesis.sign`); ``noise`` is that of `Hypothesis`.
    """
    policy = estimator.policy
    readings = estimator.readings
    white = readings.white((data / readings.std)[observed], observed)
    total = math.sqrt(float(np.mean(white**2))) if len(white) else 0.0
    none = np.zeros(len(terms))
    if not total > 0.0:
        flat = np.zeros((len(estimator.columns), math.prod(estimator.operator.surface.shape)))
        return Hypothesis(1, Rough(0.0, 0.0, 1.0, flat, np.zeros_like(data), 0.0), none, none > 0)
    plain = Hypothesis(1, rough(estimator, data, observed, total, 0, noise), none, none > 0)
    tried = [plain]
    # displacement is felt far away: what pulls in the middle looks much like what pushes all round
    if -1 in signs and (estimator.far or _worth(estimator, plain, data, total)):
        tried.append(Hypothesis(-1, rough(estimator, -data, observed, total, 0, noise), none, none > 0))
    if terms:
        # offsets come first, and ramps where they leave doubt
        usual = np.arange(len(terms)) < estimator.usual
        levels = quiet_levels(estimator, data, observed, terms)
        columns = np.stack([term.rows for term in terms], axis=1)
        best = max(tried, key=lambda h: h.rough.gain)
        left = (data - best.sign * best.rough.explained) / readings.std
        rest = np.zeros(len(terms))
        rest[usual] = readings.allowing(columns[:, usual]).sizes_of(left, observed)
        unit = np.sqrt((readings.white((columns / readings.std[:, None])[observed], observed) ** 2).sum(axis=0))
        level = max(best.rough.left, estimator.least_noise(data))
        # something is left over, or the edge of the array is loaded all round
        seen = (np.abs(rest) * unit > policy.explanations.nuisance * level) & usual
        if estimator.at_size or estimator.taxels >= policy.explanations.many_taxels:
            # so many readings tell an offset that is far too small to be looked for
            seen &= np.abs(rest) > policy.explanations.half * policy.explanations.smallest_nuisance * _reach(
                columns, data
            )
        doubt = seen.any() or best.rough.ring > policy.explanations.edge
        doubt |= _worth(estimator, best, data, total) and not _just_noise(estimator, best, data, observed, terms)
        # an offset of displacement on a half-space is explained by wide pressure, and nothing is left over
        hopeless = _hopeless(estimator, tried)
        wide = (
            estimator.far
            and estimator.problem.pad.thickness is None
            and best.rough.free < policy.explanations.compact * observed.sum()
        )
        if doubt or wide:
            # the likelier sign first: the other one is left where it cannot catch up
            ordered = _likelier_first(tried, hopeless)
            for sign in ordered if doubt else (best.sign,):
                for k, start in enumerate([*levels, *lowest_levels(estimator, data, observed, terms, sign)]):
                    more = _with_drift(estimator, data, observed, total, sign, start, usual, noise, tried)
                    if k > 0:
                        # the level of the wrong end leaves the other end loaded, and so does a ramp
                        more = [h for h in more if not h.rough.ring > policy.explanations.edge]
                    for h in more:
                        # noise that is learned otherwise makes another solution of the same: the better one counts
                        same = [o for o in tried if _alike(h, o, policy)]
                        if all(h.rough.gain > o.rough.gain for o in same):
                            tried = [o for o in tried if not any(o is s for s in same)] + [h]
        tilted = edge_drift(estimator, data, observed, terms) if doubt and not usual.all() else levels[0]
        if (np.abs(tilted) * unit > policy.explanations.nuisance * level)[~usual].any():
            every = np.ones_like(usual)
            for sign in _likelier_first(tried, hopeless):
                tried.extend(_with_drift(estimator, data, observed, total, sign, tilted, every, noise, tried))
    if 0 in signs:
        free = _both(estimator, data, observed, total, none)
        if free is not None:
            # of the linear model's traction some lies everywhere
            free = replace(free, rough=replace(free.rough, ring=plain.rough.ring))
            tried.append(free)
    best = _best(tried, policy)
    chance = 1.0 if 0 not in signs or best.sign == 0 or free is None else rough_fit(estimator, best, data, observed)
    best = free if chance < policy.explanations.structured_chance and free is not None else best
    # one that bends to every reading explains any; so does load all round with an offset against it, which leaves the rest free to push and to pull
    rivals = sorted(
        (h for h in tried if h.present.any() and h is not best and _may_be(h, policy)),
        key=lambda h: -worth_of(h, policy),
    )
    best = replace(best, rivals=tuple(rivals))
    return best if noise is None else replace(best, noise=noise)


def _likelier_first(tried: Sequence[Hypothesis], hopeless: Sequence[int]) -> list[int]:
    """The signs of what was tried, but for those that are ``hopeless``."""
    ordered = dict.fromkeys(h.sign for h in sorted(tried, key=lambda h: -h.rough.gain))
    return [sign for sign in ordered if sign not in hopeless]


def _hopeless(estimator: ConstrainedEstimator, tried: Sequence[Hypothesis]) -> list[int]:
    """Signs of contact that no offset saves, on large arrays: they gain less than half of what the best does, and that is no load all round, which is what
    an offset would be taken for.
    """
    policy = estimator.policy
    best = max(tried, key=lambda h: h.rough.gain)
    explains = best.rough.gain > 0.0 and not best.rough.ring > policy.explanations.edge
    if estimator.far or estimator.taxels < policy.explanations.many_taxels or not explains:
        return []
    return [h.sign for h in tried if h.rough.gain < policy.explanations.half * best.rough.gain]


def _with_drift(
    estimator: ConstrainedEstimator,
    data: Floats,
    observed: Flags,
    total: float,
    sign: int,
    start: Floats,
    sought: Flags,
    noise: float | None,
    tried: Sequence[Hypothesis],
) -> list[Hypothesis]:
    """The hypothesis with those of the nuisances ``sought`` that are there, if it is one, and may be better than what was ``tried``."""
    policy, terms = estimator.policy, [term for term, here in zip(estimator.terms, sought) if here]
    # what is loaded all round, or bends to every reading, is refuted too often to leave others for it
    beat = max((worth_of(h, policy) for h in tried if _may_be(h, policy)), default=-math.inf)
    solved = with_nuisance(estimator, data, observed, total, terms, sign, start[sought], noise, beat)
    if solved is None:
        return []
    found, sizes, _ = solved
    # one as large as the readings themselves is no offset, and a very small one is what the model cannot follow
    columns = np.stack([term.rows for term in terms], axis=1)
    part = np.abs(sizes) / np.maximum(_reach(columns, data), 1e-300)
    reach = reach_of_kind(estimator, columns, data - columns @ sizes)
    if not (
        (part > policy.explanations.smallest_nuisance).any()
        and (np.abs(sizes) <= policy.explanations.largest_nuisance * reach).all()
    ):
        return []
    every = np.zeros(len(sought))
    every[sought] = sizes
    return [Hypothesis(sign, found, every, every != 0)]


def rough_fit(estimator: ConstrainedEstimator, h: Hypothesis, data: Floats, observed: Flags) -> float:
    """The chance that noise is what a hypothesis leaves; 1 where it leaves little. Else contact of one sign is not what this is."""
    policy = estimator.policy
    white = estimator.readings.white((data / estimator.readings.std)[observed], observed)
    total = math.sqrt(float(np.mean(white**2))) if len(white) else 0.0
    columns = np.stack([term.rows for term in estimator.terms], axis=1) if estimator.terms else None
    clean = data if columns is None else data - columns @ h.sizes
    residual = np.where(observed, h.sign * clean - h.rough.explained, 0.0) / estimator.readings.std
    size = math.sqrt(float(np.mean(residual[observed] ** 2)))
    if not size > policy.explanations.structured * total or (
        estimator.noise_known and size < policy.detection.unexplained
    ):
        return 1.0
    taken = float(observed.sum()) - h.rough.free
    return misfit_probability(residual / size, observed, estimator.pairs, taken=taken, known=False)


def exceeded(estimator: ConstrainedEstimator, h: Hypothesis, data: Floats, observed: Flags) -> bool:
    """Whether what contact leaves is far more than the noise that was given: it is then taken for noise, and the fit says so."""
    policy = estimator.policy
    white = estimator.readings.white((data / estimator.readings.std)[observed], observed)
    size = math.sqrt(float(np.mean(white**2)))
    misfit = h.rough.left * math.sqrt(h.rough.free / max(float(observed.sum()), 1.0))
    return misfit > max(policy.detection.unexplained, policy.explanations.exceeded * size)


def without_outliers(
    estimator: ConstrainedEstimator, h: Hypothesis, data: Floats, observed: Flags
) -> tuple[Hypothesis, Flags]:
    """A hypothesis without the readings that its contact does not explain, left out one at a time, the worst first."""
    policy = estimator.policy
    readings, n = estimator.readings, len(data)
    if h.sign == 0 or not h.rough.traction[-1].any():
        return h, observed
    columns = np.stack([term.rows for term in estimator.terms], axis=1) if estimator.terms else np.zeros((n, 0))
    clean = h.sign * (data - columns @ h.sizes)
    counted = observed.copy()
    white = readings.white((clean / readings.std)[counted], counted)
    total = math.sqrt(float(np.mean(white**2)))
    best = h.rough
    for _ in range(max(int(policy.screening.most * observed.sum()), 1)):
        size = np.abs(clean) / readings.std
        others = np.where(counted & ~estimator.outermost, size, 0.0).max(initial=0.0)
        may = counted & (~estimator.outermost | (size > policy.screening.outermost * others))
        residual = np.where(may, np.abs(clean - best.explained) / readings.std, 0.0)
        worst = int(np.argmax(residual))
        largest = float(np.abs(best.explained / readings.std).max(initial=0.0))
        # one reading among n raises what is left to its own size over sqrt(n): it hides behind itself where there are few
        part = 1.0 if estimator.at_size else policy.explanations.half
        if not residual[worst] > max(part * policy.screening.deviations * best.left, policy.screening.gross * largest):
            break
        fewer = counted.copy()
        fewer[worst] = False
        filled = np.where(fewer, clean, best.explained)
        found = rough(estimator, filled, fewer, total, int(h.present.sum()), h.noise, best.traction)
        floor = max(found.left, estimator.least_noise(data))
        if not (
            found.free * math.log(max(best.left, floor) / floor) > policy.screening.broken + math.log(n)
            and abs(clean[worst] - found.explained[worst]) / readings.std[worst] > policy.screening.deviations * floor
        ):
            break
        counted, best = fewer, found
    return replace(h, rough=best), counted


def _alike(a: Hypothesis, b: Hypothesis, policy: Policy) -> bool:
    """Whether two hypotheses with nuisances came to the same: a rival that is a copy would be solved for nothing."""
    same = a.sign == b.sign and np.array_equal(a.present, b.present)
    return bool(same and np.allclose(a.sizes, b.sizes, rtol=policy.explanations.same, atol=0.0))


def _reach(columns: Floats, data: Floats) -> Floats:
    """The size at which each nuisance makes readings as large as the largest that it touches."""
    return np.array(
        [np.abs(data[c != 0]).max(initial=0.0) / max(float(np.abs(c).max(initial=0.0)), 1e-300) for c in columns.T]
    )


def reach_of_kind(estimator: ConstrainedEstimator, columns: Floats, data: Floats) -> Floats:
    """The size at which each nuisance makes readings as large as the largest of any channel of its kind: how well a sensor keeps its zero is a
    matter of its range, and not of how much a contact happens to say to one of its channels.
    """
    arrays = estimator.operator.planes_of
    kinds = [find_channel(c).kind.unit for a in arrays for c in a.channels]
    kind = np.repeat(kinds, [int(a.valid.sum()) for a in arrays for _ in a.channels])
    size = np.abs(data)
    return np.array(
        [
            size[np.isin(kind, np.unique(kind[c != 0]))].max(initial=0.0)
            / max(float(np.abs(c).max(initial=0.0)), 1e-300)
            for c in columns.T
        ]
    )


def _worth(estimator: ConstrainedEstimator, h: Hypothesis, data: Floats, total: float) -> bool:
    """Whether others are worth trying: this one leaves much of the readings, and of a large array, most of which nothing touches, more than
    the linear model, which may pull, calls noise.
    """
    policy = estimator.policy
    if not h.rough.left > policy.explanations.doubt * total:
        return False
    if not estimator.at_size or estimator.noise_known:
        return True
    linear = estimator.evidence(estimator.orders[1], estimator.readings.planes(data), None)
    return h.rough.left > policy.noise.again * linear.scale


def _just_noise(
    estimator: ConstrainedEstimator, h: Hypothesis, data: Floats, observed: Flags, terms: Sequence[Nuisance]
) -> bool:
    """Whether what is left is no more than noise, and the outermost taxels of an area read nothing but it: offsets are then not worth
    seeking, however large a part of the readings is noise. What contact leaves would not tell: it takes up noise that pushes.
    """
    policy, std, noise = estimator.policy, estimator.readings.std, 1.0
    if not estimator.noise_known:
        noise = estimator.evidence(estimator.orders[1], estimator.readings.planes(data), None).scale
    if h.rough.left > noise * (
        1.0 + policy.explanations.sure / math.sqrt(2.0 * h.rough.free) if estimator.noise_known else policy.noise.again
    ):
        return False
    for term in terms:
        array, here = _touched(estimator, term)
        if term.kind != "offset" or array.dimensions == 1:
            return False
        at = here[_outermost(array.points[array.valid.ravel()], isinstance(array, ScatteredArray))]
        at = at[observed[at]]
        if (
            len(at) < policy.explanations.edge_taxels
            or abs(float((data[at] / std[at]).mean())) * math.sqrt(len(at)) > policy.explanations.edge_mean * noise
        ):
            return False
    return True


def _both(
    estimator: ConstrainedEstimator, data: Floats, observed: Flags, total: float, none: Floats
) -> Hypothesis | None:
    """Traction of either sign, by the linear model."""
    if (~observed).sum() > len(data) // 2:
        return None
    found, left, free = estimator.start.noise(data, total, observed)
    floor = estimator.least_noise(data)
    gain = free * math.log(total / max(left, floor, 1e-300))
    flat = found.traction.reshape(len(found.traction), -1)
    return Hypothesis(0, Rough(gain, left, free, flat, np.zeros_like(data), 1.0), none, none > 0)


def _may_be(h: Hypothesis, policy: Policy) -> bool:
    """Whether a hypothesis is one of compact contact."""
    return h.rough.free >= FEWEST and h.rough.ring < policy.explanations.ring


def worth_of(h: Hypothesis, policy: Policy) -> float:
    """The gain of a hypothesis, less what it needs."""
    return h.rough.gain - policy.explanations.per_nuisance * (int(h.present.sum()) + (h.sign < 1))


def _best(tried: Sequence[Hypothesis], policy: Policy) -> Hypothesis:
    """The best; one that needs more must gain more, and be surer than whether anything touches at all."""

    plain = [h for h in tried if h.sign != 0 and not h.present.any()]
    simple = max(plain, key=lambda h: worth_of(h, policy))
    best = max(tried, key=lambda h: worth_of(h, policy))
    # that the whole edge of the array is loaded is what an offset looks like, and a contact larger than the array
    margin = (
        policy.explanations.undecided if simple.rough.ring > policy.explanations.ring else policy.detection.evidence
    )
    return best if best is simple or worth_of(best, policy) - worth_of(simple, policy) > margin else simple
