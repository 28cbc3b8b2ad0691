"""Matrix products and factors in pieces of a millisecond or two, so that background work can pause for a frame."""

from __future__ import annotations

import numpy as np

from palpate._threads import give_way
from palpate.elastic.pad import Floats

__all__ = ["lower_factor", "product", "square"]

#: Multiplications of one piece: a millisecond.
PIECE = 25_000_000
#: Smallest number of rows of a piece, below which overhead dominates; and rows of a block of a factor.
ROWS, BLOCK = 48, 128


def product(a: Floats, b: Floats) -> Floats:
    """The product a b."""
    rows = max(ROWS, PIECE // max(b.size, 1))
    if rows >= len(a):
        give_way()
        return np.asarray(a @ b)
    out = np.empty((len(a), b.shape[1]))
    for start in range(0, len(a), rows):
        give_way()
        np.matmul(a[start : start + rows], b, out=out[start : start + rows])
    return out


def square(a: Floats) -> Floats:
    """The product a a'."""
    rows = max(ROWS, PIECE // max(a.size, 1))
    if rows >= len(a):
        give_way()
        return np.asarray(a @ a.T)
    out = np.empty((len(a), len(a)))
    for start in range(0, len(a), rows):
        stop = min(start + rows, len(a))
        here = a[start:stop]
        out[start:stop, start:stop] = here @ here.T  # symmetric to the last digit
        if start:
            out[start:stop, :start] = across = product(here, a[:start].T)
            out[:start, start:stop] = across.T
    return out


def lower_factor(matrix: Floats) -> Floats:
    """Lower Cholesky factor, from the lower triangle; LinAlgError if the matrix is not positive."""
    import scipy.linalg.lapack as lapack

    out, size = np.array(matrix), len(matrix)
    for start in range(0, size, BLOCK):
        stop = min(start + BLOCK, size)
        give_way()
        out[start:stop, start:stop] = here = np.linalg.cholesky(out[start:stop, start:stop])
        out[start:stop, stop:] = 0.0
        if stop == size:
            break
        below = out[stop:, start:stop] = out[stop:, start:stop] @ lapack.dtrtri(here, lower=1)[0].T
        rows = max(BLOCK, PIECE // below.size)
        for first in range(stop, size, rows):
            last = min(first + rows, size)
            give_way()
            out[first:last, stop:last] -= below[first - stop : last - stop] @ below[: last - stop].T
    return out
