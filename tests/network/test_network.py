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
from long_runs import long_runs
from palpate import solutions
from palpate.network import FrameListener, Limits, frame_bytes, frame_from_bytes
from palpate.network.waiting import WAITING

SHAPE = (3, 6, 5)


def wait(until: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60
    while not until() and time.monotonic() < deadline:
        time.sleep(0.005)
    assert until()


def counted(listener: FrameListener) -> dict[str, int]:
    return {k: v for k, v in listener.counts.items() if v}


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


@contextlib.contextmanager
def connected(kind: str, port: int) -> Iterator[tuple[Callable[[bytes], object], Callable[[], str]]]:
    """What sends, and what the listener has said to it."""
    if kind == "ws":
        client = pytest.importorskip("websockets.sync.client")
        with client.connect(f"ws://127.0.0.1:{port}", compression=None) as connection:
            yield connection.send, lambda: connection.close_reason or ""
        return
    with socket.create_connection(("127.0.0.1", port)) as plain:
        found = bytearray()

        def received() -> str:
            with contextlib.suppress(OSError):
                found.extend(plain.recv(1000, socket.MSG_DONTWAIT))
            return found.decode()

        yield lambda data: plain.sendall(struct.pack("<I", len(data)) + data), received


def closed() -> tuple[type[Exception], ...]:
    return (pytest.importorskip("websockets.exceptions").ConnectionClosed,)


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
        assert counted(listener) == {"frames": 50, "sessions": 1}


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


@pytest.mark.parametrize("kind", ["udp", "tcp", *long_runs("ws")])
def test_hostile_messages(kind: str) -> None:
    """Malformed, oversized, truncated, misshapen and late messages: counted by name, and the listener lives on."""
    rng = np.random.default_rng(0)
    good = frame_bytes(10, 1.0, np.zeros(SHAPE))
    timeless = bytearray(good)
    timeless[8:16] = struct.pack("<d", math.nan)
    made: list[tuple[str, bytes]] = []
    hundreds = 10 if kind == "udp" else 2  # the others connect anew for each
    for i in range(100 * hundreds):
        made.append(
            [
                ("malformed", rng.bytes(int(rng.integers(1, 200)))),
                ("oversized", good + bytes(500)),
                ("malformed", good[: int(rng.integers(1, len(good)))]),
                ("shape", frame_bytes(100 + i, 100.0 + i, np.zeros((2, 6, 5)))),
                ("malformed", bytes(timeless)),
            ][i % 5]
        )
    with FrameListener(SHAPE, kind=kind) as listener:
        for what, data in made:
            before = listener.counts[what]
            with sending(kind, listener.port) as send:
                send(data)
            wait(lambda what=what, before=before: listener.counts[what] == before + 1)  # type: ignore[misc]
        assert counted(listener) == {"malformed": 60 * hundreds, "oversized": 20 * hundreds, "shape": 20 * hundreds}
        with sending(kind, listener.port) as send:
            send(good)
            assert next(iter(listener))[0] == 1.0


def test_websocket_is_not_for_web_pages() -> None:
    """Text is refused, a web page is refused, and the driver goes on."""
    client = pytest.importorskip("websockets.sync.client")
    from websockets.exceptions import InvalidStatus

    with FrameListener(SHAPE, kind="ws") as listener:
        where = f"ws://127.0.0.1:{listener.port}"
        with client.connect(where) as first:
            first.send("hello")
            wait(lambda: listener.counts["malformed"] == 1)
            with pytest.raises(InvalidStatus):
                client.connect(where, origin="http://elsewhere.example")
            first.send(frame_bytes(0, 0.5, np.zeros(SHAPE)))
            assert next(iter(listener))[0] == 0.5


#: As `Limits`, in a hurry; a machine with other things to do may still pause for half a second.
FAST = Limits(silence=0.8, hold=0.1, hello=0.8, stall=0.8, connections=4)
#: Where nobody is to be too late, however long the machine pauses.
PATIENT = Limits(silence=60.0, hold=0.1, hello=60.0, stall=60.0, connections=4)


@pytest.mark.parametrize("kind", ["tcp", "ws"])
def test_a_second_connection_is_told_why_it_is_not_served(kind: str) -> None:
    with FrameListener(SHAPE, kind=kind, limits=PATIENT) as listener, sending(kind, listener.port) as first:
        first(frame_bytes(0, 0.0, np.zeros(SHAPE)))
        wait(lambda: listener.counts["frames"] == 1)
        with connected(kind, listener.port) as (second, received):
            sent = 0
            with contextlib.suppress(OSError, *closed()):
                while "busy" not in received():
                    first(frame_bytes(sent + 1, 0.01 * (sent + 1), np.zeros(SHAPE)))
                    second(frame_bytes(sent, 0.01 * sent, np.ones(SHAPE)))
                    sent += 1
                    time.sleep(0.01)
            assert "busy" in received()
        first(frame_bytes(sent + 2, 0.01 * (sent + 2), np.zeros(SHAPE)))
        wait(lambda: listener.counts["frames"] >= sent + 1)
        assert listener.counts["busy"] >= 2
        assert listener.counts["sessions"] == 1
        assert any("busy" in text and "one sender is accepted at a time" in text for text in listener.events)


def test_two_bytes_and_silence_do_not_keep_the_successor_out() -> None:
    """Slow-loris: neither one that never begins nor one that was served and stalls inside a frame."""
    whole = frame_bytes(0, 0.0, np.zeros(SHAPE))
    with FrameListener(SHAPE, kind="tcp", limits=FAST) as listener, contextlib.ExitStack() as stack:
        loris = stack.enter_context(socket.create_connection(("127.0.0.1", listener.port)))
        loris.send(b"\x01\x00")
        send = stack.enter_context(sending("tcp", listener.port))
        send(whole)
        assert next(iter(listener))[0] == 0.0
        wait(lambda: listener.counts["slow"] == 1)
        assert b"slow" in loris.recv(100)
        stalled = stack.enter_context(socket.create_connection(("127.0.0.1", listener.port)))
        time.sleep(0.5 * FAST.silence)  # it may wait so long, and the served one is silent for longer than it may be
        stalled.sendall(struct.pack("<I", len(whole)) + whole + b"\x00\x01")
        assert next(iter(listener))[0] == 0.0
        assert b"slow" in stalled.recv(100)
        send(frame_bytes(1, 5.0, np.zeros(SHAPE)))
        assert next(iter(listener))[0] == 5.0


def test_a_dead_sender_whose_socket_stays_open_is_followed_by_its_successor() -> None:
    with FrameListener(SHAPE, kind="tcp", limits=FAST) as listener, contextlib.ExitStack() as stack:
        dead = stack.enter_context(sending("tcp", listener.port))
        dead(frame_bytes(500, 5.0, np.zeros(SHAPE)))
        assert next(iter(listener))[0] == 5.0
        time.sleep(1.1 * FAST.silence)
        stack.enter_context(sending("tcp", listener.port))(frame_bytes(0, 0.0, np.ones(SHAPE)))
        session, stamp, values = next(listener.frames())
        assert (session, stamp, values.min()) == (2, 0.0, 1.0)
        assert any("was silent for" in text for text in listener.events)


@pytest.mark.parametrize("kind", ["tcp", "ws"])
def test_many_connections_that_say_nothing_leave_room_for_one_that_sends(kind: str) -> None:
    with FrameListener(SHAPE, kind=kind, limits=PATIENT) as listener, contextlib.ExitStack() as stack:
        send = stack.enter_context(sending(kind, listener.port))
        send(frame_bytes(0, 0.0, np.zeros(SHAPE)))
        wait(lambda: listener.counts["frames"] == 1)
        for _ in range(40):
            stack.enter_context(socket.create_connection(("127.0.0.1", listener.port)))
        wait(lambda: listener.counts["crowded"] >= 40 + 1 - PATIENT.connections)
        send(frame_bytes(1, 0.1, np.zeros(SHAPE)))
        wait(lambda: listener.counts["frames"] == 2)
        assert len(listener._connections) <= PATIENT.connections


@pytest.mark.parametrize("kind", ["udp", "tcp", "ws"])
def test_a_killed_and_restarted_driver_is_served_again(kind: str) -> None:
    with FrameListener(SHAPE, kind=kind, limits=FAST) as listener:
        for life in range(3):
            with sending(kind, listener.port) as send:
                send(frame_bytes(0, 0.0, np.full(SHAPE, float(life))))
                session, stamp, values = next(listener.frames())
                assert (session, stamp, values.max()) == (life + 1, 0.0, life)
            if kind == "udp":  # nothing says that it has gone
                time.sleep(1.1 * FAST.silence)


@pytest.mark.parametrize("kind", ["udp", "tcp", "ws"])
def test_the_listener_ends_and_leaves_its_port(kind: str) -> None:
    listener = FrameListener(SHAPE, kind=kind)
    with sending(kind, listener.port) as send:
        send(frame_bytes(0, 0.0, np.zeros(SHAPE)))
        wait(lambda: listener.counts["frames"] == 1)
        listener.close()
    listener.close()
    assert not listener._thread.is_alive()
    assert len(list(listener)) == 1
    FrameListener(SHAPE, kind=kind, port=listener.port).close()


@pytest.mark.long
def test_from_the_wire_to_newtons() -> None:
    array = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    reading = skin.sense(solutions.hertz_point(contact_radius=2e-3, force=1.0))
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
