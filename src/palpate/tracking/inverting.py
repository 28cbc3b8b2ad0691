"""Invert a symmetric positive matrix without blocking other threads.

SciPy's LAPACK holds Python's interpreter lock until it finishes: inverting 1500 unknowns in a thread delayed the
frames of a stream by 0.1 s. NumPy's products and small Cholesky factors release it, so the inverse is composed of
these, recursively and in pieces. It takes up to 1.4 times as long.
"""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats
from palpate.tracking.pieces import lower_factor, product, square

__all__ = ["inverse"]

#: Triangles of at most this many rows are inverted by LAPACK, in less than a tenth of a millisecond.
SMALL = 96


def inverse(matrix: Floats) -> Floats | None:
    """Inverse of a symmetric positive matrix; None if it is not positive in double precision."""
    try:
        factor = lower_factor(matrix)
    except np.linalg.LinAlgError:
        return None
    triangle, out = np.zeros_like(factor), np.empty_like(factor)
    _invert(factor, triangle, 0, len(factor))
    _square(triangle, out, 0, len(factor))
    return out if np.isfinite(np.diagonal(out)).all() else None


def _invert(factor: Floats, out: Floats, start: int, stop: int) -> None:
    """L^-1 of a lower L, rows and columns from ``start`` to ``stop``: [[A, 0], [B, C]]^-1 = [[A^-1, 0], [-C^-1 B A^-1, C^-1]]."""
    import scipy.linalg.lapack as lapack

    if stop - start <= SMALL:
        out[start:stop, start:stop] = lapack.dtrtri(factor[start:stop, start:stop], lower=1)[0]
        return
    half = (start + stop) // 2
    _invert(factor, out, start, half)
    _invert(factor, out, half, stop)
    beside = product(out[half:stop, half:stop], factor[half:stop, start:half])
    out[half:stop, start:half] = product(-beside, out[start:half, start:half])


def _square(lower: Floats, out: Floats, start: int, stop: int) -> None:
    """T'T of a lower T: [[A, 0], [B, C]] gives [[A'A + B'B, B'C], [C'B, C'C]]."""
    if stop - start <= SMALL:
        triangle = lower[start:stop, start:stop]
        out[start:stop, start:stop] = triangle.T @ triangle
        return
    half = (start + stop) // 2
    _square(lower, out, start, half)
    _square(lower, out, half, stop)
    below = lower[half:stop, start:half]
    out[start:half, start:half] += square(below.T)
    across = product(below.T, lower[half:stop, half:stop])
    out[start:half, half:stop], out[half:stop, start:half] = across, across.T
