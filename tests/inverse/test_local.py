"""Traction of either sign with local weights: cells on gels, without a sign that says where traction ends."""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.bench import pulled

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
SHIFTS = ["displacement_x", "displacement_y"]
Floats = npt.NDArray[np.float64]


def field(count: int = 16, **given: object) -> pp.AreaArray:
    return pp.AreaArray(shape=(count, count), pitch=1e-6, depth=0.0, channels=SHIFTS, **given)


@functools.cache
def on_gel(count: int = 16) -> pp.Skin:
    """What is prepared for a skin is prepared once for all tests."""
    return pp.Skin(GEL, field(count))


def dipole(skin: pp.Skin) -> Floats:
    """Two patches of 500 Pa that pull at each other along x."""
    x, y = np.meshgrid(skin.surface.axes[1], skin.surface.axes[0])
    out = np.zeros((3, *skin.surface.shape))
    out[0] = 500.0 * ((np.abs(x + 4e-6) < 1.5e-6) & (np.abs(y) < 1.2e-6))
    out[0] -= 500.0 * ((np.abs(x - 4e-6) < 1.5e-6) & (np.abs(y) < 1.2e-6))
    return out


def noisy(clean: object, part: float = 0.02, seed: int = 0) -> Floats:
    values = np.asarray(clean)
    return values + part * np.nanmax(np.abs(values)) * np.random.default_rng(seed).standard_normal(values.shape)


def error(touch: pp.Touch, truth: Floats) -> float:
    return float(np.linalg.norm(np.asarray(touch.values) - truth) / np.linalg.norm(truth))


def ends(touch: pp.Touch, level: float, of: str = "traction") -> tuple[Floats, Floats]:
    low, high = touch.interval(level, of=of)
    return np.asarray(low), np.asarray(high)


@pytest.mark.long
def test_patches_that_pull_at_each_other_have_half_the_error_of_an_even_penalty() -> None:
    skin = on_gel()
    truth = dipole(skin)
    readings = noisy(skin.sense(truth))
    touch = skin.reconstruct(readings, components=["x", "y"])
    even = skin.reconstruct(readings, components=["x", "y"], method="tikhonov")
    assert touch.methods == "local"
    assert error(touch, truth) < 0.5 * error(even, truth)
    low, high = ends(touch, 0.95)
    on = truth[0] != 0
    assert np.mean(((low <= truth) & (truth <= high))[0][on]) >= 0.9


@pytest.mark.long
def test_where_traction_ends_a_shift_of_the_image_is_told_from_a_net_force() -> None:
    """The even penalty takes a shift and a net force for one another: its interval is wider than the load."""
    skin = on_gel()
    truth = dipole(skin)
    clean = np.asarray(skin.sense(truth))
    shift = 0.3 * np.abs(clean).max()
    touch = skin.reconstruct(noisy(clean) + shift, components=["x", "y"])
    load = np.abs(truth).sum() * skin.surface.cell
    assert np.abs(np.asarray(touch.force)).max() < 0.05 * load
    low, high = ends(touch, 0.95, of="force")
    assert np.all((low <= 0) & (high >= 0))
    assert (high - low).max() < 0.5 * load
    assert any(note.startswith("shift along x: ") for note in touch.notes)
    assert touch.nuisance is not None
    np.testing.assert_allclose(np.asarray(touch.nuisance)[:2], shift, rtol=0.05)


@pytest.mark.long
def test_a_stage_that_turned_and_moved_over_a_bonded_gel_makes_no_net_force() -> None:
    layer = pp.BondedLayers([pp.Layer(thickness=10e-6, youngs_modulus=8e3, poissons_ratio=0.48)])
    skin = pp.Skin(layer, field())
    truth = dipole(skin)
    clean = np.asarray(skin.sense(truth))
    top = np.abs(clean).max()
    x, y = np.meshgrid(field().grid.axes[1], field().grid.axes[0])
    turned = 0.2 * top / 1e-5 * np.stack([-y, x])
    touch = skin.reconstruct(noisy(clean) + turned - 0.2 * top, components=["x", "y"])
    load = np.abs(truth).sum() * skin.surface.cell
    assert np.abs(np.asarray(touch.force)).max() < 0.05 * load
    assert error(touch, truth) < 0.35


