"""Error bars of a stream, made anew when the contact has changed."""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import FAINT, ConstrainedEstimator
from palpate.inverse.estimate import Errors
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.tracking.background import Background
from palpate.tracking.health import Flags
from palpate.tracking.iteration import Iteration

__all__ = ["ErrorBars"]

#: Error bars are made again after so many frames (a second at 200 Hz), or when the number of cells in contact has changed by this
#: part: the standard deviation of a force goes about with the square root of it, by an eighth.
REFRESH, CHANGED = 200, 0.25


class ErrorBars:
    """The errors of the present contact, or of a frame without one."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._estimator = estimator
        self._no_contact: tuple[float, Errors] | None = None
        self._age, self._cells = 0, 0
        self.errors: Errors | None = None

    def clear(self) -> None:
        """The contact has ended."""
        self.errors = None

    def outdate(self) -> None:
        """Make them again at the next frame: noise or penalty are others."""
        self._age = REFRESH + 1

    def without_contact(self, noise: float | None) -> Errors | None:
        """Errors of a frame without contact: what would not be detected."""
        if noise is None:
            return self.errors
        if self._no_contact is None or self._no_contact[0] != noise:
            self._no_contact = noise, self._estimator.undetected(noise)
        return self._no_contact[1]

    def refresh(self, solution: Iteration, y: Floats, noise: float, unused: Flags, background: Background) -> None:
        """Make them again where they are old, or the contact is another."""
        region, estimator = solution.region, self._estimator
        if region is None:
            return
        pressure = solution.pressure
        contact = pressure > FAINT * float(pressure.max(initial=0.0))
        count = int(contact.sum())
        self._age += 1
        stale = self.errors is None or self._age > REFRESH
        changed = abs(count - self._cells) > CHANGED * max(self._cells, 1)
        if count == 0 or (not (stale or changed) and "errors" not in background):
            return
        cells = region.cells[contact]
        start = solution.traction[:, contact]
        observed = ~unused
        std = max(noise, MODEL_ERROR * float(np.abs(y).max()))
        weight = region.parameter / noise**2 if noise > 0 else 0.0

        def work() -> tuple[Errors, int]:
            level = estimator.level(1)
            data = estimator.normal(level, cells, y / std, estimator.readings.std * std, observed)
            model = estimator.model(data, estimator.precisions(level, 1, weight), start, keep_face=True)
            model.weight = 1.0
            return estimator.summed_up([model])[1], len(cells)

        found = background.result("errors", work)
        if found is not None:
            self.errors, self._cells = found
            self._age = 0
