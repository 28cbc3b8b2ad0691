"""Remove outliers of an explanation before it is solved."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.rough import rough
from palpate.inverse.contact.score import gain_of
from palpate.inverse.contact.screening import loads_above, shallow
from palpate.inverse.fit import rms

__all__ = ["loaded_above", "without_outliers"]

Flags = npt.NDArray[np.bool_]


def without_outliers(
    estimator: PreparedContact, h: Explanation, data: Floats, observed: Flags
) -> tuple[Explanation, Flags]:
    """The explanation solved without outliers, and the mask of the readings used. Outliers are removed one at a time,
    worst first; on a large array, where each solution takes long, with all that are nearly as bad.
    """
    policy = estimator.policy
    readings, n = estimator.readings, len(data)
    if h.sign == 0 or not h.rough.traction[-1].any():
        return h, observed
    clean = h.sign * (data - estimator.shifts @ h.sizes)
    counted = observed.copy()
    total = rms(readings.whitened(clean, counted))
    best = h.rough
    for _ in range(max(int(policy.screening.most * observed.sum()), 1)):
        size = np.abs(clean) / readings.std
        others = np.where(counted & ~estimator.outermost, size, 0.0).max(initial=0.0)
        residual = np.where(counted, np.abs(clean - best.explained) / readings.std, 0.0)
        may = ~estimator.outermost | (size > policy.screening.outermost * others)
        if estimator.large:
            around = policy.screening.outermost_alone * _of_neighbours(residual, estimator)
            may |= ~shallow(estimator.operator.planes_of, policy) & (residual > around)
        residual = np.where(may, residual, 0.0)
        worst = int(np.argmax(residual))
        largest = float(np.abs(best.explained / readings.std).max(initial=0.0))
        # An outlier among n readings raises the residual to its own size over sqrt(n). With few readings it inflates
        # the noise that is used to judge it.
        part = 1.0 if estimator.at_size else policy.screening.examined
        limit = max(part * policy.screening.deviations * best.left, policy.screening.gross * largest)
        if not residual[worst] > limit or loaded_above(estimator, worst, clean - best.explained, counted):
            break
        fewer = counted.copy()
        fewer[_like_the_worst(residual, limit, estimator) if estimator.large else worst] = False
        start = best.left if h.noise is None and estimator.noise_known else h.noise
        left_out = int(counted.sum() - fewer.sum())
        filled = np.where(fewer, clean, best.explained)
        found = rough(estimator, filled, fewer, total, estimator.shifts[:, h.present], start, best.traction)
        floor = max(found.left, estimator.least_noise(data))
        if not (
            gain_of(found.free, max(best.left, floor), floor) > left_out * (policy.screening.broken + math.log(n))
            and abs(clean[worst] - found.explained[worst]) / readings.std[worst] > policy.screening.deviations * floor
        ):
            break
        counted, best = fewer, found
    return replace(h, rough=best), counted


def loaded_above(estimator: PreparedContact, place: int, residual: Floats, observed: Flags) -> bool:
    """Whether more load above the taxel of a reading would lower the squared residual nearly as much as leaving the
    reading out: then it is contact that coarse cells cannot follow.
    """
    policy, readings = estimator.policy, estimator.readings
    left = readings.whitened(residual, observed)
    without = abs(residual[place]) / readings.std[place]
    most = 0.0
    c = len(estimator.columns)
    for i, load in enumerate(loads_above(estimator.operator, estimator.columns, readings, place, policy)):
        column = readings.whitened(load, observed)
        part = float(column @ left) / max(float(np.linalg.norm(column)), 1e-300)
        most = max(most, part if i % c == c - 1 else abs(part))  # pressure only pushes
    return most**2 > policy.screening.explained * without**2


def _like_the_worst(residual: Floats, limit: float, estimator: PreparedContact) -> Flags:
    """Mask of the readings whose residuals are beyond the limit and at least half the largest. Of neighbours only the
    worse: its residual is also seen in theirs.
    """
    half = estimator.policy.screening.beside_largest * float(residual.max())
    return np.asarray((residual > limit) & (residual >= half) & (residual >= _of_neighbours(residual, estimator)))


def _of_neighbours(residual: Floats, estimator: PreparedContact) -> Floats:
    """The largest residual among the neighbours of each reading."""
    largest = np.zeros_like(residual)
    for i, j in (estimator.pairs, estimator.pairs[::-1]):
        np.maximum.at(largest, i, residual[j])
    return largest
