"""A stream into a recording that is stopped by a signal: every frame that was done is kept, the command says so, and the file opens."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.cli import main
from palpate.recordings import read_recording, write_recording
from palpate.recordings.recording import Recording
from skin_files import skin_text

SKIN = skin_text(8, noise="5 Pa")
#: More than a block of 32, and no whole number of blocks.
DONE = 41


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "skin.toml").write_text(SKIN)
    readings = np.random.default_rng(0).normal(0, 5.0, (70, 1, 8)).astype(np.float32)
    write_recording(Recording(readings=readings, channels=("stress_zz",), time=np.arange(70) / 50), "r.nc")
    before = signal.getsignal(signal.SIGTERM)
    yield tmp_path
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize(
    ("ending", "number", "code"),
    [
        ("nc", signal.SIGINT, 130),
        *long_runs(("h5", signal.SIGTERM, 143), ("zarr", signal.SIGTERM, 143), ("mcap", signal.SIGINT, 130)),
    ],
)
def test_track_keeps_every_frame_that_was_done(
    ending: str,
    number: int,
    code: int,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    step = pp.Tracker.step
    count = 0

    def stopped(self: Any, *given: Any) -> Any:
        nonlocal count
        count += 1
        if count > DONE:
            os.kill(os.getpid(), number)
        return step(self, *given)

    monkeypatch.setattr(pp.Tracker, "step", stopped)
    monkeypatch.setattr(sys, "argv", ["palpate", "track", "r.nc", "--skin", "skin.toml", "--out", f"t.{ending}"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == code
    said = capsys.readouterr().err
    assert said.startswith("error: stopped")
    assert len(said.strip().splitlines()) == 1
    kept, whole = read_recording(f"t.{ending}"), read_recording("r.nc")
    assert len(kept.readings) == DONE
    np.testing.assert_array_equal(kept.readings, whole.readings[:DONE])
    np.testing.assert_allclose(kept.time, whole.time[:DONE], rtol=0, atol=1e-9)  # MCAP counts nanoseconds
