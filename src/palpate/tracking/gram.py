"""Parts of the normal matrix A'A of whitened readings, for cells that a contact moves over.

Readings of independent noise: columns of A and their products are kept while the contact moves, so that only those of cells it comes to are made.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.tracking.health import Flags, Index

__all__ = ["Grams", "picked"]

#: Columns are forgotten where they are so many times those that are asked for, and never more than so many entries are kept (160 MB).
LARGER, ENTRIES = 3.0, 20_000_000


def picked(matrix: Floats, components: int, count: int, places: Index) -> Floats:
    """The part of a normal matrix of ``count`` cells that belongs to some of them (a copy)."""
    picks = (np.arange(components)[:, None] * count + places[None, :]).ravel()
    return np.asarray(matrix[np.ix_(picks, picks)])


@dataclass(frozen=True)
class _Kept:
    """Some cells, in the order in which they came: influences (cell * component, reading) in blocks, and A'A (cell * component, cell * component)."""

    cells: Index
    blocks: tuple[Floats, ...]
    gram: Floats

    @cached_property
    def order(self) -> Index:
        return np.argsort(self.cells)

    def places(self, cells: Index) -> Index:
        """Where some of the cells stand."""
        return np.asarray(self.order[np.searchsorted(self.cells, cells, sorter=self.order)])


class Grams:
    """A'A of some cells, of all readings or without a few. Never changed in place: threads may ask side by side."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._estimator = estimator
        self._kept: _Kept | None = None

    def holds(self, cells: Index) -> bool:
        """Whether the cells are at hand."""
        kept = self._kept
        return kept is not None and bool(np.isin(cells, kept.cells).all())

    def of(self, cells: Index, unused: Flags) -> Floats:
        """(component * cell, component * cell), component-major."""
        kept, c = self._grown(cells), len(self._estimator.columns)
        picks = (kept.places(cells)[None, :] * c + np.arange(c)[:, None]).ravel()
        out = kept.gram[np.ix_(picks, picks)]
        if unused.any():
            lost = np.concatenate([b[:, unused] for b in kept.blocks])[picks]
            out -= lost @ lost.T
        return out

    def _grown(self, cells: Index) -> _Kept:
        kept, c = self._kept, len(self._estimator.columns)
        if kept is not None:
            new = np.setdiff1d(cells, kept.cells)
            if not len(new):
                return kept
            whole = c * (len(kept.cells) + len(new))
            if len(new) == len(cells) or whole > LARGER * c * len(cells) or whole * kept.blocks[0].shape[1] > ENTRIES:
                kept = None
        if kept is None:
            rows = self._influences(cells)
            kept = self._kept = _Kept(cells.copy(), (rows,), rows @ rows.T)
            return kept
        rows, n = self._influences(new), len(kept.gram)
        gram = np.empty((n + len(rows), n + len(rows)))
        gram[:n, :n] = kept.gram
        gram[:n, n:] = np.concatenate([b @ rows.T for b in kept.blocks])
        gram[n:, :n] = gram[:n, n:].T
        gram[n:, n:] = rows @ rows.T
        kept = self._kept = _Kept(np.concatenate([kept.cells, new]), (*kept.blocks, rows), gram)
        return kept

    def _influences(self, cells: Index) -> Floats:
        """(cell * component, reading), whitened."""
        estimator = self._estimator
        std, c = estimator.readings.std, len(estimator.columns)
        rows = estimator.level(1).rows(cells, std, np.ones(len(std), dtype=bool))
        return np.ascontiguousarray(np.swapaxes(rows.reshape(c, len(cells), -1), 0, 1)).reshape(len(rows), -1)
