"""Influences of cells that the rounds of a frame share: whatever was asked for before, they are those of the cells alone."""

import numpy as np
import pytest

import palpate as pp
from palpate.inverse.constrained.factors import Beside, Dense, cholesky
from palpate.inverse.constrained.model import Columns, Level
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.operator import Operator

CHANNELS = ["stress_xz", "stress_zz"]


def level(correlation: float = 0.0) -> Level:
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    mask = np.ones((5, 6), dtype=bool)
    mask[2, 3] = False
    array = pp.AreaArray(
        shape=(5, 6),
        pitch=2e-3,
        depth=1e-3,
        channels=CHANNELS,
        mask=mask,
        noise=[2.0, 3.0],
        noise_correlation=correlation,
    )
    operator = Operator(pad, [array], pp.AreaGrid(shape=(14, 16), spacing=1e-3))
    return Level(operator, 1, (0, 2), Readings(operator, [np.array([2.0, 3.0])]))


@pytest.mark.parametrize("correlation", [0.0, 4e-3])
def test_rounds_of_a_frame_have_the_columns_of_their_cells(correlation: float) -> None:
    """Cells are added and left out, readings are left out and come back, the noise changes."""
    here, rng = level(correlation), np.random.default_rng(0)
    n = len(here.readings.std)
    y, kept = rng.standard_normal(n), {}
    for turn, count in enumerate((30, 50, 40, 120, 25)):
        cells = np.sort(rng.choice(14 * 16, count, replace=False))
        noise = here.readings.std * (1.0 + turn)
        observed = np.ones(n, dtype=bool)
        observed[rng.choice(n, turn, replace=False)] = False
        shared, alone = (here.normal(cells, y, noise, observed, k) for k in (kept, None))
        assert len(kept) == 1
        dense = (
            here.operator.dense().reshape(-1, 3, 14 * 16)[:, [0, 2]][:, :, cells][observed].reshape(observed.sum(), -1)
        )
        plain = here.readings.white(dense / noise[observed, None], observed)
        np.testing.assert_allclose(alone.matrix, plain, rtol=1e-12, atol=1e-14 * np.abs(plain).max())
        for name in ("linear", "gram", "matrix"):
            mine, other = getattr(shared, name), getattr(alone, name)
            np.testing.assert_allclose(mine, other, rtol=1e-10, atol=1e-12 * np.abs(other).max())
        some = np.arange(0, count, 3)
        np.testing.assert_allclose(
            shared.part(some).gram, alone.part(some).matrix.T @ alone.part(some).matrix, rtol=1e-8
        )


def test_few_readings_left_out_make_no_new_columns() -> None:
    here, n = level(), 2 * 29
    noise, cells = here.readings.std, np.arange(40)
    columns = Columns(here, cells, noise, np.ones(n, dtype=bool))
    some = np.ones(n, dtype=bool)
    some[[3, 20]] = False
    assert list(columns.lost(some)) == [3, 20]
    assert columns.lost(np.arange(n) < n // 2) is None  # too many
    assert Columns(here, cells, noise, some).lost(np.ones(n, dtype=bool)) is None  # one more than there are


def test_shear_that_nothing_holds_is_eliminated_once() -> None:
    """Solutions beside it are those of the whole factor."""
    rng = np.random.default_rng(1)
    matrix = rng.standard_normal((60, 20))
    h = matrix.T @ matrix
    first = cholesky(h[:12, :12])
    tied = np.linalg.solve(first, h[:12, 12:])
    some = np.array([0, 3, 4, 6])
    left = (h[12:, 12:] - tied.T @ tied)[np.ix_(some, some)]
    picks = np.append(np.arange(12), 12 + some)
    whole = Dense(cholesky(h[np.ix_(picks, picks)]))
    beside = Beside(first, tied, some, cholesky(left))
    right = rng.standard_normal(16)
    np.testing.assert_allclose(beside.lower, whole.lower, atol=1e-12)
    np.testing.assert_allclose(beside.solve(right), whole.solve(right), rtol=1e-9)
