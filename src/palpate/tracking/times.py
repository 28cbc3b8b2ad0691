"""Times of frames: uneven, missing, repeated, or from a clock that restarts."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["FrameTime", "FrameTimes"]

#: Smallest time between two frames, as a fraction of the usual one: the creep filter needs increasing time, and a pad
#: does not change in so short a time.
LEAST_STEP = 1e-6


@dataclass(frozen=True)
class FrameTime:
    """Time of a frame [s], time since the one before [s], and whether they are out of order."""

    now: float
    elapsed: float
    before: float | None = None
    restarted: bool = False
    repeated: bool = False


class FrameTimes:
    """Times of the frames of a stream; ``rate`` [1/s] is assumed for frames without a time."""

    def __init__(self, rate: float) -> None:
        self._usual = 1.0 / rate
        self._last: float | None = None
        self.total = 0.0  # time since the first frame [s]; always increasing

    def next(self, time: float | None) -> FrameTime:
        """The time of the next frame; a time before that of the last frame means that the clock restarted."""
        last = self._last
        if time is None:
            frame = FrameTime(0.0 if last is None else last + self._usual, self._usual, last)
        elif last is None:
            frame = FrameTime(float(time), self._usual)
        else:
            now = float(time)
            elapsed = now - last
            restarted = elapsed < 0.0
            frame = FrameTime(now, self._usual if restarted else elapsed, last, restarted, elapsed == 0.0)
        self._last = frame.now
        self.total += max(frame.elapsed, LEAST_STEP * self._usual)
        return frame
