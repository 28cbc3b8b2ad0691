"""Limit how many connections the page's server keeps and for how long, and how often it reports them.

Anyone who reaches the port can open idle connections. Each uses a file descriptor, of which a process has about a
thousand: without a limit the server could soon accept no page, and the stream could open no file.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import time
from collections.abc import Callable, Iterator
from typing import Any

__all__ = ["BACKLOG", "HELLO", "OPEN", "Connections", "Seldom", "accept_failures_are_warnings", "bounded", "seldom"]

#: Largest number of open connections, and of those that wait to be accepted: the loop accepts this many before it
#: handles any.
OPEN, BACKLOG = 64, 32
#: A connection that requests nothing for this many seconds is closed.
HELLO = 30.0
#: Seconds between two equal lines of a log.
PAUSE = 60.0

_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


class Connections:
    """The open connections, oldest first. If there are too many, the oldest that has requested nothing is closed, or
    else the oldest that is not a page.

    Parameters
    ----------
    refused : callable
        Called for each connection that is closed to let another in.
    limit : int
        Most connections at the same time.
    """

    def __init__(self, refused: Callable[[], Any], *, limit: int) -> None:
        self._refused, self._limit = refused, limit
        self._open: dict[Any, Any] = {}

    def __len__(self) -> int:
        return len(self._open)

    def arrived(self, transport: Any, protocol: Any) -> None:
        """Add a new connection."""
        for gone in [t for t in self._open if t.is_closing()]:
            del self._open[gone]
        if len(self._open) >= self._limit:
            # a connection that became a page has another protocol
            plain = [t for t, p in self._open.items() if t.get_protocol() is p]
            oldest = next((t for t in plain if self._open[t].cycle is None), plain[0] if plain else transport)
            self._open.pop(oldest, None)
            self._refused()
            oldest.abort()
            if oldest is transport:
                return
        self._open[transport] = protocol

    def left(self, transport: Any) -> None:
        """Remove a connection that has ended."""
        self._open.pop(transport, None)


def bounded(base: type[Any], connections: Connections) -> type[Any]:
    """Return the protocol ``base`` of uvicorn, extended to register in ``connections`` and to close when idle."""

    class Bounded(base):  # type: ignore[misc]
        """uvicorn alone takes any number of connections, and waits for ever for a request that never comes or never ends."""

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            connections.arrived(transport, self)
            self.loop.call_later(HELLO, self.expire, None)

        def connection_lost(self, exc: Exception | None) -> None:
            connections.left(self.transport)
            super().connection_lost(exc)

        def expire(self, last: Any) -> None:
            """Check again as long as there was a new request since the last check: a program may ask for ``/health`` for hours."""
            if self.transport.get_protocol() is not self:  # it has become a WebSocket
                return
            if self.cycle is last:
                self.transport.abort()
            else:
                self.loop.call_later(HELLO, self.expire, self.cycle)

    return Bounded


class Seldom(logging.Filter):
    """Passes each message of a logger at most once a minute, with the number of suppressed ones.

    Examples
    --------
    >>> import logging
    >>> from palpate.live.connections import Seldom
    >>> seldom = Seldom(clock=iter([0.0, 1.0, 61.0]).__next__)
    >>> lines = [logging.LogRecord("page", logging.WARNING, "", 0, "Invalid request.", None, None) for _ in range(3)]
    >>> [line.getMessage() for line in lines if seldom.filter(line)]
    ['Invalid request.', 'Invalid request. (2 times in 61 s)']
    """

    #: Number of different messages that are remembered.
    MOST = 100

    def __init__(self, *, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._said: dict[str, tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether to write the record."""
        now, text = self._clock(), str(record.msg)
        if text not in self._said:
            if len(self._said) >= self.MOST:
                del self._said[next(iter(self._said))]
            self._said[text] = now, 0
            return True
        last, count = self._said[text][0], self._said[text][1] + 1
        if now - last < PAUSE:
            self._said[text] = last, count
            return False
        self._said[text] = now, 0
        if count > 1:
            record.msg, record.args = f"{record.getMessage()} ({count} times in {now - last:.0f} s)", None
        return True


@contextlib.contextmanager
def seldom(*loggers: logging.Logger) -> Iterator[None]:
    """A context in which these loggers repeat no line within a minute."""
    filters = [(logger, Seldom()) for logger in loggers]
    for logger, one in filters:
        logger.addFilter(one)
    try:
        yield
    finally:
        for logger, one in filters:
            logger.removeFilter(one)


def accept_failures_are_warnings(loop: asyncio.AbstractEventLoop, logger: logging.Logger) -> None:
    """Make the loop warn in one line if the system has no file descriptor for a new connection; asyncio writes a
    traceback for each.
    """

    def handle(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in _EXHAUSTED:
            logger.warning("no connection can be accepted: %s.", error.strerror)
        else:
            loop.default_exception_handler(context)

    loop.set_exception_handler(handle)
