"""What makes the iteration short: an approximation of M on its lattice, balanced with the longest waves, which it misses most."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.lattice import Approximation, Cosines, Inverse, Padded
from palpate.inverse.linear.matrix_free.memory import LONGEST
from palpate.inverse.linear.matrix_free.normal import Normal
from palpate.inverse.linear.matrix_free.transforms import Cosine

__all__ = ["Balanced", "approximation", "longest_cosines"]

#: Combinations of cosines that working taxels hardly tell apart are one.
APART = 1e-8


def approximation(normal: Normal) -> Approximation:
    """The one that serves these channels: displacement reaches as far as the array, and the rest go together across parities."""
    channels = [c for a in normal.operator.planes_of for c in a.channels]
    return Cosines(normal) if all(find_channel(c).kind.absolute for c in channels) else Padded(normal)


def longest_cosines(normal: Normal) -> Floats:
    """The longest cosines (wave, n) of each channel of regular arrays."""
    units = []
    for plane, shape in enumerate(normal.shapes):
        few = LONGEST[len(shape) - 1]
        tables = [Cosine(n).table[:few] for n in shape[1:]]
        for channel, *waves in itertools.product(range(shape[0]), *tables):
            rows = [np.zeros((1, *s)) for s in normal.shapes]
            rows[plane][0, channel] = waves[0] if len(waves) == 1 else np.multiply.outer(*waves)
            units.append(normal.joined(rows)[0])
    return np.stack(units)


class Balanced:
    """An approximation ``smooth`` of (M + lambda)^{-1}, for parameters, and a few waves Z on which M is exact (J. Mandel, Commun. Numer. Methods
    Eng. 9, 1993, 233-241)."""

    def __init__(
        self, product: Callable[[Floats], Floats], longest: Floats, smooth: Callable[[Floats], Inverse]
    ) -> None:
        self._smooth = smooth
        # single precision is enough for what only makes the iteration shorter
        self._longest = longest.astype(np.float32)
        self._moved = product(self._longest)
        own, inner = (self._longest @ rows.T for rows in (self._longest, self._moved))
        size, vectors = np.linalg.eigh(own.astype(np.float64))
        kept = size > APART * size.max()
        basis = vectors[:, kept] / np.sqrt(size[kept])
        values, modes = np.linalg.eigh(basis.T @ (0.5 * (inner + inner.T)).astype(np.float64) @ basis)
        self._values, self._vectors = np.maximum(values, 0.0), basis @ modes
        #: About the largest eigenvalue of M, from below.
        self.largest = float(self._values[-1])

    @property
    def nbytes(self) -> int:
        """Memory that it holds."""
        return self._longest.nbytes + self._moved.nbytes

    def at(self, parameter: Floats) -> Inverse:
        """(M + lambda)^{-1} about, for the parameter of each frame: a function of rows and of which frames they belong to."""
        z, moved, vectors = self._longest, self._moved, self._vectors
        smooth = self._smooth(parameter)

        def inverse(rows: Floats, which: Any) -> Floats:
            lam, kind = parameter[which], rows.dtype
            weights = 1.0 / (self._values[:, None] + lam)  # (mode, frame)
            first = (vectors @ (weights * (vectors.T @ (z @ rows.T)))).T
            out = smooth(
                rows - first.astype(kind) @ moved - (lam[:, None] * first).astype(kind) @ z,
                which,
            )
            against = moved @ out.T + lam * (z @ out.T)
            second = (vectors @ (weights * (vectors.T @ against))).T
            out += (first - second).astype(kind) @ z
            return out

        return inverse
