"""The live view: packets, the server's doors, and the page in a real browser where there is one."""

from __future__ import annotations

import contextlib
import json
import shutil
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.live import Live, Session, packed, unpacked
from palpate.recordings.robots import read_robot, topics
from skin_files import SHEAR, skin_text

testclient = pytest.importorskip("starlette.testclient")

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
ARRAY = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
BALL = solutions.hertz_point(contact_radius=2.5e-3, force=1.0).partial_slip(0.6, 0.3)


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, ARRAY)


#: Seconds that a machine with other things to do may take; nobody waits as long where it goes well.
PATIENCE = 120.0


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def session(skin: pp.Skin, frames: int = 100_000, rate: float = 100.0, wrong_at: int | None = None) -> Session:
    clean = skin.sense(BALL)
    rng = np.random.default_rng(0)

    def source() -> Iterator[tuple[float, Any]]:
        for i in range(frames):
            if wrong_at is not None and i >= wrong_at:  # a frame that is late is skipped
                yield i / rate, np.zeros((2, 2))
            yield i / rate, (clean if i > 20 else 0.0) + 100.0 * rng.standard_normal(clean.shape)

    return Session(skin, source, skin.track(friction=0.6, baseline=10), pp.GraspMonitor(friction=0.6), name="test")


#: Where the pages of these tests are.
HERE = "http://127.0.0.1"


def packet(socket: Any) -> dict[str, Any]:
    """The numbers of the next packet; what is told in between is left."""
    while True:
        message = socket.receive()
        if message["type"] == "websocket.close":
            raise AssertionError("closed")
        if message.get("bytes"):
            return unpacked(message["bytes"])[0]


def told(socket: Any, key: str) -> Any:
    """The next thing of this name that a page is told."""
    while True:
        message = socket.receive()
        if message["type"] == "websocket.close":
            raise AssertionError("closed")
        if message.get("text") and key in (facts := json.loads(message["text"])):
            return facts[key]


def test_packets_hold_what_the_touch_holds(skin: pp.Skin) -> None:
    tracker, monitor = skin.track(friction=0.6), pp.GraspMonitor(friction=0.6)
    for seconds in (1.3, 1.4, 1.5):
        touch = tracker.step(skin.sense(BALL), seconds)
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
    with pytest.raises(pp.InvalidInput, match="incomplete"):
        unpacked(b"PLP1" + struct.pack("<I", 2**31) + b"{}")
    with pytest.raises(pp.InvalidInput, match="JSON"):
        unpacked(b"PLP1" + struct.pack("<I", 4) + b"\xff{}}")


@pytest.mark.long
def test_the_page_and_its_stream(skin: pp.Skin) -> None:
    live = Live(session(skin), token="")
    with testclient.TestClient(live.app, base_url=HERE) as client:
        page = client.get("/")
        assert page.status_code == 200
        assert "default-src 'self'" in page.headers["content-security-policy"]
        for name in ("live.js", "map.js", "charts.js", "live.css", "uplot.js", "uplot.css"):
            assert client.get(f"/{name}").status_code == 200
            assert name in page.text
        assert client.get("/../session.py").status_code == 404
        with client.websocket_connect("ws://127.0.0.1/stream") as socket:
            layout = json.loads(socket.receive_text())
            assert layout["shape"] == list(skin.surface.shape)
            assert not layout["may_record"]
            numbers = [packet(socket) for _ in range(40)]
        frames = [n["frame"] for n in numbers]
        assert frames == sorted(set(frames))
        health = client.get("/health").json()
        assert health["frames"] >= frames[-1]
        assert health["failure"] is None


@pytest.mark.long
def test_a_slow_page_gets_the_newest_and_nothing_queues(skin: pp.Skin, monkeypatch: pytest.MonkeyPatch) -> None:
    """A page whose connection takes nothing for 60 frames: what was under way, then the present."""
    import asyncio

    from palpate.live import server

    monkeypatch.setattr(server, "STALLED", PATIENCE)
    live = Live(session(skin, rate=400.0), token="")
    frames: list[int] = []

    async def page() -> int:
        taken, left = asyncio.Event(), asyncio.Event()
        asked = iter([{"type": "websocket.connect"}])

        async def receive() -> dict[str, Any]:
            for message in asked:
                return message
            await left.wait()
            return {"type": "websocket.disconnect", "code": 1000}

        async def send(message: Any) -> None:
            if message.get("bytes"):
                frames.append(unpacked(message["bytes"])[0]["frame"])
                await taken.wait()
                if len(frames) > 3:
                    left.set()

        scope = {"type": "websocket", "scheme": "ws", "path": "/stream", "root_path": "", "query_string": b""}
        scope |= {"headers": [(b"host", b"127.0.0.1")], "subprotocols": [], "client": ("127.0.0.1", 1)}
        async with asyncio.timeout(PATIENCE):
            serving = asyncio.create_task(live.app(scope, receive, send))
            while not frames or live.session.count < frames[0] + 60:
                await asyncio.sleep(0.005)
            now = live.session.count
            taken.set()
            await serving
        return now

    live.session.start()
    try:
        now = asyncio.run(page())
    finally:
        live.session.stop()
    assert frames[2] >= now, frames


