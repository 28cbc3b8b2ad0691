"""Newtons from presses of which something is known. Readings come from closed forms: Boussinesq's point load and Hertz's pressure, not from the forward model."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from calibrate_scenes import PAD, ball, bench, taxels
from palpate import grasp
from palpate.calibrate import FORCE_ONLY_NOTE, Weight, calibrate, find_delay, read_calibration, write_calibrated
from palpate.calibrate.regressions import ridge
from palpate.errors import InvalidInput, NotObservable, Unsupported
from palpate.status import Status


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    return pp.Skin(PAD, taxels())


@pytest.fixture(scope="module")
def calibrated(skin: pp.Skin) -> pp.Skin:
    readings, force, _ = bench(12, 3)
    readings, force = np.concatenate([np.zeros((1, 1, 4, 4)), readings]), np.r_[0.0, force]
    return skin.calibrate(readings, reference=force)


@pytest.mark.long
def test_three_weights_tell_newtons(skin: pp.Skin) -> None:
    """Three labelled presses of sixteen taxels: 0.4 of the error of a linear regression, and intervals that hold the force."""
    error, linear, inside = [], [], []
    for seed in range(3):
        readings, force, _ = bench(3, 100 + seed)
        test, known, _ = bench(20, 5100 + seed)
        found = calibrate(skin, readings, reference=force)
        value, std = found.force(test.reshape(20, -1))
        error += list(np.abs(value[:, 2] - known))
        inside += list(np.abs(value[:, 2] - known) < 2.6 * std[:, 2])
        linear += list(np.abs(ridge(readings.reshape(3, -1), force, test.reshape(20, -1)) - known))
    assert np.mean(error) < 0.6 * np.mean(linear)
    assert np.mean(inside) >= 0.9


@pytest.mark.long
def test_unit_of_readings_does_not_matter(skin: pp.Skin) -> None:
    readings, force, _ = bench(6, 7)
    test = bench(5, 8)[0]
    values = [
        calibrate(skin, u * readings, reference=force).force(u * test.reshape(5, -1))[0][:, 2] for u in (1.0, 1e6)
    ]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-4)


@pytest.mark.long
def test_many_labels_are_a_regression(skin: pp.Skin) -> None:
    """A sensor of no pad at all: force is an odd linear map of the readings, which physics calls unlikely."""
    rng = np.random.default_rng(0)
    mixed = rng.normal(size=(160, 16))
    force = mixed @ rng.normal(size=16) + 0.01 * rng.normal(size=160)
    found = calibrate(skin, mixed[:120].reshape(-1, 1, 4, 4), reference=force[:120])
    value, _ = found.force(mixed[120:])
    plain = ridge(mixed[:120], force[:120], mixed[120:])
    assert np.abs(value[:, 2] - force[120:]).mean() < 1.1 * np.abs(plain - force[120:]).mean() + 1e-3
    assert not found.elastic
    assert any("no pressure map" in s for s in found.said)


def test_force_is_zero_at_rest(calibrated: pp.Skin) -> None:
    touch = calibrated.reconstruct(np.zeros((1, 4, 4)))
    low, high = touch.interval(0.95, "force")
    assert abs(float(touch.force[2])) < 0.05
    assert low[2] < 0.0 < high[2]


@pytest.mark.long
def test_the_elastic_model_holds_and_its_unit_is_found(calibrated: pp.Skin) -> None:
    found = calibrated.calibration
    assert found is not None
    assert found.elastic
    assert found.unit == pytest.approx(41.0, rel=0.3)  # depth is 13 % more than said
    readings, force, _ = bench(1, 5003)
    touch = calibrated.reconstruct(readings[0])
    low, high = touch.interval(0.95, "force")
    assert low[2] < force[0] < high[2]
    assert float(touch.pressure.max()) > 0.0
    assert "Forces and stress do not tell the modulus" in " ".join(found.said)


@pytest.mark.long
def test_markers_that_move_sideways_alone_are_tracked() -> None:
    array = pp.AreaArray(shape=(4, 4), pitch=2e-3, depth=2e-3, channels=["displacement_x", "displacement_y"])
    gel = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array)
    unit = pp.solutions.hertz_point(force=1.0, contact_radius=2e-3).fields(
        gel.pad, array.channels, array.points[:, 0], array.points[:, 1], 2e-3
    )
    rng = np.random.default_rng(0)
    force = np.array([0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 1.5])
    presses = force[:, None, None, None] * unit.reshape(2, 4, 4) + 1e-7 * rng.standard_normal((len(force), 2, 4, 4))
    found = gel.calibrate(presses, reference=force)
    assert found.calibration is not None
    assert not found.calibration.elastic
    with found.track(baseline=3) as tracker:
        for frame in presses[:3]:
            tracker.step(frame)
        touch = tracker.step(presses[4])
    low, high = touch.interval(0.95, "force")
    assert low[2] < 2.0 < high[2]
    assert float(touch.force[2]) == pytest.approx(2.0, rel=0.05)
    assert FORCE_ONLY_NOTE in touch.notes
    with pytest.raises(Unsupported, match="seek z too"):
        found.track(components=["x", "y"])


@pytest.mark.long
def test_twenty_weights_make_intervals_of_the_size_of_the_errors(skin: pp.Skin) -> None:
    widths, errors, inside = [], [], []
    for seed in range(4):
        readings, force, _ = bench(60, 9000 + seed)
        found = calibrate(skin, readings[:20], reference=force[:20])
        value, std = found.force(readings[20:].reshape(40, -1))
        half = 2.2 * std[:, 2]
        errors.append(np.abs(value[:, 2] - force[20:]).mean())
        widths.append(half.mean())
        inside.append((np.abs(value[:, 2] - force[20:]) < half).mean())
    assert np.mean(inside) > 0.9
    assert np.mean(widths) < 6.0 * np.mean(errors)


def test_a_press_far_beyond_the_labels_is_a_guess_however_well_they_agree(calibrated: pp.Skin) -> None:
    found = calibrated.calibration
    assert found is not None
    readings, _, _ = bench(12, 3)
    largest = readings[np.abs(readings).max(axis=(1, 2, 3)).argmax()].reshape(1, -1)
    value, std = found.force(np.concatenate([largest, 10.0 * largest]))
    assert std[1, 2] > 0.5 * value[1, 2]
    assert found.maps["fz"].unlike(10.0 * largest) > 0.8


def test_a_rejected_model_gives_force_alone(calibrated: pp.Skin) -> None:
    found = calibrated.calibration
    assert found is not None
    alone = pp.Skin(PAD, taxels())
    alone._calibration = dataclasses.replace(found, unit=float("nan"))
    readings, force, _ = bench(2, 5003)
    touch = alone.reconstruct(readings)
    assert np.isnan(np.asarray(touch.pressure)).all()
    assert FORCE_ONLY_NOTE in touch.notes
    assert float(touch.force[0, 2]) == pytest.approx(force[0], rel=0.2)
    assert np.isfinite(touch.table()["force_z_high (N)"]).all()
    assert "net force z" in touch[0].summary()
    missing = readings.copy()
    missing[1, 0, 0, 0] = np.nan
    touch = alone.reconstruct(missing)
    assert Status.coded(int(touch.status[1])) is Status.MISSING
    assert np.isnan(touch.force[1]).all()
    with pytest.raises(NotObservable, match="friction is an option of the elastic model"):
        alone.reconstruct(readings, friction=0.5)


@pytest.mark.long
def test_track_takes_its_own_zero(calibrated: pp.Skin) -> None:
    readings = bench(4, 5003)[0]
    rng = np.random.default_rng(1)
    with calibrated.track(baseline=10) as tracker:
        for _ in range(10):
            tracker.step(7.0 + 0.01 * rng.standard_normal((1, 4, 4)))
        touches = [tracker.step(7.0 + r) for r in readings]
    expected = np.asarray(calibrated.reconstruct(readings).force)[:, 2]
    assert [float(t.force[2]) for t in touches] == pytest.approx(expected, rel=0.05, abs=0.05)


@pytest.mark.long
def test_places_tell_the_centre(skin: pp.Skin) -> None:
    readings, force, place = bench(40, 11)
    found = calibrate(skin, readings, reference={"fz": force, "x": place[:, 0], "y": place[:, 1]})
    test, _, known = bench(20, 5011)
    value, std = found.force(test.reshape(20, -1))
    center = found.center(test.reshape(20, -1), value, std)
    assert center is not None
    assert np.abs(center[0] - known).mean() < 1e-3
    assert np.mean(np.abs(center[0] - known) < 2.5 * center[1]) > 0.85


@pytest.mark.long
def test_weights_in_words(skin: pp.Skin) -> None:
    readings, force, _ = bench(3, 21)
    time = np.arange(0.0, 40.0, 0.1)
    frames = np.zeros((len(time), 1, 4, 4))
    said = ["0 g, 0 s to 5 s"]
    for k in range(3):
        frames[(time >= 10 * k + 8) & (time < 10 * k + 14)] = readings[k]
        said.append(f"{1e3 * force[k] / 9.80665:.6f} g, {10 * k + 9} s to {10 * k + 13} s")
    frames += 3.0 + 0.001 * np.random.default_rng(0).standard_normal(frames.shape)
    recording = pp.Recording(readings=frames, channels=["stress_zz"], time=time)
    found = calibrate(skin, recording, weights=said)
    value, _ = found.force(readings.reshape(3, -1))
    assert value[:, 2] == pytest.approx(force, rel=0.1)
    assert len(found.maps["fz"].process.values) == 4  # one label a weight
    with pytest.raises(InvalidInput, match="no frame lies"):
        calibrate(skin, recording, weights=["200 g, 100 s to 120 s"])


@pytest.mark.parametrize(
    "text", ["200 g", "200, 1 s to 2 s", "200 g, 2 s to 1 s", "-5 g, 1 s to 2 s", "200 stone, 1 s to 2 s", ""]
)
def test_weights_that_cannot_be_read(text: str) -> None:
    with pytest.raises(InvalidInput, match="weight"):
        Weight.parse(text)


@pytest.mark.long
def test_delay_between_clocks(skin: pp.Skin) -> None:
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 30.0, 0.02)
    load = np.maximum(np.sin(0.9 * time) + 0.4 * np.sin(2.3 * time), 0.0)
    frames = load[:, None, None, None] * ball(1.0)[None] + 0.2 * rng.standard_normal((len(time), 1, 4, 4))
    clock = np.arange(-1.0, 31.0, 0.011) - 0.43
    force = np.interp(clock + 0.43, time, load)
    assert find_delay(time, frames.reshape(len(time), -1), clock, force) == pytest.approx(0.43, abs=0.01)
    found = calibrate(skin, frames, time=time, reference=force, reference_time=clock, labels=40)
    assert any("0.43 s behind" in s for s in found.said)
    with pytest.raises(InvalidInput, match="overlap too little"):
        calibrate(skin, frames, time=time, reference=force, reference_time=clock + 1000.0)


@pytest.mark.long
def test_calibration_travels_in_files(calibrated: pp.Skin, tmp_path: Path) -> None:
    (tmp_path / "skin.toml").write_text(
        '[pad]\nkind = "half_space"\nyoungs_modulus = "200 kPa"\npoissons_ratio = 0.48\n\n[[plane]]\nkind = "area"\nshape = [4, 4]\npitch = "4 mm"\ndepth = "3 mm"\nchannels = ["stress_zz"]\n'
    )
    found = calibrated.calibration
    assert found is not None
    path, numbers = write_calibrated(tmp_path / "calibrated.toml", tmp_path / "skin.toml", found)
    again = pp.Skin.from_file(path)
    readings = bench(3, 5003)[0]
    for quantity in (
        lambda s: np.asarray(s.reconstruct(readings).force),
        lambda s: np.asarray(s.reconstruct(readings).interval(0.95, "force")),
    ):
        np.testing.assert_allclose(quantity(again), quantity(calibrated), rtol=1e-6, atol=1e-9)
    assert again.calibration is not None
    assert str(again.calibration) == str(found)
    # a calibration of a calibrated file replaces its section
    write_calibrated(tmp_path / "twice.toml", path, found)
    assert (tmp_path / "twice.toml").read_text().count("[calibration]") == 1
    assert read_calibration(tmp_path / "twice.toml") is not None
    numbers.write_bytes(numbers.read_bytes()[:200])
    with pytest.raises(InvalidInput, match="damaged"):
        pp.Skin.from_file(path)
    numbers.unlink()
    with pytest.raises(InvalidInput, match="not beside it"):
        pp.Skin.from_file(path)


@pytest.mark.long
def test_touch_of_a_calibration_travels_in_files(calibrated: pp.Skin, tmp_path: Path) -> None:
    from palpate.recordings import read_touch, write_touch
    from palpate.recordings.labelled import touch_of

    touch = calibrated.reconstruct(bench(2, 5003)[0])
    write_touch(touch, tmp_path / "touch.nc")
    again = touch_of(read_touch(tmp_path / "touch.nc"))
    np.testing.assert_allclose(np.asarray(again.force), np.asarray(touch.force))
    np.testing.assert_allclose(again.interval(0.95, "force"), touch.interval(0.95, "force"))


@pytest.mark.parametrize(("gain", "word"), [(1.0, "no sign of ageing"), (0.6, "the sensor has aged")])
@pytest.mark.long
def test_ageing(calibrated: pp.Skin, gain: float, word: str) -> None:
    readings, force, _ = bench(8, 4003)
    later = calibrated.calibrate(gain * readings, reference=force, again=True)
    assert later.calibration is not None
    assert any(word in s for s in later.calibration.said)
    assert len(later.calibration.maps["fz"].process.values) == 13 + 8


@pytest.mark.long
def test_a_silent_taxel_is_named(skin: pp.Skin) -> None:
    readings, force, _ = bench(12, 3)
    readings[:, 0, 1, 2] = 0.0
    found = calibrate(skin, readings, reference=force)
    assert any("stress_zz of taxel 6" in s for s in found.said)


def test_what_cannot_be_calibrated(skin: pp.Skin) -> None:
    readings, force, place = bench(3, 1)
    cases = [
        ({}, "no force is known"),
        ({"reference": force[:2]}, "2 values for 3 frames"),
        ({"reference": 0.0 * force}, "all known forces are zero"),
        ({"reference": np.full(3, np.nan)}, "no force is known"),
        ({"reference": {"force": force}}, "reference names force"),
        ({"reference": {"x": place[:, 0]}}, "no force is known"),
        ({"reference": force, "labels": 0}, "labels must be"),
        ({"reference": force, "baseline": 3}, "baseline must be"),
        ({"weights": ["200 g, 0 s to 1 s"]}, "weights have times"),
        ({"reference": force, "reference_time": [0.0, 1.0, 2.0]}, "reference_time needs times"),
    ]
    for options, words in cases:
        with pytest.raises(InvalidInput, match=words):
            calibrate(skin, readings, **options)
    with pytest.raises(InvalidInput, match="all labelled readings are zero"):
        calibrate(skin, 0.0 * readings, reference=force)
    with pytest.raises(InvalidInput, match="axes"):
        calibrate(skin, readings[0], reference=force)


def test_other_taxels_need_another_calibration(calibrated: pp.Skin) -> None:
    mask = np.ones((4, 4), dtype=bool)
    mask[0, 0] = False
    with pytest.raises(InvalidInput, match="is for 16 readings"):
        calibrated.masked(mask).reconstruct(np.zeros((1, 4, 4)))
    with pytest.raises(InvalidInput, match="is for 16 readings"):
        calibrated.masked(mask).track()


@pytest.mark.long
def test_lines_have_no_physics_but_a_map() -> None:
    skin = pp.Skin(PAD, pp.LineArray(count=5, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    rng = np.random.default_rng(2)
    readings = rng.uniform(0.0, 1.0, (30, 1, 5))
    found = calibrate(skin, readings, reference=readings.sum(axis=(1, 2)))
    assert found.force(readings[:2].reshape(2, 5))[0][:, 2] == pytest.approx(readings[:2].sum(axis=(1, 2)), rel=0.05)


@pytest.mark.long
def test_the_command_line(tmp_path: Path) -> None:
    """From a table of counts with a force sensor on its own clock to forces of another table."""
    pytest.importorskip("typer")
    from command_line import run

    (tmp_path / "skin.toml").write_text(
        '[pad]\nkind = "half_space"\nyoungs_modulus = "200 kPa"\npoissons_ratio = 0.48\n\n[[plane]]\nkind = "area"\nshape = [4, 4]\npitch = "4 mm"\ndepth = "3 mm"\nchannels = ["stress_zz"]\n\n[columns]\ntime = "t"\nstress_zz = "S{}"\nunit = "1 Pa"\n'
    )
    readings, force, _ = bench(10, 3)
    time = np.arange(0.0, 22.0, 0.1)
    load, frames = np.zeros(len(time)), np.zeros((len(time), 16))
    for k in range(10):
        at = (time >= 2 * k + 2) & (time < 2 * k + 3)
        load[at], frames[at] = force[k], readings[k].ravel()
    frames += 500.0 + 0.5 * np.random.default_rng(0).standard_normal(frames.shape)
    titles = "t," + ",".join(f"S{i}" for i in range(16)) + ",Fz"
    np.savetxt(tmp_path / "bench.csv", np.c_[time, frames, -load], delimiter=",", header=titles, comments="")
    done = run(
        "calibrate",
        "bench.csv",
        "--skin",
        "skin.toml",
        "--reference",
        "fz=-Fz",
        "--report",
        "report.png",
        "--labels",
        "40",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "presses that were left out" in done.stdout
    assert (tmp_path / "report.png").stat().st_size > 10_000
    done = run(
        "reconstruct",
        "bench.csv",
        "--skin",
        "calibrated.toml",
        "--baseline",
        "10",
        "--frame",
        "45",
        "--out",
        "one.nc",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    found = float(done.stdout.split("net force z")[1].split("N")[0])
    assert found == pytest.approx(force[1], rel=0.15)
    # another day: all readings are a fifth lower, and one weight tells that
    today = np.c_[time, frames - 0.2 * (frames - 500.0), -load]
    np.savetxt(tmp_path / "day.csv", today, delimiter=",", header=titles, comments="")
    weights = [f"--weight={f} N, {2 * k + 2} s to {2 * k + 3} s" for k, f in enumerate(force[:3])]
    done = run(
        "calibrate",
        "day.csv",
        "--skin=calibrated.toml",
        "--this-run",
        "--weight=0 N, 0 s to 1 s",
        *weights,
        "--out=today.toml",
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "this run: forces are 1.2" in done.stdout
    done = run(
        "reconstruct", "day.csv", "--skin=today.toml", "--baseline=10", "--frame=105", "--out=d.nc", cwd=tmp_path
    )
    assert float(done.stdout.split("net force z")[1].split("N")[0]) == pytest.approx(force[4], rel=0.15)
    # a recording that begins under load has no frames for a zero: that of the calibration serves
    pressed = np.c_[time, frames, -load][42:48]
    np.savetxt(tmp_path / "pressed.csv", pressed, delimiter=",", header=titles, comments="")
    for command in (("reconstruct", "--frame", "3", "--out", "two.nc"), ("track", "--out", "two.csv")):
        done = run(command[0], "pressed.csv", "--skin", "calibrated.toml", *command[1:], cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "that of the calibration" in done.stdout
        if command[0] == "reconstruct":
            found = float(done.stdout.split("net force z")[1].split("N")[0])
        else:
            text = (tmp_path / "two.csv").read_text()
            rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
            found = float(rows[-1][next(i for i, name in enumerate(rows[0]) if name.startswith("force_z"))])
        assert found == pytest.approx(force[1], rel=0.15)
    for words, arguments in (
        ("say what is known", ()),
        ("no column 'Fy'", ("--reference", "fz=Fy")),
        ("must name columns", ("--reference", "pressure=Fz")),
        ("has none: leave it out", ("--reference", "fz=Fz", "--again")),
        ("--reference-file needs --reference", ("--reference-file", "bench.csv", "--weight", "1 g, 0 s to 1 s")),
    ):
        done = run("calibrate", "bench.csv", "--skin", "skin.toml", "--out", "other.toml", *arguments, cwd=tmp_path)
        assert done.returncode == 2
        assert words in done.stderr


def test_a_monitor_takes_a_force_without_a_map_of_pressure() -> None:
    """Where a calibration alone tells the force, no cell presses: a twist was asked of it and divided by zero."""
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    skin = pp.Skin(
        pad,
        pp.AreaArray(
            shape=(4, 4), pitch=2e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=10.0
        ),
    )
    touch = skin.reconstruct(skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=1.0)))
    turning, std = grasp._twist(touch, np.zeros_like(np.asarray(touch.values)))
    assert np.isnan(turning)
    assert std == 0.0


@pytest.mark.long
def test_a_force_sensor_without_a_reading_is_no_label(skin: pp.Skin) -> None:
    """A load cell writes -1 where it has nothing to say; forces that are read then are not pulls."""
    readings, force, _ = bench(30, 8)
    test, known, _ = bench(20, 5008)
    said = force.copy()
    said[[3, 9, 14, 20]] = -1.0
    found = calibrate(skin, readings, reference=said)
    assert any("fz is exactly -1 N in 4 samples" in s for s in found.said)
    value, _ = found.force(test.reshape(20, -1))
    kept = np.delete(np.arange(30), [3, 9, 14, 20])
    same, _ = calibrate(skin, readings[kept], reference=force[kept]).force(test.reshape(20, -1))
    np.testing.assert_allclose(value, same)
    assert np.abs(value[:, 2] - known).mean() < 0.5


@pytest.mark.long
def test_a_force_sensor_without_a_reading_on_a_clock_of_its_own(skin: pp.Skin) -> None:
    """Every second sample is -1, as of a load cell that answers half as often as it is asked; nothing of it is mixed into the forces between."""
    time = np.arange(0.0, 30.0, 0.05)
    load = 2.0 + 1.9 * np.sin(0.7 * time) + 0.05 * np.sin(13.0 * time)
    readings = load[:, None, None, None] * ball(1.0, 1e-3)[None]
    clock = np.arange(0.2, 29.0, 0.03)
    forces = np.interp(clock, time, load)
    forces[::2] = -1.0
    bench = pp.Recording(readings=readings, channels=["stress_zz"], time=time)
    found = calibrate(skin, bench, reference=forces, reference_time=clock, baseline=0)
    assert any("fz is exactly -1 N in 481 samples" in s for s in found.said)
    labels = found.maps["fz"].process.values
    assert labels.min() > 0.0
    value, _ = found.force(readings[200:300].reshape(100, -1))
    np.testing.assert_allclose(value[:, 2], load[200:300], rtol=0.05)


@pytest.mark.long
def test_a_force_at_the_end_of_its_sensor_is_no_label(skin: pp.Skin) -> None:
    readings, force, _ = bench(30, 9)
    found = calibrate(skin, readings, reference=np.minimum(force, 3.0))
    assert any("fz is exactly 3 N" in s for s in found.said)


@pytest.mark.long
def test_weights_written_by_hand_are_labels(skin: pp.Skin) -> None:
    """200 and 500 g, each at six places: the largest force comes again, and is no fault."""
    places = np.random.default_rng(3).uniform(-5e-3, 5e-3, (12, 2))
    force = np.repeat([1.96, 4.9], 6)
    found = calibrate(skin, np.stack([ball(f, *p) for f, p in zip(force, places)]), reference=force)
    assert not any("exactly" in s for s in found.said)
    assert len(found.maps["fz"].process.values) == 12


@pytest.mark.long
def test_presses_unlike_any_label_have_room_and_a_word(skin: pp.Skin) -> None:
    """Labels of small forces near one place say little of other places and of large forces; those of many places say more."""
    near = [(f, x, y) for f in (0.5, 0.7, 1.0) for x in (-4.2e-3, -3.8e-3) for y in (-0.2e-3, 0.2e-3)]
    wide = [(f, x, y) for f in (0.5, 1.0) for x in (-4e-3, 0.0, 4e-3) for y in (-4e-3, 0.0, 4e-3)]
    found = [
        calibrate(skin, np.stack([ball(*p) for p in at]), reference=np.array([p[0] for p in at])) for at in (near, wide)
    ]
    here, there, large = (np.asarray([p.ravel()]) for p in (ball(0.8, -4e-3), ball(0.8, 2e-3, 2e-3), ball(3.0, -4e-3)))
    here_, there_, large_ = (float(found[0].maps["fz"].novelty(f)[0]) for f in (here, there, large))
    assert here_ < 0.3
    assert min(there_, large_) > 0.5
    assert float(found[1].maps["fz"].novelty(there)[0]) < 0.75 * there_
    touch = found[0].alone(there, skin.surface, np.zeros(0))
    assert any("differ from those of all labelled presses" in s for s in touch.assumptions)
    low, high = touch.interval(0.95, "force")
    assert low[0, 2] < 0.8 < high[0, 2]


@pytest.mark.long
def test_a_second_run_tells_how_gains_differ(skin: pp.Skin) -> None:
    """From one recording 8 % between runs are assumed and said; two alike, or 40 % apart, are believed in part."""
    readings, force, _ = bench(24, 11)
    one = calibrate(skin, readings, reference=force)
    assert any("all labels are of one recording" in s for s in one.said)
    alike = calibrate(skin, [readings[:12], readings[12:]], reference=[force[:12], force[12:]])
    apart = calibrate(skin, [readings[:12], 1.4 * readings[12:]], reference=[force[:12], force[12:]])
    assert not any("all labels are of one recording" in s for s in alike.said)
    shares = [c.maps["fz"].run_share for c in (alike, one, apart)]
    assert shares[0] < shares[1] < shares[2]


@pytest.mark.long
def test_a_stream_of_a_calibrated_skin_needs_no_zero_where_its_readings_have_one(skin: pp.Skin) -> None:
    """Readings without their zero, and no frame of rest named: a press that stays is not drift of the zero."""
    rng = np.random.default_rng(4)
    readings, force, _ = bench(14, 12, unit=41.0)
    rest = 1e-3 * np.abs(readings).max() * rng.standard_normal((8, 1, 4, 4))
    found = skin.calibrate(np.concatenate([rest, readings]), reference=np.r_[np.zeros(8), force])
    press = ball(4.0, 1e-3, depth=3.4e-3) / 41.0
    tracker = found.track()
    for _ in range(5):
        tracker.step(rest[0])
    assert (
        Status.coded(int(tracker.step(rest[1]).status)) is Status.NO_CONTACT
    )  # its noise is that of the calibration's rest
    forces = [float(tracker.step(min(1.0, 0.1 * i) * press + rest[i % 8]).force[2]) for i in range(60)]
    assert forces[-1] == pytest.approx(4.0, rel=0.2)


@pytest.mark.long
def test_the_zero_of_a_calibration_serves_where_none_is_taken(skin: pp.Skin, tmp_path: Path) -> None:
    """Raw counts with an offset, and a stream that begins under load: by the calibration's own zero, its scatter in the interval."""
    readings, force, _ = bench(16, 21)
    rng = np.random.default_rng(2)
    noise = 0.003 * np.abs(readings).max()
    offset = 500.0 + 20.0 * rng.standard_normal((1, 4, 4))
    rest = offset + noise * rng.standard_normal((12, 1, 4, 4))
    found = skin.calibrate(np.concatenate([rest, offset + readings]), reference=np.r_[np.zeros(12), force])
    (tmp_path / "skin.toml").write_text("[pad]\n")
    write_calibrated(tmp_path / "calibrated.toml", tmp_path / "skin.toml", found.calibration)
    kept = read_calibration(tmp_path / "calibrated.toml")
    assert kept is not None
    assert kept.zero == pytest.approx(offset, abs=2.0 * noise)
    assert 0.3 * noise < float(np.median(kept.zero_std)) < 3.0 * noise
    new = ball(3.0, 1e-3, 1e-3, depth=3.4e-3) / 41.0 * (1.0 + 0.1 * np.random.default_rng(21).normal(size=(1, 4, 4)))
    with found.track(zero=kept.zero) as tracker:
        touch = tracker.step(offset + new)
    assert float(touch.force[2]) == pytest.approx(3.0, rel=0.2)
    flat = new.reshape(1, -1)
    own, opened = (c.force(flat)[1][0, 2] for c in (kept, kept.opened()))
    assert opened > own
    with found.track(zero=np.asarray(kept.zero) + 0.0 * noise) as tracker:
        assert tracker.calibration.open_zero


