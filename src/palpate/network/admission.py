"""Admission of frames: one sender at a time, its frames in order.

A sender is an address (UDP) or a connection (TCP, WebSocket). Its frames form a session that begins with its first good frame and has a
clock of its own. Within a session a frame is accepted if its sequence and its time are a little after those of the last one. A frame far from the
last is damaged, or the sender restarted. It waits until `RUN` such frames follow each other, and then all of them start a new session (the rule for
restarted sources in RFC 3550, appendix A.1). Frames a little before the last are late or copies, unless `LATE_RUN` of them follow each other with
none of the session between: then the sender restarted soon after its start.

Frames of two senders never mix. A second one is refused until the first has been silent for a while, several times its own interval.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from palpate._numbers import plain_time
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.network.frames import HEAD, MAGIC, frame_from_bytes, is_big_endian

__all__ = ["REFUSALS", "Admission", "Limits"]

#: Frames out of their order that must follow each other before they are a new beginning.
RUN = 3
#: The same for frames a little before the last, several of which may arrive out of order.
LATE_RUN = 20
#: How far the sequence may be ahead (frames lost) or behind (frames late); ahead also by `FASTEST` a second of silence.
AHEAD, BEHIND, FASTEST = 1000, 1000, 10_000
#: How far the time may be ahead [s], besides the silence and some of the steps before.
LEAP, STEPS = 10.0, 10.0
#: A sender is silent after this many of its intervals without a frame, or at most after so long [s].
INTERVALS, LONGEST = 5.0, 60.0
#: Senders that were served before and are remembered, so that two slow ones do not take turns for ever.
REMEMBERED = 64
#: One kind of refusal is put into words at most so often [s].
PAUSE = 10.0

#: Reasons to refuse a frame or a connection.
REFUSALS = (
    "malformed", "big-endian", "oversized", "shape", "late", "jump", "busy", "slow", "crowded",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How patient a listener is; times in seconds.

    ``quiet``: silence after which another sender is served. ``hold``: a connection refused for so long because another is served is told
    so and closed. ``hello``: for the first frame of a connection. ``stall``: for a frame that has begun. ``idle``: for the next frame of
    a connection. ``connections``: at the same time; one more closes the oldest that is not served.

    Examples
    --------
    >>> from palpate.network import Limits
    >>> Limits(quiet=0.5).quiet
    0.5
    """

    quiet: float = 1.0
    hold: float = 2.0
    hello: float = 10.0
    stall: float = 10.0
    idle: float = 300.0
    connections: int = 16

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, bool) or not (isinstance(value, int | float) and math.isfinite(value) and value > 0):
                raise InvalidInput(f"{one.name} must be a positive number; got {value!r}.")
        if self.connections < 2 or self.connections != int(self.connections):
            raise InvalidInput(f"connections must be a whole number from 2 on; got {self.connections!r}.")


@dataclass
class _Run:
    """Frames that follow each other, but not the session."""

    name: str
    sequence: int
    time: float
    values: list[tuple[float, Any]]
    count: int = 1


@dataclass
class _Session:
    """A sender's frames since it began."""

    sender: str
    number: int
    sequence: int
    time: float
    last: float
    interval: float = 0.0
    step: float = 0.0
    run: _Run | None = None


