"""Frames with many saturated readings: which of two results counts, with their values taken as true or without them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import palpate as pp
from palpate.sensing.uncertainty import EXACT

THREE = ["stress_xz", "stress_yz", "stress_zz"]
LAYER = pp.BondedLayers([pp.Layer(thickness=2.4e-3, youngs_modulus=7e5, poissons_ratio=0.5)])


def clipped(
    shape: int, part: float, ball: pp.solutions.AreaContact, pitch: float = 2e-3, noise: float = 0.01, seed: int = 0
) -> tuple[pp.Skin, np.ndarray]:
    """A skin whose range ends at a part of the largest reading, and 20 frames of rest and one of a ball of 1 N."""
    array = pp.AreaArray(shape=(shape, shape), pitch=pitch, depth="base", channels=THREE)
    clean = np.asarray(pp.Skin(LAYER, array).sense(ball))
    level, noise = part * float(np.abs(clean).max()), noise * float(np.abs(clean).max())
    skin = pp.Skin(LAYER, replace(array, limits=level, noise=noise), uncertainty=EXACT)
    frames = noise * np.random.default_rng(seed).standard_normal((21, *clean.shape))
    frames[-1] += clean
    return skin, np.clip(frames, -level, level)


@pytest.mark.parametrize("part", [0.3, 0.5])
def test_equal_readings_of_few_taxels_are_no_wide_contact(part: float) -> None:
    """Taken as true, three to eight saturated readings of 27 look like a wide contact of 6 N on a layer."""
    ball = pp.solutions.hertz_point(contact_radius=2.1e-3, force=1.0).shifted(0.6e-3, 0.3e-3)
    skin, frames = clipped(3, part, ball)
    touch = skin.reconstruct(frames[-1], zero=frames[:-1])
    assert touch.status == pp.Status.OVERLOAD
    assert float(touch.force[2]) < 2.6
    assert float(touch.interval(0.95, "force")[0][2]) < 1.0


def test_readings_without_the_saturated_ones_must_prove_a_contact() -> None:
    """Without two saturated readings, a wide contact of 12 N explains the other 25 of a small one."""
    ball = pp.solutions.hertz_point(contact_radius=0.6e-3, force=1.0).shifted(0.8e-3, 0.6e-3)
    for seed in (4, 5, 6):
        skin, frames = clipped(3, 0.7, ball, 1.9e-3, 0.014, seed)
        touch = skin.reconstruct(frames[-1], zero=frames[:-1])
        assert float(touch.force[2]) < 2.0
