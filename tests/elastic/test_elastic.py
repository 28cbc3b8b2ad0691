from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import palpate as pp
from palpate.elastic import AREA_CHANNELS, LINE_CHANNELS, stress_from_strains, transfer
from palpate.elastic.channels import channel_unit, mirror_parity

RATIOS = (0.0, 0.3, 0.49, 0.5)


def pad(nu: float, modulus: float = 3.0) -> pp.HalfSpace:
    return pp.HalfSpace(youngs_modulus=modulus, poissons_ratio=nu)


@pytest.mark.parametrize("nu", RATIOS)
def test_states_obey_the_elasticity_equations(nu: float) -> None:
    """The six first-order equations of PHYSICS (plane strain and antiplane), by a Richardson-extrapolated difference."""
    body = pad(nu)
    mu, b = body.shear_modulus, nu / (1 - nu)
    c = (1 - 2 * nu) / (2 * mu * (1 - nu))
    k, z = np.array([0.3, 1.0, 4.0]), 0.7

    def at(depth: float) -> tuple[np.ndarray, np.ndarray]:
        # along x the states are (i U, u_t, u_z, i S, T, N)
        s = np.moveaxis(body.states(k, np.stack([np.ones(3), np.zeros(3)], -1), depth), 0, -1)
        radial, transverse = s[[0, 2, 3, 5]] / np.array([1j, 1, 1j, 1])[:, None, None], s[[1, 4], 1]
        assert not s[[0, 2, 3, 5], 1].any()
        assert not s[[1, 4]][:, [0, 2]].any()
        columns = radial[:, [0, 2]] * np.array([1j, 1])[:, None]  # per unit S0 and N0
        assert not columns.imag.any()
        assert not transverse.imag.any()
        in_plane = columns.real
        return np.concatenate([in_plane[:2] / k, in_plane[2:]]), np.stack([transverse.real[0] / k, transverse.real[1]])

    def slope(h: float, which: int) -> np.ndarray:
        return (at(z + h)[which] - at(z - h)[which]) / (2 * h)

    (u, uz, s, n), (ut, t) = at(z)
    for which, expected in (
        (0, np.stack([-k * uz - s / mu, b * k * u - c * n, -(2 * mu / (1 - nu)) * k**2 * u - b * k * n, k * s])),
        (1, np.stack([-t / mu, -mu * k**2 * ut])),
    ):
        derivative = (4 * slope(5e-4, which) - slope(1e-3, which)) / 3
        np.testing.assert_allclose(derivative, expected, rtol=1e-9, atol=1e-10)


def test_founding_kernels() -> None:
    """p -> s_zz is (1 + kz) e^-kz, q -> s_zz is -i kz e^-kz; nu = 0.5, E = 1: p -> e_zz is 1.5 kz e^-kz."""
    k, z = np.array([1e-8, 0.1, 1.0, 7.0, 1e4]), 1.5
    m = transfer(pad(0.5, 1.0), k, 0.0, z, ["stress_zz", "strain_zz"], line=True)
    np.testing.assert_allclose(m[:, 0, 2], (1 + k * z) * np.exp(-k * z), rtol=1e-13)
    np.testing.assert_allclose(m[:, 0, 0], -1j * k * z * np.exp(-k * z), rtol=1e-13)
    np.testing.assert_allclose(m[:, 1, 2], 1.5 * k * z * np.exp(-k * z), rtol=1e-10, atol=1e-24)


@given(
    nu=st.floats(0, 0.5),
    kx=st.floats(-50, 50),
    ky=st.floats(-50, 50),
    depth=st.floats(0, 3),
    modulus=st.floats(1e-3, 1e12),
)
@pytest.mark.long
def test_physics_of_one_wavevector(nu: float, kx: float, ky: float, depth: float, modulus: float) -> None:
    """Traction is the stress at z = 0; Hooke's law; strain is the gradient of displacement; surface reciprocity."""
    if np.hypot(kx, ky) < 1e-3:
        return
    body = pad(nu, modulus)
    m = dict(zip(AREA_CHANNELS, transfer(body, kx, ky, depth, AREA_CHANNELS)))
    mu = body.shear_modulus
    surface = transfer(body, kx, ky, 0.0, ["stress_xz", "stress_yz", "stress_zz"])
    np.testing.assert_allclose(surface, np.eye(3), atol=1e-12)

    scale = max(np.abs(m["stress_zz"]).max(), np.abs(m["stress_xx"]).max(), 1e-300)
    for ij in ("xz", "yz", "xy"):
        np.testing.assert_allclose(2 * mu * m[f"strain_{ij}"], m[f"stress_{ij}"], atol=1e-12 * scale)
    for i, j, h in (("x", "y", "z"), ("y", "z", "x"), ("z", "x", "y")):
        hooke = (m[f"stress_{i}{i}"] - nu * (m[f"stress_{j}{j}"] + m[f"stress_{h}{h}"])) / modulus
        np.testing.assert_allclose(m[f"strain_{i}{i}"] * modulus, hooke * modulus, atol=1e-11 * scale)
    wave = {"x": kx, "y": ky}
    for i, j in (("x", "x"), ("y", "y"), ("x", "y")):
        gradient = -0.5 * (1j * wave[j] * m[f"displacement_{i}"] + 1j * wave[i] * m[f"displacement_{j}"])
        np.testing.assert_allclose(m[f"strain_{i}{j}"] * mu, gradient * mu, atol=1e-11 * scale)

    compliance = transfer(body, kx, ky, 0.0, ["displacement_x", "displacement_y", "displacement_z"])
    size = np.abs(compliance).max()
    np.testing.assert_allclose(compliance, compliance.conj().T, atol=1e-13 * size)
    assert np.linalg.eigvalsh(compliance).min() > 0


