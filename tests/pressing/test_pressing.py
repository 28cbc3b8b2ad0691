"""Contacts of rigid bodies as traction: against closed forms, and independent of what is pressed beside them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

import palpate as pp
from palpate.pressing import Contacts, Surface, local_shape
from palpate.pressing.footprints import disc_points, ellipse_points, hull_points, strip_points, tilted
from palpate.solutions import hertz_ellipse, hertz_point

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)


@pytest.fixture(scope="module")
def surface() -> Surface:
    array = pp.AreaArray(shape=(12, 12), pitch=1.2e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    return Surface(pp.Skin(PAD, array))


@pytest.mark.parametrize("curvatures", [(50.0, 200.0), (2.0, 200.0), (199.9, 200.0), (2e-3, 200.0), (80.0, 80.0)])
def test_an_elliptic_contact_satisfies_hertz(curvatures: tuple[float, float]) -> None:
    """Both equations of the gap (Johnson 4.26): with the pressure's own a and b they give the curvatures back."""
    force, modulus = 1.3, 2.6e5
    a, b = (float(v) for v in hertz_ellipse(curvatures, force, modulus))
    peak, square = 1.5 * force / (np.pi * a * b), 1.0 - (b / a) ** 2
    if square == 0.0:
        assert abs(a / (0.75 * force / (curvatures[0] * modulus)) ** (1 / 3) - 1) < 1e-9
        return
    k, e = ellipk(square), ellipe(square)
    lesser = 2 * peak / modulus * b / (square * a**2) * (k - e)
    greater = 2 * peak / modulus * b / (square * a**2) * ((a / b) ** 2 * e - k)
    np.testing.assert_allclose([lesser, greater], curvatures, rtol=1e-6)


@pytest.mark.parametrize("wrong", [[-1.0, 1.0], [2.0, 1.0], [0.0, 1.0], [1.0, np.nan], [1.0, np.inf], [1.0]])
def test_curvatures_that_touch_in_no_ellipse(wrong: list[float]) -> None:
    with pytest.raises(pp.InvalidInput, match="curvatures must be"):
        hertz_ellipse(wrong, 1.0, 1e5)


def test_footprints_have_the_moments_of_their_pressure() -> None:
    """Mean squares: 1/5 of a^2 of Hertz's ellipse, 1/4 of a disc, 1/3 along and 1/4 across a strip, and those of a square."""
    for (points, weights), squares in (
        (ellipse_points(12), (0.2, 0.2)),
        (disc_points(12), (0.25, 0.25)),
        (strip_points(60), (1 / 3, 0.25)),
    ):
        assert weights.min() >= 0
        assert abs(weights.sum() - 1) < 1e-12
        np.testing.assert_allclose(weights @ points, 0.0, atol=1e-12)
        np.testing.assert_allclose(weights @ points**2, squares, rtol=1e-3)
    corners = np.array([[[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]] + [[1.0, 1.0]] * 4])
    points, weights = hull_points(corners, 20)
    np.testing.assert_allclose(np.einsum("nk,nki->ni", weights, points), 0.0, atol=1e-2)
    assert np.abs(points).max() < 1.0


@pytest.mark.parametrize("more", [[(0.0, 0.0)], [(0.3, 0.0)], [(0.0, -1.0)], [(1.0, 1.0), (0.0, 0.0)]])
def test_a_place_inside_a_flat_changes_nothing(more: list[tuple[float, float]]) -> None:
    square = [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)]
    points, weights = hull_points(np.array([square + more]), 20)
    np.testing.assert_allclose(np.einsum("nk,nki->ni", weights, points), 0.0, atol=2e-2)
    np.testing.assert_allclose(np.einsum("nk,nki->ni", weights, points**2), 1 / 3, rtol=1e-2)


@pytest.mark.parametrize("along", [2, 3, 4])
def test_a_flat_of_many_points_presses_all_of_it(along: int, surface: Surface) -> None:
    side = np.linspace(-2e-3, 2e-3, along)
    places = np.array([(x, y, 0.0) for y in side for x in side])
    n = len(places)
    flat = Contacts(
        position=places, force=[[0.0, 0.0, 1.0 / n]] * n, curvature=np.zeros((n, 2, 2)), friction=[0.5] * n,
        body=np.zeros(n, dtype=int),
    )  # fmt: skip
    pressure = surface.press(flat).traction[0, 2]
    grid = surface.skin.surface
    share = (pressure * (np.abs(grid.y) < 1e-3)[:, None] * (np.abs(grid.x) < 1e-3)).sum() * grid.cell
    inside = np.count_nonzero(np.abs(grid.x) < 1e-3) * grid.spacings[1] / 4e-3
    assert share == pytest.approx(inside**2, rel=0.05)


def test_a_tilted_pressure_never_pulls_and_has_its_centre() -> None:
    points, weights = (v[None] for v in disc_points(20))
    for center in ([0.3, -0.2], [0.8, 0.0], [0.0, 0.0]):
        moved, found = tilted(points, weights, np.array([center]))
        assert found.min() >= 0
        np.testing.assert_allclose(moved, points, atol=1e-6)  # the footprint stays
        np.testing.assert_allclose(np.einsum("nk,nki->ni", found, moved)[0], center, atol=1e-10)
    moved, found = tilted(points, weights, np.array([[1.5, 0.0]]))  # outside: it moves
    np.testing.assert_allclose(np.einsum("nk,nki->ni", found, moved)[0], [1.5, 0.0], atol=1e-10)


