"""The map from readings to force: its covariance, its degrees of freedom, what few labels leave open."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.calibrate import ForceMap, calibrate
from palpate.calibrate.process import NAMES, Process, Scaled, terms, variance

SENSOR = np.random.default_rng(1).normal(size=(2, 16))


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    array = pp.AreaArray(shape=(4, 4), pitch=4e-3, depth=3e-3, channels=["stress_zz"])
    return pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)


def labelled(readings: np.ndarray, force: np.ndarray) -> Process:
    return Process(readings, force, np.zeros(len(force)), np.full(readings.shape[1], 4.0), None, np.arange(len(force)))


def forces_of_a_plain_sensor(count: int, shear: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return readings (frame, reading), Fx and Fz [N] of a sensor whose sixteen readings are a mixture of both."""
    rng = np.random.default_rng(seed)
    normal = rng.uniform(1.0, 3.0, count)
    sideways = shear * normal * rng.uniform(-1.0, 1.0, count)
    return np.stack([sideways, normal], axis=1) @ SENSOR, sideways, normal


@pytest.mark.long
def test_the_normal_force_tells_how_large_shear_may_be(skin: pp.Skin) -> None:
    """Three presses that hardly shear do not show that shear is small where the normal force is newtons."""
    readings, sideways, normal = forces_of_a_plain_sensor(3, 0.01, 2)
    asked = forces_of_a_plain_sensor(40, 0.5, 3)[0]
    alone, beside = (
        calibrate(skin, readings.reshape(-1, 1, 4, 4), reference=reference).maps["fx"]
        for reference in ({"fx": sideways}, {"fx": sideways, "fz": normal})
    )
    assert np.median(beside.predict(asked)[1]) > 2.0 * np.median(alone.predict(asked)[1])
    assert alone.process.expected == 0.0
    assert 0.1 < beside.process.expected / np.sqrt(np.mean(normal**2)) < 0.3


def test_degrees_of_freedom_count_presses_that_show_the_size_of_forces() -> None:
    readings, _, normal = forces_of_a_plain_sensor(3, 0.0, 4)
    alike = ForceMap.fit(labelled(readings / normal[:, None], np.ones(3)))
    assert alike.freedom == pytest.approx(4.0)
    light = ForceMap.fit(labelled(np.array([[1.0], [0.01], [0.02]]) * readings[0], np.array([1.0, 0.01, 0.02])))
    assert light.freedom == pytest.approx(2.0, abs=0.01)


def test_prior_variance_is_the_diagonal_of_the_covariance() -> None:
    rng = np.random.default_rng(0)
    frames = Scaled.of(rng.normal(size=(7, 3)), np.ones(3))
    log, physics = rng.normal(size=len(NAMES)), np.diag([1.0, 2.0, 0.5])
    for without in ((), ("growing", "free"), ("bend", "quadratic"), ("physics", "linear")):
        both = terms(frames, frames, log, physics, without).total
        np.testing.assert_allclose(
            np.diag(both), variance(frames, log, physics, without), rtol=1e-5
        )  # `LEAST` makes directions shorter than 1


def test_a_map_of_an_older_file_does_not_bend() -> None:
    readings, sideways, _ = forces_of_a_plain_sensor(8, 0.5, 5)
    held = ForceMap.fit(labelled(readings, sideways)).arrays()
    frames = forces_of_a_plain_sensor(4, 0.5, 6)[0]
    bent = ForceMap.from_arrays(held).predict(frames)[0]
    older = ForceMap.from_arrays({**held, "log": held["log"][:, :-1]}).predict(frames)[0]
    straight = np.c_[held["log"][:, :-1], np.full(len(held["log"]), -50.0)]
    np.testing.assert_allclose(older, ForceMap.from_arrays({**held, "log": straight}).predict(frames)[0], rtol=1e-9)
    assert np.abs(bent - older).max() > 1e-4


def test_members_with_smaller_errors_weigh_more() -> None:
    readings, _, normal = forces_of_a_plain_sensor(30, 0.3, 7)
    made = ForceMap.fit(labelled(readings, normal**2))
    square = np.array([(m.left_out**2).mean() for m in made.members])
    assert np.array_equal(np.argsort(-made.weights), np.argsort(square))
    assert made.weights.sum() == pytest.approx(1.0)
