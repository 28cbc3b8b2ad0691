"""`Skin.sense` of a contact in closed form: exact readings, whatever the cells of the surface."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.special import j1

import palpate as pp
from palpate import solutions

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.45)
LAYERS = pp.BondedLayers(
    [
        pp.Layer(thickness=2.0, youngs_modulus=1e5, poissons_ratio=0.48),
        pp.Layer(thickness=1.0, youngs_modulus=3e5, poissons_ratio=0.4),
    ]
)
CHANNELS = [
    ["stress_xz", "stress_yz", "stress_zz"],
    ["displacement_x", "displacement_z"],
    ["strain_xx", "strain_zz", "stress_xx"],
]
#: Lengths in pitches.
AREA = {
    "tiny ball": solutions.hertz_point(contact_radius=0.05, force=1.0),
    "small ball that slides": solutions.hertz_point(contact_radius=0.4, force=1.0).sliding(0.5),
    "wide ball in partial slip": solutions.hertz_point(contact_radius=2.5, force=1.0).partial_slip(
        0.5, 0.2, direction=0.4
    ),
    "small punch": solutions.flat_punch(radius=0.4, force=1.0),
    "wide punch": solutions.flat_punch(radius=2.0, force=1.0),
    "patch": solutions.patch(half_widths=(0.43, 0.71), traction=1.0),
    "point": solutions.point_load(force=1.0),
}
LINE = {
    "tiny roller": solutions.hertz_line(half_width=0.02, force=1.0),
    "small roller that slides": solutions.hertz_line(half_width=0.4, force=1.0).sliding(0.3),
    "wide roller in partial slip": solutions.hertz_line(half_width=5.0, force=1.0).partial_slip(0.4, 0.2),
    "small punch": solutions.flat_punch_line(half_width=0.4, force=1.0),
    "wide punch": solutions.flat_punch_line(half_width=4.0, force=1.0),
    "strip": solutions.strip(half_width=0.37, traction=1.0, component="x"),
    "line load": solutions.line_load(force=1.0),
}


def off(found: Any, true: Any) -> float:
    """Largest error, in parts of the largest reading."""
    return float(np.abs(np.asarray(found) - true).max() / np.abs(true).max())


@pytest.mark.parametrize("name", AREA)
@pytest.mark.parametrize("depth", [0.25, 0.4, 1.5])
@pytest.mark.long
def test_area_contacts_of_any_size_read_what_their_closed_form_says(name: str, depth: float) -> None:
    for channels in CHANNELS:
        array = pp.AreaArray(shape=(6, 7), pitch=1.0, depth=depth, channels=channels)
        skin = pp.Skin(PAD, array)
        contact = AREA[name].shifted(0.23, -0.31)
        true = contact.fields(PAD, channels, array.points[:, 1], array.points[:, 0], depth)
        assert off(skin.sense(contact), true.reshape(-1, 6, 7)) < 1e-3


@pytest.mark.parametrize("name", LINE)
@pytest.mark.parametrize("depth", [0.05, 0.4, 2.0])
@pytest.mark.long
def test_line_contacts_of_any_size_read_what_their_closed_form_says(name: str, depth: float) -> None:
    for channels in (["stress_xz", "stress_zz"], ["strain_xx", "strain_zz"], ["displacement_x", "displacement_z"]):
        array = pp.LineArray(count=21, pitch=1.0, depth=depth, channels=channels)
        contact = LINE[name].shifted(0.23)
        true = contact.fields(PAD, channels, array.grid.x, depth)
        if channels[0] == "displacement_x":  # of a half-plane it has no zero
            true = true - true.mean(axis=1, keepdims=True)
        assert off(pp.Skin(PAD, array).sense(contact), true) < 3e-4


def test_a_punch_of_less_than_a_cell_read_on_cells_is_far_off() -> None:
    """What the mean on each cell of the surface reads, which is what a field says: here 5 % of the largest reading."""
    array = pp.AreaArray(shape=(6, 7), pitch=1.0, depth=0.4, channels=["stress_zz"])
    skin = pp.Skin(PAD, array)
    punch = AREA["small punch"].shifted(0.23, -0.31)
    true = punch.fields(PAD, ["stress_zz"], array.points[:, 1], array.points[:, 0], 0.4).reshape(1, 6, 7)
    assert off(skin.sense(skin.sample(punch)), true) > 0.04
    assert off(skin.sense(punch), true) < 1e-3


def test_the_surface_does_not_matter() -> None:
    array = pp.AreaArray(shape=(6, 6), pitch=1.0, depth=0.6, channels=CHANNELS[0])
    ball = AREA["small ball that slides"].shifted(0.4, 0.2)
    fine, coarse = (
        pp.Skin(PAD, array, surface=pp.AreaGrid(shape=(n, n), spacing=12.0 / n)).sense(ball) for n in (60, 9)
    )
    assert off(coarse, np.asarray(fine)) < 1e-3


def test_a_contact_beyond_the_surface_presses_all_the_same() -> None:
    array = pp.AreaArray(shape=(5, 5), pitch=1.0, depth=0.5, channels=CHANNELS[0])
    skin = pp.Skin(PAD, array)
    edge = float(skin.surface.axes[1][-1])
    for x in (edge, edge + 5.0):  # across the edge of the surface, and past it
        ball = solutions.hertz_point(contact_radius=1.5, force=1.0).shifted(x, 0.3)
        true = ball.fields(PAD, CHANNELS[0], array.points[:, 1], array.points[:, 0], 0.5).reshape(3, 5, 5)
        assert off(skin.sense(ball), true) < 1e-3


@pytest.mark.parametrize("kind", ["area", "scattered", "aperture"])
@pytest.mark.parametrize("pad", [PAD, LAYERS], ids=["half-space", "layers"])
@pytest.mark.long
def test_readings_are_those_of_fine_cells(pad: Any, kind: str) -> None:
    """A patch, which fine cells hold exactly where they end with it."""
    patch = solutions.patch(half_widths=(0.3, 0.45), traction=1e3).shifted(0.2, -0.1)
    fine = pp.AreaGrid(shape=(2, 2), spacing=(0.45, 0.3), center=patch.center)
    for depth, channels in ((0.0, ["displacement_x", "displacement_z"]), (0.4, ["stress_zz", "strain_xx"])):
        more: Any = {"depth": depth, "channels": channels}
        if kind == "scattered":
            places = np.random.default_rng(0).uniform(-2.0, 2.0, (15, 2))
            array: Any = pp.ScatteredArray(positions=places, **more)
        else:
            array = pp.AreaArray(shape=(4, 5), pitch=1.0, aperture=0.6 if kind == "aperture" else 0.0, **more)
        exact = pp.Skin(pad, array, surface=fine)
        true = np.asarray(exact.sense(exact.sample(patch)))
        # an aperture on the surface itself is cut into few cells
        assert off(pp.Skin(pad, array).sense(patch), true) < (6e-3 if depth == 0.0 and kind == "aperture" else 1e-3)


def test_one_marker_near_a_small_contact() -> None:
    """The part of scattered markers that needs finer cells may be a single one."""
    places = np.array([[0.0, 0.0], [9.0, 0.5], [0.3, 9.0], [9.0, 9.0]])
    array = pp.ScatteredArray(positions=places, depth=0.3, channels=["displacement_z"])
    ball = solutions.hertz_point(contact_radius=0.1, force=1.0)
    true = ball.fields(PAD, ["displacement_z"], places[:, 0], places[:, 1], 0.3)
    assert off(pp.Skin(PAD, array).sense(ball), true) < 1e-3


@pytest.mark.parametrize("center", [0.3, 7.9], ids=["inside", "across the edge"])
@pytest.mark.parametrize("half_width", [0.2, 2.0])
def test_on_a_periodic_surface_a_roller_is_repeated(half_width: float, center: float) -> None:
    """The Fourier series of rows of Hertz contacts: p(k) = 2 P J1(k a)/(k a), and s_zz(k) = (1 + k z) exp(-k z) p(k)."""
    count, depth = 16, 0.7
    array = pp.LineArray(count=count, pitch=1.0, depth=depth, channels=["stress_zz"])
    skin = pp.Skin(PAD, array, boundary="periodic")
    contact = solutions.hertz_line(half_width=half_width, force=1.0).shifted(center)
    k = 2 * math.pi / count * np.arange(1, 400)
    weight = 2 * j1(k * half_width) / (k * half_width) * (1 + k * depth) * np.exp(-k * depth)
    true = (1 + 2 * (weight * np.cos(k * (array.grid.x[:, None] - center))).sum(axis=1)) / count
    assert off(skin.sense(contact)[0], true) < 1e-3


def test_planes_gaps_and_noise_are_those_of_any_traction() -> None:
    """Several planes are joined, a missing taxel reads NaN, and the noise is drawn as for a field."""
    mask = np.ones(11, dtype=bool)
    mask[4] = False
    planes = [
        pp.LineArray(count=11, pitch=1.0, depth=d, channels=["stress_xz", "stress_zz"], noise=0.01, mask=m)
        for d, m in ((0.5, mask), (1.5, None))
    ]
    skin = pp.Skin(PAD, planes)
    contact = LINE["small roller that slides"]
    clean, noisy = skin.sense(contact), skin.sense(contact, rng=np.random.default_rng(3))
    field = skin.sample(contact)
    noise = skin.sense(field, rng=np.random.default_rng(3)) - skin.sense(field)
    assert clean.shape == (4, 11)
    assert np.isnan(clean[:2, 4]).all()
    assert np.isfinite(clean[2:]).all()
    np.testing.assert_allclose(noisy - clean, noise, atol=1e-15)


def test_a_concentrated_load_on_the_surface_is_refused() -> None:
    array = pp.AreaArray(shape=(3, 3), pitch=1.0, depth=0.0, channels=["displacement_z"])
    with pytest.raises(pp.errors.Unsupported, match="concentrated load"):
        pp.Skin(PAD, array).sense(solutions.point_load(force=1.0))


def test_means_of_circles_in_cells_are_exact() -> None:
    """They add up to the force, cells inside one another agree, and no cell outside presses."""
    for contact in (solutions.hertz_point(contact_radius=1.0, force=2.0), solutions.flat_punch(radius=1.0, force=2.0)):
        moved = contact.shifted(0.07, -0.13)
        coarse, fine = (np.linspace(-1.5 + 1.5 / n, 1.5 - 1.5 / n, n) for n in (5, 135))
        few, many = moved.averages(coarse, coarse)[2], moved.averages(fine, fine)[2]
        np.testing.assert_allclose(few.sum() * 0.36, 2.0, rtol=1e-12)
        np.testing.assert_allclose(many.reshape(5, 27, 5, 27).mean(axis=(1, 3)), few, rtol=1e-9)
        y, x = np.meshgrid(fine + 0.13, fine - 0.07, indexing="ij")
        assert (many >= 0).all()
        assert not many[np.hypot(x, y) > 1.03].any()
        inside = np.hypot(x, y) < 0.5
        np.testing.assert_allclose(many[inside], contact.traction(x, y)[2][inside], rtol=1e-3)
