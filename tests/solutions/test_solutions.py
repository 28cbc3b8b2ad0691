from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from conftest import channel_of, relative
from palpate import solutions
from palpate.elastic import AREA_CHANNELS, LINE_CHANNELS
from palpate.errors import InvalidInput

LINE = {
    "line_p": solutions.line_load(force=1),
    "line_q": solutions.line_load(force=1, component="x"),
    "strip_p": solutions.strip(half_width=1, traction=1),
    "strip_q": solutions.strip(half_width=1, traction=1, component="x"),
    "hertz_p": solutions.hertz_line(half_width=1, force=np.pi / 2),
    "punch_p": solutions.flat_punch_line(half_width=1, force=1),
    "hertz_sliding_mu0.4": solutions.hertz_line(half_width=1, force=np.pi / 2).sliding(0.4),
}
AREA = {
    "point_P": solutions.point_load(force=1),
    "point_Q": solutions.point_load(force=1, component="x"),
    "hertz_circle_p": solutions.hertz_point(contact_radius=1, force=2 * np.pi / 3),
    "rect_p": solutions.patch(half_widths=(1, 0.75), traction=1),
    "rect_q": solutions.patch(half_widths=(1, 0.75), traction=1, component="x"),
}


@pytest.mark.parametrize("nu", ["0.3", "0.5"])
@pytest.mark.parametrize("case", list(LINE))
def test_line_contacts_against_oracle(oracle: Any, case: str, nu: str) -> None:
    data = oracle("closed_form_2d")
    body, compared = pp.HalfSpace(youngs_modulus=1, poissons_ratio=float(nu)), 0
    for key, true in data.items():
        if not key.startswith(case + "__"):
            continue
        field = key.removeprefix(case + "__")
        if field.startswith("nu"):
            if not field.startswith(f"nu{nu}__"):
                continue
            field = field.split("__")[1]
        depths = data["z_u"] if field.startswith("u_") else data["z"]
        found = LINE[case].fields(body, [channel_of(field)], data["x"], depths[:, None])[0]
        if field.startswith("u_"):
            found = found - LINE[case].fields(body, [channel_of(field)], 0.0, 8.0)[0]
        assert relative(found, true) < 1e-10, key
        compared += 1
    assert compared >= 5


@pytest.mark.parametrize("nu", ["0.3", "0.5"])
@pytest.mark.parametrize("case", list(AREA))
def test_area_contacts_against_oracle(oracle: Any, case: str, nu: str) -> None:
    data = oracle("closed_form_3d")
    body, compared = pp.HalfSpace(youngs_modulus=1, poissons_ratio=float(nu)), 0
    g = data["xy"]
    for key, true in data.items():
        field = key.split("__")[-1]
        if not key.startswith(f"{case}__nu{nu}__") or field.startswith(("line", "surf")):
            continue
        found = AREA[case].fields(body, [channel_of(field)], g, g[:, None], data["z"][:, None, None])[0]
        assert relative(found, true) < 1e-8, key
        compared += 1
    assert compared >= 10


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("contact", [*LINE.values()])
def test_line_fields_are_in_equilibrium(contact: Any, nu: float) -> None:
    """div s = 0 and e = -sym grad u, by differences (independent of the oracle folder)."""
    body = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=nu)
    x, z, h = np.array([-1.7, -0.3, 0.2, 2.5]), 0.6, 1e-4

    def at(dx: float, dz: float) -> dict[str, np.ndarray]:
        return dict(zip(LINE_CHANNELS, contact.fields(body, LINE_CHANNELS, x + dx, z + dz)))

    right, left, down, up, here = at(h, 0), at(-h, 0), at(0, h), at(0, -h), at(0, 0)
    ddx = {c: (right[c] - left[c]) / (2 * h) for c in here}
    ddz = {c: (down[c] - up[c]) / (2 * h) for c in here}
    np.testing.assert_allclose(ddx["stress_xx"] + ddz["stress_xz"], 0, atol=1e-6)
    np.testing.assert_allclose(ddx["stress_xz"] + ddz["stress_zz"], 0, atol=1e-6)
    np.testing.assert_allclose(here["strain_xx"], -ddx["displacement_x"], atol=1e-6)
    np.testing.assert_allclose(here["strain_zz"], -ddz["displacement_z"], atol=1e-6)
    np.testing.assert_allclose(here["strain_xz"], -0.5 * (ddz["displacement_x"] + ddx["displacement_z"]), atol=1e-6)
    np.testing.assert_allclose(here["stress_yy"], nu * (here["stress_xx"] + here["stress_zz"]), atol=1e-14)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
