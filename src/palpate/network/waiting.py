"""Queue between the thread that receives frames and the one that processes them: it is short, and drops the oldest
frames.
"""

from __future__ import annotations

import threading
import time as clock
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from palpate.errors import InvalidInput
from palpate.network.admission import Admission, Limits
from palpate.network.frames import ZERO, zero_from_bytes

__all__ = ["EVENTS", "WAITING", "FrameSource"]

#: Largest number of frames that wait; the oldest are dropped.
WAITING = 8
#: Number of stored log lines about senders.
EVENTS = 100


class FrameSource:
    """Frames of live senders, one sender at a time: the common part of `FrameListener`, `ZenohListener` and the node
    for ROS 2.

    A subclass passes received bytes to `_take`; or it passes messages of another form to ``_admission`` and the
    accepted frames to `_put`. ``report`` and ``zero`` are those of `FrameListener`, and at most ``waiting`` frames
    wait.
    """

    def __init__(
        self,
        shape: Sequence[int],
        *,
        limits: Limits | None = None,
        report: Callable[[str], None] | None = None,
        zero: Callable[[int], None] | None = None,
        waiting: int = WAITING,
    ) -> None:
        self.events: deque[str] = deque(maxlen=EVENTS)
        self.report, self.zero = report, zero
        self._admission = Admission(shape, limits or Limits(), self._report_text)
        self.shape = tuple(self._admission.shape)
        self.counts = self._admission.counts
        self.counts["dropped"] = 0
        self._frames: deque[tuple[int, float, Any]] = deque(maxlen=waiting)
        self._ready = threading.Condition()
        self._open = True

    def __iter__(self) -> Iterator[tuple[float, Any]]:
        """Yield (time [s], readings (channel, *array)) until `close`."""
        for _, time, values in self.frames():
            yield time, values

    def frames(self) -> Iterator[tuple[int, float, Any]]:
        """Yield (session, time [s], readings (channel, *array)) until `close`; the session number increases when a
        sender starts or restarts.
        """
        while True:
            with self._ready:
                self._ready.wait_for(lambda: self._frames or not self._open)
                if not self._frames:
                    return
                found = self._frames.popleft()
            yield found

    @property
    def sender(self) -> str | None:
        """The sender whose frames are accepted."""
        return self._admission.sender

    def close(self) -> None:
        """Receive no more frames: `frames` ends."""
        with self._ready:
            self._open = False
            self._ready.notify_all()

    def _take(self, sender: str, data: bytes) -> str:
        """Process a message and return its outcome."""
        if data[:4] == ZERO and self.zero is not None:
            return self._zeroed(sender, data, self.zero)
        result, found = self._admission.offer(sender, data, clock.monotonic())
        self._put(found)
        return result

    def _zeroed(self, sender: str, data: bytes, zero: Callable[[int], None]) -> str:
        """Process a request for a new zero, which only the current sender may make."""
        now = clock.monotonic()
        if sender != self.sender:
            return self._admission.refuse(
                "busy", sender, now, "only the sender whose frames are accepted can request a new zero"
            )
        try:
            frames = zero_from_bytes(data)
        except InvalidInput as error:
            return self._admission.refuse("malformed", sender, now, str(error).rstrip("."))
        self._report_text(f"{sender} asks for a new zero")
        with self._ready:  # frames sent before the request may show a touch
            self.counts["dropped"] += len(self._frames)
            self._frames.clear()
        zero(frames)
        return "frames"

    def _put(self, frames: Sequence[tuple[int, float, Any]]) -> None:
        """Queue accepted frames."""
        if frames:
            with self._ready:
                for frame in frames:
                    if len(self._frames) == self._frames.maxlen:
                        self.counts["dropped"] += 1
                    self._frames.append(frame)
                self._ready.notify()

    def _report_text(self, text: str) -> None:
        self.events.append(text)
        if self.report is not None:
            self.report(text)
