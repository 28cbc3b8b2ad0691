"""The rows of `palpate bench trust` that are recordings: what they do to readings, and what counts as right."""

from __future__ import annotations

import math
import sys
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.bench import trust
from palpate.bench.trust import recorded
from palpate.bench.trust.judge import _answered
from palpate.bench.trust.presses import cell_means
from palpate.bench.trust.rows import Frame
from palpate.inverse.estimate import Errors
from palpate.status import Status
from palpate.touch.fields import ErrorParts

ROWS = [name for name, row in trust.ROWS.items() if row.recorded is not None]


def recording_of(frame: Frame) -> recorded.Recorded:
    assert frame.recorded is not None
    return frame.recorded


def endless(frame: Frame) -> np.ndarray:
    """What the described skin, whose pad goes on for ever, would read under the true load."""
    return np.asarray(frame.sensor.skin(surface=frame.load.grid).sense(frame.load.traction))


def pressed(frame: Frame) -> np.ndarray:
    """The judged readings less the zero."""
    return frame.readings - recording_of(frame).rest.mean(axis=0)


def off(found: np.ndarray, right: np.ndarray) -> float:
    return float(np.linalg.norm(found - right) / np.linalg.norm(right))


# -- what is recorded ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("row", ROWS)
def test_a_recording_begins_with_thirty_frames_at_rest(row: str) -> None:
    frame = trust.make_frame(row, 3)
    recording = recording_of(frame)
    assert len(recording.rest) == recorded.REST == 30
    assert np.array_equal(recording.steps[-1], frame.readings)
    assert len(recording.times) == len(recording.rest) + len(recording.steps)
    assert np.isfinite(recording.times).all()
    spread, loud = recording.rest.std(axis=0).max(), np.abs(recording.clean - recording.rest.mean(axis=0)).max()
    assert spread < 0.15 * loud
    again = trust.make_frame(row, 3)
    assert np.array_equal(recording.rest, recording_of(again).rest)


@pytest.mark.long
def test_gains_differ_by_thirty_percent() -> None:
    ratios = []
    for index in range(12):
        frame = trust.make_frame("gains of 30 %", index)
        clean = endless(frame)
        strong = np.abs(clean) > 0.3 * np.abs(clean).max()
        ratios += list((pressed(frame)[strong] / clean[strong]).ravel())
    assert np.std(ratios) == pytest.approx(0.3, abs=0.06)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_the_side_of_a_pad_changes_shear_more_than_pressure() -> None:
    """Within a thickness of a free side the base feels a drag by a fifth more, and a push by a twentieth."""
    _, table = recorded._edge_table()
    frames = [trust.make_frame("edge", i) for i in range(12)]
    for frame in frames:
        # turned and mirrored with its load: it lies where the endless layer would have it
        assert 0.005 < off(pressed(frame), endless(frame)) < 0.2
    contacts, _ = recorded._edge_table()
    assert table.shape == (40, 3, 3, 5, 5)
    rim = 2.5 - contacts[:, 0] - contacts[:, 2]
    assert rim.min() > 0.5
    assert rim.max() < 1.0
    assert {frame.sensor.channels[-1] for frame in frames} == {"stress_zz"}


def test_a_push_at_the_pads_side_is_felt_on_that_side() -> None:
    contacts, table = recorded._edge_table()
    across = 0.75 * (np.arange(5) - 2)
    center = (table[:, 2, 2] * across).sum(axis=(1, 2)) / table[:, 2, 2].sum(axis=(1, 2))
    assert (center > 0.4 * contacts[:, 0]).all()
    assert np.corrcoef(center, contacts[:, 0])[0, 1] > 0.8
    # dragged towards +x the base is pushed towards +x
    assert (table[:, 0, 0].sum(axis=(1, 2)) > 0).all()
    assert (table[:, 1, 1].sum(axis=(1, 2)) > 0).all()


@pytest.mark.long
def test_a_lattice_leaves_a_tenth_to_a_third_unexplained() -> None:
    left = [off(pressed(f), endless(f)) for f in (trust.make_frame("lattice", i) for i in range(10))]
    assert min(left) > 0.05
    assert max(left) < 0.5


