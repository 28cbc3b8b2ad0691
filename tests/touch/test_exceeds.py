"""The probability that a quantity exceeds a limit, against the interval of the same quantity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.status import Status
from palpate.touch.fields import CalibratedForce

PRESS = solutions.hertz_line(half_width=2e-3, force=5.0)


@pytest.fixture(scope="module")
def touch() -> pp.Touch:
    """Frames without contact, with a push, with a pull."""
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=10.0))
    signal = np.array([0.0, 1.0, -1.0])[:, None, None] * skin.sense(PRESS)
    noise = 10.0 * np.random.default_rng(3).standard_normal(signal.shape)
    found = skin.reconstruct(signal + noise)
    assert np.asarray(found.touching).tolist() == [False, True, True]
    assert np.asarray(found.pushing).tolist() == [True, True, False]
    return found


@pytest.mark.parametrize("frame", [0, 1, 2])
def test_the_chance_above_the_ends_of_the_interval(touch: pp.Touch, frame: int) -> None:
    low, high = (float(end[frame, -1]) for end in touch.interval(0.95, "force"))
    assert touch.exceeds(high, "force")[frame] == pytest.approx(0.025, abs=1e-4)
    assert touch.exceeds(low, "force")[frame] == pytest.approx(0.975, abs=1e-4)


def test_the_chance_where_traction_has_either_sign(touch: pp.Touch) -> None:
    """A frame that neither pushes nor pulls as a whole."""
    either = replace(touch[1], pushing=np.array(False))
    high = float(either.interval(0.95, "force")[1][-1])
    assert either.exceeds(high, "force") == pytest.approx(0.025, abs=1e-4)


def test_a_frame_without_force_keeps_the_calibration_of_the_others(touch: pp.Touch) -> None:
    force, std = np.zeros((3, 2)), np.ones((3, 2))
    force[:, 1] = [np.nan, 4.0, 5.0]
    calibrated = CalibratedForce(force, std, np.full(3, 1e6))
    some = replace(touch, calibrated=calibrated, status=np.full(3, int(Status.SOLVED)))
    np.testing.assert_allclose(some.exceeds(5.0, "force")[1:], [0.1586553, 0.5], atol=1e-4)


def test_a_pull_has_a_centre(touch: pp.Touch) -> None:
    """That of the push with the opposite readings."""
    assert touch.force[2, -1] < 0
    center, (low, high) = touch.center_of_pressure, touch.interval(0.95, "center_of_pressure")
    assert np.isnan(center[0, 0])
    assert abs(center[2, 0]) < 2e-4
    assert low[2, 0] < center[2, 0] < high[2, 0]


def test_bounds_beyond_the_calibrated_interval(touch: pp.Touch) -> None:
    """An overload that pulls has no lower end, and exceeds no force above it; other bounds are as likely as the end of an interval."""
    pull = replace(touch[2], status=np.array(int(Status.OVERLOAD), dtype=np.int8))
    bounds = np.array([[np.nan, np.nan], [-np.inf, float(pull.force[-1])]])
    pull = replace(pull, force_bounds=bounds)
    assert pull.exceeds(1.0, "force") < 1e-3
    assert pull.exceeds(2.0 * float(pull.force[-1]), "force") == 0.975
    assert pull.exceeds(1.0) < 1e-3
    assert pull.interval(0.95, "peak_pressure")[0] == -np.inf
    push = replace(touch[1], force_bounds=np.array([[np.nan, np.nan], [np.nan, 50.0]]))
    assert push.interval(0.95, "force")[1][-1] == 50.0
    assert push.exceeds(20.0, "force") == 0.025
    assert push.exceeds(60.0, "force") < 1e-6
    nothing = pp.Skin(
        pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5),
        pp.LineArray(count=61, pitch=1e-3, depth=1e-3, channels=["stress_zz"]),
    ).reconstruct(np.zeros((1, 61)))
    assert nothing.exceeds(1.0, "force") == 0.0  # no error at all: without a warning
    over = replace(touch[1], status=np.array(int(Status.OVERLOAD), dtype=np.int8))
    assert over.exceeds(1e3, "force") == over.exceeds(1e9) == 1.0
