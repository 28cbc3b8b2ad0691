"""Forces on micropillars: parts of the formula against others', errors against drawn posts, tables, refusals."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from palpate.errors import InvalidInput
from palpate.microscopy import Pillar, pillar_forces, read_pillars

POST = {"diameter": 2e-6, "height": 6e-6, "youngs_modulus": 2e6}


def test_bending_is_that_of_a_cantilever_and_shear_is_timoshenkos():
    post = Pillar(**POST, poissons_ratio=0.4)
    inertia, area = math.pi * 2e-6**4 / 64, math.pi * 1e-6**2
    assert post.compliances["bending"] == pytest.approx(6e-6**3 / (3 * 2e6 * inertia))
    # Cowper's coefficient of a round beam (G. R. Cowper, J. Appl. Mech. 33, 1966, 335-340)
    cowper, shear = 6 * 1.4 / (7 + 6 * 0.4), 2e6 / (2 * 1.4)
    assert post.compliances["shear"] == pytest.approx(6e-6 / (cowper * shear * area))
    assert post.bending_alone == pytest.approx(3 * math.pi * 2e6 * 2e-6**4 / (64 * 6e-6**3))


@pytest.mark.parametrize("ratio", [0.3, 0.4, 0.5])
def test_the_base_tilts_about_as_under_a_stiff_disc(ratio):
    """A stiff disc turns by 3 (1 - nu^2) M/(4 E a^3) (K. L. Johnson, Contact Mechanics, section 3.3), the least of all; the linear stress of a beam turns the base somewhat more."""
    post = Pillar(**POST, poissons_ratio=ratio)
    moment = post.height  # of a force of one
    stiff = 3 * (1 - ratio**2) * moment / (4 * post.youngs_modulus * 1e-6**3)
    assert 1.0 < post.compliances["tilt"] / post.height / stiff < 1.25
    assert Pillar(**POST, rigid_base=True).compliances["tilt"] == 0.0


def test_bending_alone_overestimates_forces_by_up_to_tens_of_per_cent():
    """ "Neglecting deformations of elastic substrates systematically overestimates the applied forces (up to 40 %)" (Schoen et al. 2010, abstract): of posts from 2 diameters on."""
    for slender, low, high in ((2.0, 0.25, 0.45), (4.0, 0.1, 0.2), (8.0, 0.05, 0.12)):
        parts = Pillar(diameter=1e-6, height=slender * 1e-6, youngs_modulus=2e6).compliances
        assert low < parts["tilt"] / (parts["bending"] + parts["shear"]) < high, slender


def test_errors_are_those_of_posts_that_are_drawn():
    post = Pillar(**POST, diameter_error=0.03, height_error=0.02, modulus_error=0.1)
    rng = np.random.default_rng(0)
    drawn = [
        Pillar(
            diameter=2e-6 * (1 + 0.03 * a), height=6e-6 * (1 + 0.02 * b), youngs_modulus=2e6 * (1 + 0.1 * c)
        ).stiffness.value
        for a, b, c in rng.standard_normal((3000, 3))
    ]
    assert np.std(drawn) == pytest.approx(post.stiffness.std, rel=0.06)


def test_intervals_of_forces_hold_them():
    rng = np.random.default_rng(1)
    true = 5e-9 * rng.standard_normal((400, 2))
    post = Pillar(**POST)
    noise = 2e-8
    moved = true / post.stiffness.value + noise * rng.standard_normal((400, 2))
    found = pillar_forces(np.zeros((400, 2)), moved, post, noise=noise)
    held = np.abs(found.forces - true) < 1.96 * found.std
    assert 0.92 < held.mean() < 0.98
    for key, value in (("mean_force", np.hypot(*true.T).mean()), ("net_force_x", true[:, 0].sum()), ("strain_energy", 0.5 * (true**2).sum() / post.stiffness.value)):  # fmt: skip
        assert abs(found[key].value - value) < 3 * found[key].std, key


def test_a_table_in_pixels_with_missing_posts(tmp_path):
    path = tmp_path / "posts.csv"
    path.write_text("x (px),y (px),dx (px),dy (px)\n0,0,1,0\n40,0,nan,nan\n80,0,-1,0.5\n")
    with pytest.raises(InvalidInput, match="--pixel"):
        read_pillars(path)
    at, moved, std = read_pillars(path, pixel=1e-7)
    assert std is None
    assert at[2] == pytest.approx([8e-6, 0.0])
    found = pillar_forces(at, moved, Pillar(**POST))
    assert np.isnan(found.forces[1]).all()
    assert any("1 of 3 posts have no deflection" in n for n in found.notes)
    assert any("is not known, and in no error" in n for n in found.notes)
    found.write_table(tmp_path / "out.csv")
    assert len((tmp_path / "out.csv").read_text().splitlines()) == 4


def test_a_table_without_units_is_refused(tmp_path):
    path = tmp_path / "posts.csv"
    path.write_text("x,y,dx,dy\n0,0,1,0\n40,0,0,1\n")
    with pytest.raises(InvalidInput, match="unit"):
        read_pillars(path)
    assert read_pillars(path, unit="um")[1][0] == pytest.approx([1e-6, 0.0])
    path.write_text("x [um],y [um],dx [um],dy [um]\n0,0,1,0\n40,0,0,1\n")
    with pytest.raises(InvalidInput, match="not in nm"):
        read_pillars(path, unit="nm")


@pytest.mark.parametrize(
    ("change", "said"),
    [({"diameter": 0.0}, "diameter"), ({"height": math.nan}, "height"), ({"poissons_ratio": 0.6}, "0 to 0.5"), ({"modulus_error": 5}, "0.05 is 5 %")],
)  # fmt: skip
def test_posts_that_cannot_be_are_refused(change, said):
    with pytest.raises(InvalidInput, match=said):
        Pillar(**{**POST, **change})


def test_deflections_that_cannot_be_are_refused():
    post = Pillar(**POST)
    with pytest.raises(InvalidInput, match="longer than the post"):
        pillar_forces(np.zeros((1, 2)), np.array([[0.1, 0.0]]), post)
    with pytest.raises(InvalidInput, match="no post has a deflection"):
        pillar_forces(np.zeros((1, 2)), np.full((1, 2), np.nan), post)
    with pytest.raises(InvalidInput, match=r"\(n, 2\)"):
        pillar_forces(np.zeros((1, 2)), np.zeros(2), post)
    with pytest.raises(InvalidInput, match="noise"):
        pillar_forces(np.zeros((1, 2)), np.zeros((1, 2)), post, noise=-1.0)
    assert any("bend by more" in n for n in pillar_forces(np.zeros((1, 2)), np.array([[2e-6, 0.0]]), post).notes)


def test_errors_of_deflections_have_the_unit_of_their_columns(tmp_path: Path) -> None:
    path = tmp_path / "posts.csv"
    for errors, title in (("5,5", "ex [nm],ey [nm]"), ("0.005,0.005", "ex,ey")):
        path.write_text(f"x [um],y [um],dx [um],dy [um],{title}\n0,0,0.1,0,{errors}\n4,0,-0.25,0.03,{errors}\n")
        std = read_pillars(path)[2]
        assert std is not None
        np.testing.assert_allclose(std, 5e-9)
