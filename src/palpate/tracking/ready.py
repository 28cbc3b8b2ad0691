"""Prepare before the stream what its first contact would otherwise wait for."""

from __future__ import annotations

import math

import numpy as np

from palpate.inverse.constrained.model import dilated
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.linear.matrix_free.evidence import LinearAtSize
from palpate.inverse.linear.matrix_free.freedom import PER_DECADE
from palpate.tracking.region import NormalEquations

__all__ = ["make_ready"]

#: Noise, as a fraction of the largest reading, of the contact with which a matrix-free model is warmed up: typical of
#: arrays.
NOISE = 0.01
#: Largest parameter that the evidence tries, as a fraction of the largest eigenvalue.
WEAKEST = 100.0


def make_ready(estimator: ConstrainedEstimator, equations: NormalEquations) -> None:
    """Compute what the first contact needs: neighbours, differences, degrees of freedom; load modules."""
    grid, count = estimator.operator.surface, len(estimator.readings.std)
    _ = estimator.pairs, estimator.level(1).differences.laplacian
    equations.shared(np.zeros(count, dtype=bool))
    middle = np.zeros(grid.shape, dtype=bool)
    middle[tuple(n // 2 for n in grid.shape)] = True
    patch = dilated(middle, math.ceil(estimator.depth / min(grid.spacings)))
    if isinstance(estimator.orders[1], LinearAtSize):
        traction = np.zeros((len(estimator.columns), patch.size))
        traction[-1] = patch.ravel()
        readings = estimator.explained_by(traction)
        readings += NOISE * np.abs(readings).max() * np.random.default_rng(0).standard_normal(count)
        found = estimator.start.evidence(estimator.orders[1], estimator.readings.planes(readings), None)
        # A contact begins with a small load, and the penalty is learned repeatedly while it grows. These computations
        # took four fifths of that time.
        freedom = estimator.orders[1].system.freedom
        steps = math.ceil(PER_DECADE * math.log10(max(WEAKEST * freedom.top / found.parameter, 1.0)))
        freedom.of(found.parameter * 10.0 ** (np.arange(steps + 1) / PER_DECADE))
