"""The measure of how often the library is wrong without a word: its frames, what it counts, and its command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import CliRunner
from palpate.bench import trust
from palpate.bench.trust.presses import Load, cell_means, plain_ball, random_load
from palpate.bench.trust.sensors import Sensor, random_sensor
from palpate.cli import app
from palpate.inverse.estimate import Errors
from palpate.status import Status
from palpate.touch.fields import ErrorParts

LINE = Sensor("line", (21,), 1e-3, 1e-3, 0.0, ("stress_zz",), 1e5, 0.45)


# -- the population ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("row", list(trust.ROWS))
@pytest.mark.long
def test_frames_are_of_their_row(row: str) -> None:
    frame = trust.make_frame(row, 2)
    assert np.isfinite(frame.readings).all()
    assert frame.readings.shape == (len(frame.sensor.channels), *frame.sensor.shape) == frame.reference.shape[:4]
    assert trust.ROWS[row].suits(frame.sensor)
    assert frame.empty == (trust.ROWS[row].load == "nothing")
    assert np.any(frame.typical.traction)


@pytest.mark.long
def test_a_frame_is_the_same_whatever_else_is_run() -> None:
    for row in ("mixed", "depth named"):
        one, again = trust.make_frame(row, 4), trust.make_frame(row, 4)
        assert np.array_equal(one.readings, again.readings)
        assert np.array_equal(one.load.traction, again.load.traction)
        assert str(one) == str(again)
    assert len({str(trust.make_frame("empty", i, seed=s)) for i in (0, 1) for s in (0, 1)}) == 4
    with pytest.raises(pp.errors.InvalidInput, match="row must be one of clean"):
        trust.make_frame("nothing", 0)


def test_sensors_are_of_every_kind() -> None:
    found = [random_sensor(np.random.default_rng((3, i))) for i in range(300)]
    assert {s.kind for s in found} == {"line", "area", "tiny"}
    assert {s.sensing for s in found} == {"stress", "strain", "displacement"}
    assert {len(s.layers) for s in found} == {0, 1, 2}
    assert {s.shears for s in found} == {"", "x", "y", "xy"}
    assert any(s.gel for s in found)
    assert all(s.depth < s.thickness for s in found)
    assert {s.shape for s in found if s.kind == "tiny"} == {(3, 3), (3, 5), (4, 4)}


@pytest.mark.parametrize("i", range(6))
def test_shear_stays_within_friction_and_the_truth_keeps_its_force(i: int) -> None:
    rng = np.random.default_rng((4, i))
    sensor = random_sensor(rng, lambda s: s.shears == "xy")
    load = random_load(rng, sensor, friction=0.5, axes="xy")
    shear = np.hypot(*load.traction[:2])
    assert (shear <= 0.5 * load.traction[2] * (1 + 1e-9)).all()
    assert load.size == pytest.approx(np.sqrt((load.traction**2).sum(axis=0)).sum() * load.grid.cell)
    # on any other grid that covers it
    wide = pp.AreaGrid(shape=(40, 37), spacing=sensor.pitch * 0.93)
    means = cell_means(load, wide)
    assert means.sum(axis=(1, 2)) * wide.cell == pytest.approx(load.force, abs=1e-9 * load.size)


def test_the_readings_are_those_of_the_closed_form() -> None:
    """A ball in the middle of a half-space: Hertz's field at the taxels, which owes nothing to the spectral code."""
    sensor = Sensor("area", (9, 9), 1e-3, 1.1e-3, 0.0, ("stress_xz", "stress_yz", "stress_zz"), 1e5, 0.4)
    load = plain_ball(sensor, 5e3)
    readings = sensor.skin(surface=load.grid).sense(load.traction)
    ball = pp.solutions.hertz_point(contact_radius=0.35 * 4.5e-3, force=float(load.force[2])).shifted(0.1e-3, 0.1e-3)
    grid = sensor.skin().planes[0].grid
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.4)
    exact = ball.fields(pad, sensor.channels, grid.x[None, :], grid.axes[0][:, None], 1.1e-3)
    assert np.abs(readings - exact).max() < 0.01 * np.abs(exact).max()


def test_what_is_stated_reaches_the_skin() -> None:
    for row, name, value in (("modulus named", "youngs_modulus", 0.2), ("gains named", "gain", 0.075)):
        frame = trust.make_frame(row, 1)
        assert getattr(frame.skin.uncertainty, name) == value


@pytest.mark.long
def test_violations_are_what_they_say() -> None:
    for index in range(2):
        clipped = trust.make_frame("clipped", index)
        ceiling = np.abs(clipped.readings).max()
        assert np.count_nonzero(np.abs(clipped.readings) == ceiling) >= 1
        assert np.all(trust.make_frame("pulling", index).load.traction[-1] <= 0)
        assert trust.make_frame("adhesion", index).load.traction[-1].min() < 0
        rounded = trust.make_frame("8 bit", index)
        steps = np.unique(rounded.readings)
        assert len(steps) <= 256
        thick = trust.make_frame("thickness", index)
        assert thick.described.layers != thick.sensor.layers
        assert thick.described.depth == thick.sensor.depth < thick.described.thickness
        railed = np.sort(np.abs(trust.make_frame("railed", index).readings).ravel())
        assert railed[-1] > 8 * railed[-2]


