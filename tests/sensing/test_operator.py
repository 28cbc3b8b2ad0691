from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import palpate as pp
from conftest import channel_of, relative
from palpate import solutions
from palpate.elastic import AREA_CHANNELS, LINE_CHANNELS, transfer
from palpate.elastic.channels import mirror_parity
from palpate.sensing import Operator, default_surface
from palpate.sensing.kernels import aperture_rule, influence

POSITIONS = np.random.default_rng(5).uniform(-1, 1, (23, 2))
LAYOUTS: dict[str, list[Any]] = {
    "line": [pp.LineArray(count=20, pitch=0.5, depth=0.7, channels=LINE_CHANNELS)],
    "line, odd, aperture, masked": [
        pp.LineArray(count=21, pitch=0.5, depth=0.1, channels=LINE_CHANNELS, aperture=0.4, mask=np.arange(21) != 4)
    ],
    "line, at the surface": [
        pp.LineArray(count=9, pitch=0.5, depth=0.0, channels=["displacement_x", "displacement_z", "stress_zz"])
    ],
    "line, two planes": [
        pp.LineArray(count=12, pitch=0.5, depth=d, channels=["stress_zz", "strain_xx"]) for d in (0.5, 0.9)
    ],
    "line, scattered": [pp.ScatteredArray(positions=POSITIONS[:, 0], depth=0.4, channels=LINE_CHANNELS, aperture=0.1)],
    "area": [pp.AreaArray(shape=(6, 7), pitch=(0.5, 0.4), depth=0.5, channels=AREA_CHANNELS, center=(0.3, -2.0))],
    "area, aperture, fine": [pp.AreaArray(shape=(3, 4), pitch=0.5, depth=0.15, channels=AREA_CHANNELS, aperture=0.3)],
    "area, at the surface": [
        pp.AreaArray(
            shape=(5, 6),
            pitch=0.5,
            depth=0.0,
            channels=["displacement_x", "displacement_y", "displacement_z", "stress_xz"],
        )
    ],
    "area, masked": [pp.AreaArray(shape=(4, 4), pitch=0.5, depth=0.5, channels=["stress_zz"], mask=np.eye(4) < 0.5)],
    "area, scattered": [
        pp.ScatteredArray(
            positions=POSITIONS[:8], depth=0.0, channels=["displacement_x", "displacement_y"], aperture=0.05
        )
    ],
    "area, planes of two kinds": [
        pp.AreaArray(shape=(4, 5), pitch=0.5, depth=0.5, channels=["stress_zz"]),
        pp.ScatteredArray(positions=POSITIONS, depth=0.3, channels=["displacement_z", "strain_xy"]),
    ],
}
PERIODIC = [n for n, a in LAYOUTS.items() if all(hasattr(p, "grid") and p.mask is None for p in a) and len(a) == 1]


PADS: dict[str, Any] = {
    **{f"half-space {nu}": pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=nu) for nu in (0.0, 0.37, 0.5)},
    "layer 0.5": pp.BondedLayers([pp.Layer(thickness=1.0, youngs_modulus=2.0, poissons_ratio=0.5)]),
    "skin on soft": pp.BondedLayers(
        [
            pp.Layer(thickness=0.3, youngs_modulus=20.0, poissons_ratio=0.3),
            pp.Layer(thickness=1.0, youngs_modulus=1.0, poissons_ratio=0.49),
        ]
    ),
    "soft base": pp.BondedLayers(
        [pp.Layer(thickness=0.4, youngs_modulus=2.0, poissons_ratio=0.4)],
        pp.HalfSpace(youngs_modulus=0.5, poissons_ratio=0.3),
    ),
}


def operator(planes: Sequence[Any], boundary: Any, pad: str = "half-space 0.37") -> Operator:
    surface = planes[0].grid if boundary == "periodic" else default_surface(planes)
    return Operator(PADS[pad], planes, surface, boundary)


