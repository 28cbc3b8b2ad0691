"""Times of frames: uneven, missing, repeated, or from a clock that begins anew."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["AFTER_RESTART", "FrameTime", "FrameTimes"]

#: Frames after a clock that went back in which the zero may have jumped with it.
AFTER_RESTART = 10
#: Least time between two frames, as a part of the usual one: the memory of creep needs time that increases. Nothing in a pad
#: changes in so little of a frame.
LEAST_STEP = 1e-6


@dataclass(frozen=True)
class FrameTime:
    """Time of a frame [s], time since the one before [s], and how they are out of order."""

    now: float
    elapsed: float
    before: float | None = None
    restarted: bool = False
    repeated: bool = False


class FrameTimes:
    """Times of the frames of a stream; ``rate`` [1/s] is that of frames that come without a time."""

    def __init__(self, rate: float) -> None:
        self._usual = 1.0 / rate
        self._last: float | None = None
        self.total = 0.0  # time that has passed since the first frame [s]; it increases always

    def next(self, time: float | None) -> FrameTime:
        """The next frame; a time before that of the last frame is a clock that has begun anew."""
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
