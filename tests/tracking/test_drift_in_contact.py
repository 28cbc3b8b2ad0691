"""Offsets that arise after the zero, in one frame and in streams, and presses that grow slowly."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.elastic.pad import Floats

CHANNELS = ["stress_xz", "stress_yz", "stress_zz"]
BALL = pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.1)


def _skin(noise: float | None = None, channels: list[str] = CHANNELS, n: int = 8) -> pp.Skin:
    array = pp.AreaArray(shape=(n, n), pitch=1e-3, depth=1.2e-3, channels=channels, noise=noise)
    return pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array)


def _held(touch: pp.Touch, true: tuple[float, float, float]) -> bool:
    """Whether the 99 % interval of each component holds the true force."""
    low, high = touch.interval(0.99, of="force")
    return bool(((low <= np.array(true)) & (np.array(true) <= high)).all())


CLEAN: Floats = np.asarray(_skin().sense(BALL))
TOP = float(np.abs(CLEAN).max())


@pytest.mark.parametrize("part", [0.05, 0.2])
@pytest.mark.parametrize("given", [True, pytest.param(False, marks=pytest.mark.long)])
def test_an_offset_after_the_zero_is_no_drag(part: float, *, given: bool) -> None:
    """A fifth of the largest reading, in one shear channel, was read as 0.30 N of drag beside 0.15 N of press."""
    rng, std = np.random.default_rng(0), 0.02 * TOP
    skin = _skin(std if given else None)
    rest = std * rng.standard_normal((20, *CLEAN.shape))
    readings = CLEAN + std * rng.standard_normal(CLEAN.shape)
    readings[1] += part * TOP
    touch = skin.reconstruct(readings, zero=rest)
    assert _held(touch, (0.0, 0.0, 0.1))
    assert abs(touch.force[1]) < 0.01
    assert any("offset of stress_yz" in note for note in touch.notes)


@pytest.mark.parametrize(("n", "radius"), [(8, 1.5e-3), (7, 1.5e-3), (6, 1.5e-3), (12, 1e-3)])
@pytest.mark.parametrize("part", [0.05, 0.12])
def test_a_drift_after_the_zero_is_no_wide_press(n: int, radius: float, part: float) -> None:
    """Contact alone explained it: 1.4 N [1.05, 1.7] and 2.0 N [1.3, 3.0] of 1 N on 7 x 7, without a word.

    On 6 x 6 the contact takes a fifth of the offset, the fit is doubtful (0.008), and a model error then leaves the offset
    unknown.
    """
    skin, rng = _skin(n=n, channels=["stress_zz"]), np.random.default_rng(7)
    clean = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=radius, force=1.0).shifted(0.3e-3, 0.0)))
    top, rest = float(np.abs(clean).max()), rng.standard_normal((10, *clean.shape))
    readings = clean + part * top + 0.01 * top * rng.standard_normal(clean.shape)
    touch = skin.reconstruct(readings, zero=0.01 * top * rest)
    unsure = any(note.startswith("the net force is uncertain") for note in touch.notes)
    assert float(touch.force[2]) == pytest.approx(1.0, abs=0.1) or (unsure and n == 6)
    assert _held(touch, (0.0, 0.0, 1.0))


def test_a_punch_larger_than_the_array_is_no_offset() -> None:
    """It was read as an offset of every channel: "no contact"."""
    skin, rng = _skin(n=10), np.random.default_rng(1)
    wide = pp.Skin(skin.pad, skin.planes[0], surface=pp.AreaGrid(shape=(60, 60), spacing=0.5e-3))
    clean = np.asarray(wide.sense(pp.solutions.flat_punch(radius=11e-3, force=4.0)))
    top = float(np.abs(clean).max())
    rest, noise = 0.01 * top * rng.standard_normal((2, 12, *clean.shape))
    touch = skin.reconstruct(clean + noise[0], zero=rest)
    assert touch.status != pp.Status.NO_CONTACT
    assert touch.interval(0.95, of="force")[1][2] > 1.0


@pytest.mark.parametrize("n", [4, 5])
def test_an_offset_on_few_readings_is_no_drag(n: int) -> None:
    """48 readings had no term for it: 0.05 N of drag and 0.17 N of press, none of which the interval excluded."""
    skin, rng = _skin(n=n), np.random.default_rng(1)
    clean = np.asarray(skin.sense(BALL))
    std = 0.01 * float(np.abs(clean).max())
    rest = std * rng.standard_normal((20, *clean.shape))
    readings = clean + std * rng.standard_normal(clean.shape)
    readings[0] += 0.2 * float(np.abs(clean).max())
    touch = skin.reconstruct(readings, zero=rest)
    assert _held(touch, (0.0, 0.0, 0.1))
    assert abs(touch.force[0]) < 0.02
    assert float(touch.force[2]) == pytest.approx(0.1, rel=0.2)
    assert any("offset of stress_xz" in note for note in touch.notes)


def test_a_press_on_a_zeroed_skin_is_no_offset() -> None:
    """An even press looks like offsets; contact explains it, so that no offset is sought."""
    skin, rng, std = _skin(channels=["stress_zz"]), np.random.default_rng(0), 20.0
    grid = skin.surface
    traction = np.zeros((3, *grid.shape))
    traction[2] = 5e3
    clean = np.asarray(skin.sense(traction))
    touch = skin.reconstruct(
        clean + std * rng.standard_normal(clean.shape), zero=std * rng.standard_normal((20, *clean.shape))
    )
    assert touch.nuisance is not None
    assert not touch.nuisance.any()
    assert touch.interval(0.95, of="force")[1][2] > 0.9 * 5e3 * 64e-6


@pytest.mark.parametrize("baseline", [10, pytest.param(0, marks=pytest.mark.long)])
def test_a_step_of_a_shear_channel_under_contact_is_found(baseline: int) -> None:
    """It was read as 0.4 N of drag for ever, "solved" and without a note where noise was given."""
    rng, std = np.random.default_rng(0), 0.02 * TOP
    tracker = _skin(std).track(baseline=baseline)
    for i in range(56):
        readings = (CLEAN if i >= 20 else 0.0 * CLEAN) + std * rng.standard_normal(CLEAN.shape)
        readings[1] += 0.2 * TOP if i >= 30 else 0.0
        touch = tracker.step(readings, i / 50)
    assert _held(touch, (0.0, 0.0, 0.1))
    assert abs(touch.force[1]) < 0.05
    assert any("stress_yz has drifted" in note for note in touch.notes)


@pytest.mark.long
def test_drift_of_a_shear_channel_under_contact_is_inside_the_interval() -> None:
    """At 5 % of the largest reading a second, 0.07 N [0.06, 0.10] of drag were read of none, without a note."""
    rng, std = np.random.default_rng(0), 0.01 * TOP
    tracker = _skin().track(baseline=10)
    held = []
    for i in range(120):
        readings = (CLEAN if i >= 15 else 0.0 * CLEAN) + std * rng.standard_normal(CLEAN.shape)
        readings[0] += 0.05 * TOP * max(i - 10, 0) / 40
        touch = tracker.step(readings, i / 40)
        held.append(_held(touch, (0.0, 0.0, 0.1 if i >= 15 else 0.0)))
    assert np.mean(held[60:]) > 0.9


def test_a_press_that_grows_slowly_is_found() -> None:
    """The noise at rest was learned from its first frames too, so that it hid itself: 0 N at full load."""
    rng, std = np.random.default_rng(0), 0.02 * TOP
    tracker = _skin(std).track(baseline=10, rate=25.0)
    for i in range(85):
        part = min(max(i - 20, 0) / 62.5, 1.0)
        touch = tracker.step(part * CLEAN + std * rng.standard_normal(CLEAN.shape), i / 25)
    assert touch.status == pp.Status.SOLVED
    assert float(touch.force[2]) == pytest.approx(0.1, rel=0.2)
