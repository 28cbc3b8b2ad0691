"""Bonded layers: closed forms and limits, numerical safety, reference solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from conftest import channel_of, relative
from long_runs import long_runs
from palpate import solutions
from palpate.elastic import AREA_CHANNELS, LINE_CHANNELS, transfer


def layer(thickness: float = 1.0, modulus: float = 1.0, nu: float = 0.5) -> pp.Layer:
    return pp.Layer(thickness=thickness, youngs_modulus=modulus, poissons_ratio=nu)


def random_pad(rng: np.random.Generator) -> pp.BondedLayers:
    layers = [
        layer(10 ** rng.uniform(-4, 0), 10 ** rng.uniform(-4, 4), rng.choice([0.0, 0.3, 0.45, 0.5]))
        for _ in range(rng.integers(1, 21))
    ]
    soft = pp.HalfSpace(youngs_modulus=10 ** rng.uniform(-4, 4), poissons_ratio=0.4)
    return pp.BondedLayers(layers, soft if rng.random() < 0.5 else None)


def test_one_incompressible_layer() -> None:
    """Base normal and shear stress and surface displacement per pressure, in closed form (plane strain)."""
    q = np.array([1e-8, 1e-4, 0.1, 0.5, 0.999, 1.001, 2.0, 4.0, 20.0, 100.0])
    pad, mu = pp.BondedLayers([layer()]), 1 / 3
    base = transfer(pad, q, 0.0, 1.0, ["stress_zz", "stress_xz"], line=True)[..., 2]
    cosh, sinh = np.cosh(q), np.sinh(q)
    np.testing.assert_allclose(base[:, 0], (cosh + q * sinh) / (cosh**2 + q**2), rtol=1e-13)
    np.testing.assert_allclose(np.abs(base[:, 1]), q * cosh / (cosh**2 + q**2), rtol=1e-13)
    surface = transfer(pad, q, 0.0, 0.0, ["displacement_z"], line=True)[:, 0, 2]
    expected = (sinh * cosh - q) / (2 * mu * q * (cosh**2 + q**2))
    np.testing.assert_allclose(surface[2:], expected[2:], rtol=1e-11)
    np.testing.assert_allclose(surface[:2], q[:2] ** 2 / (3 * mu), rtol=1e-7)  # thin limit k^2 h^3/(3 mu)
    assert base[4, 0] == pytest.approx(0.804, abs=1e-3)
    assert base[7, 0] == pytest.approx(0.179, abs=1e-3)


def test_thin_and_thick_limits_and_their_order() -> None:
    """u_z -> k^2 h^3/(3 mu) with error of order (kh)^2; a half-space with error exp(-2 k h) (k h)^2."""
    mu, k = 1 / 3, 1.0
    thin = [
        abs(
            transfer(pp.BondedLayers([layer(h)]), k, 0.0, 0.0, ["displacement_z"], line=True)[0, 2]
            * 3
            * mu
            / (k**2 * h**3)
            - 1
        )
        for h in (0.02, 0.01)
    ]
    assert np.log2(thin[0] / thin[1]) == pytest.approx(2.0, abs=0.01)
    half = transfer(pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5), k, 0.0, 0.0, ["displacement_z"], line=True)[
        0, 2
    ]
    for h in (6.0, 10.0):
        thick = transfer(pp.BondedLayers([layer(h)]), k, 0.0, 0.0, ["displacement_z"], line=True)[0, 2]
        assert abs(thick / half - 1) < 10 * h**2 * np.exp(-2 * h)


def test_mean_traction() -> None:
    """k = 0 on a rigid base: s_xx is nu/(1-nu) p, u_z = p (h-z)(1+nu)(1-2nu)/(E(1-nu)), u_x = q (h-z)/mu."""
    nu, modulus, h, z = 0.3, 2.0, 1.5, 0.4
    row = dict(zip(AREA_CHANNELS, transfer(pp.BondedLayers([layer(h, modulus, nu)]), 0.0, 0.0, z, AREA_CHANNELS)))
    np.testing.assert_allclose(row["stress_xx"], [0, 0, nu / (1 - nu)], atol=1e-12)
    np.testing.assert_allclose(row["displacement_z"], [0, 0, (h - z) * (1 + nu) * (1 - 2 * nu) / (modulus * (1 - nu))])
    np.testing.assert_allclose(row["displacement_x"], [(h - z) * 2 * (1 + nu) / modulus, 0, 0])
    soft = pp.BondedLayers([layer()], pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3))
    assert np.isnan(transfer(soft, 0.0, 0.0, 0.0, ["displacement_z"])).all()


@pytest.mark.parametrize("seed", [*range(10), *long_runs(*range(10, 40))])
def test_safe_everywhere(seed: int) -> None:
    """k h from 1e-8 to 1e4, moduli 1e-4 to 1e4, 1 to 20 layers: finite, reciprocal to 1e-10, positive definite."""
    pad = random_pad(np.random.default_rng(seed))
    k = np.geomspace(1e-8, 1e4, 50) / pad.thickness
    compliance = transfer(pad, 0.6 * k, 0.8 * k, 0.0, ["displacement_x", "displacement_y", "displacement_z"])
    scale = 1 / np.sqrt(np.abs(np.einsum("kii->ki", compliance)))
    balanced = compliance * scale[:, :, None] * scale[:, None, :]
    assert np.abs(balanced - balanced.conj().swapaxes(1, 2)).max() < 1e-10
    assert np.linalg.eigvalsh(balanced).min() > 0
    for depth in (0.0, 0.3 * pad.thickness, pad.thickness):
        assert np.isfinite(transfer(pad, k, 0.0, depth, AREA_CHANNELS)).all()


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_cutting_a_layer_changes_nothing(nu: float) -> None:
    k = np.geomspace(1e-3, 60, 40)
    whole = pp.BondedLayers([layer(1.0, 2.0, nu)])
    cut = pp.BondedLayers([layer(t, 2.0, nu) for t in (0.1, 0.35, 0.05, 0.5)])
    on_itself = pp.BondedLayers([layer(1.0, 2.0, nu)], pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=nu))
    half = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=nu)
    for z in (0.0, 0.07, 0.1, 0.45, 0.8, 1.0):
        a, b = (transfer(p, k, 0.3 * k, z, AREA_CHANNELS) for p in (whole, cut))
        np.testing.assert_allclose(a, b, atol=1e-12 * np.abs(a).max())
        a, b = (transfer(p, k, 0.3 * k, z, AREA_CHANNELS) for p in (half, on_itself))
        np.testing.assert_allclose(a, b, atol=1e-12 * np.abs(a).max())
    a, b = (transfer(p, k, 0.3 * k, 1.7, AREA_CHANNELS) for p in (half, on_itself))
    np.testing.assert_allclose(a, b, atol=1e-12 * np.abs(a).max())


def test_interfaces() -> None:
    """Traction and displacement pass on; s_xx jumps, and belongs to the upper layer."""
    pad = pp.BondedLayers([layer(0.5, 1.0, 0.3), layer(0.7, 10.0, 0.45)])
    k = np.array([0.5, 3.0])
    above, below = (
        dict(zip(LINE_CHANNELS, np.moveaxis(transfer(pad, k, 0.0, z, LINE_CHANNELS, line=True), 1, 0)))
        for z in (0.5, 0.5 * (1 + 1e-7))
    )
    for name in ("displacement_x", "displacement_z", "stress_zz", "stress_xz", "strain_xx"):
        np.testing.assert_allclose(above[name], below[name], atol=1e-5)
    assert np.abs(above["stress_xx"] - below["stress_xx"]).max() > 0.1


@pytest.mark.parametrize("depth", [0.0, 0.2, 0.7, 1.0])
@pytest.mark.long
def test_the_influence_in_space_transforms_back(depth: float) -> None:
    """Quadrature plus damped half-space against the matrix: a layer's fields die out, so a sum over the line suffices."""
    from palpate.sensing.kernels import influence

    names = [
        n for n in LINE_CHANNELS if depth > 0 or n in ("displacement_x", "displacement_z", "stress_zz", "stress_xz")
    ]
    pad = pp.BondedLayers([layer(0.4, 1.0, 0.4), layer(0.6, 3.0, 0.5)])
    dx, n = 0.05, 2001
    x = (np.arange(n) - n // 2) * dx
    kernel = influence(pad, [x], [dx], depth, names, [(np.zeros(1), np.ones(1))])
    k = np.array([0.0, 0.7, 3.0])
    found = np.einsum("cpn,kn->kcp", kernel, np.exp(-1j * k[:, None] * x))
    expected = transfer(pad, k, 0.0, depth, names, line=True)[..., [0, 2]] * np.sinc(k * dx / 2 / np.pi)[:, None, None]
    # point samples of a cell's surface displacement see its kinks: second order in dx
    np.testing.assert_allclose(found, expected, atol=2e-3 if depth == 0 else 2e-7)


@pytest.mark.long
def test_area_and_line_agree() -> None:
    """A strip that is long in y is a line contact in its middle."""
    pad = pp.BondedLayers([layer(0.5, 1.0, 0.4), layer(0.5, 0.2, 0.5)])
    names = ["displacement_x", "displacement_z", "stress_xx", "stress_zz", "stress_xz", "strain_zz"]
    x = np.array([-0.9, -0.2, 0.4, 1.3])
    for depth in (0.2, 1.0):
        line = pp.Skin(
            pad, pp.ScatteredArray(positions=x, depth=depth, channels=names), surface=pp.LineGrid(count=4, spacing=0.25)
        )
        positions = np.stack([x, 1e-3 * np.arange(4)], axis=1)
        area = pp.Skin(
            pad,
            pp.ScatteredArray(positions=positions, depth=depth, channels=names),
            surface=pp.AreaGrid(shape=(120, 4), spacing=(0.5, 0.25)),
        )
        traction = np.zeros((3, 120, 4))
        traction[0], traction[2] = 0.4, 1.0
        np.testing.assert_allclose(area.sense(traction), line.sense(traction[[0, 2], 0]), atol=2e-6)


@pytest.mark.parametrize(
    "case", ["h1__nu0.45__hertz_p", *long_runs("h1__nu0.3__strip_q", "h1__nu0.5__strip_q", "h0.5__nu0.5__strip_q")]
)
@pytest.mark.long
def test_layers_against_mesh_free_solutions(oracle: Any, case: str) -> None:
    data = oracle("mfs_layer_2d")
    group, nu, load = case.split("__")
    pad = pp.BondedLayers([layer(float(group[1:]), 1.0, float(nu[2:]))])
    cells = 128
    grid = pp.LineGrid(count=2 * cells, spacing=1 / cells)
    contact = (
        solutions.strip(half_width=1, traction=1)
        if "strip" in load
        else solutions.hertz_line(half_width=1, force=np.pi / 2)
    )
    traction = contact.averages(grid.edges)
    if load.endswith("q"):
        traction = traction[::-1]
    x = data[f"{group}__x"][::4]
    for kind in ("z", "z_u"):
        fields = ["u_x", "u_z"] if kind == "z_u" else ["S_zz", "S_xx", "S_xz", "eps_zz", "eps_xx"]
        for i, z in enumerate(data[f"{group}__{kind}"]):
            array = pp.ScatteredArray(positions=x, depth=float(z), channels=[channel_of(f) for f in fields])
            for field, row in zip(fields, pp.Skin(pad, array, surface=grid).sense(traction)):
                true = data[f"{case}__{field}"][:, ::4]
                largest = max(np.linalg.norm(r) for r in true)
                if np.linalg.norm(true[i]) > 1e-3 * largest:
                    assert relative(row, true[i]) < 1e-3, (field, z)


@pytest.mark.long
def test_base_taxels() -> None:
    pad = pp.BondedLayers([layer(2e-3, 2e5, 0.48)])
    skin = pp.Skin(
        pad,
        pp.AreaArray(
            shape=(11, 11), pitch=1e-3, depth="base", channels=["stress_xz", "stress_yz", "stress_zz"], noise=50.0
        ),
    )
    assert skin.planes[0].depth == 2e-3
    contact = solutions.hertz_point(contact_radius=3e-3, force=0.4).sliding(0.4)
    touch = skin.reconstruct(skin.sense(contact, rng=np.random.default_rng(0)))
    assert relative(touch.values, skin.sample(contact)) < 0.25
    np.testing.assert_allclose(touch.force, contact.force, atol=0.02)
    with pytest.raises(pp.InvalidInput, match="below the rigid base"):
        pp.Skin(pad, pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=3e-3, channels=["stress_zz"]))
    with pytest.raises(pp.InvalidInput, match="HalfSpace has none"):
        pp.Skin(pad.surface, pp.AreaArray(shape=(4, 4), pitch=1e-3, depth="base", channels=["stress_zz"]))


