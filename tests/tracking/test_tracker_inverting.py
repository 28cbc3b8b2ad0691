"""The inverse of a region's normal matrix: the same by either road, and one of them lets other threads run."""

import threading
import time

import numpy as np
import pytest
import scipy.linalg.lapack as lapack

from palpate.elastic.pad import Floats
from palpate.tracking.inverting import SMALL, inverse


def positive(size: int) -> Floats:
    factor = np.random.default_rng(size).standard_normal((size, size))
    return np.asarray(factor @ factor.T + 1e-3 * size * np.eye(size))


@pytest.mark.parametrize("size", [1, 7, SMALL, SMALL + 1, 331])
def test_an_inverse_made_by_halves_is_the_inverse_that_lapack_makes(size: int) -> None:
    matrix = positive(size)
    beside, direct = inverse(matrix), np.linalg.inv(matrix)
    assert beside is not None
    assert direct is not None
    np.testing.assert_allclose(beside, direct, atol=1e-9 * np.abs(direct).max())
    np.testing.assert_array_equal(beside, beside.T)
    np.testing.assert_allclose(beside @ matrix, np.eye(size), atol=1e-8)


def test_a_matrix_that_is_not_positive_has_no_inverse() -> None:
    matrix = positive(200)
    matrix[150, 150] = -1.0
    assert inverse(matrix) is None


def by_lapack(matrix: Floats) -> Floats:
    """The inverse by SciPy's LAPACK, which holds the interpreter's lock."""
    return np.asarray(lapack.dpotri(lapack.dpotrf(matrix, lower=True)[0], lower=True)[0])


def longest_wait(made) -> float:  # type: ignore[no-untyped-def]
    """The longest time in which another thread does not come to run, as a part of the whole."""
    matrix, done = positive(1600), threading.Event()

    def work() -> None:
        made(matrix)
        done.set()

    begun = last = time.perf_counter()
    longest = 0.0
    threading.Thread(target=work).start()
    while not done.is_set():
        time.sleep(0)
        now = time.perf_counter()
        longest, last = max(longest, now - last), now
    return longest / (last - begun)


@pytest.mark.long
def test_the_inverse_beside_a_stream_lets_the_stream_run() -> None:
    # the best of some: the machine may be busy with other things
    assert min(longest_wait(inverse) for _ in range(5)) < 0.5 * min(longest_wait(by_lapack) for _ in range(5))
