"""Convert messages of a topic to frames: read by the mapping, from one publisher at a time, in order, with the stamps
for the results.

Each publisher has an identifier, and each frame a sequence number from the middleware. From these,
`palpate.network.admission` decides which frames to accept, as it does for frames from the network. A publisher that is
killed and restarted is a new one: it is accepted when the first has left the graph, or has been silent for a while.
"""

from __future__ import annotations

import math
import time as clock
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.network.admission import Limits
from palpate.network.waiting import WAITING, FrameSource
from palpate.recordings import TopicMapping
from palpate.recordings.clock import LiveClock
from palpate.sensing.times import LATEST

__all__ = ["Header", "Intake", "readings_of"]

#: Shortest time between two queries of the list of publishers [s].
LOOK = 0.1
#: Largest number of remembered publishers.
REMEMBERED = 64


@dataclass(frozen=True)
class Header:
    """When a frame was taken by the clock of ROS [ns], in which frame of reference, and when it arrived by this
    machine's steady clock [ns].
    """

    stamp: int
    frame: str
    came: int


def readings_of(mapping: TopicMapping, shape: Sequence[int], message: Any) -> Floats:
    """Return the readings (channel, *array) of a message; raise `InvalidInput` if it does not match its description."""
    try:
        values = mapping.readings(message)
    except InvalidInput:
        raise
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"{mapping.topic}: a message does not hold numbers where they should be ({error})."
        ) from error
    wanted = tuple(shape)
    if len(wanted) == 2 and values.ndim == 3 and values.shape[1] == 1:
        values = values[:, 0]
    if values.shape != wanted:
        raise InvalidInput(
            f"{mapping.topic}: a message holds {_times(values.shape)} numbers, the skin describes {_times(wanted)} (channel x taxels)."
        )
    return values


class Intake(FrameSource):
    """Frames from the messages of a topic.

    Parameters
    ----------
    mapping : TopicMapping
        Layout of the messages.
    shape : sequence of int
        (channel, *array) that the skin describes.
    now : callable
        The clock of ROS [ns], or of a simulation if there is one.
    rest : array (channel, marker), optional
        Positions of the markers at rest; without them the first message gives them if ``mapping.markers``.
    publishers : callable, optional
        Names of the publishers that there are, by their identifiers in hexadecimal digits.
    limits : Limits, optional
        Time limits, such as how long a publisher may be silent until another is accepted.
    waiting : int
        Messages that wait to be read, at most.

    Attributes
    ----------
    counts : dict
        As of a `FrameListener`; and "messages" that came, and "lost" ones, which publishers sent and the middleware did not deliver.
    header : Header
        Header of the frame that was returned last.
    """

    def __init__(
        self,
        mapping: TopicMapping,
        shape: Sequence[int],
        *,
        now: Callable[[], int],
        rest: Floats | None = None,
        publishers: Callable[[], dict[str, str]] | None = None,
        limits: Limits | None = None,
        waiting: int = WAITING,
    ) -> None:
        super().__init__(shape, limits=limits, waiting=waiting)
        self.counts.update(messages=0, lost=0)
        self.header = Header(0, "", 0)
        self._mapping, self._now, self._rest = mapping, now, rest
        self._publishers = publishers
        self._keys: dict[str, str] = {}
        self._looked = -math.inf
        self._sequences: dict[str, int] = {}
        self._counted = 0
        self._clock = LiveClock()

    def frames(self) -> Iterator[tuple[int, float, Any]]:
        """Yield (session, time [s], readings); `header` is that of the frame. Messages are decoded here, so that
        dropped ones cost nothing.
        """
        for session, time, (message, header, sender) in super().frames():
            try:
                values = readings_of(self._mapping, self._admission.shape, message)
            except InvalidInput as error:
                self.counts["frames"] -= 1
                self._admission.refuse("malformed", sender, clock.monotonic(), str(error).rstrip("."))
                continue
            if self._mapping.markers:
                self._rest = values if self._rest is None else self._rest
                values = values - self._rest
            self.header = header
            yield session, time, values

    def take(self, message: Any, info: Any = None) -> str:
        """Decide about a message by its publisher and stamp, and return the outcome ("frames", or a reason for
        refusal); ``info`` comes from rclpy.
        """
        came, now = clock.monotonic_ns(), clock.monotonic()
        self.counts["messages"] += 1
        said = info if isinstance(info, dict) else {}
        sender = self._key(bytes((said.get("publisher_gid") or {}).get("data", b"")))
        sequence = said.get("publication_sequence_number")
        self._counted += 1
        if sequence is None:
            sequence = self._counted
        else:
            self._count_lost(sender, int(sequence))
        try:
            time, header = self._times(message, came)
        except InvalidInput as error:
            return self._admission.refuse("malformed", sender, now, str(error).rstrip("."))
        frame = (message, header, sender)
        result, found = self._admission.take(sender, int(sequence), time, frame, now)
        if result == "busy" and self._left(now):
            result, found = self._admission.take(sender, int(sequence), time, frame, now)
        self._put(found)
        return result

    def _times(self, message: Any, came: int) -> tuple[float, Header]:
        """Return the frame's time [s], and the header for its result."""
        now = self._now()
        header = getattr(message, "header", None)
        stamp = getattr(header, "stamp", None)
        taken = 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)
        said = self._mapping.time(message, now / 1e9) if self._mapping.stamp else max(taken, 0) / 1e9
        if not abs(said) <= LATEST:
            raise InvalidInput(f"{self._mapping.topic}: {self._mapping.stamp} is {said}, which is no time.")
        time = self._clock.next(said, now / 1e9)
        return time, Header(taken if taken > 0 else now, str(getattr(header, "frame_id", "")), came)

    def _count_lost(self, publisher: str, sequence: int) -> None:
        last = self._sequences.get(publisher)
        if last is not None and sequence > last + 1:
            self.counts["lost"] += sequence - last - 1
        elif last is None and len(self._sequences) >= REMEMBERED:
            del self._sequences[next(iter(self._sequences))]
        self._sequences[publisher] = sequence

    def _report_text(self, text: str) -> None:
        """Report a sentence, with publishers called by the names of their nodes."""
        for key in [k for k in self._keys if k in text]:
            text = text.replace(key, self._named(key))
        super()._report_text(text)

    @property
    def sender(self) -> str | None:
        """The name of the publisher whose messages are accepted."""
        key = self._admission.sender
        return None if key is None else self._named(key)

    def _key(self, publisher: bytes) -> str:
        key = publisher.hex() or "publisher"
        if key not in self._keys:
            self._keys[key] = ""
            while len(self._keys) > REMEMBERED:
                del self._keys[next(iter(self._keys))]
        return key

    def _named(self, key: str) -> str:
        """Return the name of the publisher's node, with a suffix if two have the same name; the graph may know the
        name only after the first message.
        """
        if not self._keys.get(key) and self._publishers is not None:
            self._keys[key] = self._publishers().get(key, "")
        return f"{self._keys.get(key) or 'of no known node'} ({zlib.crc32(key.encode()):08x})"

    def _left(self, now: float) -> bool:
        """Return whether the accepted publisher has left the graph, so that another may be accepted."""
        served = self._admission.sender
        if now - self._looked < LOOK or self._publishers is None or served is None:
            return False
        self._looked = now
        if served in self._publishers():
            return False
        self._admission.gone(served)
        return True


def _times(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))
