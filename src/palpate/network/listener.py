"""Sockets: one thread with one event loop receives datagrams, connections and messages."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import struct
import threading
import time as clock
from collections.abc import Callable, Sequence
from typing import Any

from palpate._extras import missing
from palpate.errors import InvalidInput
from palpate.network.admission import Limits
from palpate.network.frames import MAGIC, ZERO
from palpate.network.waiting import FrameSource

__all__ = ["FrameListener"]


def _silent_logger() -> logging.Logger:
    """Return a logger that writes nothing: failed handshakes are the sender's problem."""
    logger = logging.getLogger("palpate.network")
    logger.setLevel(logging.CRITICAL)
    return logger


class FrameListener(FrameSource):
    """Listens for frames and returns them one by one; if too many wait, the oldest are dropped.

    One sender is accepted at a time; `palpate.network.admission` describes which frames are. A sender that restarts,
    or another in its place, begins a new session, whose times may be earlier than those of the last.

    Parameters
    ----------
    shape : sequence of int
        (channel, *array) of a frame; others are refused. Taxels on a line or scattered are sent as one row.
    kind : "udp", "tcp" or "ws"
    port : int
        0 takes a free one; see `port`.
    host : str
        Address to listen on; this machine alone by default.
    limits : Limits, optional
        Its timeouts.
    report : callable, optional
        Called with sentences on senders (served, restarted, or refused and why), from the listener's thread. Refusals
        of one kind are reported at most every 10 s; ``counts`` has all of them.
    zero : callable, optional
        Called with a number of frames when the current sender requests a new zero (`palpate.network.zero_bytes`), from the listener's thread. Without
        it such a request is refused as malformed.

    Attributes
    ----------
    counts : dict
        "frames" accepted, "sessions" started, "dropped" because newer ones came, and refusals: "malformed", "big-endian",
        "oversized", "shape", "late" (a sequence or time not after the last), "jump" (far from the last, without a restart), "busy"
        (another sender is served), "slow" (connections that sent no frame in time), "crowded" (connections closed to let another in).
    events : deque of str
        The latest sentences.

    Raises
    ------
    InvalidInput
        A port that is taken, an address that is not this machine's.

    Examples
    --------
    >>> import socket
    >>> from palpate.network import FrameListener, frame_bytes
    >>> listener = FrameListener([1, 3])  # UDP, on a free port of this machine
    >>> with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as driver:
    ...     _ = driver.sendto(frame_bytes(0, 0.5, [[1.0, 2.0, 3.0]]), ("127.0.0.1", listener.port))
    ...     session, time, values = next(listener.frames())
    >>> time, values.tolist(), listener.sender is not None
    (0.5, [[1.0, 2.0, 3.0]], True)

    >>> listener.close()
    >>> list(listener.frames())  # nothing more comes
    []
    """

    def __init__(
        self,
        shape: Sequence[int],
        *,
        kind: str = "udp",
        port: int = 0,
        host: str = "127.0.0.1",
        limits: Limits | None = None,
        report: Callable[[str], None] | None = None,
        zero: Callable[[int], None] | None = None,
    ) -> None:
        if kind not in ("udp", "tcp", "ws"):
            raise InvalidInput(f'kind must be "udp", "tcp" or "ws"; got {kind!r}.')
        super().__init__(shape, limits=limits, report=report, zero=zero)
        self._limits = self._admission.limits
        self._kind = kind
        self._connections: dict[str, Any] = {}
        self._refused: dict[str, float] = {}
        if kind == "ws":
            self._library()
        self._socket = _bound(kind, host, port)
        self.port = int(self._socket.getsockname()[1])
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name=f"palpate-{kind}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        super().close()
        with contextlib.suppress(RuntimeError):  # it has ended already
            self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(timeout=5)

    def __enter__(self) -> FrameListener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run({"udp": self._udp, "tcp": self._tcp, "ws": self._ws}[self._kind]())

    # -- datagrams -----------------------------------------------------------------------------------------------------

    async def _udp(self) -> None:
        transport, _ = await self._loop.create_datagram_endpoint(lambda: _Datagrams(self._take), sock=self._socket)
        try:
            await self._end.wait()
        finally:
            transport.close()

    # -- connections ---------------------------------------------------------------------------------------------------

    async def _tcp(self) -> None:
        server = await asyncio.start_server(self._converse, sock=self._socket)
        try:
            await self._end.wait()
        finally:
            # accept no more connections, and end the open ones: a closed server leaves their sockets open (Python 3.11)
            with contextlib.suppress(NotImplementedError):
                self._loop.remove_reader(self._socket)
            for _ in range(20):
                self._abort_all()
                others = asyncio.all_tasks() - {asyncio.current_task()}
                if not others:
                    break
                await asyncio.wait(others, timeout=0.1)
            server.close()
            await asyncio.sleep(0)  # aborted connections close one turn of the loop later

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Read frames from a connection until it closes or sends anything that is not a frame, after which the start
        of the next frame cannot be found.
        """
        sender = self._arrived(writer.transport)
        why = None
        try:
            why = await self._listen(sender, reader)
        except (OSError, asyncio.IncompleteReadError):
            pass
        finally:
            self._left(sender)
            if why is not None and not writer.is_closing():
                # tell the sender the reason, if it reads
                writer.write(f"refused: {why}\n".encode())
            writer.close()
            with contextlib.suppress(OSError, TimeoutError):
                async with asyncio.timeout(self._limits.hold):
                    await writer.wait_closed()
            writer.transport.abort()  # the sender does not read

    async def _listen(self, sender: str, reader: asyncio.StreamReader) -> str | None:
        """Read frames until the end. Return why the connection must be closed, or None if the sender closed it."""
        wait, refuse = self._limits.hello, self._admission.refuse
        while True:
            try:
                async with asyncio.timeout(wait):
                    head = await reader.read(1)
                if not head:
                    return None
                async with asyncio.timeout(self._limits.stall):
                    head += await reader.readexactly(3)
                    (size,) = struct.unpack("<I", head)
                    if size > self._admission.largest:
                        text = f"a message of {size} bytes was announced, a frame has {self._admission.largest}"
                        return refuse("oversized", sender, clock.monotonic(), text)
                    data = await reader.readexactly(size)
            except asyncio.IncompleteReadError:
                refuse("malformed", sender, clock.monotonic(), "the connection ended inside a frame")
                return None
            except TimeoutError:
                return refuse("slow", sender, clock.monotonic(), "no whole frame came in time")
            result = self._take(sender, data)
            if result in ("malformed", "big-endian", "oversized") and not data.startswith((MAGIC, ZERO)):
                return result
            if self._unwanted(sender, result):
                return f"busy, {self.sender} is being served"
            wait = self._limits.idle

    async def _ws(self) -> None:
        serve, connection = self._library()
        arrived = self._arrived

        class Counted(connection):  # type: ignore[misc, valid-type]
            """Counted before the handshake, which may never end."""

            def connection_made(self, transport: Any) -> None:
                self.sender = arrived(transport)
                super().connection_made(transport)

        # refuse pages in a browser, which send an Origin; a sensor's driver sends none
        async with serve(
            self._hear, sock=self._socket, max_size=self._admission.largest, compression=None, origins=[None],
            open_timeout=self._limits.hello, close_timeout=self._limits.hold, create_connection=Counted, logger=_silent_logger(),
        ):  # fmt: skip
            await self._end.wait()
            self._abort_all()

    async def _hear(self, connection: Any) -> None:
        """Read the messages of one WebSocket sender."""
        from websockets.exceptions import ConnectionClosed

        sender, wait = connection.sender, self._limits.hello
        try:
            while True:
                try:
                    async with asyncio.timeout(wait):
                        data = await connection.recv()
                except TimeoutError:
                    why = self._admission.refuse("slow", sender, clock.monotonic(), "no whole frame came in time")
                    await connection.close(1008, why)
                    return
                if isinstance(data, str):
                    self._admission.refuse("malformed", sender, clock.monotonic(), "text came, frames are binary")
                elif self._unwanted(sender, self._take(sender, data)):
                    await connection.close(1013, f"busy, {self.sender} is being served")
                    return
                wait = self._limits.idle
        except ConnectionClosed as end:
            code = None if end.sent is None else end.sent.code
            name = {1009: "oversized", 1002: "malformed", 1007: "malformed"}.get(code or 0)
            if name is not None:
                self._admission.refuse(name, sender, clock.monotonic(), f"WebSocket closed with {code}")
        finally:
            self._left(sender)

    @staticmethod
    def _library() -> Any:
        try:
            from websockets.asyncio.server import ServerConnection, serve
        except ImportError as error:
            raise missing("WebSocket frames", error) from error
        return serve, ServerConnection

    def _arrived(self, transport: Any) -> str:
        """Return the name of a new connection. If there are too many, close the oldest that is not accepted."""
        peer = transport.get_extra_info("peername") or ("unknown", id(transport))
        sender = _name(peer)
        line = transport.get_extra_info("socket")
        with contextlib.suppress(OSError):
            line.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in (("TCP_KEEPIDLE", 10), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 3)):
                if hasattr(socket, option):
                    line.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
        # connections whose handshake failed have left already
        for name in [n for n, t in self._connections.items() if t.is_closing()]:
            self._left(name)
        if len(self._connections) >= self._limits.connections:
            oldest = next(n for n in self._connections if n != self.sender)
            text = f"{len(self._connections)} connections are open"
            self._admission.refuse("crowded", oldest, clock.monotonic(), text)
            self._connections.pop(oldest).abort()
        self._connections[sender] = transport
        return sender

    def _left(self, sender: str) -> None:
        self._connections.pop(sender, None)
        self._refused.pop(sender, None)
        self._admission.gone(sender)

    def _unwanted(self, sender: str, result: str) -> bool:
        """Return whether a connection has been refused long enough, because another one is accepted, to get a message."""
        if result != "busy":
            self._refused.pop(sender, None)
            return False
        now = clock.monotonic()
        return now - self._refused.setdefault(sender, now) >= self._limits.hold

    def _abort_all(self) -> None:
        for transport in self._connections.values():
            transport.abort()


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, take: Callable[[str, bytes], str]) -> None:
        self._take = take

    def datagram_received(self, data: bytes, address: Any) -> None:
        self._take(_name(address), data)


def _name(address: Any) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in str(host) else f"{host}:{port}"


def _bound(kind: str, host: str, port: int) -> socket.socket:
    form = socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=form, flags=socket.AI_PASSIVE)[0]
        bound = socket.socket(family, form)
        try:
            if kind != "udp":
                bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            bound.bind(address)
            if kind != "udp":
                bound.listen(64)
        except OSError:
            bound.close()
            raise
    except OSError as error:
        raise InvalidInput(f"cannot listen on {host}:{port} ({error.strerror}).") from error
    bound.setblocking(False)
    return bound
