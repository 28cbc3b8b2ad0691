"""Misfit probability of a frame of a stream (`palpate.inverse.fit`)."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.fit import MODEL_DETAIL, misfit_probability
from palpate.tracking.health import Flags

__all__ = ["probability_of"]


def probability_of(
    estimator: ConstrainedEstimator,
    rest: Floats,
    used: Flags,
    noise: float,
    *,
    largest: float,
    taken: float,
    known: bool,
    ordered: float = 0.0,
) -> float:
    """Misfit probability of the residual ``rest`` (reading,), in units of the readings' standard deviations.

    ``noise`` is that of a frame minus the zero, ``largest`` the largest reading, ``taken`` the degrees of freedom
    used by contact and offsets; with ``known`` noise the size of the residual is tested too. ``ordered`` is the
    root mean square of a residual that may be correlated between taxels.
    """
    noise = max(noise, 1e-300)
    residual = np.zeros(len(rest))
    residual[used] = estimator.readings.white(rest[used] / noise, used)
    detail = math.hypot(MODEL_DETAIL, estimator.problem.doubts.stated_gain) * largest / noise
    pairs = estimator.pairs
    if known and ordered and len(pairs[0]):
        both = used[pairs[0]] & used[pairs[1]]
        alike = float((residual[pairs[0]] * residual[pairs[1]])[both].sum()) / max(int(both.sum()), 1)
        if alike <= (ordered / noise) ** 2:
            pairs = pairs[0][:0], pairs[1][:0]
    return misfit_probability(residual, used, pairs, taken=taken, known=known, detail=detail)
