"""A pad of one's own, and a channel of one's own, go everywhere that palpate's go."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.elastic import AREA_CHANNELS, LINE_CHANNELS, channels, transfer
from palpate.elastic.pad import isotropic_compliance, mirror_symmetric
from palpate.sensing.kernels import influence
from transversely_isotropic import TransverselyIsotropic

POINT = (np.zeros(1), np.ones(1))
#: Far from isotropic: stiff along the surface, soft in shear (real roots), and one with complex roots.
PLY = TransverselyIsotropic(c11=3.0, c12=1.2, c13=0.9, c33=1.8, c44=0.5)
COMPLEX = TransverselyIsotropic(c11=2.0, c12=0.8, c13=0.9, c33=2.2, c44=1.1)


def isotropic(modulus: float, nu: float, off: float = 0.0) -> TransverselyIsotropic:
    """Isotropic but for a part ``off`` of c44 (equal roots cannot be told apart by this pad's formula)."""
    mu, lam = modulus / 2 / (1 + nu), modulus * nu / (1 + nu) / (1 - 2 * nu)
    return TransverselyIsotropic(c11=lam + 2 * mu, c12=lam, c13=lam, c33=lam + 2 * mu, c44=mu * (1 + off))


class Bare:
    """A half-space that offers nothing but what a pad must."""

    thickness = None

    def __init__(self, pad: pp.HalfSpace) -> None:
        self._pad = pad
        self.states, self.compliance, self.mean_compliance = pad.states, pad.compliance, pad.mean_compliance


class Tilted(Bare):
    """Anisotropic in the plane: a plane-stress sheet bonded to the material would do it; here a solid with its axis along x."""

    thickness = None

    def __init__(self, compliance: np.ndarray) -> None:
        self._compliance = compliance

    def compliance(self, depth: float) -> np.ndarray:  # type: ignore[override]
        return self._compliance

    def mean_compliance(self, depth: float) -> None:  # type: ignore[override]
        return None

    def states(self, wavenumber: Any, direction: Any, depth: float) -> np.ndarray:  # type: ignore[override]
        """Stroh's six-dimensional eigenproblem, compression positive (T. C. T. Ting, Anisotropic Elasticity, 1996, ch. 5)."""
        voigt = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
        c = np.linalg.inv(self._compliance)[voigt[:, :, None, None], voigt]
        n = np.concatenate([direction, np.zeros((*np.shape(direction)[:-1], 1))], axis=-1)
        m = np.array([0.0, 0.0, 1.0])
        q = np.einsum("ijkl,...j,...l->...ik", c, n, n)
        r = np.einsum("ijkl,...j,l->...ik", c, n, m)
        t = np.broadcast_to(np.linalg.inv(c[:, 2, :, 2]), q.shape)
        rt = np.swapaxes(r, -1, -2)
        stroh = np.concatenate(
            [np.concatenate([-t @ rt, t], -1), np.concatenate([r @ t @ rt - q, -r @ t], -1)], axis=-2
        )
        p, v = np.linalg.eig(stroh)
        order = np.argsort(-p.imag, axis=-1)[..., :3]
        p = np.take_along_axis(p, order, -1)
        v = np.take_along_axis(v, order[..., None, :], -1)
        a, b = v[..., :3, :], v[..., 3:, :]  # u = a exp(i k p z), tension on z planes i k b
        amplitude = np.linalg.inv(-1j * b)
        phase = np.exp(1j * p * (np.asarray(wavenumber) * depth)[..., None])[..., None, :]
        return np.concatenate([(a * phase) @ amplitude, (-1j * b * phase) @ amplitude], axis=-2)


def orthotropic() -> Tilted:
    """An orthotropic solid whose axes lie along x, y and z (three materials' worth of difference, no equal roots)."""
    stiffness = np.diag([0.0, 0.0, 0.0, 0.5, 0.9, 0.6])
    stiffness[:3, :3] = [[1.8, 0.9, 0.7], [0.9, 3.0, 1.2], [0.7, 1.2, 2.4]]
    return Tilted(np.linalg.inv(stiffness))


def test_point_load_on_transverse_isotropy() -> None:
    """Elliott 1948, Hanson 1992: u_z = H P/r on the surface and s_zz below, each a sum over the two roots."""
    x, y, z = np.arange(-4, 5) * 0.7, np.arange(-3, 4) * 0.9, 0.8
    s = np.sort(PLY.roots.real)
    r2 = x**2 + y[:, None] ** 2
    below = influence(PLY, [y, x], [0.9, 0.7], z, ["stress_zz"], [POINT] * 2, concentrated=True)[0, 2]
    stress = [(r2 + (root * z) ** 2) ** -1.5 for root in s]
    expected = s[0] * s[1] * z / (2 * np.pi * (s[1] - s[0])) * (stress[0] - stress[1]) * 0.9 * 0.7
    np.testing.assert_allclose(below, expected, rtol=1e-9)

    h = sum(1 / s) * PLY.c11 / (2 * np.pi * (PLY.c11 * PLY.c33 - PLY.c13**2))
    love = pp.HalfSpace(youngs_modulus=1 / (np.pi * h), poissons_ratio=0.0)  # with the same H = (1 - nu^2)/(pi E)
    found, known = (influence(p, [y, x], [0.9, 0.7], 0.0, ["displacement_z"], [POINT] * 2)[0, 2] for p in (PLY, love))
    np.testing.assert_allclose(found, known, rtol=1e-11)


LONG_DEPTHS = [
    pytest.param(*case, marks=pytest.mark.long) for case in ((0.3, 0.05), (0.5, 0.05), (0.5, 0.0), (0.5, 0.6))
]


@pytest.mark.parametrize("depth", [0.0, *long_runs(0.5)])
def test_isotropic_limit(depth: float) -> None:
    """The error against a half-space falls with the anisotropy, and is its size."""
    half = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=0.3)
    x, y = np.arange(-1, 3) * 0.5, np.arange(0, 2) * 0.4
    names = [c for c in AREA_CHANNELS if c != "rotation_z"]
    known = influence(half, [y, x], [0.4, 0.5], depth, names, [POINT] * 2)
    size = np.abs(known).max(axis=(1, 2, 3))
    errors = []
    for off in (1e-3, 1e-5):
        found = influence(isotropic(2.0, 0.3, off), [y, x], [0.4, 0.5], depth, names, [POINT] * 2)
        errors.append((np.abs(found - known).max(axis=(1, 2, 3)) / size).max())
    assert errors[0] < 3e-3
    assert errors[1] < 3e-5


