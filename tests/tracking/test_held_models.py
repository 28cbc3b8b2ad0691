"""Frames of a stream are answered with the models of the last single solve of the same contact, while these explain them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.inverse.contact.again import Again, keeping
from palpate.sensing.uncertainty import EXACT
from palpate.tracking.held import own_force

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
THREE = ["stress_xz", "stress_yz", "stress_zz"]


def scene(n: int, depth: float, radius: float, x: float = 0.0) -> tuple[pp.Skin, Any, float]:
    """A skin of n x n taxels 1 mm apart, its readings under a ball of 1 N at ``x``, and 1 % of the largest."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(n, n), pitch=1e-3, depth=depth, channels=THREE), uncertainty=EXACT)
    traction = np.asarray(skin.sample(solutions.hertz_point(contact_radius=radius, force=1.0).shifted(x, 0.0)))
    ball = np.asarray(skin.sense(traction / (traction[-1].sum() * skin.surface.cell)))
    return skin, ball, 0.01 * float(np.abs(ball).max())


def stream(skin: pp.Skin, frames: list[Any], noise: float) -> list[tuple[pp.Touch, float]]:
    """Touches of these frames after twelve of rest, and the force by the tracker's own model."""
    rng, found = np.random.default_rng(7), []
    with skin.track(baseline=10) as tracker:
        for frame in [np.zeros_like(frames[0])] * 12 + frames:
            touch = tracker.step(frame + noise * rng.standard_normal(frame.shape))
            found.append((touch, float(own_force(tracker.estimator, tracker._contact)[-1])))
    return found[12:]


@pytest.mark.parametrize(("n", "depth"), [(4, 1.5e-3), (8, 1.5e-3)])
def test_the_answer_is_nearer_to_the_force_than_one_even_penalty_alone(n: int, depth: float) -> None:
    skin, ball, noise = scene(n, depth, 1e-3)
    loads = np.r_[np.ones(6), np.linspace(1.0, 1.8, 6)]
    found = stream(skin, [load * ball for load in loads], noise)
    answered = np.array([float(touch.force[2]) for touch, _ in found]) / loads
    own = np.array([force for _, force in found]) / loads
    assert np.median(np.abs(answered - 1.0)) < 0.05
    assert np.median(np.abs(answered - 1.0)) < 0.5 * np.median(np.abs(own - 1.0))
    low, high = np.array([[end[2] for end in touch.interval(0.95, "force")] for touch, _ in found]).T / loads
    assert ((low <= 1.0) & (high >= 1.0)).all()
    assert np.median(high - low) < 0.4


def test_the_same_frame_is_answered_as_by_the_single_solve() -> None:
    skin, ball, noise = scene(6, 1.5e-3, 1.5e-3)
    frame = ball + noise * np.random.default_rng(1).standard_normal(ball.shape)
    with keeping() as kept:
        touch = skin.reconstruct(frame)
    assert kept.models is not None
    traction, left = Again(kept.models).solve([frame], np.zeros(frame.size, dtype=bool))
    np.testing.assert_allclose(traction, touch.values, atol=1e-4 * np.abs(touch.values).max())
    assert np.sqrt(np.mean(left**2)) == pytest.approx(1.0, abs=0.3)


def test_another_contact_is_not_answered_with_the_models_of_the_last() -> None:
    skin, ball, noise = scene(8, 1.5e-3, 1e-3, -2e-3)
    other = np.asarray(skin.sense(solutions.hertz_point(contact_radius=1e-3, force=1.0).shifted(2e-3, 0.0)))
    found = stream(skin, [ball] * 4 + [other] * 8, noise)
    assert all(float(touch.center_of_pressure[0]) > 1e-3 for touch, _ in found[4:])
    assert float(found[-1][0].force[2]) == pytest.approx(1.0, abs=0.05)
    assert str(found[3][0].method) == "adaptive"


def test_a_reading_that_fails_is_not_used() -> None:
    skin, ball, noise = scene(6, 1.5e-3, 1e-3)
    broken = ball.copy()
    broken[2, 3, 3] = np.nan
    found = stream(skin, [ball] * 4 + [broken] * 6, noise)
    assert [str(touch.method) for touch, _ in found] == ["adaptive"] * len(found)
    assert [float(touch.force[2]) for touch, _ in found] == pytest.approx([1.0] * len(found), abs=0.03)
    low, high = np.array([[end[2] for end in touch.interval(0.95, "force")] for touch, _ in found]).T
    assert ((low <= 1.0) & (high >= 1.0)).all()