@pytest.mark.long
def test_doors(skin: pp.Skin) -> None:
    """Another origin, a missing token, long and wrong messages: refused, counted, and the service lives on."""
    live = Live(session(skin), token="secret")
    with testclient.TestClient(live.app, base_url=HERE) as client:
        assert client.get("/").status_code == 403
        assert client.get("/health").status_code == 403
        assert client.get("/?token=secret").status_code == 200
        for headers, path in (
            ({"origin": "http://evil.example"}, "ws://127.0.0.1/stream?token=secret"),
            ({}, "ws://127.0.0.1/stream"),
            ({}, "ws://127.0.0.1/stream?token=wrong"),
        ):
            with (
                pytest.raises(testclient.WebSocketDisconnect),
                client.websocket_connect(path, headers=headers) as socket,
            ):
                socket.receive_text()
        with client.websocket_connect(
            "ws://127.0.0.1/stream?token=secret", headers={"origin": "http://127.0.0.1"}
        ) as socket:
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
            deadline = time.monotonic() + PATIENCE
            while live.refused.get("message", 0) < 1000 and time.monotonic() < deadline:
                packet(socket)
            assert packet(socket)["frame"] > 0
        refused = client.get("/health?token=secret").json()["refused"]
        assert refused["message"] == 1000
        assert refused["origin"] == 1
        assert refused["token"] == 4


def test_recording_from_the_page(skin: pp.Skin, tmp_path: Path) -> None:
    live = Live(session(skin), token="", folder=tmp_path)
    with (
        testclient.TestClient(live.app, base_url=HERE) as client,
        client.websocket_connect("ws://127.0.0.1/stream") as socket,
    ):
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
                if message.get("text") and "recording" in (facts := json.loads(message["text"])):
                    names.append(facts["recording"])
    assert names[1] is None
    (path,) = tmp_path.iterdir()
    assert path.name == names[0]
    assert len(read_robot(path).readings) > 10
    assert "/palpate/wrench" in topics(path)


@pytest.mark.long
def test_a_sensor_on_the_network(skin: pp.Skin) -> None:
    import socket

    from palpate.network import FrameListener, frame_bytes

    listener = FrameListener((3, 10, 10))
    one = Session(
        skin, lambda: listener, skin.track(friction=0.6), pp.GraspMonitor(friction=0.6), pace=False, end=listener.close
    )
    reading = skin.sense(BALL) + 100.0 * np.random.default_rng(0).standard_normal((3, 10, 10))
    with (
        testclient.TestClient(Live(one, token="").app, base_url=HERE) as client,
        client.websocket_connect("ws://127.0.0.1/stream") as page,
    ):
        page.receive_text()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for i in range(5):
                sender.sendto(b"noise", ("127.0.0.1", listener.port))
                sender.sendto(frame_bytes(i, 0.01 * i, reading), ("127.0.0.1", listener.port))
            while (numbers := packet(page))["time"] < 0.0399:
                pass
        assert numbers["force"][2] == pytest.approx(1.0, abs=0.05)
        assert numbers["time"] == pytest.approx(0.04)
        begun = time.monotonic()
    assert time.monotonic() - begun < PATIENCE
    assert listener.counts["malformed"] == 5


def test_a_failing_source_is_said(skin: pp.Skin) -> None:
    live = Live(session(skin, wrong_at=30), token="")
    with (
        testclient.TestClient(live.app, base_url=HERE) as client,
        client.websocket_connect("ws://127.0.0.1/stream") as socket,
    ):
        while (state := told(socket, "state"))["failure"] is None:
            pass
        assert "a frame must have shape" in state["failure"]
        assert state["ended"]
        assert client.get("/health").json()["failure"]


def test_sessions_end(skin: pp.Skin) -> None:
    before = threading.active_count()
    one = session(skin)
    one.start()
    until(lambda: one.count > 10)
    one.stop()
    assert one.count > 10
    assert threading.active_count() <= before


