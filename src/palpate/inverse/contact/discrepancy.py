"""Model error of the pad as a noise term proportional to the readings.

A real pad has edges, unequal gains, a lattice or a stiffening rubber: no elastic model fits it better than to a few
per cent. So

    readings = A t + noise + discrepancy,    discrepancy ~ N(0, share^2 * mean square of the readings).

``share`` is learned from the frame: the smallest value of `Fit.shares` with which contact fits the readings. It widens
every interval twice: as independent noise of that size, and as an error common to all readings (`Touch.discrepancy`),
because a model that is wrong at one taxel is wrong in the same way at its neighbours.

"No contact" is a statement about noise. It is only proven if the noise level was given by the user or measured at
rest; then a reading beyond the noise is contact or unexplained. A noise level learned from the frame itself proves
nothing if there are few readings.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact import trace
from palpate.inverse.contact.answer import nothing_fits
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.no_contact import WIDE
from palpate.inverse.contact.policy import Fit, Policy
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.search import search
from palpate.inverse.fit import DISCREPANCY, POOR_FIT, rms

__all__ = ["degrees_of_share", "posterior", "solve_with_model_error"]


def solve_with_model_error(
    estimator: PreparedContact, readings: Sequence[Floats], rng: np.random.Generator | None
) -> Frame:
    """The result of one frame with the smallest discrepancy that makes it fit; see the module."""
    data, _ = estimator.data_of(readings)
    if estimator.noise_known:
        return _with_known_noise(estimator, readings, data, rng)
    plain = search(estimator, readings, rng)
    few = len(data) <= estimator.policy.detection.few_readings or plain.unproven > 0
    if not plain.contact:
        return _undecided(plain) if few and np.any(data) else plain
    return _doubted(estimator, plain, data)


def _with_known_noise(
    estimator: PreparedContact, readings: Sequence[Floats], data: Floats, rng: np.random.Generator | None
) -> Frame:
    """The result with noise that was given, or measured with the zero. After a zero the fit shows the discrepancy, and one
    is tried at once where the noise is far below what an elastic model of any pad can explain.
    """
    policy, zeroed = estimator.policy, estimator.problem.zeroed
    ratio = data / estimator.readings.std
    loud = zeroed and np.abs(ratio).max(initial=0.0) > policy.screening.deviations
    if loud and (rms(ratio) * policy.fit.shares[0] > policy.fit.faint or len(data) <= policy.fit.proves):
        return _with_shares(estimator, readings, data, None, rng)
    plain = _solved(estimator, readings, rng)
    # Contact and offsets together may explain anything about few readings.
    proven = _explains(estimator, plain) and plain.free > policy.fit.proves
    if loud and len(data) <= policy.detection.few_readings and not proven:
        return _with_shares(estimator, readings, data, None, rng)
    misfit = plain.fit < POOR_FIT
    if plain.contact and not zeroed:
        return _doubted(estimator, plain, data)
    if plain.contact and not misfit:
        return replace(plain, discrepancy=_posterior(0.0, plain.free, ratio, policy))
    quiet = np.abs(ratio[~plain.outliers]).max(initial=0.0) < policy.screening.deviations
    if not plain.contact and (quiet or not misfit):
        return replace(plain, undecided=plain.undecided or misfit)
    return _with_shares(estimator, readings, data, plain, rng)


def _solved(
    estimator: PreparedContact, readings: Sequence[Floats], rng: np.random.Generator | None, factor: float = 1.0
) -> Frame:
    """The frame with ``factor`` times the noise (`_at_noise`); of few readings without the nuisances that the zero removed."""
    few = len(estimator.readings.std) <= estimator.policy.fit.proves
    settled = estimator.settled if few else estimator
    found = search(settled, readings, rng) if factor == 1.0 else _at_noise(settled, readings, factor, rng)
    if settled is estimator:
        return found
    kept = np.isin([t.label for t in estimator.terms], [t.label for t in settled.terms])
    sizes, std = np.zeros((2, len(kept)))
    sizes[kept], std[kept] = found.nuisance, found.nuisance_std
    return replace(found, nuisance=sizes, nuisance_std=std)


def _credible(
    estimator: PreparedContact, readings: Sequence[Floats], rng: np.random.Generator | None, factor: float
) -> Frame:
    """The frame with ``factor`` times the noise; with drift after the zero only if that is credible.

    Offsets that are real take load away from beyond the outermost taxels, where contact alone put it to imitate them. If
    they add load there, the drift is not one offset of each channel, and contact takes up the rest: then contact alone
    counts, which needs a larger discrepancy.
    """
    found = _solved(estimator, readings, rng, factor)
    if not found.contact or not found.nuisance[estimator.since_zero].any():
        return found
    alone = _solved(estimator.seeks_no_drift, readings, rng, factor)
    return alone if alone.contact and found.beyond[0] > alone.beyond[0] else found


def _doubted(estimator: PreparedContact, frame: Frame, data: Floats) -> Frame:
    """The frame with a discrepancy computed from its residual: none at the misfit probability `Fit.accepted`, all of it
    at `POOR_FIT`. Many frames of a wrong pad pass the fit test narrowly.
    """
    accepted = estimator.policy.fit.accepted
    doubt = min((accepted - frame.fit) / (accepted - POOR_FIT), 1.0)
    if not doubt > 0.0:
        return frame
    sizes = data / estimator.readings.std
    left = frame.left / max(rms(sizes), 1e-300)
    found = math.sqrt(doubt) * _posterior(min(left, 1.0), frame.free, sizes, estimator.policy)
    return replace(frame, discrepancy=max(frame.discrepancy, found))


def _undecided(frame: Frame) -> Frame:
    """Result of a frame with few readings that look like noise of unknown level: bounds allow a contact that this
    noise hides, and the even press that its offsets may be.
    """
    force = WIDE * frame.known.force
    low, high = np.moveaxis(frame.bounds, -1, 0)
    bounds = np.stack([np.fmin(low, -force), np.fmax(high, force)], axis=-1)
    return replace(frame.blanked(), undecided=True, bounds=bounds)


def _explains(estimator: PreparedContact, frame: Frame) -> bool:
    """Whether the contact that was found, or drift since the zero without contact, passes the fit test."""
    if frame.contact:
        return not frame.fit < POOR_FIT and (frame.pushed or frame.sign < 0 or frame.sign > 1)
    drift = frame.nuisance[estimator.since_zero]
    return frame.fit > estimator.policy.fit.accepted and bool(drift.any())


def _with_shares(
    estimator: PreparedContact,
    readings: Sequence[Floats],
    data: Floats,
    plain: Frame | None,
    rng: np.random.Generator | None,
) -> Frame:
    """The frame with the first of the discrepancies that makes it fit; otherwise with the best of them, or
    unexplained.
    """
    policy = estimator.policy
    level = estimator.even_noise
    sizes = data / level.readings.std
    ratio = rms(sizes)

    @cache
    def solved(share: float) -> tuple[float, Frame]:
        """The factor of the noise, and the frame."""
        factor = math.hypot(1.0, share * ratio)
        trace.step(f"solved with a model error of {share:.0%} of the readings, as {factor:.3g} times the noise")
        return factor, _credible(level, readings, rng, factor)

    def promises() -> bool:
        """Whether the largest discrepancy shows a contact or an offset: if not, a smaller one seldom does."""
        largest = solved(policy.fit.shares[-1])[1]
        return largest.contact or _explains(level, largest)

    best: tuple[float, Frame] | None = None
    hopeless = plain is not None and not plain.contact and not promises()
    share: float | None = None if hopeless else policy.fit.shares[0]
    while share is not None:
        factor, found = solved(share)
        left = found.left / max(ratio, 1e-300) if found.contact else 1.0
        if found.contact:
            found = replace(found, fit=_size_probability(found, len(data)))
        if _explains(level, found):
            found = _in_units_of(estimator, found, factor)
            share = _posterior(max(left, 0.0), found.free, sizes, policy) if found.contact else 0.0
            return replace(found, discrepancy=share)
        if found.contact and (best is None or left < best[0]):
            best = left, _in_units_of(estimator, found, factor)
        larger = [s for s in policy.fit.shares if s > share]
        if found.contact:
            # The noise explains a part of the residual: the discrepancy need not.
            needed = math.sqrt(max(left**2 - 1.0 / ratio**2, 0.0))
            share = next((s for s in larger if s >= policy.fit.margin * needed), None)
        else:
            share = larger[0] if larger and promises() else None
    if best is None or not best[0] < policy.detection.most_left:
        return nothing_fits(estimator, data)
    left, found = best
    # No discrepancy makes the contact fit.
    discrepancy = max(policy.fit.shares[-1], _posterior(left, found.free, sizes, policy))
    return replace(found, discrepancy=discrepancy, unexplained=True)


def _at_noise(
    estimator: PreparedContact, readings: Sequence[Floats], factor: float, rng: np.random.Generator | None
) -> Frame:
    """Solve a frame as if its noise were ``factor`` times the noise that ``estimator`` was prepared for.

    Traction and errors are proportional to readings and noise. So instead of preparing an estimator anew, divide the
    readings, their limits and the zero by ``factor``, solve with the prepared noise, and multiply the result by
    ``factor``.
    """
    scaled = copy.copy(estimator)
    if estimator.given_ends is not None:
        scaled.given_ends = (estimator.given_ends[0] / factor, estimator.given_ends[1] / factor)
    scaled.zero = None if estimator.zero is None else estimator.zero / factor
    found = search(scaled, [r / factor for r in readings], rng)
    return replace(
        found,
        traction=found.traction * factor,
        errors=found.known.times(factor),
        parameter=found.parameter / factor**2,
        one_penalty=True,
        noise=found.noise * factor,
        draws=None if found.draws is None else found.draws * factor,
        nuisance=found.nuisance * factor,
        nuisance_std=found.nuisance_std * factor,
        stated=None if found.stated is None else found.stated.times(factor),
        bounds=found.bounds * factor,
        models=None if found.models is None else found.models.times(factor),
    )


def _in_units_of(estimator: PreparedContact, frame: Frame, factor: float) -> Frame:
    """The frame solved by `_at_noise` with even noise: its noise in units of the noise of ``estimator``, and the resolution at that noise."""
    even = estimator.even_noise
    noise = frame.noise * np.concatenate(even.scales) / np.concatenate(estimator.scales)
    return replace(frame, noise=noise, resolution=even.resolution(factor**2 * frame.parameter))


def _size_probability(frame: Frame, count: int) -> float:
    """Misfit probability from the size of the residual only. Model errors are correlated between neighbours, so the
    whiteness test does not apply. NaN if contact leaves less than one degree of freedom.
    """
    import scipy.special

    if not frame.free >= 1.0:
        return math.nan
    return float(scipy.special.gammaincc(0.5 * frame.free, 0.5 * count * frame.residual**2))


def posterior(share: float, free: float, policy: Fit) -> float:
    """Posterior estimate of the discrepancy: ``share`` measured with ``free`` degrees of freedom, combined with its
    prior. Fractions of the readings' root mean square.
    """
    return math.sqrt((policy.prior_weight * DISCREPANCY**2 + free * share**2) / (policy.prior_weight + free))


def degrees_of_share(share: float, free: float, readings: Floats) -> float:
    """Degrees of freedom that tell a ``share``, of the ``free`` ones that a contact leaves of ``readings``.

    A model error in proportion to each reading shows in the large ones only: to a small share, faint readings add
    nothing. Of n readings y, sum r^2 / sum y^2 has (sum y^2)^2 / sum y^4 degrees of freedom (F. E. Satterthwaite,
    Biometrics 2, 1946, 110-114). A share above the prior's needs no such caution.
    """
    squares = np.square(readings)
    loaded = float(squares.sum()) ** 2 / max(len(readings) * float(np.square(squares).sum()), 1e-300)
    return free if share > DISCREPANCY else free * loaded


def _posterior(left: float, free: float, readings: Floats, policy: Policy) -> float:
    """`posterior` from ``left``, the root mean square of the residual of the ``readings`` as a fraction of theirs, with
    ``free`` degrees of freedom.
    """
    free = max(free, 0.0) if math.isfinite(free) else 0.0
    share = left * math.sqrt(len(readings) / free) if free > 0.0 else 0.0
    return posterior(share, degrees_of_share(share, free, readings), policy.fit)
