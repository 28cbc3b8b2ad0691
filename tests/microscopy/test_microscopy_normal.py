"""Displacements out of the plane: normal traction of a cell, against blobs of force in closed form."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
import xarray
from scipy.special import i0e, i1e

import palpate as pp
from palpate.errors import InvalidInput
from palpate.microscopy import Field, cell_forces, read_field

MODULUS, PITCH, COUNT = 8e3, 1e-6, 40
#: Places [m] and forces (x to the right, y down, z out of the gel) [N] of a cell that pulls inwards, and up at its ends as down in its middle.
BLOBS = (((-9e-6, 0.0), (3e-9, 0.0, 2e-9)), ((9e-6, 0.0), (-3e-9, 0.0, 2e-9)), ((0.0, 0.0), (0.0, 0.0, -4e-9)))
SIZE = 1.5e-6


def moved(ratio: float) -> np.ndarray:
    """Displacement along x, y (down) and out of the gel by Gaussian blobs on a half-space: Cerruti's and Boussinesq's solutions (K. L. Johnson, Contact Mechanics, 1985, sections 3.2
    and 3.6) as means over a Gaussian.
    """
    at = PITCH * (np.arange(COUNT) - 0.5 * (COUNT - 1))
    out = np.zeros((3, COUNT, COUNT))
    for (px, py), (fx, fy, fz) in BLOBS:
        x, y = np.meshgrid(at - px, at - py)
        squares = x**2 + y**2 + 1e-30
        q = squares / (4 * SIZE**2)
        a = (1 + ratio) / (math.pi * MODULUS * SIZE) * math.sqrt(math.pi / 2)
        g0, g2 = a * (1 - 0.5 * ratio) * i0e(q), a * 0.5 * ratio * i1e(q)
        even, odd = g2 * (x * x - y * y) / squares, g2 * 2 * x * y / squares
        out[0] += (g0 + even) * fx + odd * fy
        out[1] += odd * fx + (g0 - even) * fy
        out[2] += a * (1 - ratio) * i0e(q) * fz
        # what is pulled up moves away from where it is pulled, and what is pulled along rises before it
        side = (1 - 2 * ratio) * (1 + ratio) / (2 * math.pi * MODULUS) * (1 - np.exp(-2 * q)) / squares
        out[0] += side * x * fz
        out[1] += side * y * fz
        out[2] -= side * (x * fx + y * fy)
    return out


def field_of(ratio: float, noise: float = 2e-9, seed: int = 0) -> Field:
    u = moved(ratio)
    u += np.array([noise, noise, 2 * noise])[:, None, None] * np.random.default_rng(seed).standard_normal(u.shape)
    return Field(displacement=u[:2], normal=u[2], start=(4.5, 4.5), step=10.0, pixel=0.1e-6)


@pytest.mark.parametrize("ratio", [0.3, 0.49])
@pytest.mark.long
def test_normal_forces_and_their_energy_are_held_by_their_intervals(ratio: float) -> None:
    pad = pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=ratio)
    forces = cell_forces(field_of(ratio), pad, draws=24, uncertainty=pp.Uncertainty(youngs_modulus=0.0, scale=0.0))
    found = forces.normal
    assert found is not None
    traction, std = found
    at = [round((p[0] / PITCH) + 0.5 * (COUNT - 1)) for p, _ in BLOBS]
    middle = COUNT // 2
    for column, (_, force) in zip(at, BLOBS):
        near = traction[middle - 5 : middle + 5, column - 4 : column + 5]
        assert near.sum() * PITCH**2 == pytest.approx(force[2], rel=0.15, abs=0.0)
    assert (std > 0).all()
    low, high = forces["net_force_z"].interval
    assert low < 0.0 < high
    # half the forces' work, by the same closed forms at the blobs' mean displacement
    shear = cell_forces(Field(displacement=moved(ratio)[:2], start=(4.5, 4.5), step=10.0, pixel=0.1e-6), pad, draws=24)[
        "strain_energy"
    ]
    assert forces["strain_energy_normal"].value > 0
    if ratio == 0.49:  # then neither direction moves the other
        assert forces["strain_energy"].value == pytest.approx(shear.value, rel=0.25, abs=0.0)
    a = (1 + ratio) * (1 - ratio) / (math.pi * MODULUS * math.sqrt(2) * SIZE) * math.sqrt(math.pi / 2)
    own = sum(0.5 * a * f[2] ** 2 for _, f in BLOBS)
    other = -sum(
        0.5 * abs(f[2] * g[2]) * (1 - ratio**2) / (math.pi * MODULUS * math.dist(p, q))
        for p, f in BLOBS for q, g in BLOBS if f[2] * g[2] < 0
    ) + 4e-18 * (1 - ratio**2) / (math.pi * MODULUS * 18e-6)  # fmt: skip
    side = (1 - 2 * ratio) * (1 + ratio) / (2 * math.pi * MODULUS)
    cross = sum(f[0] * g[2] * side * (p[0] - q[0]) / math.dist(p, q) ** 2 for p, f in BLOBS for q, g in BLOBS if p != q)
    low, high = forces["strain_energy_normal"].interval
    assert low < own + other + cross < high


@pytest.mark.long
def test_a_gel_that_is_compressible_gives_right_shear_with_normal_displacements_and_wrong_without() -> None:
    pad = pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=0.2)
    whole = field_of(0.2, noise=0.5e-9)
    flat = Field(displacement=whole.displacement, start=whole.start, step=whole.step, pixel=whole.pixel)
    truth = 2 * 3e-9 * 9e-6
    errors = [abs(cell_forces(f, pad, draws=24)["contractile_moment"].value / truth - 1) for f in (whole, flat)]
    assert errors[0] < 0.05
    assert errors[1] > 2 * errors[0]


def test_a_table_with_w_is_read_in_both_directions(tmp_path: Path) -> None:
    field = field_of(0.4)
    u = np.concatenate([field.displacement, field.normal[None]]) / field.pixel
    x, y = np.meshgrid(4.5 + 10.0 * np.arange(COUNT), 4.5 + 10.0 * np.arange(COUNT))
    table = tmp_path / "field.csv"
    rows = np.column_stack([p.ravel() for p in (x, y, *u)])
    np.savetxt(table, rows, delimiter=",", header="x [px],y [px],u [px],v [px],w [px]", comments="")
    up = read_field(table, pixel=0.1e-6)
    assert np.allclose(up.normal, field.normal)
    assert "out of the gel" in " ".join(up.notes)
    assert np.allclose(read_field(table, pixel=0.1e-6, normal="down").normal, -field.normal)
    assert read_field(table, pixel=0.1e-6, normal="ignore").normal is None
    with pytest.raises(InvalidInput, match="--normal"):
        read_field(table, pixel=0.1e-6, normal="z")
    np.savez(tmp_path / "field.npz", u=u[0], v=u[1], w=u[2])
    assert np.allclose(read_field(tmp_path / "field.npz", pixel=0.1e-6, unit="px", step=10).normal, field.normal)


def test_one_normal_displacement_for_each_vector() -> None:
    with pytest.raises(InvalidInput, match="each vector"):
        Field(displacement=np.zeros((2, 20, 30)), normal=np.zeros((30, 20)), start=(0, 0), step=8.0, pixel=1e-7)


@pytest.mark.long
def test_files_of_a_cell_hold_its_normal_traction(tmp_path: Path) -> None:
    forces = cell_forces(field_of(0.45), pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=0.45), draws=8)
    traction, std = forces.normal or (None, None)
    forces.write_vectors(tmp_path / "vectors.csv")
    rows = list(csv.DictReader((tmp_path / "vectors.csv").read_text().splitlines()))
    assert np.allclose([float(r["traction_normal [Pa]"]) for r in rows], np.ravel(traction), rtol=1e-5, atol=1e-9)
    assert np.allclose(read_field(tmp_path / "vectors.csv", pixel=0.1e-6).normal, forces.field.normal, atol=1e-13)
    forces.write_netcdf(tmp_path / "cell.nc")
    with xarray.open_dataset(tmp_path / "cell.nc") as held:
        assert np.allclose(held["field_traction_normal"], traction)
        assert np.allclose(held["field_std_normal"], std)
    with xarray.open_dataset(tmp_path / "cell.nc") as held:
        assert np.allclose(held["displacement_normal"], forces.field.normal)


@pytest.mark.long
def test_normal_traction_leaves_no_shear_in_beads_below_the_surface() -> None:
    count, depth = 24, 2e-6
    pad = pp.HalfSpace(youngs_modulus=MODULUS, poissons_ratio=0.3)
    channels = ["displacement_x", "displacement_y", "displacement_z"]
    skin = pp.Skin(pad, pp.AreaArray(shape=(count, count), pitch=PITCH, depth=depth, channels=channels))
    push = np.zeros((3, *skin.surface.shape))
    middle = skin.surface.shape[0] // 2
    push[2, middle - 2 : middle + 2, middle - 2 : middle + 2] = 500.0
    u = np.asarray(skin.sense(push)).reshape(3, count, count)
    u = u + 0.5e-9 * np.random.default_rng(0).standard_normal(u.shape)
    field = Field(displacement=u[:2], normal=-u[2], start=(4.5, 4.5), step=10.0, pixel=0.1e-6)
    found = cell_forces(field, pad, depth=depth, method="tikhonov", draws=8)
    # nothing pulls along the surface: sideways motion of the beads is due to the push
    assert found["strain_energy"].value < 0.05 * found["strain_energy_normal"].value
    assert found["net_force_z"].value == pytest.approx(-push[2].sum() * PITCH**2, rel=0.2, abs=0.0)
