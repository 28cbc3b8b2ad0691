"""Preconditioner: an approximation of M on its lattice, combined with an exact treatment of the longest waves, where
its error is largest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.lattice import Approximation, Cosines, Inverse, Padded
from palpate.inverse.linear.matrix_free.memory import LONGEST
from palpate.inverse.linear.matrix_free.normal import Normal
from palpate.inverse.linear.matrix_free.transforms import Cosine

__all__ = ["Balanced", "BalancedInverse", "LongestCosines", "LongestSines", "approximation"]

#: Combinations of cosines whose separation by working taxels is below this count as one.
MIN_SEPARATION = 1e-8


def approximation(normal: Normal) -> Approximation:
    """The approximation that suits these channels: `Cosines` for displacement, whose influence extends across the
    array; otherwise `Padded`.
    """
    channels = [c for a in normal.operator.planes_of for c in a.channels]
    return Cosines(normal) if all(find_channel(c).kind.absolute for c in channels) else Padded(normal)


class LongestCosines:
    """The longest cosines Z of each channel of regular arrays; missing taxels are zero in them.

    They are applied as sums over axes: a matrix of them would be read from memory at every step.
    """

    def __init__(self, normal: Normal) -> None:
        self.normal = normal
        self._tables: list[dict[Any, list[Any]]] = []
        for _, *shape in normal.shapes:
            waves = [Cosine.longest(n, LONGEST[len(shape)]) for n in shape]
            self._tables.append({np.dtype(kind): [w.astype(kind) for w in waves] for kind in (np.float32, np.float64)})
        self._counts = [
            shape[0] * math.prod(len(w) for w in tables[np.dtype(np.float64)])
            for shape, tables in zip(normal.shapes, self._tables)
        ]
        self.count = sum(self._counts)

    def of(self, rows: Any) -> Any:
        """Z v (frame, wave) of rows v (frame, n)."""
        parts = []
        planes: list[Any] = self.normal.planes(rows)
        for plane, tables in zip(planes, self._tables):
            first, *second = tables[rows.dtype]
            part = first @ (plane @ second[0].T) if second else plane @ first.T
            parts.append(part.reshape(len(rows), -1))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def rows(self, weights: Any) -> Any:
        """Z^T c (frame, n) of weights c (frame, wave)."""
        parts, start = [], 0
        for shape, count, tables in zip(self.normal.shapes, self._counts, self._tables):
            first, *second = tables[weights.dtype]
            part = weights[:, start : start + count].reshape(len(weights), shape[0], len(first), -1)
            parts.append((first.T @ part) @ second[0] if second else part[..., 0] @ first)
            start += count
        return self.normal.joined(parts)


class LongestSines:
    """As `LongestCosines`, for the sines at the entries ``index`` of rows of ``size`` coefficients."""

    def __init__(self, index: Sequence[Any], size: int) -> None:
        self._index, self._size, self.count = np.array(index, dtype=np.intp), size, len(index)

    def of(self, rows: Any) -> Any:
        """Z v."""
        return rows[:, self._index]

    def rows(self, weights: Any) -> Any:
        """Z^T c."""
        out = np.zeros((len(weights), self._size), dtype=weights.dtype)
        out[:, self._index] = weights
        return out


class Balanced:
    """An approximation ``smooth`` of (M + lambda)^{-1}, made exact on a few waves Z (J. Mandel, Commun. Numer. Methods
    Eng. 9, 1993, 233-241).
    """

    def __init__(
        self,
        product: Callable[[Floats], Floats],
        longest: LongestCosines | LongestSines,
        smooth: Callable[[Floats], Inverse],
    ) -> None:
        self._smooth, self.longest = smooth, longest
        # single precision suffices for a preconditioner
        rows = longest.rows(np.eye(longest.count, dtype=np.float32))
        self.moved = product(rows)
        own, inner = longest.of(rows), longest.of(self.moved)
        size, vectors = np.linalg.eigh(own.astype(np.float64))
        kept = size > MIN_SEPARATION * size.max()
        basis = vectors[:, kept] / np.sqrt(size[kept])
        values, modes = np.linalg.eigh(basis.T @ (0.5 * (inner + inner.T)).astype(np.float64) @ basis)
        self.values, self.vectors = np.maximum(values, 0.0), basis @ modes
        #: Lower estimate of the largest eigenvalue of M.
        self.largest = float(self.values[-1])

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        return int(self.moved.nbytes)

    def at(self, parameter: Floats) -> BalancedInverse:
        """Approximate (M + lambda)^{-1} for the parameter of each frame."""
        return BalancedInverse(self, parameter, self._smooth(parameter))


class BalancedInverse:
    """The approximate inverse `Balanced` at the ``parameter`` lambda of each frame. Call it with ``rows`` v (row, n)
    and ``which``, the index of the frame of each row.

    With A = M + lambda, the smooth approximation S and Q = Z (Z^T A Z)^{-1} Z^T, it is Q + (1 - Q A) S (1 - A Q),
    which is symmetric. If conjugate gradients start from `begin`, their residuals v keep Z^T v = 0. For those,
    (1 - Q A) S + Q gives the same with a third of the work; `within` applies it (J. Tang, R. Nabben, C. Vuik, Y.
    Erlangga, J. Sci. Comput. 39, 2009, 340-370: "A-DEF2").
    """

    def __init__(self, of: Balanced, parameter: Floats, smooth: Inverse) -> None:
        self._of, self._parameter, self._smooth = of, parameter, smooth

    def __call__(self, rows: Any, which: Any) -> Any:
        """Apply the inverse to any rows."""
        solution, left = self.begin(rows, which)
        out = self._smooth(left, which)
        out -= self._long(self._inner(out, which), which, rows.dtype)
        out += solution
        return out

    def begin(self, rows: Any, which: Any) -> tuple[Any, Any]:
        """Q v, and v - A Q v, for which Z^T is zero."""
        lam, kind = self._parameter[which], rows.dtype
        weights = self._weights(self._of.longest.of(rows), which)
        solution = self._of.longest.rows(weights.astype(kind))
        left = rows - weights.astype(kind) @ self._of.moved
        left -= lam[:, None].astype(kind) * solution
        return solution, left

    def within(self, rows: Any, which: Any) -> Any:
        """Apply the inverse to rows for which Z^T is zero, except for rounding."""
        out = self._smooth(rows, which)
        out -= self._long(self._inner(out, which) - self._of.longest.of(rows), which, rows.dtype)
        return out

    def _inner(self, rows: Any, which: Any) -> Any:
        """Z^T A v."""
        return (self._of.moved @ rows.T).T + self._parameter[which, None] * self._of.longest.of(rows)

    def _long(self, inner: Any, which: Any, kind: Any) -> Any:
        """Z (Z^T A Z)^{-1} c."""
        return self._of.longest.rows(self._weights(inner, which).astype(kind))

    def _weights(self, inner: Any, which: Any) -> Any:
        """(Z^T A Z)^{-1} c, in double precision."""
        vectors = self._of.vectors
        gain = 1.0 / (self._of.values + self._parameter[which, None])  # (frame, mode)
        return ((inner @ vectors) * gain) @ vectors.T
