"""Cells of the surface above markers in a gel."""

from __future__ import annotations

import pytest

import palpate as pp
from palpate.sensing import default_surface

SIDEWAYS = ["displacement_x", "displacement_y"]


def test_shallow_markers_that_move_sideways_in_a_gel_have_two_cells_a_pitch() -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=0.2e-3, channels=SIDEWAYS)
    assert default_surface([array], thickness=1.4e-3).spacing == pytest.approx((0.5e-3, 0.5e-3))
    assert default_surface([array]).spacing == pytest.approx((0.25e-3, 0.25e-3))  # without a base


def test_shallow_markers_of_three_displacements_have_four() -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=0.2e-3, channels=[*SIDEWAYS, "displacement_z"])
    assert default_surface([array], thickness=1.4e-3).spacing == pytest.approx((0.25e-3, 0.25e-3))


def test_shallow_taxels_of_stress_have_four() -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=0.2e-3, channels=["stress_zz"])
    assert default_surface([array], thickness=1.4e-3).spacing == pytest.approx((0.25e-3, 0.25e-3))
