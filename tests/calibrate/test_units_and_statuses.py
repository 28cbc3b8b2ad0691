"""Units of a calibrated skin, statuses of its touches, and labels that several frames share."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import palpate as pp
from calibrate_scenes import PAD, bench, taxels
from palpate.calibrate.labels import plateaus
from palpate.status import Status
from palpate.touch import Forces


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, taxels())


def at_rest(count: int, seed: int = 1) -> np.ndarray:
    return 7.0 + 0.002 * np.random.default_rng(seed).standard_normal((count, 1, 4, 4))


def told(frames: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Ten frames at rest and ten presses of some frames each, in the unit of the sensor, and their forces."""
    readings, force, _ = bench(10, 3)
    rng = np.random.default_rng(5)
    presses = 7.0 + np.repeat(readings, frames, axis=0)
    presses += 0.002 * rng.standard_normal(presses.shape)
    return np.concatenate([at_rest(10), presses]), np.r_[np.zeros(10), np.repeat(force, frames)]


@pytest.mark.long
@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_of_readings_changes_nothing_after_the_calibration(skin: pp.Skin, unit: float) -> None:
    """Frames at rest give the noise in the unit of the sensor, and the elastic model works in that of the pad."""
    frames, force = told()
    test, rest = 7.0 + bench(4, 5003)[0], at_rest(12, 2)
    found = []
    for each in (1.0, unit):
        calibrated = skin.calibrate(each * frames, reference=force)
        assert calibrated.calibration is not None
        assert calibrated.calibration.elastic
        touch = calibrated.reconstruct(each * test, zero=each * rest)
        with calibrated.track(zero=each * rest) as tracker:
            tracked = [tracker.step(each * frame) for frame in test]
        found.append((touch.status.tolist(), touch.force[:, 2], [int(t.status) for t in tracked]))
    assert found[0][0] == found[1][0] == [int(Status.SOLVED)] * 4
    assert found[0][2] == found[1][2]
    np.testing.assert_allclose(found[0][1], found[1][1], rtol=1e-3)


@pytest.mark.long
def test_frames_of_the_zero_have_the_components_of_the_others(skin: pp.Skin) -> None:
    """Without an elastic model: a table of forces takes the frames of the zero and the presses."""
    frames, force = told()
    found = skin.calibrate(frames, reference=force).calibration
    assert found is not None
    alone = pp.Skin(PAD, taxels())
    alone._calibration = dataclasses.replace(found, unit=math.nan)
    forces = Forces()
    with alone.track(baseline=10) as tracker:
        for frame in [*at_rest(10), *(7.0 + bench(2, 5003)[0])]:
            forces.add(tracker.step(frame))
    assert forces.table()["status"].tolist()[::10] == ["capturing zero", "solved"]


def test_a_wide_interval_is_not_no_contact(skin: pp.Skin) -> None:
    """Only readings like those at rest are no contact; others whose force may be zero are undecided, with a note."""
    frames, force = told()
    found = skin.calibrate(frames, reference=force).calibration
    assert found is not None
    unsure = dataclasses.replace(found, unit=math.nan)
    rest, press = (part.reshape(1, -1) for part in (at_rest(1, 8)[0] - 7.0, 0.02 * bench(1, 5003)[0][0]))
    for one in unsure.maps.values():
        object.__setattr__(one, "inflation", 100.0)
    touch = unsure.alone(np.concatenate([rest, press]), skin.surface, np.zeros(0))
    assert [Status.coded(int(s)) for s in touch.status] == [Status.NO_CONTACT, Status.UNDECIDED]
    assert not touch.touching.any()
    assert any("by this calibration the force may be zero" in note for note in touch.notes)


