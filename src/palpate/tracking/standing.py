"""What stands still: readings in which nothing is found, far from 0 all the same (offsets that no zero was taken of), and a contact that hardly changes."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.sensing.zero import FRAMES, STILL
from palpate.tracking.health import Flags

__all__ = ["Standing", "Steady"]

#: A contact that has not changed by a tenth for so long [s] is questioned: drift looks the same.
STEADY, VARIED = 60.0, 0.1
#: Time constant [s] with which what a contact was is remembered.
REMEMBERED = 2.0


class Standing:
    """Whether the readings of frames without contact stand far from 0 for all that they vary from one to the next.

    Noise, too, explains a frame of offsets, because a frame by itself does not tell what stays; that nothing moves does.

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
        """A frame without contact: readings less the zero, in units that channels share."""
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
        """The frame after this one is none that follows the last."""
        self._last = None


class Steady:
    """For how long a contact has hardly changed."""

    def __init__(self) -> None:
        self._time, self._usual = 0.0, math.nan

    def look(self, size: float, elapsed: float) -> list[str]:
        """A frame of a contact of this size, ``elapsed`` seconds after the last one; what is said of it."""
        if math.isnan(self._usual):
            self._usual = size
        self._time += elapsed
        if abs(size - self._usual) > VARIED * self._usual:
            self._time = 0.0
        self._usual += -math.expm1(-elapsed / REMEMBERED) * (size - self._usual)
        if self._time <= STEADY:
            return []
        return [f"steady for {self._time:.0f} s: contact or drift? rezero() where nothing touches"]
