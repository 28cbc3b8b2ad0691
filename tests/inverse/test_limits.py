"""Ends of the range of a reading that are given: readings there are at least, or at most, what they say."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate import archives, solutions
from palpate.recordings import Recording, write_recording
from palpate.sensing.limits import at_ends, ends_of
from skin_files import skin_text

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
CHANNELS = ["stress_xz", "stress_yz", "stress_zz"]
ARRAY = pp.AreaArray(shape=(9, 9), pitch=2e-3, depth=0.7e-3, channels=CHANNELS, center=(-0.3e-3, -0.2e-3))
BALL = solutions.hertz_point(contact_radius=2.2e-3, force=1.0)


def pressed(skin: pp.Skin, noise: float = 0.01, seed: int = 0) -> Any:
    """Readings of 1 N whose noise is this part of the largest."""
    clean = np.asarray(skin.sense(BALL))
    return clean + noise * float(np.abs(clean).max()) * np.random.default_rng(seed).standard_normal(clean.shape)


def force(touch: pp.Touch) -> tuple[float, float, float]:
    low, high = touch.interval(0.95, "force")
    return float(touch.force[2]), float(low[2]), float(high[2])


def ended(readings: Any, part: float = 0.6) -> tuple[float, Any]:
    """Readings with an end of their range at a part of the largest, of which only one reading of the normal channel comes to it."""
    top = part * float(np.abs(readings).max())
    out = np.clip(readings, -top, top)
    assert int((np.abs(out) == top).sum()) == 1
    return top, out


@pytest.mark.parametrize("seed", [0, *long_runs(1, 2, 3)])
@pytest.mark.parametrize("friction", [None, 0.5])
@pytest.mark.long
def test_a_single_reading_at_an_end_that_is_given_is_at_least_that(friction: float | None, seed: int) -> None:
    """Nothing in a frame tells one reading at its end from a peak: 1 N reads 0.9."""
    given: dict[str, Any] = {} if friction is None else {"friction": friction}
    plain = pp.Skin(PAD, ARRAY)
    top, readings = ended(pressed(plain, seed=seed))
    stated = pp.Skin(PAD, dataclasses.replace(ARRAY, limits=top)).reconstruct(readings, **given)
    (f, low, high), (f0, _, _) = force(stated), force(plain.reconstruct(readings, **given))
    # (where friction is given the evidence is less sure of the peak without its reading: the word is what tells)
    assert friction is not None or low <= 1.0 <= high, (seed, low, high)
    assert abs(f - 1.0) < abs(f0 - 1.0)
    assert f0 < 0.95  # the frame alone does not know
    assert any("at the end of their range" in note for note in stated.notes)
    assert stated.at_limit is not None
    assert int(stated.at_limit.sum()) == int((np.abs(readings) == top).sum())


@pytest.mark.long
def test_the_low_end_counts_too() -> None:
    """A converter that ends below: the sign of what presses is turned by whoever wired it."""
    plain = pp.Skin(PAD, ARRAY)
    readings = pressed(plain)
    bottom = 0.5 * float(readings[0].min())
    cut = readings.copy()
    cut[0] = np.maximum(cut[0], bottom)
    limits = [(bottom, np.inf), (-np.inf, np.inf), (-np.inf, np.inf)]
    touch = pp.Skin(PAD, dataclasses.replace(ARRAY, limits=limits)).reconstruct(cut)
    assert touch.at_limit is not None
    assert int(touch.at_limit.sum()) == int((readings[0] <= bottom).sum())
    f, low, high = force(touch)
    assert low <= 1.0 <= high
    assert f == pytest.approx(1.0, abs=0.06)


@pytest.mark.long
def test_limits_that_nothing_reaches_change_nothing() -> None:
    plain = pp.Skin(PAD, ARRAY)
    readings = pressed(plain)
    far = pp.Skin(PAD, dataclasses.replace(ARRAY, limits=3.0 * float(np.abs(readings).max())))
    a, b = plain.reconstruct(readings), far.reconstruct(readings)
    np.testing.assert_array_equal(a.values, b.values)
    assert a.notes == b.notes


def test_forms_of_limits_mean_the_same() -> None:
    pair = (-5e3, 5e3)
    ends = [
        np.asarray(dataclasses.replace(ARRAY, limits=e).limits) for e in (5e3, pair, [pair] * 3, np.array([pair] * 3))
    ]
    for other in ends[1:]:
        np.testing.assert_array_equal(ends[0], other)
    again = dataclasses.replace(ARRAY, limits=ends[0])
    np.testing.assert_array_equal(ends[0], np.asarray(again.limits))
    assert not np.asarray(again.limits).flags.writeable


@pytest.mark.parametrize(
    "wrong", [0.0, -1.0, (1.0, 1.0), (2.0, 1.0), (1.0, 2.0, 3.0), float("nan"), "high", [(0.0, 1.0)] * 2]
)
def test_limits_that_mean_nothing_are_refused(wrong: Any) -> None:
    with pytest.raises(pp.InvalidInput, match="limits must be the largest reading"):
        dataclasses.replace(ARRAY, limits=wrong)


def test_ends_of_channels_that_creep_are_refused_and_of_those_that_do_not_kept() -> None:
    """Strain creeps under a load that is kept, stress does not; each channel is asked for its own ends."""
    creeping = pp.Viscoelastic(PAD, [(0.3, 1.0)])
    free = (-np.inf, np.inf)

    def skin(*limits: tuple[float, float]) -> pp.Skin:
        channels = ["stress_xz", "stress_zz", "strain_zz"]
        return pp.Skin(creeping, pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=channels, limits=limits))

    for one_sided in ((0.0, 0.1), (-np.inf, 0.1), (-0.1, np.inf)):
        with pytest.raises(pp.InvalidInput, match="limits of strain_zz cannot be kept where the pad creeps"):
            skin(free, free, one_sided)
    assert np.asarray(skin((-5e3, 5e3), (0.0, 3e4), free).planes[0].limits)[1].tolist() == [0.0, 3e4]


def test_masked_taxels_have_no_ends_and_missing_readings_are_at_none() -> None:
    array = pp.LineArray(
        count=4, pitch=1e-3, depth=1e-3, channels=["stress_zz"], limits=[(0.0, 10.0)], mask=[True, False, True, True]
    )
    found = ends_of([array])
    assert found is not None
    assert found[1].tolist() == [10.0] * 3
    upper, lower = at_ends(np.array([10.0, np.nan, 0.0]), found)
    assert (upper.tolist(), lower.tolist()) == ([True, False, False], [False] * 3)  # it rests at 0
    upper, lower = at_ends(np.array([10.0, np.nan, 0.0]), found, np.array([4.0, np.nan, -6.0]))
    assert (upper.tolist(), lower.tolist()) == ([True, False, False], [False, False, True])


@pytest.mark.parametrize("stream", [False, True])
@pytest.mark.long
def test_a_range_that_begins_where_readings_rest_leaves_them_in_use(stream: bool) -> None:
    """Taxels that nothing presses read 0, the low end of a converter of 0 to its largest count: that tells that nothing presses there."""
    one = dataclasses.replace(ARRAY, channels=["stress_zz"])
    clean = np.asarray(pp.Skin(PAD, one).sense(BALL))
    size, top = 0.01 * float(clean.max()), 0.6 * float(clean.max())
    rng = np.random.default_rng(3)
    frames = [np.clip((i >= 10) * clean + size * rng.standard_normal(clean.shape), 0.0, top) for i in range(20)]
    found = []
    for low_end in (0.0, -np.inf):
        skin = pp.Skin(PAD, dataclasses.replace(one, limits=(low_end, top)))
        if stream:
            tracker = skin.track(baseline=10)
            for frame in frames:
                touch = tracker.step(frame)
        else:
            touch = skin.reconstruct(frames[-1])
        said = [n for n in touch.notes if "at the end of their range" in n]
        assert [n.split()[0] for n in said] == ["1"]
        found.append(force(touch))
    assert found[0] == pytest.approx(found[1], rel=1e-9)
    assert found[0][0] > 0.7


def test_simulated_readings_end_where_the_array_says() -> None:
    array = dataclasses.replace(ARRAY, limits=(0.0, 4e4), noise=100.0)
    skin = pp.Skin(PAD, array)
    noisy = np.asarray(skin.sense(BALL, rng=np.random.default_rng(0)))
    assert noisy.max() == 4e4
    assert noisy.min() == 0.0
    assert np.asarray(skin.sense(BALL)).max() == 4e4
    assert np.asarray(pp.Skin(PAD, ARRAY).sense(BALL)).max() > 4e4  # what acts there


@pytest.mark.parametrize("method", ["tikhonov", "constrained"])
@pytest.mark.long
def test_what_a_method_makes_of_them_is_said(method: str) -> None:
    plain = pp.Skin(PAD, ARRAY)
    top, readings = ended(pressed(plain))
    touch = pp.Skin(PAD, dataclasses.replace(ARRAY, limits=top)).reconstruct(readings, method=method)
    said = [note for note in touch.notes if "at the end of their range" in note]
    assert len(said) == 1
    assert ("takes them as they are" in said[0]) is (method == "tikhonov")


@pytest.mark.long
def test_single_precision_at_an_end() -> None:
    plain = pp.Skin(PAD, ARRAY)
    top, readings = ended(pressed(plain))
    touch = pp.Skin(PAD, dataclasses.replace(ARRAY, limits=top)).reconstruct(readings.astype(np.float32))
    assert touch.at_limit is not None
    assert touch.at_limit.any()


@pytest.mark.long
def test_a_tracker_knows_the_ends_of_the_raw_readings() -> None:
    """With offsets: the converter's end is that of what it reads, not of what the zero leaves."""
    plain = pp.Skin(PAD, ARRAY)
    rest = 200.0 * np.random.default_rng(1).standard_normal(np.shape(pressed(plain)))
    size = 0.01 * float(np.abs(pressed(plain)).max())
    rng = np.random.default_rng(2)
    top = float((rest + np.asarray(plain.sense(BALL))).max()) * 0.75
    skin = pp.Skin(PAD, dataclasses.replace(ARRAY, limits=(-np.inf, top)))
    forces = {}
    for name, one in (("given", skin), ("not given", plain)):
        tracker = one.track(baseline=10)
        for i in range(20):
            load = 0.0 if i < 10 else 1.0
            touch = tracker.step(
                np.minimum(rest + load * np.asarray(plain.sense(BALL)) + size * rng.standard_normal(rest.shape), top)
            )
        forces[name] = force(touch)
    for f, low, high in forces.values():
        assert low <= 1.0 <= high
        assert f == pytest.approx(1.0, rel=0.2)