@pytest.mark.long
def test_a_press_that_grows_while_the_zero_is_taken(skin: pp.Skin) -> None:
    """Half of the press in the zero took half of every force; the zero of the calibration serves instead, and that is said."""
    readings, force, _ = bench(16, 21)
    rng = np.random.default_rng(3)
    noise = 0.003 * np.abs(readings).max()
    rest = noise * rng.standard_normal((12, 1, 4, 4))
    found = skin.calibrate(np.concatenate([rest, readings]), reference=np.r_[np.zeros(12), force])
    press = ball(4.0, 1e-3, depth=3.4e-3) / 41.0 * (1.0 + 0.1 * np.random.default_rng(21).normal(size=(1, 4, 4)))
    with found.track(baseline=20) as tracker:
        for i in range(60):
            touch = tracker.step(min(1.0, max(i - 8, 0) / 24) * press + noise * rng.standard_normal((1, 4, 4)))
        assert float(touch.force[2]) == pytest.approx(4.0, rel=0.2)
        assert any("the zero of the calibration serves instead" in n for n in touch.assumptions)
        tracker.rezero(frames=10)
        for _ in range(14):
            touch = tracker.step(noise * rng.standard_normal((1, 4, 4)))
        assert not any("the zero of the calibration" in n for n in touch.assumptions)
        assert not tracker.calibration.open_zero