@cache
def laid_out(layout: str, boundary: Any, pad: str = "half-space 0.37") -> Operator:
    """The operator of a layout, whose kernels are made once for all tests."""
    return operator(LAYOUTS[layout], boundary, pad)


def dot_test(op: Operator, dtype: Any, rng: np.random.Generator) -> float:
    """|<A t, r> - <t, A' r>| in units of eps |A t| |r|."""
    traction = rng.standard_normal((2, len(op.surface.components), *op.surface.shape)).astype(dtype)
    readings = [rng.standard_normal((2, len(p.channels), *p.shape)).astype(dtype) for p in op.planes_of]
    forward, back = op.forward(traction), op.adjoint(readings)
    assert back.dtype == dtype
    assert all(f.dtype == dtype for f in forward)
    left = sum(float((f.astype(np.float64) * r).sum()) for f, r in zip(forward, readings))
    right = float((traction.astype(np.float64) * back).sum())
    size = np.sqrt(sum(float((f.astype(np.float64) ** 2).sum()) for f in forward))
    size *= np.sqrt(sum(float((r.astype(np.float64) ** 2).sum()) for r in readings))
    return abs(left - right) / (size * float(np.finfo(dtype).eps))


CASES = [(n, "free") for n in LAYOUTS] + [(n, "periodic") for n in PERIODIC]


#: Closed form, closed form without a part that is nothing at 0.5, and quadrature.
KINDS = ("half-space 0.37", "half-space 0.5", "soft base")


#: Single precision is the same arithmetic: one of the kinds shows it.
QUICK = [(KINDS[0], np.float32), *((kind, np.float64) for kind in KINDS)]


@pytest.mark.parametrize(
    ("pad", "dtype"),
    [
        pytest.param(pad, dtype, marks=[] if (pad, dtype) in QUICK else [pytest.mark.long])
        for pad in PADS
        for dtype in (np.float64, np.float32)
    ],
)
@pytest.mark.parametrize(("layout", "boundary"), CASES)
def test_adjoint(layout: str, boundary: str, pad: str, dtype: Any, rng: np.random.Generator) -> None:
    assert dot_test(laid_out(layout, boundary, pad), dtype, rng) < 50


@pytest.mark.parametrize(("layout", "boundary"), CASES)
def test_dense_is_the_same_operator(layout: str, boundary: str, rng: np.random.Generator) -> None:
    op = laid_out(layout, boundary)
    traction = rng.standard_normal((len(op.surface.components), *op.surface.shape))
    expected = np.concatenate([f[:, p.valid].ravel() for f, p in zip(op.forward(traction), op.planes_of)])
    found = op.dense() @ traction.ravel()
    assert np.abs(found - expected).max() < 1e-13 * np.abs(expected).max()


@settings(max_examples=25)
@given(
    count=st.integers(2, 40),
    ratio=st.integers(1, 4),
    depth=st.floats(0.01, 5),
    width=st.floats(0, 1),
    nu=st.floats(0, 0.5),
)
@pytest.mark.long
def test_adjoint_property(count: int, ratio: int, depth: float, width: float, nu: float) -> None:
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=nu)
    array = pp.LineArray(count=count, pitch=1.0, depth=depth, channels=LINE_CHANNELS, aperture=width)
    surface = pp.LineGrid(count=ratio * count + 3, spacing=1.0 / ratio)
    assert dot_test(Operator(pad, [array], surface), np.float64, np.random.default_rng(count)) < 50


