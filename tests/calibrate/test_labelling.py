"""Labels, zeros and frames at rest of a calibration. Readings are linear in the force, with known offsets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.calibrate import SkinCalibration, calibrate, calibrating
from palpate.calibrate.calibrating import Run, find_rest, flat_readings
from palpate.calibrate.calibrating import _labels as force_labels
from palpate.calibrate.labels import Labelled
from palpate.errors import InvalidInput
from palpate.sensing.times import interpolated

PAD = pp.BondedLayers([pp.Layer(thickness=8e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
GRAM = 9.80665e-3
TIME = np.arange(0.0, 30.0, 0.1)
BASE, GAIN = np.array([100.0, 200.0, 300.0, 400.0]), np.array([10.0, 11.0, 12.0, 9.0])
WEIGHTS = ["100 g, 5 s to 9 s", "200 g, 11 s to 15 s", "300 g, 17 s to 21 s", "500 g, 23 s to 27 s"]
AT_REST = "0 g, 0 s to 4 s"


def skin(mask: Any = None) -> pp.Skin:
    return pp.Skin(PAD, pp.AreaArray(shape=(2, 2), pitch=12e-3, depth="base", channels=["stress_zz"], mask=mask))


def applied(time: np.ndarray = TIME) -> np.ndarray:
    """The weights of `WEIGHTS` [N]."""
    out = np.zeros(len(time))
    for start, end, grams in ((5, 9, 100), (11, 15, 200), (17, 21, 300), (23, 27, 500)):
        out[(time >= start - 1e-9) & (time < end)] = grams * GRAM
    return out


def read(force: np.ndarray, noise: float = 0.1, seed: int = 0) -> np.ndarray:
    """Readings (frame, 1, 2, 2) of these forces."""
    rng = np.random.default_rng(seed)
    return (BASE + np.outer(force, GAIN) + noise * rng.standard_normal((len(force), 4))).reshape(-1, 1, 2, 2)


def newtons(found: SkinCalibration, force: float, base: np.ndarray = BASE) -> float:
    """Force that the calibration finds for readings minus this zero."""
    return float(found.force((BASE + force * GAIN - base)[None])[0][0, 2])


@pytest.mark.long
@pytest.mark.parametrize("dead", [np.nan, 0.0, "as its neighbour"])
def test_a_masked_taxel_may_read_anything_beside_weights(dead: Any) -> None:
    mask = np.array([[False, True], [True, True]])
    readings = np.round(read(applied()))
    readings[:, 0, 0, 0] = readings[:, 0, 0, 1] if isinstance(dead, str) else dead
    one = skin(mask)
    found = calibrate(one, readings, time=TIME, weights=[AT_REST, *WEIGHTS])
    assert found.zero is not None
    np.testing.assert_allclose(found.zero[0][mask], BASE[1:], atol=0.5)
    force = found.force(flat_readings(one.planes, readings[250] - found.zero)[None])[0][0, 2]
    assert force == pytest.approx(500 * GRAM, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize("baseline", [3, 40])
def test_the_baseline_beside_weights_counts_frames(baseline: int) -> None:
    found = calibrate(skin(), read(applied()), time=TIME, weights=WEIGHTS, baseline=baseline)
    assert found.zero is not None
    np.testing.assert_allclose(found.zero.ravel(), BASE, atol=0.3)
    assert [newtons(found, f) for f in (1.0, 3.0, 5.0)] == pytest.approx([1.0, 3.0, 5.0], rel=0.05)


@pytest.mark.long
def test_drift_of_the_zero_is_found_in_any_order_of_weights() -> None:
    drift = np.linspace(0.0, 20.0, 350)[:, None, None, None]
    time = np.arange(0.0, 35.0, 0.1)
    readings = read(applied(time)) + drift
    zeros = [AT_REST, "0 g, 30 s to 34 s"]
    for order in ([zeros[0], *WEIGHTS, zeros[1]], [*zeros, *WEIGHTS], [*WEIGHTS, *zeros]):
        found = calibrate(skin(), readings, time=time, weights=order)
        assert found.zero_std is not None
        assert np.median(found.zero_std) == pytest.approx(17.2, rel=0.1)


@pytest.mark.long
def test_a_masked_taxel_without_readings_leaves_the_frames_at_rest() -> None:
    mask = np.array([[True, True], [True, False]])
    readings = read(applied(), noise=3.0)
    readings[:, 0, 1, 1] = np.nan
    found = calibrate(skin(mask), readings, time=TIME, weights=[AT_REST, *WEIGHTS])
    assert found.rest is not None
    assert found.rest.std(axis=0)[0][mask] == pytest.approx(np.full(3, 3.0), rel=0.4)


@pytest.mark.long
@pytest.mark.parametrize("by", ["weights", "reference"])
def test_frames_of_the_baseline_tell_the_noise(by: str) -> None:
    force = applied()
    readings = read(force, noise=3.0)
    how: dict[str, Any] = (
        {"weights": WEIGHTS} if by == "weights" else {"reference": np.where(force > 0.0, force, np.nan)}
    )
    found = calibrate(skin(), readings, time=TIME, baseline=40, **how)
    assert found.rest is not None
    assert found.rest.std(axis=0).ravel() == pytest.approx(np.full(4, 3.0), rel=0.4)


@pytest.mark.long
def test_a_second_calibration_without_rest_keeps_the_zero() -> None:
    first = skin().calibrate(
        read(np.r_[np.zeros(6), np.arange(1.0, 6.0)]), reference=np.r_[np.zeros(6), np.arange(1.0, 6.0)]
    )
    second = first.calibrate(read(np.array([1.0, 2.0, 3.0])), reference=[1.0, 2.0, 3.0], again=True)
    old, new = first.calibration, second.calibration
    assert old is not None
    assert new is not None
    assert any("the zero of the calibration is used" in s for s in new.said)
    np.testing.assert_array_equal(new.zero, old.zero)
    np.testing.assert_array_equal(new.zero_std, old.zero_std)
    assert newtons(new, 3.0) == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize("shear", [np.nan, 0.0])
def test_a_frame_without_normal_force_is_at_rest_if_its_shear_is_not_known(shear: float) -> None:
    fz = np.r_[np.zeros(6), 1.0, 2.0, 3.0]
    fx = np.where(fz == 0.0, shear, 0.2 * fz)
    flat = read(fz).reshape(-1, 4)
    assert find_rest({"fx": fx, "fz": fz}, flat).tolist() == [True] * 6 + [False] * 3
    # shear alone does not say whether something presses
    assert not find_rest({"fx": np.full(9, np.nan), "fy": fx}, flat)[6:].any()


@pytest.mark.parametrize("failing", ["missing", "at the end of its range"])
def test_labels_are_not_interpolated_while_a_force_sensor_fails(failing: str) -> None:
    def force(time: np.ndarray) -> np.ndarray:
        return np.maximum(5.0 * np.sin(1.3 * time) + np.sin(0.7 * time), 0.0)

    time, clock = np.arange(0.0, 20.0, 0.05), np.arange(0.0, 20.0, 0.01)
    flat = read(force(time), noise=0.05).reshape(-1, 4)
    sensor = force(clock) + 0.003 * np.random.default_rng(1).standard_normal(len(clock))
    sensor = np.where(sensor > 3.0, np.nan, sensor) if failing == "missing" else np.minimum(sensor, 3.0)
    labels = force_labels(Run(flat.reshape(-1, 1, 4), flat, time), sensor, clock, [])["fz"]
    error = np.abs(labels - force(time))
    assert np.isfinite(error).sum() > 200
    assert np.nanmax(error) < 0.1


def test_missing_values_are_not_interpolated() -> None:
    clock = np.arange(10.0)
    values = np.array([0.0, 1.0, np.nan, 3.0, np.nan, np.nan, 6.0, 7.0, 8.0, 9.0])
    found = interpolated(np.array([-1.0, 0.5, 2.0, 3.0, 4.5, 6.0, 8.5, 9.5]), clock, values)
    np.testing.assert_allclose(found, [np.nan, 0.5, 2.0, 3.0, np.nan, 6.0, 8.5, np.nan])
    sparse = np.where(np.arange(40) % 10 == 0, np.arange(40.0), np.nan)  # known at every tenth time
    np.testing.assert_allclose(interpolated(np.array([5.5, 29.0]), np.arange(40.0), sparse), [5.5, 29.0])
    logged = np.array([0.0, 1.0, 2.0, 9.0])  # a sensor that sends only what changes
    assert interpolated(np.array([5.0]), logged, logged)[0] == 5.0
    one = np.array([np.nan, 4.0, np.nan])
    np.testing.assert_allclose(interpolated(np.array([0.5, 1.0]), np.arange(3.0), one), [np.nan, 4.0])


def presses_of(runs: list[Any], monkeypatch: pytest.MonkeyPatch, **options: Any) -> Labelled:
    """The labelled frames of a calibration, without its fit."""

    class Found(Exception):
        data: Labelled

    def caught(_: Any, data: Labelled, *__: Any) -> None:
        found = Found()
        found.data = data
        raise found

    monkeypatch.setattr(calibrating, "labelled_constants", caught)
    with pytest.raises(Found) as found:
        calibrate(skin(), runs, **options)
    return found.value.data


def test_frames_of_a_press_are_one_in_a_list_of_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    force = np.concatenate([applied(), applied()])
    runs, reference = [read(force), read(force, seed=1)], [force, force]
    time = np.arange(0.0, 60.0, 0.1)
    one = presses_of(runs[:1], monkeypatch, time=time, reference=force)
    assert one.time is not None
    single = len(np.unique(one.press))
    assert single < 12
    for times in ([time], (time,)):
        assert len(np.unique(presses_of(runs[:1], monkeypatch, time=times, reference=force).press)) == single
    both = presses_of(runs, monkeypatch, time=[time, time], reference=reference)
    assert len(np.unique(both.press)) == 2 * single
    assert both.time is not None
    none = presses_of(runs, monkeypatch, reference=reference)
    assert len(np.unique(none.press)) == len(none.flat)


def test_a_force_sensor_keeps_its_presses_beside_weights(monkeypatch: pytest.MonkeyPatch) -> None:
    force = np.concatenate([applied(), applied()])
    time = np.arange(0.0, 60.0, 0.1)
    runs = [read(applied()), pp.Recording(readings=read(force, seed=1), channels=["stress_zz"], time=time)]
    data = presses_of(runs, monkeypatch, time=[TIME, None], weights=[AT_REST, *WEIGHTS], reference=[None, force])
    assert len(np.unique(data.press[data.run == 0])) == 5  # each weight is a press
    assert len(np.unique(data.press[data.run == 1])) < 12
    assert not set(data.press[data.run == 0]) & set(data.press[data.run == 1])


@pytest.mark.parametrize("time", [TIME, [TIME], [TIME, 3.0], [TIME, TIME, TIME]])
def test_a_list_of_runs_needs_a_list_of_times(time: Any) -> None:
    with pytest.raises(InvalidInput, match=r"time must be a list with the times of each of 2 runs"):
        calibrate(skin(), [read(applied())] * 2, time=time, reference=[applied()] * 2)