@pytest.mark.long
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium on this machine")
def test_in_a_browser(tmp_path: Path) -> None:
    """The page in headless Chromium paints what the demonstration sends."""
    out = subprocess.run(
        [
            sys.executable,
            str(Path(__file__).parents[2] / "benchmarks" / "live.py"),
            "--painted",
            "61",
            "--shots",
            str(tmp_path),
        ],
        capture_output=True,
        text=True,
        timeout=5 * PATIENCE,
    )
    assert out.returncode == 0, out.stderr
    numbers = json.loads(out.stdout.splitlines()[-1])
    assert numbers["painted"] > 60
    assert numbers["failures"] == 0
    assert numbers["errors"] == []
    assert len(list(tmp_path.glob("*.png"))) == 5
    keys = numbers["keys"]
    assert keys["theme"]
    assert keys["tab"][:4] == ["pause", "theme", "keys", "scrub"]
    assert keys["switched off"] == {"checked": "false", "theme": False, "space": "Pause", "kept": "false"}
    assert keys["switched on"]
    assert keys["space"] == "Resume"
    assert keys["paused"] == "paused"
    assert keys["resumed"]
    assert keys["still"]
    assert keys["back"].startswith("−")
    assert keys["axis"]
    assert numbers["cut off"] == {"lost": True, "again": True}
    assert all(p.stat().st_size > 20_000 for p in tmp_path.glob("*.png"))


SKIN = skin_text(10, 10, channels=SHEAR, depth="1.5 mm")


def free_port() -> int:
    import socket

    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@pytest.mark.parametrize("kind", ["udp", "tcp", "ws"])
@pytest.mark.long
def test_a_sensor_on_the_network_through_the_command(skin: pp.Skin, tmp_path: Path, kind: str) -> None:
    """palpate live: frames in by the network, recorded from the start, shown in Foxglove, ended by Ctrl-C."""
    import signal

    import httpx
    from test_network import sending
    from websockets.sync.client import connect

    from palpate.network import frame_bytes
    from palpate.recordings import read_touch

    (tmp_path / "skin.toml").write_text(SKIN)
    page, wire, glove = free_port(), free_port(), free_port()
    arguments = ["live", "--skin", "skin.toml", f"--{kind}", str(wire), "--port", str(page)]
    arguments += ["--foxglove", str(glove), "--record", "out.h5", "--baseline", "5", "--token", ""]
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate", *arguments], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    stack = contextlib.ExitStack()
    try:
        client = stack.enter_context(httpx.Client(base_url=f"http://127.0.0.1:{page}", timeout=PATIENCE))

        def answers() -> bool:
            try:
                return client.get("/health").is_success
            except httpx.ConnectError:
                assert process.poll() is None
                return False

        until(answers)
        clean = np.asarray(skin.sense(BALL), dtype=np.float32)
        rng = np.random.default_rng(0)
        noise = (100.0 * rng.standard_normal((40, *clean.shape))).astype(np.float32)
        values = [(clean if i > 10 else 0 * clean) + noise[i] for i in range(40)]
        with (
            connect(f"ws://127.0.0.1:{glove}", subprotocols=["foxglove.sdk.v1"]) as viewer,
            sending(kind, wire) as send,
        ):
            for i, frame in enumerate(values):
                send(frame_bytes(i, 0.01 * i, frame))
                until(lambda i=i: client.get("/health").json()["frames"] > i)
            seen: set[str] = set()
            while len(seen) < 3:
                seen |= {c["topic"] for c in json.loads(viewer.recv(timeout=PATIENCE)).get("channels", [])}
        assert client.get("/health").json()["received"]["frames"] == 40
        process.send_signal(signal.SIGINT)
        output = process.communicate(timeout=PATIENCE)[0].decode()
    finally:
        stack.close()
        process.kill()
        process.communicate()
    assert "Traceback" not in output, output
    assert f"ws://127.0.0.1:{glove}" in output
    assert seen >= {"/palpate/readings", "/palpate/touch", "/palpate/wrench"}
    found = pp.recordings.read_recording(tmp_path / "out.h5")
    np.testing.assert_array_equal(found.readings, values)
    np.testing.assert_allclose(found.time, 0.01 * np.arange(40), atol=1e-12)
    assert read_touch(tmp_path / "out.h5")["force"].values[-1, 2] == pytest.approx(1.0, abs=0.1)


def test_show_takes_a_generator(skin: pp.Skin, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One call from a driver of one's own to the page, and into a file."""
    from palpate.live import server, show
    from palpate.recordings import read_recording, recorder

    def serve(live: Live, *, host: str, port: int) -> None:
        assert (host, port) == ("127.0.0.1", 8765)
        with testclient.TestClient(live.app, base_url=HERE) as client:
            deadline = time.monotonic() + PATIENCE
            assert client.get("/health").status_code == 403
            health = f"/health?token={live.token}"
            while client.get(health).json()["frames"] < 30 and time.monotonic() < deadline:
                time.sleep(0.02)

    monkeypatch.setattr(server, "serve", serve)
    clean = skin.sense(BALL)
    show(
        skin,
        ((0.01 * i, clean) for i in range(30)),
        friction=0.6,
        sinks=[recorder(tmp_path / "a.zarr", ARRAY.channels)],
    )
    np.testing.assert_array_equal(read_recording(tmp_path / "a.zarr").readings, np.stack([clean] * 30))
    with pytest.raises(pp.InvalidInput, match="token"):
        show(skin, [], host="0.0.0.0", token="")
