"""Readings as real sensors give them: offsets, ends of range, broken taxels, pulls, a pad that is not the one described.

Data are made on cells four times finer than those of the reconstruction.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.screening import ceilings
from palpate.inverse.fit import misfit_probability, neighbours
from palpate.sensing.grids import refined
from palpate.sensing.nuisance import nuisances
from palpate.sensing.uncertainty import EXACT

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
NOISE = 0.01


def line(
    channels: tuple[str, ...] = ("stress_zz",), *, given: bool = False, seed: int = 0, slide: float = 0.0
) -> tuple[pp.Skin, np.ndarray, float]:
    """Skin, readings of a cylinder of 10 N/m with one per cent of noise, and the largest reading."""
    array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=channels)
    fine = pp.Skin(PAD, array, surface=refined(pp.Skin(PAD, array).surface, 4))
    contact = pp.solutions.hertz_line(half_width=3e-3, force=10.0).shifted(0.2e-3)
    return _with_noise(array, fine.sense(contact.sliding(slide) if slide else contact), given, seed)


def area(
    shape: tuple[int, int] = (8, 8), channels: tuple[str, ...] = ("stress_zz",), *, given: bool = False, seed: int = 0
) -> tuple[pp.Skin, np.ndarray, float]:
    """The same of a ball of 1 N."""
    array = pp.AreaArray(shape=shape, pitch=2e-3, depth=2e-3, channels=channels)
    fine = pp.Skin(PAD, array, surface=refined(pp.Skin(PAD, array).surface, 4))
    contact = pp.solutions.hertz_point(contact_radius=3e-3, force=1.0).shifted(0.3e-3, -0.2e-3)
    return _with_noise(array, fine.sense(contact), given, seed)


def _with_noise(
    array: pp.LineArray | pp.AreaArray, clean: np.ndarray, given: bool, seed: int
) -> tuple[pp.Skin, np.ndarray, float]:

    top = float(np.abs(clean).max())
    noisy = clean + NOISE * top * np.random.default_rng(seed).standard_normal(clean.shape)
    return pp.Skin(PAD, replace(array, noise=NOISE * top if given else None)), noisy, top


def holds(touch: pp.Touch, truth: float) -> bool:
    """Whether the interval of the normal force holds the truth, and is no wider than a fifth of it."""
    low, high = (float(v[-1]) for v in touch.interval(0.95, "force"))
    return low <= truth <= high and high - low < 0.2 * abs(truth)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("part", [0.2, -0.2, 0.05])
def test_an_offset_of_the_readings_is_no_contact(part: float, given: bool) -> None:
    """0.2 of the peak on all taxels was 3.9 N for 1 N, and -0.2 a pull of 2 N."""
    skin, readings, top = line(given=given, seed=1)
    touch = skin.reconstruct(readings + part * top)
    assert holds(touch, 10.0)
    assert any("offset of stress_zz" in n and " Pa" in n for n in touch.notes)
    assert touch.nuisance == pytest.approx([part * top, 0.0], abs=0.02 * top)  # and no ramp


@pytest.mark.long
def test_an_offset_under_a_ball() -> None:
    skin, readings, top = area()
    plain, shifted = (skin.reconstruct(r) for r in (readings, readings - 0.2 * top))
    assert holds(plain, 1.0)
    assert holds(shifted, 1.0)
    assert not plain.nuisance.any()


def test_offsets_of_channels_are_told_apart() -> None:
    skin, readings, top = line(("stress_xz", "stress_zz"), slide=0.3)
    touch = skin.reconstruct(readings + np.array([[0.1], [-0.2]]) * top)
    assert holds(touch, 10.0)
    assert touch.force[0] == pytest.approx(3.0, abs=0.4)
    assert touch.nuisance == pytest.approx([0.1 * top, -0.2 * top, 0.0, 0.0], abs=0.02 * top)  # and no ramps


def test_an_offset_that_was_not_allowed_is_not_sought() -> None:
    skin, readings, _ = line()
    none = pp.Skin(PAD, skin.planes, nuisance=())
    assert none.reconstruct(readings).nuisance is None
    with pytest.raises(pp.InvalidInput, match="offset, ramp, rotation"):
        pp.Skin(PAD, skin.planes, nuisance=["drift"])


@pytest.mark.parametrize("channels", [("stress_zz",), ("stress_xz", "stress_zz"), ("displacement_x", "displacement_z")])
@pytest.mark.parametrize("given", [False, True])
@pytest.mark.long
def test_a_pull_is_a_pull(channels: tuple[str, ...], given: bool) -> None:
    """Displacements under a pull gave a push of 6.6 times the force, noise given or not."""
    skin, readings, _ = line(channels, given=given)
    push, pull = skin.reconstruct(readings), skin.reconstruct(-readings)
    np.testing.assert_allclose(pull.values, -push.values, rtol=1e-9, atol=1e-9 * np.abs(push.values).max())
    assert float(pull.force[1]) == pytest.approx(-10.0, abs=0.15)
    for mine, other in zip(pull.interval(0.95, "force"), push.interval(0.95, "force")[::-1]):
        np.testing.assert_allclose(mine, -other, atol=1e-9)
    assert float(pull.peak_pressure) == pytest.approx(-float(push.peak_pressure))
    low, high = pull.interval(0.95, "peak_pressure")
    assert low < float(pull.peak_pressure) < high < 0.0
    assert float(pull.contact_area()) == float(push.contact_area()) > 0
    assert push.pushing
    assert not pull.pushing
    assert any("pull" in n for n in pull.notes)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.long
def test_a_railed_converter_is_left_out(given: bool) -> None:
    """One taxel at ten times the peak was "no contact" in 8 of 8."""
    for skin, readings, top in (area((8, 8), given=given), area((3, 3), given=given), line(given=given)):
        broken = readings.copy()
        broken[(0, 2)] = (
            np.where(np.arange(broken.shape[-1]) == 1, 10 * top, broken[(0, 2)]) if broken.ndim == 3 else 10 * top
        )
        touch = skin.reconstruct(broken)
        assert touch.touching
        assert touch.outliers.sum() == 1
        truth = 10.0 if broken.ndim == 2 else 1.0
        if broken[0].size > 9 or given:
            assert abs(float(touch.force[-1]) - truth) < 0.25 * truth
        else:
            # what presses beyond eight taxels whose noise nobody knows is anybody's guess: 0.8 to 1.8 N by the models
            low, high = (float(side[-1]) for side in touch.interval(0.95, "force"))
            assert low < truth < high
            assert high < 3.0 * truth


@pytest.mark.parametrize("given", [False, True])
def test_a_dead_taxel_under_the_contact_is_left_out_alone(given: bool) -> None:
    for skin, readings, place, truth in (
        (*line(given=given)[:2], (0, 10), 10.0),
        (*area(given=given)[:2], (0, 4, 4), 1.0),
    ):
        broken = readings.copy()
        broken[place] = 0.0
        touch = skin.reconstruct(broken)
        assert holds(touch, truth)
        assert touch.outliers.sum() == 1


@pytest.mark.parametrize("shape", [(3, 3), (3, 5)])
@pytest.mark.parametrize("given", [False, True])
def test_a_ball_on_a_handful_of_taxels_is_contact(shape: tuple[int, int], given: bool) -> None:
    skin, readings, _ = area(shape, given=given)
    touch = skin.reconstruct(readings)
    assert touch.touching
    low, high = touch.interval(0.95, "force")
    assert low[2] < 1.0 < high[2]
    if shape == (3, 3):
        assert any("cannot be separated from contact" in n for n in touch.notes)


def test_readings_at_the_end_of_their_range_count_as_at_least_that() -> None:
    skin, readings, top = line()
    touch = skin.reconstruct(np.minimum(readings, 0.6 * top))
    assert touch.at_limit.sum() == 5
    assert any("end of their range" in n for n in touch.notes)
    low, high = touch.interval(0.95, "force")
    assert low[1] < 10.0 < high[1]  # how much more they would have read is not known


def test_ceilings_and_steps() -> None:
    index = np.zeros(12, dtype=int)
    pairs = neighbours([pp.LineArray(count=12, pitch=1e-3, depth=1e-3, channels=["stress_zz"])])
    x = np.minimum(9.0 * np.exp(-0.2 * (np.arange(12) - 5.2) ** 2), 6.0)
    found = ceilings(x, index, pairs, Policy())
    assert np.flatnonzero(found.upper).tolist() == [4, 5, 6]
    assert not found.lower.any()
    assert not found.step.any()
    assert not ceilings(np.where(np.arange(12) % 4, x / 2, 6.0), index, pairs, Policy()).any  # apart from each other
    rounded = ceilings(np.array([0.0, 1, 2, 5, 7, 7, 6, 4, 3, 1, 0, 0]), index, pairs, Policy())
    assert not rounded.any  # neighbours of a peak share its step
    assert (rounded.step == 1.0).all()


@pytest.mark.long
def test_axes_that_were_exchanged_are_noticed() -> None:
    skin, readings, _ = area((8, 8), ("stress_xz", "stress_yz", "stress_zz"))
    right, wrong = skin.reconstruct(readings), skin.reconstruct(np.swapaxes(readings, 1, 2))
    assert right.fit > 0.01
    assert any("does not explain" in n for n in wrong.notes)
    assert "does not explain" in wrong.summary()
    assert wrong.method == "tikhonov"  # nothing that only pushes, or only pulls, leaves what noise leaves
    strict = skin.reconstruct(np.swapaxes(readings, 1, 2), method="adaptive")
    assert strict.fit < 1e-6


def test_misfit_probability_of_white_noise_is_uniform() -> None:
    array = pp.AreaArray(shape=(9, 9), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    pairs = neighbours([array])
    assert len(pairs[0]) == 2 * 9 * 8 + 2 * 8 * 8  # next and across
    rng = np.random.default_rng(0)
    observed = np.ones(81, dtype=bool)
    p = [misfit_probability(rng.standard_t(3, 81), observed, pairs, taken=0.0, known=False) for _ in range(2000)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.02)
    known = [misfit_probability(rng.standard_normal(81), observed, pairs, taken=0.0, known=True) for _ in range(2000)]
    assert np.mean(np.array(known) < 0.05) == pytest.approx(0.05, abs=0.02)
    wave = np.sin(0.7 * np.arange(9))[:, None].repeat(9, axis=1).ravel()
    assert misfit_probability(wave, observed, pairs, taken=0.0, known=False) < 1e-6
    assert misfit_probability(3.0 * rng.standard_normal(81), observed, pairs, taken=0.0, known=True) < 1e-6


def test_nuisances_are_what_they_are_called() -> None:
    array = pp.AreaArray(shape=(2, 3), pitch=1e-3, depth=0.0, channels=["displacement_x", "displacement_y"])
    found = nuisances([array], ("offset", "ramp", "rotation"))
    assert [n.label for n in found] == [
        "shift along x",
        "ramp of displacement_x along x",
        "ramp of displacement_x along y",
        "shift along y",
        "ramp of displacement_y along x",
        "ramp of displacement_y along y",
        "rotation about z",
    ]
    turned = found[-1].rows.reshape(2, 2, 3)
    assert turned[0, 0] == pytest.approx(0.5e-3)  # -y, the first row lies below
    assert turned[1, :, 0] == pytest.approx(-1e-3)
    assert found[-1].unit == "rad"


@pytest.mark.parametrize(
    ("channel", "name", "wide"),
    [
        ("strain_zz", "youngs_modulus", True),
        ("displacement_z", "youngs_modulus", True),
        ("stress_zz", "youngs_modulus", False),  # stress under a given load does not depend on it
        ("strain_zz", "depth", True),
        ("stress_zz", "gain", True),
    ],
)
@pytest.mark.long
def test_what_is_not_known_exactly_is_in_the_error_bars(channel: str, name: str, wide: bool) -> None:
    array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=[channel])
    contact = pp.solutions.hertz_line(half_width=3e-3, force=10.0)
    clean = pp.Skin(PAD, array).sense(contact)
    array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=[channel], noise=0.002 * float(np.abs(clean).max()))
    widths = []
    for uncertainty in (EXACT, replace(EXACT, **{name: 0.1})):
        low, high = pp.Skin(PAD, array, uncertainty=uncertainty).reconstruct(clean).interval(0.95, "force")
        widths.append(float(high[1] - low[1]))
    assert (widths[1] > 1.5 * widths[0]) == wide
    if name == "youngs_modulus" and wide:
        assert (
            3.5 < widths[1] < 9.0
        )  # 10 % of 10 N/m: 3.9 between two deviations on each side, up to twice that by the constants


@pytest.mark.long
def test_a_modulus_off_by_a_fifth_is_within_the_interval_where_it_was_named() -> None:
    array = pp.AreaArray(
        shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    true = pp.Skin(pp.HalfSpace(youngs_modulus=1.2 * 2e5, poissons_ratio=0.48), array)
    readings = true.sense(pp.solutions.hertz_point(contact_radius=3e-3, force=1.0))
    skin = pp.Skin(PAD, array, uncertainty=pp.Uncertainty(youngs_modulus=0.2))
    low, high = skin.reconstruct(readings).interval(0.95, "force")
    assert low[2] < 1.0 < high[2]
    sure = pp.Skin(PAD, array, uncertainty=pp.Uncertainty(youngs_modulus=0.05))
    assert sure.reconstruct(readings).interval(0.95, "force")[1][2] < 1.0


def test_uncertainties_that_make_no_sense_are_refused(tmp_path: Path) -> None:
    with pytest.raises(pp.InvalidInput, match="relative"):
        pp.Uncertainty(depth=12.0)
    with pytest.raises(pp.Unsupported, match="thickness"):
        pp.Skin(PAD, line()[0].planes, uncertainty=pp.Uncertainty(thickness=0.1))
    text = """