@pytest.mark.parametrize("method", ["dft", "linear", "hilgers", "truncated"])
def test_methods_on_layers(method: Any) -> None:
    pad = pp.BondedLayers([layer(2.0, 1.0, 0.48)])
    array = pp.LineArray(count=61, pitch=0.5, depth=1.0, channels=["stress_xz", "stress_zz"])
    contact = solutions.hertz_line(half_width=3.0, force=1.0).partial_slip(0.5, 0.3)
    skin = pp.Skin(pad, array)
    touch = skin.reconstruct(skin.sense(contact), method=method)
    np.testing.assert_allclose(touch.force, [0.3, 1.0], atol=0.02)


@pytest.mark.long
def test_friction_on_a_layer() -> None:
    pad = pp.BondedLayers([layer(2.0, 1.0, 0.45)])
    array = pp.LineArray(count=81, pitch=0.5, depth="base", channels=["stress_zz"])
    skin = pp.Skin(pad, array)
    traction = solutions.flat_punch_line(half_width=4.0, force=1.0).averages(skin.surface.edges)  # type: ignore[union-attr]
    traction[0] = solutions.strip(half_width=4.0, traction=0.05, component="x").averages(skin.surface.edges)[0]  # type: ignore[union-attr]
    touch = skin.reconstruct(skin.sense(traction), method="constant_friction", friction=0.4)
    np.testing.assert_allclose(touch.force, [0.4, 1.0], rtol=0.05)