@pytest.mark.parametrize(
    ("layout", "boundary"),
    [c for c in CASES if "scattered" not in c[0] and "kinds" not in c[0] and "masked" not in c[0]],
)
@pytest.mark.parametrize("pad", ["half-space 0.37", "skin on soft", "soft base"])
@pytest.mark.long
def test_mirror(layout: str, boundary: str, pad: str, rng: np.random.Generator) -> None:
    """Mirrored traction gives the mirrored reading, on even and odd grids."""
    op = laid_out(layout, boundary, pad)
    axes = "x" if op.surface.dimensions == 1 else "yx"
    traction = rng.standard_normal((len(op.surface.components), *op.surface.shape))
    for axis, name in enumerate(axes):
        signs = np.array([mirror_parity(c, name) for c in op.surface.components]).reshape(-1, *(1,) * len(axes))
        mirrored = signs * np.flip(traction, axis=1 + axis)
        for plane, plain, image in zip(op.planes_of, op.forward(traction), op.forward(mirrored)):
            parity = np.array([mirror_parity(c, name) for c in plane.channels]).reshape(-1, *(1,) * len(axes))
            expected = parity * np.flip(plain, axis=1 + axis)
            np.testing.assert_allclose(image, expected, rtol=0, atol=3e-13 * np.abs(expected).max())


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.parametrize("size", [6, 7])
@pytest.mark.parametrize("pad", ["half-space 0.37", "skin on soft", "soft base"])
def test_rotation(size: int, boundary: Any, pad: str, rng: np.random.Generator) -> None:
    """Turning the traction by 90 degrees turns the reading."""
    names = [
        "displacement_x",
        "displacement_y",
        "displacement_z",
        "stress_xx",
        "stress_yy",
        "stress_xy",
        "stress_xz",
        "stress_yz",
    ]
    array = pp.AreaArray(shape=(size, size), pitch=0.5, depth=0.6, channels=names)
    op = operator([array], boundary, pad)

    def turned(a: np.ndarray) -> np.ndarray:  # (x, y) -> (-y, x): new[y', x'] = old[y, x]
        return np.rot90(a, k=-1, axes=(-2, -1))

    t = rng.standard_normal((3, *op.surface.shape))
    plain = dict(zip(names, op.forward(t)[0]))
    image = dict(zip(names, op.forward(np.stack([-turned(t[1]), turned(t[0]), turned(t[2])]))[0]))
    for new, sign, old in (
        ("displacement_x", -1, "displacement_y"),
        ("displacement_y", 1, "displacement_x"),
        ("displacement_z", 1, "displacement_z"),
        ("stress_xx", 1, "stress_yy"),
        ("stress_xy", -1, "stress_xy"),
        ("stress_xz", -1, "stress_yz"),
    ):
        expected = sign * turned(plain[old])
        np.testing.assert_allclose(image[new], expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("boundary", ["free", "periodic"])
@pytest.mark.parametrize("size", [6, 7])
@pytest.mark.parametrize("pad", ["half-space 0.37", "layer 0.5", "skin on soft", "soft base"])
def test_reciprocity(size: int, boundary: Any, pad: str) -> None:
    """Maxwell and Betti: surface displacement of cell i along a per load on cell j along b is symmetric."""
    array = pp.AreaArray(
        shape=(size, size), pitch=0.5, depth=0.0, channels=["displacement_x", "displacement_y", "displacement_z"]
    )
    dense = Operator(PADS[pad], [array], array.grid, boundary).dense()
    assert np.abs(dense - dense.T).max() < 1e-13 * np.abs(dense).max()


@pytest.mark.parametrize("depth", [0.3, 1.0])
def test_influence_is_the_transform_of_the_transfer_matrix(depth: float) -> None:
    """The closed-form influence of a cell and the matrix of a wavevector are two independent derivations."""
    pad = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=0.37)
    dx, n = 0.05, 1024
    x = (np.arange(n) - n // 2) * dx
    kernel = influence(pad, [x], [dx], depth, LINE_CHANNELS, [(np.zeros(1), np.ones(1))])
    k = np.array([3.0, 8.0])
    window = np.exp(-((x / 18) ** 8))  # the kernels' far tails carry only small k
    found = np.einsum("cpn,kn->kcp", kernel * window, np.exp(-1j * k[:, None] * x))
    expected = (
        transfer(pad, k, 0.0, depth, LINE_CHANNELS, line=True)[..., [0, 2]] * np.sinc(k * dx / 2 / np.pi)[:, None, None]
    )
    np.testing.assert_allclose(found, expected, atol=1e-5)  # what the window leaves of ln x

    n, dx = 256, 0.25
    x = (np.arange(n) - n // 2) * dx
    kernel = influence(pad, [x, x], [dx, dx], 1.0, AREA_CHANNELS, [(np.zeros(1), np.ones(1))] * 2)
    kx, ky, w = 1.4, 0.9, np.exp(-((x / 20) ** 8))
    found = np.einsum("cpyx,x,y->cp", kernel, w * np.exp(-1j * kx * x), w * np.exp(-1j * ky * x))
    expected = transfer(pad, kx, ky, 1.0, AREA_CHANNELS) * np.sinc(kx * dx / 2 / np.pi) * np.sinc(ky * dx / 2 / np.pi)
    np.testing.assert_allclose(found, expected, atol=3e-5)


def test_periodic_wave_is_its_own_image() -> None:
    """On a periodic surface a sine of traction gives a sine of readings with the transfer matrix as its factor."""
    pad = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=0.37)
    array = pp.AreaArray(shape=(8, 10), pitch=0.5, depth=0.4, channels=AREA_CHANNELS, aperture=0.2)
    op = Operator(pad, [array], array.grid, "periodic")
    y, x = np.meshgrid(*array.grid.axes, indexing="ij")
    kx, ky = 2 * np.pi * 2 / 5.0, 2 * np.pi * 3 / 4.0
    wave = np.exp(1j * (kx * x + ky * y))
    amplitude = np.array([0.3, -0.7, 1.0])
    traction = np.real(amplitude[:, None, None] * wave)
    factor = np.sinc(kx * 0.2 / 2 / np.pi) * np.sinc(ky * 0.2 / 2 / np.pi)
    m = transfer(pad, kx, ky, 0.4, AREA_CHANNELS) @ amplitude * factor
    np.testing.assert_allclose(op.forward(traction)[0], np.real(m[:, None, None] * wave), atol=1e-13)


def test_free_boundary_does_not_wrap() -> None:
    """A load at one edge reads at the other edge what the closed form says, not what its copy would."""
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3)
    array = pp.LineArray(count=40, pitch=0.5, depth=1.0, channels=["stress_zz", "stress_xx", "stress_xz"])
    skin = pp.Skin(pad, array)
    edge = solutions.strip(half_width=0.25, traction=1.0).shifted(float(array.grid.x[0]))
    expected = edge.fields(pad, array.channels, array.grid.x, 1.0)
    np.testing.assert_allclose(skin.sense(skin.sample(edge)), expected, atol=1e-14)  # it fills a cell