@pytest.mark.long
def test_vectors_that_jumped_are_left_out_and_named() -> None:
    skin = on_gel()
    truth = dipole(skin)
    readings = noisy(skin.sense(truth))
    top = np.abs(readings).max()
    readings[0, 3, 12] += 2.0 * top
    readings[1, 13, 4] -= 4.0 * top
    touch = skin.reconstruct(readings, components=["x", "y"])
    assert error(touch, truth) < 0.3
    note = next(n for n in touch.notes if "left out" in n)
    assert "displacement_x at taxel (3, 12)" in note
    assert "displacement_y at taxel (13, 4)" in note


@pytest.mark.long
def test_windows_that_overlap_are_noticed_and_their_noise_is_not_taken_for_precision() -> None:
    import scipy.ndimage

    skin = on_gel(20)
    truth = dipole(skin)
    clean = np.asarray(skin.sense(truth))
    white = np.random.default_rng(3).standard_normal(clean.shape)
    shared = scipy.ndimage.gaussian_filter(white, (0, 0.75, 0.75), mode="wrap")
    touch = skin.reconstruct(clean + 0.01 * np.abs(clean).max() * shared / shared.std(), components=["x", "y"])
    assert float(touch.fit) < 0.01
    low, high = ends(touch, 0.95)
    on = truth[0] != 0
    assert np.mean(((low <= truth) & (truth <= high))[0][on]) >= 0.9


@pytest.mark.parametrize("seed", [0, *long_runs(1)])
@pytest.mark.long
def test_noise_alone_makes_no_patch_that_its_interval_denies(seed: int) -> None:
    skin = on_gel()
    readings = 1e-9 * np.random.default_rng(seed).standard_normal((2, 16, 16))
    touch = skin.reconstruct(readings, components=["x", "y"])
    low, high = ends(touch, 0.95)
    assert np.mean((low <= 0) & (high >= 0)) > 0.99
    low, high = ends(touch, 0.95, of="force")
    assert np.all((low <= 0) & (high >= 0))


@pytest.mark.long
def test_traction_all_over_is_left_to_the_even_penalty_with_a_word() -> None:
    skin = on_gel(36)
    x, y = np.meshgrid(skin.surface.axes[1], skin.surface.axes[0])
    truth = 300.0 * np.stack([np.cos(x / 6e-6) * np.sin(y / 8e-6), np.sin(x / 7e-6), 0 * x])
    touch = skin.reconstruct(noisy(skin.sense(truth)), components=["x", "y"])
    assert touch.methods == "tikhonov"
    assert any("traction acts in too many places" in note for note in touch.notes)
    assert np.isfinite(np.stack(ends(touch, 0.95))[:, :2]).all()


@pytest.mark.long
def test_frames_are_decided_alone_and_float32_stays_float32() -> None:
    skin = on_gel()
    readings = np.stack([noisy(skin.sense(dipole(skin)), seed=s) for s in (0, 1)])
    readings[1] = 0.0
    together = skin.reconstruct(readings.astype(np.float32), components=["x", "y"])
    alone = skin.reconstruct(readings[0].astype(np.float32), components=["x", "y"])
    assert together.methods.tolist() == ["local", "tikhonov"]
    np.testing.assert_array_equal(together.values[0], alone.values)
    assert together.values.dtype == np.float32
    assert np.all(np.asarray(together.values[1]) == 0.0)


@pytest.mark.long
def test_notes_of_the_even_penalty_are_on_its_own_frames() -> None:
    """It cannot tell a shift from a net force, and the local models can: the note counts only the frame that it answered."""
    skin = on_gel()
    press = noisy(skin.sense(dipole(skin)))
    empty = 0.02 * np.abs(press).max() * np.random.default_rng(1).standard_normal(press.shape)
    touch, alone = skin.reconstruct(np.stack([press, empty, press])), skin.reconstruct(empty)
    assert touch.methods.tolist() == ["local", "tikhonov", "local"]
    assert alone.notes[0].startswith("shift along x (of up to")
    some = [note for note in touch.notes if "cannot be separated" in note]
    assert some
    assert all("in 1 of 3 frames" in note for note in some)
    assert touch.notes[0].split(" and a net")[0] == alone.notes[0].split(" and a net")[0]