def test_all_readings_are_at_the_stated_end() -> None:
    for index in range(6):
        frame = trust.make_frame("all at their end", index)
        assert frame.limits is not None
        assert (frame.readings == frame.limits).all()
        assert np.abs(recording_of(frame).rest).max() < 0.2 * frame.limits
        assert np.abs(frame.reference).max() < frame.limits
        assert frame.open_above
        assert 0 < frame.least.force[-1] <= frame.load.force[-1]  # type: ignore[union-attr]


def test_an_even_press_reads_alike_and_goes_on_beyond_the_array() -> None:
    for index in range(6):
        frame = trust.make_frame("even press", index)
        assert frame.least is not None
        assert 0 < frame.least.force[-1] < 0.9 * frame.load.force[-1]
        normal = endless(frame)[frame.sensor.channels.index("stress_zz")]
        assert normal.min() > 0.3 * normal.max()


def test_a_patch_stays_at_the_values_of_its_press() -> None:
    for index in range(6):
        frame = trust.make_frame("frozen patch", index)
        steps = recording_of(frame).steps
        frozen = (steps[-1] == steps[-4]).all(axis=0)
        assert 4 <= frozen.sum() <= 9
        assert 3 * frozen.sum() < frozen.size
        assert frame.empty
        # its neighbours are at rest again
        around = (frame.readings - recording_of(frame).rest.mean(axis=0))[:, ~frozen]
        assert np.abs(around).max() < 0.25 * np.abs(steps - steps[-1]).max()


def test_zeros_follow_a_press() -> None:
    for index in range(6):
        frame = trust.make_frame("zeros after press", index)
        assert (frame.readings == 0).all()
        assert np.abs(recording_of(frame).steps).max() > 0
        assert (recording_of(frame).rest == 0).mean() > 0.5 or "noise at rest" in frame.words
        assert frame.empty


@pytest.mark.long
def test_the_clock_is_wrong_and_the_readings_are_right() -> None:
    kinds = set()
    for index in range(25):
        frame = trust.make_frame("restarted clock", index)
        assert (np.diff(recording_of(frame).times) <= 0).any()
        assert off(pressed(frame), endless(frame)) < 0.6
        kinds.add(frame.words.partition("the clock ")[2].split(" ")[0])
    assert kinds == {"restarts", "wraps", "goes", "counts", "swaps"}


def test_the_rows_without_recordings_are_as_they_were() -> None:
    sums = {"clean": 124419.56331100786, "gains": 249145.32511667925, "mixed": 20638.497321526716}
    for row, value in sums.items():
        assert np.abs(trust.make_frame(row, 5).readings).sum() == pytest.approx(value, rel=1e-9)
        assert trust.make_frame(row, 5).recorded is None


# -- what is right -------------------------------------------------------------------------------------------------------


def touch_of(frame: Frame, factor: float = 1.0, half: float = 0.1, **fields: Any) -> pp.Touch:
    """The truth times a factor, +- ``half`` of it."""
    grid = frame.skin.surface
    values = factor * cell_means(frame.typical, grid)
    d = len(frame.sensor.shape)
    names = d + 1
    std = half / 1.96 * float(frame.typical.force[-1])
    force = np.full(names, 1e-9 * std)
    force[-1] = std
    zeros = {"force": (names,), "moment": (2 * d - 1,), "center": (d,), "peak": (), "traction": (names, *grid.shape)}
    errors = Errors(
        traction=np.full((names, *grid.shape), 1e3),
        force=force,
        moment=np.ones(2 * d - 1),
        center=np.ones(d),
        peak=np.asarray(100.0),
        variance_reduction=np.full((names, *grid.shape), np.nan),
        beyond_force=np.zeros(names),
        **{f"outside_{n}": np.zeros(s) for n, s in zeros.items()},
    )
    return pp.Touch(values, grid, ("z",), "adaptive", _errors=fields.pop("_errors", ErrorParts(errors)), **fields)


def judged(frame: Frame, touch: pp.Touch) -> trust.Verdict:
    return trust.verdict(frame, touch, touch_of(frame), 0.0)


