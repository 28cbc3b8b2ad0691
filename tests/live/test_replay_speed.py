"""A recording played faster or slower than it was taken: only the wait changes."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import run
from palpate.errors import InvalidInput
from palpate.live import Session
from palpate.recordings import Recording, write_recording
from skin_files import skin_text

TIMES = [0.0, 0.2, 0.4]


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    return pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=10.0))


def test_a_faster_replay_keeps_the_times(skin: pp.Skin) -> None:
    tracker, seen = skin.track(), []

    def source() -> Iterator[tuple[float, Any]]:
        yield from ((t, np.zeros((1, 11))) for t in TIMES)

    def step(readings: Any, at: float) -> pp.Touch:
        seen.append(at)
        return tracker.step(readings, at)

    session = Session(skin, source, tracker, pp.GraspMonitor(), speed=4.0, step=step, pages=False)
    begun = time.monotonic()
    session.run()
    assert seen == pytest.approx(TIMES)
    assert time.monotonic() - begun >= 0.1


def test_the_command_keeps_the_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "skin.toml").write_text(skin_text(11, noise="10 Pa"))
    recording = Recording(readings=np.zeros((3, 1, 11)), channels=("stress_zz",), time=TIMES)
    write_recording(recording, tmp_path / "r.npz")
    seen: dict[str, Any] = {}

    def keep(skin: Any, source: Any, *rest: Any, **options: Any) -> Any:
        seen.update(options, times=[t for t, _ in source()])
        raise InvalidInput("seen")

    monkeypatch.setattr("palpate.live.Session", keep)
    out = run("live", "r.npz", "--skin", "skin.toml", "--speed", "4", cwd=tmp_path)
    assert out.returncode == 2, out.stderr
    assert (seen["times"], seen["speed"]) == (TIMES, 4.0)
