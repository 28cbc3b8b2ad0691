"""Frames one after another: the tracker, the simulator that feeds it, and the grasp monitor that listens."""

from __future__ import annotations

import math
from concurrent.futures import Future, wait
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate import simulation, solutions
from palpate.grasp import Event, GraspMonitor
from palpate.inverse.contact.policy import Policy
from palpate.simulation import Stage
from palpate.tracking.held import own_force, own_traction

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
THREE = ["stress_xz", "stress_yz", "stress_zz"]
ARRAY = pp.AreaArray(shape=(14, 14), pitch=1e-3, depth=1.5e-3, channels=THREE)
BALL = solutions.hertz_point(contact_radius=3e-3, force=1.0)
MU = 0.6


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, ARRAY)


@pytest.fixture(scope="module")
def story(skin: pp.Skin) -> tuple[list[simulation.Frame], Any]:
    """A story with everything in it, and its readings with 1 % noise."""
    frames = list(simulation.stream(skin, simulation.handling(1.0, 1e-3), friction=MU, radius=15e-3, rate=50.0))
    readings = np.stack([np.asarray(f.readings) for f in frames])
    noise = 0.01 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)
    return frames, readings + noise


@pytest.fixture(scope="module")
def followed(skin: pp.Skin, story: Any) -> tuple[list[pp.Touch], Any]:
    """The touches of the whole story, and the tracker's health after it."""
    frames, readings = story
    tracker = skin.track(friction=MU, baseline=15, rate=50.0)
    return [tracker.step(reading, frame.time) for frame, reading in zip(frames, readings)], tracker.health


# -- the simulator -------------------------------------------------------------------------------------------------------


def test_simulated_forces_are_those_of_the_story(skin: pp.Skin, story: Any) -> None:
    frames, _ = story
    for frame in frames:
        p = frame.traction[2]
        assert (p >= 0).all()
        assert (np.hypot(*frame.traction[:2]) <= MU * p * (1 + 1e-9) + 1e-9).all()
    held = next(f for f in frames if f.stage == "roll")
    assert held.traction[2].sum() * skin.surface.cell == pytest.approx(1.0, rel=1e-3)
    slid = [f for f in frames if f.sliding and np.isfinite(f.traction).all() and f.traction.any()]
    assert slid
    force = slid[0].traction.sum(axis=(1, 2))
    assert np.hypot(*force[:2]) / force[2] == pytest.approx(MU, rel=1e-6)
    assert force[0] < 0  # dragged towards -x
    partly = next(f for f in frames if f.stage == "shear" and 0.3 < f.stick < 0.9)
    force = partly.traction.sum(axis=(1, 2))
    assert np.hypot(*force[:2]) / force[2] / MU == pytest.approx(1 - partly.stick**3, rel=5e-3)


def test_simulation_on_a_line() -> None:
    skin = pp.Skin(PAD, pp.LineArray(count=41, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=10.0))
    stages = [Stage("press", 0.2, 100.0), Stage("drag", 0.2, 100.0, drag=0.5), Stage("slide", 0.2, 100.0, drag=1.0)]
    frames = list(simulation.stream(skin, stages, friction=0.4, radius=0.02, rate=50.0, rng=np.random.default_rng(0)))
    assert frames[-1].sliding
    total = frames[-1].traction.sum(axis=1) * skin.surface.cell
    np.testing.assert_allclose(total, [40.0, 100.0], rtol=1e-6)


@pytest.mark.parametrize("bad", [{"friction": 0.0}, {"radius": -1.0}, {"rate": math.nan}])
def test_simulation_refuses(skin: pp.Skin, bad: dict[str, float]) -> None:
    options = {"friction": 0.5, "radius": 0.01, "rate": 50.0, **bad}
    with pytest.raises(pp.InvalidInput):
        next(simulation.stream(skin, [Stage("press", 1.0, 1.0)], **options))
    with pytest.raises(pp.InvalidInput):
        Stage("press", 1.0, 1.0, drag=2.0)


