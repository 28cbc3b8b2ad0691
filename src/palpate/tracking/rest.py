"""What frames without contact show: noise that taxels share, noise of single taxels, drift that the zero does not follow."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.tracking.region import NormalEquations
from palpate.tracking.zero import FRAMES_FOR_NOISE

__all__ = ["Rest"]

#: Frames that are kept, and frames that the level of a score is the mean of.
KEPT, COUNTED = 32, 200


class Rest:
    """The readings and the scores (of every cell, in standard deviations of unit noise) of frames without contact.

    A score of noise that is independent and known has this noise as its standard deviation. Noise that neighbours share adds up in a score, and so does
    that of one taxel that is louder than the others: contact is what exceeds the scores that rest has shown.

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
        self.frames: list[Floats] = []  # the first ones, less the zero; NaN where missing
        self._square: Floats | None = None
        self._count = 0

    @classmethod
    def of(cls, frames: Floats, equations: NormalEquations) -> Rest:
        """Of frames (frame, reading) less their mean; of few they tell nothing."""
        out = cls()
        if len(frames) >= FRAMES_FOR_NOISE:
            for y in frames * math.sqrt(len(frames) / (len(frames) - 1)):
                absent = ~np.isfinite(y)
                score = equations.score(equations.adjoint_of(np.where(absent, 0.0, y), absent))
                out.look(y, score, largest=math.inf)
        return out

    def look(self, y: Floats, score: Floats, *, largest: float) -> None:
        """Take in a frame: readings less the zero (NaN where missing) and scores, which count up to ``largest``."""
        if len(self.frames) < KEPT and np.isfinite(y).all():
            self.frames.append(y)
        square = np.minimum(np.abs(score), largest) ** 2
        self._count = min(self._count + 1, COUNTED)
        self._square = square if self._square is None else self._square + (square - self._square) / self._count

    def level(self, noise: float) -> Floats:
        """Standard deviation of each cell's score at rest, at least the ``noise``; () before there was a frame."""
        return np.asarray(noise if self._square is None else np.maximum(np.sqrt(self._square), noise))
