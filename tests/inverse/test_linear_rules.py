"""Rules that choose a parameter where they have nothing to go by: they say so instead of giving a plausible wrong answer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import Rounds
from palpate.inverse.linear.parameter import Tried, candidates, choose, tikhonov, truncate
from palpate.recordings import Recording, read_table

CHANNELS = ["displacement_x", "displacement_y"]


def beads(tables: Path, name: str) -> tuple[Recording, pp.HalfSpace, float]:
    """Real and synthetic bead displacements on a grid, the gel, and its pitch."""
    if name == "axon":
        pixel, modulus, ratio, columns = 1e-6 / 1.3, 100.0, 0.5, ["pos/0", "vec/0"]
        path = tables / "beads_axon.h5"
    else:
        pixel, modulus, ratio, columns = 1e-6, 1e4, 0.3, ["x", "y", "u", "v"]
        path = tables / "beads_synthetic.csv"
    table = read_table(
        path, columns=columns, channels=CHANNELS, position_factor=pixel, reading_factor=pixel, follow=True
    )
    pad = pp.HalfSpace(youngs_modulus=modulus, poissons_ratio=ratio)
    return table.gridded(10 * pixel), pad, 10 * pixel


@pytest.mark.parametrize("name", ["axon", "synthetic"])
def test_an_l_curve_without_corner_does_not_make_traction_vanish(tables: Path, name: str) -> None:
    """Bead displacements: the curve bends the other way all over, and its "corner" was no traction at all."""
    recording, pad, pitch = beads(tables, name)
    array = pp.AreaArray(shape=recording.readings.shape[2:], pitch=pitch, depth=0.0, channels=CHANNELS)
    skin = pp.Skin(pad, array, boundary="periodic")
    for order in (0, 1):
        found = skin.reconstruct(recording.readings[0], method=pp.Tikhonov(order=order, rule="lcurve"))
        other = skin.reconstruct(recording.readings[0], method=pp.Tikhonov(order=order, rule="evidence"))
        np.testing.assert_allclose(found.values, other.values)
        assert any("the curve has no corner" in n and '"evidence"' in n for n in found.notes)
        assert not any("corner" in n for n in other.notes)


def test_an_l_curve_with_a_corner_is_left_alone(rng: np.random.Generator) -> None:
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    skin = pp.Skin(pad, pp.LineArray(count=61, pitch=1e-3, depth=2e-3, channels=["stress_zz"]))
    contact = pp.solutions.hertz_line(half_width=6e-3, force=5.0)
    clean = np.asarray(skin.sense(contact))
    noise = rng.standard_normal((6, *clean.shape)) * np.abs(clean).max()
    touch = skin.reconstruct(clean + 0.02 * noise, method=pp.Tikhonov(rule="lcurve"))
    assert not any("corner" in n for n in touch.notes)
    error = np.linalg.norm(touch.values - skin.sample(contact), axis=(1, 2)) / np.linalg.norm(skin.sample(contact))
    assert (error < 0.25).all()
    # half of a batch is noise: those frames, and only those, are left to another rule
    mixed = np.concatenate([clean + 0.02 * noise[:3], noise[3:]])
    touch = skin.reconstruct(mixed, method=pp.Tikhonov(rule="lcurve"))
    assert any("no corner in 3 of 6 frames" in n for n in touch.notes)
    np.testing.assert_allclose(
        touch.values[3:], skin.reconstruct(mixed[3:], method="tikhonov").values, rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("rule", ["evidence", "gcv"])
def test_noise_is_never_reported_below_what_grids_are_known_to(tables: Path, rule: Any) -> None:
    """Real bead displacements: the noise was said to be exactly zero."""
    recording, pad, pitch = beads(tables, "axon")
    array = pp.AreaArray(shape=recording.readings.shape[2:], pitch=pitch, depth=0.0, channels=CHANNELS)
    skin = pp.Skin(pad, array, boundary="periodic")
    touch = skin.reconstruct(recording.readings[0], method=pp.Tikhonov(order=0, rule=rule))
    assert (touch.noise_std >= 2e-4 * np.abs(recording.readings[0]).max() * (1 - 1e-9)).all()
    assert (np.asarray(touch.std())[:2] > 0).all()
    assert any("noise cannot be separated from traction" in n for n in touch.notes)


def test_the_floor_is_part_of_the_evidence(rng: np.random.Generator) -> None:
    """Noise that is known not to be smaller is not followed: the parameter is that of the noise given."""
    values = 10.0 ** rng.uniform(-6, 0, 300)
    power = (values + 1e-9) * rng.standard_normal((1, 300)) ** 2
    ones = np.ones(300)
    free = choose("evidence", tikhonov, values, ones, power, noise_known=False)
    held = choose("evidence", tikhonov, values, ones, power, noise_known=False, floor=np.array([1e-3]))
    given = choose("evidence", tikhonov, values, ones, power / 1e-3, noise_known=True)
    assert held.noise_variance[0] == 1e-3
    assert held.parameter[0] == pytest.approx(given.parameter[0], rel=1e-6)
    assert free.parameter[0] < 0.1 * held.parameter[0]


def test_a_cut_off_never_parts_a_pair_that_symmetry_makes_equal(rng: np.random.Generator) -> None:
    """A square array: shear along x and along y have the same singular values but for rounding."""
    pairs = np.repeat(10.0 ** np.linspace(0, -8, 60), 2)
    power = (1e3 * pairs + 1.0) * rng.standard_normal((20, 120)) ** 2
    for rule in ("gcv", "lcurve"):
        for _ in range(3):
            values = pairs * (1 + 1e-13 * rng.standard_normal(120))
            cut = choose(rule, truncate, values, np.ones(120), power, noise_known=False).parameter
            kept = (values[None, :] > cut[:, None]).sum(axis=1)
            assert (kept % 2 == 0).all()


def test_what_does_not_depend_on_frames_may_be_kept() -> None:
    """The same parameter and noise whether the candidates' filter factors are kept or made anew."""
    rng = np.random.default_rng(7)
    values, ones = 10.0 ** -rng.uniform(0.0, 9.0, 40), np.ones(40)
    power = (1.0 + values[None, :] / 1e-4) * rng.standard_normal((3, 40)) ** 2
    tried = Tried(tikhonov, candidates(values), values, ones)
    for rule in ("evidence", "gcv", "lcurve"):
        anew = choose(rule, tikhonov, values, ones, power, noise_known=False)
        kept = choose(rule, tikhonov, values, ones, power, noise_known=False, tried=tried)
        np.testing.assert_array_equal(anew.parameter, kept.parameter)
        np.testing.assert_array_equal(anew.noise_variance, kept.noise_variance)


def test_a_frame_projects_readings_once_and_others_anew() -> None:
    class Counting:
        asked = 0

        def project(self, rows: list[Floats]) -> Floats:
            self.asked += 1
            return 2.0 * np.asarray(rows[0]).ravel()

    spectrum, rounds = Counting(), Rounds()
    first, second = np.ones((1, 4)), np.full((1, 4), 3.0)
    with rounds:
        for rows in (first, first.copy(), second, second, first):
            np.testing.assert_array_equal(rounds.projected(spectrum, [rows]), 2.0 * rows.ravel())  # type: ignore[arg-type]
        assert spectrum.asked == 3
    rounds.projected(spectrum, [first])  # type: ignore[arg-type]
    assert spectrum.asked == 4  # nothing outlives the frame