# -- the tracker ---------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_tracker_agrees_with_the_batch(skin: pp.Skin, story: Any, followed: Any) -> None:
    """Contact made, rolled, twisted, slipped and lost: the same traction as frame-by-frame reconstruction."""
    (frames, readings), (touches, health) = story, followed
    worst, forces, seen = 0.0, 0.0, 0
    for i, (frame, reading, touch) in enumerate(zip(frames, readings, touches)):
        if frame.stage == "rest" and i > 0:
            assert not touch.touching
            assert not np.asarray(touch.values).any()
        if not touch.touching or i % 25:
            continue
        assert touch.converged
        assert touch.time == frame.time
        same = skin.reconstruct(reading, method="constrained", friction=MU, parameter=float(touch.parameter))  # type: ignore[arg-type]
        if frame.traction[2].sum() * skin.surface.cell > 0.5:
            seen += 1
            worst = max(worst, float(np.linalg.norm(touch.values - same.values) / np.linalg.norm(same.values)))
            forces = max(forces, float(np.abs(touch.force - same.force).max() / same.force[2]))
    assert seen > 5
    assert worst < 0.08  # weak patches of noise far from the contact, which only one of both may have
    assert forces < 0.04
    assert health.approximate == 0


@pytest.mark.long
def test_tracker_solves_its_problem_exactly(skin: pp.Skin, story: Any) -> None:
    """On its own cells a tight tolerance gives the minimiser that the exact solver finds."""
    from palpate.inverse import Cone, minimise

    frames, readings = story
    tracker = skin.track(friction=MU, baseline=15, tolerance=1e-6, rate=50.0, rezero=None)
    index = next(i for i, f in enumerate(frames) if f.stage == "shear" and f.stick < 0.8)
    for reading in readings[: index + 1]:
        tracker.step(reading)
    region, estimator = tracker._contact._solution.region, tracker.estimator
    assert region is not None
    level = estimator.level(1)
    observed = np.ones(readings[0].size, dtype=bool)
    assert tracker._zero.baseline is not None
    y = readings[index].ravel() - tracker._zero.baseline
    data = estimator.normal(level, region.cells, y, np.ones_like(y), observed)
    hessian, n = data.gram.copy(), len(region.cells)
    for c, q in enumerate(estimator.precisions(level, 1, region.parameter)):
        hessian[c * n : (c + 1) * n, c * n : (c + 1) * n] += q[region.cells][:, region.cells].toarray()
    exact = minimise(hessian, data.linear, Cone(("x", "y", "z"), MU)).traction
    found = tracker._contact.traction  # before faint cells are left out and the difference to a single solve is added
    assert np.abs(found - exact).max() < 1e-4 * exact.max()


@pytest.mark.long
def test_tracker_is_as_right_as_the_truth_allows(skin: pp.Skin, story: Any, followed: Any) -> None:
    inside = []
    for frame, touch in zip(story[0], followed[0]):
        true = frame.traction.sum(axis=(1, 2)) * skin.surface.cell
        if frame.stage in ("roll", "shear"):
            assert np.abs(np.asarray(touch.force) - true).max() < 0.06 * true[2]
            assert touch._errors is not None
            low, high = touch.interval(0.95, "force")
            inside.append(low[2] <= true[2] <= high[2])
    assert np.mean(inside) > 0.8


@pytest.mark.long
def test_noise_is_learned_from_the_baseline(skin: pp.Skin) -> None:
    tracker = skin.track(baseline=40)
    rng = np.random.default_rng(0)
    offset = 500.0 * rng.standard_normal((3, 14, 14))
    for _ in range(40):
        touch = tracker.step(offset + 20.0 * rng.standard_normal((3, 14, 14)))
        assert not touch.touching
    truth = skin.sense(BALL)
    touch = tracker.step(offset + truth + 20.0 * rng.standard_normal((3, 14, 14)))
    assert touch.noise_std is not None
    np.testing.assert_allclose(touch.noise_std, 20.0, rtol=0.03)
    assert touch.touching
    assert touch.force[2] == pytest.approx(1.0, abs=0.05)


