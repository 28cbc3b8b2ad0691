"""Markers scattered in a gel that are followed in the plane: the surface that is used when none is given, and contact past the outermost."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.sensing import default_surface

GEL = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=300e3, poissons_ratio=0.48)])
PITCH, NOISE = 2e-3, 2e-6
IN_PLANE = ["displacement_x", "displacement_y"]


def places(rows: int = 6, columns: int = 8, jitter: float = 1e-4) -> np.ndarray:
    y, x = (PITCH * (np.arange(n) - 0.5 * (n - 1)) for n in (rows, columns))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return grid + jitter * np.random.default_rng(0).standard_normal(grid.shape)


def test_cells_are_half_the_distance_of_markers_in_a_pad_on_a_base() -> None:
    array = pp.ScatteredArray(positions=places(jitter=0.0), depth=0.5e-3, channels=IN_PLANE)
    surface = pp.Skin(GEL, array).surface
    assert surface.spacings == pytest.approx((1e-3, 1e-3))
    # a contact is felt a thickness past the outermost
    assert np.ptp(surface.axes[1]) >= np.ptp(array.points[:, 1]) + 2 * 4e-3


@pytest.mark.parametrize(
    ("pad", "channels"),
    [
        (pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.48), IN_PLANE),
        (GEL, ["stress_xz", "stress_yz", "stress_zz"]),
    ],
)
def test_what_is_solved_in_little_time_keeps_its_finer_cells(pad: pp.HalfSpace, channels: list[str]) -> None:
    array = pp.ScatteredArray(positions=places(jitter=0.0), depth=0.5e-3, channels=channels)
    assert pp.Skin(pad, array).surface.spacings == pytest.approx((0.5e-3, 0.5e-3))


def test_large_fields_do_not_reach_a_thickness_past_their_markers() -> None:
    array = pp.ScatteredArray(positions=0.01 * places(40, 40), depth=5e-6, channels=IN_PLANE)
    alike = default_surface([array])
    thick = default_surface([array], thickness=4e-3)
    assert np.ptp(thick.axes[0]) <= 1.1 * np.ptp(alike.axes[0])


def test_a_row_that_is_nearly_a_line_has_cells() -> None:
    positions = np.stack([np.arange(9) * 1e-3, np.arange(9) * 1e-9], axis=-1)
    surface = default_surface([pp.ScatteredArray(positions=positions, depth=1e-3, channels=IN_PLANE)], thickness=4e-3)
    assert 9 <= surface.shape[1] < 40


def test_dots_of_pictures_and_markers_of_tables_have_the_same_surface() -> None:
    from palpate.camera import gel_skin

    positions = places()
    table = pp.Skin(GEL, pp.ScatteredArray(positions=positions, depth=0.5e-3, channels=IN_PLANE))
    array = pp.AreaArray(shape=(6, 8), pitch=PITCH, depth=0.5e-3, channels=IN_PLANE)
    dots = gel_skin(pp.Skin(GEL, array), positions)
    assert dots.surface == table.surface
    assert not dots.problem().fixed  # contact is sought past it too


@pytest.mark.long
def test_a_ball_at_the_corner_is_found_within_its_error() -> None:
    """Half of it lies past the outermost markers: it took minutes, and the interval ended at 1.7 N."""
    skin = pp.Skin(GEL, pp.ScatteredArray(positions=places(), depth=0.5e-3, channels=IN_PLANE, noise=NOISE))
    fine = pp.Skin(GEL, skin.planes[0], surface=pp.AreaGrid(shape=(104, 104), spacing=0.25e-3))
    ball = pp.solutions.hertz_point(contact_radius=2e-3, force=1.83).shifted(6.5e-3, 4.8e-3).sliding(0.4, direction=1.3)
    clean = np.asarray(fine.sense(ball))
    touch = skin.reconstruct(clean + NOISE * np.random.default_rng(1).standard_normal(clean.shape))
    low, high = (np.asarray(end) for end in touch.interval(0.95, of="force"))
    true = 1.83 * np.array([0.4 * np.cos(1.3), 0.4 * np.sin(1.3), 1.0])
    assert ((low < true) & (true < high)).all()
    assert float(touch.force[2]) == pytest.approx(1.83, rel=0.25)
    assert "outside array" in touch.summary()


@pytest.mark.parametrize(
    ("middle", "radius", "stuck", "direction", "peak"),
    [((-2e-3, 1e-3), 1.7e-3, 0.75, 1.0, 2e5), *long_runs(((6.5e-3, 4.5e-3), 1.7e-3, 0.8, 0.7, 1.5e5))],
)
@pytest.mark.long
def test_what_sticks_is_not_said_to_slip_where_pressure_is_not_told_from_shear(
    middle: tuple[float, float], radius: float, stuck: float, direction: float, peak: float
) -> None:
    """Pressure that is found wrong looks like shear: balls that stuck slipped "for sure"."""
    from palpate.grasp import GraspMonitor

    skin = pp.Skin(GEL, pp.ScatteredArray(positions=places(), depth=0.5e-3, channels=IN_PLANE))
    fine = pp.Skin(GEL, skin.planes[0], surface=pp.AreaGrid(shape=(88, 96), spacing=0.25e-3))
    r = np.hypot(fine.surface.axes[1][None, :] - middle[0], fine.surface.axes[0][:, None] - middle[1]) / radius
    p = peak * np.sqrt(np.clip(1.0 - r**2, 0.0, None))  # Cattaneo's and Mindlin's
    q = 0.4 * (p - peak * stuck * np.sqrt(np.clip(1.0 - (r / stuck) ** 2, 0.0, None)))
    true = np.stack([q * np.cos(direction), q * np.sin(direction), p])
    clean, rng = np.asarray(fine.sense(true)), np.random.default_rng(0)
    monitor, said = GraspMonitor(), []
    with skin.track(baseline=8, rate=30.0) as tracker:
        for part in [0.0] * 8 + [0.2, 0.4, 0.6, 0.8] + [1.0] * 12:
            said += monitor.update(tracker.step(part * clean + NOISE * rng.standard_normal(clean.shape)))
    assert [event.kind for event in said if event.kind == "slip"] == []
    assert any(event.kind == "contact" for event in said)
