"""A few labels of a run correct a calibration that was made on another. Readings come from closed forms (`calibrate_scenes.bench`)."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from calibrate_scenes import PAD, bench, taxels
from palpate.calibrate import ForceMap, calibrate, read_calibration, with_calibration, write_calibrated
from palpate.calibrate.run import FrameErrors, RunLabels
from palpate.errors import InvalidInput

#: Factor on all readings in the new run.
GAIN = 0.75


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, taxels())


@pytest.fixture(scope="module")
def calibrated(skin: pp.Skin) -> pp.Skin:
    readings, force, _ = bench(20, 3)
    return skin.calibrate(np.concatenate([np.zeros((2, 1, 4, 4)), readings]), reference=np.r_[0.0, 0.0, force])


def new_run(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Readings and forces of the same sensor (seed 3 of its gains) on another day."""
    readings, force, _ = bench(count, seed)
    return GAIN * readings, force


def held(found: pp.Skin, readings: np.ndarray, force: np.ndarray) -> tuple[float, float]:
    """Mean relative error, and fraction of 95 % intervals with the force."""
    touch = found.reconstruct(readings)
    low, high = (np.asarray(end)[:, 2] for end in touch.interval(0.95, "force"))
    return float(np.abs(np.asarray(touch.force)[:, 2] / force - 1.0).mean()), float(
        ((low <= force) & (force <= high)).mean()
    )


@pytest.mark.long
def test_three_presses_tell_the_gain_of_a_run(calibrated: pp.Skin) -> None:
    """All readings are 0.75 of what they were: forces are 25 % low without a label of the run, and right with three."""
    readings, force = new_run(30, 1003)
    labels = readings[:3], force[:3]
    today = calibrated.calibrate(labels[0], reference=labels[1], baseline=0, this_run=True)
    before, after = held(calibrated, readings[3:], force[3:]), held(today, readings[3:], force[3:])
    assert before[0] > 0.2
    assert after[0] < 0.4 * before[0]
    assert after[1] >= 0.9
    assert today.calibration is not None
    said = today.calibration.said[0]
    assert said.startswith(("this run: forces are 1.2", "this run: forces are 1.3")), said


@pytest.mark.long
def test_more_presses_make_narrower_intervals(calibrated: pp.Skin) -> None:
    readings, force = new_run(30, 1003)
    assert calibrated.calibration is not None
    widths = [calibrated.calibration.maps["fz"].predict(readings[20:].reshape(10, -1))[1].mean()]
    for count in (1, 10):
        found = calibrated.calibrate(readings[:count], reference=force[:count], baseline=0, this_run=True)
        assert found.calibration is not None
        widths.append(found.calibration.maps["fz"].predict(readings[20:].reshape(10, -1))[1].mean())
    assert widths[0] > widths[1] > widths[2]


@pytest.mark.long
def test_a_run_of_the_same_gain_changes_nothing(calibrated: pp.Skin) -> None:
    readings, force, _ = bench(30, 1003)
    today = calibrated.calibrate(readings[:3], reference=force[:3], baseline=0, this_run=True)
    before, after = held(calibrated, readings[3:], force[3:]), held(today, readings[3:], force[3:])
    assert after[0] < 1.2 * before[0]
    assert after[1] >= 0.9


def test_the_correction_is_the_mean_of_the_joint_normal(calibrated: pp.Skin) -> None:
    """Against the formula written out for the joint covariance of labels and frames."""
    assert calibrated.calibration is not None
    one = calibrated.calibration.maps["fz"]
    readings, force = new_run(12, 1003)
    flat = readings.reshape(12, -1)
    labels = RunLabels(flat[:1], force[:1], np.zeros(1), np.zeros(1, dtype=np.int64))
    value, std = labels.corrected(one.errors(flat[1:]), labels.known(one.errors(flat[:1])))
    errors: FrameErrors = one.errors(flat)
    joint = errors.covariance(errors) + np.diag(errors.noise**2 + errors.shared**2)
    assert np.linalg.eigvalsh(joint).min() > 0.0
    gain = joint[1:, :1] / joint[0, 0]
    np.testing.assert_allclose(value, errors.mean[1:] + gain[:, 0] * (force[0] - errors.mean[0]), rtol=1e-6)
    np.testing.assert_allclose(std**2, errors.std[1:] ** 2 - gain[:, 0] * joint[0, 1:], rtol=1e-6)


