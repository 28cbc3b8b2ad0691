"""One time for the frames of every source, and not one frame lost, whatever the stamps are."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.errors import UncheckedInput
from palpate.recordings import TableMapping, TopicMapping, read_clock, read_recording, recorder
from palpate.recordings.clock import LiveClock, stored_clock, unit_of_name

STEP = 0.02
N = np.arange(20)
EVEN = STEP * N
LOG = 1.7e9 + EVEN
DAY = 86400.0


def changed(at: int, value: float, stamps: Any = EVEN) -> Any:
    out = np.array(stamps, dtype=np.float64)
    out[at] = value
    return out


#: stamps, the first time, and words of the note; all frames are 20 ms apart
JOINED: dict[str, tuple[Any, float, str]] = {
    "a clock that begins anew": (np.r_[1000 + EVEN[:10], EVEN[:10]], 1000.0, "restarted 1 time .first: frame 10 is at 0 s after 1000.18 s"),
    "and again": (np.r_[5 + EVEN[:7], EVEN[:7], EVEN[:6]], 5.0, "restarted 2 times"),
    "a clock that is set back by a little": (np.r_[EVEN[:10], 0.1 + EVEN[:10]], 0.0, "restarted 1 time"),
    "short episodes": (np.tile(EVEN[:4], 5), 0.0, "restarted 4 times"),
    "a clock that is set": (np.r_[12 + EVEN[:10], 1.7e9 + EVEN[:10]], 12.0, "set ahead 1 time"),
    "a counter of 16 bits in milliseconds": ((65400 + 20 * N) % 65536 * 1e-3, 65.4, "wrapped .period 65.536 s."),
    "a counter of 32 bits in microseconds": ((2**32 - 100_000 + 20_000 * N) % 2**32 * 1e-6, 4294.867296, "wrapped .period 4294.97 s."),
    "midnight": ((DAY - 0.1 + EVEN) % DAY, DAY - 0.1, "wrapped .period 86400 s."),
    "a stamp that is far ahead": (changed(9, 3.15e7), 0.0, "1 outlier"),
    "a stamp that is far back": (changed(9, -1e6), 0.0, "1 outlier"),
    "a stamp that no clock shows": (changed(9, -1e300), 0.0, "1 missing"),
    "missing stamps": (changed(9, np.nan, changed(0, np.nan)), 0.0, "2 missing"),
    "stamps that are not filled for a while": (np.where((N > 6) & (N < 12), 0.0, LOG), 1.7e9, "1 outlier, 4 repeated"),
    "stamps that are filled late": (np.where(N < 3, 0.0, LOG), 1.7e9, "1 outlier, 2 repeated"),
    "a stamp twice": (changed(9, EVEN[8]), 0.0, "1 repeated"),
}  # fmt: skip


@pytest.mark.parametrize("logged", [False, True], ids=["alone", "recorded"])
@pytest.mark.parametrize("case", JOINED)
def test_time_goes_on_and_every_frame_is_kept(case: str, logged: bool) -> None:
    stamps, first, words = JOINED[case]
    clock = read_clock(stamps, recorded=5e8 + EVEN if logged else None)
    np.testing.assert_allclose(clock.time, first + EVEN, atol=1e-6)
    assert (np.diff(clock.time) > 0).all()
    assert clock.order is None
    with pytest.warns(UncheckedInput, match=f"{words}.*All 20 frames are kept in their order"):
        clock.tell()


@pytest.mark.parametrize("begin", [0.0, 0.7])
def test_whole_seconds_keep_all_frames(begin: float) -> None:
    true = begin + STEP * np.arange(400)
    for recorded, within in ((true + 1.7e9, 1e-6), (None, 0.021)):
        clock = read_clock(np.floor(true), recorded=recorded)
        time = clock.time - clock.time[0]
        np.testing.assert_allclose(time, true - true[0], atol=within)
        assert "repeat" in clock.note


def test_stamps_that_are_never_filled_are_replaced_by_the_recorder_or_refused() -> None:
    clock = read_clock(np.zeros(20), recorded=LOG)
    np.testing.assert_array_equal(clock.time, LOG)
    assert "all 20 stamps are 0 s" in clock.note
    with pytest.raises(pp.InvalidInput, match=r"all 20 stamps are 0 s.*give each frame its time"):
        read_clock(np.zeros(20))
    assert read_clock([5.0]).time.tolist() == [5.0]


def test_times_that_increase_are_taken_as_they_are() -> None:
    rng = np.random.default_rng(0)
    for stamps in (np.cumsum(rng.exponential(STEP, 500)), np.r_[EVEN, 60 + EVEN], -5 + EVEN, LOG):
        for recorded in (None, np.linspace(0.0, float(np.ptp(stamps)), len(stamps))):
            clock = read_clock(stamps, recorded=recorded if np.ptp(stamps) < 30 else None)
            np.testing.assert_array_equal(clock.time, stamps)
            assert clock.note == ""


def test_a_pause_is_no_jump() -> None:
    """Neither alone nor before a clock that begins anew; the recorder's clock has it too."""
    paused = np.r_[EVEN[:10], 60 + EVEN[:10]]
    assert read_clock(paused, recorded=3.0 + paused).note == ""
    clock = read_clock(np.r_[paused, EVEN])
    np.testing.assert_allclose(clock.time, np.r_[paused, paused[-1] + STEP + EVEN])
    assert "1 time " in clock.note


