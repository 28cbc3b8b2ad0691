"""Markers on the surface of a nearly incompressible gel: pressure hardly moves them, and the error bars of its map know it."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.posterior import ambiguity_of
from palpate.inverse.observability import ACTS, pressing

GEL = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=2e5, poissons_ratio=0.48)])


def markers(depth: float) -> pp.AreaArray:
    return pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=depth, channels=["displacement_x", "displacement_y"])


@pytest.mark.long
@pytest.mark.parametrize("kind", ["frictionless", "twisted"])
def test_the_peak_under_a_ball_is_within_its_interval(kind: str) -> None:
    skin = pp.Skin(GEL, markers(0.0))
    ball = pp.solutions.hertz_point(contact_radius=3e-3, force=2.0)
    traction = np.asarray(skin.sample(ball))
    if kind == "twisted":
        y, x = np.meshgrid(skin.surface.y, skin.surface.x, indexing="ij")
        traction[0], traction[1] = -0.3 * traction[2] * y / 3e-3, 0.3 * traction[2] * x / 3e-3
    clean = np.asarray(skin.sense(traction))
    noisy = clean + 0.01 * np.abs(clean).max() * np.random.default_rng(3).standard_normal(clean.shape)
    touch = skin.reconstruct(noisy)
    low, high = touch.interval(0.95, "peak_pressure")
    peak = float(traction[2].max())
    assert float(touch.peak_pressure) < 0.6 * peak  # the map is too flat
    assert low < peak < high
    low, high = touch.interval(0.95, "traction")
    here = traction[2] > 0.2 * peak
    assert (
        float(np.mean((np.asarray(low)[2][here] < traction[2][here]) & (traction[2][here] < np.asarray(high)[2][here])))
        > 0.9
    )
    low, high = touch.interval(0.95, "force")
    assert low[2] < 2.0 < high[2]


def test_the_map_is_the_less_known_the_nearer_the_markers_are_to_the_surface() -> None:
    found = []
    for depth in (0.0, 1e-4, 2.5e-4, 1e-3):
        acting = pressing(GEL, [markers(depth)], ["x", "y"])
        free, coupled = (ambiguity_of(acting, ACTS, Policy(), coupled=c) for c in (False, True))
        assert coupled[3] == pytest.approx(0.5 * free[3])
        found.append(free[3])
    assert found == sorted(found, reverse=True)
    assert found[0] > 0.5
    assert found[-1] == 0.0
