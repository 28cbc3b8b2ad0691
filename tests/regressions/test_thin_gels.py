"""Presses on markers of three displacements in a thin gel, with a small given noise."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.contact.trace import traced

CHANNELS = ["displacement_x", "displacement_y", "displacement_z"]


def pressed(seed: int) -> tuple[pp.Touch, list[str]]:
    """A ball on 8 x 8 markers half way down a gel of one pitch; the noise is 0.3 % of the largest reading."""
    pad = pp.BondedLayers([pp.Layer(thickness=1.08e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    skin = pp.Skin(pad, pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=0.54e-3, channels=CHANNELS))
    ball = pp.solutions.hertz_point(contact_radius=2.77e-3, force=0.3).shifted(0.3e-3, -0.2e-3)
    clean = np.asarray(skin.sense(ball))
    noise = 0.003 * float(np.abs(clean).max())
    with traced() as trace:
        touch = skin.reconstruct(clean + noise * np.random.default_rng(seed).standard_normal(clean.shape), noise=noise)
    return touch, trace.lines


@pytest.mark.long
@pytest.mark.parametrize("seed", range(3))
def test_a_push_that_follows_small_noise_is_not_a_pull_that_cannot(seed: int) -> None:
    """The push takes most degrees of freedom to follow every reading, the pull all round it leaves more: it read -0.93 N."""
    touch, lines = pressed(seed)
    low, high = touch.interval(0.95, "force")
    assert float(touch.force[2]) == pytest.approx(0.3, rel=0.05)
    assert low[2] < 0.3 < high[2]
    assert any(line.startswith("best of these: push (") for line in lines)
