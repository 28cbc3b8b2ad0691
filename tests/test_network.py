"""Frames by UDP, TCP and WebSocket: what is sent arrives, and nonsense is counted, not believed."""

from __future__ import annotations

import contextlib
import math
import socket
import struct
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.network import WAITING, FrameListener, frame_bytes, frame_from_bytes

SHAPE = (3, 6, 5)


def wait(until: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not until() and time.monotonic() < deadline:
        time.sleep(0.005)
    assert until()


def test_round_trip() -> None:
    values = np.random.default_rng(0).standard_normal(SHAPE).astype(np.float32)
    values[0, 1, 2] = np.nan
    sequence, stamp, found = frame_from_bytes(frame_bytes(7, 1.25, values))
    assert (sequence, stamp) == (7, 1.25)
    np.testing.assert_array_equal(found, values)
    row = frame_from_bytes(frame_bytes(2**32 + 1, 0.0, values.reshape(3, -1)))
    assert row[0] == 1
    assert row[2].shape == (3, 1, 30)
    with pytest.raises(pp.InvalidInput, match="shape"):
        frame_bytes(0, 0.0, np.zeros(3))


@contextlib.contextmanager
def sending(kind: str, port: int) -> Iterator[Callable[[bytes], object]]:
    """What sends one message after another to a listener."""
    if kind == "ws":
        client = pytest.importorskip("websockets.sync.client")
        with client.connect(f"ws://127.0.0.1:{port}", compression=None) as connection:
            yield connection.send
        return
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM) as plain:
        plain.connect(("127.0.0.1", port))
        yield lambda data: plain.sendall(data if kind == "udp" else struct.pack("<I", len(data)) + data)


@pytest.mark.parametrize("kind", ["udp", "tcp", "ws"])
def test_frames_arrive(kind: str) -> None:
    values = np.random.default_rng(0).standard_normal((50, *SHAPE)).astype(np.float32)
    with FrameListener(SHAPE, kind=kind) as listener:
        stream = iter(listener)
        with sending(kind, listener.port) as send:
            for i, frame in enumerate(values):
                send(frame_bytes(i, 0.01 * (i + 1), frame))
                stamp, found = next(stream)
                assert stamp == pytest.approx(0.01 * (i + 1))
                np.testing.assert_array_equal(found, frame)
        assert listener.counts["frames"] == 50
        assert sum(listener.counts.values()) == 50


def test_the_newest_are_kept_and_the_order_is_watched() -> None:
    with FrameListener(SHAPE) as listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", listener.port))
        for i in [*range(20), 5, 19]:
            sender.send(frame_bytes(i, 0.1 * i, np.full(SHAPE, float(i))))
            time.sleep(0.002)
        wait(lambda: listener.counts["late"] == 2)
        assert listener.counts["dropped"] == 20 - WAITING
        stamps = [stamp for stamp, _ in (next(iter(listener)) for _ in range(WAITING))]
        np.testing.assert_allclose(stamps, 0.1 * np.arange(20 - WAITING, 20))


@pytest.mark.parametrize("kind", ["udp", "tcp", "ws"])
def test_hostile_messages(kind: str) -> None:
    """A thousand malformed, oversized, truncated, misshapen and late messages: counted by name, and the listener lives on."""
    rng = np.random.default_rng(0)
    good = frame_bytes(10, 1.0, np.zeros(SHAPE))
    made: list[tuple[str, bytes]] = []
    for i in range(1000):
        made.append(
            [
                ("malformed", rng.bytes(int(rng.integers(1, 200)))),
                ("oversized", good + bytes(500)),
                ("malformed", good[: int(rng.integers(1, len(good)))]),
                ("shape", frame_bytes(100 + i, 100.0 + i, np.zeros((2, 6, 5)))),
                ("malformed", frame_bytes(100 + i, math.nan, np.zeros(SHAPE))),
            ][i % 5]
        )
    with FrameListener(SHAPE, kind=kind) as listener:
        for what, data in made:
            before = listener.counts[what]
            with sending(kind, listener.port) as send:
                send(data)
            wait(lambda what=what, before=before: listener.counts[what] == before + 1)  # type: ignore[misc]
        assert listener.counts == {
            "frames": 0, "dropped": 0, "malformed": 600, "oversized": 200, "shape": 200, "late": 0, "busy": 0,
        }  # fmt: skip
        with sending(kind, listener.port) as send:
            send(good)
            assert next(iter(listener))[0] == 1.0


def test_websocket_is_for_one_driver() -> None:
    """Text is refused, a web page is refused, and so is a second sender; the first goes on."""
    client = pytest.importorskip("websockets.sync.client")
    from websockets.exceptions import ConnectionClosed, InvalidStatus

    with FrameListener(SHAPE, kind="ws") as listener:
        where = f"ws://127.0.0.1:{listener.port}"
        with client.connect(where) as first:
            first.send("hello")
            wait(lambda: listener.counts["malformed"] == 1)
            with client.connect(where) as second, pytest.raises(ConnectionClosed):
                second.recv(timeout=5)
            assert listener.counts["busy"] == 1
            with pytest.raises(InvalidStatus):
                client.connect(where, origin="http://elsewhere.example")
            first.send(frame_bytes(0, 0.5, np.zeros(SHAPE)))
            assert next(iter(listener))[0] == 0.5


def test_from_the_wire_to_newtons() -> None:
    array = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    reading = skin.sense(solutions.hertz_point(radius=2e-3, force=1.0))
    tracker = skin.track(friction=0.6)
    with FrameListener((3, 10, 10)) as listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(frame_bytes(0, 0.0, reading), ("127.0.0.1", listener.port))
        stamp, values = next(iter(listener))
        assert tracker.step(values, stamp).force[2] == pytest.approx(1.0, abs=0.02)


def test_listener_refuses() -> None:
    with pytest.raises(pp.InvalidInput, match="kind"):
        FrameListener(SHAPE, kind="carrier pigeon")
    with FrameListener(SHAPE, kind="tcp") as listener, pytest.raises(pp.InvalidInput, match="cannot listen"):
        FrameListener(SHAPE, kind="tcp", port=listener.port)