def test_aperture_is_the_mean_over_the_taxel() -> None:
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3)
    ball = solutions.patch(half_widths=(1.0, 0.5), traction=1.0, component="x")
    array = pp.AreaArray(shape=(3, 4), pitch=0.7, depth=0.4, channels=["stress_xz", "displacement_x"], aperture=0.6)
    skin = pp.Skin(pad, array, surface=pp.AreaGrid(shape=(2, 4), spacing=(0.5, 0.5)))
    fine = (np.arange(60) + 0.5) / 60 * 0.6 - 0.3
    x = array.grid.x[None, :, None, None] + fine[None, None, None, :]
    y = array.grid.y[:, None, None, None] + fine[None, None, :, None]
    expected = ball.fields(pad, array.channels, x, y, 0.4).mean(axis=(3, 4))
    np.testing.assert_allclose(skin.sense(ball), expected, rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize(
    ("width", "depth", "offset"), [(0.3, 0.0, 0.1), (1.3, 0.0, 0.5), (0.3, 1.0, 0.1), (0.3, 0.01, None)]
)
def test_aperture_rule_integrates(width: float, depth: float, offset: float | None) -> None:
    nodes, weights = aperture_rule(width, depth, 0.5, offset)
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ nodes**2 == pytest.approx(width**2 / 12)
    if offset is not None and depth == 0:  # a jump at a cell edge is integrated exactly
        inside = np.abs(nodes + offset) < 0.25
        covered = min(width / 2, 0.25 - offset) - max(-width / 2, -0.25 - offset)
        assert weights @ inside == pytest.approx(covered / width)


@pytest.mark.parametrize("nu", ["0.3", "0.5"])
@pytest.mark.long
def test_line_fields_against_oracle(oracle: Any, nu: str) -> None:
    """sense() of a Hertz contact, every channel, relative L2 below 1e-3, falling with the square of the spacing."""
    data = oracle("closed_form_2d")
    pad = pp.HalfSpace(youngs_modulus=1, poissons_ratio=float(nu))
    for case, contact in (
        ("hertz_p", solutions.hertz_line(half_width=1, force=np.pi / 2)),
        ("hertz_q", None),
    ):
        for field in ("S_zz", "S_xx", "S_xz", "eps_zz", "eps_xx"):
            key = f"{case}__{field}" if field.startswith("S") else f"{case}__nu{nu}__{field}"
            errors = []
            for cells in (32, 64):
                surface = pp.LineGrid(count=2 * cells + 8, spacing=1 / cells)
                normal = (contact or solutions.hertz_line(half_width=1, force=np.pi / 2)).averages(surface.edges)
                traction = normal if contact else normal[::-1]
                found = [
                    pp.Skin(
                        pad,
                        pp.ScatteredArray(positions=data["x"], depth=float(z), channels=[channel_of(field)]),
                        surface=surface,
                    ).sense(traction)[0]
                    for z in data["z"][1:]
                ]
                errors.append(relative(found, data[key][1:]))
            assert errors[0] < 1e-3, (key, errors)
            assert errors[1] < errors[0] / 3, (key, errors)


def test_displacement_of_a_half_plane_is_relative_to_the_array() -> None:
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3)
    array = pp.LineArray(count=30, pitch=0.5, depth=0.5, channels=["displacement_z"])
    skin = pp.Skin(pad, array)
    found = skin.sense(skin.sample(solutions.strip(half_width=0.75, traction=1.0).shifted(0.25)))[0]
    true = (
        solutions.strip(half_width=0.75, traction=1.0)
        .shifted(0.25)
        .fields(pad, ["displacement_z"], array.grid.x, 0.5)[0]
    )
    assert found.mean() == pytest.approx(0.0, abs=1e-14)
    np.testing.assert_allclose(found, true - true.mean(), atol=1e-12)


