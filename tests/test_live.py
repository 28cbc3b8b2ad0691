"""The live view: packets, the server's doors, and the page in a real browser where there is one."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.live import Live, Session, packed, unpacked
from palpate.recordings.robots import read_robot, topics

testclient = pytest.importorskip("starlette.testclient")

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
ARRAY = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
BALL = solutions.hertz_point(radius=2.5e-3, force=1.0).partial_slip(0.6, 0.3)


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, ARRAY)


def session(skin: pp.Skin, frames: int = 100_000, rate: float = 100.0, wrong_at: int | None = None) -> Session:
    clean = skin.sense(BALL)
    rng = np.random.default_rng(0)

    def source() -> Iterator[tuple[float, Any]]:
        for i in range(frames):
            if i == wrong_at:
                yield i / rate, np.zeros((2, 2))
            yield i / rate, (clean if i > 20 else 0.0) + 100.0 * rng.standard_normal(clean.shape)

    return Session(skin, source, skin.track(friction=0.6, baseline=10), pp.GraspMonitor(friction=0.6), name="test")


def test_packets_hold_what_the_touch_holds(skin: pp.Skin) -> None:
    tracker, monitor = skin.track(friction=0.6), pp.GraspMonitor(friction=0.6)
    touch = tracker.step(skin.sense(BALL), 1.5)
    events = monitor.update(touch)
    numbers, maps = unpacked(packed(touch, monitor, events, {"frames": 1}, born=1e12, ms=1.0))
    ny, nx = skin.surface.shape
    assert maps.size == 3 * ny * nx
    np.testing.assert_allclose(maps[: ny * nx].reshape(ny, nx), touch.values[2], rtol=1e-6)
    assert numbers["force"][2] == pytest.approx(float(touch.force[2]))
    assert numbers["events"] == ["1.500 s  contact began"]
    assert numbers["force_low"][2] <= numbers["force_high"][2]
    assert numbers["utilisation"] == pytest.approx(0.5, abs=0.1)


def test_an_empty_frame_packs_without_nan(skin: pp.Skin) -> None:
    tracker, monitor = skin.track(baseline=3), pp.GraspMonitor()
    for _ in range(6):
        touch = tracker.step(np.random.default_rng(0).standard_normal((3, 10, 10)))
        monitor.update(touch)
    packet = packed(touch, monitor, [], {"frames": 1}, born=0.0, ms=1.0)
    assert b"NaN" not in packet
    assert unpacked(packet)[0]["utilisation"] is None


def test_torn_packets_are_refused() -> None:
    rng = np.random.default_rng(0)
    good = b"PLP1" + struct.pack("<I", 2) + b"{}" + bytes(8)
    assert unpacked(good)[1].size == 2
    for cut in range(len(good) - 8):
        with pytest.raises(pp.InvalidInput):
            unpacked(good[:cut])
    for _ in range(1000):
        with pytest.raises(pp.InvalidInput):
            unpacked(rng.bytes(int(rng.integers(0, 60))))
    with pytest.raises(pp.InvalidInput, match="torn"):
        unpacked(b"PLP1" + struct.pack("<I", 2**31) + b"{}")
    with pytest.raises(pp.InvalidInput, match="JSON"):
        unpacked(b"PLP1" + struct.pack("<I", 4) + b"\xff{}}")


def test_the_page_and_its_stream(skin: pp.Skin) -> None:
    live = Live(session(skin))
    with testclient.TestClient(live.app) as client:
        page = client.get("/")
        assert page.status_code == 200
        assert "default-src 'self'" in page.headers["content-security-policy"]
        for name in ("live.js", "live.css"):
            assert client.get(f"/{name}").status_code == 200
            assert name in page.text
        assert client.get("/../session.py").status_code == 404
        with client.websocket_connect("/stream") as socket:
            layout = json.loads(socket.receive_text())
            assert layout["shape"] == list(skin.surface.shape)
            assert not layout["may_record"]
            numbers = [unpacked(socket.receive_bytes())[0] for _ in range(40)]
        frames = [n["frame"] for n in numbers]
        assert frames == sorted(set(frames))
        health = client.get("/health").json()
        assert health["frames"] >= frames[-1]
        assert health["failure"] is None


def test_a_slow_page_gets_the_newest_and_nothing_queues(skin: pp.Skin) -> None:
    live = Live(session(skin, rate=400.0))
    with testclient.TestClient(live.app) as client, client.websocket_connect("/stream") as socket:
        socket.receive_text()
        socket.receive_bytes()
        time.sleep(1.0)
        # what was under way, then the present
        late = [unpacked(socket.receive_bytes())[0]["frame"] for _ in range(12)]
        assert client.get("/health").json()["frames"] - late[-1] < 400


def test_doors(skin: pp.Skin) -> None:
    """Another origin, a missing token, long and wrong messages: refused, counted, and the service lives on."""
    live = Live(session(skin), token="secret")
    with testclient.TestClient(live.app) as client:
        assert client.get("/").status_code == 403
        assert client.get("/health").status_code == 403
        assert client.get("/?token=secret").status_code == 200
        for headers, path in (
            ({"origin": "http://evil.example"}, "/stream?token=secret"),
            ({}, "/stream"),
            ({}, "/stream?token=wrong"),
        ):
            with (
                pytest.raises(testclient.WebSocketDisconnect),
                client.websocket_connect(path, headers=headers) as socket,
            ):
                socket.receive_text()
        with client.websocket_connect("/stream?token=secret", headers={"origin": "http://testserver"}) as socket:
            socket.receive_text()
            rng = np.random.default_rng(0)
            for i in range(1000):
                kind = i % 5
                if kind == 0:
                    socket.send_bytes(rng.bytes(50))
                else:
                    socket.send_text(
                        ["{", '{"record": 3}', '{"record": "' + "x" * 5000 + '"}', '{"erase": true}'][kind - 1]
                    )
            deadline = time.monotonic() + 20
            while live.refused.get("message", 0) < 1000 and time.monotonic() < deadline:
                socket.receive_bytes()
            assert unpacked(socket.receive_bytes())[0]["frame"] > 0
        refused = client.get("/health?token=secret").json()["refused"]
        assert refused["message"] == 1000
        assert refused["origin"] == 1
        assert refused["token"] == 4


def test_recording_from_the_page(skin: pp.Skin, tmp_path: Path) -> None:
    live = Live(session(skin), folder=tmp_path)
    with testclient.TestClient(live.app) as client, client.websocket_connect("/stream") as socket:
        assert json.loads(socket.receive_text())["may_record"]
        socket.send_text('{"record": true}')
        names: list[Any] = []
        for stop in (False, True):
            if stop:
                begun = live.session.count
                while live.session.count < begun + 30:
                    socket.receive()
                socket.send_text('{"record": false}')
            while len(names) < 1 + stop:
                message = socket.receive()
                if message.get("text"):
                    names.append(json.loads(message["text"])["recording"])
    assert names[1] is None
    (path,) = tmp_path.iterdir()
    assert path.name == names[0]
    assert len(read_robot(path).readings) > 10
    assert "/palpate/wrench" in topics(path)


def test_a_sensor_on_the_network(skin: pp.Skin) -> None:
    import socket

    from palpate.network import FrameListener, frame_bytes

    listener = FrameListener((3, 10, 10))
    one = Session(
        skin, lambda: listener, skin.track(friction=0.6), pp.GraspMonitor(friction=0.6), pace=False, end=listener.close
    )
    reading = skin.sense(BALL) + 100.0 * np.random.default_rng(0).standard_normal((3, 10, 10))
    with testclient.TestClient(Live(one).app) as client, client.websocket_connect("/stream") as page:
        page.receive_text()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for i in range(5):
                sender.sendto(b"noise", ("127.0.0.1", listener.port))
                sender.sendto(frame_bytes(i, 0.01 * i, reading), ("127.0.0.1", listener.port))
                numbers = unpacked(page.receive_bytes())[0]
        assert numbers["force"][2] == pytest.approx(1.0, abs=0.05)
        assert numbers["time"] == pytest.approx(0.04)
        begun = time.monotonic()
    assert time.monotonic() - begun < 5
    assert listener.counts["malformed"] == 5


def test_a_failing_source_is_said(skin: pp.Skin) -> None:
    live = Live(session(skin, wrong_at=30))
    with testclient.TestClient(live.app) as client, client.websocket_connect("/stream") as socket:
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            message = socket.receive()
            if message.get("text") and "failure" in json.loads(message["text"]):
                break
        assert "a frame must have shape" in json.loads(message["text"])["failure"]
        assert client.get("/health").json()["failure"]


def test_sessions_end(skin: pp.Skin) -> None:
    before = threading.active_count()
    one = session(skin, frames=30, rate=1000.0)
    one.start()
    time.sleep(0.5)
    one.stop()
    assert one.count > 10
    assert threading.active_count() <= before


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium on this machine")
def test_in_a_browser(tmp_path: Path) -> None:
    """The page in headless Chromium paints what the demonstration sends."""
    out = subprocess.run(
        [
            sys.executable,
            str(Path(__file__).parents[1] / "benchmarks" / "live.py"),
            "--seconds",
            "4",
            "--shots",
            str(tmp_path),
        ],
        capture_output=True,
        text=True,
        timeout=180,
    )
    assert out.returncode == 0, out.stderr
    numbers = json.loads(out.stdout.splitlines()[-1])
    assert numbers["painted"] > 60
    assert numbers["failures"] == 0
    assert numbers["errors"] == []
    assert len(list(tmp_path.glob("*.png"))) == 4
    assert all(p.stat().st_size > 20_000 for p in tmp_path.glob("*.png"))
