"""Readings at the end of their range: each is a lower bound, and where there are many of them nothing tells how large the load is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.discrepancy import explained
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.observed import ends_of_range
from palpate.inverse.contact.prepared import Prepared

__all__ = ["in_range"]


def in_range(estimator: Prepared, readings: Sequence[Floats], rng: np.random.Generator | None) -> Frame:
    """One frame, whatever part of its readings is at the end of their range.

    Readings at their end are censored: contact explains them where it would have them read as much or more. Where they are many, the frame is also solved
    with the readings as they are. That load is one that the true load exceeds, as every true reading exceeds the one at its end.
    """
    policy = estimator.policy
    data = estimator.readings.flat(estimator.operator.observed(readings))
    ends = ends_of_range(estimator, readings, data)
    if ends is None or not ends.any:
        return explained(estimator, readings, rng)
    # at rest readings of few steps are often alike: an end is far from zero
    far = (
        np.abs(data) > policy.screening.deviations * estimator.readings.std
        if estimator.noise_known
        else np.ones(len(data), dtype=bool)
    )
    at_end = (ends.upper | ends.lower) & far
    count = np.bincount(estimator.noise.index)
    part = float((np.bincount(estimator.noise.index, at_end, len(count)) / count).max())
    if part < policy.screening.open_end:
        return explained(estimator, readings, rng)
    least = explained(estimator.as_they_are(), readings, rng)
    found = least if at_end.all() else explained(estimator, readings, rng)
    push, force = float(np.nansum(least.traction[-1])), estimator.operator.surface.cell
    sign = -1.0 if push < 0 else 1.0
    if not (found.contact and sign * float(np.nansum(found.traction[-1])) >= abs(push)):
        found = least
    bounds = np.full((len(found.traction), 2), math.nan)
    bounds[-1] = (force * push, math.inf) if sign > 0 else (-math.inf, force * push)
    return replace(
        found,
        bounds=bounds,
        overload=bool(least.contact or at_end.all()),
        unexplained=False,
        undecided=False,
        at_limit=at_end,
        nuisance=np.zeros(len(estimator.terms)) if found is least else found.nuisance,
        nuisance_std=np.zeros(len(estimator.terms)) if found is least else found.nuisance_std,
        outliers=np.zeros(len(data), dtype=bool) if found is least else found.outliers,
    )
