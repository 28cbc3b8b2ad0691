"""A pad that is not known exactly is in the error bars of linear methods too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.linear.matrix_free import path
from palpate.recordings import read_touch, write_touch
from palpate.recordings.labelled import touch_of
from palpate.sensing.uncertainty import EXACT
from palpate.touch.fields import ErrorParts

PAD = pp.HalfSpace(youngs_modulus=1e4, poissons_ratio=0.5)
IN_PLANE = pp.AreaArray(shape=(10, 10), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
DEEP = pp.AreaArray(
    shape=(9, 9), pitch=2e-3, depth=3e-3, channels=["displacement_x", "displacement_y", "displacement_z"]
)
BALL = pp.solutions.hertz_point(contact_radius=4e-3, force=1.0).sliding(0.4)


def pulled(skin: pp.Skin) -> np.ndarray:
    """Readings of shear alone, of a resultant of 0.1 uN along x."""
    t = np.zeros((3, *skin.surface.shape))
    t[0, 4:7, 3:8] = 1e-7 / (15 * skin.surface.cell)
    return np.asarray(skin.sense(t))


def test_a_pull_that_the_model_does_not_explain_may_be_a_push() -> None:
    array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=5.0)
    skin = pp.Skin(PAD, array)
    pull = skin.reconstruct(-skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0)))
    assert not pull.pushing
    errors = ErrorParts(replace(pull._errors.posterior, force=pull._errors.posterior.force + 20.0))
    ends = {}
    for fit in (0.5, 0.001):
        ends[fit] = replace(pull, _errors=errors, fit=np.asarray(fit)).interval(0.95, "force")[1][1]
    assert ends[0.5] == 0.0
    assert ends[0.001] > 1.0


@pytest.mark.long
def test_in_plane_force_of_a_cell_is_as_uncertain_as_the_modulus_of_its_gel() -> None:
    rng = np.random.default_rng(5)
    known = pp.Skin(PAD, IN_PLANE, nuisance=[], uncertainty=pp.Uncertainty(youngs_modulus=0.1))
    plain = pp.Skin(PAD, IN_PLANE, nuisance=[], uncertainty=EXACT)
    one = pulled(plain)
    factors = 1.0 / (1.0 + 0.1 * rng.standard_normal(30))  # a stiffer gel moves less
    frames = factors[:, None, None, None] * one + 0.01 * np.abs(one).max() * rng.standard_normal((30, *one.shape))
    touch = known.reconstruct(frames)
    assert set(np.ravel(touch.methods)) == {"local"}
    low, high = touch.interval(0.95, "force")
    inside = int(np.count_nonzero((low[:, 0] < 1e-7) & (high[:, 0] > 1e-7)))
    assert inside >= 26  # 95 % of 30 is 28.5; 26 or more with a chance of 0.98
    blind = plain.reconstruct(frames)
    low, high = blind.interval(0.95, "force")
    assert np.count_nonzero((low[:, 0] < 1e-7) & (high[:, 0] > 1e-7)) < 24
    assert not any("Young's modulus" in n for n in (*touch.assumed, *blind.assumed))


@pytest.mark.long
def test_a_modulus_that_nothing_is_said_of_is_known_to_15_percent_and_a_scale_to_2() -> None:
    silent = pp.Skin(PAD, IN_PLANE, nuisance=[])
    readings = pulled(silent)
    touch = silent.reconstruct(readings)
    assert any("Young's modulus known to 15 %" in n for n in touch.assumed)
    assert not any("modulus" in n for n in touch.notes)
    (line,) = (x for x in touch.summary().splitlines() if "modulus" in x)
    assert line.startswith("assumed ")
    low, high = touch.interval(0.95, "force")
    least, most = pp.Skin(PAD, IN_PLANE, nuisance=[], uncertainty=EXACT).reconstruct(readings).interval(0.95, "force")
    both = float(np.hypot(0.15, 0.02) * touch.force[0])
    assert float(high[0] - low[0]) / 2 == pytest.approx(np.hypot(1.96 * both, float(most[0] - least[0]) / 2), rel=1e-3)
    # stress under a given load does not depend on the modulus
    array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=1.0)
    known = pp.Skin(PAD, array, uncertainty=pp.Uncertainty(depth=0.0, gain=0.0))
    pressed = known.reconstruct(known.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0)))
    assert not any("modulus" in n for n in pressed.notes)
    assert pressed._scale_std == 0.02
    low, high = pressed.interval(0.95, "force")
    assert float(high[1] - low[1]) / 2 == pytest.approx(0.4, rel=0.1)
    # a centre of pressure and a ratio of forces do not change with either
    assert np.ptp(pressed.interval(0.95, "center_of_pressure")) < 1e-4
    # and a limit is exceeded with the chance that the interval says
    assert float(pressed.exceeds(float(high[1]), "force")) == pytest.approx(0.025, abs=1e-6)


@pytest.mark.parametrize("name", ["youngs_modulus", "depth"])
def test_what_a_linear_estimate_owes_is_what_it_changes_by(name: str) -> None:
    method = pp.Tikhonov(parameter=1e-18)  # little is smoothed: what is not exact is told from the estimate itself
    skin = pp.Skin(PAD, DEEP, uncertainty=replace(EXACT, **{name: 0.02}))
    surface = skin.surface  # a deeper array would be given a larger one
    off = {
        "youngs_modulus": pp.Skin(pp.HalfSpace(youngs_modulus=1e4 / 1.02, poissons_ratio=0.5), DEEP, surface=surface),
        "depth": pp.Skin(PAD, replace(DEEP, depth=1.02 * 3e-3), surface=surface),
    }[name]
    traction = skin.sample(BALL)
    right = skin.reconstruct(skin.sense(traction), method=method)
    wrong = skin.reconstruct(off.sense(traction), method=method)
    if name == "youngs_modulus":  # three displacements follow it alike, and so does all that is found
        assert right._errors.pad is None
        assert np.allclose(
            right._scale_std * np.abs(right.force), np.abs(wrong.force - right.force), rtol=0.03, atol=1e-4
        )
        return
    assert right._errors.pad is not None
    change = np.abs(wrong.force - right.force)
    assert np.allclose(right._errors.pad.force, change, rtol=0.1, atol=0.02 * change.max())
    assert right._errors.pad.peak == pytest.approx(float(abs(wrong.peak_pressure - right.peak_pressure)), rel=0.25)
    field = np.abs(np.asarray(wrong.values) - np.asarray(right.values))
    assert np.linalg.norm(right._errors.pad.traction - field) < 0.25 * np.linalg.norm(field)


def test_gains_by_random_signs_are_as_large_as_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    from palpate.inverse.linear import stated

    skin = pp.Skin(PAD, DEEP, uncertainty=pp.Uncertainty(gain=0.05))
    readings = skin.sense(BALL)
    found = skin.reconstruct(readings, method="tikhonov")._errors.pad
    monkeypatch.setattr(stated, "SKETCHES", 1000)
    each = skin.reconstruct(readings, method="tikhonov")._errors.pad
    assert found is not None
    assert each is not None
    assert np.allclose(found.force, each.force, rtol=0.3)
    assert float(np.median(found.traction / each.traction)) == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_frames_one_by_one_and_together_and_from_a_file_owe_the_same(tmp_path: Path) -> None:
    skin = pp.Skin(PAD, IN_PLANE, nuisance=[], uncertainty=pp.Uncertainty(youngs_modulus=0.1, gain=0.02))
    frames = np.stack([pulled(skin), -0.5 * pulled(skin), 0.0 * pulled(skin)])
    whole = skin.reconstruct(frames)
    assert whole._errors.pad is not None
    for i, frame in enumerate(frames):
        one = skin.reconstruct(frame)._errors.pad
        assert one is not None
        assert np.allclose(one.force, whole[i]._errors.pad.force, rtol=1e-9, atol=0.0)
    write_touch(whole, tmp_path / "touch.nc")
    again = touch_of(read_touch(tmp_path / "touch.nc"))
    assert np.array_equal(
        np.stack(again.interval(0.95, "force")), np.stack(whole.interval(0.95, "force")), equal_nan=True
    )


def test_without_a_decomposition_it_owes_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    uncertainty = pp.Uncertainty(youngs_modulus=0.1, depth=0.05)
    method = pp.Tikhonov(parameter=1e-13)
    readings = pp.Skin(PAD, DEEP).sense(BALL)
    dense = pp.Skin(PAD, DEEP, uncertainty=uncertainty).reconstruct(readings, method=method)._errors.pad
    monkeypatch.setattr(path, "LARGEST_DENSE_BLOCK", 1)
    free = pp.Skin(PAD, DEEP, uncertainty=uncertainty).reconstruct(readings, method=method)._errors.pad
    assert dense is not None
    assert free is not None
    assert np.allclose(free.traction, dense.traction, rtol=1e-2, atol=1e-3 * dense.traction.max())
    assert np.allclose(free.moment, dense.moment, rtol=1e-2)


@pytest.mark.long
@pytest.mark.parametrize(("seed", "size"), [(1, 0.2), (2, 0.2), (5, 0.2), (1, -0.2), (2, -0.2), (3, 0.5)])
def test_an_offset_beside_push_and_pull_is_within_the_interval(seed: int, size: float) -> None:
    """What pushes and pulls in different places takes an offset for traction all over, whichever method answers."""
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    array = pp.AreaArray(shape=(9, 9), pitch=2e-3, depth=2e-3, channels=["stress_zz"])
    traction = np.zeros((3, *pp.Skin(pad, array).surface.shape))
    n = traction.shape[-1] // 2
    traction[2, n - 3 : n, n - 3 : n], traction[2, n + 1 : n + 4, n + 1 : n + 4] = 3e3, -2e3
    plain = pp.Skin(pad, array)
    clean = np.asarray(plain.sense(traction))
    noise = 0.01 * np.abs(clean).max() * np.random.default_rng(seed).standard_normal(clean.shape)
    readings = clean + noise + size * float(np.abs(clean).max())
    truth = float(traction[2].sum() * plain.surface.cell)
    touch = plain.reconstruct(readings, components=["z"])
    assert any("nuisance=[]" in n for n in touch.notes)
    low, high = touch.interval(0.95, "force")
    assert low[2] < truth < high[2]
    sure = pp.Skin(pad, array, nuisance=[]).reconstruct(readings, components=["z"])
    assert not any("nuisance=[]" in n for n in sure.notes)
    low, high = sure.interval(0.95, "force")
    assert not low[2] < truth < high[2]
