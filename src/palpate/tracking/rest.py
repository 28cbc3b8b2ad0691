"""Statistics of frames without contact: correlated noise, noise of single taxels, drift that the zero does not follow."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.sensing.zero import FRAMES_FOR_NOISE
from palpate.tracking.region import NormalEquations
from palpate.tracking.search import TAKEN

__all__ = ["Rest"]

#: Number of frames kept, and of frames averaged for the level of a score.
KEPT, COUNTED = 32, 200


class Rest:
    """Readings and scores (of every cell, in standard deviations under unit noise) of frames without contact.

    If the noise is independent and known, it is the standard deviation of a score. Noise shared between neighbours
    adds up in a score, and so does that of one noisy taxel. A contact must exceed the scores seen at rest. Scores that
    are large beside their change from frame to frame are no noise, and are not learned from: a press that grows slowly
    would hide itself.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.tracking.rest import Rest
    >>> rest, rng = Rest(), np.random.default_rng(0)
    >>> for _ in range(30):
    ...     rest.look(np.zeros(4), np.array([1.0, 1.0, 5.0]) * rng.standard_normal(3), largest=50.0)
    >>> rest.level(1.0).round().tolist()
    [1.0, 1.0, 4.0]
    """

    def __init__(self) -> None:
        self.frames: list[Floats] = []  # the first ones, minus the zero; NaN if missing
        self._square: Floats | None = None
        self._last: Floats | None = None  # scores of the frame before
        self._steps: Floats | None = None  # half of the mean square of their changes
        self._count = 0

    @classmethod
    def of(cls, frames: Floats, equations: NormalEquations) -> Rest:
        """Statistics of frames (frame, reading) minus their mean; empty if there are too few."""
        out = cls()
        if len(frames) >= FRAMES_FOR_NOISE:
            for y in frames * math.sqrt(len(frames) / (len(frames) - 1)):
                absent = ~np.isfinite(y)
                score = equations.score(equations.adjoint_of(np.where(absent, 0.0, y), absent))
                out.look(y, score, largest=math.inf)
        return out

    def look(self, y: Floats, score: Floats, *, largest: float) -> None:
        """Add a frame: readings minus the zero (NaN if missing), and scores, which are cut off at ``largest``."""
        last, self._last = self._last, score
        if last is not None:
            change = 0.5 * np.minimum(np.abs(score - last), largest) ** 2
            self._steps = change if self._steps is None else self._steps + (change - self._steps) / self._count
        if self._steps is not None and self._count > FRAMES_FOR_NOISE and (score**2 > TAKEN**2 * self._steps).any():
            return
        if len(self.frames) < KEPT and np.isfinite(y).all():
            self.frames.append(y)
        square = np.minimum(np.abs(score), largest) ** 2
        self._count = min(self._count + 1, COUNTED)
        self._square = square if self._square is None else self._square + (square - self._square) / self._count

    def level(self, noise: float) -> Floats:
        """Standard deviation of each cell's score at rest, at least the ``noise``; of shape () before the first frame."""
        return np.asarray(noise if self._square is None else np.maximum(np.sqrt(self._square), noise))