@pytest.mark.long
def test_mirror_images_have_mirror_images() -> None:
    skin = on_gel()
    readings = noisy(skin.sense(dipole(skin)))
    mirrored = readings[:, :, ::-1] * np.array([-1.0, 1.0])[:, None, None]
    one, other = (np.asarray(skin.reconstruct(r, components=["x", "y"]).values) for r in (readings, mirrored))
    turned = other[:, :, ::-1] * np.array([-1.0, 1.0, 1.0])[:, None, None]
    np.testing.assert_allclose(turned, one, atol=1e-6 * np.abs(one).max())


@pytest.mark.long
def test_samples_of_the_posterior_are_as_wide_as_its_model() -> None:
    skin = on_gel(12)
    readings = noisy(skin.sense(dipole(skin)))
    touch = skin.reconstruct(readings, components=["x", "y"], draws=200, rng=0)
    assert touch._errors is not None
    assert touch.draws is not None
    std = np.asarray(touch._errors.posterior.traction)[:2]
    ratio = np.asarray(touch.draws)[:, :2].std(axis=0)[std > 0] / std[std > 0]
    assert 0.9 < np.median(ratio) < 1.1


@pytest.mark.long
def test_what_is_not_known_of_the_pad_is_in_the_error_bars() -> None:
    layer = pp.BondedLayers([pp.Layer(thickness=4e-6, youngs_modulus=8e3, poissons_ratio=0.48)])
    skins = [
        pp.Skin(layer, field(), uncertainty=pp.Uncertainty(thickness=t, youngs_modulus=0.01, gain=0.0))
        for t in (0.01, 0.2)
    ]
    readings = noisy(skins[0].sense(dipole(skins[0])))
    sure, unsure = (s.reconstruct(readings, components=["x", "y"]) for s in skins)
    assert unsure._errors.pad is not None
    assert sure._errors.pad is not None
    assert np.asarray(unsure._errors.pad.traction).max() > 5 * np.asarray(sure._errors.pad.traction).max()


@pytest.mark.parametrize("scattered", [False, True])
@pytest.mark.long
def test_markers_anywhere_and_taxels_left_out(scattered: bool) -> None:
    rng = np.random.default_rng(2)
    array: object
    if scattered:
        array = pp.ScatteredArray(positions=rng.uniform(-8e-6, 8e-6, (270, 2)), depth=0.0, channels=SHIFTS)
    else:
        working = rng.random((16, 16)) > 0.1
        array = field().masked(working)
    skin = pp.Skin(GEL, array)
    truth = dipole(skin)
    touch = skin.reconstruct(noisy(skin.sense(truth)), components=["x", "y"])
    assert touch.methods == "local"
    assert error(touch, truth) < 0.35


def test_shear_alone_on_a_line() -> None:
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5),
        pp.LineArray(count=41, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]),
    )
    x = skin.surface.axes[0]
    truth = np.zeros((2, len(x)))
    truth[0] = 1e3 * (np.abs(x - 8e-3) < 2.5e-3) - 1e3 * (np.abs(x + 8e-3) < 2.5e-3)
    readings = noisy(skin.sense(truth))
    touch = skin.reconstruct(readings, components=["x"])
    even = skin.reconstruct(readings, components=["x"], method="tikhonov")
    assert error(touch, truth) < 1.1 * error(even, truth)
    low, high = ends(touch, 0.95, of="force")
    assert low[0] <= 0 <= high[0]


@pytest.mark.long
def test_more_readings_than_a_decomposition_takes_have_the_same_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.inverse.linear.matrix_free import path

    readings = noisy(pp.Skin(GEL, field()).sense(dipole(pp.Skin(GEL, field())))) + 1e-9
    dense = pp.Skin(GEL, field()).reconstruct(readings, components=["x", "y"])
    monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", 1)
    free = pp.Skin(GEL, field()).reconstruct(readings, components=["x", "y"])
    assert free.methods == "local"
    values = np.asarray(dense.values)
    assert np.linalg.norm(np.asarray(free.values) - values) < 0.05 * np.linalg.norm(values)
    monkeypatch.undo()
    skin = pp.Skin(GEL, field(96))
    truth = dipole(skin)
    touch = skin.reconstruct(noisy(skin.sense(truth)), components=["x", "y"])
    assert touch.methods == "local"
    assert error(touch, truth) < 0.3


