"""Noise of displacements that windows measure: it differs from vector to vector, and overlapping windows share it.

The displacement of a window is a weighted mean over its beads. Where the gel is stretched within the window, the
result depends on which beads happen to lie there, so that the standard deviation is many times larger at an adhesion
than beside it. Two windows of side w whose middles are dx and dy apart have the fraction

    c = (1 - |dx|/w) (1 - |dy|/w)

of their beads in common, and c is the correlation of their errors. A small fraction of the variance (interpolation,
pixels) is independent for each vector.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate.elastic.pad import Floats

__all__ = ["Noise", "Whitener", "shared_variance", "whitener"]

#: Fraction of the variance that a vector shares with no other window. In rendered pictures neighbours at half a window
#: correlate by 0.44 to 0.5 (formula: 0.5), and by 0.73 at a quarter (0.75). A fraction of 0.1 keeps the model from
#: trusting the finest differences between overlapping windows.
INDEPENDENT_SHARE = 0.1
#: The error of a vector is conditioned on this many of the vectors before it (A. V. Vecchia, J. R. Stat. Soc. B 50,
#: 1988, 297-312).
BEFORE = 40
#: Covariance matrices of more vectors than this are stored sparse.
DENSE = 3000
#: Smallest standard deviation of a vector relative to the typical one, because standard deviations that derive from
#: residuals are themselves uncertain.
MIN_RELATIVE_STD = 0.3

Flags = npt.NDArray[np.bool_]


class Noise:
    """Standard deviation of each vector relative to the typical one, ``relative`` (row, column), and the ``side`` [m]
    of the windows that share noise; 0 if noise is independent.
    """

    def __init__(self, relative: Floats, side: float) -> None:
        self.relative, self.side = relative, side

    @classmethod
    def even(cls, shape: tuple[int, int]) -> Noise:
        """Return noise that is equal for all vectors and independent."""
        return cls(np.ones(shape), 0.0)

    @classmethod
    def of(cls, std: Floats, side: float) -> tuple[Noise, float]:
        """Noise of standard deviations ``std`` (2, row, column) [m], and the typical one by which they are divided."""
        each = np.sqrt((std**2).mean(axis=0))
        typical = float(np.nanmedian(each))
        filled = np.where(np.isfinite(each), each, typical)
        return cls(np.maximum(filled / typical, MIN_RELATIVE_STD), side), typical

    @property
    def plain(self) -> bool:
        """Whether all vectors have equal and independent noise."""
        return self.side == 0 and bool((self.relative == 1.0).all())


def shared_variance(dx: Floats, dy: Floats, side: float) -> Floats:
    """Return the correlation of the errors of windows that are (dx, dy) [m] apart."""
    if side <= 0:
        return np.asarray(((dx == 0) & (dy == 0)) * 1.0)
    return np.asarray(np.clip(1.0 - np.abs(dx) / side, 0.0, None) * np.clip(1.0 - np.abs(dy) / side, 0.0, None))


class Whitener:
    """Sparse W with W K W^T = 1, K the covariance of vectors and means of vectors; ``@`` acts on the last axis."""

    def __init__(self, matrix: scipy.sparse.csr_array) -> None:
        self._matrix = matrix

    def __call__(self, values: Floats) -> Floats:
        """Apply W to values (..., n)."""
        flat = values.reshape(-1, values.shape[-1])
        return np.ascontiguousarray((self._matrix @ flat.T).T).reshape(values.shape)


def whitener(noise: Noise, pitch: float, members: list[npt.NDArray[np.intp]], places: Floats) -> Whitener:
    """Whitener of means over ``members`` (flat vectors of each) at ``places`` (n, 2) [m], in typical noise."""
    rows, columns = noise.relative.shape
    count = rows * columns
    s = noise.relative.ravel()
    # covariance of vectors whose windows overlap
    reach = 0 if noise.side <= 0 else math.ceil(noise.side / pitch) - 1
    number = np.arange(count).reshape(rows, columns)
    parts = []
    for dr in range(-reach, reach + 1):
        for dc in range(-reach, reach + 1):
            shared = float(shared_variance(np.array(dc * pitch), np.array(dr * pitch), noise.side))
            value = 1.0 if dr == dc == 0 else (1.0 - INDEPENDENT_SHARE) * shared
            first = number[max(0, -dr) : rows - max(0, dr), max(0, -dc) : columns - max(0, dc)].ravel()
            second = first + dr * columns + dc
            parts.append((first, second, value * s[first] * s[second]))
    i, j, v = (np.concatenate(p) for p in zip(*parts))
    covariance = scipy.sparse.csr_array((v, (i, j)), shape=(count, count))
    sizes = np.array([len(m) for m in members])
    means = scipy.sparse.csr_array(
        (np.repeat(1.0 / sizes, sizes), (np.repeat(np.arange(len(members)), sizes), np.concatenate(members))),
        shape=(len(members), count),
    )
    of_means = scipy.sparse.csr_array(means @ covariance @ means.T)
    order = np.lexsort((places[:, 0], places[:, 1]))
    ordered = of_means[order][:, order]
    dense = ordered.toarray() if len(order) <= DENSE else None

    def among(rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> Floats:
        if dense is not None:
            return np.asarray(dense[np.ix_(rows, columns)])
        return np.asarray(ordered[np.repeat(rows, len(columns)), np.tile(columns, len(rows))]).reshape(
            len(rows), len(columns)
        )

    at = places[order]
    out_i, out_j, out_v = [], [], []
    for k in range(len(order)):
        near = np.arange(k)
        if k > BEFORE:
            # vectors whose windows do not overlap are still dependent, through the vectors between them
            far = np.abs(at[:k] - at[k]).max(axis=1)
            near = np.argpartition(far, BEFORE)[:BEFORE]
        block = among(np.append(near, k), np.append(near, k))
        weights = np.linalg.solve(block[:-1, :-1], block[:-1, -1])
        scale = 1.0 / math.sqrt(float(block[-1, -1] - weights @ block[:-1, -1]))
        out_i += [order[k]] * (len(near) + 1)
        out_j += [*order[near], order[k]]
        out_v += [*(-scale * weights), scale]
    return Whitener(scipy.sparse.csr_array((out_v, (out_i, out_j)), shape=(len(members), len(members))))
