"""Receivers of a stream: readings, touches and events."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event

__all__ = ["Recorder", "Sink"]


class Sink(Protocol):
    """A receiver of readings, touches and events of a stream: a recorder, or a server.

    Examples
    --------
    >>> class Counter:
    ...     def __init__(self):
    ...         self.frames = 0
    ...
    ...     def readings(self, time, values):
    ...         self.frames += 1
    ...
    ...     def touch(self, touch, time=None): ...
    ...
    ...     def event(self, event): ...
    ...
    ...     def close(self): ...
    >>> counter = Counter()
    >>> counter.readings(0.0, [[1.0, 2.0]])
    >>> counter.touch(None), counter.event(None), counter.close(), counter.frames
    (None, None, None, 1)
    """

    def readings(self, time: float, values: Any) -> None:
        """Take one frame (channel, *array) at ``time`` [s]; missing values are NaN. Planes that differ in shape come as a list of arrays."""

    def touch(self, touch: Touch, time: float | None = None) -> None:
        """Take the result of one frame."""

    def event(self, event: Event) -> None:
        """Take an event of a `palpate.GraspMonitor`."""

    def close(self) -> None:
        """Finish, and release the resources."""


class Recorder(Sink, Protocol):
    """A sink that is a file; ``with`` closes it."""

    def __enter__(self) -> Any: ...

    def __exit__(self, *_: object) -> None: ...
