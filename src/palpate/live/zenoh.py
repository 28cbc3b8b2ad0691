"""Publish packets of a live session by zenoh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from palpate.live.session import Session
from palpate.network.zenoh import zenoh_key

__all__ = ["publish_touches"]


def publish_touches(session: Session, connection: Any, *, key: str) -> Callable[[], None]:
    """Publish each packet of a session (`palpate.live.unpacked` reads them). Return the function that stops this.

    Parameters
    ----------
    session : Session
        A session with ``pages=True`` (the default).
    connection : zenoh.Session
        Open; see `palpate.network.zenoh_session`.
    key : str
        Published on.

    Raises
    ------
    InvalidInput
        An invalid key.

    Examples
    --------
    >>> from palpate.live import publish_touches
    >>> end = publish_touches(session, connection, key="finger/touch")  # doctest: +SKIP
    """
    publisher = connection.declare_publisher(zenoh_key(key))
    sent = 0

    def send() -> None:
        nonlocal sent
        if session.packet is not None and session.count > sent:  # the callback is also called for events and at the end
            sent = session.count
            publisher.put(session.packet)

    end_of_packets = session.listen(send)

    def end() -> None:
        end_of_packets()
        publisher.undeclare()

    return end