@pytest.mark.long
def test_drift_is_followed_only_without_contact() -> None:
    """Thermal drift of five times the noise in half a minute goes into the zero; a contact held as long does not."""
    rng = np.random.default_rng(1)
    skin = pp.Skin(PAD, pp.AreaArray(shape=(9, 10), pitch=1.4e-3, depth=1.5e-3, channels=["stress_zz"]))
    pattern = rng.standard_normal((1, 9, 10))
    tracker = skin.track(baseline=20, rate=10.0, rezero=2.0)
    pressed = skin.sense(BALL)
    for i in range(300):
        touch = tracker.step(20.0 * (i / 60.0) * pattern + 20.0 * rng.standard_normal(pattern.shape))
        assert not touch.touching or i < 20
    drift = 100.0 * pattern
    forces = [
        float(tracker.step(drift + pressed + 20.0 * rng.standard_normal(pattern.shape)).force[2]) for _ in range(200)
    ]
    assert np.mean(forces[100:]) == pytest.approx(1.0, abs=0.04)
    assert abs(np.mean(forces[150:]) - np.mean(forces[10:60])) < 0.01
    fixed = skin.track(baseline=20, rate=10.0, rezero=None)
    last = [fixed.step(20.0 * (i / 60.0) * pattern + 20.0 * rng.standard_normal(pattern.shape)) for i in range(300)]
    assert any(bool(t.touching) for t in last[-50:])  # what following the drift is for


@pytest.mark.parametrize("how", ["nan", "offset", *long_runs("stuck", "saturated")])
@pytest.mark.long
def test_bad_taxels_are_noticed_and_left_out(skin: pp.Skin, how: str) -> None:
    rng = np.random.default_rng(2)
    tracker = skin.track(friction=MU, baseline=20)
    pressed = skin.sense(BALL)
    size = 0.01 * np.abs(pressed).max()
    bad = (2, 6, 7)
    touch = None
    for i in range(170):
        reading = (pressed if i > 30 else 0.0) + size * rng.standard_normal(pressed.shape)
        if i > 60:
            reading[bad] = {"nan": math.nan, "stuck": 123.0, "saturated": 1e9, "offset": reading[bad] + 4e4}[how]
        touch = tracker.step(reading)
    assert touch is not None
    index = np.ravel_multi_index(bad, (3, 14, 14))
    health = tracker.health
    assert health.left_out[index]
    assert health.left_out.sum() <= 2
    expected = {
        "nan": "missing",
        "stuck": ("stuck", "unexplained"),
        "saturated": "out of range",
        "offset": "unexplained",
    }
    assert health.reasons[index] in expected[how]
    assert "stress_zz at taxel (6, 7)" in str(health)
    assert touch.force[2] == pytest.approx(1.0, abs=0.04)
    assert touch.outliers is not None
    assert touch.outliers[index]


@pytest.mark.long
def test_a_taxel_comes_back(skin: pp.Skin) -> None:
    rng = np.random.default_rng(3)
    tracker = skin.track(baseline=10)
    for i in range(120):
        reading = 10.0 * rng.standard_normal((3, 14, 14))
        if 20 < i < 40:
            reading[0, 3, 3] = math.nan
        tracker.step(reading)
        if i == 39:
            assert tracker.health.left_out.sum() == 1
    assert not tracker.health.left_out.any()


@pytest.mark.long
def test_an_offset_that_goes_away_is_forgiven(skin: pp.Skin) -> None:
    rng = np.random.default_rng(6)
    tracker = skin.track(friction=MU, baseline=20)
    pressed = skin.sense(BALL)
    size = 0.01 * np.abs(pressed).max()
    for i in range(260):
        reading = (pressed if i > 30 else 0.0) + size * rng.standard_normal(pressed.shape)
        if 60 < i < 130:
            reading[2, 6, 7] += 4e4
        tracker.step(reading)
        if i == 125:
            assert tracker.health.left_out.sum() == 1
    assert not tracker.health.left_out.any()


@pytest.mark.long
def test_a_budget_blames_no_taxel(skin: pp.Skin, story: Any) -> None:
    """While the region still grows, the solution explains little: no reason to leave taxels out."""
    readings = story[1]
    with skin.track(friction=MU, baseline=15, budget=2e-3, rate=50.0) as tracker:
        for _ in range(2):
            for reading in readings[:90]:
                tracker.step(reading)
        assert not tracker.health.left_out.any(), str(tracker.health)


def test_a_glitch_is_not_a_contact(skin: pp.Skin) -> None:
    rng = np.random.default_rng(4)
    tracker = skin.track(baseline=10)
    for i in range(60):
        reading = 10.0 * rng.standard_normal((3, 14, 14))
        if i == 40:
            reading[2, 5, 5] = 3000.0
        assert not tracker.step(reading).touching


