"""Marginal likelihood of one frame under a linear Gaussian model: what the contact methods start from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate.elastic.half_space import Floats
from palpate.inverse.linear.parameter import choose_parameter, tikhonov
from palpate.inverse.linear.regularised import Decomposition

__all__ = ["LinearEvidence", "linear_evidence"]


class LinearEvidence(NamedTuple):
    """Log marginal likelihood over that of noise alone, parameter, noise scale, and traction (component, *surface) sought."""

    gain: float
    parameter: float
    scale: float
    traction: Floats


def linear_evidence(
    linear: Decomposition, rows: Sequence[Floats], parameter: float | None = None, known: float | None = None
) -> LinearEvidence:
    """Of one frame of readings, with the parameter given or by evidence.

    ``known`` fixes the noise scale (in units of the whitening) where it is not the arrays' own.
    """
    spectrum = linear.spectrum
    values, counts = spectrum.eigenvalues, spectrum.multiplicity
    coefficients = spectrum.project(rows) / (known or 1.0)
    power = np.abs(np.asarray(coefficients)) ** 2
    certain = linear.noise_known or known is not None
    if parameter is None:
        chosen, variance = choose_parameter("evidence", tikhonov, values, counts, power[None], noise_known=certain)
    else:
        chosen = np.array([parameter])
        left = float((counts * power * (1.0 - tikhonov(values, chosen))).sum())
        variance = np.array([1.0 if certain else left / counts.sum()])
    best, scale = float(chosen[0]), math.sqrt(float(variance[0])) * (known or 1.0)
    ratio = values / best
    left, total = float((counts * power / (1.0 + ratio)).sum()), float((counts * power).sum())
    logdet = float(counts @ np.log1p(ratio))
    if total == 0.0:
        gain = 0.0
    elif certain:
        gain = 0.5 * (total - left - logdet)
    else:
        gain = 0.5 * (float(counts.sum()) * math.log(total / left) - logdet)
    phi = tikhonov(values, chosen)
    filtered = coefficients * np.where(values > 0, phi / np.sqrt(np.where(values > 0, values, 1.0)), 0.0)
    traction = np.asarray(spectrum.solve(filtered * (known or 1.0)))
    return LinearEvidence(gain, best, scale, traction[list(linear.columns)])
