"""Sparse rows over cells whose variances are requested: differences between neighbours, means over a few cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import cached_property
from palpate.elastic.pad import Floats

__all__ = ["Rows"]

Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Rows:
    """Sparse rows as entries, row after row; entries at the same position are summed. ``others`` (row, k) are dense
    columns after the sparse ones.
    """

    row: Index
    col: Index
    value: Floats
    count: int
    others: Floats | None = None

    @classmethod
    def of(cls, matrix: Any) -> Rows:
        """Convert a sparse matrix in row format."""
        row = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        return cls(row, np.asarray(matrix.indices, dtype=np.intp), np.asarray(matrix.data), matrix.shape[0])

    def each(self, components: int, cells: int) -> Rows:
        """Repeat rows over cells for each component, as rows over (component, cell)."""
        i = np.arange(components)[:, None]
        return Rows(
            (self.row + i * self.count).ravel(),
            (self.col + i * cells).ravel(),
            np.tile(self.value, components),
            self.count * components,
        )

    def times(self, dense: Floats) -> Floats:
        """Product of the rows with an array (n, k)."""
        starts = np.concatenate([[0], np.cumsum(np.bincount(self.row, minlength=self.count))])
        n = len(dense) - (0 if self.others is None else self.others.shape[1])
        own = scipy.sparse.csr_array((self.value, self.col, starts), shape=(self.count, n))
        out = np.asarray(own @ dense[:n])
        return out if self.others is None else out + self.others @ dense[n:]

    def variances(self, entries: Callable[[Index, Index], Floats]) -> Floats:
        """Diagonal of rows C rows', where ``entries(i, j)`` returns entries of C, i >= j."""
        row, first, other, weight = self._pairs
        i, j = self.col[first], self.col[other]
        each = weight * entries(np.maximum(i, j), np.minimum(i, j))
        return np.asarray(np.bincount(row, each, minlength=self.count), dtype=np.float64)

    @cached_property
    def _pairs(self) -> tuple[Index, Index, Index, Floats]:
        """Pairs of each entry with itself and with earlier entries of its row: row, both positions, weight."""
        counts = np.bincount(self.row, minlength=self.count)
        starts = np.cumsum(counts) - counts
        before = np.arange(len(self.row)) - starts[self.row] + 1
        first = np.repeat(np.arange(len(self.row)), before)
        other = np.arange(len(first)) - np.repeat(np.cumsum(before) - before, before) + starts[self.row[first]]
        weight = self.value[first] * self.value[other] * np.where(first == other, 1.0, 2.0)
        return self.row[first], first, other, weight