@pytest.mark.long
def test_late_and_uneven_frames(skin: pp.Skin, story: Any) -> None:
    frames, readings = story
    tracker = skin.track(friction=MU, baseline=15)
    for frame, reading in list(zip(frames, readings))[:80]:
        touch = tracker.step(reading, frame.time)
    again = tracker.step(readings[79], frames[79].time)
    assert again is not touch
    assert tracker.health.late == 1
    np.testing.assert_allclose(again.force, touch.force, atol=0.02)
    later = tracker.step(readings[81], frames[81].time + 0.07)
    assert later is not touch
    with pytest.raises(pp.InvalidInput, match="finite"):
        tracker.step(readings[82], math.nan)


@pytest.mark.long
def test_creep_is_taken_out_frame_by_frame() -> None:
    soft = pp.Viscoelastic(PAD, [(0.3, 0.5)])
    array = pp.AreaArray(
        shape=(12, 12), pitch=1e-3, depth=0.0, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    skin = pp.Skin(soft, array)
    traction = skin.sample(BALL)
    time = np.arange(40) / 20.0
    held = np.where((time > 0.4)[:, None, None, None], traction[None], 0.0)
    readings = skin.sense(held, time=time)
    readings += 1e-3 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)
    tracker = skin.track(baseline=5, rezero=None)
    forces = [float(tracker.step(r, t).force[2]) for r, t in zip(readings, time)]
    assert forces[-1] == pytest.approx(1.0, abs=0.06)
    assert forces[-1] == pytest.approx(forces[12], abs=0.03)  # the measured displacement grows by a fifth meanwhile


@pytest.mark.long
def test_budget_gives_an_answer_in_time_and_says_so(skin: pp.Skin, story: Any) -> None:
    frames, readings = (part[:90] for part in story)
    with skin.track(friction=MU, baseline=15, budget=1e-5, rate=50.0) as tracker:
        for frame, reading in zip(frames, readings):
            touch = tracker.step(reading, frame.time)
            if touch.touching:
                assert np.isfinite(np.asarray(touch.values)).all()
                assert (touch.values[2] >= 0).all()
        assert tracker.health.approximate > 0
    with skin.track(friction=MU, baseline=15, budget=60.0, rate=50.0) as tracker:
        for frame, reading in zip(frames, readings):
            touch = tracker.step(reading, frame.time)
        assert tracker.health.approximate == 0


@pytest.mark.long
def test_memory_is_bounded_and_reset_forgets(skin: pp.Skin, story: Any) -> None:
    import tracemalloc

    frames, readings = story
    tracker = skin.track(friction=MU, baseline=15, rate=50.0)
    first = [np.asarray(tracker.step(r, f.time).values) for f, r in zip(frames[:40], readings)]
    tracemalloc.start()
    sizes = []
    for _ in range(3):
        tracker.reset()
        again = [np.asarray(tracker.step(r, f.time).values) for f, r in zip(frames[:40], readings)]
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    np.testing.assert_array_equal(again[-1], first[-1])
    assert sizes[2] < sizes[1] + 200_000


@pytest.mark.long
def test_single_precision_and_several_planes() -> None:
    planes = [pp.AreaArray(shape=(12, 12), pitch=1e-3, depth=d, channels=["stress_zz"]) for d in (1e-3, 2e-3)]
    skin = pp.Skin(PAD, planes)
    reading = np.asarray(skin.sense(skin.sample(BALL)), dtype=np.float32)
    tracker = skin.track(components=["z"])
    touch = tracker.step(reading)
    assert touch.values.dtype == np.float32
    assert touch.force[2] == pytest.approx(1.0, abs=0.05)
    parts = [reading[:1], reading[1:]]
    np.testing.assert_allclose(skin.track(components=["z"]).step(parts).values, touch.values, rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"baseline": -1}, "baseline"),
        ({"baseline": np.zeros((2, 3))}, "zero="),
        ({"zero": np.zeros((2, 3))}, "shape"),
        ({"zero": np.full((3, 14, 14), np.nan)}, "finite"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"budget": -1.0}, "budget"),
        ({"rate": 0.0}, "rate"),
        ({"friction": -0.5}, "friction"),
        ({"components": ["x"]}, "pressure"),
    ],
)
def test_track_refuses(skin: pp.Skin, options: Any, words: str) -> None:
    with pytest.raises(pp.PalpateError, match=words):
        skin.track(**options)


