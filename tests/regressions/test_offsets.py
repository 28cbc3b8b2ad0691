"""Offsets of a channel that were taken for contact, with nothing known of the noise."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.bench.trust.rows import make_frame

SKIN = pp.Skin(
    pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
    pp.AreaArray(shape=(8, 8), pitch=1.5e-3, depth=2e-3, channels=["stress_zz"], aperture=1e-3),
)


def test_an_offset_at_rest_is_no_contact() -> None:
    """An offset of five deviations of noise and nothing else: 11 of 12 frames read 0.6 N, in intervals from 0.1 N on."""
    noise = 400.0 * np.random.default_rng(0).standard_normal((4, 1, 8, 8))
    touch = SKIN.reconstruct(noise + 2000.0)
    low, high = touch.interval(0.95, "force")
    assert (np.asarray(touch.status) == pp.Status.UNDECIDED).all()
    # one reading of one plane does not tell an offset from an even press that is wider than the array
    assert (np.asarray(low)[:, 2] <= 0.0).all()
    assert np.isinf(np.asarray(high)[:, 2]).all()


def test_an_offset_is_no_pull_about_two_balls() -> None:
    """Two balls of 0.81 N above an offset: 1.85 N (1.44 to 2.25) of traction of either sign, which follows any readings, at a fit of 1."""
    rng = np.random.default_rng([3, 10])
    radii, forces, places = rng.uniform(1.2e-3, 3e-3, 2), rng.uniform(0.2, 0.6, 2), rng.uniform(-2.5e-3, 2.5e-3, (2, 2))
    balls = [
        pp.solutions.hertz_point(contact_radius=r, force=f).shifted(*place)
        for r, f, place in zip(radii, forces, places)
    ]
    clean = np.asarray(SKIN.sense(balls[0])) + np.asarray(SKIN.sense(balls[1]))
    offset = rng.choice([-1, 1]) * rng.choice([0.1, 0.2, 0.3])
    readings = clean + clean.max() * (offset + 0.02 * rng.standard_normal(clean.shape))
    touch = SKIN.reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    assert float(touch.force[2]) == pytest.approx(forces.sum(), rel=0.1)
    assert low[2] < forces.sum() < high[2]
    assert touch.pushing
    assert any("offset of stress_zz" in note for note in touch.notes)


@pytest.mark.long
def test_an_offset_does_not_outgrow_the_readings() -> None:
    """A punch of 0.70 N with drift in every reading: a pull of 16.7 N (6.3 to 23.4) over an offset of 20 kPa, where the largest reading is 13 kPa."""
    shear_x = [[213, -406, -1052, 2895], [299, -1329, -2816, 4961], [179, 7, -230, 2398], [212, 369, 908, 608]]
    shear_y = [[536, 181, -3185, -2369], [866, 723, 1904, 1973], [718, 1784, 3804, 3084], [941, 1256, 1489, 1325]]
    normal = [[633, 1052, 6038, 4484], [644, 1518, 13031, 10214], [915, 1159, 3244, 2883], [773, 682, 782, 424]]
    pad = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    array = pp.AreaArray(shape=(4, 4), pitch=4e-3, depth="base", aperture=3e-3, channels=channels, noise=305.0)
    touch = pp.Skin(pad, array).reconstruct(np.array([shear_x, shear_y, normal], dtype=float))
    low, high = touch.interval(0.95, "force")
    assert low[2] < 0.696 < high[2]
    assert float(touch.force[2]) == pytest.approx(0.696, abs=0.15)
    assert touch.fit < 0.01  # drift that differs from taxel to taxel is no offset


@pytest.mark.long
def test_offsets_beside_a_small_ball_on_many_taxels_are_found() -> None:
    """Offsets of 3, -5 and 10 % of the largest reading beside a small ball on 16 x 16 taxels: 0.48 N for 0.145 N, where their first size was no step."""
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    array = pp.AreaArray(shape=(16, 16), pitch=1e-3, depth=2e-3, channels=channels)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    y, x = np.meshgrid(*skin.surface.axes, indexing="ij")
    squared = ((x - 0.48e-3) ** 2 + (y + 0.48e-3) ** 2) / 1.92e-3**2
    pressure = 2e4 * np.sqrt(np.maximum(1.0 - squared, 0.0))
    traction = np.stack([0.3 * pressure, -0.1 * pressure, pressure])
    force = traction.sum((1, 2)) * float(np.prod(skin.surface.spacing))
    clean = np.asarray(skin.sense(traction))
    largest = np.abs(clean).max()
    offsets = 0.1 * largest * np.array([0.3, -0.5, 1.0]).reshape(3, 1, 1)
    touch = skin.reconstruct(clean + offsets + 0.01 * largest * np.random.default_rng(16).standard_normal(clean.shape))
    low, high = touch.interval(0.95, "force")
    assert (low < force).all()
    assert (force < high).all()
    assert touch.force[2] == pytest.approx(force[2], rel=0.1)


@pytest.mark.long
def test_a_wide_press_that_noise_explains_is_no_shift() -> None:
    """A ball that loads the edge of 6 x 6 heights with known noise: 0.79 N for 1 N at a fit of 4e-72, about a shift that leaves nine times the noise."""
    how = {"shape": (6, 6), "pitch": 2e-3, "depth": 1e-3, "channels": ["displacement_z"]}
    pad = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    fine = pp.Skin(pad, pp.AreaArray(**how), surface=pp.AreaGrid(shape=(48, 48), spacing=0.5e-3))
    clean = np.asarray(fine.sense(pp.solutions.hertz_point(contact_radius=6e-3, force=1.0)))
    noise = 0.01 * float(np.abs(clean).max())
    skin = pp.Skin(pad, pp.AreaArray(**how, noise=noise))
    touch = skin.reconstruct(clean + noise * np.random.default_rng(0).standard_normal(clean.shape))
    low, high = touch.interval(0.95, "force")
    assert low[2] < 1.0 < high[2]
    assert touch.force[2] == pytest.approx(1.0, rel=0.1)
    assert touch.fit > 0.1
    assert any("shift along z cannot be separated from contact" in note for note in touch.notes)


def test_an_offset_of_one_row_is_no_contact() -> None:
    """A ball of 1 N beside -30 % of the peak on the last row: 0.28 to 1.54 N at a fit of 0.005, where rows had no offset of their own."""
    rng = np.random.default_rng(5)
    radius, place = rng.uniform(1.5e-3, 3e-3), rng.uniform(-2.5e-3, 2.5e-3, 2)
    clean = np.asarray(SKIN.sense(pp.solutions.hertz_point(contact_radius=radius, force=1.0).shifted(*place)))
    readings = clean + 0.01 * clean.max() * rng.standard_normal(clean.shape)
    readings[..., 7, :] -= 0.3 * clean.max()
    touch = SKIN.reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    assert 0.85 < low[2] < 1.0 < high[2] < 1.15
    assert touch.fit > 0.05
    assert any("offset of stress_zz in row 7" in note for note in touch.notes)


@pytest.mark.long
def test_an_offset_of_one_column_in_all_channels_is_no_contact() -> None:
    """A ball of 1 N beside 30 % of the peak on one column of all channels: 5.72 N (1.79 to 7.92) at a fit of 1, where rows had no offset of their own."""
    array = pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    rng = np.random.default_rng(2)
    radius, place = rng.uniform(1.5e-3, 3e-3), rng.uniform(-3e-3, 3e-3, 2)
    clean = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=radius, force=1.0).shifted(*place)))
    readings = clean + 0.01 * clean.max() * rng.standard_normal(clean.shape)
    readings[:, :, 0] += 0.3 * clean.max()
    touch = skin.reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    assert (low < [0.0, 0.0, 1.0]).all()
    assert (high > [0.0, 0.0, 1.0]).all()
    assert touch.force[2] == pytest.approx(1.0, rel=0.1)
    for channel in array.channels:
        assert any(f"offset of {channel} in column 0" in note for note in touch.notes)


@pytest.mark.long
def test_noise_given_half_too_small_leaves_room_for_an_offset() -> None:
    """A ball of 1 N above an offset of 30 % on 6 x 6 taxels, with half of the true noise given: 5.2 N (0 to 10.7) of an even press at a fit of 0.5."""
    pad = pp.BondedLayers([pp.Layer(thickness=3e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    how = {"shape": (6, 6), "pitch": 3e-3, "depth": "base", "channels": ["stress_zz"], "aperture": 2e-3}
    rng = np.random.default_rng(0)
    ball = pp.solutions.hertz_point(contact_radius=rng.uniform(1.5e-3, 4e-3), force=1.0)
    clean = np.asarray(pp.Skin(pad, pp.AreaArray(**how)).sense(ball.shifted(*rng.uniform(-4e-3, 4e-3, 2))))
    noise = 0.01 * float(clean.max())
    readings = clean + noise * rng.standard_normal(clean.shape) + 0.3 * clean.max()
    touch = pp.Skin(pad, pp.AreaArray(**how, noise=noise / 2)).reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    assert 0.75 < low[2] < 1.0 < high[2] < 1.2
    assert float(touch.force[2]) == pytest.approx(1.0, abs=0.05)
    assert any("offset of stress_zz" in note for note in touch.notes)


@pytest.mark.parametrize("seed", [106, pytest.param(110, marks=pytest.mark.long)])
def test_noise_given_half_too_small_is_learned_beside_an_offset(seed: int) -> None:
    """Balls above an offset on 8 x 8 taxels: 1.21 (1.00 to 1.38) and 1.12 (1.02 to 1.19) of the force at a fit of 0.005 and 0.14."""
    rng = np.random.default_rng([seed, 8, 0, 0])
    pad = pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.48)
    pitch = 2e-3
    how = {"shape": (8, 8), "pitch": pitch, "depth": rng.uniform(0.6, 1.5) * pitch, "channels": ["stress_zz"]}
    force = rng.uniform(0.5, 4.0)
    ball = pp.solutions.hertz_point(contact_radius=rng.uniform(1.0, 2.5) * pitch, force=force)
    ball = ball.shifted(*rng.uniform(-1.6 * pitch, 1.6 * pitch, 2))
    clean = np.asarray(pp.Skin(pad, pp.AreaArray(**how)).sense(ball))
    noise = 10 ** rng.uniform(-2.3, -1.3) * float(np.abs(clean).max())
    readings = clean + noise * rng.standard_normal(clean.shape)
    readings = readings + rng.uniform(-0.3, 0.3, (1, 1, 1)) * np.abs(clean).max()
    touch = pp.Skin(pad, pp.AreaArray(**how, noise=0.5 * noise)).reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    assert low[2] < force < high[2]
    assert touch.force[2] == pytest.approx(force, rel=0.1)


def test_an_offset_of_a_quarter_is_no_contact() -> None:
    """A ball of 1 N, and a quarter of 8 x 8 taxels that reads 30 % too much: at least 1.36 N before, as a second contact."""
    pad = pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.48)
    skin = pp.Skin(pad, pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"]))
    clean = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=1.0).shifted(-1e-3, 2e-3)))
    readings = clean + 0.01 * clean.max() * np.random.default_rng(0).standard_normal(clean.shape)
    readings[0, :4, 4:] += 0.3 * clean.max()
    touch = skin.reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    assert low[2] < 1.0 < high[2]
    assert touch.force[2] == pytest.approx(1.0, rel=0.1)
    assert any("offset of stress_zz in the lower right quarter" in note for note in touch.notes)


@pytest.mark.parametrize("radius", [0.8, 1.0, 1.2])
def test_an_offset_that_few_readings_hide_is_in_the_interval(radius: float) -> None:
    """A ball of 0.3 N on 4 x 4 taxels with an offset of 15 %: 0.48 N (0.43 to 0.51), without a note, because contact fits all 16 readings."""
    pad, pitch = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.45), 4e-3
    array = pp.AreaArray(shape=(4, 4), pitch=pitch, depth=0.68 * pitch, channels=["stress_zz"])
    clean = np.asarray(pp.Skin(pad, array).sense(pp.solutions.hertz_point(contact_radius=radius * pitch, force=0.3)))
    noise = 0.0015 * float(clean.max())
    skin = pp.Skin(
        pad, pp.AreaArray(shape=(4, 4), pitch=pitch, depth=0.68 * pitch, channels=["stress_zz"], noise=noise)
    )
    clean = clean + noise * np.random.default_rng(1).standard_normal(clean.shape)
    touch = skin.reconstruct(clean + 0.15 * clean.max())
    low, high = (np.asarray(end)[2] for end in touch.interval(0.95, "force"))
    assert low < 0.3 < high
    assert any("contact may hide an offset" in note for note in touch.notes)
    # the lowest reading of a clean frame leaves no room for an offset
    touch = skin.reconstruct(clean)
    low, high = (np.asarray(end)[2] for end in touch.interval(0.95, "force"))
    assert low < 0.3 < high
    assert high - low < 0.15
    assert not touch.notes


@pytest.mark.long
def test_a_rival_is_solved_without_the_readings_that_are_left_out() -> None:
    """It got broken readings back as they were: -0.056 of 0.010 N here, and 3 minutes for one railed reading of 48 x 48 x 3."""
    frame = make_frame("offset", 12, seed=20301310)
    touch = frame.skin.reconstruct(frame.readings, friction=frame.friction)
    low, high = touch.interval(0.95, "force")
    assert touch.force[2] == pytest.approx(frame.load.force[2], rel=0.05)
    assert ((low < frame.load.force) & (frame.load.force < high)).all()
