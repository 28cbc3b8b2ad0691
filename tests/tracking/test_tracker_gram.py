"""Parts of the normal matrix that are kept while a contact moves are those that would be made anew."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.tracking.gram import Grams
from palpate.tracking.region import NormalEquations

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)


def made(correlation: float = 0.0) -> NormalEquations:
    array = pp.AreaArray(
        shape=(8, 8),
        pitch=1e-3,
        depth=2e-3,
        channels=["stress_xz", "stress_yz", "stress_zz"],
        noise=5.0,
        noise_correlation=correlation,
    )
    estimator = pp.Skin(PAD, array).track().estimator
    return NormalEquations(estimator, np.zeros((192, 3)))


@pytest.mark.parametrize("broken", [0, 3, 60])
def test_a_contact_that_moves_has_the_products_of_its_cells(broken: int) -> None:
    equations = made()
    grams, level = Grams(equations.estimator), equations.estimator.level(1)
    count = int(np.prod(level.grid.shape))
    rng = np.random.default_rng(0)
    unused = np.zeros(192, dtype=bool)
    unused[rng.choice(192, broken, replace=False)] = True
    for start in (0, 5, 12, 3, count - 30, 10):
        cells = np.sort(start + rng.choice(30, 20, replace=False))
        matrix = level.matrix(cells, equations.estimator.readings.std, ~unused)
        expected = matrix.T @ matrix
        np.testing.assert_allclose(grams.of(cells, unused), expected, atol=1e-10 * expected.max())
        assert grams.holds(cells)
    kept = grams._columns
    assert kept is not None
    assert kept.count <= 60


def test_what_is_asked_for_may_be_changed() -> None:
    equations = made()
    grams, cells, unused = Grams(equations.estimator), np.arange(20), np.zeros(192, dtype=bool)
    first = grams.of(cells, unused)
    again = first.copy()
    first *= 0.0
    np.testing.assert_array_equal(grams.of(cells, unused), again)


def test_noise_that_is_shared_is_whitened_over_the_readings_that_are_used() -> None:
    equations = made(correlation=1e-3)
    level, unused = equations.estimator.level(1), np.zeros(192, dtype=bool)
    unused[[7, 90]] = True
    for cells in (np.arange(10, 30), np.arange(12, 20), np.arange(40, 55)):
        matrix = level.matrix(cells, equations.estimator.readings.std, ~unused)
        expected = matrix.T @ matrix
        np.testing.assert_allclose(equations.gram(cells, unused), expected, atol=1e-10 * expected.max())
