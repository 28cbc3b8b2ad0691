"""Contact that slides is weighed over readings where these are fewer than unknowns: the same evidence as over unknowns."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.constrained import cone
from palpate.inverse.constrained.cone import FEWER_STEPS, Cone, minimise
from palpate.inverse.constrained.differences import Differences
from palpate.inverse.constrained.model import Level, Normal
from palpate.inverse.constrained.quadratic import Formed, Penalty, Unformed
from palpate.inverse.contact.sliding import log_evidence


def _normal(readings: int, cells: int = 300) -> tuple[Normal, Penalty]:
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48),
        pp.AreaArray(shape=(20, 20), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_zz"]),
    )
    grid = skin.surface
    rng = np.random.default_rng(3)
    matrix = rng.standard_normal((readings, 2 * cells))
    y = rng.standard_normal(readings)
    level = Level.__new__(Level)
    level.grid = grid
    data = Normal(level, np.arange(cells), matrix, (y @ matrix).reshape(2, -1))
    return data, Penalty(data.cells, Differences(grid).even(1, [2.0, 5.0]), grid.shape)


@pytest.mark.parametrize("readings", [12, 700])
def test_the_evidence_of_a_gaussian_model_is_that_of_its_determinants(readings: int) -> None:
    data, penalty = _normal(readings)
    # few readings are left as they are, many are formed
    assert isinstance(data.quadratic(penalty), Unformed if readings == 12 else Formed)
    prior, linear = penalty.dense(), data.linear.ravel()
    whole = data.matrix.T @ data.matrix + prior
    expected = 0.5 * linear @ np.linalg.solve(whole, linear)
    expected -= 0.5 * (np.linalg.slogdet(whole)[1] - np.linalg.slogdet(prior)[1])
    assert log_evidence(data, penalty) == pytest.approx(expected, rel=1e-9)


def test_what_one_vector_times_a_pressure_explains_is_the_same_with_a_normal_matrix_and_without() -> None:
    data, _ = _normal(12)
    pressure = np.random.default_rng(0).random(300)
    without = data.explained(pressure)
    assert data.gram.shape == (600, 600)  # formed from now on
    assert data.formed
    np.testing.assert_allclose(data.explained(pressure), without, rtol=1e-10)


def test_a_problem_that_is_known_by_products_is_given_up_sooner_and_says_so() -> None:
    class ByProducts(Formed):
        by_products = True

    rng = np.random.default_rng(0)
    part = rng.standard_normal((40, 30))
    linear = rng.standard_normal((1, 40))
    # no step is small enough for a tolerance of nothing, and from inside nothing is found
    with mock.patch.object(cone, "interior", lambda hessian, linear, cone, start, tolerance: (start, False)):
        found = minimise(ByProducts(part @ part.T + 1e-9 * np.eye(40)), linear, Cone(("z",)), tolerance=-1.0)
    assert not found.converged
    assert found.steps <= FEWER_STEPS


def test_blocks_of_cells_of_which_only_the_normal_matrix_is_known_are_weighed_by_it() -> None:
    data, penalty = _normal(700)
    only = Normal(data.level, data.cells, np.zeros((0, 600)), data.linear, data.gram)
    assert log_evidence(only, penalty) == pytest.approx(log_evidence(data, penalty), rel=1e-12)
