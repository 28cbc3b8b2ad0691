"""Displacements in the plane of a bonded gel: pressure is told from shear because it pushes, and by where it does."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.observability import pressing

GEL = pp.BondedLayers([pp.Layer(thickness=3.5e-3, youngs_modulus=200e3, poissons_ratio=0.48)])
MARKERS = {"shape": (8, 8), "pitch": 2e-3, "depth": 0.5e-3, "channels": ["displacement_x", "displacement_y"]}


@functools.cache
def skin_of(noise: float | None) -> pp.Skin:
    return pp.Skin(GEL, pp.AreaArray(**MARKERS, noise=noise))


@functools.cache
def readings_of(contact: pp.solutions.AreaContact, *, known: bool = True) -> tuple[pp.Skin, np.ndarray]:
    """Readings with 1 % noise, made on a finer surface than the one sought, and the skin, which may know its noise."""
    fine = pp.Skin(GEL, pp.AreaArray(**MARKERS), surface=pp.AreaGrid(shape=(32, 32), spacing=0.5e-3))
    clean = fine.sense(contact)
    noise = 0.01 * float(np.abs(clean).max())
    readings = clean + noise * np.random.default_rng(0).standard_normal(clean.shape)
    return skin_of(noise if known else None), readings


BALL = pp.solutions.hertz_point(contact_radius=3e-3, force=2.0).shifted(0.3e-3, -0.2e-3)


def test_pressure_is_sought_on_a_bonded_gel() -> None:
    assert pp.Skin(GEL, pp.AreaArray(**MARKERS)).components == ("x", "y", "z")
    line = pp.LineArray(count=20, pitch=1e-3, depth=1e-3, channels=["displacement_x"])
    assert pp.Skin(GEL, line).components == ("x", "z")


def test_pressure_is_sought_whichever_axis_has_the_noise() -> None:
    """Markers on the surface of a thick incompressible gel, one axis three times as noisy: along one direction alone pressure was not felt, and 0 N was said."""
    gel = pp.BondedLayers([pp.Layer(thickness=14e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    for noise in ([3e-6, 1e-6], [1e-6, 3e-6], [1e-6, 1e-6]):
        markers = pp.AreaArray(shape=(6, 8), pitch=3.5e-3, depth=0.0, channels=MARKERS["channels"], noise=noise)
        assert pp.Skin(gel, markers).components == ("x", "y", "z")


@pytest.mark.long
@pytest.mark.parametrize(("motion", "known"), [("shift", False), ("shift", True), ("rotation", True)])
def test_a_camera_that_moved_is_no_contact(motion: str, known: bool) -> None:
    """By a fifth of the largest displacement: the readings were "not pushing", without a number."""
    skin, readings = readings_of(BALL.sliding(0.2, direction=0.7), known=known)
    y, x = np.meshgrid(np.linspace(-1.0, 1.0, 8), np.linspace(-1.0, 1.0, 8), indexing="ij")
    size = 0.2 * float(np.abs(readings).max())
    moved = size * (np.array([0.6, -0.8])[:, None, None] if motion == "shift" else np.stack([-y, x]))
    touch = skin.reconstruct(readings + moved)
    low, high = touch.interval(0.95, of="force")
    assert float(touch.force[2]) == pytest.approx(2.0, rel=0.1)
    true = np.array([0.4 * np.cos(0.7), 0.4 * np.sin(0.7), 2.0])
    assert ((low <= true) & (true <= high)).all()
    assert any(note.startswith("shift along" if motion == "shift" else "rotation about") for note in touch.notes)


@pytest.mark.long
def test_many_markers_measure_the_normal_force_by_default() -> None:
    """Pressure was taken as zero above 1,100 readings: 2 N were 0 N."""
    array = pp.AreaArray(**{**MARKERS, "shape": (24, 24), "pitch": 16e-3 / 24})
    skin = pp.Skin(GEL, array)
    clean = np.asarray(skin.sense(BALL))
    touch = skin.reconstruct(clean + 0.01 * clean.max() * np.random.default_rng(0).standard_normal(clean.shape))
    assert skin.components == ("x", "y", "z")
    assert float(touch.force[2]) == pytest.approx(2.0, rel=0.1)
    low, high = touch.interval(0.95, of="force")
    assert low[2] < 2.0 < high[2]


def test_noise_on_one_axis_makes_no_force_better_known() -> None:
    """How much pressure acts bounds the least error of the normal force: more noise must not narrow it."""
    gel = pp.BondedLayers([pp.Layer(thickness=6e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    least = [
        pressing(gel, [pp.AreaArray(**{**MARKERS, "depth": 0.0}, noise=noise)], ("x", "y")).max()
        for noise in ([1e-6, 1e-6], [1e-5, 1e-6], [1e-6, 1e-5])
    ]
    assert least[1] == pytest.approx(least[2], rel=1e-6)
    assert least[1] <= least[0]


@pytest.mark.long
def test_a_frictionless_ball_is_not_read_as_shear() -> None:
    """Pressure was taken as zero: 0 N, and 8 kPa of shear that is not there."""
    skin, readings = readings_of(BALL)
    touch = skin.reconstruct(readings)
    low, high = touch.interval(0.95, of="force")
    assert float(touch.force[2]) == pytest.approx(2.0, rel=0.1)
    assert low[2] < 2.0 < high[2]
    truth = skin.sample(BALL)
    assert np.linalg.norm(np.asarray(touch.traction)[:2]) < 0.2 * np.linalg.norm(truth[2])
    assert any("do not separate pressure from shear" in note for note in touch.notes)


@pytest.mark.long
def test_a_ball_that_slides_with_known_friction() -> None:
    skin, readings = readings_of(BALL.sliding(0.4, direction=0.5))
    touch = skin.reconstruct(readings, friction=0.4)
    low, high = touch.interval(0.95, of="force")
    truth = np.array([0.8 * np.cos(0.5), 0.8 * np.sin(0.5), 2.0])
    np.testing.assert_allclose(touch.force, truth, rtol=0.07)
    assert (low < truth).all()
    assert (truth < high).all()


@pytest.mark.long
def test_a_pull_is_not_answered_without_a_word() -> None:
    """What is known of contact is that it pushes; a pull does not fit, and says so."""
    skin, readings = readings_of(BALL)
    touch = skin.reconstruct(-readings)
    assert pp.Status(int(np.asarray(touch.status))) is pp.Status.NOT_PUSHING
    assert np.isnan(touch.force).all()
    assert "nan" not in touch.summary()


def test_linear_methods_still_refuse_and_name_one_that_works() -> None:
    skin, readings = readings_of(BALL)
    with pytest.raises(pp.NotObservable, match='method="adaptive"'):
        skin.reconstruct(readings, method="tikhonov", components=["x", "y", "z"])


@pytest.mark.long
def test_shear_alone_is_as_asked() -> None:
    """Traction force microscopy on a thin gel: cells pull along the surface."""
    skin, readings = readings_of(BALL)
    touch = skin.reconstruct(readings, components=["x", "y"])
    assert touch.components == ("x", "y")
    assert touch.methods == "local"


@pytest.mark.long
def test_markers_on_the_surface_of_a_thick_gel_read_the_force_too() -> None:
    """Pressure moves them by a fiftieth of what shear does: it was taken as zero, and the interval of the normal force was 0 to 0 N."""
    pad = pp.BondedLayers([pp.Layer(thickness=3.7e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
    markers = {"shape": (10, 10), "pitch": 1.1e-3, "depth": 0.0, "channels": ["displacement_x", "displacement_y"]}
    skin = pp.Skin(pad, pp.AreaArray(**markers))
    assert skin.components == ("x", "y", "z")
    fine = pp.Skin(pad, pp.AreaArray(**markers), surface=pp.AreaGrid(shape=(40, 40), spacing=0.275e-3))
    clean = fine.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=2.0).sliding(0.4))
    noise = 0.01 * float(np.abs(clean).max())
    touch = skin.reconstruct(clean + noise * np.random.default_rng(0).standard_normal(clean.shape), friction=0.4)
    low, high = touch.interval(0.95, of="force")
    assert low[2] < 2.0 < high[2]
    assert float(touch.force[2]) == pytest.approx(2.0, rel=0.2)


@pytest.mark.long
def test_a_wide_ball_on_surface_markers_is_no_pull_all_round() -> None:
    """With a friction that is given, a pull all round and a shift won: -12.4 of 2.7 N, at a misfit probability of 0.02."""
    how = {**MARKERS, "depth": 0.0, "channels": ["displacement_x", "displacement_y", "displacement_z"]}
    fine = pp.Skin(GEL, pp.AreaArray(**how), surface=pp.AreaGrid(shape=(40, 40), spacing=0.5e-3))
    rng = np.random.default_rng((0, 3, 0))
    force, radius = rng.uniform(0.5, 3.0), rng.uniform(2e-3, 4e-3)
    place = rng.uniform(-2e-3, 2e-3), rng.uniform(-2e-3, 2e-3)
    clean = np.asarray(fine.sense(pp.solutions.hertz_point(contact_radius=radius, force=force).shifted(*place)))
    readings = clean + 0.01 * np.abs(clean).max() * rng.standard_normal(clean.shape)
    touch = pp.Skin(GEL, pp.AreaArray(**how)).reconstruct(readings, friction=0.4)
    low, high = touch.interval(0.95, of="force")
    assert float(touch.force[2]) == pytest.approx(force, rel=0.1)
    assert low[2] < force < high[2]
