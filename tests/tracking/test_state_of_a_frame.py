"""What one frame tells holds for that frame: noise, residual, missing readings, the zero that is being taken."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
CHANNELS = ["stress_xz", "stress_zz"]
LINE = pp.Skin(PAD, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=CHANNELS, noise=5.0))
PRESS = np.asarray(LINE.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0)))


def noise(seed: int = 0) -> np.ndarray:
    return np.asarray(5.0 * np.random.default_rng(seed).normal(size=PRESS.shape))


def test_a_stated_noise_is_that_of_its_frame() -> None:
    """A source that stated a very large error once hid every later contact."""
    tracker = LINE.track()
    tracker.step(0.0 * PRESS, std=np.full_like(PRESS, 1e5))
    assert float(tracker.step(PRESS).force[1]) == pytest.approx(10.0, rel=0.05)


def test_a_zero_asked_for_while_one_is_taken_begins_anew() -> None:
    """Two touched frames stayed in the zero."""
    tracker = LINE.track(baseline=4)
    for _ in range(2):
        tracker.step(PRESS)
    tracker.rezero(frames=4)
    for k in range(4):
        assert tracker.capturing
        tracker.step(noise(k))
    assert not tracker.capturing
    assert float(np.asarray(tracker.step(noise(9)).force)[1]) == pytest.approx(0.0, abs=0.1)


def test_zeros_of_two_channels_asked_for_in_turn_are_both_taken() -> None:
    tracker = LINE.track()
    tracker.rezero(["stress_xz"], frames=2)
    tracker.rezero(["stress_zz"], frames=2)
    offset = np.array([[300.0] * 21, [50.0] * 21])
    touches = [tracker.step(offset + noise(k)) for k in range(4)]
    assert np.abs(np.asarray(touches[-1].force)[:2]).max() < 0.2


def test_rest_has_no_residual_of_the_contact_before() -> None:
    tracker = LINE.track(baseline=5)
    for k in range(5):
        tracker.step(noise(k))
    pressed = tracker.step(PRESS + noise(7))
    assert np.isfinite(float(np.asarray(pressed.residual)))
    for k in range(3):
        rest = tracker.step(noise(20 + k))
    assert np.isnan(float(np.asarray(rest.residual)))


def test_a_zero_that_is_passed_on_takes_its_noise_along() -> None:
    """Without it every frame at rest was undecided."""
    skin = pp.Skin(PAD, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=CHANNELS))
    first, second = skin.track(baseline=10), skin.track(friction=0.5)
    for k in range(10):
        first.step(50.0 + noise(k))
    assert second.take_zero(first)
    assert second.step(50.0 + noise(11)).status == pp.Status.NO_CONTACT


def test_a_reading_that_stays_wrong_is_not_taken_back_at_rest() -> None:
    tracker = LINE.track(baseline=10)
    for k in range(10):
        tracker.step(noise(k))
    left_out = []
    for k in range(150):
        readings = noise(100 + k)
        readings[1, 10] += 5000.0
        tracker.step(readings)
        left_out.append(int(tracker.health.left_out.sum()))
    assert (np.diff(left_out) < 0).sum() == 0


def test_a_missing_frame_lists_its_own_missing_readings() -> None:
    tracker = LINE.track()
    tracker.step(noise())
    touch = tracker.step(np.full_like(PRESS, np.nan))
    assert touch.outliers is not None
    assert np.asarray(touch.outliers).sum() == PRESS.size


@pytest.mark.long
def test_a_calibrated_tracker_scales_its_map_once() -> None:
    """The map of a sensor whose counts are 37 times smaller than pascals was 69 N for 2 N."""
    pad = pp.BondedLayers([pp.Layer(thickness=8e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    skin = pp.Skin(pad, pp.AreaArray(shape=(4, 4), pitch=4e-3, depth="base", channels=["stress_zz"]))
    rng = np.random.default_rng(0)
    counts = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=4e-3, force=2.0))) / 37.0

    def scatter() -> np.ndarray:
        return np.asarray(0.003 * counts.max() * rng.normal(size=counts.shape))

    part = np.r_[0.0, 0.0, np.linspace(0.2, 1.0, 6)]
    frames = np.stack([p * counts + scatter() for p in part])
    calibrated = skin.calibrate(frames, reference=2.0 * part)
    with calibrated.track(baseline=10) as tracker:
        for _ in range(10):
            tracker.step(scatter())
        for _ in range(12):
            touch = tracker.step(counts + scatter())
        missing = counts + scatter()
        missing[0, 0, 0] = np.nan
        without = tracker.step(missing)
    load = np.asarray(touch.values)[-1].sum() * touch.surface.cell
    assert load == pytest.approx(2.0, rel=0.1)
    assert float(np.asarray(without.force)[2]) == pytest.approx(2.0, rel=0.15)