@pytest.mark.parametrize(
    "contact",
    [
        solutions.patch(half_widths=(1, 0.5), traction=1, component="y"),
        solutions.patch(half_widths=(0.7, 1.5), traction=1, component="x"),
        solutions.patch(half_widths=(0.7, 1.5), traction=1),
        solutions.point_load(force=1, component="y"),
        solutions.flat_punch(radius=1, force=1),
        # by quadrature: ten times as long
        pytest.param(
            solutions.hertz_point(contact_radius=1, force=1).sliding(0.5, direction=1.0), marks=pytest.mark.long
        ),
    ],
)
def test_area_fields_are_in_equilibrium(contact: Any, nu: float) -> None:
    body = pp.HalfSpace(youngs_modulus=2.0, poissons_ratio=nu)
    p = np.array([[0.3, 0.2, 0.6], [-1.2, 0.4, 0.5]]).T
    h = 1e-4

    def at(axis: int, step: float) -> dict[str, np.ndarray]:
        q = p.copy()
        q[axis] += step
        return dict(zip(AREA_CHANNELS, contact.fields(body, AREA_CHANNELS, *q)))

    here = at(0, 0.0)
    slope = [{c: (a[c] - b[c]) / (2 * h) for c in a} for a, b in ((at(i, h), at(i, -h)) for i in range(3))]
    name = lambda i, j: "".join(sorted("xyz"[i] + "xyz"[j]))  # noqa: E731
    for i in range(3):
        divergence = sum(slope[j][f"stress_{name(i, j)}"] for j in range(3))
        np.testing.assert_allclose(divergence, 0, atol=2e-6)
        for j in range(3):
            gradient = -0.5 * (slope[j][f"displacement_{'xyz'[i]}"] + slope[i][f"displacement_{'xyz'[j]}"])
            np.testing.assert_allclose(here[f"strain_{name(i, j)}"], gradient, atol=2e-6)


@pytest.mark.parametrize("contact", [LINE["strip_p"], LINE["hertz_sliding_mu0.4"], LINE["punch_p"]])
def test_averages_hold_the_whole_force(contact: Any) -> None:
    edges = np.linspace(-3.01, 3.02, 38)
    found = contact.averages(edges) @ np.diff(edges)
    np.testing.assert_allclose(found, contact.force, rtol=1e-12, atol=1e-12)


def test_area_averages_hold_the_force() -> None:
    x = np.linspace(-3, 3, 61)
    found = solutions.patch(half_widths=(1.03, 0.72), traction=2.0).shifted(0.31, -0.2).averages(x, x)
    assert found[2].sum() * 0.01 == pytest.approx(2.0 * 4 * 1.03 * 0.72, rel=1e-12)
    ball = solutions.hertz_point(contact_radius=1.2, force=3.0).sliding(0.5, direction=np.pi / 2)
    np.testing.assert_allclose(ball.averages(x, x).sum(axis=(1, 2)) * 0.01, [0, 1.5, 3.0], atol=2e-3)


@pytest.mark.parametrize(("along_x", "along_y"), [(1, -1), (-1, 1), (-1, -1)])
def test_area_averages_follow_axes_that_fall(along_x: int, along_y: int) -> None:
    """A picture's rows run from the top: its y falls."""
    x, y = np.linspace(-3, 3, 61), np.linspace(-2, 4, 41)
    ball = solutions.hertz_point(contact_radius=1.2, force=3.0).sliding(0.5, direction=0.3).shifted(0.4, 0.9)
    found = ball.averages(x[::along_x], y[::along_y])
    np.testing.assert_allclose(found, ball.averages(x, y)[:, ::along_y, ::along_x], atol=1e-12)


@pytest.mark.parametrize("x", [[0.0], [0.0, 1.0, 2.5], [0.0, 0.0], [[0.0, 1.0]], 0.0, [0.0, np.nan, 2.0]])
def test_area_averages_need_equal_cells(x: Any) -> None:
    with pytest.raises(InvalidInput, match="two or more cells of equal width"):
        solutions.patch(half_widths=(1, 1), traction=1).averages([0.0, 1.0], x)


def test_traction_at_the_edge() -> None:
    edges = np.array([-1.0, 1.0, np.nextafter(1.0, 2.0), -1.1])
    strip, punch = solutions.strip(half_width=1, traction=2.0), solutions.flat_punch_line(half_width=1, force=1.0)
    assert strip.traction(edges)[1].tolist() == [2.0, 2.0, 0.0, 0.0]
    assert punch.traction(edges)[1].tolist() == [np.inf, np.inf, 0.0, 0.0]
    assert solutions.flat_punch(radius=1, force=1.0).traction(edges, 0.0)[2].tolist() == [np.inf, np.inf, 0.0, 0.0]


@pytest.mark.parametrize("contact", [LINE["hertz_p"], LINE["line_q"], AREA["point_P"], AREA["rect_q"]])
def test_nothing_is_above_the_surface(contact: Any) -> None:
    body = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.4)
    place = (0.3,) if hasattr(contact, "half_width") else (0.3, 0.1)
    with pytest.raises(InvalidInput, match="depth must be 0 or more"):
        contact.fields(body, ["stress_zz"], *place, [0.5, -0.5])


