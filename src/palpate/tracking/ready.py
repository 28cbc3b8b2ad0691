"""What the first contact of a stream would wait for, done before the stream."""

from __future__ import annotations

import math

import numpy as np

from palpate.inverse.constrained.model import dilated
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.linear.matrix_free.evidence import LinearAtSize
from palpate.inverse.linear.matrix_free.freedom import PER_DECADE
from palpate.tracking.region import NormalEquations

__all__ = ["make_ready"]

#: Noise of the contact that a matrix-free linear model is tried on, as a part of the largest reading: usual arrays have about so much.
NOISE = 0.01
#: The largest parameter that evidence tries, as a part of the largest eigenvalue.
WEAKEST = 100.0


def make_ready(estimator: ConstrainedEstimator, equations: NormalEquations) -> None:
    """Work out what all frames share and the first one in contact needs: neighbours, differences, degrees of freedom; modules are loaded."""
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
        found = estimator.evidence(estimator.orders[1], estimator.readings.planes(readings), None)
        # a contact comes with little load and little told of it, and the penalty is learned again and again while it grows: four in five of the
        # milliseconds of that were these
        freedom = estimator.orders[1].system.freedom
        steps = math.ceil(PER_DECADE * math.log10(max(WEAKEST * freedom.top / found.parameter, 1.0)))
        freedom.of(found.parameter * 10.0 ** (np.arange(steps + 1) / PER_DECADE))
