"""Readings whose source states how well it knows them, frame by frame: a tracker believes it."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.sensing.uncertainty import EXACT

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
SKIN = pp.Skin(
    PAD, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]), uncertainty=EXACT
)
PRESS = SKIN.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
QUIET, LOUD = 1.0, 60.0


def zeroed() -> tuple[pp.Tracker, np.random.Generator]:
    """A tracker whose zero was quieter than what follows."""
    rng = np.random.default_rng(4)
    tracker = SKIN.track(baseline=6, rezero=None)
    for i in range(6):
        tracker.step(QUIET * rng.standard_normal(PRESS.shape), 0.01 * i)
    return tracker, rng


def test_noise_that_grows_is_no_contact_where_the_source_says_it() -> None:
    tracker, rng = zeroed()
    loud = LOUD * rng.standard_normal(PRESS.shape)
    assert not bool(tracker.step(loud, 0.1, std=np.full(PRESS.shape, LOUD)).touching)
    assert bool(zeroed()[0].step(loud, 0.1).touching)


def test_a_contact_is_known_as_well_as_its_readings() -> None:
    wide, narrow = [], []
    for std, widths in ((LOUD, wide), (QUIET, narrow)):
        tracker, rng = zeroed()
        for i in range(5):
            frame = PRESS + std * rng.standard_normal(PRESS.shape)
            said = np.where(rng.random(PRESS.shape) < 0.2, np.nan, std)  # not of every reading
            touch = tracker.step(frame, 0.1 + 0.01 * i, std=said)
        low, high = touch.interval(0.95, "force")
        assert low[1] < 10.0 < high[1]
        widths.append(float(touch._errors.posterior.force[1]))  # what the pad's model leaves is not the readings' fault
    assert wide[0] > 3.0 * narrow[0]


def test_a_quiet_frame_is_no_better_known_than_the_zero() -> None:
    tracker, rng = zeroed()
    faint = QUIET * rng.standard_normal(PRESS.shape)
    assert not bool(tracker.step(faint, 0.1, std=np.full(PRESS.shape, 1e-6)).touching)
    assert tracker.step(faint, 0.11, std=np.full(PRESS.shape, np.nan)).status is not None


def test_refused() -> None:
    tracker, _ = zeroed()
    before = tracker.health.frames
    for wrong in (np.full(PRESS.shape, -1.0), np.ones(3)):
        with pytest.raises(pp.InvalidInput):
            tracker.step(PRESS, 0.1, std=wrong)
    assert tracker.health.frames == before


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_given_noise_far_too_small_is_not_fitted(seed: int) -> None:
    """Traction that follows the noise leaves less than the estimate, and was kept: 0.09 N was read as 1.9 N."""
    layer = pp.BondedLayers([pp.Layer(thickness=4.148e-3, youngs_modulus=1e6, poissons_ratio=0.48)])
    array = pp.AreaArray(
        shape=(5, 6), pitch=1e-3, depth=1.566e-3, channels=["strain_xz", "strain_yz", "strain_zz"], noise=2.9e-5
    )
    skin = pp.Skin(layer, array)
    ball = pp.solutions.hertz_point(contact_radius=1.02e-3, force=0.09).shifted(-0.94e-3, 1.0e-3)
    clean = np.asarray(skin.sense(ball))
    touch = skin.reconstruct(clean + 12 * 2.9e-5 * np.random.default_rng(seed).standard_normal(clean.shape))
    low, high = touch.interval(0.95, "force")
    assert low[2] < 0.09 < high[2]
    assert float(touch.force[2]) == pytest.approx(0.09, rel=0.3)