def test_mean_traction_policy() -> None:
    """k = 0: the mean of s_.z passes unchanged, s_xx of a half-plane is 1 per p at any nu, displacement is undefined."""
    for nu in RATIOS:
        line = transfer(pad(nu), 0.0, 0.0, 1.0, LINE_CHANNELS, line=True)
        row = dict(zip(LINE_CHANNELS, line))
        np.testing.assert_allclose(row["stress_zz"], [0, 0, 1], atol=1e-15)
        np.testing.assert_allclose(row["stress_xz"], [1, 0, 0], atol=1e-15)
        np.testing.assert_allclose(row["stress_xx"], [0, 0, 1], atol=1e-15)
        assert np.isnan(row["displacement_z"]).all()
        area = dict(zip(AREA_CHANNELS, transfer(pad(nu), 0.0, 0.0, 1.0, AREA_CHANNELS)))
        np.testing.assert_allclose(area["stress_yz"], [0, 1, 0], atol=1e-15)
        np.testing.assert_allclose(area["stress_xx"], area["stress_yy"], atol=1e-15)


def test_rotation_of_the_wavevector() -> None:
    """Turning wavevector and traction by 90 degrees turns the answer."""
    m = transfer(pad(0.4), 1.0, 0.7, 0.5, ["displacement_x", "displacement_y", "stress_xz", "stress_yz", "stress_zz"])
    turned = transfer(
        pad(0.4), -0.7, 1.0, 0.5, ["displacement_x", "displacement_y", "stress_xz", "stress_yz", "stress_zz"]
    )
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    back = turned @ turn
    np.testing.assert_allclose(back[0], -m[1], atol=1e-15)
    np.testing.assert_allclose(back[1], m[0], atol=1e-15)
    np.testing.assert_allclose(back[2], -m[3], atol=1e-15)
    np.testing.assert_allclose(back[4], m[4], atol=1e-15)


def test_stress_from_two_strains() -> None:
    body = pad(0.3, 2.0)
    m = transfer(body, 1.3, 0.0, 0.4, ["strain_xx", "strain_zz", "stress_xx", "stress_zz"], line=True)
    # the out-of-plane column is antiplane: plane strain holds for the others
    xx, zz = stress_from_strains(m[0, [0, 2]], m[1, [0, 2]], youngs_modulus=2.0, poissons_ratio=0.3)
    np.testing.assert_allclose(xx, m[2, [0, 2]], rtol=1e-13)
    np.testing.assert_allclose(zz, m[3, [0, 2]], rtol=1e-13)
    with pytest.raises(pp.NotObservable, match="incompressible"):
        stress_from_strains(0.1, -0.1, youngs_modulus=2.0, poissons_ratio=0.5)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"youngs_modulus": 0.0, "poissons_ratio": 0.3}, "youngs_modulus"),
        ({"youngs_modulus": float("nan"), "poissons_ratio": 0.3}, "youngs_modulus"),
        ({"youngs_modulus": 1.0, "poissons_ratio": 0.51}, "poissons_ratio"),
        ({"youngs_modulus": 1.0, "poissons_ratio": -0.1}, "poissons_ratio"),
    ],
)
def test_bad_material(options: dict[str, float], word: str) -> None:
    with pytest.raises(pp.InvalidInput, match=word):
        pp.HalfSpace(**options)


def test_names() -> None:
    assert channel_unit("strain_xz") == "1"
    assert mirror_parity("stress_xz", "x") == -1
    assert mirror_parity("stress_xz", "y") == 1
    assert mirror_parity("stress_xx", "x") == 1
    assert mirror_parity("z", "x") == 1
