"""Whether noise explains a frame, alone or about offsets: "no contact" is a claim."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.explanation import Explanation, Rough, Solved
from palpate.inverse.contact.prepared import Prepared
from palpate.inverse.contact.score import more_than_noise
from palpate.inverse.estimate import Errors
from palpate.inverse.fit import PROVEN
from palpate.inverse.linear.evidence import log_evidence

__all__ = ["WIDE", "detection_limit", "explained_by_noise", "uneven_noise"]

#: Half of an interval of 95 % in standard deviations.
WIDE = 1.96

Flags = npt.NDArray[np.bool_]


def explained_by_noise(estimator: Prepared, data: Floats, observed: Flags) -> Explanation | None:
    """The explanation of a frame that noise explains, alone or with offsets; None where there is more."""
    policy = estimator.policy
    rows = estimator.readings.planes(data)
    loud = uneven_noise(estimator, data, observed, None)
    none = np.zeros(len(estimator.terms))
    flat = np.zeros((len(estimator.columns), math.prod(estimator.operator.surface.shape)))
    nothing = Rough(0.0, 0.0, 1.0, flat, np.zeros_like(data), 0.0)
    linear = estimator.orders[1]
    plain = estimator.evidence(linear, rows, None)
    if not more_than_noise(plain.gain, loud, policy):
        return Explanation(1, nothing, none, none > 0)
    if not estimator.terms:
        return None
    shifts = estimator.shifts[:, : estimator.usual]
    patterns = np.stack([estimator.start.projected(estimator.readings.planes(c)) for c in shifts.T])
    found = estimator.start.evidence(linear, rows, None, patterns)
    if more_than_noise(found.gain, loud, policy):
        return None
    noise = 1.0 if estimator.noise_known else None
    reach = [np.abs(data[c != 0]).max(initial=0.0) / np.abs(c).max() for c in shifts.T]
    prior = float(np.log(np.maximum(np.array(reach) * policy.explanations.largest_nuisance, 1e-300)).sum())
    alone = log_evidence(found.objective, found.logdet, found.freedom, noise) - found.gain - prior
    if alone < log_evidence(plain.objective, plain.logdet, plain.freedom, noise):
        return None
    # noise alone, about an offset
    unit = np.sqrt((patterns**2).sum(axis=1))
    sizes = np.linalg.lstsq(patterns.T, estimator.start.projected(rows), rcond=None)[0]
    present = none > 0
    present[: estimator.usual] = np.abs(sizes) * unit > policy.explanations.nuisance * found.scale
    none[: estimator.usual] = sizes
    return Explanation(1, nothing, np.where(present, none, 0.0), present)


def detection_limit(estimator: Prepared, run: Solved, fit: float, errors: Errors) -> tuple[Errors, bool]:
    """Errors of a frame where nothing was found, and whether they are wider than ``errors``: as large as the largest reading says where noise explains the readings ill."""
    if fit >= PROVEN:
        return errors, False
    largest = float(np.abs(run.data / estimator.readings.std).max(initial=0.0))
    return estimator.undetected(largest, run.data), True


def uneven_noise(estimator: Prepared, data: Floats, observed: Flags, known: float | None) -> float:
    """What noise of another level in each channel explains (`ChannelNoise.uneven`)."""
    return estimator.noise.uneven(data, observed, known) if estimator.policy.parts.uneven_evidence else 0.0
