"""Frames by zenoh between two peers of one process: readings in, touches out, the rules of every road."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

import palpate as pp
from palpate.live import Session, publish_touches, unpacked
from palpate.network import Limits, ZenohListener, frame_bytes, zenoh_session, zero_bytes

SHAPE = (3, 4, 4)


def wait(until: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 30
    while not until() and time.monotonic() < deadline:
        time.sleep(0.005)
    assert until()


@pytest.fixture
def peers() -> Iterator[tuple[Any, Any]]:
    """The one that listens, and a driver's."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        where = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    with zenoh_session(listen=where) as here, zenoh_session(connect=where) as driver:
        yield here, driver


def publishing(driver: Any, key: str) -> Callable[[int, bytes], None]:
    """What publishes under its own name, once somebody listens."""
    publisher = driver.declare_publisher(key)
    wait(lambda: publisher.matching_status.matching)
    return lambda n, data: publisher.put(data, source_info=zenoh.SourceInfo(publisher.id, n))


def test_frames_arrive_as_they_were_sent(peers: tuple[Any, Any]) -> None:
    here, driver = peers
    values = np.random.default_rng(0).standard_normal((5, *SHAPE)).astype(np.float32)
    values[2, 0, 1, 1] = np.nan
    with ZenohListener(here, SHAPE, key="finger/readings") as listener:
        send = publishing(driver, "finger/readings")
        for n, one in enumerate(values):
            send(n, frame_bytes(n, 0.01 * n, one))
        wait(lambda: listener.counts["frames"] == 5)
    found = list(listener)
    assert [t for t, _ in found] == [0.01 * n for n in range(5)]
    np.testing.assert_array_equal(np.stack([v for _, v in found]), values)


def test_what_is_no_frame_is_refused_and_publishers_do_not_mix(peers: tuple[Any, Any]) -> None:
    here, driver = peers
    zeros: list[int] = []
    with ZenohListener(here, SHAPE, key="finger/readings", limits=Limits(silence=30.0), zero=zeros.append) as listener:
        one, two = publishing(driver, "finger/readings"), publishing(driver, "finger/readings")
        one(0, frame_bytes(0, 0.0, np.ones(SHAPE)))
        wait(lambda: listener.counts["frames"] == 1)
        two(0, frame_bytes(1, 0.01, np.ones(SHAPE)))
        two(1, zero_bytes(5))
        one(1, b"no frame")
        one(2, frame_bytes(1, 0.01, np.ones((3, 2, 8))))
        one(3, zero_bytes(7))
        wait(lambda: zeros == [7])
        assert {k: v for k, v in listener.counts.items() if v} == {
            "frames": 1, "sessions": 1, "busy": 2, "malformed": 1, "shape": 1,
        }  # fmt: skip


def test_touches_are_published_with_their_intervals(peers: tuple[Any, Any]) -> None:
    """The force of a ball comes back over the network."""
    here, driver = peers
    array = pp.AreaArray(
        shape=(6, 6), pitch=2e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=60.0
    )
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    ball = skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0).sliding(0.2))
    rng = np.random.default_rng(0)
    listener = ZenohListener(here, (3, 6, 6), key="finger/readings")
    session = Session(
        skin,
        lambda: listener,
        skin.track(friction=0.6, baseline=4),
        pp.GraspMonitor(friction=0.6),
        pace=False,
        end=listener.close,
    )
    found: list[dict[str, Any]] = []
    driver.declare_subscriber("finger/touch", lambda sample: found.append(unpacked(bytes(sample.payload))[0]))
    end = publish_touches(session, here, key="finger/touch")
    session.start()
    send = publishing(driver, "finger/readings")
    try:
        for n in range(10):
            frame = rng.normal(0.0, 60.0, (3, 6, 6)) + (ball if n >= 5 else 0.0)
            send(n, frame_bytes(n, 0.02 * n, frame))
            wait(lambda n=n: len(found) > n)
    finally:
        end()
        session.stop()
    assert len(found) == 10
    assert [one["status"] for one in found[:4]] == ["capturing zero"] * 4
    last = found[-1]
    assert last["touching"]
    assert last["force_low"][2] < 1.0 < last["force_high"][2]
    assert last["force"][2] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("key", ["", "/finger", "finger/", "a//b", "finger/*", "a b", "a#b"])
def test_a_key_that_cannot_be_published_on_is_refused(key: str, peers: tuple[Any, Any]) -> None:
    with pytest.raises(pp.InvalidInput, match="a key of zenoh"):
        ZenohListener(peers[0], SHAPE, key=key)


def test_an_endpoint_that_is_none_says_so() -> None:
    with pytest.raises(pp.InvalidInput, match="zenoh does not begin with nowhere"):
        zenoh_session(listen="nowhere")
    with pytest.raises(pp.InvalidInput, match="either listen or connect"):
        zenoh_session(listen="tcp/127.0.0.1:0", connect="tcp/127.0.0.1:0")


def test_a_second_session_of_one_machine_has_an_endpoint_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the refusal advises works."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        taken = f"tcp/127.0.0.1:{free.getsockname()[1]}"
        free.listen()
        with pytest.raises(pp.InvalidInput, match="ZENOH_CONFIG"):
            zenoh_session(listen=taken)
    (tmp_path / "second.json5").write_text(
        f'{{listen: {{endpoints: ["{taken}"]}}, scouting: {{multicast: {{enabled: false}}}}}}', encoding="utf-8"
    )
    monkeypatch.setenv("ZENOH_CONFIG", str(tmp_path / "second.json5"))
    with (
        zenoh_session() as second,
        zenoh_session(connect=taken) as driver,
        ZenohListener(second, SHAPE, key="finger/readings") as listener,
    ):
        publishing(driver, "finger/readings")(0, frame_bytes(0, 0.0, np.ones(SHAPE)))
        wait(lambda: listener.counts["frames"] == 1)
