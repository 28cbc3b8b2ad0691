"""An even press that grows as slowly as drift, so that the zero follows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.no_contact import WIDE
from palpate.inverse.estimate import Errors
from palpate.tracking.search import LOST

__all__ = ["SlowPress"]

#: Number of undetectable standard deviations at which drift is reported.
DRIFTED = 10.0


class SlowPress:
    """Net force of an even pressure over the array that would look like the drift of the readings."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        inside = estimator.inside.ravel().astype(np.float64)
        traction = np.zeros((len(estimator.columns), inside.size))
        traction[-1] = inside
        self._readings = estimator.explained_by(traction) / estimator.readings.std  # of 1 Pa
        self._area = float(inside @ estimator.operator.surface.areas.ravel())
        self._unit = "N/m" if estimator.operator.surface.dimensions == 1 else "N"

    def room(self, errors: Errors, drift: Floats, noise: float) -> tuple[Errors, list[str]]:
        """Errors of a frame without contact, widened for such a press, and notes; ``drift`` (reading,) is the change
        of the zero since it was taken.
        """
        size = max(float(np.linalg.norm(self._readings)), 1e-300)
        along = abs(float(drift @ self._readings)) / size
        if along <= LOST * noise:
            return errors, []
        force = along / size * self._area
        said = []
        if force > DRIFTED * float(errors.force[-1]):
            said.append(
                f"the zero has followed a drift of the readings, as large as that of an even press of {force:.2g} {self._unit}: "
                "take a new zero while nothing touches (Z on the page, Tracker.rezero)"
            )
        last = np.arange(len(errors.force)) == len(errors.force) - 1
        return replace(errors, force=np.hypot(errors.force, np.where(last, force / WIDE, 0.0))), said
