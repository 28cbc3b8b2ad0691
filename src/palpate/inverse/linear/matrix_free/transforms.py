"""Cosine transforms, by matrix products if these are faster."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.elastic.pad import Floats

__all__ = ["Cosine", "along"]

#: Largest number of entries along an axis for which a matrix product is faster than an FFT.
MATRIX = 512


class Cosine:
    """The orthonormal DCT-II of one axis of ``n`` entries."""

    def __init__(self, n: int) -> None:
        self.n = n
        self._table: Floats | None = self.table if n <= MATRIX else None
        self._single = None if self._table is None else self._table.astype(np.float32)

    @property
    def table(self) -> Floats:
        """The matrix (wave, entry)."""
        return self.longest(self.n, self.n)

    @staticmethod
    def longest(n: int, count: int) -> Floats:
        """The first ``count`` rows of the matrix, or all of them."""
        j = np.arange(min(count, n))[:, None]
        size = np.sqrt(np.where(j == 0, 1.0, 2.0) / n)
        return np.asarray(size * np.cos(np.pi * j * (np.arange(n) + 0.5) / n))

    def apply(self, x: Floats, axis: int, *, inverse: bool) -> Floats:
        """Transform along ``axis``, -1 or -2."""
        if self._table is None or self._single is None:
            import scipy.fft

            function = scipy.fft.idct if inverse else scipy.fft.dct
            return np.asarray(function(x, axis=axis, norm="ortho"))
        table = self._table if x.dtype == np.float64 else self._single
        if axis == -1:
            return np.asarray(x @ (table if inverse else table.T))
        return np.asarray((table.T if inverse else table) @ x)


def along(x: Floats, axes: Sequence[Cosine], *, inverse: bool) -> Floats:
    """The transform over the last axes, or its inverse."""
    for i, axis in enumerate(reversed(axes)):
        x = axis.apply(x, -1 - i, inverse=inverse)
    return x