[pad]
kind = "half_space"
youngs_modulus = "200 kPa +- 10 %"
poissons_ratio = 0.48

[[plane]]
kind = "line"
count = 21
pitch = "1 mm"
depth = "2 mm +- 0.1 mm"
channels = ["stress_zz"]
"""
    path = tmp_path / "skin.toml"
    path.write_text(text)
    skin = pp.Skin.from_file(path)
    assert skin.pad.youngs_modulus == 2e5
    assert (skin.uncertainty.youngs_modulus, skin.uncertainty.depth) == pytest.approx((0.1, 0.05))
    path.write_text(text + '\n[uncertainty]\ndepth = "3 %"\n')
    with pytest.raises(pp.InvalidInput, match="two places"):
        pp.Skin.from_file(path)
    path.write_text(text.replace("10 %", "ten"))
    with pytest.raises(pp.InvalidInput):
        pp.Skin.from_file(path)


def test_no_constant_makes_smaller_what_is_stated() -> None:
    from palpate.inverse.contact.policy import STATED
    from palpate.uncertainty import Case, constants

    for contact in ("line", "area", "area with shear"):
        for sensing in ("stress", "strain", "displacement"):
            for body in ("half-space", "layers"):
                found = constants("adaptive", Case(contact, sensing, body)).quantities
                assert min(found[name].scale for name in ("traction", "force", "peak_pressure")) >= STATED


def test_an_offset_of_displacement_on_a_half_space_is_no_wide_pressure() -> None:
    """Displacement is felt far away, and wide pressure explains an offset with nothing left over: the force was half as large again, without a word."""
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    ball = pp.solutions.hertz_point(contact_radius=4e-3, force=1.0).shifted(1e-3, -1e-3)
    grid = pp.AreaGrid(shape=(32, 40), spacing=0.5e-3)
    plain = pp.AreaArray(shape=(8, 10), pitch=2e-3, depth=4e-3, channels=["displacement_z"])
    clean = np.asarray(pp.Skin(pad, plain, surface=grid).sense(ball))
    noise = 0.003 * float(np.abs(clean).max())
    offset = 0.17 * float(np.abs(clean).max())
    readings = clean + offset + noise * np.random.default_rng(4).standard_normal(clean.shape)
    array = pp.AreaArray(shape=(8, 10), pitch=2e-3, depth=4e-3, channels=["displacement_z"], noise=noise)
    touch = pp.Skin(pad, array).reconstruct(readings)
    assert float(touch.force[2]) == pytest.approx(1.0, abs=0.05)
    assert any("shift along z" in note for note in touch.notes)


@pytest.mark.parametrize(("part", "seed"), [(0.2, 1), (-0.2, 2)])
@pytest.mark.long
def test_a_tilt_of_displacements_that_wide_pressure_hides_is_in_the_interval(part: float, seed: int) -> None:
    """Pressure all round moves the taxels of a half-space as a tilted stage does: the force is a fifth too large, and the interval must say so."""
    pad = pp.HalfSpace(youngs_modulus=3e4, poissons_ratio=0.5)
    array = pp.LineArray(count=17, pitch=1e-3, depth=2.5e-3, channels=["displacement_z"])
    skin = pp.Skin(pad, array, uncertainty=EXACT)
    clean = np.asarray(skin.sense(pp.solutions.hertz_line(half_width=4e-3, force=8.0)))
    top = float(np.abs(clean).max())
    clean = clean + 0.003 * top * np.random.default_rng(seed).standard_normal(clean.shape)
    tilted = clean + part * top * np.linspace(-1.0, 1.0, 17)
    touch = skin.reconstruct(tilted)
    low, high = (float(v[1]) for v in touch.interval(0.95, "force"))
    assert low < 8.0 < high < 16.0
    assert any(note.startswith("drift") for note in touch.notes)
    # a compact contact tells what drifts from what presses: nothing is lost, and nothing said
    plain = skin.reconstruct(clean)
    low, high = (float(v[1]) for v in plain.interval(0.95, "force"))
    assert float(plain.force[1]) == pytest.approx(8.0, abs=0.1)
    assert high - low < 0.4
    assert not any(note.startswith("drift") for note in plain.notes)
    # who knows that nothing drifts has no wider interval
    sure = pp.Skin(pad, array, nuisance=[], uncertainty=EXACT).reconstruct(tilted)
    low, high = (float(v[1]) for v in sure.interval(0.95, "force"))
    assert low > 8.0
    assert not any(note.startswith("drift") for note in sure.notes)
