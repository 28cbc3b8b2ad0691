"""Contacts too large to try pull around them, and faint contacts beside strong ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.bench.layouts import LAYOUTS

MARKERS = ["displacement_x", "displacement_y", "displacement_z"]


@pytest.mark.parametrize("seed", [37, 1, 2])
def test_a_push_that_fits_is_not_left_to_the_linear_method(seed: int) -> None:
    """The linear model scored higher, and the net force was known to 1.4 loads."""
    array = pp.AreaArray(shape=(10, 12), pitch=1e-3, depth=0.844e-3, channels=MARKERS)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array)
    ball = pp.solutions.hertz_point(contact_radius=3.67e-3, force=0.117).shifted(-1.93e-3, -0.48e-3)
    clean = np.asarray(skin.sense(ball))
    touch = skin.reconstruct(clean + 1.26e-5 * np.random.default_rng(seed).standard_normal(clean.shape))
    low, high = touch.interval(0.95, "force")
    assert touch.method == "adaptive"
    assert low[2] < 0.117 < high[2]
    assert high[2] - low[2] < 0.117


def test_noise_leaves_as_much_as_the_degrees_of_freedom_of_the_residual() -> None:
    """n - tr(2H - H^2) is the mean sum of squares that a linear model leaves of noise; n - tr(H) is a quarter more."""
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=1.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    prepared: Any = pp.Constrained(parameter=0.1).prepare(skin.problem(components=["z"]))
    start, rng, left = prepared.start, np.random.default_rng(0), []
    for _ in range(300):
        noise = rng.standard_normal(64)
        found = start.evidence(start.orders[1], prepared.readings.planes(noise), 1.0)
        left.append(float(((noise - prepared.explained_by(found.traction.reshape(1, -1))) ** 2).sum()))
    expected = 64 - start.residual_lacks(found.parameter)
    assert np.mean(left) == pytest.approx(expected, rel=0.05)
    assert 64 - start.freedom(found.parameter) > 1.2 * expected


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize(("depth", "noise"), [(0.6e-3, 300.0), (0.9e-3, 300.0)])
def test_a_clean_ball_on_a_wide_surface_is_a_push(depth: float, noise: float, seed: int) -> None:
    """The residual of the linear model has fewer degrees of freedom than n - tr(H): the net force was known to 4 loads."""
    array = pp.AreaArray(
        shape=(20, 20), pitch=1e-3, depth=depth, channels=["stress_xz", "stress_yz", "stress_zz"], noise=noise
    )
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    ball = pp.solutions.hertz_point(contact_radius=4.1e-3, force=0.6).shifted(1.3e-3, -2.1e-3)
    touch = skin.reconstruct(skin.sense(ball, rng=np.random.default_rng(seed)))
    low, high = touch.interval(0.95, "force")
    assert touch.method == "adaptive"
    assert touch.force[2] == pytest.approx(0.6, rel=0.05)
    assert low[2] < 0.6 < high[2]
    assert high[2] - low[2] < 0.2


def test_pull_as_large_as_the_array_is_left_to_the_linear_method() -> None:
    array = pp.AreaArray(shape=(15, 15), pitch=1e-3, depth=0.9e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    ball = pp.solutions.hertz_point
    clean = np.asarray(skin.sense(ball(contact_radius=3e-3, force=0.5).shifted(-3e-3, 1e-3)))
    clean -= np.asarray(skin.sense(ball(contact_radius=2.5e-3, force=0.25).shifted(4e-3, -2e-3)))
    level = 0.05 * float(np.abs(clean).max())
    touch = skin.reconstruct(clean + level * np.random.default_rng(1).standard_normal(clean.shape))
    low, high = touch.interval(0.95, "force")
    assert low[2] < 0.25 < high[2]
    assert any("push" in note or "pull" in note for note in touch.notes)


def test_a_faint_contact_beside_a_strong_one_is_kept() -> None:
    """Its pressure is below `Extent.faint` of the peak, but its readings are more than noise."""
    array = pp.AreaArray(shape=(20, 20), pitch=1e-3, depth=0.0, channels=MARKERS, noise=1e-6)
    layer = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    skin = pp.Skin(layer, array)
    ball = pp.solutions.hertz_point(contact_radius=2e-3, force=0.5)
    second = pp.solutions.hertz_point(contact_radius=1e-3, force=0.004).shifted(4e-3, 4e-3)  # 3 % of the pressure
    readings = np.asarray(skin.sense(ball)) + np.asarray(skin.sense(second))
    readings = readings + 1e-6 * np.random.default_rng(0).standard_normal(readings.shape)
    touch = skin.reconstruct(readings)
    far = (skin.surface.y[:, None] > 2.9e-3) & (skin.surface.x[None, :] > 2.9e-3)
    pressure, area = np.asarray(touch.pressure), float(np.prod(skin.surface.spacings))
    assert float(pressure[far].sum() * area) == pytest.approx(0.004, rel=0.3)


@pytest.mark.parametrize("seed", [2, 6])
def test_a_flat_punch_on_a_large_array_fits(seed: int) -> None:
    """Cells beyond the contact take up what cells cannot follow at its edge: without them pull around it answered."""
    layout = LAYOUTS["area"]
    readings, truth = layout.make(layout.contacts["punch"])
    noise = 0.01 * np.abs(readings).max() * np.random.default_rng(seed).standard_normal(readings.shape)
    touch = layout.skin.reconstruct(readings + noise, components=["z"])
    pressure = np.asarray(touch.pressure)
    assert touch.fit > 0.2
    assert pressure.min() >= 0.0
    assert np.linalg.norm(pressure - truth[-1]) < 0.2 * np.linalg.norm(truth[-1])
