"""A frame with an answer has an interval, also if neither noise nor zero is given."""

from __future__ import annotations

import math

import numpy as np
import pytest

import palpate as pp
from palpate.tracking.single import Answer, Comparison

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
THREE = ["stress_xz", "stress_yz", "stress_zz"]


def test_before_the_first_contact_noise_bounds_the_force() -> None:
    skin = pp.Skin(PAD, pp.AreaArray(shape=(5, 5), pitch=2e-3, depth=2e-3, channels=THREE))
    rng = np.random.default_rng(0)
    halves = []
    for noise in (10.0, 1000.0):
        tracker = skin.track()
        for _ in range(3):
            touch = tracker.step(noise * rng.standard_normal((3, 5, 5)))
        assert pp.Status.coded(int(touch.status)) is pp.Status.NO_CONTACT
        low, high = touch.interval(0.95, "force")
        assert (low < 0.0).all()
        halves.append(float(high[2]))
        frame = skin.reconstruct(noise * rng.standard_normal((3, 5, 5)))
        assert halves[-1] == pytest.approx(float(frame.interval(0.95, "force")[1][2]), rel=0.6)
    assert halves[1] == pytest.approx(100.0 * halves[0], rel=0.5)


def test_few_readings_of_unknown_noise_may_all_be_contact() -> None:
    """A block over all of 3 x 3 taxels looks like noise: the frame has bounds that contain it, and no number."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(3, 3), pitch=2e-3, depth=2e-3, channels=THREE))
    press = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=4e-3, force=0.02)))
    with skin.track() as tracker:
        for scale in (0.5, 1.0):
            touch = tracker.step(np.sign(np.random.default_rng(1).standard_normal(press.shape)) * scale * press)
    assert pp.Status.coded(int(touch.status)) is pp.Status.UNDECIDED
    assert np.isnan(touch.force).all()
    low, high = touch.interval(0.95, "force")
    assert low[2] < -0.02
    assert 0.02 < high[2] < 1.0


def test_an_undecided_single_solve_leaves_a_finite_interval() -> None:
    """Its force is NaN, and made the tracker's interval NaN; its bounds say what the interval must contain."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(3, 3), pitch=2e-3, depth=2e-3, channels=THREE))
    touch = skin.reconstruct(10.0 * np.random.default_rng(0).standard_normal((3, 3, 3)))
    assert pp.Status.coded(int(touch.status)) is pp.Status.UNDECIDED
    alone = Answer.of(touch)
    assert alone.explained
    assert not alone.decided
    np.testing.assert_allclose(alone.force, 0.0, atol=1e-12)
    tracked = Answer(0.9 * alone.high, 0.8 * alone.high, alone.high, True, float(alone.high.sum()))
    comparison = Comparison(27, rested=True)
    assert comparison.settle(tracked, alone)
    assert math.isfinite(comparison.share)
    assert comparison.share > 0.0