@pytest.mark.parametrize(("nu", "depth"), [(0.3, 0.0), (0.3, 0.6), *LONG_DEPTHS])
def test_quadrature_against_closed_form(nu: float, depth: float) -> None:
    half = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=nu)
    x, y = np.arange(-1, 4) * 0.5, np.arange(0, 2) * 0.4
    names = ["displacement_x", "stress_xx", "stress_zz", "strain_xz", "rotation_z"]
    known, found = (influence(p, [y, x], [0.4, 0.5], depth, names, [POINT] * 2) for p in (half, Bare(half)))
    np.testing.assert_allclose(found, known, atol=3e-9 * np.abs(known).max())
    known, found = (influence(p, [x], [0.5], depth, LINE_CHANNELS, [POINT]) for p in (half, Bare(half)))
    free = np.array([c.startswith("displacement") for c in LINE_CHANNELS])[:, None, None]
    difference = (found - known) - free * (found - known).mean(axis=-1, keepdims=True)
    np.testing.assert_allclose(difference, 0.0, atol=1e-12 * np.abs(known).max())


@pytest.mark.long
@pytest.mark.parametrize("pad", [COMPLEX, orthotropic()], ids=["complex roots", "orthotropic"])
def test_fields_of_a_cell_are_in_equilibrium(pad: Any) -> None:
    """An independent check of the coupled kernel: ds_iz/dz + ds_ix/dx + ds_iy/dy = 0, and the force goes through."""
    h, z = 2e-3, 0.7

    def at(dx: float, dy: float, dz: float) -> dict[str, np.ndarray]:
        names = ["stress_xx", "stress_yy", "stress_zz", "stress_xz", "stress_yz", "stress_xy"]
        points = [np.array([0.3]) + dy, np.array([-0.5, 0.2]) + dx]
        return dict(zip(names, influence(pad, points, [0.6, 0.7], z + dz, names, [POINT] * 2)))

    steps = {"x": (h, 0, 0), "y": (0, h, 0), "z": (0, 0, h)}
    slopes = {}
    for axis, step in steps.items():
        up, down = at(*step), at(*(-v for v in step))
        slopes[axis] = {name: (up[name] - down[name]) / (2 * h) for name in up}
    for i in "xyz":
        terms = [slopes[j]["stress_" + ("".join(sorted(i + j)))] for j in "xyz"]
        assert np.abs(sum(terms)).max() < 2e-5 * max(np.abs(t).max() for t in terms)