def test_labels_of_the_run_are_solved_once(calibrated: pp.Skin, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame of a stream inverted the covariance of all labels anew: 0.2 s a frame with 300 labels."""
    readings, force = new_run(6, 1003)
    today = calibrated.calibrate(readings[:3], reference=force[:3], baseline=0, this_run=True)
    assert today.calibration is not None
    one, solved = dataclasses.replace(today.calibration.maps["fz"]), []
    known = RunLabels.known
    monkeypatch.setattr(RunLabels, "known", lambda *a: solved.append(1) or known(*a))  # type: ignore[func-returns-value]
    for frame in readings.reshape(6, 1, -1):
        one.predict(frame)
        one.unlike(frame)
    assert one.gain_std > 0.0
    assert len(solved) == 1


@pytest.mark.long
def test_the_elastic_model_has_a_gain_of_its_own(calibrated: pp.Skin) -> None:
    """It got the gain of the map: forces that the map alone has wrong became wrong in the pressure map too."""
    assert calibrated.calibration is not None
    one = calibrated.calibration.maps["fz"]
    wrong = ForceMap.fit(dataclasses.replace(one.process, values=1.3 * one.process.values))
    found = dataclasses.replace(calibrated.calibration, maps={**calibrated.calibration.maps, "fz": wrong})
    assert found.elastic
    skin = with_calibration(calibrated._uncalibrated(), found)
    readings, force, _ = bench(30, 1003)
    today = skin.calibrate(readings[:6], reference=force[:6], baseline=0, this_run=True)
    assert today.calibration is not None
    assert today.calibration.unit / found.unit == pytest.approx(1.0, abs=0.07)
    assert today.calibration.maps["fz"].this_run is not None
    readings, force = new_run(30, 1003)
    today = calibrated.calibrate(readings[:6], reference=force[:6], baseline=0, this_run=True)
    assert today.calibration is not None
    assert today.calibration.unit / calibrated.calibration.unit == pytest.approx(1.0 / GAIN, rel=0.07)


@pytest.mark.long
def test_a_run_travels_in_files_and_into_the_next_calibration(
    calibrated: pp.Skin, skin: pp.Skin, tmp_path: Path
) -> None:
    readings, force = new_run(6, 1003)
    today = calibrated.calibrate(readings[:2], reference=force[:2], baseline=0, this_run=True)
    (tmp_path / "skin.toml").write_text("[pad]\n")
    assert today.calibration is not None
    write_calibrated(tmp_path / "today.toml", tmp_path / "skin.toml", today.calibration)
    read = read_calibration(tmp_path / "today.toml")
    assert read is not None
    flat = readings.reshape(6, -1)
    np.testing.assert_allclose(read.force(flat), today.calibration.force(flat), rtol=1e-9)
    again = calibrate(skin, readings[2:], reference=force[2:], before=read)
    labels = again.maps["fz"].process
    assert len(labels.values) == 22 + 2 + 4
    assert labels.run is not None
    assert len(np.unique(labels.run)) == 3


@pytest.mark.long
def test_one_weight_and_the_zero_of_the_calibration(skin: pp.Skin) -> None:
    """Counts with an offset and a run whose recording has no rest: the zero of the calibration serves."""
    offset = 300.0
    readings, force, _ = bench(20, 3, unit=1.0)
    found = skin.calibrate(
        np.concatenate([np.zeros((2, 1, 4, 4)), readings]) + offset, reference=np.r_[0.0, 0.0, force]
    )
    press, known = new_run(8, 1003)
    press = 41.0 * press + offset
    time = np.arange(8.0)
    today = found.calibrate(
        press, time=time, weights=[f"{known[k]} N, {k - 0.4} s to {k + 0.4} s" for k in range(3)], this_run=True
    )
    assert today.calibration is not None
    assert any("the zero of the calibration is used" in s for s in today.calibration.said)
    touch = today.reconstruct(press[3:] - offset)
    assert np.abs(np.asarray(touch.force)[:, 2] / known[3:] - 1.0).mean() < 0.15


@pytest.mark.parametrize(
    ("options", "uncalibrated"),
    [({}, True), ({"constants": ["youngs_modulus"]}, False), ({"pad_models": ["bonded"]}, False)],
)
def test_what_this_run_needs(calibrated: pp.Skin, skin: pp.Skin, options: dict[str, Any], uncalibrated: bool) -> None:
    readings, force = new_run(3, 1003)
    with pytest.raises(InvalidInput, match="this_run=True"):
        (skin if uncalibrated else calibrated).calibrate(readings, reference=force, this_run=True, **options)


def test_labels_that_the_calibration_has_no_map_of(calibrated: pp.Skin) -> None:
    readings, force = new_run(3, 1003)
    with pytest.raises(InvalidInput, match="maps of fz"):
        calibrated.calibrate(readings, reference={"fx": force}, this_run=True)


@pytest.mark.long
def test_the_zero_of_runs_is_learnt_from_runs(skin: pp.Skin) -> None:
    """The error of the zero is small if two runs agree at rest, and large if the force sensor of one is 0.2 N off."""
    readings, force, _ = bench(24, 3)
    half = [np.concatenate([np.zeros((3, 1, 4, 4)), part]) for part in (readings[:12], readings[12:])]
    labels = [np.r_[np.zeros(3), part] for part in (force[:12], force[12:])]
    alike = calibrate(skin, half, reference=labels, baseline=3).maps["fz"].run_zero
    shifted = [labels[0], labels[1] + 0.2]
    apart = calibrate(skin, half, reference=shifted, baseline=3).maps["fz"].run_zero
    assert alike < 0.05
    assert 0.1 < apart < 0.3


@pytest.mark.long
def test_a_map_without_labels_of_the_run_stays(skin: pp.Skin) -> None:
    readings, force, _ = bench(12, 3)
    found = skin.calibrate(readings, reference={"fz": force, "x": np.linspace(-1e-3, 1e-3, 12)}, baseline=0)
    today = found.calibrate(GAIN * readings[:2], reference=force[:2], baseline=0, this_run=True)
    assert found.calibration is not None
    assert today.calibration is not None
    assert today.calibration.maps["x"] is found.calibration.maps["x"]
    assert today.calibration.maps["fz"].this_run is not None
    assert dataclasses.replace(today.calibration.maps["fz"], this_run=None).predict(readings[:1].reshape(1, -1))[
        0
    ] == pytest.approx(found.calibration.maps["fz"].predict(readings[:1].reshape(1, -1))[0])
