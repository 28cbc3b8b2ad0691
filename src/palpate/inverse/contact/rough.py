"""Rough solution of a contact of one sign: one even penalty on surface cells, and a noise level consistent with the
residual.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.constrained.variances import UNTOLD, deviations_of, told_of, unit_of, with_matrix
from palpate.inverse.contact.cells import even_contact
from palpate.inverse.contact.explanation import Beside, Explanation, Rough
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.score import gain_of
from palpate.inverse.fit import misfit_probability, rms

__all__ = ["largest_gain", "rough", "rough_fit", "steps_of", "wide_and_wrong"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


def rough(
    estimator: PreparedContact,
    data: Floats,
    observed: Flags,
    total: float,
    patterns: Floats | None = None,
    noise_at_first: float | None = None,
    near: Floats | None = None,
    beat: float = -math.inf,
    shifts: Floats | None = None,
) -> Rough:
    """Rough solution of pushing readings, with the largest noise level that equals its own residual, starting from
    ``noise_at_first``.

    ``patterns`` (reading, nuisance) are the nuisances that were subtracted, each of which takes a degree of freedom;
    ``near`` is passed to `cells.even_contact`. Stop lowering the noise once the gain decreases and is below ``beat``.
    ``shifts`` (reading, nuisance) are nuisances to compute `Rough.beside` for.
    """
    policy = estimator.policy
    certain = estimator.noise_known
    floor = estimator.least_noise(data)
    known = _first_noise(estimator, total, noise_at_first, near)
    used = 0 if patterns is None else patterns.shape[1]
    solved = partial(_at_noise, estimator, data, observed, used)
    keep_face, explained, gain = used > 0 or shifts is not None, data, -math.inf
    for turn in range(policy.screening.rounds):
        at = solved(known, explained, near, keep_face=keep_face)
        near, explained, left = at.traction, at.explained, at.left
        # This noise equals its residual, or is below it: noise that is not given is only lowered.
        settled = left > known / policy.noise.again and (left < known * policy.noise.again or not certain)
        fits = left <= floor or (certain and left <= known and (turn > 0 or known <= 1.0))
        if settled or fits:
            break
        before, gain = gain, gain_of(at.free, total, left, floor)
        hopeless = gain < min(before, beat)
        if hopeless or (certain and turn >= 2):
            break
        known = max(left, floor, 1.0 if certain else 0.0)
    left, free = at.left, at.free
    gain = gain_of(free, total, left, floor) if total > 0 else 0.0
    change: Floats = np.zeros(0)
    deviation: Floats = np.zeros(0)
    if patterns is not None and used:
        change, deviation = _step(estimator, at.model, patterns, data - explained, at.noise, observed)
        deviation = deviation * (max(left, floor) / known)
    edge = estimator.edge_load(at.traction[-1])
    beside = None
    if shifts is not None:
        beside = _beside(estimator, at.model, shifts, data - explained, at.noise, observed)
    return Rough(gain, left, free, at.traction, explained, edge, change, deviation, beside)


def largest_gain(estimator: PreparedContact, h: Explanation, data: Floats, observed: Flags, total: float) -> float:
    """The largest gain of contact ``h`` at its noise and above.

    With noise far below what coarse cells leave, contact follows every reading, and gains less than a smoother one.
    """
    clean, floor = h.sign * (data - estimator.shifts @ h.sizes), estimator.least_noise(data)
    gain, known, explained, near = h.rough.gain, 2.0 * h.rough.left, h.rough.explained, h.rough.traction
    while 0.0 < known < total:
        at = _at_noise(estimator, clean, observed, int(h.present.sum()), known, explained, near)
        more = gain_of(at.free, total, at.left, floor)
        if not more > gain:
            break
        gain, known, explained, near = more, 2.0 * known, at.explained, at.traction
    return gain


class _AtNoise(NamedTuple):
    """Contact solved for one noise (reading,): traction, predicted readings, model, residual noise and degrees of freedom
    left.
    """

    noise: Floats
    traction: Floats
    explained: Floats
    model: ContactModel
    left: float
    free: float


def _at_noise(
    estimator: PreparedContact,
    data: Floats,
    observed: Flags,
    used: int,
    known: float,
    explained: Floats,
    near: Floats | None,
    *,
    keep_face: bool = False,
) -> _AtNoise:
    """Contact solved for the noise ``known``; readings that are not in use are filled with ``explained``."""
    readings = estimator.readings
    filled, noise = np.where(observed, data, explained), readings.std * known
    found = estimator.start.evidence(estimator.orders[1], readings.planes(filled), known)
    traction, explained, model = even_contact(
        estimator, found.traction, data / noise, noise, observed, found.weight, near, keep_face=keep_face
    )
    misfit = readings.whitened(data - explained, observed)
    free = max(float(observed.sum()) - used - estimator.taken(traction[-1], found.parameter), 1.0)
    return _AtNoise(noise, traction, explained, model, math.sqrt(float((misfit**2).sum()) / free), free)


def _first_noise(estimator: PreparedContact, total: float, at_first: float | None, near: Floats | None) -> float:
    """The noise to start from: ``at_first`` or a part of the readings; or the given noise, unless products would take
    hundreds of steps with a noise so far below the residual.
    """
    if not estimator.noise_known:
        return at_first or estimator.policy.screening.first_noise * total
    if at_first is not None and (estimator.large or wide_and_wrong(estimator, near, at_first)):
        return max(at_first, 1.0)
    return 1.0


def _step(
    estimator: PreparedContact, model: ContactModel, patterns: Floats, left: Floats, noise: Floats, observed: Flags
) -> tuple[Floats, Floats]:
    """Newton step of the sizes of ``patterns`` beside a contact that leaves the residual ``left``, and their standard
    deviations (nuisance,).
    """
    readings = estimator.readings
    rows, white = readings.whitened(patterns, observed, noise), readings.whitened(left, observed, noise)
    unit = unit_of(rows)
    rows = rows / unit
    # With few readings, a wide contact fits at any offset and leaves no degrees of freedom. Small steps find the offsets
    # before that happens.
    few = observed.sum() <= estimator.policy.detection.few_readings
    told = rows.T @ rows if few else told_of(model, rows)
    change = np.asarray(np.linalg.lstsq(told, rows.T @ white, rcond=UNTOLD)[0]) / unit
    return change, np.asarray(deviations_of(told) / unit)


def wide_and_wrong(estimator: PreparedContact, near: Floats | None, left: float) -> bool:
    """Whether a solution presses on so many cells that products are used, and still leaves far more than the given noise."""
    policy = estimator.policy
    if near is None or not estimator.noise_known or left <= policy.screening.deviations:
        return False
    return int(np.count_nonzero(near[-1])) * len(near) > policy.grid.few_unknowns


def _beside(
    estimator: PreparedContact, model: ContactModel, columns: Floats, left: Floats, noise: Floats, observed: Flags
) -> Beside:
    """`Beside` of a contact, for the nuisances ``columns`` and the residual ``left``."""
    rows = estimator.readings.whitened(columns, observed, noise)
    white = estimator.readings.whitened(left, observed, noise)
    unit = unit_of(rows)
    rows = rows / unit
    return Beside(told_of(with_matrix(model, rows.shape[1]), rows), rows.T @ white, float(white @ white), unit)


def steps_of(
    estimator: PreparedContact, h: Explanation, data: Floats, observed: Flags, groups: Sequence[Sequence[int] | Index]
) -> list[tuple[Floats, float]]:
    """Sizes of the nuisances of each group if it alone is solved together with the contact of ``h``, on its face, and
    the log likelihood that it gains.
    """
    beside = h.rough.beside or _solved_beside(estimator, h, data, observed)
    lengths = np.array([len(group) for group in groups])
    out: list[tuple[Floats, float]] = [(np.zeros(0), 0.0)] * len(groups)
    for length in np.unique(lengths):
        alike = np.flatnonzero(lengths == length)
        picks = np.array([groups[int(k)] for k in alike], dtype=np.intp)
        pull, information = beside.pull[picks], beside.information[picks[:, :, None], picks[:, None, :]]
        step = np.einsum("kij,kj->ki", np.linalg.pinv(information, rcond=UNTOLD, hermitian=True), pull)
        after = 1.0 - (step * pull).sum(axis=1) / max(beside.left, 1e-300)
        gains = -0.5 * max(h.rough.free - length, 1.0) * np.log(np.maximum(after, 1e-12))
        for k, sizes, gain in zip(alike, h.sign * step / beside.unit[picks], gains):
            out[int(k)] = sizes, float(gain)
    return out


def _solved_beside(estimator: PreparedContact, h: Explanation, data: Floats, observed: Flags) -> Beside:
    """`Beside` of an explanation, solved again with the noise that it leaves."""
    readings, floor = estimator.readings, estimator.least_noise(data)
    clean = h.sign * (data - estimator.shifts @ h.sizes)
    known = max(h.rough.left, floor, 1.0 if estimator.noise_known else 0.0)
    noise = readings.std * known
    found = estimator.start.evidence(
        estimator.orders[1], readings.planes(np.where(observed, clean, h.rough.explained)), known
    )
    _, explained, model = even_contact(
        estimator, found.traction, clean / noise, noise, observed, found.weight, h.rough.traction, keep_face=True
    )
    return _beside(estimator, model, estimator.shifts, clean - explained, noise, observed)


def rough_fit(estimator: PreparedContact, h: Explanation, data: Floats, observed: Flags) -> float:
    """Probability that noise alone would leave a residual as regular as that of explanation ``h``. If it is low, a
    contact of one sign (all pushing or all pulling) is the wrong model.

    A small residual is not tested, and the probability is 1: one below the fraction ``policy.explanations.structured``
    of the readings or, if the noise is given, below ``policy.detection.unexplained`` times the noise.
    """
    policy = estimator.policy
    total = rms(estimator.readings.whitened(data, observed))
    clean = h.sign * (data - estimator.shifts @ h.sizes)
    residual = np.where(observed, clean - h.rough.explained, 0.0) / estimator.readings.std
    size = rms(residual[observed])
    if not size > policy.explanations.structured * total or (
        estimator.noise_known and size < policy.detection.unexplained
    ):
        return 1.0
    taken = float(observed.sum()) - h.rough.free
    return misfit_probability(residual / size, observed, estimator.pairs, taken=taken, known=False)