@pytest.mark.long
def test_plane_anisotropy_against_its_spectrum() -> None:
    """The kernel at depth, summed over a wide lattice, against the matrix of a wavevector; the axis along x shows."""
    pad = orthotropic()
    x = np.arange(-40, 41) * 0.5
    names = ["stress_zz", "stress_xz", "strain_xx"]
    kernel = influence(pad, [x, x], [0.5, 0.5], 1.0, names, [POINT] * 2)
    kx, ky = 1.1, 0.7
    wave = np.exp(-1j * (kx * x + ky * x[:, None]))
    expected = transfer(pad, kx, ky, 1.0, names) * np.sinc(kx * 0.25 / np.pi) * np.sinc(ky * 0.25 / np.pi)
    # what lies beyond the lattice falls like 1/r^2 and turns sign: percents of a percent; aliases are below exp(-4 pi + k)
    np.testing.assert_allclose((kernel * wave).sum(axis=(-2, -1)), expected, atol=2e-3)
    along, across = (transfer(pad, *k, 0.0, ["displacement_z"])[0, 2].real for k in ((1.0, 0.0), (0.0, 1.0)))
    assert abs(along / across - 1) > 0.1


@pytest.mark.parametrize(
    ("pad", "boundary"),
    [
        *long_runs((PLY, "free")),
        (PLY, "periodic"),
        pytest.param(orthotropic(), "free", marks=pytest.mark.long),
        (orthotropic(), "periodic"),
    ],
)
def test_sense_and_reconstruct(pad: Any, boundary: Any) -> None:
    array = pp.AreaArray(
        shape=(10, 10), pitch=0.5, depth=0.4, channels=["stress_xz", "stress_yz", "stress_zz"], noise=1e-4
    )
    skin = pp.Skin(pad, array, boundary=boundary)
    y, x = np.meshgrid(*skin.surface.axes, indexing="ij")
    bump = np.exp(-((x - 0.3) ** 2 + y**2) / 0.6)
    traction = np.stack([0.2 * bump, 0.1 * bump, bump])
    readings = skin.sense(traction, rng=np.random.default_rng(1))
    touch = skin.reconstruct(readings, method="tikhonov")
    assert np.linalg.norm(touch.values - traction) < 0.08 * np.linalg.norm(traction)


@pytest.mark.long
def test_line_contact() -> None:
    array = pp.LineArray(count=40, pitch=0.25, depth=0.3, channels=["stress_zz", "stress_xz"], noise=1e-4)
    skin = pp.Skin(PLY, array)
    x = skin.surface.axes[0]
    traction = np.stack([0.3 * np.exp(-(x**2)), np.exp(-(x**2))])
    touch = skin.reconstruct(skin.sense(traction, rng=np.random.default_rng(0)))
    assert np.linalg.norm(touch.values - traction) < 0.05 * np.linalg.norm(traction)


