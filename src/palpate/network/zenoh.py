"""Frames over zenoh, a publish-subscribe protocol for robots (``pip install palpate[zenoh]``): readings come in,
packets of touches go out.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Sequence
from typing import Any

from palpate._extras import missing
from palpate.errors import InvalidInput
from palpate.network.admission import Limits
from palpate.network.waiting import FrameSource

__all__ = ["LOCAL", "ZenohListener", "zenoh_key", "zenoh_session"]

#: Default address of our session: this machine only.
LOCAL = "tcp/127.0.0.1:7447"
#: Environment variable that names the file of zenoh's own configuration, as for other zenoh programs.
CONFIG = "ZENOH_CONFIG"


def _library() -> Any:
    try:
        import zenoh
    except ImportError as error:
        raise missing("zenoh streams", error) from error
    return zenoh


def zenoh_session(*, listen: str | None = None, connect: str | None = None) -> Any:
    """An open ``zenoh.Session``, by an endpoint or by zenoh's own configuration; the caller closes it.

    Parameters
    ----------
    listen, connect : str, optional
        Endpoint to listen on or to connect to, such as "tcp/127.0.0.1:7447"; nothing else is looked for. Without either the file that
        the environment variable ZENOH_CONFIG names; without that `LOCAL` is listened on, which only this machine reaches.

    Raises
    ------
    InvalidInput
        An endpoint or a configuration that zenoh refuses, or both endpoints at once.
    Unsupported
        zenoh is not installed.

    Examples
    --------
    >>> from palpate.network import zenoh_session
    >>> with zenoh_session(listen="tcp/127.0.0.1:17450") as session:  # doctest: +SKIP
    ...     session.put("finger/note", "hello")
    """
    if listen is not None and connect is not None:
        raise InvalidInput(
            "give either listen or connect, not both; more than one endpoint is for a file that ZENOH_CONFIG names."
        )
    zenoh = _library()
    try:
        if listen is None and connect is None and os.environ.get(CONFIG):
            return zenoh.open(zenoh.Config.from_env())
        config = zenoh.Config()
        config.insert_json5("scouting/multicast/enabled", "false")
        if connect is None:
            config.insert_json5("listen/endpoints", f'["{listen or LOCAL}"]')
        else:
            config.insert_json5("mode", '"client"')
            config.insert_json5("connect/endpoints", f'["{connect}"]')
        return zenoh.open(config)
    except zenoh.ZError as error:
        where = listen or connect or os.environ.get(CONFIG) or LOCAL
        why = str(error).split(" at /")[0].rstrip(".! ")
        raise InvalidInput(
            f"zenoh does not begin with {where} ({why}). For another endpoint, or a second session on this machine, write a zenoh configuration file and set ZENOH_CONFIG to its path."
        ) from error


def zenoh_key(key: str) -> str:
    """Return the key; raise an error if zenoh cannot publish to it.

    Raises
    ------
    InvalidInput
        An empty key, one that begins or ends with /, or one with wildcards.

    Examples
    --------
    >>> from palpate.network import zenoh_key
    >>> zenoh_key("left/finger")
    'left/finger'
    """
    if not isinstance(key, str) or not all(key.split("/")) or set(key) & set("*$?# "):
        raise InvalidInput(
            f'a key of zenoh is words between single /, without * $ ? # or spaces, such as "left/finger"; got {key!r}.'
        )
    return key


class ZenohListener(FrameSource):
    """Receives the frames that are published on a key, with the rules of `FrameListener`.

    Frames are encoded by `palpate.network.frame_bytes`. Publishers are distinguished if they identify themselves
    (``source_info`` of zenoh). Samples without a source identity count as one sender, so that a key must have only one such publisher.

    Parameters
    ----------
    session : zenoh.Session
        Open; the caller closes it.
    shape : sequence of int
        (channel, *array) of a frame.
    key : str
        Subscribed to.
    limits, report, zero
        As of `FrameListener`.

    Attributes
    ----------
    counts, events
        As of `FrameListener`.

    Examples
    --------
    >>> from palpate.network import ZenohListener, frame_bytes, zenoh_session
    >>> with zenoh_session() as session:  # doctest: +SKIP
    ...     listener = ZenohListener(session, [1, 3], key="finger/readings")
    ...     session.put("finger/readings", frame_bytes(0, 0.5, [[1.0, 2.0, 3.0]]))
    ...     number, time, readings = next(listener.frames())
    ...     print(listener.sender)
    ...     listener.close()
    """

    def __init__(
        self,
        session: Any,
        shape: Sequence[int],
        *,
        key: str,
        limits: Limits | None = None,
        report: Callable[[str], None] | None = None,
        zero: Callable[[int], None] | None = None,
    ) -> None:
        super().__init__(shape, limits=limits, report=report, zero=zero)
        self._zenoh = _library()
        self.key = zenoh_key(key)
        self._subscriber = session.declare_subscriber(self.key, self._came)

    def __enter__(self) -> ZenohListener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Accept no more frames; those in the queue are still delivered."""
        with contextlib.suppress(self._zenoh.ZError):  # it has ended already
            self._subscriber.undeclare()
        super().close()

    def _came(self, sample: Any) -> None:
        if sample.kind is self._zenoh.SampleKind.DELETE:
            return
        said = sample.source_info
        sender = self.key if said is None else f"{said.source_id.zid}/{said.source_id.eid}"
        self._take(sender, bytes(sample.payload))