def with_ends(touch: pp.Touch, low: float, high: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the force of any touch these ends of its interval along z."""
    original = pp.Touch.interval

    def interval(self: pp.Touch, level: float = 0.95, of: str = "traction", **options: Any) -> Any:
        if of != "force":
            return original(self, level, of, **options)
        ends = np.zeros((2, len(touch.surface.components)))
        ends[:, -1] = low, high
        return ends[0], ends[1]

    monkeypatch.setattr(pp.Touch, "interval", interval)


def plain(row: str, suits: Any, first: int = 0) -> Frame:
    """A frame of the row whose sensor suits."""
    return next(f for f in (trust.make_frame(row, i) for i in range(first, first + 60)) if suits(f))


def test_an_overload_is_at_least_so_much(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = trust.make_frame("all at their end", 0)
    truth, touch = float(frame.load.force[-1]), touch_of(frame, 0.3)
    with_ends(touch, 0.2 * truth, math.inf, monkeypatch)
    right = judged(frame, touch)
    assert (right.far, right.betrays, right.inside["force"]) == (False, False, 1.0)
    with_ends(touch, 1.5 * truth, math.inf, monkeypatch)
    assert judged(frame, touch).inside["force"] < 1.0
    # a finite upper end, were it above the truth, is not what the readings tell
    with_ends(touch, 0.2 * truth, 1.2 * truth, monkeypatch)
    closed = judged(frame, touch)
    assert closed.far
    nothing = touch_of(frame, 0.0, status=np.int8(Status.NO_CONTACT), touching=np.asarray(False))
    with_ends(nothing, -0.01 * truth, 0.01 * truth, monkeypatch)
    assert judged(frame, nothing).betrays
    unknown = touch_of(frame, math.nan, _errors=None, status=np.int8(Status.MISSING))
    assert not judged(frame, unknown).betrays


def test_a_press_beyond_the_array_may_be_told_in_part() -> None:
    frame = trust.make_frame("even press", 1)
    least, whole = float(frame.least.force[-1]), float(frame.load.force[-1])  # type: ignore[union-attr]
    grid = frame.skin.surface
    seen = float(cell_means(frame.typical, grid)[-1].sum() * grid.cell)
    for force in (least, 0.5 * (least + whole), whole):
        v = judged(frame, touch_of(frame, force / seen))
        assert v.force_error == pytest.approx(0.0, abs=1e-9)
        assert (v.wrong, v.far) == (False, False)
    little = judged(frame, touch_of(frame, 0.2 * least / seen, half=0.01 * least / whole))
    assert little.far


def test_what_touched_before_is_not_there_any_more() -> None:
    for row in ("frozen patch", "zeros after press"):
        frame = trust.make_frame(row, 2)
        still = judged(frame, touch_of(frame, 1.0))
        assert (still.wrong, still.far) == (True, True)
        gone = judged(frame, touch_of(frame, 0.0, status=np.int8(Status.NO_CONTACT), touching=np.asarray(False)))
        assert (gone.wrong, gone.far, gone.betrays) == (False, False, False)


@pytest.mark.parametrize("road", ["reconstruct", "track", "table"])
@pytest.mark.long
def test_every_road_takes_the_zero_from_the_rest(road: str) -> None:
    """Offsets of ten times the load are gone with it."""
    frame = plain("restarted clock", lambda f: "+" not in str(f.sensor.channels) and f.sensor.kind == "area")
    recording = recording_of(frame)
    clean = recording.clean - recording.rest.mean(axis=0)
    peak = np.abs(clean).max()
    offset = 10.0 * peak * np.random.default_rng(0).standard_normal(clean.shape[1:])
    quiet = 1e-3 * peak * np.random.default_rng(1).standard_normal(recording.rest.shape)
    times = np.arange(len(quiet) + len(clean)) / recorded.RATE
    offset_only = replace(recording, rest=quiet + offset, steps=clean + offset, clean=clean, times=times, road=road)
    touch, said = _answered(frame, offset_only, {})
    alone = frame.skin.reconstruct(clean[-1])
    assert said == ()
    assert float(touch.force[-1]) == pytest.approx(float(alone.force[-1]), rel=0.3)


@pytest.mark.long
def test_what_the_reader_of_a_table_warns_of_is_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    judging = sys.modules[trust.judge.__module__]

    frame = plain("restarted clock", lambda f: recording_of(f).road == "table" and f.sensor.kind == "tiny")
    original = judging.read_recording

    def read(*arguments: Any, **options: Any) -> Any:
        warnings.warn("the clock went back", UserWarning, stacklevel=1)
        return original(*arguments, **options)

    monkeypatch.setattr(judging, "read_recording", read)
    assert "warning: the clock went back" in trust.judge(frame).words