def test_what_is_recorded_late_keeps_its_stamps() -> None:
    """A network that stands still for 5 s and then delivers all at once."""
    late = np.r_[EVEN[:5], np.full(15, 5.1) + 1e-4 * np.arange(15)]
    for stamps in (EVEN, 1e9 + EVEN):
        clock = read_clock(stamps, recorded=late)
        np.testing.assert_array_equal(clock.time, stamps)
        assert clock.note == ""


def test_one_stamp_in_ten_wrong_is_found() -> None:
    rng = np.random.default_rng(3)
    true = STEP * np.arange(1000)
    stamps = np.where(rng.random(1000) < 0.1, rng.uniform(0.0, 1e6, 1000), true)
    np.testing.assert_allclose(read_clock(stamps).time, true, atol=1e-9)


def test_frames_in_no_order_of_time_are_sorted_where_the_user_says_so() -> None:
    order = np.random.default_rng(0).permutation(20)
    for stamps in (EVEN[order], EVEN[::-1]):
        with pytest.raises(pp.InvalidInput, match=r"goes back in \d+ of 19 steps.*sort=true"):
            read_clock(stamps, remedy="say sort=true")
        clock = read_clock(stamps, sort=True)
        assert clock.order is not None
        np.testing.assert_array_equal(stamps[clock.order], EVEN)
        np.testing.assert_array_equal(clock.time, EVEN)
        assert clock.note == ""
        np.testing.assert_array_equal(read_clock(stamps, recorded=LOG).time, LOG)