@pytest.mark.long
def test_layers_through_their_states_alone() -> None:
    """Bonded layers stripped of what they offer beyond `Pad` give the same kernel, at depth and on the surface."""
    layers = pp.BondedLayers(
        [
            pp.Layer(thickness=1.0, youngs_modulus=1.0, poissons_ratio=0.4),
            pp.Layer(thickness=0.5, youngs_modulus=3.0, poissons_ratio=0.3),
        ]
    )
    x = np.arange(-1, 3) * 0.4
    names = ["stress_zz", "strain_xx", "displacement_x"]
    bare = Bare(layers)  # type: ignore[arg-type]
    bare.thickness = layers.thickness  # type: ignore[assignment]
    for depth in (0.0, 0.2, 1.0):
        known, found = (influence(p, [x, x], [0.4, 0.4], depth, names, [POINT] * 2) for p in (layers, bare))
        np.testing.assert_allclose(found, known, atol=1e-7 * np.abs(known).max(axis=(1, 2, 3)).max())


def test_a_subclass_that_changes_the_states_is_believed() -> None:
    class Softer(pp.HalfSpace):
        def states(self, wavenumber: Any, direction: Any, depth: float) -> Any:
            out = super().states(wavenumber, direction, depth)
            out[..., :3, :] *= 2.0
            return out

        def compliance(self, depth: float) -> Any:
            return 2.0 * super().compliance(depth)

    array = pp.AreaArray(shape=(4, 4), pitch=1.0, depth=0.0, channels=["displacement_z", "stress_zz"])
    pads = [Softer(youngs_modulus=1.0, poissons_ratio=0.3), pp.HalfSpace(youngs_modulus=0.5, poissons_ratio=0.3)]
    found, known = (pp.Skin(pad, array).operator.dense() for pad in pads)
    np.testing.assert_allclose(found, known, rtol=1e-9, atol=1e-12)

    class Named(pp.HalfSpace):
        """Changes nothing of the physics, and keeps the closed form."""

    named = pp.Skin(Named(youngs_modulus=0.5, poissons_ratio=0.3), array).operator.dense()
    np.testing.assert_array_equal(named, known)


def test_what_is_no_pad_is_refused_by_what_it_lacks() -> None:
    class Half:
        thickness = None

        def states(self, wavenumber: Any, direction: Any, depth: float) -> None: ...

    array = pp.LineArray(count=4, pitch=1.0, depth=1.0, channels=["stress_zz"])
    with pytest.raises(pp.InvalidInput, match="lacks compliance, mean_compliance"):
        pp.Skin(Half(), array)  # type: ignore[arg-type]
    with pytest.raises(pp.InvalidInput, match="class"):
        pp.Skin(TransverselyIsotropic, array)  # type: ignore[arg-type]


def test_growing_states_are_refused() -> None:
    class Wrong(Bare):
        def __init__(self) -> None:
            super().__init__(pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3))
            known = self.states
            self.states = lambda k, d, z: known(k, d, -z)  # type: ignore[method-assign]

    array = pp.AreaArray(shape=(3, 3), pitch=1.0, depth=1.0, channels=["stress_zz"])
    with pytest.raises(pp.Unsupported, match="grow with depth"):
        _ = pp.Skin(Wrong(), array).operator.planes  # type: ignore[arg-type]


def test_mirrors() -> None:
    """A solid whose axis lies askew in the plane is no mirror image of itself."""
    turn = np.deg2rad(30.0)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    voigt = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
    stiffness = np.linalg.inv(orthotropic().compliance(0.0))[voigt[:, :, None, None], voigt]
    turned = np.einsum("ia,jb,kc,ld,abcd->ijkl", *[rotation] * 4, stiffness)
    pairs = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    flat = np.array([[turned[i, j, k, m] for k, m in pairs] for i, j in pairs])
    askew = Tilted(np.linalg.inv(flat))
    assert mirror_symmetric(PLY, 0.3, 1.0)
    assert mirror_symmetric(orthotropic(), 0.3, 1.0)
    assert not mirror_symmetric(askew, 0.3, 1.0)
    assert mirror_symmetric(pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5), 0.0, 1.0)