@pytest.mark.parametrize("aperture", [0.0, *long_runs(0.6)])
def test_friction_on_a_layer_reads_the_kernel_off_a_table(aperture: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand contacts are tried in one frame; the table says of each what the kernel says."""
    from palpate.inverse.paper import constant_friction

    pad = pp.BondedLayers([layer(2.0, 1.0, 0.45)])
    array = pp.LineArray(count=21, pitch=0.5, depth=0.8, channels=["stress_zz"], aperture=aperture)
    problem = pp.Skin(pad, array)._problem.seeking(("z",))
    tabulated = pp.paper.ConstantFriction(friction=0.4).prepare(problem)
    assert tabulated._under_half_of_the_plane is not None
    monkeypatch.setattr(constant_friction, "POINTS", 0)
    exact = pp.paper.ConstantFriction(friction=0.4).prepare(problem)
    assert exact._under_half_of_the_plane is None
    for half_width, center in ((2.0, 0.1), (0.2, 1.0), (4.5, -3.0), (60.0, 0.0)):
        known = exact._shear_reading(half_width, center)
        found = tabulated._shear_reading(half_width, center)
        np.testing.assert_allclose(found, known, atol=1e-6 * np.abs(known).max())


def test_net_force_on_a_periodic_layer_is_known() -> None:
    pad = pp.BondedLayers([layer(1.0, 1.0, 0.4)])
    array = pp.AreaArray(
        shape=(16, 16), pitch=0.5, depth=0.0, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    skin = pp.Skin(pad, array, boundary="periodic")
    contact = solutions.hertz_point(contact_radius=1.5, force=1.0).sliding(0.3)
    touch = skin.reconstruct(skin.sense(contact))
    np.testing.assert_allclose(touch.force, contact.force, atol=0.02)


def test_closed_forms_are_of_a_half_space() -> None:
    pad = pp.BondedLayers([layer()])
    with pytest.raises(pp.Unsupported, match="HalfSpace"):
        solutions.strip(half_width=1.0, traction=1.0).fields(pad, ["stress_zz"], 0.0, 0.5)  # type: ignore[arg-type]
    with pytest.raises(pp.Unsupported, match="HalfSpace"):
        solutions.point_load(force=1.0).fields(pad, ["stress_zz"], 0.0, 0.0, 0.5)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: pp.BondedLayers([]), "at least one"),
        (lambda: pp.BondedLayers(["gel"]), "Layer"),  # type: ignore[list-item]
        (lambda: pp.BondedLayers([layer()], base="steel"), "HalfSpace"),  # type: ignore[arg-type]
        (lambda: layer(0.0), "thickness"),
        (lambda: layer(float("inf")), "thickness"),
        (lambda: layer(nu=0.7), "poissons_ratio"),
    ],
)
def test_bad_layers(make: Any, word: str) -> None:
    with pytest.raises(pp.InvalidInput, match=word):
        make()
