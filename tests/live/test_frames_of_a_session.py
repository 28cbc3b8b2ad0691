"""Frames of a session: times that go back, masked readings, a zero that is asked for over the network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

import palpate as pp
from palpate.live import FoxgloveServer, Session
from palpate.live.session import recorded
from palpate.network import FrameListener, frame_bytes, zero_bytes
from palpate.recordings import read_recording, recorder

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


def two_planes(*shapes: tuple[int, int]) -> pp.Skin:
    arrays = [
        pp.AreaArray(shape=shape, pitch=1e-3, depth=depth, channels=["stress_zz"], noise=5.0)
        for shape, depth in zip(shapes, (1e-3, 2e-3))
    ]
    return pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5), arrays)


def played(skin: pp.Skin, frame: Any, **options: Any) -> Session:
    session = Session(
        skin, lambda: [(0.1 * i, frame) for i in range(3)], skin.track(), pp.GraspMonitor(), pace=False, **options
    )
    session.run()
    session.stop()
    return session


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".mcap"])
def test_planes_of_one_shape_are_recorded_together(tmp_path: Path, suffix: str) -> None:
    """The recorder was dropped in the first frame; the mask of a plane was ignored."""
    skin = two_planes((4, 5), (4, 5))
    first = np.ma.masked_array(np.full((1, 4, 5), 1.0), mask=np.arange(20).reshape(1, 4, 5) == 7)
    path = tmp_path / f"a{suffix}"
    session = played(skin, [first, np.full((1, 4, 5), 2.0)], sinks=[recorder(path, **recorded(skin))])
    assert not session.lost
    found = np.asarray(read_recording(path).readings)
    expected = np.stack([np.where(np.arange(20).reshape(4, 5) == 7, np.nan, 1.0), np.full((4, 5), 2.0)])
    np.testing.assert_array_equal(found, np.broadcast_to(expected, (3, 2, 4, 5)))


@pytest.mark.parametrize("sink", [".nc", ".zarr", ".mcap", "foxglove"])
def test_planes_that_differ_in_shape_end_a_recording_and_no_session(tmp_path: Path, sink: str) -> None:
    """A ValueError of NumPy ended the session in its first frame."""
    skin = two_planes((4, 5), (3, 4))
    channels = recorded(skin)["channels"]
    failing = FoxgloveServer(channels, port=0) if sink == "foxglove" else recorder(tmp_path / f"a{sink}", channels)
    seen, reports = Seen(), list[str]()
    session = played(skin, [np.zeros((1, 4, 5)), np.zeros((1, 3, 4))], sinks=[failing, seen], report=reports.append)
    assert seen.frames == session.count == 3
    assert len(reports) == len(session.lost) == 1
    assert "differ in shape ((1, 4, 5) and (1, 3, 4))" in reports[0]


def test_planes_that_differ_in_shape_go_to_rerun_one_by_one(tmp_path: Path) -> None:
    """A ValueError of NumPy ended the session in its first frame."""
    pytest.importorskip("rerun")
    from palpate.live import RerunSink

    sink = RerunSink(tmp_path / "a.rrd")
    session = played(two_planes((4, 5), (3, 4)), [np.zeros((1, 4, 5)), np.zeros((1, 3, 4))], sinks=[sink])
    assert session.count == 3
    assert not session.lost


def test_planes_at_different_places_are_recorded_without_positions() -> None:
    """The places of the first plane were recorded for all."""
    places = np.array([(0.0, 0.0), (1e-3, 0.0), (0.0, 1e-3), (1e-3, 1e-3)])
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    for moved, known in ((0.0, True), (5e-4, False)):
        planes = [
            pp.ScatteredArray(positions=places + shift, depth=depth, channels=["stress_zz"], noise=5.0)
            for shift, depth in ((0.0, 1e-3), (moved, 2e-3))
        ]
        assert (recorded(pp.Skin(pad, planes))["positions"] is not None) is known


def test_labelled_frames_are_recorded_in_the_order_of_the_skin(tmp_path: Path) -> None:
    """Channels in another order were recorded under each other's names."""
    frame = xarray.DataArray(
        np.repeat([[3.0], [1.0]], 21, axis=1),
        dims=("channel", "x"),
        coords={"channel": ["stress_zz", "stress_xz"]},
    )
    session = played(SKIN, frame, sinks=[recorder(tmp_path / "a.nc", **recorded(SKIN))])
    assert not session.lost
    found = read_recording(tmp_path / "a.nc")
    assert tuple(found.channels) == ("stress_xz", "stress_zz")
    assert np.asarray(found.readings)[0, :, 0].tolist() == [1.0, 3.0]


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
