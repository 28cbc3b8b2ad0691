"""What the live page shows: where the taxels lie, their readings, the centre, pressure beyond the array, and axes that show the values."""

from __future__ import annotations

import asyncio
import importlib.util
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.live import Live, Session, packed, unpacked
from palpate.live.taxels import MAX_READINGS, described, edge

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
GRID = pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=2e-3, channels=["stress_xz", "stress_zz"], noise=50.0)
RING = pp.ScatteredArray(
    positions=[(0.0, 0.0), *(5e-3 * np.array([np.cos(a), np.sin(a)]) for a in np.arange(8) * np.pi / 4)],
    depth=2e-3,
    channels=["stress_zz"],
    noise=50.0,
)
LINE = pp.LineArray(count=6, pitch=2e-3, depth=2e-3, channels=["stress_zz"], aperture=1e-3, noise=50.0)


def test_each_taxel_has_its_place_size_and_name() -> None:
    (plane,) = described(pp.Skin(PAD, GRID))
    assert plane["channels"] == ["stress_xz", "stress_zz"]
    assert plane["units"] == ["Pa", "Pa"]
    assert plane["names"][:5] == ["0,0", "0,1", "0,2", "0,3", "1,0"]  # as messages call them
    assert (plane["x"][1], plane["y"][1]) == (-2e-3, -6e-3)  # row 0 has the smallest y
    assert plane["size"] == [4e-3, 4e-3]
    (plane,) = described(pp.Skin(PAD, RING))
    assert plane["round"]
    assert plane["names"] == [str(i) for i in range(9)]
    assert (plane["x"][3], plane["y"][3]) == pytest.approx((0.0, 5e-3), abs=1e-9)
    assert 0.0 < plane["size"][0] < 4e-3  # neighbours do not overlap
    (plane,) = described(pp.Skin(PAD, LINE))
    assert plane["size"] == [1e-3, 0.0]
    assert plane["y"] == [0.0] * 6
    dead = np.ones((4, 4), dtype=bool)
    dead[0, 1] = False
    assert described(pp.Skin(PAD, GRID.masked(dead)))[0]["works"][:3] == [True, False, True]


def test_the_edge_of_an_array_is_round_its_taxels() -> None:
    corners = np.array(edge(pp.Skin(PAD, GRID)))
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[-8e-3] * 2, [8e-3] * 2], atol=1e-12)
    around = np.hypot(*np.array(edge(pp.Skin(PAD, RING))).T)
    assert 5e-3 < around.min() <= around.max() < 7.5e-3
    assert edge(pp.Skin(PAD, LINE)) == [[-5.5e-3, 0.0], [5.5e-3, 0.0]]


def press(skin: pp.Skin, at: tuple[float, float]) -> Any:
    return np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=0.6).shifted(*at)))


def stream(skin: pp.Skin, at: tuple[float, float], offset: float = 3000.0) -> Iterator[tuple[float, Any]]:
    clean, rng = press(skin, at), np.random.default_rng(0)
    for i in range(100_000):
        yield 0.02 * i, offset + clean * (i >= 20) + 50.0 * rng.standard_normal(clean.shape)


def test_a_packet_holds_the_readings_as_they_came_and_since_the_zero() -> None:
    skin = pp.Skin(PAD, GRID)
    frames = [frame for _, frame in zip(range(30), stream(skin, (2e-3, 2e-3)))]
    one = Session(skin, lambda: frames, skin.track(baseline=20), pp.GraspMonitor(), pace=False)
    assert one.layout()["readings"] == 32
    one.run()
    numbers, values = unpacked(one.packet or b"")
    cells = 3 * skin.surface.shape[0] * skin.surface.shape[1]
    assert values.size == cells + 2 * 32
    np.testing.assert_allclose(values[cells : cells + 32], frames[-1][1].ravel(), rtol=1e-6)
    np.testing.assert_allclose(values[cells + 32 :], press(skin, (2e-3, 2e-3)).ravel(), atol=5 * 60.0)
    assert numbers["center"] == pytest.approx([2e-3, 2e-3], abs=1e-3)
    for low, middle, high in zip(numbers["center_low"], numbers["center"], numbers["center_high"]):
        assert low <= middle <= high
    one.rezero(5)  # with the press on: that is the zero from now on
    again = [(1.0 + t, reading) for t, reading in frames[-9:]]
    one.source = lambda: again
    one.run()
    one.stop()
    np.testing.assert_allclose(unpacked(one.packet or b"")[1][cells + 32 :], 0.0, atol=5 * 60.0)


def shown(skin: pp.Skin, tracker: pp.Tracker, frames: list[tuple[float, Any]]) -> Any:
    """The readings minus the zero in the last packet of a session."""
    one = Session(skin, lambda: frames, tracker, pp.GraspMonitor(), pace=False)
    one.run()
    one.stop()
    return unpacked(one.packet or b"")[1][-one.readings :]