@pytest.mark.long
def test_a_recording_whose_zero_is_taken_off_keeps_its_ends(tmp_path: Path) -> None:
    plain = pp.Skin(PAD, ARRAY)
    rest = 500.0 + 200.0 * np.random.default_rng(1).standard_normal(np.shape(pressed(plain)))
    clean = np.asarray(plain.sense(BALL))
    size, rng = 0.005 * float(np.abs(clean).max()), np.random.default_rng(2)
    top = 0.75 * float((rest + clean).max())
    frames = np.stack(
        [np.minimum(rest + (i >= 10) * clean + size * rng.standard_normal(clean.shape), top) for i in range(12)]
    )
    recording = Recording(readings=frames, channels=CHANNELS, time=np.arange(12.0))
    skin = pp.Skin(PAD, dataclasses.replace(ARRAY, limits=(-np.inf, top)))
    write_recording(recording, tmp_path / "press.nc")
    done = archives.reconstruct_recording(skin, tmp_path / "press.nc", tmp_path / "touch.nc", baseline=10)
    assert any("at the end of their range" in note for note in done.notes)


def test_a_skin_file_states_them(tmp_path: Path) -> None:
    text = skin_text(5, channels=("stress_xz", "stress_zz"), depth="1 mm") + "limits = {}\n"
    path = tmp_path / "skin.toml"
    for given, expected in (
        ('"30 kPa"', [(-3e4, 3e4), (-3e4, 3e4)]),
        ('["0 Pa", "30 kPa"]', [(0.0, 3e4), (0.0, 3e4)]),
        ('["5 kPa", ["0 Pa", "30 kPa"]]', [(-5e3, 5e3), (0.0, 3e4)]),
        ('[["-5 kPa", "5 kPa"], ["0 Pa", "30 kPa"]]', [(-5e3, 5e3), (0.0, 3e4)]),
    ):
        path.write_text(text.format(given))
        limits = np.asarray(pp.Skin.from_file(path).planes[0].limits)
        assert [tuple(ends) for ends in limits.tolist()] == expected
