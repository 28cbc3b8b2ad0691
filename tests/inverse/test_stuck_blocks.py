"""Neighbours that read exactly the same are broken, unless rounding, saturation, a threshold or symmetry makes readings equal."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.elastic.pad import Floats
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.screening import ceilings, stuck
from palpate.inverse.fit import neighbours

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
BALL = pp.solutions.hertz_point(contact_radius=3e-3, force=1.0)


def array(count: int) -> pp.AreaArray:
    return pp.AreaArray(shape=(count, count), pitch=1e-3, depth=1.5e-3, channels=["stress_zz"])


def flagged(frame: Floats) -> Floats:
    taxels, index, data = array(len(frame)), np.zeros(frame.size, dtype=np.intp), frame.ravel()
    pairs = neighbours([taxels])
    return stuck(data, index, pairs, ceilings(data, index, pairs, Policy()), Policy()).reshape(frame.shape)


def pressed(count: int, noise: float = 0.01, seed: int = 0) -> Floats:
    clean = np.asarray(pp.Skin(PAD, array(count)).sense(BALL))[0]
    return clean + noise * clean.max() * np.random.default_rng(seed).standard_normal(clean.shape)


def test_a_block_of_equal_readings_is_flagged_and_nothing_else() -> None:
    frame = pressed(16)
    frame[9:12, 2:5] = 0.13 * frame.max()
    found = flagged(frame)
    assert found[9:12, 2:5].all()
    assert found.sum() == 9


def test_rounding_of_a_zero_hides_no_block() -> None:
    frame, rng = pressed(16), np.random.default_rng(5)
    frame[9:12, 2:5] = 0.13 * frame.max()
    zero = 1e3 * rng.standard_normal(frame.shape)
    again = (frame - zero) + zero
    assert len(np.unique(again[9:12, 2:5])) > 1
    assert flagged(again)[9:12, 2:5].all()


@pytest.mark.parametrize("count", [4, 9, 16])
def test_equal_readings_of_sound_sensors_are_not_flagged(count: int) -> None:
    noisy = pressed(count)
    step = 0.02 * float(noisy.max())
    assert not flagged(noisy).any()
    assert not flagged(pressed(count, noise=0.0)).any()  # mirrored twins
    assert not flagged(step * np.round(noisy / step)).any()
    assert not flagged(np.where(noisy < 0.1 * noisy.max(), 0.0, noisy)).any()
    assert not flagged(np.where(noisy < 0.1 * noisy.max(), 0.02 * noisy.max(), noisy)).any()
    assert not flagged(np.clip(noisy, None, 0.6 * noisy.max())).any()


@pytest.mark.long
@pytest.mark.parametrize("zeroed", [False, True])
def test_the_force_beside_a_stuck_block(zeroed: bool) -> None:
    """Read as a second contact of a tenth of the force, without a note."""
    skin, rng = pp.Skin(PAD, array(16)), np.random.default_rng(3)
    frame = pressed(16)[None]
    rest = 2e3 + 0.01 * frame.max() * rng.standard_normal((20, *frame.shape))
    readings = frame + 2e3 if zeroed else frame
    readings[0, 11:15, 1:5] = 0.2 * frame.max()
    touch = skin.reconstruct(readings, zero=rest) if zeroed else skin.reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    assert low[2] <= 1.0 <= high[2]
    assert touch.force[2] == pytest.approx(1.0, abs=0.05)
    assert any("left out" in note for note in touch.notes)
