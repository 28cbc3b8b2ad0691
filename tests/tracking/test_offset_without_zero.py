"""Streams whose readings have an offset that nobody subtracted: no zero is given, and no frame is at rest."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.status import Status

THREE = ["stress_xz", "stress_yz", "stress_zz"]
MOVED = ["displacement_x", "displacement_y", "displacement_z"]
LAYER = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])


HALF = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)


@pytest.mark.parametrize(
    ("side", "channels", "depth", "pad", "noise"),
    [
        (8, THREE, 1e-3, LAYER, 100.0),
        pytest.param(8, MOVED, 0.0, HALF, None, marks=pytest.mark.long),
        pytest.param(16, THREE, 1e-3, LAYER, None, marks=pytest.mark.long),
    ],
)
def test_an_offset_passes_for_no_force(
    side: int, channels: list[str], depth: float, pad: pp.Pad, noise: float | None
) -> None:
    # 1 N on an offset of 20 % of the largest reading: a wide contact explains this offset too, until the press is strong
    array = pp.AreaArray(shape=(side, side), pitch=1e-3, depth=depth, channels=channels, noise=noise)
    skin = pp.Skin(pad, array)
    press = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)))
    largest, rng = float(np.abs(press).max()), np.random.default_rng(5)
    tracker = skin.track()
    for k in range(50):
        part = min(max(k - 12, 0) / 20, 1.0)
        added = 1e-3 * largest * rng.standard_normal(press.shape)
        touch = tracker.step(part * press + added + 0.2 * largest, 0.02 * k)
        if k >= 40:
            low, high = touch.interval(0.95, "force")
            assert low[-1] <= 1.0 <= high[-1]
    if noise is not None:
        assert touch.force == pytest.approx([0.0, 0.0, 1.0], abs=0.05)
        assert (high - low < 0.5).all()


def test_a_stream_that_was_at_rest_takes_no_press_for_an_offset() -> None:
    # all taxels pressed evenly by a wide punch, after frames at rest
    skin = pp.Skin(LAYER, pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    press = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=9e-3, force=5.0)))
    rng, tracker = np.random.default_rng(1), skin.track()
    for k in range(30):
        noise = 1e-3 * press.max() * rng.standard_normal(press.shape)
        touch = tracker.step((press if k > 9 else 0.0) + noise, 0.02 * k)
    assert touch.status != Status.NO_CONTACT
    assert not any("drifted" in note for note in touch.notes)
