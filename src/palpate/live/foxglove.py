"""A local Foxglove server that shows pressure, shear, wrench, readings and events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from palpate._extras import missing
from palpate.errors import InvalidInput
from palpate.recordings.messages import Encoder, Kind, nanoseconds
from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event

__all__ = ["FoxgloveServer"]

#: Number of messages that wait for a slow viewer; the oldest are dropped.
WAITING = 16


class FoxgloveServer:
    """Sends a stream to Foxglove over a WebSocket (a sink of `Session`).

    Parameters
    ----------
    channels : sequence of str
        Channels of the readings.
    port : int
        0 chooses a free port, which the attribute ``port`` gives. Open ws://127.0.0.1:PORT in Foxglove.
    host : str
        Address to listen on; this machine alone by default. There is no token: give another address only on a network you trust.
    """

    def __init__(self, channels: Sequence[str] = (), *, port: int = 8766, host: str = "127.0.0.1") -> None:
        try:
            import foxglove
        except ImportError as error:
            raise missing("Foxglove streams", error) from error
        self._encoder = Encoder(channels)
        self._foxglove = foxglove
        self._context = foxglove.Context()
        try:
            self._server = foxglove.start_server(
                name="palpate", host=host, port=port, context=self._context, message_backlog_size=WAITING
            )
        except (RuntimeError, OSError, ValueError) as error:
            raise InvalidInput(f"cannot listen on {host}:{port} ({error}).") from error
        self.port = int(self._server.port)
        self._channels: dict[str, Any] = {}

    def readings(self, time: float, values: Any) -> None:
        """Send the readings of one frame (channel, *array) at ``time`` [s]."""
        if self._encoder.channels:
            self._send(*self._encoder.readings(time, values), time)

    def touch(self, touch: Touch, time: float | None = None) -> None:
        """Send the result of one frame."""
        now = float(touch.time) if time is None else time  # type: ignore[arg-type]
        for kind, data in self._encoder.touch(touch, now):
            self._send(kind, data, now)

    def event(self, event: Event) -> None:
        """Send an event of a `palpate.GraspMonitor`."""
        self._send(*self._encoder.event(event), event.time)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    def _send(self, kind: Kind, data: bytes, time: float) -> None:
        if kind.topic not in self._channels:
            schema = self._foxglove.Schema(name=kind.name, encoding=kind.schema_encoding, data=kind.schema)
            self._channels[kind.topic] = self._foxglove.Channel(
                kind.topic, schema=schema, message_encoding=kind.message_encoding, context=self._context
            )
        try:
            self._channels[kind.topic].log(data, log_time=nanoseconds(time))
        except (RuntimeError, OSError) as error:
            raise InvalidInput(f"Foxglove: sending {kind.topic} failed ({error}).") from error
