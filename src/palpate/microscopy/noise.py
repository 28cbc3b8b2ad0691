"""Noise of displacements that windows make: it differs from vector to vector, and windows that overlap share it.

A window's displacement is a weighted mean over its beads. Where the gel is stretched within the window, which beads happen to lie there decides, so that the standard deviation
is many times larger at an adhesion than beside it. Two windows of side w whose middles are dx and dy apart share the part

    c = (1 - |dx|/w) (1 - |dy|/w)

of their beads, and that is the correlation of their errors; a small part of the variance (interpolation, pixels) is each vector's own.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate.elastic.pad import Floats

__all__ = ["Noise", "Whitener", "shared_variance", "whitener"]

#: Part of the variance that no other window shares. Of rendered beads neighbours at half a window correlate by 0.44 to 0.5 (0.5 by the formula) and by 0.73 at a quarter (0.75); a
#: part of 0.1 keeps the model from taking the finest differences between overlapping windows as known.
INDEPENDENT_SHARE = 0.1
#: A vector's error given the others follows from so many that come before it (A. V. Vecchia, J. R. Stat. Soc. B 50, 1988, 297-312).
BEFORE = 40
#: Covariances of more vectors are not stored as a whole.
DENSE = 3000
#: Smallest standard deviation of a vector over the typical one: those of residuals are themselves uncertain.
MIN_RELATIVE_STD = 0.3

Flags = npt.NDArray[np.bool_]


class Noise:
    """Standard deviation of each vector relative to the typical one, ``relative`` (row, column), and the side [m] of the windows that share it; 0: each has its own."""

    def __init__(self, relative: Floats, side: float) -> None:
        self.relative, self.side = relative, side

    @classmethod
    def even(cls, shape: tuple[int, int]) -> Noise:
        """The same everywhere, each vector with its own."""
        return cls(np.ones(shape), 0.0)

    @classmethod
    def of(cls, std: Floats, side: float) -> tuple[Noise, float]:
        """From standard deviations (2, row, column) [m], and the typical one, by which the others are divided."""
        each = np.sqrt((std**2).mean(axis=0))
        typical = float(np.nanmedian(each))
        filled = np.where(np.isfinite(each), each, typical)
        return cls(np.maximum(filled / typical, MIN_RELATIVE_STD), side), typical

    @property
    def plain(self) -> bool:
        """Whether all vectors have one noise of their own."""
        return self.side == 0 and bool((self.relative == 1.0).all())


def shared_variance(dx: Floats, dy: Floats, side: float) -> Floats:
    """Correlation of the errors of windows (dx, dy) apart."""
    if side <= 0:
        return np.asarray(((dx == 0) & (dy == 0)) * 1.0)
    return np.asarray(np.clip(1.0 - np.abs(dx) / side, 0.0, None) * np.clip(1.0 - np.abs(dy) / side, 0.0, None))


class Whitener:
    """Sparse W with W K W^T = 1 for the covariance K of some vectors and means of vectors; ``@`` applies it to the last axis."""

    def __init__(self, matrix: scipy.sparse.csr_array) -> None:
        self._matrix = matrix

    def __call__(self, values: Floats) -> Floats:
        """W applied to (..., n)."""
        flat = values.reshape(-1, values.shape[-1])
        return np.ascontiguousarray((self._matrix @ flat.T).T).reshape(values.shape)


def whitener(noise: Noise, pitch: float, members: list[npt.NDArray[np.intp]], places: Floats) -> Whitener:
    """For means over ``members`` (flat numbers of the vectors in each) at ``places`` (n, 2) [m], in units of the typical noise."""
    rows, columns = noise.relative.shape
    count = rows * columns
    s = noise.relative.ravel()
    # covariance of the vectors, as far as windows overlap
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
            # independent errors of two vectors still correlate through those between
            far = np.abs(at[:k] - at[k]).max(axis=1)
            near = np.argpartition(far, BEFORE)[:BEFORE]
        block = among(np.append(near, k), np.append(near, k))
        weights = np.linalg.solve(block[:-1, :-1], block[:-1, -1])
        scale = 1.0 / math.sqrt(float(block[-1, -1] - weights @ block[:-1, -1]))
        out_i += [order[k]] * (len(near) + 1)
        out_j += [*order[near], order[k]]
        out_v += [*(-scale * weights), scale]
    return Whitener(scipy.sparse.csr_array((out_v, (out_i, out_j)), shape=(len(members), len(members))))
