"""The elastic model as one more source of the normal force. Readings are closed forms of a half-space, not of the forward model."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.calibrate import read_calibration, write_calibrated
from palpate.calibrate.elastic import joined, normal_force

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
DEPTH, SHAPE = 3e-3, (5, 5)
ARRAY = pp.AreaArray(shape=SHAPE, pitch=2.5e-3, depth=DEPTH, channels=["stress_zz"])
SKIN = pp.Skin(PAD, ARRAY)


def bench(force: np.ndarray, seed: int) -> np.ndarray:
    """Readings (press, 1, 5, 5) of balls at random places on a sensor 10 % deeper than the skin, with gains of 3 % and 1 % noise."""
    rng, gain = np.random.default_rng(seed), 1.0 + 0.03 * np.random.default_rng(5).standard_normal(SHAPE)
    out = []
    for f in force:
        x, y = rng.uniform(-3e-3, 3e-3, 2)
        ball = pp.solutions.hertz_point(force=1.0, contact_radius=1.5e-3)
        at = ARRAY.points - [x, y]
        out.append(f * gain * ball.fields(PAD, ["stress_zz"], at[:, 0], at[:, 1], 1.1 * DEPTH)[0].reshape(SHAPE))
    clean = np.stack(out)[:, None] / 41.0
    return np.asarray(clean + 0.01 * clean.max() * rng.standard_normal(clean.shape))


WEIGHTS, ASKED = np.array([0.0, 1.0, 2.0, 4.0]), np.linspace(0.5, 4.5, 8)


@pytest.fixture(scope="module")
def elastic() -> pp.Skin:
    """A sensor that follows the elastic model, calibrated by three weights and a frame at rest."""
    return SKIN.calibrate(bench(WEIGHTS, 1), reference=WEIGHTS)


@pytest.fixture(scope="module")
def presses() -> np.ndarray:
    return bench(ASKED, 2)


def test_joined_weighs_by_precision() -> None:
    one, zero = np.array([1.0]), np.array([0.0])
    value, std = joined(one, one, zero, one)
    assert value[0] == pytest.approx(0.5)
    assert std[0] == pytest.approx(0.5**0.5)
    value, std = joined(one, 1e6 * one, zero, one)
    assert value[0] == pytest.approx(0.0, abs=1e-9)
    assert std[0] == pytest.approx(1.0)


def test_few_weights_are_helped_by_the_elastic_model(elastic: pp.Skin, presses: np.ndarray) -> None:
    found = elastic.calibration
    assert found is not None
    assert found.elastic
    assert found.elastic_weight > 0.5
    touch, force = elastic.reconstruct(presses), ASKED
    low, high = touch.interval(0.95, "force")
    assert touch.calibrated is not None
    alone, std = found.force(presses.reshape(len(force), -1))
    assert np.abs(touch.force[:, 2] - force).mean() < 0.8 * np.abs(alone[:, 2] - force).mean()
    assert ((low[:, 2] <= force) & (force <= high[:, 2])).all()
    assert touch.calibrated.std[:, 2].mean() < 0.8 * std[:, 2].mean()


def test_frames_that_the_elastic_model_does_not_solve_have_the_map(elastic: pp.Skin, presses: np.ndarray) -> None:
    found = elastic.calibration
    assert found is not None
    readings = presses[-2:]
    flat = readings.reshape(2, -1)
    touch = dataclasses.replace(
        elastic.reconstruct(readings), status=np.array([int(pp.Status.UNEXPLAINED), int(pp.Status.SOLVED)], dtype=np.int8),
        calibrated=None,
    )  # fmt: skip
    alone, std = found.force(flat)
    force = found.attach(touch, flat)
    assert force.calibrated is not None
    assert np.isnan(normal_force(touch)[0][0])
    assert force.calibrated.force[0] == pytest.approx(alone[0], nan_ok=True)
    assert force.calibrated.std[0] == pytest.approx(std[0], nan_ok=True)
    assert force.calibrated.force[1, 2] != pytest.approx(alone[1, 2], rel=1e-6)


def test_the_weight_of_the_elastic_model_travels(elastic: pp.Skin, tmp_path: Path) -> None:
    found = elastic.calibration
    assert found is not None
    (tmp_path / "skin.toml").write_text("[pad]\n")
    _, numbers = write_calibrated(tmp_path / "calibrated.toml", tmp_path / "skin.toml", found)
    again = read_calibration(tmp_path / "calibrated.toml")
    assert again is not None
    assert again.elastic_weight == found.elastic_weight
    assert again.elastic_inflation == found.elastic_inflation
    with np.load(numbers) as file:
        held = {k: file[k] for k in file.files if not k.startswith("elastic_") or k == "elastic_error"}
    np.savez(numbers, **held)  # as a version without these numbers wrote it
    old = read_calibration(tmp_path / "calibrated.toml")
    assert old is not None
    assert old.elastic_weight == 0.0


@pytest.mark.long
def test_a_missing_taxel_leaves_the_zero_of_the_others() -> None:
    """With a taxel missing, the zero was not subtracted before the elastic model was asked."""
    mask = np.ones(SHAPE, dtype=bool)
    mask[0, 4] = False
    skin = pp.Skin(PAD, dataclasses.replace(ARRAY, mask=mask))
    counts = bench(WEIGHTS, 1)
    found = skin.calibrate(counts + 512.0 * counts.max(), reference=WEIGHTS).calibration
    plain = skin.calibrate(counts, reference=WEIGHTS).calibration
    assert found is not None
    assert plain is not None
    assert plain.elastic
    assert found.unit == pytest.approx(plain.unit, rel=1e-6)
