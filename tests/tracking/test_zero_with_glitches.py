"""A glitch or a touch among the frames of the zero: it neither moves the zero nor makes the noise so large that contact hides in it."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate import solutions

ARRAY = pp.LineArray(count=24, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
PRESS = solutions.hertz_line(half_width=3e-3, force=50.0)


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), ARRAY)


@pytest.mark.parametrize("frames", [5, 9])
@pytest.mark.parametrize("what", ["constant", "spike", "touch", "missing", "nothing"])
@pytest.mark.long
def test_a_frame_unlike_the_others_is_no_zero(skin: pp.Skin, what: str, frames: int) -> None:
    rng = np.random.default_rng(frames)
    pressed = np.asarray(skin.sense(PRESS))
    offset = 300.0 * rng.standard_normal(pressed.shape)
    tracker = skin.track(baseline=frames, rezero=None)
    for i in range(frames):
        reading = offset + 20.0 * rng.standard_normal(pressed.shape)
        if i == 2:
            if what == "constant":
                reading[:] = 5e3
            elif what == "spike":
                reading[0, 7] += 1e5
            elif what == "touch":
                reading += pressed
            elif what == "missing":
                reading[0, 3:6] = np.nan
        assert not tracker.step(reading).touching
    empty = tracker.step(offset + 20.0 * rng.standard_normal(pressed.shape))
    assert not empty.touching
    touch = tracker.step(offset + pressed + 20.0 * rng.standard_normal(pressed.shape))
    np.testing.assert_allclose(touch.noise_std, 20.0, rtol=0.3)
    assert touch.force[1] == pytest.approx(50.0, abs=1.5)


def test_most_frames_are_believed(skin: pp.Skin) -> None:
    """Readings in steps, of which most frames show the same, and a slow drift: every frame counts."""
    from palpate.sensing.zero import far_frames

    steps = np.zeros((9, 24))
    steps[4, 3] = 1.0
    assert not far_frames(steps).any()
    drifting = np.arange(9.0)[:, None] * np.ones(24) + 0.1 * np.random.default_rng(0).standard_normal((9, 24))
    assert not far_frames(drifting).any()
    assert not far_frames(np.full((4, 24), np.nan)).any()
    assert not far_frames(np.array([[0.0, 1.0], [5.0, 2.0]])).any()