# -- the measure ---------------------------------------------------------------------------------------------------------


def a_frame(force: float = 10.0) -> trust.Frame:
    """A line of 21 taxels on which a block of 4 mm presses."""
    grid = pp.LineGrid(count=40, spacing=1e-4)
    traction = np.stack([np.zeros(40), np.full(40, force / 4e-3)])
    load = Load(grid, traction, "block")
    nothing = np.zeros((1, 21))
    return trust.Frame("clean", 0, LINE, LINE, {}, None, None, nothing, load, load, nothing, "")


def touch_of(frame: trust.Frame, factor: float = 1.0, half: float = 0.5, **fields: Any) -> pp.Touch:
    """A made-up answer: the truth times a factor, with an error of the force that makes a 95 % interval of about +- ``half``."""
    grid = frame.skin.surface
    std = half / 1.96
    errors = Errors(
        traction=np.full((2, grid.count), 1e3),
        force=np.array([0.0, std]),
        moment=np.ones(1),
        center=np.ones(1),
        peak=np.asarray(100.0),
        variance_reduction=np.full((2, grid.count), np.nan),
        beyond_force=np.zeros(2),
        **{f"outside_{n}": np.zeros(s) for n, s in OUTSIDE.items()},
    )
    values = factor * cell_means(frame.load, grid)
    return pp.Touch(values, grid, ("z",), "adaptive", _errors=fields.pop("_errors", ErrorParts(errors)), **fields)


OUTSIDE = {"force": (2,), "moment": (1,), "center": (1,), "peak": (), "traction": (2, 25)}


def judged(frame: trust.Frame, touch: pp.Touch, reference: pp.Touch | None = None) -> trust.Verdict:
    return trust.verdict(frame, touch, touch_of(frame) if reference is None else reference, 0.01)


def test_what_is_right_is_right() -> None:
    frame = a_frame()
    v = judged(frame, touch_of(frame))
    assert not v.wrong
    assert not v.far
    assert not v.betrays
    assert v.words == ()
    assert v.force_error == pytest.approx(0.0, abs=1e-12)
    assert v.inside == {"force": 1.0, "peak": 1.0, "cells": 1.0}


def test_an_answer_off_by_two_fifths_without_a_word_is_counted() -> None:
    frame = a_frame()
    v = judged(frame, touch_of(frame, 1.4))
    assert v.force_error == pytest.approx(0.4)
    assert v.wrong
    assert v.far
    assert v.betrays
    assert v.inside["force"] == 0.0


def test_outside_by_less_than_half_the_half_width_is_not_far() -> None:
    frame = a_frame()
    touch = touch_of(frame, 1.0, half=0.5)
    low, high = touch.interval(0.95, "force")
    half = 0.5 * float(high[1] - low[1])
    for beyond, far in ((0.4, False), (0.6, True)):
        factor = 1.0 + (half * (1 + beyond) + (10.0 - 0.5 * float(low[1] + high[1]))) / 10.0
        v = judged(frame, touch_of(frame, factor, half=0.5))
        assert (v.far, v.wrong, v.betrays) == (far, False, far)
        assert v.inside["force"] == 0.0


def test_words_are_what_this_frame_says() -> None:
    frame = a_frame()
    wrong = touch_of(frame, 2.0)
    assert judged(frame, wrong).betrays
    standing = "the net force is seen only through 3 cells"
    noted = touch_of(frame, 2.0, assumptions=(standing,))
    assert not judged(frame, noted).betrays
    # what is said of a clean frame too, figures apart, is no word
    usual = touch_of(frame, assumptions=(standing.replace("3", "17"),))
    assert judged(frame, noted, usual).betrays
    pulls = touch_of(frame, 2.0, status=np.int8(Status.NOT_PUSHING))
    assert judged(frame, pulls).words == ("status not pushing",)
    wide = touch_of(frame, 2.0, half=20.0)
    said = judged(frame, wide).words
    assert said[0] == "interval wider than the load"
    assert "is uncertain" in said[1]
    assert judged(frame, wide).wrong
    assert not judged(frame, wide).betrays
    unknown = touch_of(frame, 2.0, _errors=None)
    assert judged(frame, unknown).words == ("force or interval not known",)
    assert judged(frame, unknown, unknown).betrays  # it never has one


def test_what_says_that_it_is_known_roughly_only_is_not_wrong_without_a_word_inside_its_interval() -> None:
    """Be it as every frame of this sensor: a gel whose modulus is known to 20 % cannot say less."""
    frame = a_frame()
    usual = touch_of(frame, half=4.7)
    inside = judged(frame, touch_of(frame, 1.35, half=4.7), usual)
    assert (inside.rough, inside.silent, inside.wrong, inside.far, inside.betrays) == (True, True, True, False, False)
    outside = judged(frame, touch_of(frame, 0.4, half=1.8), usual)
    assert (outside.rough, outside.silent, outside.far, outside.betrays) == (True, True, True, True)
    narrow = judged(frame, touch_of(frame, 1.35, half=0.2), usual)
    assert (narrow.rough, narrow.betrays) == (False, True)