def test_infinite_response_is_refused() -> None:
    pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3)
    array = pp.AreaArray(shape=(4, 4), pitch=1.0, depth=0.0, channels=["stress_xx"])
    skin = pp.Skin(pad, array, surface=pp.AreaGrid(shape=(5, 5), spacing=1.0))
    with pytest.raises(pp.InvalidInput, match="edge of a surface cell"):
        skin.sense(np.zeros((3, 5, 5)))


def test_too_large_a_dense_map_is_refused() -> None:
    array = pp.ScatteredArray(
        positions=np.random.default_rng(0).uniform(-1, 1, (2000, 2)),
        depth=0.0,
        channels=["displacement_x", "displacement_y"],
    )
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3), array, surface=pp.AreaGrid(shape=(400, 400), spacing=0.01)
    )
    with pytest.raises(pp.Unsupported, match="GB"):
        _ = skin.operator.planes


@pytest.mark.parametrize(("layout", "boundary"), CASES)
def test_columns_are_those_of_the_matrix(layout: str, boundary: str, rng: np.random.Generator) -> None:
    op = laid_out(layout, boundary)
    count, cells = len(op.surface.components), int(np.prod(op.surface.shape))
    some = rng.choice(cells, size=min(9, cells), replace=False)
    wanted = [count - 1, 0]
    dense = op.dense().reshape(-1, count, cells)[:, wanted][:, :, some]
    np.testing.assert_allclose(op.columns(wanted, some), dense, rtol=0, atol=1e-13 * np.abs(dense).max())


