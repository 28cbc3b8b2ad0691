"""Frames of a session: times that go back, masked readings, a zero that is asked for over the network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.live import Session
from palpate.network import FrameListener, frame_bytes, zero_bytes
from palpate.recordings import read_recording

SKIN = pp.Skin(
    pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5),
    pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0),
)


class Seen:
    """A sink that counts frames."""

    def __init__(self) -> None:
        self.frames = 0

    def readings(self, time: float, values: Any) -> None:
        self.frames += 1

    def touch(self, touch: Any, time: float | None = None) -> None: ...
    def event(self, event: Any) -> None: ...
    def close(self) -> None: ...


def test_a_paced_source_whose_times_go_back_loses_no_frame() -> None:
    """A third of the frames was skipped as too late."""
    times = [*np.arange(0.0, 0.6, 0.05), *np.arange(0.0, 0.3, 0.05)]
    seen = Seen()
    session = Session(
        SKIN, lambda: [(float(t), np.zeros((2, 21))) for t in times], SKIN.track(), pp.GraspMonitor(), sinks=[seen]
    )
    session.run()
    assert seen.frames == len(times)


def test_masked_readings_are_recorded_as_missing(tmp_path: Path) -> None:
    """The number under the mask was written."""
    readings = np.ma.masked_array(np.ones((2, 21)), mask=np.arange(21)[None].repeat(2, 0) == 10)
    readings.data[:, 10] = 1e6
    session = Session(
        SKIN, lambda: [(0.1 * i, readings) for i in range(3)], SKIN.track(), pp.GraspMonitor(), pace=False
    )
    session.record(str(tmp_path / "a.nc"))
    session.run()
    session.stop()
    found = np.asarray(read_recording(tmp_path / "a.nc").readings)
    assert np.isnan(found[:, :, 10]).all()
    assert (found[:, :, 9] == 1.0).all()


def test_a_zero_takes_no_frames_that_were_sent_before_it() -> None:
    """Up to eight pressed frames that waited became the zero."""
    asked: list[int] = []
    listener = FrameListener((2, 21), zero=asked.append, port=0)
    try:
        for i in range(3):
            assert listener._take("sensor", frame_bytes(i, 0.01 * i, np.full((2, 21), 100.0))) == "frames"
        listener._take("sensor", zero_bytes(3))
        listener._take("sensor", frame_bytes(3, 0.03, np.zeros((2, 21))))
        listener.close()
        left = [values for _, values in listener]
    finally:
        listener.close()
    assert asked == [3]
    assert len(left) == 1
    assert (np.asarray(left[0]) == 0.0).all()
    assert listener.counts["dropped"] == 3
