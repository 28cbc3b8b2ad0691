"""All readings of a channel at the end of their range: they are the same, and the load has no upper bound."""

from __future__ import annotations

import math

import numpy as np
import pytest

import palpate as pp
from palpate.status import Status

HALF = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
ZZ, THREE = ["stress_zz"], ["stress_xz", "stress_yz", "stress_zz"]


def skin_of(side: int, channels: list[str]) -> pp.Skin:
    return pp.Skin(HALF, pp.AreaArray(shape=(side, side), pitch=1e-3, depth=1e-3, channels=channels))


def press_of(skin: pp.Skin, side: int) -> np.ndarray:
    return np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=0.6e-3 * side, force=3.0)))


@pytest.mark.parametrize(("side", "channels"), [(4, ZZ), (6, THREE)])
def test_a_stream_says_overload(side: int, channels: list[str]) -> None:
    skin = skin_of(side, channels)
    press, rng = press_of(skin, side), np.random.default_rng(0)
    largest = float(np.abs(press).max())
    with skin.track(baseline=10) as tracker:
        for k in range(40):
            part = min(max(k - 15, 0) / 20, 1.0)
            noise = 3e-3 * largest * rng.standard_normal(press.shape)
            touch = tracker.step(np.clip(part * press + noise, -0.1 * largest, 0.1 * largest), 0.02 * k)
            if part > 0.1:
                assert touch.status == Status.OVERLOAD, (k, touch.notes)
                low, high = touch.interval(0.95, "force")
                assert low[-1] <= 3.0 * part
                assert high[-1] == math.inf


@pytest.mark.parametrize(("side", "channels"), [(4, ZZ), pytest.param(6, THREE, marks=pytest.mark.long)])
def test_one_frame_after_a_zero_says_overload(side: int, channels: list[str]) -> None:
    skin = skin_of(side, channels)
    press, rng = press_of(skin, side), np.random.default_rng(0)
    largest = float(np.abs(press).max())
    rest = 3e-3 * largest * rng.standard_normal((10, *press.shape))
    touch = skin.reconstruct(np.clip(press, -0.1 * largest, 0.1 * largest), zero=rest)
    assert touch.status == Status.OVERLOAD
    assert touch.interval(0.95, "force")[1][-1] == math.inf


def test_without_a_zero_nothing_bounds_equal_readings() -> None:
    # the end of the range, or an offset: they look the same
    touch = skin_of(4, ZZ).reconstruct(np.full((1, 4, 4), 2e4))
    assert touch.status == Status.UNDECIDED
    low, high = touch.interval(0.95, "force")
    assert (low == -math.inf).all()
    assert (high == math.inf).all()


@pytest.mark.parametrize("baseline", [0, 10])
def test_a_coarse_sensor_at_rest_is_not_at_its_end(baseline: int) -> None:
    skin = skin_of(4, ZZ)
    press, found = press_of(skin, 4), []
    step = float(press.max()) / 20  # rest reads the same count everywhere, a press 20 more
    with skin.track(baseline=baseline) as tracker:
        for k in range(40):
            part = min(max(k - 20, 0) / 10, 1.0)
            counts = 512 + np.round(part * press / step)
            found.append(Status.coded(tracker.step((counts - 512 * (baseline == 0)) * step, 0.02 * k).status))
    assert Status.OVERLOAD not in found[:21]


def test_a_sensor_that_fails_to_zero_is_no_rest() -> None:
    # 512 counts at rest; the cable breaks, and every reading is 0
    skin, rng = skin_of(4, ZZ), np.random.default_rng(0)
    with skin.track(baseline=10) as tracker:
        for k in range(30):
            broken = k > 20
            touch = tracker.step(
                0.0 * np.ones((1, 4, 4)) if broken else 5e4 + 50 * rng.standard_normal((1, 4, 4)), 0.02 * k
            )
            if broken:
                assert touch.status not in (Status.NO_CONTACT, Status.SOLVED), (k, touch.notes)


def test_a_stream_whose_displacements_exceed_the_array_goes_on() -> None:
    # minus the offsets found, displacements are larger than the array: no pad does that, and no step raises
    array = pp.AreaArray(
        shape=(6, 6), pitch=1e-3, depth=0.0, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    skin, rng = pp.Skin(HALF, array), np.random.default_rng(1)
    press = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0)))
    press *= 5.9e-3 / press.max()
    with skin.track() as tracker:
        for k in range(40):
            readings = min(max(k - 15, 0) / 15, 1.0) * press + 1e-6 * rng.standard_normal(press.shape)
            touch = tracker.step(readings - 2e-3 * (k >= 8), 0.02 * k)
    assert touch.status != Status.NO_CONTACT
