"""A new zero while the stream runs: from the session, the page, the sensor's driver, and in a recording."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import run
from palpate.live import Session
from palpate.network import FrameListener, frame_bytes, zero_bytes
from palpate.recordings import recorder
from palpate.status import Status
from skin_files import SHEAR, skin_text

ARRAY = pp.AreaArray(
    shape=(6, 6), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=100.0
)
PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
#: What the zero has jumped to [Pa].
JUMP = 3e3


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, ARRAY)


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(0.01)


def frames(count: int, offset: float = JUMP) -> Iterator[tuple[float, Any]]:
    rng = np.random.default_rng(0)
    for i in range(count):
        yield 0.01 * i, offset + 100.0 * rng.standard_normal((3, 6, 6))


def test_a_session_takes_a_new_zero_and_says_so(skin: pp.Skin) -> None:
    tracker, touching = skin.track(baseline=0, rezero=None), []

    def step(readings: Any, time: float) -> pp.Touch:
        touching.append(tracker.step(readings, time))
        return touching[-1]

    one = Session(skin, lambda: frames(30), tracker, pp.GraspMonitor(), pace=False, step=step)
    one.rezero(12)
    one.run()
    found = [Status.coded(int(t.status)) for t in touching]
    assert found[:12] == [Status.CAPTURING_ZERO] * 12
    assert found[-1] is Status.NO_CONTACT
    assert any("new zero is taken from 12 frames" in text for text in one.past)


def test_only_a_page_with_the_token_may_ask(skin: pp.Skin) -> None:
    testclient = pytest.importorskip("starlette.testclient")
    from palpate.live import Live

    for token, admitted in (("secret", True), ("", False)):
        one = Session(skin, lambda: frames(100_000), skin.track(baseline=0), pp.GraspMonitor(), pace=True)
        live = Live(one, token=token)
        with (
            testclient.TestClient(live.app, base_url="http://127.0.0.1") as client,
            client.websocket_connect(f"ws://127.0.0.1/stream?token={token}") as page,
        ):
            assert json.loads(page.receive_text())["may_zero"] is admitted
            page.send_text('{"zero": true}')
            if admitted:
                until(lambda one=one: any("new zero is taken" in text for text in one.past))  # type: ignore[misc]
            else:
                until(lambda live=live: live.refused.get("message", 0) == 1)  # type: ignore[misc]


def test_the_drivers_wish_reaches_the_session_and_nobody_elses_does() -> None:
    asked: list[int] = []
    with FrameListener((3, 6, 6), zero=asked.append) as listener:
        driver, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        to = ("127.0.0.1", listener.port)
        with driver, other:
            driver.sendto(frame_bytes(0, 0.0, np.zeros((3, 6, 6))), to)
            until(lambda: listener.counts["frames"] == 1)
            other.sendto(zero_bytes(5), to)
            until(lambda: listener.counts["busy"] == 1)
            for bad in (b"PLPZ", b"PLPZ" + bytes(4), zero_bytes(7) + b"!", b"PLPZ\xff\xff\xff\xff"):
                driver.sendto(bad, to)
            until(lambda: listener.counts["malformed"] == 4)
            driver.sendto(zero_bytes(7), to)
            until(lambda: asked == [7])
        assert any("asks for a new zero" in text for text in listener.events)


def test_without_anybody_to_take_it_a_wish_is_malformed() -> None:
    with FrameListener((3, 6, 6)) as listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as driver:
        driver.sendto(zero_bytes(), ("127.0.0.1", listener.port))
        until(lambda: listener.counts["malformed"] == 1)


@pytest.mark.parametrize("frames", [0, -1, 1.5, True, 10_001])
def test_a_zero_is_taken_from_a_whole_number_of_frames(frames: Any) -> None:
    with pytest.raises(pp.InvalidInput, match="frames must be"):
        zero_bytes(frames)


def test_a_recording_is_zeroed_where_it_is_said(tmp_path: Path) -> None:
    with recorder(tmp_path / "rest.nc", ARRAY.channels) as recording:
        for moment, reading in frames(40):
            recording.readings(moment, reading)
    (tmp_path / "skin.toml").write_text(skin_text(6, 6, channels=SHEAR, depth="1.5 mm", noise="100 Pa"))
    call = ("track", "rest.nc", "--skin", "skin.toml", "--zero-at")
    done = run(*call, "0.1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "0.100 s  a new zero is taken" in done.stdout
    refused = run(*call, "9", cwd=tmp_path)
    assert refused.returncode != 0
    assert "goes from 0 to 0.39 s" in refused.stderr
