"""A'A of a box, made of three of its sides and of the taxels at both ends, is that of its cells; a region in it is picked from it."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.tracking.gram import Grams
from palpate.tracking.health import Index

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)


def array(shape: tuple[int, int], depth: float = 2e-3, **given: object) -> pp.AreaArray:
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    return pp.AreaArray(shape=shape, pitch=1e-3, depth=depth, channels=channels, noise=[5.0, 4.0, 7.0], **given)  # type: ignore[arg-type]


def grams(*planes: pp.AreaArray) -> Grams:
    return Grams(pp.Skin(PAD, list(planes)).track().estimator)


def disc(shape: tuple[int, ...], radius: int, y: int, x: int) -> Index:
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    return np.flatnonzero((rows - y) ** 2 + (columns - x) ** 2 <= radius**2)


@pytest.mark.parametrize("broken", [0, 3, 400])
@pytest.mark.parametrize("two", [False, True])
@pytest.mark.long
def test_a_box_is_made_of_its_sides(two: bool, broken: int) -> None:
    planes = [array((20, 24)), array((20, 24), 1e-3)] if two else [array((20, 24))]
    products = grams(*planes)
    estimator = products._estimator
    count, shape = len(estimator.readings.std), estimator.operator.surface.shape
    unused = np.zeros(count, dtype=bool)
    unused[np.random.default_rng(0).choice(count, broken, replace=False)] = True
    for radius, y, x in ((0, 3, 4), (4, 10, 10), (6, 11, 14), (5, 2, shape[1] - 3)):
        cells = disc(shape, radius, y, x)
        matrix = estimator.level(1).matrix(cells, estimator.readings.std, ~unused)
        expected = matrix.T @ matrix
        found = products.of(cells, unused)
        np.testing.assert_allclose(found, expected, atol=1e-12 * expected.max())
        np.testing.assert_array_equal(found, found.T)
        assert products.holds(cells)
        assert products.holds(cells[::2])
    assert products._columns is None
    assert len(products._boxes) == 2


def test_the_box_before_serves_what_is_asked_of_it() -> None:
    products = grams(array((20, 20)))
    shape = products._estimator.operator.surface.shape
    before, now = disc(shape, 4, 8, 8), disc(shape, 4, 8, 13)
    unused = np.zeros(1200, dtype=bool)
    products.of(before, unused)
    products.of(now, unused)
    assert products.holds(before)
    assert products.holds(now)
    assert not products.holds(np.union1d(before, now))


@pytest.mark.parametrize("case", ["few readings", "missing taxels", "far apart"])
@pytest.mark.long
def test_others_are_made_cell_by_cell(case: str) -> None:
    mask = np.ones((20, 20), dtype=bool)
    mask[3, 4] = False
    given = (
        array((8, 8)) if case == "few readings" else array((20, 20), mask=mask if case == "missing taxels" else None)
    )
    products = grams(given)
    estimator = products._estimator
    shape = estimator.operator.surface.shape
    cells = disc(shape, 3, 4, 4)
    if case == "far apart":
        cells = np.union1d(cells, disc(shape, 3, shape[0] - 4, shape[1] - 4))
    observed = np.ones(len(estimator.readings.std), dtype=bool)
    matrix = estimator.level(1).matrix(cells, estimator.readings.std, observed)
    expected = matrix.T @ matrix
    np.testing.assert_allclose(products.of(cells, ~observed), expected, atol=1e-12 * expected.max())
    assert products._boxes == ()
