"""Test whether noise explains a frame, with or without offsets, and limit the contact that may have been missed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact import trace
from palpate.inverse.contact.explanation import Explanation, Rough, Solved
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.proposals.levels import reach
from palpate.inverse.contact.rough import rough
from palpate.inverse.contact.score import more_than_noise
from palpate.inverse.contact.unbounded import even_press
from palpate.inverse.estimate import Errors
from palpate.inverse.fit import PROVEN, rms
from palpate.inverse.linear.evidence import log_evidence

__all__ = ["WIDE", "detection_limit", "explained_by_noise", "short_line_load"]

#: Half-width of a 95 % interval, in standard deviations.
WIDE = 1.96

Flags = npt.NDArray[np.bool_]


def explained_by_noise(estimator: PreparedContact, data: Floats, observed: Flags) -> Explanation | None:
    """The explanation of a frame by noise, with or without offsets; None if contact is needed."""
    policy = estimator.policy
    rows = estimator.readings.planes(data)
    loud = estimator.noise.uneven(data, observed, None)
    sizes = np.zeros(len(estimator.terms))
    flat = np.zeros((len(estimator.columns), math.prod(estimator.operator.surface.shape)))
    nothing = Rough(0.0, 0.0, 1.0, flat, np.zeros_like(data), 0.0)
    linear = estimator.orders[1]
    plain = estimator.start.evidence(linear, rows, None)
    trace.decided("log evidence of contact over noise alone", plain.gain, policy.detection.evidence + loud)
    if not more_than_noise(plain.gain, loud, policy):
        return Explanation(1, nothing, sizes)
    if not estimator.usual:
        return None
    shifts = estimator.shifts[:, : estimator.usual]
    patterns = np.stack([estimator.start.projected(estimator.readings.planes(c)) for c in shifts.T])
    found = estimator.start.evidence(linear, rows, None, patterns)
    trace.decided("log evidence of contact over noise with offsets", found.gain, policy.detection.evidence + loud)
    if more_than_noise(found.gain, loud, policy):
        return None
    noise = 1.0 if estimator.noise_known else None
    largest = policy.explanations.largest_nuisance * reach(shifts, data)
    prior = float(np.log(np.maximum(largest, 1e-300)).sum())
    alone = log_evidence(found.objective, found.logdet, found.freedom, noise) - found.gain - prior
    if alone < log_evidence(plain.objective, plain.logdet, plain.freedom, noise):
        return None
    # Noise alone, around an offset.
    unit = np.sqrt((patterns**2).sum(axis=1))
    offsets = np.linalg.lstsq(patterns.T, estimator.start.projected(rows), rcond=None)[0]
    significant = np.abs(offsets) * unit > policy.explanations.nuisance * found.scale
    sizes[: estimator.usual] = np.where(significant, offsets, 0.0)
    if sizes[estimator.since_zero].any():
        even = even_press(estimator, sizes)
        if even is not None and even[-1] > 0 and np.linalg.norm(even[:-1]) <= policy.prior.most_friction * even[-1]:
            return (
                None  # after a zero, a press is likelier than such a drift; with more shear it is drift of all channels
            )
    left = rms(estimator.readings.whitened(data - estimator.shifts @ sizes, observed))
    return Explanation(1, replace(nothing, left=left), sizes)


def short_line_load(estimator: PreparedContact, run: Solved) -> Floats | None:
    """Net force (component,) of a contact over most of a short line that would explain the readings although noise does too; None
    if the noise is given or no such contact fits.

    If all of a few taxels on a line are pressed, the readings look like noise, because each taxel has only two
    neighbours. A contact of one sign then leaves almost no residual. But noise can do the same by chance, and the
    readings cannot tell which it is.
    """
    policy = estimator.policy
    lines = estimator.operator.surface.dimensions == 1
    if (
        estimator.noise_known
        or not lines
        or estimator.taxels > policy.detection.short_line
        or not policy.parts.few_cells
    ):
        return None
    readings, observed = estimator.readings, run.observed
    total = rms(readings.whitened(run.data, observed))
    if not total > 0.0:
        return None
    grid = estimator.operator.surface
    out = np.zeros(len(grid.components))
    for sign in (1, -1) if -1 in estimator.signs else (1,):
        found = rough(estimator, sign * run.data, observed, total, None, policy.detection.short_line_noise * total)
        left = rms(readings.whitened(sign * run.data - found.explained, observed))
        if left < policy.detection.short_line_left * total:
            force = grid.cell * np.abs(found.traction[:, estimator.inside.ravel()].sum(axis=1))
            out[list(estimator.columns)] = np.maximum(out[list(estimator.columns)], force)
    return out if out.any() else None


def detection_limit(estimator: PreparedContact, run: Solved, fit: float, errors: Errors) -> tuple[Errors, int]:
    """Errors of a frame without contact, and the reason if they are wider than ``errors``: 0 not wider, 1 because noise
    explains the readings poorly (``fit``), 2 because of `short_line_load`.
    """
    why = 0
    if fit < PROVEN:
        # As large as the largest reading allows.
        why, largest = 1, float(np.abs(run.data / estimator.readings.std).max(initial=0.0))
        errors = estimator.undetected(largest, run.data)
    force = short_line_load(estimator, run)
    if force is not None:
        why, errors = 2, replace(errors, force=np.maximum(errors.force, force / WIDE))
    return errors, why