def test_delay_between_clocks_where_readings_outnumber_frames() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(24.0)
    force = np.where(time < 8, 0.0, rng.uniform(0.5, 4.0, 24))
    maps = rng.standard_normal(90)
    readings = force[:, None] * maps + 0.01 * rng.standard_normal((24, 90))
    clock = np.linspace(-1.0, 25.0, 500)
    late = np.interp(clock + 0.3, time, force)
    assert find_delay(time, readings, clock, late) == pytest.approx(0.3, abs=0.05)


@pytest.mark.long
def test_a_press_that_stands_through_the_zero_is_told_by_the_kept_zero(skin: pp.Skin) -> None:
    readings, force, _ = bench(16, 21)
    rng = np.random.default_rng(3)
    noise = 0.003 * np.abs(readings).max()
    rest = 500.0 + noise * rng.standard_normal((12, 1, 4, 4))
    found = skin.calibrate(np.concatenate([rest, 500.0 + readings]), reference=np.r_[np.zeros(12), force])
    press = ball(4.0, 1e-3, depth=3.4e-3) / 41.0 * (1.0 + 0.1 * np.random.default_rng(21).normal(size=(1, 4, 4)))
    for weight, said in ((1.0, True), (0.0, False)):
        with found.track(baseline=10) as tracker:
            for _ in range(14):
                frame = 500.0 + weight * press + noise * rng.standard_normal((1, 4, 4))
                touch = tracker.step(frame)
        words = [n for n in touch.assumptions if "differs from that of the calibration" in n]
        assert bool(words) is said
        if said:
            newtons = float(words[0].split("fz = ")[1].split(" N")[0])
            assert newtons == pytest.approx(4.0, rel=0.2)


