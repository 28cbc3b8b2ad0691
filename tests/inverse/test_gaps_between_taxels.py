"""Contacts of about a pitch on taxels much shallower than the pitch: what lies between the taxels is not measured."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp

PITCH = 1e-3


def _skin(depth: float, n: int = 12) -> pp.Skin:
    pad = pp.HalfSpace(youngs_modulus=1e6, poissons_ratio=0.48)
    return pp.Skin(pad, pp.AreaArray(shape=(n, n), pitch=PITCH, depth=depth * PITCH, channels=["stress_zz"]))


def _noisy(clean: np.ndarray, seed: int) -> np.ndarray:
    return clean + 0.01 * np.abs(clean).max() * np.random.default_rng(seed).standard_normal(clean.shape)


@pytest.mark.parametrize(("radius", "at"), [(0.7, (0.4, 0.1)), (1.0, (0.5, 0.5)), (0.66, (0.1, 0.3))])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_interval_holds_what_may_lie_between_shallow_taxels(
    radius: float, at: tuple[float, float], seed: int
) -> None:
    """The force was read 55 to 80 % too low, with intervals that ended at 0.4 to 0.8 of it."""
    skin = _skin(0.12)
    ball = pp.solutions.hertz_point(contact_radius=radius * PITCH, force=0.1)
    x, y = at
    touch = skin.reconstruct(_noisy(np.asarray(skin.sense(ball.shifted(x * PITCH, y * PITCH))), seed))
    low, high = touch.interval(0.95, of="force")
    assert low[2] < 0.1 < high[2]


def test_deep_taxels_hide_nothing_between_them() -> None:
    skin = _skin(1.0)
    touch = skin.reconstruct(
        _noisy(np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=PITCH, force=0.1))), 1)
    )
    assert touch._errors is not None
    assert not touch._errors.posterior.beyond_force.any()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_largest_readings_of_a_small_punch_are_not_broken_taxels(seed: int) -> None:
    """Two to five shallow taxels under a punch of one pitch were left out as dead, and 90 % of its force with them; or
    the punch was given to the linear method, 57 N wide.
    """
    pad = pp.HalfSpace(youngs_modulus=1e6, poissons_ratio=0.48)
    skin = pp.Skin(pad, pp.AreaArray(shape=(22, 24), pitch=4e-3, depth=1.88e-3, channels=["stress_zz"]))
    clean = np.asarray(skin.sense(pp.solutions.flat_punch(radius=3.94e-3, force=1.0).shifted(20.0e-3, 5.7e-3)))
    rng, noise = np.random.default_rng(seed), float(np.abs(clean).max()) / 37
    rest = noise * rng.standard_normal((50, *clean.shape))
    readings = clean + noise * rng.standard_normal(clean.shape)
    touch = skin.reconstruct(readings, zero=rest)
    low, high = touch.interval(0.95, of="force")
    assert low[2] < 1.0 < high[2]
    assert high[2] - low[2] < 2.0
    assert float(touch.force[2]) == pytest.approx(1.0, rel=0.2)