@pytest.mark.parametrize("radius", [0.05e-3, 2e-3, 20e-3])
@pytest.mark.parametrize("shear", [0.0, 0.3, 0.6])
def test_a_ball_reads_what_its_closed_form_does(radius: float, shear: float, surface: Surface) -> None:
    place = (0.37e-3, -0.61e-3)
    pressed = surface.press(
        Contacts(
            position=[[*place, 0.0]], force=[[0.0, shear, 1.0]], curvature=np.eye(2)[None] / radius, friction=[0.6]
        )
    )
    a = pp.solutions.hertz_contact_radius(PAD, radius=radius, force=1.0)
    ball = hertz_point(contact_radius=a, force=1.0)
    if shear:
        ball = (
            ball.sliding(0.6, direction=np.pi / 2)
            if shear == 0.6
            else ball.partial_slip(0.6, shear, direction=np.pi / 2)
        )
    expected = surface.skin.sense(ball.shifted(*place))
    assert np.abs(pressed.readings()[0] - expected).max() < 5e-3 * np.abs(expected).max()
    np.testing.assert_allclose(pressed.felt, pressed.wrench, atol=1e-12)


def random_contacts(n: int, rng: np.random.Generator) -> Contacts:
    """Of every kind, some of several points."""
    curvature = np.zeros((n, 2, 2))
    curvature[: n // 2] = np.diag([50.0, 300.0])
    curvature[n // 2 : 3 * n // 4] = np.diag([0.0, 200.0])
    return Contacts(
        position=np.c_[rng.uniform(-4e-3, 4e-3, (n, 2)), rng.uniform(-1e-4, 1e-4, n)],
        force=np.c_[rng.uniform(-0.3, 0.3, (n, 2)), rng.uniform(0.5, 2.0, n)],
        torque=rng.uniform(-1e-4, 1e-4, (n, 3)),
        curvature=curvature,
        friction=np.full(n, 0.6),
        world=np.arange(n) // 3,
        body=rng.integers(0, 2, n),
        known=rng.random(n) < 0.9,
        sharp=rng.random(n) < 0.1,
        length=np.where(np.arange(n) % 2, 5e-3, 0.0),
    )


def test_force_and_moment_are_kept_and_company_changes_nothing(surface: Surface, rng: np.random.Generator) -> None:
    contacts = random_contacts(90, rng)
    together = surface.press(contacts, worlds=30)
    assert not together.missed.any()
    np.testing.assert_allclose(together.felt, together.wrench, atol=1e-9)
    for world in (0, 7, 29):
        alone = surface.press(contacts.some(np.asarray(contacts.world) == world), worlds=30)
        np.testing.assert_allclose(alone.traction[world], together.traction[world], rtol=1e-9, atol=1e-6)


def test_what_lies_beyond_the_surface_is_counted(surface: Surface) -> None:
    far = Contacts(position=[[0.05, 0.0, 0.0]], force=[[0, 0, 1.0]], curvature=100 * np.eye(2)[None], friction=[0.5])
    pressed = surface.press(far)
    assert pressed.missed.tolist() == [1]
    assert not pressed.felt.any()


def test_what_is_refused() -> None:
    line = pp.Skin(PAD, pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    with pytest.raises(pp.Unsupported, match="give the skin an AreaArray"):
        Surface(line)
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    with pytest.raises(pp.Unsupported, match="leave boundary out"):
        Surface(pp.Skin(PAD, array, boundary="periodic"))
    strain = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["strain_zz"])
    creeps = pp.Skin(pp.Viscoelastic(PAD, prony=[(0.3, 1.0)]), strain)
    with pytest.raises(pp.Unsupported, match="without_creep"):
        Surface(creeps)
    assert Surface(creeps.without_creep()).modulus > 0
    with pytest.raises(pp.InvalidInput, match="least must be"):
        Surface(pp.Skin(PAD, array), least=-1.0)
    with pytest.raises(pp.InvalidInput, match="force must be finite"):
        Contacts(position=[[0, 0, 0]], force=[[0, 0, np.nan]], curvature=np.eye(2)[None], friction=[0.5])
    with pytest.raises(pp.InvalidInput, match="worlds=6"):
        Surface(pp.Skin(PAD, array)).press(
            Contacts(position=[[0, 0, 0]], force=[[0, 0, 1]], curvature=np.eye(2)[None], friction=[0.5], world=[5])
        )


def test_shapes_are_curved_as_they_are() -> None:
    egg = local_shape("ellipsoid", [3e-3, 2e-3, 1e-3], [0.0, 0.0, 1e-3]).curvature
    np.testing.assert_allclose(np.diag(egg)[:2], [1e-3 / 9e-6, 1e-3 / 4e-6])  # c/a^2, c/b^2 at the pole
    assert local_shape("cylinder", [4e-3, 6e-3], [1e-3, 0.0, 6e-3]).disc == 4e-3
    assert local_shape("cylinder", [4e-3, 6e-3], [4e-3, 0.0, 6e-3]).sharp
    np.testing.assert_allclose(local_shape("cylinder", [4e-3, 6e-3], [4e-3, 0.0, 1e-3]).curvature[1, 1], 250.0)
    assert not local_shape("box", [1e-2, 1e-2, 1e-2], [0.0, 0.0, 1e-2]).curvature.any()
    with pytest.raises(pp.InvalidInput, match="three finite numbers"):
        local_shape("sphere", [1e-3], [0.0, np.nan, 0.0])
