"""The page's doors and its stream: who is let in, who is cut off, and what late-comers are told."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.live import Live, Session, address, connections, packed, server, unpacked
from palpate.live.server import is_local, serve
from palpate.network import FrameListener, frame_bytes

testclient = pytest.importorskip("starlette.testclient")

HERE, STREAM = "http://127.0.0.1:8765", "ws://127.0.0.1:8765/stream"


class Still:
    """A tracker that answers every frame alike, and at once."""

    def __init__(self, skin: pp.Skin) -> None:
        self.inner = skin.track(baseline=0)
        self.names, self.notes, self.seconds = self.inner.names, self.inner.notes, 0.0
        self.health, self.unknowns, self.zero = self.inner.health, self.inner.unknowns, self.inner.zero
        self.touch = self.inner.step(np.zeros((1, 4, 4)), 0.0)
        self.times: list[float] = []

    def step(self, reading: Any, time: float) -> pp.Touch:
        self.health.frames += 1
        self.times.append(time)
        return self.touch

    def close(self) -> None:
        self.inner.close()


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    array = pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1.5e-3, channels=["stress_zz"], noise=100.0)
    return pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)


class Feed:
    """Frames as they are put in; ends with None, fails with an exception."""

    def __init__(self) -> None:
        self.ready = threading.Condition()
        self.frames: list[Any] = []

    def put(self, *frames: Any) -> None:
        with self.ready:
            self.frames += frames
            self.ready.notify()

    def __iter__(self) -> Iterator[tuple[float, Any]]:
        while True:
            with self.ready:
                self.ready.wait_for(lambda: self.frames)
                frame = self.frames.pop(0)
            if frame is None:
                return
            if isinstance(frame, Exception):
                raise frame
            yield frame, np.zeros((1, 4, 4))


@pytest.fixture
def feed() -> Iterator[Feed]:
    one = Feed()
    yield one
    one.put(None)


def session(skin: pp.Skin, feed: Any, **options: Any) -> Session:
    tracker: Any = Still(skin)
    return Session(skin, lambda: feed, tracker, pp.GraspMonitor(), pace=False, end=lambda: feed.put(None), **options)


def until(what: Any) -> None:
    deadline = time.monotonic() + 120
    while not what():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def told(page: Any, key: str) -> Any:
    while True:
        message = page.receive()
        assert message["type"] != "websocket.close"
        if message.get("text") and key in (facts := json.loads(message["text"])):
            return facts[key]


@pytest.mark.parametrize(
    ("host", "known"),
    [
        ("127.0.0.1", True), ("127.0.0.1:8765", True), ("127.8.9.1:1", True), ("localhost:8765", True), ("LOCALHOST", True),
        ("[::1]:8765", True), ("evil.example", False), ("evil.example:8765", False), ("127.0.0.1.evil.example", False),
        ("localhost.evil.example", False), ("192.168.1.7:8765", False), ("", False), ("[::1", False), ("a b", False),
        ("evil.example@127.0.0.1x", False), ("0.0.0.0", False),
    ],
)  # fmt: skip
def test_names_of_this_machine(host: str, known: bool) -> None:
    assert is_local(host) is known


def test_a_foreign_name_for_this_machine_gets_nothing_without_a_token(skin: pp.Skin, feed: Feed) -> None:
    """DNS rebinding: Host and Origin agree, and both are evil."""
    live = Live(session(skin, feed), token="")
    evil = {"host": "evil.example:8765", "origin": "http://evil.example:8765"}
    with testclient.TestClient(live.app, base_url=HERE) as client:
        for path in ("/", "/live.js", "/health"):
            assert client.get(path).status_code == 200
            answer = client.get(path, headers=evil)
            assert answer.status_code == 421
            assert "palpate" not in answer.text
        with pytest.raises(testclient.WebSocketDisconnect), client.websocket_connect(STREAM, headers=evil):
            pass
        assert live.refused == {"host": 4}
        with client.websocket_connect(STREAM, headers={"origin": HERE}) as page:
            assert told(page, "state")["failure"] is None


def test_a_token_is_made_up_unless_it_is_given(skin: pp.Skin, feed: Feed) -> None:
    live = Live(session(skin, feed))
    assert len(live.token) >= 20
    assert live.token != Live(session(skin, feed)).token
    assert address(live, "::1", 80) == f"http://[::1]:80/?token={live.token}"
    assert address(Live(session(skin, feed), token=""), "127.0.0.1", 80) == "http://127.0.0.1:80/"
    with testclient.TestClient(live.app, base_url=HERE) as client:
        assert client.get("/").status_code == 403
        assert client.get(f"/?token={live.token}").status_code == 200
        for header, status in ((f"Bearer {live.token}", 200), ("Bearer é", 403), (live.token, 403), ("Bearer", 403)):
            assert client.get("/health", headers={"authorization": header.encode()}).status_code == status
    with pytest.raises(pp.InvalidInput, match="token"):
        serve(Live(session(skin, feed), token=""), host="0.0.0.0")


def test_a_page_opened_after_the_end_is_told(skin: pp.Skin, feed: Feed) -> None:
    for last, failure in ((ValueError("the sensor is on fire"), "the sensor is on fire"), (None, None)):
        one = session(skin, feed)
        feed.put(0.0, 0.1, last)
        if failure is None:
            one.run()
        else:
            with pytest.raises(ValueError, match="fire"):
                one.run()
        one.start = lambda: None  # type: ignore[method-assign]
        live = Live(one, token="")
        with testclient.TestClient(live.app, base_url=HERE) as client:
            for _ in range(2):
                with client.websocket_connect(STREAM) as page:
                    state = told(page, "state")
                    assert (state["failure"], state["ended"]) == (failure, True)
            assert client.get("/health").json()["failure"] == failure
            assert client.get("/health").json()["ended"]


def test_nested_json_is_counted_and_left(skin: pp.Skin, feed: Feed) -> None:
    live = Live(session(skin, feed), token="")
    with testclient.TestClient(live.app, base_url=HERE) as client, client.websocket_connect(STREAM) as page:
        told(page, "state")
        for text in ("[" * 1000, '{"a":' * 200, "[" * 1024, "null", '"record"', "NaN", '{"record": 1}'):
            page.send_text(text)
        until(lambda: live.refused.get("message") == 7)
        feed.put(0.0)
        until(lambda: live.session.count > 0)
        while not page.receive().get("bytes"):
            pass
    with pytest.raises(pp.InvalidInput, match="JSON"):
        unpacked(b"PLP1" + (100_000).to_bytes(4, "little") + b"[" * 100_000)


def test_twenty_quick_recordings_have_twenty_files(skin: pp.Skin, feed: Feed, tmp_path: Path) -> None:
    live = Live(session(skin, feed), token="", folder=tmp_path)
    with testclient.TestClient(live.app, base_url=HERE) as client, client.websocket_connect(STREAM) as page:
        names = []
        for i in range(40):
            page.send_text(json.dumps({"record": i % 2 == 0}))
            names.append(told(page, "recording"))
        assert len(set(names[::2])) == 20
        assert set(names[1::2]) == {None}
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names[::2])


def test_recordings_begun_without_end_are_bounded(
    skin: pp.Skin, feed: Feed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "RECORDINGS", 3)
    live = Live(session(skin, feed), token="", folder=tmp_path)
    with testclient.TestClient(live.app, base_url=HERE) as client, client.websocket_connect(STREAM) as page:
        for _ in range(6):
            page.send_text('{"record": true}')
        assert "wait a little" in told(page, "refused")
        until(lambda: live.refused.get("recordings") == 3)
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.long
def test_a_page_that_never_reads_gives_its_place_back(
    skin: pp.Skin, feed: Feed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A real server and a real socket that is never read; others are served meanwhile and after."""
    uvicorn = pytest.importorskip("uvicorn")
    from websockets.sync.client import connect

    monkeypatch.setattr(server, "STALLED", 0.5)
    monkeypatch.setattr(server, "PAGES", 2)
    live = Live(session(skin, feed), token="")
    with socket.create_server(("127.0.0.1", 0)) as bound:
        where = f"127.0.0.1:{bound.getsockname()[1]}"
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        runner = uvicorn.Server(uvicorn.Config(live.app, log_level="critical", ws_per_message_deflate=False))
        thread = threading.Thread(target=runner.run, kwargs={"sockets": [bound]})
        thread.start()
        try:
            until(lambda: runner.started)
            with socket.socket() as deaf:
                deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                deaf.connect(bound.getsockname())
                deaf.sendall(
                    f"GET /stream HTTP/1.1\r\nHost: {where}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
                )
                until(lambda: live.pages == 1)
                stop = threading.Event()
                count = 0
                while "stalled" not in live.refused and not stop.wait(0.002):
                    feed.put(0.01 * count)
                    count += 1
                    assert count < 20_000
                until(lambda: live.pages == 0)
                with connect(f"ws://{where}/stream") as page:
                    assert json.loads(page.recv(timeout=120))["shape"]
        finally:
            runner.should_exit = True
            thread.join(timeout=120)


