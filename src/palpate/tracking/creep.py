"""Remove the pad's creep from the readings of a stream."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.elastic.viscoelastic import CreepFilter
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.readings import Layout
from palpate.tracking.health import Flags

__all__ = ["Creep", "creep_filters"]


def creep_filters(prony: Any, creeps: Sequence[bool]) -> list[CreepFilter | None]:
    """One creep filter per plane; None for a plane that does not creep."""
    return [CreepFilter(prony) if c else None for c in creeps]


class Creep:
    """Removes creep frame by frame. A missing reading counts as unchanged in the memory of its creep."""

    def __init__(self, filters: list[CreepFilter | None], layout: Layout, readings: Readings) -> None:
        self._filters, self._readings, self._creeping = filters, readings, layout.creeping()
        self._last_good = np.zeros(len(readings.std))

    def removed(self, flat: Floats, usable: Flags, time: float) -> Floats:
        """Readings (reading,) at ``time`` [s] without creep; NaN if not ``usable``."""
        self._last_good = np.where(usable, flat, self._last_good)
        planes = self._readings.planes(self._last_good)
        elastic = [p if f is None else f.remove(p, time) for p, f in zip(planes, self._filters)]
        return np.where(usable, np.where(self._creeping, self._readings.flat(elastic), flat), math.nan)