@dataclass
class Admission:
    """Decides frame by frame; ``now`` is the listener's own clock, which only goes forward.

    Parameters
    ----------
    shape : sequence of int
        (channel, *array) of a frame.
    limits : Limits
    report : callable
        Called with a sentence on each event.

    Attributes
    ----------
    counts : dict
        "frames" accepted, "sessions" started, and refusals by reason (`REFUSALS`).

    Examples
    --------
    >>> from palpate.network import Admission, Limits, frame_bytes
    >>> words = []
    >>> admission = Admission([1, 3], Limits(), words.append)
    >>> what, frames = admission.offer("driver", frame_bytes(0, 0.5, [[1.0, 2.0, 3.0]]), now=0.0)
    >>> what, [(time, values.tolist()) for _, time, values in frames], admission.sender
    ('frames', [(0.5, [[1.0, 2.0, 3.0]])], 'driver')

    >>> admission.offer("another", frame_bytes(0, 0.5, [[1.0, 2.0, 3.0]]), now=0.1)[0]
    'busy'

    >>> admission.refuse("crowded", "a third", 0.2, "too many connections")
    'crowded'
    >>> admission.gone("driver")
    >>> admission.offer("another", frame_bytes(1, 0.6, [[1.0, 2.0, 3.0]]), now=0.3)[0]
    'frames'

    >>> admission.counts["sessions"]
    2
    """

    shape: Sequence[int]
    limits: Limits = field(default_factory=Limits)
    report: Callable[[str], None] = field(default=lambda text: None)

    def __post_init__(self) -> None:
        self.shape = tuple(int(n) for n in self.shape)
        if len(self.shape) not in (2, 3) or min(self.shape) < 1:
            raise InvalidInput(f"shape must be (channel, taxel) or (channel, y, x); got {self.shape}.")
        #: (channel, row, column) as a frame states them: taxels without rows are one row
        self.wire = self.shape if len(self.shape) == 3 else (self.shape[0], 1, self.shape[1])
        self.largest = HEAD.size + 4 * math.prod(self.wire)
        self.counts = dict.fromkeys(("frames", "sessions", *REFUSALS), 0)
        self._session: _Session | None = None
        self._before: dict[str, int] = {}
        self._reported: dict[str, float] = {}

    @property
    def sender(self) -> str | None:
        """Who is served."""
        return None if self._session is None else self._session.sender

    def offer(self, sender: str, data: bytes, now: float) -> tuple[str, list[tuple[int, float, Floats]]]:
        """The outcome of a message ("frames" or one of `REFUSALS`), and the accepted frames (session, time [s], readings)."""
        if len(data) > self.largest:
            text = f"{len(data)} bytes came, a frame has {self.largest}{_states(data)}"
            return self.refuse("oversized", sender, now, text), []
        try:
            sequence, time, values = frame_from_bytes(data)
        except InvalidInput as error:
            name = "big-endian" if is_big_endian(data) else "malformed"
            return self.refuse(name, sender, now, str(error).rstrip(".")), []
        if values.shape != self.wire:
            text = f"a frame of {_times(values.shape)} came, {_times(self.wire)} (channel x row x column) is expected"
            return self.refuse("shape", sender, now, text), []
        return self.take(sender, sequence, time, values.reshape(tuple(self.shape)), now)

    def take(
        self, sender: str, sequence: int, time: float, values: Any, now: float
    ) -> tuple[str, list[tuple[int, float, Any]]]:
        """The same of a frame that has been read already; ``values`` are handed on as they are.

        Examples
        --------
        >>> from palpate.network import Admission, Limits
        >>> Admission([1, 3], Limits(), [].append).take("driver", 0, 0.5, "a frame", now=0.0)
        ('frames', [(1, 0.5, 'a frame')])
        """
        session = self._session
        if session is None or sender != session.sender:
            if session is not None and now - session.last < self._patience(session):
                text = f"{session.sender} is being served, and one sender at a time is; let each send from one socket"
                return self.refuse("busy", sender, now, text), []
            return "frames", self._begin(sender, sequence, [(time, values)], now)
        return self._next(session, sequence, time, values, now)

    def gone(self, sender: str) -> None:
        """A connection has ended: the next sender is served at once."""
        if self._session is not None and self._session.sender == sender:
            self._session = None
            self.report(f"sender {sender} left")

    def refuse(self, name: str, sender: str, now: float, why: str) -> str:
        """Count a refusal, and report it at a limited rate."""
        self.counts[name] += 1
        if now - self._reported.get(name, -math.inf) >= PAUSE:
            self._reported[name] = now
            self.report(f"sender {sender} refused ({name}): {why}")
        return name

    def _patience(self, session: _Session) -> float:
        turns = self._before.get(session.sender, 0)
        return min(LONGEST, max(self.limits.quiet, INTERVALS * session.interval) * 2.0 ** min(turns, 10))

    def _next(
        self, session: _Session, sequence: int, time: float, values: Any, now: float
    ) -> tuple[str, list[tuple[int, float, Any]]]:
        ahead, silent, step = (sequence - session.sequence) % 2**32, now - session.last, time - session.time
        if 0 < ahead <= AHEAD + FASTEST * silent and 0 < step <= LEAP + silent + STEPS * session.step:
            session.interval += 0.1 * (silent - session.interval) if session.interval else silent
            session.step = max(step, 0.9 * session.step)
            session.sequence, session.time, session.last, session.run = sequence, time, now, None
            self.counts["frames"] += 1
            return "frames", [(session.number, time, values)]
        behind = (session.sequence - sequence) % 2**32
        near = step == 0 or (behind <= BEHIND and step < 0 and silent < self._patience(session))
        name = "late" if near else "jump"
        run = session.run
        if run is not None and run.name == name and 0 < (sequence - run.sequence) % 2**32 <= AHEAD and time > run.time:
            run.sequence, run.time, run.count = sequence, time, run.count + 1
            run.values = [*run.values, (time, values)][-RUN:]
        else:
            session.run = run = _Run(name, sequence, time, [(time, values)])
        if run.count < (LATE_RUN if near else RUN):
            how = "is not after" if near else "is far from"
            text = (
                f"sequence {sequence} at {plain_time(time)} s {how} {session.sequence} at {plain_time(session.time)} s"
            )
            return self.refuse(name, session.sender, now, text), []
        # those that are taken now were refused while they could have been damage
        self.counts[name] -= len(run.values) - 1
        return "frames", self._begin(session.sender, sequence, run.values, now)

    def _begin(
        self, sender: str, sequence: int, values: list[tuple[float, Any]], now: float
    ) -> list[tuple[int, float, Any]]:
        old, time = self._session, values[-1][0]
        self.counts["sessions"] += 1
        self.counts["frames"] += len(values)
        number = self.counts["sessions"]
        step = time - values[-2][0] if len(values) > 1 else 0.0
        self._session = _Session(sender, number, sequence, time, now, step=step)
        if old is None:
            self.report(f"sender {sender} is served")
        elif old.sender == sender:
            self._session.interval = old.interval
            self.report(
                f"sender {sender} began again: sequence {sequence} at {plain_time(time)} s after {old.sequence} at {plain_time(old.time)} s"
            )
        else:
            self._before[old.sender] = self._before.pop(old.sender, 0)
            if sender in self._before:
                self._before[sender] += 1
            while len(self._before) > REMEMBERED:
                del self._before[next(iter(self._before))]
            self.report(f"sender {sender} is served: {old.sender} was silent for {now - old.last:.1f} s")
        return [(number, time, one) for time, one in values]


def _times(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))


def _states(data: bytes) -> str:
    """The shape that the header of a frame states."""
    try:
        magic, _, _, *shape = HEAD.unpack_from(data)
    except struct.error:
        return ""
    return f"; it says {_times(shape)}" if magic == MAGIC else ""
