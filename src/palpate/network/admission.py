"""Decide which frames to accept: those of one sender at a time, in order.

A sender is an address (UDP) or a connection (TCP, WebSocket). Its frames form a session that begins with its first
valid frame and has its own clock. Within a session a frame is accepted if its sequence number and its time are
slightly later than those of the last one. A frame far from the last is damaged, or the sender restarted: such frames
are held back until `RUN` of them follow each other, and then all of them start a new session (the rule for restarted
sources in RFC 3550, appendix A.1). Frames slightly before the last are late or copies, unless `LATE_RUN` of them
follow each other without any of the session between: then the sender restarted soon after its start.

Frames of two senders never mix. A second sender is refused until the first has been silent for several times its own
interval.
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

#: Number of consecutive frames out of order that start a new session.
RUN = 3
#: The same number for frames slightly before the last, because several may arrive out of order.
LATE_RUN = 20
#: Largest jump of the sequence number ahead (lost frames) and behind (late frames); FASTEST is added to AHEAD for each
#: second of silence.
AHEAD, BEHIND, FASTEST = 1000, 1000, 10_000
#: Largest jump ahead of the time [s], in addition to the silence, and in multiples of the previous interval.
LEAP, STEPS = 10.0, 10.0
#: A sender counts as silent after this many of its intervals without a frame, and at the latest after LONGEST [s].
INTERVALS, LONGEST = 5.0, 60.0
#: Number of earlier senders that are remembered, so that two slow ones do not alternate for ever.
REMEMBERED = 64
#: Shortest time [s] between two messages about the same kind of refusal.
PAUSE = 10.0

#: Reasons to refuse a frame or a connection.
REFUSALS = (
    "malformed", "big-endian", "oversized", "shape", "late", "jump", "busy", "slow", "crowded",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Time limits of a listener [s].

    ``silence``: time without frames after which another sender is accepted. ``hold``: time after which a refused
    connection gets a message and is closed. ``hello``: time for the first frame of a connection. ``stall``: time for a
    frame that has begun. ``idle``: time for the next frame of a connection. ``connections``: largest number of
    connections; if one more arrives, the oldest that is not accepted is closed.

    Examples
    --------
    >>> from palpate.network import Limits
    >>> Limits(silence=0.5).silence
    0.5
    """

    silence: float = 1.0
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
    """Consecutive frames that do not belong to the current session."""

    name: str
    sequence: int
    time: float
    values: list[tuple[float, Any]]
    count: int = 1


@dataclass
class _Session:
    """The frames of a sender since it started."""

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
    """Decides about each frame; ``now`` is the listener's own clock, which never goes back.

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
        #: (channel, row, column) as a frame states it: taxels without rows count as one row
        self.wire = self.shape if len(self.shape) == 3 else (self.shape[0], 1, self.shape[1])
        self.largest = HEAD.size + 4 * math.prod(self.wire)
        self.counts = dict.fromkeys(("frames", "sessions", *REFUSALS), 0)
        self._session: _Session | None = None
        self._before: dict[str, int] = {}
        self._reported: dict[str, float] = {}

    @property
    def sender(self) -> str | None:
        """The sender whose frames are accepted."""
        return None if self._session is None else self._session.sender

    def offer(self, sender: str, data: bytes, now: float) -> tuple[str, list[tuple[int, float, Floats]]]:
        """Return the outcome of a message ("frames" or one of `REFUSALS`), and the accepted frames (session, time [s],
        readings).
        """
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
        """Do the same as `offer` for a frame that is decoded already; ``values`` are returned unchanged.

        Examples
        --------
        >>> from palpate.network import Admission, Limits
        >>> Admission([1, 3], Limits(), [].append).take("driver", 0, 0.5, "a frame", now=0.0)
        ('frames', [(1, 0.5, 'a frame')])
        """
        session = self._session
        if session is None or sender != session.sender:
            if session is not None and now - session.last < self._patience(session):
                text = f"one sender is accepted at a time, now {session.sender}; each sender must use a single socket"
                return self.refuse("busy", sender, now, text), []
            return "frames", self._begin(sender, sequence, [(time, values)], now)
        return self._next(session, sequence, time, values, now)

    def gone(self, sender: str) -> None:
        """Note that a connection has ended; the next sender is then accepted at once."""
        if self._session is not None and self._session.sender == sender:
            self._session = None
            self.report(f"sender {sender} left")

    def refuse(self, name: str, sender: str, now: float, why: str) -> str:
        """Count a refusal, and report it unless one of its kind was reported recently."""
        self.counts[name] += 1
        if now - self._reported.get(name, -math.inf) >= PAUSE:
            self._reported[name] = now
            self.report(f"sender {sender} refused ({name}): {why}")
        return name

    def _patience(self, session: _Session) -> float:
        turns = self._before.get(session.sender, 0)
        return min(LONGEST, max(self.limits.silence, INTERVALS * session.interval) * 2.0 ** min(turns, 10))

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
        # these frames were counted as refused while they could have been damaged: they are accepted now
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
    """Return the shape that the header of a frame states."""
    try:
        magic, _, _, *shape = HEAD.unpack_from(data)
    except struct.error:
        return ""
    return f"; it says {_times(shape)}" if magic == MAGIC else ""
