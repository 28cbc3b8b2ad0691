"""What a stream says hangs on the zero, its noise and the readings of now: contact, overload, fit and events."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.status import Status
from palpate.tracking.single import Single

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
GEL = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
THREE = ["stress_xz", "stress_yz", "stress_zz"]
DISPLACED = ["displacement_x", "displacement_y", "displacement_z"]
BALL = solutions.hertz_point(contact_radius=3e-3, force=3.0).sliding(0.3)
TAXELS = pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=1.5e-3, channels=THREE)
PRESSED = pp.AreaArray(shape=(8, 8), pitch=1.5e-3, depth=2e-3, channels=["stress_zz"])
REST = 20


def status(touch: pp.Touch) -> Status:
    assert touch.status is not None
    return Status.coded(int(touch.status))


def bounds(touch: pp.Touch) -> tuple[float, float]:
    low, high = touch.interval(0.95, "force")
    return float(low[-1]), float(high[-1])


def followed(tracker: Any, frames: Any, rate: float = 100.0) -> tuple[list[pp.Touch], list[Any]]:
    """Touches and events of some frames."""
    monitor, touches, events = pp.GraspMonitor(), [], []
    for i, frame in enumerate(frames):
        touches.append(tracker.step(frame, i / rate))
        events += monitor.update(touches[-1])
    return touches, events


# -- contact begins above rest, and ends ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pad", "array", "noise"),
    [
        (PAD, TAXELS, 50.0),
        (GEL, pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=0.3e-3, channels=DISPLACED), 1e-6),
    ],
)
@pytest.mark.long
def test_readings_that_are_exactly_zero_after_a_press_are_no_contact(pad: Any, array: Any, noise: float) -> None:
    """A sensor that writes 0 where it feels nothing tells no noise; taxels whose gains differ by a fifth leave offsets and rates of drift behind."""
    skin, rng = pp.Skin(pad, array), np.random.default_rng(0)
    full = np.asarray(skin.sense(BALL))
    full = full * (1.0 + 0.2 * rng.standard_normal(full.shape))
    loads = [*[0.0] * REST, *np.linspace(0.0, 1.0, 20), *[1.0] * 40, *np.linspace(1.0, 0.0, 10), *[0.0] * 60]
    frames = [load * full + (noise * rng.standard_normal(full.shape) if load > 0 else 0.0) for load in loads]
    touches, events = followed(skin.track(baseline=10), frames)
    assert all(status(t) is Status.NO_CONTACT for t in touches[-58:])
    assert [(e.kind, e.began) for e in events if e.kind == "contact"] == [("contact", True), ("contact", False)]


def test_contact_begins_above_noise_that_taxels_share() -> None:
    """All taxels flicker together: their scores at rest say how much, and a press is found all the same, and ends."""
    skin, rng = pp.Skin(PAD, PRESSED), np.random.default_rng(1)
    full = np.asarray(skin.sense(solutions.hertz_point(contact_radius=2e-3, force=1.0)))
    across = np.linspace(-1.0, 1.0, 8)[None, :, None] * np.ones(full.shape)

    def frame(load: float) -> Any:
        noise = 20.0 * rng.standard_normal(full.shape) + 100.0 * rng.standard_normal() * across
        return load * full + noise

    loads = [*[0.0] * 150, *[1.0] * 20, *[0.0] * 20]
    touches, events = followed(skin.track(baseline=30, rezero=None), [frame(load) for load in loads])
    assert not any(t.touching for t in touches[30:150])
    assert all(t.touching for t in touches[151:170])
    assert not any(t.touching for t in touches[-15:])
    assert [(e.kind, e.began) for e in events if e.kind == "contact"] == [("contact", True), ("contact", False)]


@pytest.mark.long
def test_an_even_press_that_grows_slowly_is_within_the_interval_of_no_contact() -> None:
    """Wider than the array and slower than the zero follows, it looks like drift: that is said, and the interval has room for it."""
    skin, rng = pp.Skin(PAD, PRESSED), np.random.default_rng(0)
    grid = skin.surface
    traction = np.zeros((3, *grid.shape))
    traction[2] = 1e4
    full = np.asarray(skin.sense(traction))
    truth = 1e4 * (8 * 1.5e-3) ** 2  # over the array
    loads = [*[0.0] * REST, *np.linspace(0.0, 1.0, 1000)]
    tracker = skin.track(baseline=REST)
    for i, load in enumerate(loads):
        touch = tracker.step(load * full + 100.0 * rng.standard_normal(full.shape), 0.01 * i)
    low, high = bounds(touch)
    assert low <= truth <= high
    assert touch.touching or any("the zero has followed a drift" in note for note in touch.notes)


@pytest.mark.long
def test_an_even_press_wider_than_the_array_is_load_with_a_zero_just_taken() -> None:
    skin, rng = pp.Skin(PAD, PRESSED), np.random.default_rng(0)
    full = np.asarray(skin.sense(solutions.hertz_point(contact_radius=60e-3, force=100.0)))
    loads = [*[0.0] * REST, *np.linspace(0.1, 1.0, 10), *[1.0] * 200]
    touches, _ = followed(
        skin.track(baseline=REST), [load * full + 100.0 * rng.standard_normal(full.shape) for load in loads]
    )
    for touch in touches[REST + 12 :: 40]:
        assert status(touch) is Status.SOLVED
        low, high = bounds(touch)
        assert 0.5 < low <= 1.9 <= high


# -- the end of the range, and readings that stand still -----------------------------------------------------------------


@pytest.mark.long
def test_all_readings_at_their_end_are_an_overload_without_an_upper_end() -> None:
    skin = pp.Skin(PAD, replace(PRESSED, noise=100.0, limits=(-1e5, 13e3)))
    full = np.asarray(pp.Skin(PAD, PRESSED).sense(solutions.hertz_point(contact_radius=30e-3, force=40.0)))
    rng = np.random.default_rng(0)
    loads = [*[0.0] * REST, *np.linspace(0.2, 1.0, 5), *[1.0] * 8]
    frames = [np.clip(load * full + 100.0 * rng.standard_normal(full.shape), None, 13e3) for load in loads]
    assert (frames[-1] >= 13e3).all()
    touches, events = followed(skin.track(baseline=REST), frames)
    for touch in touches[-8:]:
        assert status(touch) is Status.OVERLOAD
        assert touch.touching
        low, high = bounds(touch)
        assert 0.5 < low < 40.0  # at least so many newtons ...
        assert math.isinf(high)  # ... and any more
    assert [(e.kind, e.began) for e in events] == [("contact", True)]


def test_an_overload_raises_the_alarm_of_excess_force_and_no_slip() -> None:
    skin = pp.Skin(PAD, replace(PRESSED, noise=100.0, limits=(-1e5, 13e3)))
    full = np.asarray(pp.Skin(PAD, PRESSED).sense(solutions.hertz_point(contact_radius=30e-3, force=40.0)))
    tracker, monitor = skin.track(), pp.GraspMonitor(max_force=0.5)
    for i in range(6):
        monitor.update(tracker.step(np.minimum(full, 13e3), 0.01 * i))
    assert monitor.going_on() == ("contact", "excess force")


@pytest.mark.parametrize("top", [False, True])
@pytest.mark.long
def test_a_patch_that_freezes_after_a_press_is_no_load(top: bool) -> None:
    """3 x 3 taxels stay at the values of the press, or at the largest of them, bit by bit, for 0.3 s."""
    skin, rng = pp.Skin(PAD, PRESSED), np.random.default_rng(0)
    full = np.asarray(skin.sense(solutions.hertz_point(contact_radius=2e-3, force=1.0)))
    size = 0.005 * float(full.max())
    frames = [load * full + size * rng.standard_normal(full.shape) for load in [*[0.0] * 30, *[1.0] * 20, *[0.0] * 30]]
    held = frames[49][:, 2:5, 2:5].copy()
    for frame in frames[50:]:
        frame[:, 2:5, 2:5] = held.max() if top else held
    touches, _ = followed(skin.track(baseline=30), frames)
    last = touches[-1]
    assert not last.touching or status(last) is Status.UNEXPLAINED or bounds(last)[0] <= 0.0
    assert any("left out" in note or "end of their range" in note for note in last.notes)


# -- what a pad's model leaves unexplained -------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(2, 2), (4, 4)])
@pytest.mark.long
def test_fit_is_known_in_every_solved_frame_of_few_taxels(shape: tuple[int, int]) -> None:
    """Their gains differ by a fifth; contact takes up nearly all that they tell."""
    array = pp.AreaArray(shape=shape, pitch=3e-3, depth=2e-3, channels=["stress_zz"])
    skin, rng = pp.Skin(PAD, array), np.random.default_rng(2)
    full = np.asarray(skin.sense(solutions.hertz_point(contact_radius=3e-3, force=1.0)))
    full = full * (1.0 + 0.2 * rng.standard_normal(full.shape))
    size = 1e-3 * float(full.max())
    frames = [
        load * full + size * rng.standard_normal(full.shape) for load in [*[0.0] * 10, *np.linspace(0.1, 1.0, 30)]
    ]
    touches, _ = followed(skin.track(baseline=10), frames)
    solved = [t for t in touches if status(t) is Status.SOLVED]
    assert len(solved) > 20
    assert all(t.fit is not None and math.isfinite(float(t.fit)) for t in solved)


@pytest.mark.long
def test_gains_that_differ_widen_the_intervals_and_are_said() -> None:
    """By a fifth, with noise that is a hundred times smaller: the interval holds the force, and the share is said."""
    held = []
    for seed in range(4):
        skin, rng = pp.Skin(PAD, TAXELS), np.random.default_rng(seed)
        full = np.asarray(skin.sense(BALL))
        full = full * (1.0 + 0.2 * rng.standard_normal(full.shape))
        size = 2e-3 * float(np.abs(full).max())
        loads = [*[0.0] * 12, *np.linspace(0.2, 1.0, 6), *[1.0] * 4]
        touches, _ = followed(
            skin.track(baseline=12), [load * full + size * rng.standard_normal(full.shape) for load in loads]
        )
        low, high = bounds(touches[-1])
        held.append(low <= 3.0 <= high or status(touches[-1]) is Status.UNEXPLAINED)
        if status(touches[-1]) is Status.SOLVED:
            said = (*touches[-1].notes, *touches[-1].assumed)
            assert any("unexplained; intervals allow for it" in one for one in said)
    assert all(held)


# -- one answer for one frame --------------------------------------------------------------------------------------------


def pressed_tracker(skin: pp.Skin, load: float = 1.0) -> tuple[Any, Any]:
    """A tracker with a zero, and frames of a press."""
    full, rng = np.asarray(skin.sense(BALL)), np.random.default_rng(3)
    size = 0.01 * float(np.abs(full).max())
    tracker = skin.track(baseline=12)
    for i in range(12):
        tracker.step(size * rng.standard_normal(full.shape), 0.01 * i)
    return tracker, lambda: load * full + size * rng.standard_normal(full.shape)


@pytest.mark.parametrize(
    ("contact", "words"),
    [
        (solutions.hertz_point(contact_radius=2e-3, force=1.0).shifted(5.5e-3, 0.0), "contact across the edge"),
        (solutions.hertz_point(contact_radius=1e-3, force=0.3).shifted(5.5e-3, 0.0), "small contact"),
    ],
)
def test_notes_of_a_single_solve_stay_while_its_models_answer(contact: Any, words: str) -> None:
    """Only the single solve of a frame had them, and a stream said nothing of what its readings do not determine."""
    skin, rng = pp.Skin(GEL, TAXELS), np.random.default_rng(0)
    full = np.asarray(skin.sense(contact))
    size = 0.003 * float(np.abs(full).max())
    tracker = skin.track(baseline=REST)
    for i in range(REST):
        tracker.step(size * rng.standard_normal(full.shape), 0.01 * i)
    touches = [tracker.step(full + size * rng.standard_normal(full.shape), 0.01 * (REST + i)) for i in range(8)]
    held = [t for t in touches if t.method == "adaptive"]
    assert len(held) > 4
    assert all(any(note.startswith(words) for note in t.notes) for t in held)


@pytest.mark.long
def test_a_tracker_that_a_single_solve_contradicts_begins_anew_and_its_interval_meets_the_other() -> None:
    """Said once, and only there."""
    skin = pp.Skin(PAD, TAXELS)
    tracker, frame = pressed_tracker(skin)
    honest, asked = tracker._alone, []

    def other(readings: Any, rest: Any, *given: Any) -> Single:
        found = honest(readings, rest, *given).touch
        asked.append(len(rest))
        return Single(replace(found, values=3.0 * found.values), None)

    tracker._alone = other
    touches = [tracker.step(frame(), 0.12 + 0.01 * i) for i in range(12)]
    assert asked == [12]  # a single solve is rare, and knows the frames at rest
    assert sum("restarts the contact" in note for t in touches for note in t.notes) == 1
    for touch in touches:
        low, high = bounds(touch)
        assert low <= 9.0 <= high
        assert float(touch.force[2]) == pytest.approx(3.0, rel=0.2)


@pytest.mark.long
def test_a_frame_that_a_single_solve_does_not_explain_is_unexplained_when_it_is_followed() -> None:
    tracker, frame = pressed_tracker(pp.Skin(PAD, TAXELS))
    honest = tracker._alone

    def refuted(*given: Any) -> Single:
        found = honest(*given)
        status = np.asarray(int(Status.UNEXPLAINED), dtype=np.int8)
        return found._replace(touch=replace(found.touch, status=status))

    tracker._alone = refuted
    monitor = pp.GraspMonitor()
    for i in range(8):
        touch = tracker.step(frame(), 0.12 + 0.01 * i)
        monitor.update(touch)
        assert status(touch) is Status.UNEXPLAINED
        assert np.isnan(touch.force).all()
        assert np.isnan(float(touch.peak_pressure))
        low, high = bounds(touch)
        assert low < 0.0 < 3.0 < high < 300.0
    assert monitor.going_on() == ("unexplained",)


@pytest.mark.long
def test_what_came_before_does_not_change_the_answer() -> None:
    """After garbage, a pull and another contact, the interval meets that of a tracker that saw none of it."""
    skin = pp.Skin(PAD, TAXELS)
    (fresh, frame), (used, _) = pressed_tracker(skin), pressed_tracker(skin)
    rng, full = np.random.default_rng(5), np.asarray(skin.sense(BALL))
    time = 0.12
    for before in [
        *[rng.standard_normal(full.shape) * float(full.max())] * 3,
        *[-full] * 5,
        *[0.4 * full] * 5,
        *[0.0 * full] * 5,
    ]:
        used.step(before + 1e-3 * float(full.max()) * rng.standard_normal(full.shape), time := time + 0.01)
    for i in range(10):
        reading = frame()
        one, other = fresh.step(reading, 0.12 + 0.01 * i), used.step(reading, time := time + 0.01)
    (a, b), (c, d) = bounds(one), bounds(other)
    assert Status.UNEXPLAINED in (status(one), status(other)) or max(a, c) <= min(b, d)
    assert a <= 3.0 <= b


# -- events --------------------------------------------------------------------------------------------------------------


def a_touch(shear: float, status: Status = Status.SOLVED, fit: float = 0.5, scale: float = 1000.0) -> pp.Touch:
    pressure = scale * np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    values = np.stack([shear * pressure, pressure])
    code = np.asarray(int(status), dtype=np.int8)
    touching = np.asarray(bool(values.any()))
    grid = pp.LineGrid(count=5, spacing=1e-3)
    return pp.Touch(values, grid, ("x", "z"), "tikhonov", status=code, fit=np.asarray(fit), touching=touching)


def test_one_frame_alone_is_no_event() -> None:
    monitor = pp.GraspMonitor(friction=0.5, max_pressure=5000.0)
    for _ in range(20):
        monitor.update(a_touch(0.1))
    began = [(e.kind, e.time) for e in monitor.events]
    assert began == [("contact", 2.0)]
    monitor.update(a_touch(0.6, scale=1e4))
    for _ in range(5):
        monitor.update(a_touch(0.1))
    assert [(e.kind, e.time) for e in monitor.events] == began
    for _ in range(25):
        monitor.update(a_touch(0.6, scale=1e4))
    assert {e.kind for e in monitor.events} == {"contact", "excess pressure", "incipient slip", "slip"}


@pytest.mark.parametrize(("poor", "fit"), [(Status.UNEXPLAINED, 0.5), (Status.SOLVED, 1e-9)])
def test_frames_that_nothing_explains_begin_and_end_nothing_else(poor: Status, fit: float) -> None:
    """Nor does a sensor that recovers from them raise an alarm with its first frames."""
    monitor = pp.GraspMonitor(friction=0.5, max_pressure=5000.0)
    for _ in range(10):
        monitor.update(a_touch(0.1))
    for _ in range(10):
        monitor.update(a_touch(0.6, poor, fit, 1e4))
    assert [(e.kind, e.began) for e in monitor.events[1:]] == [("unexplained", True)]
    assert math.isnan(monitor.state.utilisation)  # type: ignore[union-attr]
    monitor.update(a_touch(0.6))
    for _ in range(9):
        monitor.update(a_touch(0.1))
    assert [(e.kind, e.began) for e in monitor.events[1:]] == [("unexplained", True), ("unexplained", False)]
    assert monitor.going_on() == ("contact",)


@pytest.mark.parametrize("time", [True, math.nan, math.inf, -1e300, "0.1", [0.1], 0.1j])
def test_a_tracker_refuses_what_is_no_time(time: Any) -> None:
    skin = pp.Skin(PAD, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    tracker = skin.track()
    with pytest.raises(pp.InvalidInput, match="seconds"):
        tracker.step(np.zeros((1, 11)), time)
    assert tracker.health.frames == 0
    assert float(tracker.step(np.zeros((1, 11)), np.float32(0.5)).time) == 0.5  # type: ignore[arg-type]