def test_numbers_without_a_unit() -> None:
    for scale, name in ((1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")):
        dates = read_clock((LOG - LOG % 1 + EVEN) * scale, unit=None)
        np.testing.assert_allclose(np.diff(dates.time), STEP, atol=1e-6)
        assert f"taken as {name} since 1970" in dates.note
        said = read_clock(LOG * scale)  # in seconds, says the file
        np.testing.assert_allclose(said.time, LOG, atol=1e-6)
        assert f"{name} since 1970, because" in said.note
        up = read_clock(EVEN * scale, unit=None, recorded=LOG)
        np.testing.assert_allclose(up.time, EVEN, atol=1e-9)
        assert name in up.note
    counted = read_clock(N, unit=None, recorded=LOG)
    np.testing.assert_array_equal(counted.time, LOG)
    assert "as no unit does" in counted.note
    days = read_clock(42946.5 + EVEN / DAY, unit=None)
    np.testing.assert_allclose(days.time, 1501416000.0 + EVEN, atol=1e-5)
    assert "days since 1900" in days.note
    for begin, words in ((719529 + 42946.5 - 25569, "as MATLAB"), (42946.5, "as spreadsheets")):
        slow = read_clock(begin + 2 * N / DAY, unit=None)  # a frame every 2 s
        np.testing.assert_allclose(slow.time, 1501416000.0 + 2 * N, atol=1e-4)
        assert words in slow.note
    for begin, words in ((621355968000000000, "as .NET"), (116444736000000000, "as Windows")):
        ticks = read_clock(begin + (LOG * 1e7).astype(np.int64), unit=None)
        np.testing.assert_allclose(ticks.time, LOG, atol=2e-5)
        assert words in ticks.note
    with pytest.raises(pp.InvalidInput, match=r"its times \(6e\+15\) are beyond 2\*\*33 s, and no date"):
        read_clock(6e15 + 20 * N, unit=None)
    assert "say time_unit=ms" in read_clock(20 * N, unit=None).note
    assert read_clock(N, unit=None).note == ""


def test_units_of_names() -> None:
    names = {
        "time_ms": 1e-3,
        "t (us)": 1e-6,
        "stampNanosec": 1e-9,
        "Time [msec]": 1e-3,
        "elapsed seconds": 1.0,
        "t_µs": 1e-6,
        "time": None,
        "items": None,
        "t": None,
    }
    assert {name: unit_of_name(name) for name in names} == names


def test_units_of_stored_times() -> None:
    np.testing.assert_allclose(stored_clock(20 * N, b"ms", "x").time, EVEN)
    np.testing.assert_allclose(
        stored_clock(20 * N, "milliseconds since 2017-07-30 00:00:00", "x").time, 1501372800.0 + EVEN
    )
    np.testing.assert_array_equal(stored_clock(EVEN, None, "x").time, EVEN)
    with pytest.raises(pp.InvalidInput, match="'fortnights'; write s, ms"):
        stored_clock(N, "fortnights", "x")


def test_empty_and_repeated_stamps_of_what_comes_now() -> None:
    clock = LiveClock()
    assert [clock.next(0.0, now) for now in (5.0, 5.0, 5.5)] == pytest.approx([5.0, 5.000001, 5.5])
    clock = LiveClock()
    found = [clock.next(np.floor(1e3 + t), t) for t in STEP * np.arange(200)]
    assert np.diff(found) == pytest.approx(np.full(199, STEP))
    assert LiveClock().next(7.25, 0.0) == 7.25


# -- every source ------------------------------------------------------------------------------------------------------

PRESSED = np.arange(20.0)
RESTARTED = np.r_[1000 + EVEN[:10], EVEN[:10]]
MAP = TableMapping(time="t", channels={"stress_zz": "S{}"}, scale=1.0)
LONG = TableMapping(frame="f", marker="m", channels={"stress_zz": "p"}, scale=1.0, rate=50.0)


def readings() -> Any:
    return PRESSED[:, None, None] * np.array([1.0, 2.0, 3.0])


def written(folder: Path, source: str) -> tuple[Path, Any]:
    """A recording of a clock that begins anew, and how it is read."""
    lines = [[t, *row[0]] for t, row in zip(RESTARTED, readings())]
    if source == "own table":
        titles = "time (s),stress_zz[0] (Pa),stress_zz[1] (Pa),stress_zz[2] (Pa)\n"
        (folder / "r.csv").write_text(titles + "".join(",".join(map(str, line)) + "\n" for line in lines))
        return folder / "r.csv", None
    if source == "table":
        (folder / "r.txt").write_text("t;S0;S1;S2\n" + "".join(";".join(map(str, line)) + "\n" for line in lines))
        return folder / "r.txt", MAP
    if source in ("lines of markers", "numbers that come again"):
        numbers = np.r_[50_000 + N[:10], N[:10]] if source == "lines of markers" else np.r_[N[:10], N[:10]]
        rows = [f"{n},{m},{row[0, m]}\n" for n, row in zip(numbers, readings()) for m in range(3)]
        (folder / "r.csv").write_text("f,m,p\n" + "".join(rows))
        return folder / "r.csv", LONG
    if source == "npz":
        np.savez(folder / "r.npz", readings=readings(), channel=np.array(["stress_zz"]), time=RESTARTED)
        return folder / "r.npz", None
    path = folder / f"r.{source}"
    with recorder(path, ["stress_zz"]) as out:
        for time, values in zip(RESTARTED, readings()):
            out.readings(time, values)
    return path, None


@pytest.mark.parametrize(
    "source", ["own table", "table", "lines of markers", "numbers that come again", "npz", "nc", "h5", "zarr", "mcap"]
)
def test_every_source_keeps_the_frames_after_a_restart(tmp_path: Path, source: str) -> None:
    path, mapping = written(tmp_path, source)
    with pytest.warns(UncheckedInput, match="restarted 1 time .*All 20 frames are kept in their order"):
        found = read_recording(path, mapping=mapping)
    np.testing.assert_array_equal(found.readings, readings())
    np.testing.assert_allclose(found.time - found.time[0], EVEN, atol=1e-9)
    assert "restarted" in found.meta["clock"]


def test_the_zero_is_taken_from_the_frames_at_rest_and_the_press_after_a_restart_is_read(tmp_path: Path) -> None:
    """Sorted by time, the zero would be the press."""
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
        pp.AreaArray(shape=(6, 5), pitch=1.5e-3, depth=2e-3, channels=["stress_zz"], noise=100.0),
    )
    rng = np.random.default_rng(0)
    ball = skin.sample(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0))
    frames = np.stack([skin.sense(f * ball, rng=rng) for f in (*np.zeros(10), *np.linspace(0.1, 1.0, 10))])
    titles = ",".join(["t", *(f"S{i}" for i in range(30))])
    lines = [",".join(map(repr, [float(t), *map(float, f.ravel())])) for t, f in zip(RESTARTED, frames)]
    (tmp_path / "r.csv").write_text("\n".join([titles, *lines, ""]))
    mapping = TableMapping(time="t", channels={"stress_zz": "S{}"}, scale=1.0, shape=(6, 5))
    with pytest.warns(UncheckedInput, match="restarted"):
        found = read_recording(tmp_path / "r.csv", mapping=mapping)
    with skin.track(baseline=8) as tracker:
        forces = [float(tracker.step(r, t).force[2]) for r, t in zip(found.readings, found.time)]
    assert forces[:10] == pytest.approx([0.0] * 10, abs=0.02)
    assert forces[-1] == pytest.approx(1.0, rel=0.1)
    assert tracker.health.restarts == 0


