"""Constants of a pad from presses of known force. Readings are closed forms of a half-space, or come from `Skin.sense` where layers are ranked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.calibrate import PadConstants, read_calibration, with_constants, write_calibrated
from palpate.calibrate.constants import fit_constants
from palpate.errors import InvalidInput

SHAPE, PITCH, NOISE = (6, 7), 2e-3, 0.01
MOVED = ["displacement_x", "displacement_y"]
SKIN_FILE = """\
[pad]
kind = "half_space"
youngs_modulus = "100 kPa"
poissons_ratio = 0.48

[[plane]]
kind = "area"
shape = [6, 7]
pitch = "2 mm"
depth = "2 mm"
channels = ["displacement_x", "displacement_y"]
"""


def array(channels: list[str], depth: float = 2e-3) -> pp.AreaArray:
    return pp.AreaArray(shape=SHAPE, pitch=PITCH, depth=depth, channels=channels)


def gel(seed: int, presses: int, truth: pp.HalfSpace, depth: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Marker displacements (press, 2, 6, 7), forces, radii of balls at unknown places, and the noise."""
    rng = np.random.default_rng(seed)
    y, x = array(MOVED).points.T
    force, radius = np.resize([1.0, 2.0, 4.0], presses), np.resize([4e-3, 6e-3, 9e-3], presses)
    made = []
    for f, r in zip(force, radius):
        at = rng.uniform(-3e-3, 3e-3, 2)
        a = pp.solutions.hertz_contact_radius(truth, radius=r, force=f)
        ball = pp.solutions.hertz_point(force=f, contact_radius=a)
        made.append(ball.fields(truth, MOVED, x - at[0], y - at[1], depth))
    clean = np.stack(made).reshape(presses, 2, *SHAPE)
    noise = NOISE * float(np.abs(clean).max())
    return clean + noise * rng.standard_normal(clean.shape), force, radius, noise


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array(MOVED))


def test_three_balls_tell_modulus_and_depth_of_a_gel(skin: pp.Skin) -> None:
    truth = pp.HalfSpace(youngs_modulus=1.4e5, poissons_ratio=0.48)
    readings, force, radius, noise = gel(1, 3, truth, 2.3e-3)
    found = fit_constants(skin, readings, force, constants=["youngs_modulus", "depth"], noise=noise, ball_radius=radius)
    off = np.log(found.values / [1.4e5, 2.3e-3])
    assert found.told.all()
    assert (np.abs(off) < 3.0 * found.std).all()
    assert (found.std < 0.05).all()


def test_the_modulus_is_not_told_by_stress_under_known_loads() -> None:
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    skin = pp.Skin(pad, array(["stress_zz"]))
    y, x = array(["stress_zz"]).points.T
    ball = pp.solutions.hertz_point(force=2.0, contact_radius=1.5e-3)
    clean = np.stack([ball.fields(pad, ["stress_zz"], x - s, y, 2.2e-3) for s in (-2e-3, 0.0, 3e-3)]).reshape(
        3, 1, *SHAPE
    )
    found = fit_constants(skin, clean, np.full(3, 2.0), constants=["youngs_modulus", "depth"], noise=0.01 * clean.max())
    told = dict(zip(found.names, found.told.tolist()))
    assert told == {"youngs_modulus": False, "depth": True}
    assert "the presses do not determine youngs_modulus" in str(found)
    assert "of known radius" in str(found)  # the press that would tell it


def test_modulus_and_unit_of_a_displacement_are_told_together_only(skin: pp.Skin) -> None:
    readings, force, _, noise = gel(2, 6, pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), 2e-3)
    found = fit_constants(skin, readings, force, constants=["youngs_modulus", "unit"], noise=noise)
    assert not found.told[found.names.index("youngs_modulus")]
    assert found.covariance[0, 1] > 0.99 * found.std[0] * found.std[1]


