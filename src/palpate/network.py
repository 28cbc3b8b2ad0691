"""Frames over the network: a small binary form by UDP, TCP or WebSocket, for drivers in any language.

One frame is, little-endian,

    "PLPF" | sequence uint32 | time float64 [s] | channels uint16 | rows uint16 | columns uint16 | values float32

with the values as (channel, row, column), in SI units, compression positive, NaN where missing; taxels that lie on a line or anywhere are
one row. By UDP a frame is one datagram; by TCP each frame follows its length in bytes (uint32); by WebSocket a frame is one binary message,
from programs, not from web pages (an Origin is refused), one sender at a time. `frame_bytes` makes one.
"""

from __future__ import annotations

import contextlib
import logging
import math
import socket
import struct
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.half_space import Floats
from palpate.errors import InvalidInput, Unsupported

__all__ = ["FrameListener", "frame_bytes", "frame_from_bytes"]

MAGIC = b"PLPF"
_HEAD = struct.Struct("<4sIdHHH")
#: Frames that wait to be taken; the oldest make room for the newest.
WAITING = 8


def frame_bytes(sequence: int, time: float, readings: Any) -> bytes:
    """One frame (channel, taxel) or (channel, y, x) as bytes."""
    values = to_numpy(readings)
    if values.ndim not in (2, 3):
        raise InvalidInput(f"a frame must have shape (channel, taxel) or (channel, y, x); got {values.shape}.")
    rows, columns = (1, values.shape[1]) if values.ndim == 2 else values.shape[1:]
    head = _HEAD.pack(MAGIC, sequence % 2**32, float(time), len(values), rows, columns)
    return head + np.ascontiguousarray(values, dtype="<f4").tobytes()


def frame_from_bytes(data: bytes) -> tuple[int, float, Floats]:
    """(sequence, time [s], readings (channel, row, column)) of a frame; `InvalidInput` where it is not one."""
    if len(data) < _HEAD.size or data[:4] != MAGIC:
        raise InvalidInput("not a palpate frame: it does not begin with PLPF.")
    _, sequence, time, channels, rows, columns = _HEAD.unpack_from(data)
    if len(data) != _HEAD.size + 4 * channels * rows * columns:
        raise InvalidInput(
            f"a frame of {channels} x {rows} x {columns} floats has {_HEAD.size + 4 * channels * rows * columns} bytes; got {len(data)}."
        )
    if not math.isfinite(time):
        raise InvalidInput("a frame without a finite time.")
    values = np.frombuffer(data, dtype="<f4", offset=_HEAD.size).reshape(channels, rows, columns)
    return sequence, time, np.asarray(values, dtype=np.float64)


def _quiet() -> logging.Logger:
    """Handshakes that fail are the sender's affair."""
    logger = logging.getLogger("palpate.network")
    logger.setLevel(logging.CRITICAL)
    return logger


