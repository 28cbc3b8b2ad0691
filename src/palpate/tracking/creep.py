"""Remove the pad's creep from the readings of a stream."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.elastic.viscoelastic import CreepFilter
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.readings import Layout, creeping
from palpate.tracking.health import Flags

__all__ = ["Creep"]


class Creep:
    """Removes creep frame by frame. A missing reading counts as unchanged in the memory of its creep.

    ``prony`` are the terms of a `Viscoelastic` pad.
    """

    def __init__(self, prony: Any, layout: Layout, readings: Readings) -> None:
        self._readings, self._creeping = readings, layout.creeping()
        self._filters = [CreepFilter(prony) if creeping(a).any() else None for a in layout.planes]
        self._last_good = np.zeros(len(readings.std))

    def removed(self, flat: Floats, usable: Flags, time: float) -> Floats:
        """Readings (reading,) at ``time`` [s] without creep; NaN if not ``usable``."""
        self._last_good = np.where(usable, flat, self._last_good)
        planes = self._readings.planes(self._last_good)
        elastic = [p if f is None else f.remove(p, time) for p, f in zip(planes, self._filters)]
        return np.where(usable, np.where(self._creeping, self._readings.flat(elastic), flat), math.nan)