def test_rotation_is_the_curl_of_displacement() -> None:
    half = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=0.3)
    h = 1e-4

    def u(axis: str, dx: float, dy: float) -> np.ndarray:
        points = [np.array([0.4, 1.1]) + dy, np.array([-0.3, 0.6]) + dx]
        return influence(half, points, [0.7, 0.9], 0.5, [f"displacement_{axis}"], [POINT] * 2)[0]

    curl = (u("y", h, 0) - u("y", -h, 0) - u("x", 0, h) + u("x", 0, -h)) / (4 * h)
    points = [np.array([0.4, 1.1]), np.array([-0.3, 0.6])]
    found = influence(half, points, [0.7, 0.9], 0.5, ["rotation_z"], [POINT] * 2)[0]
    np.testing.assert_allclose(found, curl, atol=1e-8 * np.abs(curl).max())
    assert np.abs(found[2]).max() < 1e-12  # pressure does not twist


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.long
def test_rotation_senses_and_reconstructs(boundary: Any) -> None:
    """One number a taxel finds a twist: with shear alone sought from rotation and one shear stress."""
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    array = pp.AreaArray(
        shape=(12, 12), pitch=0.5, depth=0.3, channels=["rotation_z", "stress_xz", "stress_yz"], noise=1e-5
    )
    skin = pp.Skin(pad, array, boundary=boundary)
    y, x = np.meshgrid(*skin.surface.axes, indexing="ij")
    bump = np.exp(-(x**2 + y**2) / 0.8)
    twist = np.stack([-y * bump, x * bump, 0.0 * bump])
    touch = skin.reconstruct(skin.sense(twist, rng=np.random.default_rng(0)), components=["x", "y"], method="tikhonov")
    assert np.linalg.norm(touch.values - twist) < 0.05 * np.linalg.norm(twist)


def test_one_entry_adds_a_channel(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    """A magnet 1 mm up whose field changes with displacement: units, files, limits and inversion follow from its entry."""
    field = channels.Kind(
        "field",
        unit="T",
        creeps=True,
        absolute=True,
        scale=lambda modulus, k: 0.02 / (modulus * k),
        limit=lambda modulus, width: (10.0, "10 T"),
    )
    entry = channels.Channel("field_z", field, "z", "", False, lambda f: 0.02 * f.displacement("z"))
    monkeypatch.setattr(channels, "CHANNELS", MappingProxyType({**channels.CHANNELS, "field_z": entry}))
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    array = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=1e-3, channels=["field_z"], noise=1e-8)
    skin = pp.Skin(pad, array)
    y, x = np.meshgrid(*skin.surface.axes, indexing="ij")
    push = np.stack([0 * x, 0 * x, 1e3 * np.exp(-(x**2 + y**2) / 4e-6)])
    readings = skin.sense(push, rng=np.random.default_rng(0))
    alike = pp.Skin(pad, replace(array, channels=["displacement_z"], noise=1e-8 / 0.02))
    options = {"method": "tikhonov", "components": ["z"]}
    found, known = skin.reconstruct(readings, **options), alike.reconstruct(readings / 0.02, **options)
    np.testing.assert_allclose(found.values, known.values, atol=1e-6 * np.abs(known.values).max())
    recording = pp.Recording(readings=readings[None], channels=("field_z",), time=np.zeros(1))
    assert recording.units == ("T",)
    with pytest.raises(pp.InvalidInput, match="10 T"):
        skin.reconstruct(np.full((1, 10, 10), 11.0))


def test_isotropic_compliance() -> None:
    stress = np.array([1.0, 0, 0, 0, 0, 2.0])
    np.testing.assert_allclose(isotropic_compliance(4.0, 0.25) @ stress, [0.25, -1 / 16, -1 / 16, 0, 0, 1.25])