@pytest.mark.long
def test_the_pad_that_made_the_presses_is_named() -> None:
    layers = pp.BondedLayers([pp.Layer(thickness=3e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    skin = pp.Skin(layers, array(["displacement_x", "displacement_z"]))
    balls = [pp.solutions.hertz_point(force=2.0, contact_radius=1.5e-3).shifted(1e-3 * i, -1e-3) for i in range(-2, 2)]
    clean = np.stack([np.asarray(skin.sense(b)) for b in balls])
    noise = NOISE * float(np.abs(clean).max())
    readings = clean + noise * np.random.default_rng(0).standard_normal(clean.shape)
    found = fit_constants(
        skin,
        readings,
        np.full(4, 2.0),
        constants=["youngs_modulus", "thickness"],
        noise=noise,
        models=["half-space", "bonded"],
    )
    assert found.best_model == "bonded"


@pytest.mark.long
def test_presses_that_no_pad_makes_give_no_constants(skin: pp.Skin) -> None:
    readings = np.random.default_rng(0).standard_normal((4, 2, *SHAPE))
    found = fit_constants(skin, readings, np.ones(4), constants=["depth", "unit"], noise=0.01)
    assert found.best_model is None
    assert "none of the requested pad models" in str(found)
    assert with_constants(skin, found) is skin


@pytest.mark.long
def test_constants_travel_into_the_skin_its_file_and_the_next_calibration(skin: pp.Skin, tmp_path: Path) -> None:
    truth = pp.HalfSpace(youngs_modulus=1.4e5, poissons_ratio=0.48)
    readings, force, radius, noise = gel(3, 6, truth, 2e-3)
    rest = noise * np.random.default_rng(4).standard_normal((10, *readings.shape[1:]))
    presses = np.concatenate([rest, readings])
    known = {"fz": np.r_[np.zeros(10), force], "ball_radius": np.r_[np.full(10, np.nan), radius]}
    asked = ["youngs_modulus", "depth"]
    calibrated = skin.calibrate(presses, reference=known, constants=asked)
    assert calibrated.calibration is not None
    assert calibrated.calibration.constants is not None
    assert calibrated.pad.youngs_modulus == pytest.approx(1.4e5, rel=0.1)
    stated = calibrated.uncertainty.youngs_modulus
    assert stated is not None
    assert stated < 0.1
    assert "youngs_modulus" in str(calibrated.calibration)

    source, target = tmp_path / "skin.toml", tmp_path / "calibrated.toml"
    source.write_text(SKIN_FILE, encoding="utf-8")
    write_calibrated(target, source, calibrated.calibration)
    read = read_calibration(target)
    assert read is not None
    assert read.constants is not None
    np.testing.assert_array_equal(read.constants.covariance, calibrated.calibration.constants.covariance)
    assert pp.Skin.from_file(target).pad.youngs_modulus == calibrated.pad.youngs_modulus

    again = calibrated.calibrate(presses, reference=known, constants=asked, again=True)
    assert again.calibration is not None
    assert again.calibration.constants is not None
    assert (again.calibration.constants.std < calibrated.calibration.constants.std).all()
    kept = calibrated.calibrate(presses, reference=known, again=True)
    assert kept.calibration is not None
    assert kept.calibration.constants is calibrated.calibration.constants


def test_one_channel_of_displacement_is_enough(skin: pp.Skin) -> None:
    readings, force, radius, noise = gel(5, 3, pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), 2e-3)
    one = pp.Skin(skin.pad, array(["displacement_x"]))
    found = fit_constants(one, readings[:, :1], force, constants=["depth"], noise=noise, ball_radius=radius)
    assert abs(np.log(found.values[0] / 2e-3)) < 3.0 * found.std[0]


def test_damaged_constants_are_refused() -> None:
    found = PadConstants("half-space", ("depth",), np.ones(1), np.eye(1), np.ones(1), {"half-space": 0.0}, 1.0)
    assert PadConstants.from_json(found.json()).names == ("depth",)
    with pytest.raises(ValueError, match="other counts"):
        PadConstants.from_json(found.json().replace('["depth"]', '["depth", "unit"]'))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"constants": ["stiffness"]}, "constants names 'stiffness'"),
        ({"constants": ["poissons_ratio"]}, "poissons_ratio is not fitted: state it with the pad"),
        ({"constants": ["depth"], "pad_models": ["foam"]}, "models names 'foam'"),
        ({"pad_models": ["bonded"]}, "pad_models="),
    ],
)
def test_unknown_names_are_refused(skin: pp.Skin, options: dict[str, list[str]], words: str) -> None:
    readings, force, _, _ = gel(1, 3, pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), 2e-3)
    with pytest.raises(InvalidInput, match=words):
        skin.calibrate(readings, reference=force, **options)


