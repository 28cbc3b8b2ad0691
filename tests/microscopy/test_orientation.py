"""Axes of a displacement field: a wrong sign of v, or u for v, spreads the traction of a cell over its gel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import palpate as pp
from long_runs import long_runs
from palpate.microscopy import Field, cell_forces
from palpate.microscopy.orientation import suspected

GEL = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.48)
NOISE = 4e-9
V = np.array([1.0, -1.0])[:, None, None]


def field_of_cell(elongation: float, angle: float, seed: int) -> Field:
    """Ten adhesions on an ellipse that pull towards its long axis and inwards, in balance of forces and moments."""
    array = pp.AreaArray(shape=(32, 40), pitch=1e-6, depth=0.0, channels=["displacement_x", "displacement_y"])
    skin = pp.Skin(GEL, array)
    rng = np.random.default_rng(seed)
    at = rng.uniform(0, 2 * np.pi, 10)
    place = 11e-6 * np.stack([np.cos(at), np.sin(at) / elongation])
    force = -place / np.hypot(*place) * rng.uniform(0.5, 1.0, 10)
    balance = np.zeros((3, 20))
    balance[0, :10] = balance[1, 10:] = 1.0
    balance[2] = 1e5 * np.concatenate([-place[1], place[0]])
    flat = force.ravel() - np.linalg.pinv(balance) @ (balance @ force.ravel())
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    place, force = turn @ place, turn @ flat.reshape(2, 10)
    x, y = np.meshgrid(skin.surface.x, skin.surface.y)
    traction = np.zeros((3, *x.shape))
    for (px, py), (fx, fy) in zip(place.T, force.T):
        patch = np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * 1.2e-6**2))
        traction[0] += 400.0 * fx * patch
        traction[1] += 400.0 * fy * patch
    u = np.asarray(skin.sense(traction)) + NOISE * rng.standard_normal((2, 32, 40))
    return Field(displacement=u, start=(4.5, 4.5), step=10.0, pixel=0.1e-6)


@pytest.mark.parametrize("elongation", [1.3, *long_runs(2.5), 5.0])
@pytest.mark.parametrize("angle", [0.0, 0.4, 0.79, 1.57])
def test_a_cell_of_any_elongation_tells_its_axes(elongation: float, angle: float) -> None:
    right = field_of_cell(elongation, angle, seed=int(10 * elongation + 100 * angle))
    u = right.displacement
    for meant, values in (
        ("", u),
        ("v's sign", u * V),
        *([("u for v", u[::-1])] if elongation < 3 else []),  # a slender one turns then, which is said
        ("u for v and a sign", np.stack([-u[1], u[0]])),
        ("", -u),  # what a cell does, backwards: said by its moment
    ):
        assert suspected(replace(right, displacement=values), GEL, depth=0.0, noise=NOISE) == meant
    # rows from the bottom up, with v as it is: the mirror image with v of the wrong sign
    assert suspected(replace(right, displacement=u[:, ::-1]), GEL, depth=0.0, noise=NOISE) == "v's sign"


@pytest.mark.long
def test_noise_alone_and_a_gel_that_does_not_widen_tell_no_sign() -> None:
    right = field_of_cell(2.5, 0.0, seed=3)
    cork = pp.HalfSpace(youngs_modulus=8e3, poissons_ratio=0.0)  # its surface moves along the force alone
    assert suspected(replace(right, displacement=right.displacement * V), cork, depth=0.0, noise=NOISE) == ""
    rng = np.random.default_rng(1)
    for _ in range(2):
        noise = replace(right, displacement=NOISE * rng.standard_normal(right.displacement.shape))
        assert not any("no cell" in n for n in cell_forces(noise, GEL, draws=8, drift=False).notes)


@pytest.mark.long
def test_an_elongated_cell_with_v_of_the_wrong_sign_is_questioned() -> None:
    """Its moment across is small, so that no opposed moments show: the traction's spread does."""
    right = field_of_cell(5.0, 0.0, seed=7)
    notes = [
        " ".join(cell_forces(replace(right, displacement=u), GEL, draws=8, drift=False).notes)
        for u in (right.displacement, right.displacement * V)
    ]
    assert "--v-up" in notes[1]
    assert "no cell" in notes[1]
    assert "no cell" not in notes[0]