def test_the_page_subtracts_the_zero_of_the_tracker() -> None:
    """A zero that was given, one that follows drift, and one frame of it that was touched were not those of the page."""
    skin, rng = pp.Skin(PAD, GRID), np.random.default_rng(0)
    noise = [50.0 * rng.standard_normal((2, 4, 4)) for _ in range(200)]
    given = np.full((2, 4, 4), 3000.0)
    frames = [(0.02 * k, 3000.0 + n) for k, n in enumerate(noise)]
    np.testing.assert_allclose(shown(skin, skin.track(zero=given), frames[:5]), 0.0, atol=300.0)
    drifting = [(t, y + 10.0 * k) for k, (t, y) in enumerate(frames)]
    drifted = skin.track(baseline=20, rezero=0.2)
    np.testing.assert_allclose(shown(skin, drifted, drifting), 0.0, atol=500.0)
    touched = [(t, y + (1e5 if k == 3 else 0.0)) for k, (t, y) in enumerate(frames)]
    np.testing.assert_allclose(shown(skin, skin.track(baseline=20), touched[:30]), 0.0, atol=400.0)
    assert np.isnan(shown(skin, skin.track(baseline=20), frames[:10])).all()  # not known yet


def test_where_nothing_touches_there_is_no_centre() -> None:
    skin = pp.Skin(PAD, GRID)
    tracker, monitor = skin.track(), pp.GraspMonitor()
    touch = tracker.step(np.zeros((2, 4, 4)))
    monitor.update(touch)
    assert "center" not in unpacked(packed(touch, monitor, [], {"frames": 1}, born=0.0, ms=1.0))[0]


def test_more_readings_than_a_page_shows_are_not_sent() -> None:
    n = int(np.sqrt(MAX_READINGS)) + 1
    skin = pp.Skin(PAD, pp.AreaArray(shape=(n, n), pitch=1e-3, depth=1e-3, channels=["stress_zz"]))

    class Idle:
        names, notes = ("z",), ()

    tracker: Any = Idle()
    layout = Session(skin, list, tracker, pp.GraspMonitor()).layout()
    assert (layout["readings"], layout["planes"]) == (0, [])


def load_browser() -> Any:
    path = Path(__file__).parents[2] / "benchmarks" / "live.py"
    spec = importlib.util.spec_from_file_location("live_benchmark", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.long
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium on this machine")
@pytest.mark.parametrize(("array", "at", "outside"), [(GRID, (9e-3, 0.0), True), (RING, (0.5e-3, 0.0), False)])
def test_the_page_shows_taxels_readings_centre_and_what_lies_outside(
    array: Any, at: tuple[float, float], outside: bool
) -> None:
    uvicorn = pytest.importorskip("uvicorn")
    benchmark = load_browser()
    skin = pp.Skin(PAD, array)
    one = Session(skin, lambda: stream(skin, at), skin.track(baseline=20), pp.GraspMonitor(), name="page")
    port = benchmark.free_port()
    server = uvicorn.Server(uvicorn.Config(Live(one, token="").app, host="127.0.0.1", port=port, log_level="warning"))
    thread = threading.Thread(target=server.run)
    thread.start()

    async def seen() -> dict[str, Any]:
        browser = benchmark.Browser()
        try:
            await browser.open()
            await browser("Page.navigate", url=f"http://127.0.0.1:{port}/")
            assert await browser.until("window.palpate && palpate.painted > 2 && shown.touching && shown.time > 1", 120)
            found = {
                name: await browser.value(script)
                for name, script in {
                    "failures": "palpate.failures",
                    "readings": "shown.raw.length",
                    "painted": "new Set(document.getElementById('readings').getContext('2d').getImageData(0, 0, 150, 150).data).size",
                    "outside": "shown.outside",
                    "centre": "shown.center",
                    "units": "[unit(999.96, 'N'), unit(0.5, 'N'), unit(1e-9, 'N'), unit(-1234, 'Pa'), unit(46, 'Pa', 1)]",
                    "short": "[short(3021.46), short(-0.5), short(123456), short(0)]",
                    "usual": "axisOf([[[1, 2, 1, 2], [0.9, 1.9, 0.9, 1.9], [1.1, 2.1, 1.1, 2.1]]])",
                    "spike": "axisOf([[Array(40).fill(2), [-400, ...Array(39).fill(1.9)], [400, ...Array(39).fill(2.1)]]])",
                    "wide": "axisOf([[[1, 1, 1], [-40, -40, -40], [40, 40, 40]]])",
                    "empty": "axisOf([[[], [], []]])",
                }.items()
            }
            return {**found, "errors": browser.errors}
        finally:
            browser.close()

    try:
        deadline = time.monotonic() + 120
        while not server.started:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        found = asyncio.run(seen())
    finally:
        server.should_exit = True
        thread.join(timeout=60)
    assert (found["failures"], found["errors"]) == (0, [])
    assert found["readings"] == one.readings
    assert found["painted"] > 20
    assert (found["outside"] > 0.05) is outside
    assert abs(found["centre"][0] - at[0]) < 4e-3
    assert found["units"] == ["1.00 kN", "500 mN", "0.00000100 mN", "-1.23 kPa", "50 Pa"]
    assert found["short"] == ["3021", "-0.5", "123k", "0"]
    assert found["usual"] == {"ends": [0, 5], "cut": False}
    assert found["spike"] == {"ends": [0, 5], "cut": True}
    assert found["wide"] == {"ends": [-50, 50], "cut": False}
    assert found["empty"] == {"ends": [0, 1], "cut": False}
