"""Which components are sought where the channels cannot tell all of them apart."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp

PAD = pp.HalfSpace(youngs_modulus=200e3, poissons_ratio=0.48)


@pytest.mark.parametrize(
    ("channels", "sought"),
    [
        (["stress_zz", "stress_xz"], ("x", "z")),
        (["stress_yz", "stress_zz"], ("y", "z")),
        (["displacement_x", "displacement_z"], ("x", "z")),
        (["stress_zz", "stress_xx"], ("z",)),
        (["displacement_x", "displacement_y"], ("x", "y")),
        (["strain_xx", "strain_yy", "strain_xy"], ("x", "y")),
        (["displacement_x", "displacement_y", "rotation_z"], ("x", "y")),
        (["displacement_x"], ("x",)),
        (["stress_xz", "stress_yz"], ("x", "y")),
        (["stress_xz", "stress_yz", "stress_zz"], ("x", "y", "z")),
    ],
)
def test_pressure_is_sought_where_it_is_measured(channels: list[str], sought: tuple[str, ...]) -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=channels)
    assert pp.Skin(PAD, array).components == sought


@pytest.mark.parametrize("shear", ["stress_xz", "stress_yz"])
@pytest.mark.long
def test_a_ball_that_presses_reads_its_force_without_the_second_shear(shear: str) -> None:
    """It read 0 N: both shears were sought, and pressure was taken as zero."""
    array = pp.AreaArray(shape=(10, 10), pitch=2e-3, depth=2e-3, channels=["stress_zz", shear], noise=5.0)
    skin = pp.Skin(PAD, array)
    ball = pp.solutions.hertz_point(contact_radius=4e-3, force=1.0)
    readings = skin.sense(ball, rng=np.random.default_rng(0))
    assert float(skin.reconstruct(readings, method="tikhonov").force[-1]) == pytest.approx(1.0, rel=0.1)
    with skin.track() as tracker:
        assert float(tracker.step(readings, 0.0).force[-1]) == pytest.approx(1.0, rel=0.1)
