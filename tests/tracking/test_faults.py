"""A tracker fed with everything that sensors do wrong: never a foreign exception, never an old answer, unknown is NaN with a status."""

from __future__ import annotations

import itertools
import math
import time as clock
from concurrent.futures import wait
from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate import solutions
from palpate.bench.trust.rows import make_frame
from palpate.grasp import GraspMonitor
from palpate.inverse.contact.prepared import TooLarge
from palpate.sensing.uncertainty import EXACT
from palpate.status import Status
from palpate.tracking.health import Health, ReadingCheck

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
GEL = pp.BondedLayers([pp.Layer(thickness=8e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
THREE = ["stress_xz", "stress_yz", "stress_zz"]
BALL = solutions.hertz_point(contact_radius=2.5e-3, force=1.0)
NOISE = 30.0


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, pp.AreaArray(shape=(9, 9), pitch=1e-3, depth=1.5e-3, channels=THREE))


def on_cells(skin: pp.Skin) -> Any:
    """What traction that is even in the skin's cells reads: what is tested are faults, not what cells cannot follow."""
    return np.asarray(skin.sense(skin.sample(BALL)))


@pytest.fixture(scope="module")
def pressed(skin: pp.Skin) -> Any:
    return on_cells(skin)


@pytest.fixture(scope="module")
def small() -> pp.Skin:
    return pp.Skin(PAD, pp.AreaArray(shape=(6, 7), pitch=1.3e-3, depth=1.5e-3, channels=THREE))


def status(touch: pp.Touch) -> Status:
    assert touch.status is not None
    return Status.coded(int(touch.status))


def check(touch: pp.Touch) -> None:
    """Finite, or NaN with a status that says so."""
    values, known = np.asarray(touch.values), status(touch).known
    if status(touch) is Status.UNEXPLAINED:  # no number, and a bound
        assert np.isnan(values).all()
        assert np.isnan(touch.force).all()
        assert touch.has_intervals
        assert np.isfinite(touch.interval(0.95, "force")).all()
    elif status(touch) is Status.UNDECIDED:  # a number, bounds, or both
        assert np.isfinite(values).all() or np.isnan(values).all()
        assert np.isfinite(values).all() == touch.has_intervals or not np.isnan(touch.interval(0.95, "force")).any()
    elif known:
        assert np.isfinite(values).all()
    else:
        assert np.isnan(values).all()
        assert np.isnan(touch.force).all()
        assert np.isnan(float(touch.peak_pressure))
        assert any(status(touch).meaning in note for note in touch.notes)
        assert not touch.touching


# -- the cases that were found -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [0, 1, *long_runs(2, 3, 4, 5)])
@pytest.mark.parametrize("baseline", [0, 6])
@pytest.mark.long
def test_zero_frames_before_a_contact_that_grows(seed: int, baseline: int) -> None:
    """10 x 10 normal stresses at 2 mm in 8 mm of glued gel: the normal matrix was not positive definite in one of three."""
    skin = _glued()
    rng = np.random.default_rng(seed)
    truth = np.asarray(skin.sense(BALL))
    tracker = skin.track(baseline=baseline)
    for _ in range(6):
        assert not tracker.step(np.zeros_like(truth)).touching
    noise = 10.0 ** rng.uniform(-4, -1) * np.abs(truth).max()
    for force in np.linspace(0.02, 1.0, 12):
        touch = tracker.step(force * truth + noise * rng.standard_normal(truth.shape))
        check(touch)
        assert status(touch).known
    assert touch.force[2] == pytest.approx(1.0, abs=0.25)


_KEPT: list[pp.Skin] = []


def _glued() -> pp.Skin:
    if not _KEPT:
        _KEPT.append(pp.Skin(GEL, pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=2e-3, channels=["stress_zz"])))
    return _KEPT[0]


@pytest.mark.long
def test_readings_without_noise(skin: pp.Skin, pressed: Any) -> None:
    tracker = skin.track()
    for _ in range(3):
        touch = tracker.step(pressed)
        assert touch.force[2] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("back", [1.0, 1e-3])
@pytest.mark.long
def test_a_clock_that_restarts(skin: pp.Skin, pressed: Any, back: float) -> None:
    """Each frame after the restart is answered as itself, on the zero that was captured before."""
    rng = np.random.default_rng(0)
    offset = 300.0 * rng.standard_normal(pressed.shape)
    tracker = skin.track(baseline=10)
    for i in range(30):
        tracker.step(offset + (i >= 10) * pressed + NOISE * rng.standard_normal(pressed.shape), 5.0 + 0.01 * i)
    first = tracker.step(offset + 0.5 * pressed + NOISE * rng.standard_normal(pressed.shape), 5.29 - back)
    assert any("clock went back" in n for n in first.notes)
    assert first.force[2] == pytest.approx(0.5, abs=0.06)
    again = [
        tracker.step(offset + f * pressed + NOISE * rng.standard_normal(pressed.shape), 5.3 - back + 0.01 * i)
        for i, f in enumerate([0.5, 0.8, 1.0, 0.0, 0.0])
    ]
    np.testing.assert_allclose([float(t.force[2]) for t in again], [0.5, 0.8, 1.0, 0.0, 0.0], atol=0.06)
    assert tracker.health.restarts == 1
    assert "1 restarts" in str(tracker.health)


@pytest.mark.long
def test_two_frames_of_one_time_are_two_answers(skin: pp.Skin, pressed: Any) -> None:
    tracker = skin.track()
    rng = np.random.default_rng(0)
    noise = NOISE * rng.standard_normal((2, *pressed.shape))
    one, two = (tracker.step(f * pressed + n, 1.0) for f, n in zip((1.0, 0.4), noise))
    assert one.force[2] == pytest.approx(1.0, abs=0.06)
    assert two.force[2] == pytest.approx(0.4, abs=0.06)
    assert tracker.health.late == 1


@pytest.mark.long
def test_frames_without_readings_are_unknown(skin: pp.Skin, pressed: Any) -> None:
    """Not 0 N, no contact that ended; and the first good frame is answered again."""
    rng = np.random.default_rng(0)
    tracker, monitor = skin.track(friction=0.6), GraspMonitor(friction=0.6)
    for i in range(40):
        lost = 15 <= i < 25
        reading = pressed + NOISE * rng.standard_normal(pressed.shape)
        if lost:
            reading[:] = [math.nan, math.inf, -math.inf, 1e12][i % 4]
        touch = tracker.step(reading, 0.01 * i)
        check(touch)
        monitor.update(touch)
        assert (status(touch) is Status.MISSING) == (lost or not status(touch).known)
        if i < 15 or i == 39:
            assert touch.force[2] == pytest.approx(1.0, abs=0.06)
    assert tracker.health.unknown >= 10
    assert [e.began for e in monitor.events if e.kind == "contact"] == [True]


@pytest.mark.parametrize("part", [0.1, *long_runs(0.02, 0.3)])
@pytest.mark.long
def test_some_missing_taxels_are_left_out_of_that_frame(skin: pp.Skin, pressed: Any, part: float) -> None:
    """Other taxels in every frame, while the force changes: nothing is taken from the frame before.

    Filled by the contact before, 19 of 30 frames with 30 % missing were unexplained.
    """
    rng = np.random.default_rng(1)
    tracker = skin.track()
    for i in range(30):
        force = 1.0 if (i // 3) % 2 else 0.3
        reading = force * pressed + NOISE * rng.standard_normal(pressed.shape)
        reading[rng.random(pressed.shape) < part] = math.nan
        touch = tracker.step(reading)
        check(touch)
        low, high = touch.interval(0.95, "force")
        assert status(touch) is Status.SOLVED
        assert low[2] < force < high[2]
        assert touch.force[2] == pytest.approx(force, abs=0.08)


@pytest.mark.long
def test_a_sensor_that_freezes_says_so(skin: pp.Skin, pressed: Any) -> None:
    rng = np.random.default_rng(0)
    tracker = skin.track()
    for _ in range(30):
        reading = pressed + NOISE * rng.standard_normal(pressed.shape)
        assert status(tracker.step(reading)) is not Status.FROZEN
    last = [status(tracker.step(reading)) for _ in range(80)]
    assert last[10] is Status.SOLVED
    assert last[-1] is Status.FROZEN
    assert status(tracker.step(pressed + NOISE * rng.standard_normal(pressed.shape))) is Status.SOLVED


@pytest.mark.long
def test_missing_frames_while_the_zero_is_captured_do_not_count(skin: pp.Skin, pressed: Any) -> None:
    rng = np.random.default_rng(0)
    offset = 500.0 * rng.standard_normal(pressed.shape)
    tracker = skin.track(baseline=10)
    for i in range(20):
        reading = offset + NOISE * rng.standard_normal(pressed.shape)
        reading[0, 2, 2] = math.nan  # comes only after the zero
        if i % 2:
            reading[:] = math.nan
        touch = tracker.step(reading)
        assert status(touch) is (Status.MISSING if i % 2 else Status.CAPTURING_ZERO)
    for _ in range(60):
        assert not tracker.step(offset + NOISE * rng.standard_normal(pressed.shape)).touching
    touch = tracker.step(offset + pressed + NOISE * rng.standard_normal(pressed.shape))
    assert touch.force[2] == pytest.approx(1.0, abs=0.05)


@pytest.mark.long
def test_what_is_refused_leaves_the_tracker_as_it_was(skin: pp.Skin, pressed: Any) -> None:
    rng = np.random.default_rng(0)
    one, other = skin.track(), skin.track()
    for i in range(6):
        reading = pressed + NOISE * rng.standard_normal(pressed.shape)
        expected = one.step(reading, 0.01 * i)
        for bad, time in (
            (reading[:, :-1], 1.0),
            (reading.astype(complex), 1.0),
            (reading, math.nan),
            (reading, math.inf),
        ):
            with pytest.raises(pp.InvalidInput):
                other.step(bad, time)
        np.testing.assert_array_equal(other.step(reading, 0.01 * i).values, expected.values)
    assert other.health.frames == 6


@pytest.mark.long
def test_a_numerical_failure_is_a_status(skin: pp.Skin, pressed: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.tracking.iteration import Iteration

    def fail(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("broken on purpose")

    tracker = skin.track()
    rng = np.random.default_rng(0)
    frames = pressed + NOISE * rng.standard_normal((3, *pressed.shape))
    tracker.step(frames[0])
    with monkeypatch.context() as patch:
        patch.setattr(Iteration, "solve", fail)
        touch = tracker.step(frames[1])
        assert status(touch) is Status.FAILED
        check(touch)
    assert tracker.step(frames[2]).force[2] == pytest.approx(1.0, abs=0.06)


@pytest.mark.long
def test_creep_is_remembered_through_gaps() -> None:
    """A frame without readings and a clock that restarts do not disturb a creeping pad's memory."""
    soft = pp.Viscoelastic(PAD, [(0.3, 0.5)])
    array = pp.AreaArray(
        shape=(10, 10), pitch=1e-3, depth=0.0, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    skin = pp.Skin(soft, array)
    time = np.arange(40) / 20.0
    held = np.where((time > 0.2)[:, None, None, None], skin.sample(BALL)[None], 0.0)
    readings = np.asarray(skin.sense(held, time=time))
    readings += 1e-3 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)
    readings[20] = math.nan
    tracker = skin.track(rezero=None, rate=20.0)
    touches = [tracker.step(r, t if t < 1.5 else t - 1.5) for r, t in zip(readings, time)]
    assert status(touches[20]) is Status.MISSING
    forces = np.array([float(t.force[2]) for t in touches])
    np.testing.assert_allclose(np.delete(forces, 20)[6:], 1.0, atol=0.07)


@pytest.fixture
def own_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """A budget of time is told by how often it is looked at, 25 times a millisecond, whatever else the machine does."""
    looks = itertools.count()
    monkeypatch.setattr(clock, "perf_counter", lambda: 4e-5 * next(looks))


# -- faults at random ----------------------------------------------------------------------------------------------------------


def _faulty(skin: pp.Skin, pressed: Any, seed: int, frames: int) -> dict[str, int]:
    """A stream with every fault injected at random; answers that follow a clean frame are compared with its truth."""
    rng = np.random.default_rng(seed)
    budget = [None, 1e-3][seed % 2]
    tracker = skin.track(friction=[None, 0.6][seed % 3 == 0], baseline=int(rng.choice([0, 0, 5])), budget=budget)
    monitor = GraspMonitor(friction=0.6)
    time, counts = 0.0, dict.fromkeys(Status.__members__, 0)
    reading = np.zeros_like(pressed)
    loud = float(np.abs(pressed).max())
    with tracker:
        for i in range(frames):
            force = max(0.0, math.sin(0.05 * i)) if i > 8 else 0.0
            last, reading = reading, force * pressed + NOISE * rng.standard_normal(pressed.shape)
            time += 0.01
            fault = rng.choice(
                ["none"] * 12
                + ["taxels", "all", "inf", "zeros", "constant", "spike", "spikes", "back", "forward", "repeat", "clip"]
                + ["shape", "huge", "tiny", "single", "integer", "nan time", "same time"]
            )
            kind: Any = reading
            if fault == "taxels":
                reading[rng.random(reading.shape) < rng.uniform(0, 0.9)] = math.nan
            elif fault == "all":
                reading[:] = math.nan
            elif fault == "inf":
                reading[rng.random(reading.shape) < rng.uniform(0, 1)] = rng.choice([math.inf, -math.inf])
            elif fault == "zeros":
                reading[:] = 0.0
            elif fault == "constant":
                reading[:] = rng.choice([1.0, -5e3, 5e3, loud])
            elif fault == "spike":
                reading[tuple(int(rng.integers(n)) for n in reading.shape)] = rng.choice([-1, 1]) * 10 * loud
            elif fault == "spikes":
                reading[rng.random(reading.shape) < 0.2] *= 30.0
            elif fault == "back":
                time = rng.choice([0.0, time - 0.02, -1e9])
            elif fault == "forward":
                time += rng.choice([0.1, 60.0, 1e9])
            elif fault == "repeat":
                reading = last
            elif fault == "clip":
                np.clip(reading, -0.5 * loud, 0.5 * loud, out=reading)
            elif fault == "huge":
                reading[:] = rng.choice([1e300, -1e300, 1e30])
            elif fault == "tiny":
                reading *= 1e-300
            kind = reading
            if fault == "single":
                kind = reading.astype(np.float32)
            elif fault == "integer":
                kind = np.round(reading).astype(np.int32)
            if fault in ("shape", "nan time"):
                with pytest.raises(pp.InvalidInput):
                    tracker.step(kind[:, ::2] if fault == "shape" else kind, math.nan if fault == "nan time" else time)
                continue
            touch = tracker.step(kind, time - 0.01 if fault == "same time" else time)
            if budget is not None:
                wait(tracker._background._pending.values())  # as a stream that pauses: no race with the machine
            check(touch)
            assert float(touch.time) == (time - 0.01 if fault == "same time" else time)
            monitor.update(touch)
            counts[status(touch).name] += 1
        assert sum(counts.values()) == tracker.health.frames
        # whatever came before, a sensor that is well again is answered well again
        for i in range(160):
            clean = (i >= 100) * pressed + NOISE * rng.standard_normal(pressed.shape)
            touch = tracker.step(clean, time + 0.01 * (i + 1))
            if budget is not None:
                wait(
                    tracker._background._pending.values()
                )  # a stream pauses between its frames: no race with the machine
            if i < 150:
                continue
            if budget is None:
                assert status(touch) in (Status.SOLVED, Status.NOT_CONVERGED)
                if status(touch) is Status.SOLVED:
                    assert touch.force[2] == pytest.approx(1.0, abs=0.15)
            else:
                # a millisecond is too short for any frame: 0.9 to 4 N half a second later. What is promised of such frames is that their error bars hold (here to the 0.15 of above), and an end
                # to unfinished frames: without one it was 17 to 290 N. An unfinished frame may also be unexplained: it has no number
                if status(touch) is Status.UNEXPLAINED:
                    assert np.isnan(touch.force).all()
                    continue
                assert status(touch) in (Status.SOLVED, Status.NOT_CONVERGED, Status.NOT_PUSHING)
                low, high = touch.interval(0.95, of="force")
                assert low[2] - 0.15 < 1.0 < high[2] + 0.15
                assert 0.4 < touch.force[2] < 10.0
    return counts


@pytest.mark.parametrize(("friction", "force", "radius"), [(0.6, 1.0, 2.5e-3), (0.6, 2.0, 2.1e-3), (None, 1.0, 2.5e-3)])
def test_a_ball_on_cells_as_wide_as_taxels_are_deep(
    small: pp.Skin, friction: float | None, force: float, radius: float
) -> None:
    """Cells of 1.3 mm cannot follow a ball's readings to noise of 0.06 %: 4.1 N (2.6 to 4.6) was said for 1 N, 17.9 N (13 to 21) for 2 N.

    Without friction pressure and shear grow against each other where the taxels hardly tell: the interval knows.
    """
    clean = np.asarray(small.sense(solutions.hertz_point(contact_radius=radius, force=force).shifted(0.3e-3, -0.4e-3)))
    rng = np.random.default_rng(0)
    tracker = small.track(baseline=8, friction=friction)
    for i in range(20):
        touch = tracker.step((i > 8) * clean + NOISE * rng.standard_normal(clean.shape))
    low, high = (float(side[2]) for side in touch.interval(0.95, of="force"))
    assert status(touch) is Status.SOLVED
    assert low < force < high
    if friction is not None:
        assert touch.force[2] == pytest.approx(force, rel=0.2)
    assert float(touch.fit) > 0.01


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.filterwarnings("error")
@pytest.mark.usefixtures("own_time")
def test_faults_at_random(small: pp.Skin, seed: int) -> None:
    counts = _faulty(small, on_cells(small), seed, 120)
    assert counts["SOLVED"] + counts["NOT_CONVERGED"] > 20
    assert counts["MISSING"] > 3


@pytest.mark.long
@pytest.mark.parametrize("seed", [4, 6])
@pytest.mark.filterwarnings("error")
@pytest.mark.usefixtures("own_time")
def test_thousands_of_faults_at_random(skin: pp.Skin, pressed: Any, seed: int) -> None:
    counts = _faulty(skin, pressed, seed, 500)
    assert counts["FAILED"] == 0


def test_a_contact_right_in_the_middle_without_noise_is_not_at_a_ceiling() -> None:
    """Four taxels that read alike because the contact is symmetric: the interval was 0.34 to 1.15 N where there is 1 N."""
    array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2.2e-3, channels=["stress_zz"], noise=20.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array, uncertainty=EXACT)
    touch = skin.reconstruct(skin.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=1.0)))
    low, high = touch.interval(0.95, of="force")
    assert 0.95 < low[2] < high[2] < 1.05
    assert not any("end of their range" in note for note in touch.notes)


@pytest.mark.parametrize("seed", range(3, 9))
def test_a_dead_taxel_under_a_narrow_contact_is_left_out(seed: int) -> None:
    """A reading of exactly zero beside 17, 25, 21 and 9 kPa made so much noise that nothing was said to touch.

    The taxels beside it may feel a sharper contact right over it, too: then it says that it may be small, and the interval has room for both.
    """
    array = pp.LineArray(count=28, pitch=5e-3, depth=4.6e-3, channels=["stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.45), array)
    fine = pp.Skin(skin.pad, array, surface=pp.LineGrid(count=280, spacing=0.5e-3))
    readings = fine.sense(pp.solutions.hertz_line(half_width=8e-3, force=500.0).shifted(-12e-3))
    readings = readings + 0.01 * readings.max() * np.random.default_rng(seed).standard_normal(readings.shape)
    dead = int(np.argmax(readings[0]))
    readings[0, dead] = 0.0
    touch = skin.reconstruct(readings)
    low, high = touch.interval(0.95, of="force")
    assert low[1] < 500.0 < high[1]
    small = any(note.startswith("small contact") for note in touch.notes)
    assert small or float(touch.force[1]) == pytest.approx(500.0, rel=0.1)
    assert any(f"taxel ({dead},)" in note for note in touch.notes)


@pytest.mark.parametrize("seed", range(2))
def test_zeros_below_a_threshold_of_the_sensor_are_left_out_beside_a_load(seed: int) -> None:
    """Readings below a threshold come as zero. Where the neighbours say otherwise they are no measurement: taken as one, 1.76 of 2 N were found, with a pull."""
    array = pp.AreaArray(shape=(10, 10), pitch=2e-3, depth=2e-3, channels=["stress_zz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array)
    clean = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=8e-3, force=2.0)))
    readings = clean + 0.01 * clean.max() * np.random.default_rng(seed).standard_normal(clean.shape)
    touch = skin.reconstruct(np.where(readings < np.quantile(readings, 0.4), 0.0, readings))
    assert float(touch.force[2]) == pytest.approx(2.0, rel=0.03)
    low, high = touch.interval(0.95, of="force")
    assert low[2] < 2.0 < high[2]


def test_a_converter_that_rails_at_ten_peaks_beside_a_pull_is_answered() -> None:
    """Displacements of a line on a half-space have no datum, so that a shift of half the largest reading is no fault."""
    # its readings told less than nothing of common shear, by rounding: a matrix was not positive definite
    frame = make_frame("railed", 11, seed=733)
    touch = frame.skin.reconstruct(frame.readings, **({} if frame.friction is None else {"friction": frame.friction}))
    # the linear method answered 64 kN where shifts were limited to 0.4 of the largest reading
    low, high = touch.interval(0.95, "force")
    assert touch.force == pytest.approx(frame.load.force, rel=0.02)
    assert (low < frame.load.force).all()
    assert (frame.load.force < high).all()
    assert touch.fit > 0.01
    assert any("displacement_x at taxel (0,)" in note for note in touch.notes)


@pytest.mark.parametrize("error", [np.linalg.LinAlgError, TooLarge])
def test_a_failure_of_the_comparison_is_a_status(
    error: type[Exception], small: pp.Skin, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A contact with too many unknowns ended the stream of 24 x 24 sideways markers whose image had moved."""

    def fail(*_: object, **__: object) -> None:
        raise error("broken on purpose")

    tracker = small.track()
    frames = on_cells(small) + NOISE * np.random.default_rng(0).standard_normal((3, 3, 6, 7))
    tracker.step(frames[0])
    with monkeypatch.context() as patch:
        patch.setattr(type(tracker), "_compare", fail)
        touch = tracker.step(frames[1])
        assert status(touch) is Status.FAILED
        assert ("broken on purpose" in touch.notes) == (error is TooLarge)
        check(touch)
    assert status(tracker.step(frames[2])) is Status.SOLVED


def test_a_saturated_reading_that_is_left_out_is_no_bound() -> None:
    """A stuck reading has no value (NaN), but its raw value was equal to the ceiling: a contact that began then had no cells."""
    flat = np.r_[np.linspace(100.0, 900.0, 20), 1e3, 1e3, 1e3, 1e3]
    n, index = len(flat), np.zeros(len(flat), dtype=np.intp)
    health = Health(left_out=np.zeros(n, dtype=bool), reasons=np.zeros(n, dtype="<U12"), label=str)
    check = ReadingCheck(health, np.full(n, 1e6), None, np.ones(n))
    y = flat.copy()
    y[-1] = np.nan
    assert np.isfinite(check.zeroed(y, flat + 1e-9, index, 1.0)).all()
    np.testing.assert_array_equal(np.flatnonzero(check.clipped), [n - 4, n - 3, n - 2])
