"""Times of every kind are seconds, whatever their unit."""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np
import pandas as pd
import pytest

import palpate as pp
from palpate.network import frame_bytes, frame_from_bytes
from palpate.sensing.times import as_second, as_seconds

SECONDS = 0.05 * np.arange(8)
STEPS = (SECONDS * 1e9).round().astype("timedelta64[ns]")
KINDS: dict[str, Any] = {
    **{f"timedelta64[{u}]": STEPS.astype(f"timedelta64[{u}]") for u in ("ms", "us", "ns")},
    **{f"datetime64[{u}]": np.datetime64("2026-01-01", u) + STEPS.astype(f"timedelta64[{u}]") for u in ("ms", "us", "ns")},
    "timedelta": [datetime.timedelta(seconds=float(s)) for s in SECONDS],
    "datetime": [datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC) + datetime.timedelta(seconds=float(s)) for s in SECONDS],
    "pandas differences": pd.to_timedelta(SECONDS, unit="s"),
    "pandas dates": pd.date_range("2026-01-01", periods=8, freq="50ms"),
    "pandas dates of a zone": pd.date_range("2026-01-01", periods=8, freq="50ms", tz="Europe/Berlin"),
    "a column": pd.Series(pd.date_range("2026-01-01", periods=8, freq="50ms")),
    "stamps": list(pd.date_range("2026-01-01", periods=8, freq="50ms")),
}  # fmt: skip
ARRAY = pp.AreaArray(shape=(5, 5), pitch=1e-3, depth=0.5e-3, channels=["displacement_x", "displacement_y", "displacement_z"], noise=1e-7)  # fmt: skip
SKIN = pp.Skin(pp.Viscoelastic(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), prony=[(0.5, 0.1)]), ARRAY)


@pytest.mark.parametrize("kind", KINDS)
def test_the_steps_of_every_kind_are_seconds(kind: str) -> None:
    found = as_seconds(KINDS[kind])
    np.testing.assert_allclose(found - found[0], SECONDS, atol=3e-7)
    if "date" in kind and "zone" not in kind and "timedelta" not in kind:
        assert found[0] == 1767225600.0
    recording = pp.Recording(readings=np.zeros((8, 1, 2)), channels=["stress_zz"], time=KINDS[kind])
    np.testing.assert_array_equal(recording.time, found)


def test_a_creeping_pad_has_one_force_for_every_kind_of_time() -> None:
    ball = SKIN.sample(pp.solutions.hertz_point(contact_radius=2e-3, force=0.5))
    readings = SKIN.sense(np.stack([ball] * 8), time=SECONDS, rng=np.random.default_rng(0))
    forces = {
        kind: float(SKIN.reconstruct(readings, time=time, method="tikhonov").force[-1][-1])
        for kind, time in {"s": SECONDS, **KINDS}.items()
    }
    # those that pandas counts from 1970 are rounded to a quarter of a microsecond
    assert forces == pytest.approx(dict.fromkeys(forces, forces["s"]), rel=1e-5)
    wrong = SKIN.reconstruct(readings, time=1e3 * SECONDS, method="tikhonov")
    assert abs(float(wrong.force[-1][-1]) / forces["s"] - 1.0) > 0.01


REFUSED: dict[str, tuple[Any, str]] = {
    "truth values": ([True, False], "True and False are no numbers"),
    "text": (["0.1", "0.2"], "x.astype.float."),
    "complex": ([0.1j, 0.2j], "must be real numbers"),
    "no unit": (np.array([1, 2], dtype="timedelta64"), "no length"),
    "months": (np.array([1, 2], dtype="timedelta64[M]"), "no length"),
    "milliseconds since 1970": ([1700000000000, 1700000000020], "look like milliseconds since 1970: divide by 1000"),
    "nanoseconds since 1970": (1.7e18 + 2e7 * np.arange(2), "nanoseconds since 1970: divide by 1e.09"),
    "what is no time": ([0.0, -1e300], "within 2..33 of 0; got -1e.300"),
    "other things": ([datetime.timedelta(seconds=1), "x"], "got 'x'"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_unit_is_refused(case: str) -> None:
    time, words = REFUSED[case]
    with pytest.raises(pp.InvalidInput, match=words):
        as_seconds(time)
    with pytest.raises(pp.InvalidInput, match=words):
        pp.Recording(readings=np.zeros((2, 1, 2)), channels=["stress_zz"], time=time)


def test_missing_times_are_nan() -> None:
    for time in (
        np.array(["NaT", "1970-01-01T00:00:01"], dtype="datetime64[s]"),
        [pd.NaT, pd.Timestamp("1970-01-01T00:00:01")],
        np.ma.masked_array([0.0, 1.0], [True, False]),
        np.ma.masked_array(np.array([5000, 1000], dtype="datetime64[ms]"), [True, False]),
        np.ma.masked_array(np.array([5000, 1000], dtype="timedelta64[ms]"), [True, False]),
        np.ma.masked_array([datetime.timedelta(seconds=5), datetime.timedelta(seconds=1)], [True, False]),
    ):
        if isinstance(time, list):
            time = pd.Series(time)
        np.testing.assert_array_equal(as_seconds(time), [np.nan, 1.0])


@pytest.mark.parametrize("time", [True, "0.1", 0.1 + 0j, np.array([0.1]), -1e300, np.nan, np.inf, 1.7e12, [0.1]])
def test_a_tracker_takes_seconds_alone(time: Any) -> None:
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5),
        pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=["stress_zz"]),
    )
    tracker = skin.track()
    with pytest.raises(pp.InvalidInput, match="time must be"):
        tracker.step(np.zeros((1, 9)), time)
    assert tracker.health.frames == 0
    for good in (np.timedelta64(250, "ms"), np.float32(0.5), 1, datetime.timedelta(seconds=2)):
        assert float(tracker.step(np.zeros((1, 9)), good).time) == as_second(good)


def test_the_time_of_a_frame_on_the_wire() -> None:
    assert frame_from_bytes(frame_bytes(0, np.timedelta64(1500, "ms"), [[1.0]]))[1] == 1.5  # type: ignore[arg-type]
    with pytest.raises(pp.InvalidInput, match="the time of a frame must be a finite number"):
        frame_bytes(0, True, [[1.0]])


def test_labelled_times() -> None:
    import xarray

    values = np.zeros((8, 1, 9))
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5),
        pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=["stress_zz"]),
    )
    for coordinate in (("time", KINDS["datetime64[ns]"]), ("time", 1e3 * SECONDS, {"units": "ms"})):
        touch = skin.reconstruct(
            xarray.DataArray(values, dims=("time", "channel", "x"), coords={"time": coordinate}), method="tikhonov"
        )
        np.testing.assert_allclose(touch.time - touch.time[0], SECONDS, atol=3e-7)