@pytest.mark.long
def test_gains_are_divided_out_of_what_the_pad_sees(tmp_path: Path) -> None:
    layer = pp.BondedLayers([pp.Layer(thickness=3e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    skin = pp.Skin(layer, pp.AreaArray(shape=(5, 5), pitch=2e-3, depth="base", channels=["stress_zz"]))
    rng = np.random.default_rng(0)
    gains = np.exp(0.1 * rng.standard_normal((5, 5)))
    places = rng.uniform(-3e-3, 3e-3, (12, 2))
    clean = np.stack(
        [np.asarray(skin.sense(pp.solutions.hertz_point(force=2.0, contact_radius=2e-3).shifted(*p))) for p in places]
    )
    noise = 0.005 * float(clean.max())
    rest = noise * rng.standard_normal((10, *clean.shape[1:]))
    pressed = gains * clean + noise * rng.standard_normal(clean.shape)
    known = {"fz": np.r_[np.zeros(10), np.full(12, 2.0)], "ball_radius": np.full(22, np.nan)}
    presses = np.concatenate([rest, pressed])
    plain = skin.calibrate(presses, reference=known)
    found = skin.calibrate(presses, reference=known, constants=["gain"])
    assert found.calibration is not None
    assert found.calibration.gains is not None
    assert np.abs(np.log(found.calibration.gains / gains.ravel())).mean() < 0.03
    assert found.uncertainty.gain is not None
    assert 0.0 < found.uncertainty.gain < 0.05
    ball = pp.solutions.hertz_point(force=1.5, contact_radius=2e-3).shifted(0.5e-3, -1e-3)
    truth = skin.sample(ball)[2]
    reading = gains * np.asarray(skin.sense(ball)) + noise * rng.standard_normal(clean.shape[1:])
    off = [np.abs(np.asarray(s.reconstruct(reading).pressure) - truth).sum() for s in (plain, found)]
    assert off[1] < 0.7 * off[0]

    source, target = tmp_path / "skin.toml", tmp_path / "calibrated.toml"
    source.write_text(
        '[pad]\nkind = "bonded_layers"\n[[pad.layer]]\nthickness = "3 mm"\nyoungs_modulus = "100 kPa"\npoissons_ratio = 0.48\n'
        '[[plane]]\nkind = "area"\nshape = [5, 5]\npitch = "2 mm"\ndepth = "base"\nchannels = ["stress_zz"]\n',
        encoding="utf-8",
    )
    write_calibrated(target, source, found.calibration)
    read = pp.Skin.from_file(target)
    assert read.uncertainty == found.uncertainty
    same = read.reconstruct(reading).pressure
    np.testing.assert_allclose(np.asarray(same), np.asarray(found.reconstruct(reading).pressure))
    tracked = read.track(zero=np.zeros_like(reading)).step(reading)
    assert np.abs(np.asarray(tracked.pressure) - truth).sum() < 0.8 * off[0]


@pytest.mark.long
def test_the_pixel_scale_moves_the_places_of_the_readings_once(skin: pp.Skin) -> None:
    truth = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    scale = 1.1
    rng = np.random.default_rng(8)
    y, x = scale * array(MOVED).points.T
    force, radius = np.resize([1.0, 2.0, 4.0], 6), np.resize([4e-3, 6e-3, 9e-3], 6)
    made = []
    for f, r in zip(force, radius):
        ball = pp.solutions.hertz_point(
            force=f, contact_radius=pp.solutions.hertz_contact_radius(truth, radius=r, force=f)
        )
        at = rng.uniform(-3e-3, 3e-3, 2)
        made.append(ball.fields(truth, MOVED, x - at[0], y - at[1], 2e-3) / scale)
    clean = np.stack(made).reshape(6, 2, *SHAPE)
    noise = NOISE * float(np.abs(clean).max())
    presses = np.concatenate([np.zeros((10, *clean.shape[1:])), clean])
    presses = presses + noise * rng.standard_normal(presses.shape)
    known = {"fz": np.r_[np.zeros(10), force], "ball_radius": np.r_[np.full(10, np.nan), radius]}
    asked = ["youngs_modulus", "pixel_scale"]
    found = skin.calibrate(presses, reference=known, constants=asked)
    assert found.calibration is not None
    assert found.calibration.constants is not None
    np.testing.assert_allclose(found.planes[0].points, scale * skin.planes[0].points, rtol=0.03, atol=1e-12)
    again = found.calibrate(presses, reference=known, constants=asked, again=True)
    np.testing.assert_allclose(again.planes[0].points, scale * skin.planes[0].points, rtol=0.03, atol=1e-12)
    kept = found.calibrate(presses, reference=known, again=True)
    np.testing.assert_allclose(kept.planes[0].points, found.planes[0].points)


@pytest.mark.long
@pytest.mark.parametrize("dead", [np.nan, 1e9])
def test_a_masked_taxel_has_no_noise(dead: float) -> None:
    """The noise by which constants are fitted is that of the valid taxels."""
    mask = np.arange(25).reshape(5, 5) != 0
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    masked = pp.AreaArray(shape=(5, 5), pitch=2e-3, depth=2e-3, channels=["stress_zz"], mask=mask)
    whole = pp.Skin(pad, pp.AreaArray(shape=(5, 5), pitch=2e-3, depth=2e-3, channels=["stress_zz"]))
    force = np.r_[np.zeros(7), 1.0, 2.0, 3.0]
    clean = [np.asarray(whole.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=max(f, 1e-9)))) for f in force]
    rng = np.random.default_rng(0)
    readings = np.stack(clean) + 50.0 * rng.standard_normal((10, 1, 5, 5))
    readings[:, 0, 0, 0] = dead * rng.standard_normal(10)
    found = pp.Skin(pad, masked).calibrate(readings, reference=force, constants=["depth"]).calibration
    assert found is not None
    assert found.constants is not None
    assert found.constants.values[0] == pytest.approx(2e-3, rel=0.1)
    assert found.constants.std[0] < 0.1