@pytest.mark.long
def test_drift_of_the_zero_while_calibrating_widens_the_intervals_of_that_zero(skin: pp.Skin) -> None:
    readings, force, _ = bench(16, 21)
    rng = np.random.default_rng(4)
    noise = 0.003 * np.abs(readings).max()
    size = 0.05 * np.abs(readings).max()
    count = len(readings)
    known = np.r_[np.zeros(10), force, np.zeros(10)]
    std, wide = [], []
    for drift in (0.0, size):
        frames = np.concatenate([np.zeros((10, 1, 4, 4)), readings, np.zeros((10, 1, 4, 4))])
        frames = frames + drift * np.linspace(0.0, 1.0, count + 20)[:, None, None, None]
        frames = frames + noise * rng.standard_normal(frames.shape)
        made = skin.calibrate(frames, reference=known).calibration
        assert made is not None
        std.append(float(np.median(made.zero_std)))
        wide.append(float(made.opened().force(readings[0].reshape(1, -1))[1][0, 2]))
    assert std[0] < 3.0 * noise
    assert 0.5 * size < std[1] < 1.5 * size
    assert wide[1] > wide[0]


@pytest.mark.long
def test_coarse_counts_that_are_alike_by_chance_are_no_overload() -> None:
    """Five magnetometers in steps of 2.4 counts: two of one channel are often the largest. Labelled presses gave larger readings."""
    array = pp.ScatteredArray(
        positions=1e-3 * np.array([[0, 0], [7, 0], [-7, 0], [0, 7], [0, -7]]), depth=8e-3, channels=["stress_zz"]
    )
    plus = pp.Skin(pp.BondedLayers([pp.Layer(thickness=8e-3, youngs_modulus=1e5, poissons_ratio=0.3)]), array)
    rng = np.random.default_rng(0)
    weight = np.array([1.0, 0.7, 0.7, 0.5, 0.3]) * 100.0

    def counts(f: float) -> np.ndarray:
        return np.round((f * weight + 2.0 * rng.standard_normal(5)) / 2.4)[None] * 2.4

    forces = np.r_[np.zeros(10), rng.uniform(0.5, 5.0, 30)]
    found = plus.calibrate(np.stack([counts(f) for f in forces]), reference=forces)
    pressed = np.array([[0.4, 0.4, 0.2, 0.15, 0.1]]) * 480.0  # two alike, far below the largest labelled
    with found.track() as tracker:
        for _ in range(5):
            tracker.step(counts(0.0))
        touch = tracker.step(pressed)
    assert not any("end of their range" in n for n in touch.assumptions)
    assert Status.coded(int(touch.status)) is not Status.OVERLOAD