def test_frames_of_one_press_are_one_label() -> None:
    """Frames in a row with equal labels and alike readings; the same force at another place is another press."""
    force = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 2.0, 0.0])
    flat = np.outer(force, [1.0, 0.0]) + 1e-3 * np.random.default_rng(0).standard_normal((8, 2))
    assert plateaus({"fz": force}, flat, np.arange(8)).tolist() == [0, 0, 1, 1, 1, 1, 2, 3]
    apart = np.array([0, 1, 2, 3, 7, 8, 9, 10])  # the frames between have no label
    assert plateaus({"fz": force}, flat, apart).tolist() == [0, 0, 1, 1, 2, 2, 3, 4]
    flat[4:6] = [0.0, 1.0]
    assert len(np.unique(plateaus({"fz": force}, flat, np.arange(8))[2:6])) == 4
    place = np.array([0.0, 0.0, 0.0, 0.0, 1e-3, 1e-3, 0.0, 0.0])
    assert plateaus({"fz": force, "x": place}, flat, np.arange(8)).tolist() == [0, 0, 1, 1, 2, 2, 3, 4]


@pytest.mark.long
def test_five_frames_of_each_press_tell_what_one_does(skin: pp.Skin) -> None:
    errors = []
    test, known, _ = bench(20, 5103)
    for count in (1, 5):
        frames, force = told(count)
        recording = pp.Recording(readings=frames, channels=["stress_zz"], time=0.1 * np.arange(len(frames)))
        found = skin.calibrate(recording, reference=force).calibration
        assert found is not None
        assert len(found.maps["fz"].process.values) == 11
        errors.append(np.abs(found.force(test.reshape(20, -1))[0][:, 2] - known).mean())
    assert errors[1] < 1.3 * errors[0]


@pytest.mark.long
def test_frames_before_the_first_weight_are_the_zero(skin: pp.Skin) -> None:
    """No weight of 0 g is named: raw counts would be taken for load. A hand on the pad before it is no rest."""
    readings, force, _ = bench(3, 21)
    time = np.arange(0.0, 40.0, 0.1)
    frames, said = np.zeros((len(time), 1, 4, 4)), []
    for k in range(3):
        frames[(time >= 10 * k + 8) & (time < 10 * k + 14)] = readings[k]
        said.append(f"{force[k]:.6f} N, {10 * k + 9} s to {10 * k + 13} s")
    frames += 300.0 + 0.001 * np.random.default_rng(0).standard_normal(frames.shape)
    found = skin.calibrate(pp.Recording(readings=frames, channels=["stress_zz"], time=time), weights=said).calibration
    assert found is not None
    assert found.zero is not None
    np.testing.assert_allclose(found.zero, 300.0, atol=0.01)
    assert found.force(readings.reshape(3, -1))[0][:, 2] == pytest.approx(force, rel=0.1)
    moving = frames + np.where(time < 7.0, 0.1 * np.abs(readings).max() * time, 0.0)[:, None, None, None]
    other = skin.calibrate(pp.Recording(readings=moving, channels=["stress_zz"], time=time), weights=said).calibration
    assert other is not None
    assert other.zero is None


def test_a_zero_far_from_0_beside_a_calibration_without_one_has_a_note(skin: pp.Skin) -> None:
    readings, force, _ = bench(6, 3)
    calibrated = skin.calibrate(300.0 + readings, reference=force)
    assert calibrated.calibration is not None
    assert calibrated.calibration.zero is None
    notes = calibrated.reconstruct(300.0 + readings[0], zero=at_rest(5) + 293.0).notes
    assert any("had no frames at rest" in note for note in notes)
    assert not any(
        "had no frames at rest" in note for note in calibrated.reconstruct(readings[0], zero=at_rest(5) - 7.0).notes
    )


@pytest.mark.long
def test_saturation_limits_are_in_the_unit_of_the_sensor() -> None:
    """Readings that lie at the limit are saturated, and no others: of 16 taxels 11 counted as saturated where 3 were."""
    frames, force = told()
    press = bench(1, 5003)[0][0]
    limit = 0.7 * float(press.max())
    cut = pp.Skin(PAD, dataclasses.replace(taxels(), limits=(-np.inf, limit)))
    calibrated = cut.calibrate(frames - 7.0, reference=force)
    assert calibrated.calibration is not None
    assert calibrated.calibration.elastic
    clipped = np.minimum(press, limit)
    assert calibrated.reconstruct(clipped).at_limit.tolist() == (clipped >= limit).ravel().tolist()