@pytest.mark.parametrize("boundary", ["free", "periodic"])
def test_components_in_any_order(boundary: str, rng: np.random.Generator) -> None:
    """Some components, also out of order, in batches and in single precision: the same as all of them with zeros."""
    array = pp.AreaArray(shape=(5, 6), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"])
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.45)
    operator = pp.Skin(pad, array, boundary=boundary).operator  # type: ignore[arg-type]
    for among in ((0,), (2,), (0, 2), (2, 0), (1, 0, 2)):
        for dtype, within in ((np.float64, 1e-12), (np.float32, 1e-5)):
            traction = rng.standard_normal((2, len(among), *operator.surface.shape)).astype(dtype)
            whole = np.zeros((2, 3, *operator.surface.shape), dtype=dtype)
            whole[:, list(among)] = traction
            (found,), (expected,) = operator.forward(traction, among), operator.forward(whole)
            assert found.dtype == dtype
            np.testing.assert_allclose(found, expected, atol=within * np.abs(expected).max())
            readings = rng.standard_normal((2, 2, 5, 6)).astype(dtype)
            kept = readings.copy()
            back = operator.adjoint([readings], among)
            np.testing.assert_array_equal(readings, kept)
            all_of_it = operator.adjoint([readings])[:, list(among)]
            np.testing.assert_allclose(back, all_of_it, atol=within * np.abs(all_of_it).max())


@pytest.mark.parametrize("nudge", [0.0, 1e-13, -1e-13])
@pytest.mark.parametrize(
    "pad",
    [
        pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
        pp.BondedLayers([pp.Layer(thickness=3e-3, youngs_modulus=5e5, poissons_ratio=0.45)]),
    ],
    ids=["half-space", "layer"],
)
def test_a_surface_taxel_on_a_corner_of_cells_feels_a_quarter_of_each(pad, nudge):
    pitch = 2e-3
    array = pp.AreaArray(shape=(4, 4), pitch=pitch, depth=0.0, channels=["stress_zz"], center=(nudge * pitch, 0.0))
    skin = pp.Skin(pad, array, surface=pp.AreaGrid(shape=(8, 8), spacing=pitch / 2))
    traction = np.zeros((3, 8, 8))
    for row, column in ((3, 3), (3, 4), (4, 3), (4, 4), (5, 5)):  # each has one taxel at a corner
        traction[2, row, column] = 1e4
    expected = np.zeros((4, 4))
    expected[1, 1] = expected[1, 2] = expected[2, 1] = 2500.0
    expected[2, 2] = 5000.0
    np.testing.assert_allclose(skin.sense(traction)[0], expected, atol=1.0)


def test_a_surface_taxel_on_the_edge_of_a_strip_feels_half_of_it():
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    array = pp.LineArray(count=4, pitch=2e-3, depth=0.0, channels=["stress_xz", "stress_zz"])
    skin = pp.Skin(pad, array, surface=pp.LineGrid(count=8, spacing=1e-3))
    traction = np.zeros((2, 8))
    traction[:, 4] = 1e3, 1e4
    np.testing.assert_allclose(skin.sense(traction), [[0, 0, 500, 0], [0, 0, 5000, 0]], atol=1e-2)


@pytest.mark.parametrize("depth", [0.0, 1e-9])
@pytest.mark.long
def test_the_centre_of_an_even_press_on_surface_taxels_stays_in_the_middle(depth):
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    skin = pp.Skin(pad, pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=depth, channels=["stress_zz"], noise=50.0))
    y, x = skin.planes[0].points.T.reshape(2, 8, 8)
    pressure = 2e4 * np.exp(-(x**2 + y**2) / (2 * 3.2e-3**2))
    noise = 50.0 * np.random.default_rng(0).standard_normal((1, 8, 8))
    touch = skin.reconstruct(pressure[None] + noise)
    assert np.abs(touch.center_of_pressure).max() < 0.1e-3  # with other noise 0.001 to 0.093 mm
    low, high = touch.interval(0.95, "center_of_pressure")
    assert ((low <= 0.0) & (high >= 0.0)).all()
