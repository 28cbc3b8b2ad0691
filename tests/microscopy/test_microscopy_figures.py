"""Figures of a cell: arrows where traction is sure, the largest with its interval, and what was assumed."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure
from matplotlib.quiver import Quiver

import palpate as pp
from palpate.microscopy import CellForces, Field, cell_forces

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)


def forces_of(pull: float) -> CellForces:
    """Two patches that pull at each other, in noise of 0.02 px."""
    u = 0.02 * np.random.default_rng(0).standard_normal((2, 20, 24))
    u[0, 8:12, 5:8] += pull
    u[0, 8:12, 16:19] -= pull
    field = Field(displacement=1e-7 * u, start=(7.5, 7.5), step=16.0, pixel=1e-7, aperture=1.6e-6)
    return cell_forces(field, GEL, method="tikhonov", draws=24)


def arrows(figure: Figure) -> np.ndarray:
    """Places (n, 2) of the arrows of traction; another quiver holds the one that says how long they are."""
    found = [q for axes in figure.axes for q in axes.get_children() if isinstance(q, Quiver)]
    return np.asarray(found[0].XY) if len(found) == 2 else np.zeros((0, 2))


def words(figure: Figure) -> str:
    return " ".join(t.get_text() for t in figure.findobj(lambda a: hasattr(a, "get_text")))


def test_arrows_stand_where_traction_differs_from_zero_alone() -> None:
    forces = forces_of(2.0)
    places = arrows(forces.plot())
    assert len(places) > 4
    size = np.hypot(*forces.traction)
    along = np.hypot(*forces.std)
    for x, y in places:
        row, column = round((y - 7.5) / 16), round((x - 7.5) / 16)
        assert size[row, column] > 1.3 * along[row, column] / np.sqrt(2.0)
    assert np.abs(places[:, 1] - (7.5 + 16 * 9.5)).max() < 16 * 6  # near the patches


@pytest.mark.long
def test_noise_alone_has_hardly_an_arrow() -> None:
    assert len(arrows(forces_of(0.0).plot())) <= 0.05 * 20 * 24


@pytest.mark.long
def test_the_figure_says_the_largest_traction_with_its_interval_and_what_was_assumed() -> None:
    forces = forces_of(2.0)
    said = words(forces.plot())
    low, high = forces["traction_peak"].interval
    factor = 1e-3 if high > 1e3 else 1.0
    assert "largest" in said
    assert f"95 %: {low * factor:.3g}" in said
    for part in ("gel 8 kPa", "Poisson's ratio 0.48", "pixel", "windows of 1.6"):
        assert part in said, part