def test_step_refuses_another_shape_and_goes_on(skin: pp.Skin) -> None:
    tracker = skin.track()
    good = tracker.step(skin.sense(BALL))
    with pytest.raises(pp.InvalidInput, match="one frame at a time"):
        tracker.step(np.zeros((5, 3, 14, 14)))
    assert tracker.health.frames == 1
    np.testing.assert_allclose(tracker.step(skin.sense(BALL)).force, good.force, atol=1e-3)


# -- the grasp -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def slipping(skin: pp.Skin) -> list[simulation.Frame]:
    stages = [
        Stage("rest", 0.4, 0.0),
        Stage("press", 0.4, 1.2),
        Stage("load", 0.3, 1.2, drag=0.35),
        Stage("firm", 0.8, 1.2, drag=0.35),
        Stage("shear", 1.0, 1.2, drag=0.999),
        Stage("slide", 0.4, 1.2, drag=1.0),
        Stage("lift", 0.2, 0.0),
        Stage("rest", 0.2, 0.0),
    ]
    return list(simulation.stream(skin, stages, friction=MU, radius=15e-3, rate=50.0))


@pytest.mark.parametrize("given", [*long_runs(MU), None])
@pytest.mark.long
def test_slip_is_announced_before_it_happens(
    skin: pp.Skin, slipping: list[simulation.Frame], given: float | None
) -> None:
    frames = slipping
    rng = np.random.default_rng(0)
    size = 0.01 * max(float(np.abs(np.asarray(f.readings)).max()) for f in frames)
    received: list[Event] = []
    monitor = GraspMonitor(friction=given, callback=received.append)
    tracker = skin.track(friction=given, baseline=15, rate=50.0)
    for frame in frames:
        monitor.update(tracker.step(frame.readings + size * rng.standard_normal((3, 14, 14)), frame.time))
        if frame.stage == "firm":
            assert "incipient slip" not in monitor.going_on()
            assert monitor.state is not None
            assert 0.1 < monitor.state.utilisation < 0.75
    assert received == monitor.events
    starts = {e.kind: e.time for e in reversed(received) if e.began}
    ends = {e.kind: e.time for e in received if not e.began}
    gross = next(f.time for f in frames if f.sliding)
    assert 0.1 < gross - starts["incipient slip"] < 0.8
    assert abs(gross - starts["slip"]) < 0.3
    assert starts["contact"] < 0.6
    assert ends["contact"] > 3.2
    assert "contact began" in str(received[0])
    if given is None:
        assert monitor.learned == pytest.approx(MU, rel=0.12)


@pytest.mark.long
def test_excess_is_announced_with_its_certainty(skin: pp.Skin) -> None:
    tracker, rng = skin.track(baseline=10), np.random.default_rng(0)
    monitor = GraspMonitor(max_force=0.8, max_pressure=1e9)
    for i in range(60):
        load = min(max(i - 10, 0) / 30.0, 1.2)
        reading = load * skin.sense(BALL) + 100.0 * rng.standard_normal((3, 14, 14))
        monitor.update(tracker.step(reading))
    (event,) = [e for e in monitor.events if e.kind == "excess force"]
    assert event.began
    assert event.probability >= 0.9
    assert 0.78 < event.value < 0.95
    assert not any(e.kind == "excess pressure" for e in monitor.events)


@pytest.mark.long
def test_monitor_refuses() -> None:
    with pytest.raises(pp.InvalidInput, match="friction"):
        GraspMonitor(friction=0.0)
    with pytest.raises(pp.InvalidInput, match="incipient"):
        GraspMonitor(incipient=1.5)
    skin = pp.Skin(PAD, ARRAY)
    touch = skin.reconstruct(skin.sense(np.stack([skin.sample(BALL)] * 2)), method="tikhonov")
    with pytest.raises(pp.InvalidInput, match="one touch"):
        GraspMonitor().update(touch)
    with pytest.raises(pp.InvalidInput, match="pressure"):
        GraspMonitor().update(replace(touch.frame(0), components=("x", "y")))


