"""What a pushing contact would leave of a frame if its penalty were another."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.tracking.health import Index
from palpate.tracking.iteration import Iteration
from palpate.tracking.region import NormalEquations
from palpate.tracking.search import Search

__all__ = ["residual_by_penalty"]


def residual_by_penalty(
    estimator: ConstrainedEstimator,
    equations: NormalEquations,
    search: Search,
    y: Floats,
    noise: float,
    cells: Index | None,
    tolerance: float,
) -> Callable[[float], float]:
    """A function from penalty to the residual of pushing contact: root mean square per degree of freedom.

    ``cells`` are those of the contact; None: those where it would be sought first. All cells might leave a smaller
    residual, but would take a hundred times as long.
    """
    nothing = np.zeros(len(y), dtype=bool)

    def pushed(parameter: float) -> tuple[Floats, Floats]:
        """Pressure, and the readings that it explains."""
        slope, here = equations.adjoint_of(y, nothing), cells
        if here is None:
            here = search.scored(equations.score(slope) / noise)
            if search.many(len(here)):
                return search.rough(y, noise, nothing, parameter)
        trial = Iteration(estimator.cone, len(estimator.columns), math.prod(estimator.operator.surface.shape))
        trial.move(equations.region(here, parameter, nothing))
        give_way()
        trial.solve(slope, tolerance=tolerance, deadline=math.inf)
        return trial.pressure, equations.explained(here, trial.traction)

    def residual_rms(parameter: float) -> float:
        pressure, explained = pushed(parameter)
        residual = estimator.readings.white(y - explained, ~nothing)
        free = max(len(residual) - estimator.taken(pressure, parameter), 1.0)
        return math.sqrt(float(residual @ residual) / free)

    return residual_rms