def test_a_misfit_is_a_word() -> None:
    frame = a_frame()
    fitted = touch_of(frame, 2.0, fit=np.asarray(0.002))
    assert "fit 0.002" in judged(frame, fitted).words
    assert judged(frame, fitted).fit == 0.002


def test_no_contact_is_an_answer_and_no_word() -> None:
    frame = a_frame()
    nothing = touch_of(frame, 0.0, status=np.int8(Status.NO_CONTACT), touching=np.asarray(False))
    v = judged(frame, nothing)
    assert v.status == "no contact"
    assert v.wrong
    assert v.betrays
    empty = replace(frame, load=frame.load.times(0.0))
    right = judged(empty, nothing)
    assert right.status == "no contact"
    assert not right.betrays
    assert right.force_error == 0.0


def test_pressure_that_acts_and_is_not_sought_is_wrong() -> None:
    frame = a_frame()
    touch = touch_of(frame)
    shear = pp.Touch(np.zeros_like(touch.values), touch.surface, ("x",), "adaptive", _errors=touch._errors)
    assert judged(frame, shear).wrong
    assert judged(frame, shear).far


def test_a_refusal_is_a_word_and_a_breakdown_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = trust.make_frame("clean", 0)
    huge = replace(frame, readings=frame.readings * 1e9)
    v = trust.judge(huge)
    assert v.status.startswith("refused: ")
    assert not v.silent
    assert not v.betrays

    def fail(*_: Any, **__: Any) -> Any:
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr(pp.Skin, "reconstruct", fail)
    v = trust.judge(frame)
    assert v.broken
    assert v.wrong
    assert v.betrays
    line = trust.lines([v])[0]
    assert (line.frames, line.broken, line.betrays, line.refused) == (1, 1, 1, 0)
    assert "1 broken" in trust.cells(line)[1]


def test_a_frame_that_takes_too_long_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = trust.make_frame("clean", 0)
    answer = pp.Skin.reconstruct
    calls: list[int] = []

    def slow(self: pp.Skin, readings: Any, **options: Any) -> Any:
        calls.append(1)
        while len(calls) > 1:  # the second call is the frame's
            pass
        return answer(self, readings, **options)

    monkeypatch.setattr(pp.Skin, "reconstruct", slow)
    v = trust.judge(frame, limit=0.05)
    assert v.late
    assert not v.broken
    assert not v.betrays
    assert "not in time" in trust.cells(trust.lines([v])[0])[1]


def test_lines_count() -> None:
    frame = a_frame()
    right, wrong = judged(frame, touch_of(frame)), judged(frame, touch_of(frame, 1.5))
    warned = judged(frame, touch_of(frame, 1.5, status=np.int8(Status.NOT_CONVERGED)))
    though_right = judged(frame, touch_of(frame, 1.0, status=np.int8(Status.NOT_CONVERGED)))
    line = trust.lines([right, right, wrong, warned, though_right])[0]
    assert (line.frames, line.wrong, line.wrong_silent, line.far, line.far_silent) == (5, 2, 1, 2, 1)
    assert (line.betrays, line.warned, line.words, line.though_right) == (1, 1, 2, 1)
    assert line.coverage["force"] == pytest.approx(0.6)
    assert line.half == pytest.approx(0.01)
    assert trust.by_sensor([right, wrong]) == [("line of stress_zz", 1, 2)]
    text = trust.markdown([line], command="palpate bench trust")
    assert "| clean | 5 | 2 / 1 |" in text


# -- the command ---------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_command_writes_table_picture_and_cases(tmp_path: Path) -> None:
    out, figure, every = tmp_path / "trust.md", tmp_path / "trust.png", tmp_path / "trust.csv"
    options = ["--frames", "1", "--rows", "empty,unseen shear", "--seed", "4", "--limit", "20", "--each"]
    files = ["--out", str(out), "--figure", str(figure), "--cases", str(every)]
    done = CliRunner().invoke(app, ["bench", "trust", *options, *files])
    assert done.exit_code == 0, done.output
    text = out.read_text(encoding="utf-8")
    assert text.startswith("Made by `palpate bench trust --frames 1 --seed 4 --rows 'empty,unseen shear' --limit 20`")
    assert "| empty | 1" in text
    assert "| unseen shear | 1" in text
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert len(every.read_text(encoding="utf-8").splitlines()) == 3
    again = CliRunner().invoke(app, ["bench", "trust", *options, "--out", str(out)])
    assert again.exit_code != 0  # it exists
    unknown = CliRunner().invoke(app, ["bench", "trust", "--rows", "nothing at all"])
    assert unknown.exit_code != 0