@pytest.mark.long
def test_error_bars_are_right_from_the_first_frame(skin: pp.Skin) -> None:
    """Without a baseline the noise is learned from the first frame in contact, and its error bars go by it."""
    rng = np.random.default_rng(0)
    clean = skin.sense(skin.sample(BALL))  # what cells cannot follow is no noise
    for noise in (1e-3, 1e-2):
        reading = clean + noise * np.abs(clean).max() * rng.standard_normal(clean.shape)
        touch = skin.track(friction=MU).step(reading)
        same = skin.reconstruct(reading, method="constrained", friction=MU)
        assert touch._errors is not None
        assert same._errors is not None
        # a frame whose fit is doubted has twice the error, which a tracker does not know of
        doubled = 2.0 if float(same.fit) < Policy().fit.doubted else 1.0
        assert 1 / 3 < touch._errors.posterior.force[2] * doubled / same._errors.posterior.force[2] < 3
        np.testing.assert_allclose(touch.noise_std, same.noise_std, rtol=0.4)


@pytest.mark.long
def test_a_given_zero_is_in_the_units_of_the_readings() -> None:
    """Also where the noise is given, by which readings are weighed."""
    skin = pp.Skin(PAD, replace(ARRAY, noise=[50.0, 50.0, 200.0]))
    rng = np.random.default_rng(0)
    offset = 2000.0 * rng.standard_normal((3, 14, 14))
    tracker = skin.track(friction=MU, zero=offset)
    assert not tracker.step(offset + rng.standard_normal(offset.shape)).touching
    touch = tracker.step(offset + skin.sense(BALL))
    assert touch.force[2] == pytest.approx(1.0, abs=0.02)


def test_correlated_noise_and_a_taxel_left_out() -> None:
    """The readings that remain are whitened among themselves, on both sides of the normal equations."""
    array = pp.AreaArray(
        shape=(12, 12), pitch=1e-3, depth=1.5e-3, channels=["stress_zz"], noise=100.0, noise_correlation=2e-3
    )
    skin = pp.Skin(PAD, array)
    clean = skin.sense(BALL)
    rng = np.random.default_rng(0)
    tracker = skin.track(tolerance=1e-6)
    for _ in range(12):
        reading = clean + array.sample_noise(rng)
        reading[0, 6, 6] = math.nan
        touch = tracker.step(reading)
    assert tracker.health.left_out.sum() == 1
    working = np.ones((12, 12), dtype=bool)
    working[6, 6] = False
    same = skin.masked(working).reconstruct(reading, method="constrained", parameter=float(touch.parameter))  # type: ignore[arg-type]
    own = own_traction(tracker.estimator, tracker._contact)
    assert np.linalg.norm(own - same.values) < 0.05 * np.linalg.norm(same.values)
    assert own_force(tracker.estimator, tracker._contact)[2] == pytest.approx(float(same.force[2]), abs=0.01)
    assert touch.force[2] == pytest.approx(1.0, rel=0.02)  # by the models of a single solve without it


@pytest.mark.long
def test_a_new_contact_takes_nothing_over_from_the_last(skin: pp.Skin) -> None:
    rng = np.random.default_rng(0)
    left, right = (skin.sense(BALL.shifted(x, 0.0)) for x in (-3e-3, 3e-3))
    never: Future[None] = Future()  # work on the contact before, which has not ended when the contact has
    with skin.track(friction=MU, baseline=10, budget=60.0) as tracker:
        for i in range(160):
            if i == 80:
                tracker._background._pending["move"] = never
            if i == 84:
                assert "move" not in tracker._background
            clean = 0.0 if i < 12 or i % 20 < 4 else left if (i // 20) % 2 else right
            touch = tracker.step(clean + 200.0 * rng.standard_normal(left.shape))
            # a busy machine must not decide what this frame knows
            wait([work for work in tracker._background._pending.values() if work is not never], 60.0)
            if i > 60 and i % 20 == 19:
                assert float(touch.center_of_pressure[0]) == pytest.approx(-3e-3 if (i // 20) % 2 else 3e-3, abs=3e-4)
                assert touch.force[2] == pytest.approx(1.0, abs=0.05)