def asked_again_and_again(port: int, token: str, seconds: float) -> tuple[bool, float]:
    """Whether a program that asks for /health again and again keeps its one connection, and the longest pause in its asking."""
    client = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    pause, last = 0.0, time.monotonic()
    end = last + seconds
    with contextlib.closing(client):
        client.connect()
        kept = client.sock
        while last < end:
            try:
                client.request("GET", "/health", headers={"Authorization": f"Bearer {token}"})
                answer = client.getresponse()
                assert answer.status == 200
                answer.read()
            except ConnectionError:
                kept = None
            now = time.monotonic()
            pause, last = max(pause, now - last), now
            if client.sock is not kept or kept is None:
                return False, pause
            time.sleep(0.01)
    return True, pause


@pytest.fixture
def serving(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A function that serves a page by `serve` itself, and returns its port; it is stopped as Ctrl-C stops it."""
    uvicorn = pytest.importorskip("uvicorn")
    made: list[Any] = []
    threads: list[threading.Thread] = []

    class Kept(uvicorn.Server):  # type: ignore[misc]
        def __init__(self, config: Any) -> None:
            super().__init__(config)
            made.append(self)

    monkeypatch.setattr(uvicorn, "Server", Kept)

    def begin(live: Live) -> int:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = int(free.getsockname()[1])
        threads.append(threading.Thread(target=serve, args=(live,), kwargs={"port": port}))
        threads[-1].start()
        until(lambda: made and made[-1].started)
        return port

    yield begin
    for one in made:
        one.should_exit = True
    for thread in threads:
        thread.join(timeout=120)


def test_connections_that_never_ask_are_closed(
    skin: pp.Skin, feed: Feed, monkeypatch: pytest.MonkeyPatch, serving: Any
) -> None:
    monkeypatch.setattr(connections, "HELLO", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(pp.InvalidInput, match="cannot listen"):
        serve(Live(session(skin, feed)), port=taken.getsockname()[1])
    live = Live(session(skin, feed))
    port = serving(live)
    with (
        socket.create_connection(("127.0.0.1", port)) as silent,
        socket.create_connection(("127.0.0.1", port)) as slow,
    ):
        slow.sendall(b"GET / HT")
        for one in (silent, slow):
            one.settimeout(120)
            with pytest.raises(ConnectionResetError):
                raise ConnectionResetError if not one.recv(1) else AssertionError
    for _ in range(20):  # where the machine paused for so long that the program did not ask, once more
        kept, pause = asked_again_and_again(port, live.token, 5 * connections.HELLO)
        if kept or pause < 0.5 * connections.HELLO:
            break
    assert kept


def closed(one: socket.socket) -> bool:
    """Whether the other side has ended a connection on which it sent nothing."""
    one.setblocking(False)
    try:
        return one.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def test_idle_connections_leave_room_for_a_page(
    skin: pp.Skin, feed: Feed, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, serving: Any
) -> None:
    """Of 60 connections that ask for nothing 8 stay, the page and its stream are served all the same, and the log has one line."""
    from websockets.sync.client import connect

    monkeypatch.setattr(server, "OPEN", 8)
    live = Live(session(skin, feed))
    port = serving(live)
    with contextlib.ExitStack() as stack:
        page = stack.enter_context(connect(f"ws://127.0.0.1:{port}/stream?token={live.token}", open_timeout=120))
        page.recv(timeout=120)
        idle = [stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=120)) for _ in range(60)]
        until(lambda: sum(map(closed, idle)) == 60 - 7)
        assert not any(map(closed, idle[-7:]))  # the newest stay
        client = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
        client.request("GET", "/health", headers={"Authorization": f"Bearer {live.token}"})
        health = json.loads(client.getresponse().read())
        client.close()
        assert health["pages"] == 1
        assert health["refused"] == {"connections": 54}
        feed.put(0.0)
        while isinstance(page.recv(timeout=120), str):
            pass
    (line,) = [r for r in caplog.records if r.name == "palpate.live"]
    assert line.getMessage().startswith("8 connections are open")


def test_requests_that_are_none_fill_no_log(
    skin: pp.Skin, feed: Feed, capfd: pytest.CaptureFixture[str], serving: Any
) -> None:
    port = serving(Live(session(skin, feed)))
    for _ in range(20):
        with socket.create_connection(("127.0.0.1", port), timeout=120) as one:
            one.sendall(b"what\r\n\r\n")
            assert one.recv(20).startswith(b"HTTP/1.1 400")
    assert capfd.readouterr().err.count("Invalid HTTP request received.") == 1


def test_a_system_without_descriptors_is_said_in_one_line(caplog: pytest.LogCaptureFixture) -> None:
    logger = connections.logging.getLogger("palpate.live")
    loop = asyncio.new_event_loop()
    try:
        connections.accept_failures_are_warnings(loop, logger)
        with connections.seldom(logger):
            for _ in range(100):
                loop.call_exception_handler(
                    {"message": "accept", "exception": OSError(errno.EMFILE, "Too many open files")}
                )
        loop.call_exception_handler({"message": "another fault", "exception": OSError(errno.EPIPE, "Broken pipe")})
    finally:
        loop.close()
    said = [(r.name, r.getMessage().splitlines()[0], bool(r.exc_info)) for r in caplog.records]
    assert said == [
        ("palpate.live", "no connection can be accepted: Too many open files.", False),
        ("asyncio", "another fault", True),
    ]


@pytest.mark.parametrize(
    "origin", ["http://[::1", "http://[", "//[v1.x", "http://[::1]]:80", "null", "", "http://evil.example"]
)
def test_an_origin_that_is_no_address_is_refused(skin: pp.Skin, feed: Feed, origin: str) -> None:
    live = Live(session(skin, feed), token="secret")
    with testclient.TestClient(live.app, base_url=HERE) as client:
        for address_ in (STREAM, f"{STREAM}?token=secret"):
            with (
                pytest.raises(testclient.WebSocketDisconnect),
                client.websocket_connect(address_, headers={"origin": origin}),
            ):
                pass
        assert live.refused == {"origin": 2}


@pytest.mark.parametrize(
    ("ending", "spelling"),
    [
        ("mcap", ("--token", "S3CRET 7")),
        ("mcap", ("--token=S3CRET 7",)),
        ("nc", ("--token", "S3CRET 7")),
        ("h5", ("--token=S3CRET 7",)),
        ("zarr", ("--token", "S3CRET 7")),
    ],
)
@pytest.mark.long
def test_a_token_is_in_no_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str, spelling: tuple[str, ...]
) -> None:
    from command_line import run
    from palpate.recordings import read_recording

    def serve(live: Live, *, host: str, port: int) -> None:
        assert live.token == "S3CRET 7"
        with testclient.TestClient(live.app, base_url=HERE):
            until(lambda: live.session.count > 2)

    monkeypatch.setattr("palpate.live.serve", serve)
    done = run("live", "--demo", "--record", f"r.{ending}", *spelling, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    command = read_recording(tmp_path / f"r.{ending}").meta["command"]
    assert command.startswith("palpate live --demo --record")
    assert "HIDDEN" in command
    assert not holding(b"S3CRET", tmp_path)


def holding(secret: bytes, folder: Path) -> list[str]:
    """Files below a folder in which a secret stands."""
    return [str(p) for p in folder.rglob("*") if p.is_file() and secret in p.read_bytes()]


@pytest.mark.parametrize(
    "command",
    [
        "palpate live --token S3CRET --demo",
        "palpate live --token=S3CRET",
        "palpate live '--token=S3CRET 7'",
        "live --token 'S3CRET",
    ],
)
@pytest.mark.long
def test_a_token_of_an_older_recording_is_not_carried_on(tmp_path: Path, command: str) -> None:
    from command_line import run
    from palpate.recordings import read_recording

    old = tmp_path / "old.csv"
    meta = {"command": command, "operator": "A. B."}
    old.write_text(f"# meta: {json.dumps(meta)}\ntime (s),stress_zz[0;0] (Pa)\n0.0,1.0\n0.1,2.0\n")
    (tmp_path / "new").mkdir()
    for ending in ("csv", "npz", "nc", "h5", "mcap", "zarr"):
        done = run("convert", "old.csv", f"new/r.{ending}", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        kept = read_recording(tmp_path / "new" / f"r.{ending}").meta
        assert "S3CRET" not in str(kept)
        assert kept["operator"] == "A. B."
    assert not holding(b"S3CRET", tmp_path / "new")


def test_times_go_on_where_a_sensor_begins_again(skin: pp.Skin, feed: Feed) -> None:
    """One time that only increases for page, tracker and sinks; said among the events."""

    class Sink:
        times: list[float] = []  # noqa: RUF012

        def readings(self, time: float, values: Any) -> None:
            self.times.append(time)

        def touch(self, touch: pp.Touch, time: float | None = None) -> None: ...
        def event(self, event: Any) -> None: ...
        def close(self) -> None: ...

    sink = Sink()
    one = session(skin, feed, sinks=[sink])
    feed.put(50.0, 50.1, 50.2, 0.0, 0.1, 0.2, None)
    one.run()
    times = one.tracker.times  # type: ignore[attr-defined]
    assert times == sink.times
    assert times[:3] == pytest.approx([0.0, 0.1, 0.2])
    assert (np.diff(times) > 0).all()
    assert np.diff(times)[3:] == pytest.approx([0.1, 0.1])
    assert ["went back by 50.2 s" in text for text in one.past] == [True]
    assert one.ended


def test_a_restarted_sensor_on_the_wire_stays_on_the_page(skin: pp.Skin) -> None:
    """Through the listener: the sender's words and counts reach a page that gets no new frame."""
    listener = FrameListener((1, 4, 4))
    tracker: Any = Still(skin)
    one = Session(skin, lambda: listener, tracker, pp.GraspMonitor(), pace=False, end=listener.close)
    with (
        testclient.TestClient(Live(one, token="").app, base_url=HERE) as client,
        client.websocket_connect(STREAM) as page,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        sender.connect(("127.0.0.1", listener.port))
        for start in (7.0, 0.0):
            for i in range(4):
                sender.send(frame_bytes(int(5000 * start) + i, start + 0.01 * i, np.zeros((1, 4, 4))))
                time.sleep(0.005)
        sender.send(frame_bytes(9, 9.0, np.zeros((1, 2, 8))))
        until(lambda: one.count == 8)
        texts: list[str] = list(told(page, "log"))
        while not any("refused (shape): a frame of 1 x 2 x 8 came" in t for t in texts):
            texts += told(page, "log")
        assert any("began again" in t for t in texts)
        while (state := told(page, "state"))["received"].get("shape") != 1:
            pass
        assert state["sender"].startswith("127.0.0.1:")
        health = client.get("/health").json()
        assert (health["received"]["frames"], health["received"]["sessions"]) == (8, 2)
    assert (np.diff(tracker.times) > 0).all()


def test_a_slow_page_is_told_every_event(skin: pp.Skin, feed: Feed) -> None:
    """Packets are skipped, words are not."""
    one = session(skin, feed)
    with (
        testclient.TestClient(Live(one, token="").app, base_url=HERE) as client,
        client.websocket_connect(STREAM) as page,
    ):
        told(page, "state")
        for i in range(50):
            one.note(f"event {i}")
        texts: list[str] = []
        while len(texts) < 50:
            texts += told(page, "log")
        assert texts == [f"event {i}" for i in range(50)]
    touch = one.tracker.touch  # type: ignore[attr-defined]
    assert b"refused" not in packed(touch, one.monitor, [], {"frames": 1}, born=0.0, ms=0.0)
