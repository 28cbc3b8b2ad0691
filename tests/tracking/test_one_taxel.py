"""A press that one taxel alone feels may be a small contact or a broken taxel; a stream leaves it open, as one frame does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.49)
NOISE = 50.0
SKIN = pp.Skin(PAD, pp.AreaArray(shape=(8, 8), pitch=4e-3, depth=0.4e-3, channels=["stress_zz"], noise=NOISE))


def press(force: float, radius: float = 0.5e-3) -> Any:
    """Readings of a ball above the taxel (4, 4)."""
    ball = pp.solutions.hertz_point(contact_radius=radius, force=force)
    return np.asarray(SKIN.sense(ball.shifted(2e-3, 2e-3)))


def follow(frames: list[Any], *, step: float = 0.01, seed: int = 0) -> tuple[pp.Tracker, list[pp.Touch]]:
    """A tracker and its touches of these frames, with noise, after twenty frames of zero."""
    rng, tracker = np.random.default_rng(seed), SKIN.track(baseline=20)
    noisy = [f + NOISE * rng.standard_normal(f.shape) for f in [0.0 * frames[0]] * 20 + frames]
    return tracker, [tracker.step(f, step * k) for k, f in enumerate(noisy)][20:]


def label(touch: pp.Touch) -> str:
    return pp.Status.coded(int(np.asarray(touch.status))).label


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_press_that_one_taxel_feels_is_undecided_for_as_long_as_it_lasts(seed: int) -> None:
    """It was "no contact" with a force of at most 0.16 N, and after five frames the taxel was left out."""
    small = press(0.3)
    _, touches = follow([small] * 30 + [0.0 * small] * 10, seed=seed)
    for touch in touches[:30]:
        assert label(touch) == "undecided"
        assert np.isnan(np.asarray(touch.force)[2])
        assert any("stress_zz at taxel (4, 4) alone responds" in note for note in touch.notes)
    for touch in touches[30:]:
        assert label(touch) == "no contact"


def test_the_zero_does_not_follow_such_a_press() -> None:
    """In half a minute the zero took up a press of 40 standard deviations."""
    small = press(1.0)
    small *= 40.0 * NOISE / np.abs(small).max()
    _, touches = follow([small] * 60, step=0.5)
    assert label(touches[-1]) == "undecided"


@pytest.mark.long
def test_a_press_that_the_neighbours_feel_is_solved() -> None:
    small, wide = press(0.1), press(2.0, radius=6e-3)
    _, touches = follow([small] * 20 + [wide] * 40)
    assert label(touches[19]) == "undecided"
    low, high = (float(np.asarray(side)[2]) for side in touches[-1].interval(0.95, "force"))
    assert label(touches[-1]) == "solved"
    assert low < 2.0 < high


def test_a_reading_that_repeats_itself_is_stuck() -> None:
    """Then its taxel is broken, and the others say that nothing touches."""
    frames = [0.0 * press(0.1)] * 60
    rng, tracker = np.random.default_rng(0), SKIN.track(baseline=20)
    touches = []
    for k, frame in enumerate(frames):
        noisy = frame + NOISE * rng.standard_normal(frame.shape)
        if k >= 30:
            noisy[0, 4, 4] = 8e4
        touches.append(tracker.step(noisy, 0.01 * k))
    assert label(touches[30]) == "undecided"
    assert label(touches[-1]) == "no contact"
    assert "stuck" in str(tracker.health)
