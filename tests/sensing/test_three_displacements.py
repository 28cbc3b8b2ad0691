"""All three displacements of shallow markers in a bonded gel: traction of its own for every reading, so that no linear model tells noise."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.sensing.uncertainty import EXACT

GEL = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=200e3, poissons_ratio=0.48)])
CHANNELS = ["displacement_x", "displacement_y", "displacement_z"]
BALL = pp.solutions.hertz_point(contact_radius=2.5e-3, force=2.0).shifted(0.3e-3, -0.2e-3)


def readings_of(contact: pp.solutions.AreaContact, depth: float) -> tuple[pp.Skin, np.ndarray, float]:
    """A skin that does not know its noise, readings made on finer cells with 1 % noise, and that noise."""
    array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=depth, channels=CHANNELS)
    clean = pp.Skin(GEL, array, surface=pp.AreaGrid(shape=(32, 32), spacing=0.5e-3)).sense(contact)
    noise = 0.01 * float(np.abs(clean).max())
    return pp.Skin(GEL, array), clean + noise * np.random.default_rng(1).standard_normal(clean.shape), noise


@pytest.mark.parametrize("depth", [0.0, pytest.param(0.5e-3, marks=pytest.mark.long)])
@pytest.mark.parametrize("friction", [None, *long_runs(0.4)])
def test_a_ball_that_slides_is_told_from_noise(depth: float, friction: float | None) -> None:
    """Evidence found no noise at all, took noise for traction, and read up to five times the load; the interval held nothing."""
    skin, readings, noise = readings_of(BALL.sliding(0.4, direction=0.5), depth)
    touch = skin.reconstruct(readings, **({} if friction is None else {"friction": friction}))
    truth = np.array([0.8 * np.cos(0.5), 0.8 * np.sin(0.5), 2.0])
    np.testing.assert_allclose(touch.force, truth, atol=0.3)
    low, high = touch.interval(0.95, of="force")
    assert low[2] < 2.0 < high[2]
    assert 0.5 * noise < float(np.median(touch.noise_std)) < 2.0 * noise


@pytest.mark.long
def test_contact_over_four_markers_is_not_taken_for_broken_markers() -> None:
    """Markers at the surface tell nothing of their neighbours: the whole contact was left out, marker by marker, as readings that are wrong."""
    skin, readings, _ = readings_of(BALL, 0.0)
    touch = skin.reconstruct(readings, friction=0.4)
    low, high = touch.interval(0.95, of="force")
    assert low[2] < 2.0 < high[2]
    assert not any("left out" in note for note in touch.notes)
    assert not any("shift" in note for note in touch.notes)


@pytest.mark.long
def test_pressure_that_nothing_feels_is_not_added_for_noise_in_shear() -> None:
    """Friction that is known let wide even pressure in, 44 % of the force, under which noise in shear is allowed."""
    force, radius, friction = 2.4, 2.5e-3, 0.4
    grid = pp.AreaGrid(shape=(64, 64), spacing=0.25e-3)
    y, x = grid.axes[0][:, None] + 0.2e-3, grid.axes[1][None, :] - 0.3e-3
    r = np.hypot(y, x)
    pressure = 1.5 * force / (np.pi * radius**2) * np.sqrt(np.clip(1.0 - (r / radius) ** 2, 0.0, None))
    # a twist: shear about the middle, up to what friction allows at the edge
    size = friction * pressure * (r / radius) ** 2 / np.maximum(r, 1e-12)
    twisted = np.stack([-y * size, x * size, pressure])
    array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=0.0, channels=CHANNELS)
    clean = np.asarray(pp.Skin(GEL, array, surface=grid).sense(twisted))
    noise = 0.01 * float(np.abs(clean).max()) * np.random.default_rng(3).standard_normal(clean.shape)
    touch = pp.Skin(GEL, array, uncertainty=EXACT).reconstruct(clean + noise, friction=friction)
    assert float(touch.force[2]) == pytest.approx(force, rel=0.1)
    low, high = touch.interval(0.95, of="force")
    assert low[2] < force < high[2]
    assert high[2] - low[2] < 1.0
