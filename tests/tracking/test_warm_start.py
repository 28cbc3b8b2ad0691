"""What the last single solve found is carried along: nearer to the force that acts, gone with the contact, and no part of a pull."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.inverse import Cone
from palpate.sensing.uncertainty import EXACT
from palpate.tracking.anchor import Anchor

CONE = Cone(("x", "y", "z"), 0.5)


@pytest.fixture(scope="module")
def stream() -> tuple[Any, list[tuple[float, float]]]:
    """Forces that a tracker answers, and that of one even penalty alone, of a ball that presses with 1 N."""
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    skin = pp.Skin(pad, array, uncertainty=EXACT)
    traction = np.asarray(skin.sample(solutions.hertz_point(contact_radius=2e-3, force=1.0)))
    traction /= traction[-1].sum() * skin.surface.cell
    ball = np.asarray(skin.sense(traction))
    rng, found = np.random.default_rng(7), []
    with skin.track(baseline=10) as tracker:
        for load in np.r_[np.zeros(12), np.ones(30), -np.ones(20)]:
            touch = tracker.step(load * ball + 0.01 * np.abs(ball).max() * rng.standard_normal(ball.shape))
            found.append(
                (float(touch.force[2]), float(tracker._contact.traction[-1].sum()) * skin.surface.cell if load else 0.0)
            )
    return skin, found


@pytest.mark.long
def test_the_answer_is_nearer_to_the_force_than_one_even_penalty_alone(stream: Any) -> None:
    answered, own = np.array(stream[1][14:42]).T
    assert np.median(np.abs(answered - 1.0)) < 0.9 * np.median(np.abs(own - 1.0))


def test_a_pull_after_a_press_is_a_pull(stream: Any) -> None:
    assert np.median([f for f, _ in stream[1][-10:]]) == pytest.approx(-1.0, abs=0.2)


def test_what_is_answered_stays_within_friction_and_never_pulls() -> None:
    rng = np.random.default_rng(0)
    own, single = (CONE.nearest(rng.standard_normal((3, 20))) for _ in range(2))
    anchor = Anchor(CONE, (0, 1, 2))
    anchor.take(own, single)
    for _ in range(5):
        out = anchor.carried(CONE.nearest(own + 0.5 * rng.standard_normal(own.shape)))
        assert (out[-1] >= 0.0).all()
        assert (np.hypot(out[0], out[1]) <= 0.5 * out[-1] + 1e-12).all()


def test_the_frame_of_the_single_solve_is_answered_as_it_says() -> None:
    rng = np.random.default_rng(1)
    own, single = (CONE.nearest(rng.standard_normal((3, 20))) for _ in range(2))
    anchor = Anchor(CONE, (0, 1, 2))
    anchor.take(own, single)
    np.testing.assert_allclose(anchor.carried(own), single, atol=1e-12)
    anchor.clear()
    assert anchor.carried(own) is own
