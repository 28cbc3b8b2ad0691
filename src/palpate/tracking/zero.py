"""The zero of the readings: captured from frames without contact, and following drift while there is none."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.zero import FRAMES_FOR_NOISE, far_frames, moved
from palpate.tracking.health import Flags, Index
from palpate.tracking.search import TAKEN

__all__ = ["Zero", "checked_zero"]

#: Largest fraction of the time constant that one frame counts for, however long the pause before it: ten frames must
#: agree on a new zero.
ONE_FRAME = 0.1
#: Remaining weight of a zero whose frames moved at which the note about it ends.
FORGOTTEN = 0.05


def checked_zero(flat: Floats) -> Floats:
    """The readings (reading,) of a given zero; `InvalidInput` if some are not finite."""
    if not np.isfinite(flat).all():
        raise InvalidInput(
            f"the zero holds {np.count_nonzero(~np.isfinite(flat))} values that are not finite: give another frame, or leave "
            "these taxels out (Skin.masked)."
        )
    return flat


class Zero:
    """Baseline of whitened readings.

    ``baseline`` is the zero itself, or None: then it is the mean of the first ``frames`` frames. The zero follows
    drift with ``time_constant`` [s]; None: it stays fixed. ``index`` is the channel of each reading; ``moved`` is
    whether the readings moved while the zero was taken, until drift has replaced that zero.
    """

    def __init__(self, baseline: Floats | None, frames: int, time_constant: float | None, index: Index) -> None:
        self.baseline = None if baseline is None else baseline.copy()
        self._taken = None if baseline is None else baseline.copy()
        self.time_constant = time_constant
        self._frames = frames
        self._captured: list[Floats] = []
        self.shown: Floats = np.zeros(
            (0, 0)
        )  # frames of the last zero less their mean (frame, reading); NaN where missing
        self.variance = 0.0  # of the zero, in units of the noise variance
        self._only: Flags | None = None  # readings whose zero is captured again
        self.moved, self._index, self._left = False, index, 1.0

    @property
    def capturing(self) -> bool:
        """Whether frames are being averaged for the zero."""
        return self.baseline is None or self._only is not None

    @property
    def wandered(self) -> Floats:
        """Change of the zero of each reading since it was taken."""
        if self.baseline is None or self._taken is None:
            return np.zeros(0)
        return np.nan_to_num(self.baseline - self._taken)

    def again(self, frames: int, only: Flags) -> None:
        """Take the zero of some readings again, from the next frames."""
        self._captured, self._frames = [], frames
        if self.baseline is not None:
            self._only = only.copy() if self._only is None else self._only | only

    def shift(self, by: Floats) -> None:
        """Move the zero by a known drift."""
        if self.baseline is not None:
            self.baseline = self.baseline + by

    def capture(self, scaled: Floats) -> float | None:
        """Add a frame to the zero; with the last one, return the noise (standard deviation) if it can be estimated."""
        self._captured.append(scaled)
        if len(self._captured) < self._frames:
            return None
        frames = np.stack(self._captured)
        self._captured = []
        with np.errstate(invalid="ignore"):
            good = np.isfinite(frames)
            far = far_frames(np.where(good, frames, math.nan))
            sought = slice(None) if self._only is None else self._only
            self.moved, self._left = moved(frames[:, sought], self._index[sought]), 1.0
            good &= ~far[:, None]
            count = np.maximum(good.sum(axis=0), 1)
            mean = np.where(good, frames, 0.0).sum(axis=0) / count
            # A reading that never arrived has no zero yet, or keeps its old one.
            old = np.full(len(mean), math.nan) if self.baseline is None else self.baseline
            taken = good.any(axis=0) if self._only is None else good.any(axis=0) & self._only
            self.baseline, self._only = np.where(taken, mean, old), None
            self._taken = np.where(taken, mean, old if self._taken is None else self._taken)
            self.variance = 1.0 / max(len(frames) - int(far.sum()), 1)
            self.shown = np.where(good, frames - mean, math.nan)[~far]
            if self._frames < FRAMES_FOR_NOISE:
                return None
            square = np.where(good, (frames - mean) ** 2, 0.0).sum() / max((count - 1).sum(), 1)
            return math.sqrt(square) if square > 0 else None

    def follow(self, scaled: Floats, elapsed: float, noise: float) -> bool:
        """Follow drift in a frame without contact, ``elapsed`` seconds after the last; return whether the zero follows
        at all.
        """
        if self.baseline is None:
            return False
        good = np.isfinite(scaled)
        unset = good & np.isnan(self.baseline)
        self.baseline[unset] = scaled[unset]
        if self.time_constant is None:
            return False
        # After a long pause, a single noisy frame must not become the zero.
        share = -math.expm1(-min(elapsed / self.time_constant, ONE_FRAME))
        # Drift is slow: a change that would count as contact in one frame is not drift.
        change = np.clip(scaled - self.baseline, -TAKEN * noise, TAKEN * noise)
        self.baseline[good] += share * change[good]
        self._left *= 1.0 - share
        self.moved = self.moved and self._left > FORGOTTEN
        self.variance = (1.0 - share) ** 2 * self.variance + share**2
        return True
