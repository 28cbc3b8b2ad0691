"""Constant readings: without contact but far from 0 (offsets for which no zero was taken), and a contact that hardly
changes.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.sensing.zero import FRAMES, STILL
from palpate.tracking.health import Flags

__all__ = ["Standing", "Steady"]

#: A contact whose size changed by less than VARIED for this time [s] is reported: drift looks the same.
STEADY, VARIED = 60.0, 0.1
#: Time constant [s] of the running average of a contact's size.
REMEMBERED = 2.0


class Standing:
    """Whether frames without contact have readings far from 0 that hardly vary between frames.

    A single frame of offsets can be explained by noise, because it does not show what stays constant. Several frames
    do.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.tracking.standing import Standing
    >>> standing, rng = Standing(), np.random.default_rng(0)
    >>> offsets, unused = 500.0 * rng.standard_normal(48), np.zeros(48, dtype=bool)
    >>> for _ in range(10):
    ...     standing.look(offsets + rng.standard_normal(48), unused)
    >>> standing.now
    True
    """

    def __init__(self) -> None:
        self.now = False
        self._last: Floats | None = None
        self._square, self._frames = 0.0, 0

    def look(self, y: Floats, unused: Flags) -> None:
        """Add a frame without contact: readings minus the zero, in a unit common to the channels."""
        last, self._last = self._last, np.where(unused, math.nan, y)
        if last is None:
            return
        steps = self._last - last
        steps = steps[np.isfinite(steps)]
        if not steps.size:
            return
        self._frames += 1
        self._square += (0.5 * float(steps @ steps) / steps.size - self._square) / self._frames
        level = float(np.sqrt(np.nanmean(self._last**2)))
        self.now = self._frames >= FRAMES and level > STILL * math.sqrt(self._square)

    def interrupt(self) -> None:
        """Mark that the next frame does not follow the last one directly."""
        self._last = None


class Steady:
    """Measures for how long a contact has hardly changed."""

    def __init__(self) -> None:
        self._time, self._usual = 0.0, math.nan

    def look(self, size: float, elapsed: float) -> list[str]:
        """Add a frame of a contact of this size, ``elapsed`` seconds after the last one; return notes."""
        if math.isnan(self._usual):
            self._usual = size
        self._time += elapsed
        if abs(size - self._usual) > VARIED * self._usual:
            self._time = 0.0
        self._usual += -math.expm1(-elapsed / REMEMBERED) * (size - self._usual)
        if self._time <= STEADY:
            return []
        return [f"steady for {self._time:.0f} s: contact or drift? rezero() where nothing touches"]