@pytest.mark.long
def test_weak_traction_all_round_is_not_taken_for_a_shift_of_the_image() -> None:
    """Tails beyond the cells that are kept were a shift: 2164 to 2703 of 2921 N, with nothing said."""
    skin = pp.Skin(pp.BondedLayers([pp.Layer(thickness=10e-6, youngs_modulus=8e3, poissons_ratio=0.48)]), field())
    x, y = np.meshgrid(skin.surface.axes[1], skin.surface.axes[0])
    truth = np.zeros((3, *skin.surface.shape))
    truth[0] = 500.0 / (1.0 + ((x - 2e-6) ** 2 + y**2) / 1e-12) ** 1.5
    touch = skin.reconstruct(noisy(skin.sense(truth), 0.03), components=["x", "y"])
    low, high = ends(touch, 0.95, of="force")
    assert low[0] < truth[0].sum() * skin.surface.cell < high[0]


@pytest.mark.long
def test_a_glitch_on_a_frame_of_zeros_is_a_frame() -> None:
    readings = np.zeros((2, 12, 12))
    readings[0, 6, 6] = 1e-7
    assert np.isfinite(np.asarray(on_gel(12).reconstruct(readings, components=["x", "y"]).values)).all()


@pytest.mark.long
def test_where_local_weights_have_no_answer_it_is_that_of_the_even_penalty() -> None:
    skin = pp.Skin(pp.BondedLayers([pp.Layer(thickness=10e-6, youngs_modulus=8e3, poissons_ratio=0.48)]), field(30))
    x, y = np.meshgrid(skin.surface.axes[1], skin.surface.axes[0])
    truth = np.stack([300.0 * np.cos(x / 6e-6) * np.sin(y / 8e-6) + 100.0, 300.0 * np.sin(x / 7e-6), 0 * x])
    readings = noisy(skin.sense(truth))
    touch, even = (skin.reconstruct(readings, components=["x", "y"], method=m) for m in ("automatic", "tikhonov"))
    assert touch.methods == "tikhonov"
    np.testing.assert_array_equal(touch.values, even.values)


def test_friction_belongs_to_pressure() -> None:
    with pytest.raises(pp.Unsupported, match='method="local" is used'):
        on_gel(8).reconstruct(np.full((2, 8, 8), 1e-9), components=["x", "y"], friction=0.5)


@pytest.mark.long
def test_patches_that_tuned_nothing() -> None:
    """Ten frames of the population of the constants, another seed: error below the even penalty's, and force inside its interval."""
    ratios, inside = [], []
    for i in range(10):
        frame = pulled(np.random.default_rng((977, i)))
        true = np.concatenate([frame.truth, np.zeros((1, *frame.truth.shape[1:]))])
        if not true.any():
            continue
        touch = frame.skin.reconstruct(frame.readings, components=["x", "y"])
        even = frame.skin.reconstruct(frame.readings, components=["x", "y"], method="tikhonov")
        ratios.append(error(touch, true) / error(even, true))
        low, high = ends(touch, 0.95, of="force")
        force = true.sum(axis=(1, 2)) * frame.skin.surface.cell
        inside.append(np.all((low <= force) & (force <= high)))
    assert np.exp(np.mean(np.log(ratios))) < 0.75
    assert np.mean(inside) >= 0.8


def test_a_line_so_short_that_no_cell_is_left_out() -> None:
    line = pp.LineArray(count=13, pitch=1e-3, depth=2e-3, channels=["stress_zz", "stress_xz"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e6, poissons_ratio=0.48), line)
    truth = np.zeros((2, *skin.surface.shape))
    truth[0] = 1e4 * np.exp(-((skin.surface.axes[0] / 3e-3) ** 2))
    touch = skin.reconstruct(noisy(skin.sense(truth), 0.01), components=["x"], method="local")
    low, high = ends(touch, 0.95, of="force")
    assert low[0] <= truth[0].sum() * skin.surface.spacing <= high[0]


@pytest.mark.long
def test_a_load_that_noise_hides_is_no_sure_nothing() -> None:
    """A model of next to no traction was next to sure of it: +- 1 % of a load under ten times its readings of noise."""
    skin = on_gel()
    truth = np.abs(dipole(skin))
    clean = np.asarray(skin.sense(truth))
    load = truth.sum() * skin.surface.cell
    noise = 10.0 * np.abs(clean).max() * np.random.default_rng(1).standard_normal(clean.shape)
    touch = skin.reconstruct(clean + noise, components=["x", "y"])
    low, high = ends(touch, 0.95, of="force")
    assert low[0] <= load <= high[0]
    assert any("too many places or in none" in note for note in touch.notes)