# -- bags --------------------------------------------------------------------------------------------------------------


def bag(folder: Path, stamps: Any, kind: str = "sensor_msgs/msg/Image", log: Any = None) -> Path:
    """A ROS 2 bag of 20 frames of three taxels, 20 ms apart by its own clock."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("uint64 at\nuint64 at_us\nstring when\nfloat64[] taxels\n", "my/msg/Skin"))
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        made = writer.add_connection("/skin", kind, typestore=store)
        for i, (stamp, row) in enumerate(zip(stamps, readings())):
            at = 1_700_000_000_000_000_000 + 20_000_000 * i if log is None else log[i]
            if kind == "my/msg/Skin":
                plain = int(stamp) if not isinstance(stamp, str) else 0
                message = store.types[kind](at=plain, at_us=plain, when=str(stamp), taxels=row[0])
            else:
                time = store.types["builtin_interfaces/msg/Time"](sec=int(stamp // 10**9), nanosec=int(stamp % 10**9))
                header = store.types["std_msgs/msg/Header"](stamp=time, frame_id="")
                data = row[0].astype("<f4").view(np.uint8)
                message = store.types[kind](
                    header=header, height=1, width=3, encoding="32FC1", is_bigendian=0, step=12, data=data
                )
            writer.write(made, at, store.serialize_cdr(message, kind))
    return folder


BAGS: dict[str, tuple[Any, float, str]] = {
    "restarted": (np.r_[10**12 + 20_000_000 * N[:10], 20_000_000 * N[:10]], 1000.0, "restarted 1 time"),
    "one far": (np.where(N == 9, 31_500_000, 0) * 10**9 + 10**18 + 20_000_000 * N, 1e9, "1 outlier: replaced by the time"),
    "never filled": (0 * N, 1.7e9, "all 20 stamps are 0 s: replaced by the time"),
    "whole seconds": (0 * N + 1_700_000_000 * 10**9, 1.7e9, "all 20 stamps are 1.7e.09 s: replaced by the time"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAGS)
def test_every_message_of_a_bag_is_a_frame(tmp_path: Path, case: str) -> None:
    stamps, first, words = BAGS[case]
    mapping = TopicMapping(topic="/skin", channels=["stress_zz"], stamp="header.stamp")
    with pytest.warns(UncheckedInput, match=f"{words}.*All 20 frames are kept"):
        found = read_recording(bag(tmp_path / "b", stamps), mapping=mapping)
    np.testing.assert_array_equal(found.readings, readings())
    np.testing.assert_allclose(found.time, first + EVEN, atol=1e-6)


def test_stamps_that_are_numbers_or_dates_have_a_unit(tmp_path: Path) -> None:
    """By its name, by what the user says, by its size, or by how fast it advances."""
    path = bag(tmp_path / "b", 5_000_000 + 20_000 * N, "my/msg/Skin")
    common: dict[str, Any] = {"topic": "/skin", "channels": ["stress_zz"], "path": "taxels"}
    for options in ({"stamp": "at_us"}, {"stamp": "at", "stamp_scale": 1e-6}):
        np.testing.assert_allclose(read_recording(path, mapping=TopicMapping(**common, **options)).time, 5.0 + EVEN)
    with pytest.warns(UncheckedInput, match="taken as microseconds, as the recorder's clock has them"):
        np.testing.assert_allclose(read_recording(path, mapping=TopicMapping(**common, stamp="at")).time, 5.0 + EVEN)
    path = bag(tmp_path / "c", 1_700_000_000_000 + 20 * N, "my/msg/Skin")
    with pytest.warns(UncheckedInput, match="milliseconds since 1970"):
        found = read_recording(path, mapping=TopicMapping(**common, stamp="at"))
    np.testing.assert_allclose(found.time, LOG, atol=1e-6)
    path = bag(tmp_path / "d", [f"2023-11-14T22:13:20.{20 * n:03d}Z" for n in N], "my/msg/Skin")
    found = read_recording(path, mapping=TopicMapping(**common, stamp="when"))
    np.testing.assert_allclose(found.time, LOG, atol=1e-6)


def test_a_bag_is_sorted_by_its_stamps_where_the_user_says_so(tmp_path: Path) -> None:
    order = np.random.default_rng(1).permutation(20)
    path = bag(tmp_path / "b", 10**12 + 20_000_000 * order)
    mapping = TopicMapping(topic="/skin", channels=["stress_zz"], stamp="header.stamp", sort=True)
    found = read_recording(path, mapping=mapping)
    np.testing.assert_allclose(found.time, 1000.0 + EVEN)
    np.testing.assert_array_equal(found.readings[order, 0, 0], PRESSED)
    with pytest.raises(pp.InvalidInput, match="name stamp too"):
        TopicMapping(topic="/skin", channels=["stress_zz"], sort=True)


def test_messages_at_one_time_of_the_recorder_are_all_frames(tmp_path: Path) -> None:
    path = bag(tmp_path / "b", 0 * N, log=[10**18 + 10**9 * (i // 5) for i in range(20)])
    with pytest.warns(UncheckedInput, match="16 repeated"):
        found = read_recording(path, mapping=TopicMapping(topic="/skin", channels=["stress_zz"]))
    np.testing.assert_array_equal(found.readings, readings())
    np.testing.assert_allclose(np.diff(found.time), 0.2, atol=1e-6)


def test_a_plain_bag_says_nothing(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for stamp in ("", "header.stamp"):
            mapping = TopicMapping(topic="/skin", channels=["stress_zz"], stamp=stamp)
            found = read_recording(bag(tmp_path / f"b{stamp}", 10**12 + 20_000_000 * N), mapping=mapping)
            assert "clock" not in found.meta