def test_surface_stress_is_the_traction() -> None:
    body = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.4)
    x = np.array([-1.5, -0.5, 0.0, 0.9, 1.4])
    sliding = solutions.hertz_line(half_width=1, force=1).sliding(-0.3)
    np.testing.assert_allclose(
        sliding.fields(body, ["stress_xz", "stress_zz"], x, 0.0), sliding.traction(x), atol=1e-12
    )
    block = solutions.patch(half_widths=(1, 2), traction=3.0, component="y")
    np.testing.assert_allclose(
        block.fields(body, ["stress_xz", "stress_yz", "stress_zz"], x, 0.3, 0.0), block.traction(x, 0.3), atol=1e-12
    )


def test_hertz_surface_displacement() -> None:
    """A ball's indentation: u_z = pi p0 (2a^2 - r^2)/(4 E* a) (Johnson 3.41a), as the limit of small depth."""
    body = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.3)
    ball = solutions.hertz_point(contact_radius=1.0, force=2 * np.pi / 3)
    r = np.array([0.0, 0.4, 0.7])
    expected = np.pi * (2 - r**2) / 4 * (1 - 0.09)
    near = [ball.fields(body, ["displacement_z"], r, 0.0, z)[0] for z in (0.02, 0.04)]
    np.testing.assert_allclose(2 * near[0] - near[1], expected, rtol=3e-3)
    with pytest.raises(pp.Unsupported, match="depth"):
        ball.fields(body, ["displacement_z"], r, 0.0, 0.0)


def test_hertz_sizes() -> None:
    body = pp.HalfSpace(youngs_modulus=1e6, poissons_ratio=0.5)
    a = solutions.hertz_contact_radius(body, radius=0.01, force=1.0)
    # p0 = (6 P E*^2/(pi^3 R^2))^(1/3)
    p0 = (6 * 1.0 * (1e6 / 0.75) ** 2 / (np.pi**3 * 0.01**2)) ** (1 / 3)
    assert solutions.hertz_point(contact_radius=a, force=1.0).traction(0.0, 0.0)[2] == pytest.approx(p0, rel=1e-12)
    b = solutions.hertz_contact_half_width(body, radius=0.01, force=100.0)
    # p0 = sqrt(P E*/(pi R))
    assert solutions.hertz_line(half_width=b, force=100.0).traction(0.0)[1] == pytest.approx(
        np.sqrt(100.0 * 1e6 / 0.75 / (np.pi * 0.01)), rel=1e-12
    )
    layer: Any = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=2e5, poissons_ratio=0.48)])
    with pytest.raises(pp.Unsupported, match="HalfSpace only; got BondedLayers"):
        solutions.hertz_contact_radius(layer, radius=0.01, force=1.0)


@pytest.mark.parametrize("tangential", [0.2, -0.35])
def test_partial_slip(tangential: float) -> None:
    ball = solutions.hertz_point(contact_radius=1.0, force=1.0).partial_slip(0.5, tangential, direction=0.4)
    np.testing.assert_allclose(ball.force, [tangential * np.cos(0.4), tangential * np.sin(0.4), 1.0], rtol=1e-12)
    x = np.linspace(-0.99, 0.99, 41)
    t = ball.traction(x, 0.0)
    shear, limit = np.hypot(t[0], t[1]), 0.5 * t[2]
    assert (shear <= limit * (1 + 1e-12)).all()
    stick = (1 - abs(tangential) / 0.5) ** (1 / 3)
    np.testing.assert_allclose(shear[np.abs(x) > stick], limit[np.abs(x) > stick], rtol=1e-12)
    line = solutions.hertz_line(half_width=1.0, force=1.0).partial_slip(0.5, tangential)
    np.testing.assert_allclose(line.force, [tangential, 1.0], rtol=1e-12)
    with pytest.raises(pp.InvalidInput, match="slides"):
        solutions.hertz_line(half_width=1.0, force=1.0).partial_slip(0.5, 0.5)
    with pytest.raises(pp.Unsupported, match="Hertz"):
        solutions.flat_punch(radius=1.0, force=1.0).partial_slip(0.5, 0.1)


def test_the_contact_of_a_ball_is_told_by_the_ball_and_the_pad() -> None:
    pad = pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.5)  # E* = 4e5 Pa
    force, ball = 2.0, 10e-3
    a = solutions.hertz_contact_radius(pad, radius=ball, force=force)
    contact = solutions.hertz_point(contact_radius=a, force=force)
    assert contact.size == (a, a)
    assert a == pytest.approx((3 * force * ball / (4 * 4e5)) ** (1 / 3))
    assert contact.traction(0.0, 0.0)[2] == pytest.approx(1.5 * force / (np.pi * a**2))


def test_radius_was_the_contact_s_and_says_so() -> None:
    with pytest.warns(FutureWarning, match="radius of the contact, not of the ball: write contact_radius="):
        old = solutions.hertz_point(radius=2e-3, force=0.5)
    assert old == solutions.hertz_point(contact_radius=2e-3, force=0.5)
    with pytest.raises(pp.InvalidInput, match="contact_radius is missing"):
        solutions.hertz_point(force=0.5)
    with pytest.raises(pp.InvalidInput, match="leave it out"):
        solutions.hertz_point(contact_radius=2e-3, radius=2e-3, force=0.5)