class FrameListener:
    """Listens for frames and gives them out one by one, the newest first where too many wait.

    Parameters
    ----------
    shape : sequence of int
        (channel, *array) of a frame; others are refused.
    kind : "udp", "tcp" or "ws"
    port : int
        0 takes a free one; see `port`.
    host : str
        Address to listen on; this machine alone by default.

    Attributes
    ----------
    counts : dict
        "frames" taken in, "dropped" because newer ones came, and what was refused: "malformed", "oversized", "shape", "late" (a sequence
        or time not after the last), "busy" (a second sender).
    """

    def __init__(self, shape: Sequence[int], *, kind: str = "udp", port: int = 0, host: str = "127.0.0.1") -> None:
        if kind not in ("udp", "tcp", "ws"):
            raise InvalidInput(f'kind must be "udp", "tcp" or "ws"; got {kind!r}.')
        self.shape = tuple(int(n) for n in shape)
        self.counts = dict.fromkeys(("frames", "dropped", "malformed", "oversized", "shape", "late", "busy"), 0)
        self._largest = _HEAD.size + 4 * math.prod(self.shape)
        self._frames: deque[tuple[float, Floats]] = deque(maxlen=WAITING)
        self._ready = threading.Condition()
        self._open = True
        self._last: tuple[int, float] | None = None
        self._kind = kind
        if kind == "ws":
            self._thread = self._serve_ws(host, port)
            return
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM)
        try:
            if kind == "tcp":
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise InvalidInput(f"cannot listen on {host}:{port} ({error.strerror}).") from error
        self._socket.settimeout(0.2)
        self.port = int(self._socket.getsockname()[1])
        if kind == "tcp":
            self._socket.listen(1)
        self._thread = threading.Thread(target=self._run, name=f"palpate-{kind}", daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[tuple[float, Floats]]:
        """(time [s], readings (channel, *array)) until `close`."""
        while True:
            with self._ready:
                self._ready.wait_for(lambda: self._frames or not self._open, timeout=0.5)
                if self._frames:
                    found = self._frames.popleft()
                elif not self._open:
                    return
                else:
                    continue
            yield found

    def close(self) -> None:
        """Stop listening."""
        with self._ready:
            self._open = False
            self._ready.notify_all()
        if self._kind == "ws":
            self._server.shutdown()
        self._thread.join(timeout=5)
        if self._kind != "ws":
            self._socket.close()

    def __enter__(self) -> FrameListener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _serve_ws(self, host: str, port: int) -> threading.Thread:
        try:
            from websockets.sync.server import serve
        except ImportError as error:
            raise Unsupported('WebSocket frames need more packages: pip install "palpate[live]".') from error
        self._sender = threading.Lock()
        try:
            # pages in a browser bring an Origin; a sensor's driver does not
            self._server = serve(
                self._hear, host, port, max_size=self._largest, compression=None, origins=[None], logger=_quiet()
            )
        except OSError as error:
            raise InvalidInput(f"cannot listen on {host}:{port} ({error.strerror}).") from error
        self.port = int(self._server.socket.getsockname()[1])
        thread = threading.Thread(target=self._server.serve_forever, name="palpate-ws", daemon=True)
        thread.start()
        return thread

    def _hear(self, connection: Any) -> None:
        """Messages of one WebSocket sender."""
        from websockets.exceptions import ConnectionClosed

        # one that comes back may be here before its old connection has ended
        if not self._sender.acquire(timeout=1.0):
            self.counts["busy"] += 1
            connection.close(1013, "another sender is connected")
            return
        try:
            # a sender that comes back counts from the start again
            self._last = None
            while self._open:
                try:
                    data = connection.recv(timeout=0.2)
                except TimeoutError:
                    continue
                if isinstance(data, str):
                    self.counts["malformed"] += 1
                else:
                    self._take(data)
        except ConnectionClosed as end:
            if end.sent is not None and end.sent.code == 1009:
                self.counts["oversized"] += 1
            elif end.sent is not None and end.sent.code in (1002, 1007):
                self.counts["malformed"] += 1
        finally:
            self._sender.release()

    def _run(self) -> None:
        if self._kind == "udp":
            while self._open:
                with contextlib.suppress(TimeoutError, ConnectionError):
                    data = self._socket.recv(65536)
                    self._take(data)
            return
        while self._open:
            with contextlib.suppress(TimeoutError):
                connection, _ = self._socket.accept()
                with connection, contextlib.suppress(OSError):
                    connection.settimeout(0.2)
                    # a sender that comes back counts from the start again
                    self._last = None
                    self._converse(connection)

    def _converse(self, connection: socket.socket) -> None:
        """Frames of one sender, until it leaves or speaks nonsense: after that nothing tells where a frame begins."""
        while self._open:
            head = self._exactly(connection, 4)
            if head is None:
                return
            (size,) = struct.unpack("<I", head)
            if size > self._largest:
                self.counts["oversized"] += 1
                return
            data = self._exactly(connection, size)
            if data is None:
                self.counts["malformed"] += 1
                return
            if not self._take(data):
                return

    def _exactly(self, connection: socket.socket, size: int) -> bytes | None:
        parts = bytearray()
        while len(parts) < size:
            try:
                some = connection.recv(size - len(parts))
            except TimeoutError:
                if not self._open:
                    return None
                continue
            if not some:
                return None
            parts += some
        return bytes(parts)

    def _take(self, data: bytes) -> bool:
        """Take a frame in; False where it was not one."""
        if len(data) > self._largest:
            self.counts["oversized"] += 1
            return False
        try:
            sequence, time, values = frame_from_bytes(data)
        except InvalidInput:
            self.counts["malformed"] += 1
            return False
        if values.size != math.prod(self.shape) or len(values) != self.shape[0]:
            self.counts["shape"] += 1
            return True
        if self._last is not None:
            ahead = (sequence - self._last[0]) % 2**32
            if not 0 < ahead < 2**31 or time <= self._last[1]:
                self.counts["late"] += 1
                return True
        self._last = (sequence, time)
        with self._ready:
            if len(self._frames) == WAITING:
                self.counts["dropped"] += 1
            self._frames.append((time, values.reshape(self.shape)))
            self.counts["frames"] += 1
            self._ready.notify()
        return True
