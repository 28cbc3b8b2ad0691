"""Dates and times of day in text."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.errors import UncheckedInput
from palpate.recordings import TableMapping, read_recording
from palpate.recordings.columns import columns_of, columns_of_text
from palpate.recordings.dates import TimeCells

NOON = datetime.datetime(2017, 7, 30, 12, 6, 34, tzinfo=datetime.UTC).timestamp()
DATES = {
    "2017-07-30T12:06:34": 0.0,
    "2017-07-30 12:06:34.250": 0.25,
    "2017-07-30T12:06:34,5Z": 0.5,
    "2017-07-30T12:06:34+02:00": -7200.0,
    "2017-07-30T12:06:34.5-0530": 19800.5,
    "20170730T120634": 0.0,
    "20170730_120634.75": 0.75,
    "2017/07/30 12:06:34 UTC": 0.0,
    "30.07.2017 12:06:34,5": 0.5,
    "30.07.17 12:06": -34.0,
    "7/30/2017 12:06:34 PM": 0.0,
    "7/30/2017 12:06:34 am": -43200.0,
    "30/7/2017 12:06:34": 0.0,
    "30-Jul-2017 12:06:34.125": 0.125,
    "2017-07-30": -43594.0,
}
OF_DAY = {"12:06:34": 43594.0, "12:06:34.5": 43594.5, "1:06:34 PM": 47194.0, "06:34.5": 394.5, "0 days 00:00:00.050000": 0.05, "1 day, 0:00:01": 86401.0}  # fmt: skip
PLAIN = ("17.5", "-3", "1e5", "", "nan", "20170730", "1.2.3", "noon")
WRONG = {
    "2017-13-30": "no such day",
    "12:66:01": "66 minutes",
    "30-Jux-2017": "no month",
    "06:34": "hours and minutes or minutes and seconds",
}
CHANNELS = {"stress_zz": "S{}"}


@pytest.mark.parametrize("text", DATES)
def test_dates_are_seconds_since_1970(text: str) -> None:
    cells = TimeCells("x")
    value = cells.value(text, "line 1")
    assert value is not None
    assert cells.settled(np.array([value]))[0] == pytest.approx(NOON + DATES[text], abs=1e-6)


@pytest.mark.parametrize("text", OF_DAY)
def test_times_of_day_are_seconds_since_midnight(text: str) -> None:
    assert TimeCells("x").value(text, "line 1") == pytest.approx(OF_DAY[text])


@pytest.mark.parametrize("text", PLAIN)
def test_what_is_no_date_is_left_to_numbers(text: str) -> None:
    assert TimeCells("x").value(text, "line 1") is None


@pytest.mark.parametrize("text", WRONG)
def test_dates_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(pp.InvalidInput, match=f"line 1: '{text}'.*{WRONG[text]}"):
        TimeCells("x").value(text, "line 1")


def table(folder: Path, times: list[str], said: str = "time=t", title: str = "t") -> pp.Recording:
    rows = "".join(f"{t};{i};0\n" for i, t in enumerate(times))
    (folder / "t.csv").write_text(f"{title};S0;S1\n{rows}")
    return read_recording(folder / "t.csv", mapping=columns_of(columns_of_text(f"{said},stress_zz=S{{}},unit=1Pa")))


def test_a_table_of_dates(tmp_path: Path) -> None:
    found = table(tmp_path, ["2017-07-30T14:06:34+02:00", "2017-07-30T14:06:35.5+02:00"])
    assert found.time.tolist() == [NOON, NOON + 1.5]
    assert table(tmp_path, ["30.07.2017;12:06:34,5", "30.07.2017;12:06:35"], "time=day,t", "day;t").time.tolist() == [
        NOON + 0.5,
        NOON + 1,
    ]
    # the day first is what the second line alone allows
    assert np.diff(table(tmp_path, ["1/8/2017 23:59:59", "2/8/2017 0:00:00", "13/8/2017 0:00:00"]).time).tolist() == [
        1.0,
        11 * 86400.0,
    ]
    assert np.diff(table(tmp_path, ["3/4/2017 10:00:00", "3/4/2017 10:00:01"]).time).tolist() == [1.0]
    with pytest.warns(UncheckedInput, match="1 missing"):
        assert np.diff(table(tmp_path, ["12:00:00", "12:00:01", "", "12:00:03"]).time).tolist() == [1.0] * 3
    with pytest.warns(UncheckedInput, match="wrapped .period 86400 s."):
        assert np.diff(table(tmp_path, ["23:59:59", "23:59:59.5", "00:00:00", "00:00:00.5"]).time).tolist() == [0.5] * 3


def test_a_table_of_dates_without_titles(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("2017-07-30T12:06:34,1,2\n2017-07-30T12:06:35,3,4\n")
    mapping = TableMapping(time="1", channels={"stress_zz": ["2", "3"]}, scale=1.0)
    found = read_recording(tmp_path / "t.csv", mapping=mapping)
    assert (found.time.tolist(), found.readings[:, 0, 0].tolist()) == ([NOON, NOON + 1], [1.0, 3.0])


def test_own_tables_take_dates(tmp_path: Path) -> None:
    for title in ("time", "time (s)", "time (UTC)"):
        (tmp_path / "t.csv").write_text(
            f"{title},stress_zz[0] (Pa)\n2017-07-30T12:06:34Z,1\n2017-07-30T12:06:34.5Z,2\n"
        )
        assert read_recording(tmp_path / "t.csv").time.tolist() == [NOON, NOON + 0.5]
    (tmp_path / "t.csv").write_text("time (UTC),stress_zz[0] (Pa)\n5,1\n6,2\n")
    with pytest.raises(pp.InvalidInput, match="line 2: time has the unit 'UTC'"):
        read_recording(tmp_path / "t.csv")


def test_dates_that_may_be_meant_in_two_ways_are_refused(tmp_path: Path) -> None:
    with pytest.raises(pp.InvalidInput, match=r"month or the day first \(over 30 or 0 days\); save them as 2017-07-30"):
        table(tmp_path, ["7/3/2017 23:59:59", "8/3/2017 0:00:00"])
    with pytest.raises(pp.InvalidInput, match="leave out time_unit"):
        table(tmp_path, ["12:00:00", "12:00:01"], "time=t,time_unit=ms")
    with pytest.raises(pp.InvalidInput, match="some are numbers"):
        table(tmp_path, ["12:00:00", "5"])
    with pytest.raises(pp.InvalidInput, match="stands among dates"):
        table(tmp_path, ["2017-07-30 12:00:00", "12:00:01"])


def test_dates_are_no_readings(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("t;S0;S1\n0;2017-07-30;1\n1;2017-07-31;2\n")
    with pytest.raises(
        pp.InvalidInput, match="the column 'S0' holds dates or times of day, but stress_zz must be a number"
    ):
        read_recording(tmp_path / "t.csv", mapping=TableMapping(time="t", channels=CHANNELS, scale=1.0))


def test_lines_of_several_dates_are_several_frames(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("time,id,p\n12:00:00,0,1\n12:00:00,1,2\n12:00:01,0,3\n12:00:01,1,4\n")
    said = {"marker": "id", "channels": {"stress_zz": "p"}, "scale": 1.0}
    with pytest.raises(pp.InvalidInput, match="holds 2 different values: these are several frames"):
        read_recording(tmp_path / "t.csv", mapping=TableMapping(**said))
    assert read_recording(tmp_path / "t.csv", mapping=TableMapping(time="time", **said)).time.tolist() == [
        43200.0,
        43201.0,
    ]