def test_without_all_readings_of_a_channel_the_interval_is_wider() -> None:
    skin, ball, noise = scene(6, 1.5e-3, 1e-3)
    frame = ball + noise * np.random.default_rng(1).standard_normal(ball.shape)
    with keeping() as kept:
        skin.reconstruct(frame)
    assert kept.models is not None
    again, unused = Again(kept.models), np.zeros(frame.shape, dtype=bool)
    unused[2] = True
    assert again.widening(np.zeros(frame.size, dtype=bool)) == 1.0
    assert again.widening(unused.ravel()) > 1.3
    frame[unused] = np.nan
    traction, left = again.solve([np.nan_to_num(frame)], unused.ravel())
    assert traction[-1].sum() * skin.surface.cell == pytest.approx(1.0, abs=0.1)
    assert not left[unused.ravel()].any()


def test_a_pull_after_a_press_is_a_pull() -> None:
    skin, ball, noise = scene(8, 1.5e-3, 2e-3)
    found = stream(skin, [ball] * 15 + [-ball] * 10, noise)
    assert np.median([float(touch.force[2]) for touch, _ in found[15:]]) == pytest.approx(-1.0, abs=0.2)


def test_after_the_contact_nothing_of_it_is_left() -> None:
    skin, ball, noise = scene(6, 1.5e-3, 1e-3)
    found = stream(skin, [ball] * 4 + [0.0 * ball] * 4, noise)
    assert float(found[-1][0].force[2]) == 0.0
    assert found[-1][0].status == pp.Status.NO_CONTACT


def renewed(skin: pp.Skin, ball: Any, other: Any, noise: float) -> tuple[bool, pp.Touch]:
    """Whether the frame ``other`` after five of ``ball`` is solved by itself again, and its touch."""
    rng = np.random.default_rng(7)
    with skin.track(baseline=10) as tracker:
        for frame in [0.0 * ball] * 12 + [ball] * 5:
            tracker.step(frame + noise * rng.standard_normal(ball.shape))
        before = tracker._held._kept
        assert before is not None
        for _ in range(4 + 5 * ball.size // 200):  # comparisons keep their distance
            touch = tracker.step(other + noise * rng.standard_normal(ball.shape))
        return tracker._held._kept is not before, touch


@pytest.mark.parametrize(("load", "again"), [(1.2, False), (1.6, True)])
def test_a_load_that_grows_is_solved_anew(load: float, *, again: bool) -> None:
    """A contact widens with its load, and the local penalties of the smaller one hold it back."""
    skin, ball, noise = scene(8, 1.5e-3, 1e-3)
    found, touch = renewed(skin, ball, load * ball, noise)
    assert found is again
    assert float(touch.force[2]) == pytest.approx(load, rel=0.05)


@pytest.mark.long
def test_many_readings_do_not_hide_that_a_contact_has_moved() -> None:
    """The sum of squares of 1728 residuals hardly grows, and 0.88 N were found 1.55 mm away; the pressure that a few want grows."""
    skin, ball, noise = scene(24, 2e-3, 1.5e-3)
    moved = np.asarray(skin.sense(solutions.hertz_point(contact_radius=1.5e-3, force=1.0).shifted(2e-3, 0.0)))
    found, touch = renewed(skin, ball, moved, 10.0 * noise)
    assert found
    assert float(touch.center_of_pressure[0]) == pytest.approx(2e-3, abs=0.2e-3)


def test_intervals_of_the_own_model_allow_for_the_gain_that_is_assumed() -> None:
    widths = []
    for uncertainty in (None, pp.Uncertainty(gain=0.05), pp.Uncertainty(gain=0.0)):
        array = pp.AreaArray(shape=(6, 6), pitch=1e-3, depth=1.5e-3, channels=THREE, noise=30.0)
        skin = pp.Skin(PAD, array, **({} if uncertainty is None else {"uncertainty": uncertainty}))
        ball = np.asarray(skin.sense(solutions.hertz_point(contact_radius=1.5e-3, force=0.3)))
        rng = np.random.default_rng(0)
        with skin.track() as tracker:
            tracker._alone = None  # no single solves
            for load in [0.0] * 3 + [1.0] * 4:
                touch = tracker.step(load * ball + 30.0 * rng.standard_normal(ball.shape))
        low, high = touch.interval(0.95, "force")
        widths.append(float(high[2] - low[2]))
    assert widths[0] == pytest.approx(widths[1])
    assert widths[0] > 1.02 * widths[2]
