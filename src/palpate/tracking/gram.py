"""Parts of the normal matrix A'A of whitened readings, cached for the cells that a contact moves over.

For readings with independent noise: columns of A and their products are kept while the contact moves, so that only
those of new cells are computed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate._threads import cached_property, give_way
from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.tracking.boxes import Alike, Box
from palpate.tracking.health import Flags, Index
from palpate.tracking.pieces import product, square

__all__ = ["Grams", "picked"]

#: Drop cached columns if they are this many times more than needed; never keep more than this many entries (160 MB).
LARGER, ENTRIES = 3.0, 20_000_000
#: Cells whose columns are computed at a time: a millisecond or two for some thousand readings.
AT_A_TIME = 32


def picked(matrix: Floats, components: int, count: int, places: Index) -> Floats:
    """The part of a normal matrix of ``count`` cells that belongs to the cells ``places`` (a copy)."""
    picks = (np.arange(components)[:, None] * count + places[None, :]).ravel()
    return np.asarray(matrix.take(picks, axis=0).take(picks, axis=1))


@dataclass(frozen=True)
class _Kept:
    """Cached cells by arrival: influences (cell * component, reading) in blocks, and A'A of cells * components."""

    cells: Index
    blocks: tuple[Floats, ...]
    gram: Floats

    @cached_property
    def order(self) -> Index:
        return np.argsort(self.cells)

    def places(self, cells: Index) -> Index:
        """Indices of some of the cached cells."""
        return np.asarray(self.order[np.searchsorted(self.cells, cells, sorter=self.order)])


class Grams:
    """A'A of some cells, with all readings or without a few. Never changed in place, so that threads may share it."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._estimator = estimator
        self._kept: _Kept | None = None
        self._alike = Alike(estimator)
        self._boxes: tuple[Box, ...] = ()  # the last two: work on the previous region may still run

    def holds(self, cells: Index) -> bool:
        """Whether A'A of these cells is cached."""
        where = np.unravel_index(cells, self._estimator.operator.surface.shape)
        if any(box.places(where) is not None for box in self._boxes):
            return True
        kept = self._kept
        return kept is not None and bool(np.isin(cells, kept.cells).all())

    def of(self, cells: Index, unused: Flags) -> Floats:
        """(component * cell, component * cell), component-major."""
        if (boxed := self._boxed(cells, unused)) is not None:
            return boxed
        kept, c = self._grown(cells), len(self._estimator.columns)
        picks = (kept.places(cells)[None, :] * c + np.arange(c)[:, None]).ravel()
        out = np.asarray(kept.gram.take(picks, axis=0).take(picks, axis=1))
        if unused.any():
            lost = np.concatenate([b[:, unused] for b in kept.blocks])[picks]
            out -= lost @ lost.T
        return out

    def _boxed(self, cells: Index, unused: Flags) -> Floats | None:
        """Compute A'A from the bounding box of the cells; None if that is not less work."""
        alike, c = self._alike, len(self._estimator.columns)
        where = np.unravel_index(cells, self._estimator.operator.surface.shape)
        box, places = next(((b, p) for b in self._boxes if (p := b.places(where)) is not None), (None, None))
        if box is None or places is None:
            sides = alike.fits(where, ENTRIES)
            if sides is None:
                return None
            box = alike.box(*sides)
            places = box.places(where)
            self._boxes = (box, *self._boxes[:1])
        picks = (np.asarray(places)[None, :] * c + np.arange(c)[:, None]).ravel()
        give_way()
        out = box.gram.take(picks, axis=0).take(picks, axis=1)
        if unused.any():
            lost = alike.of(where, unused)
            out -= lost @ lost.T
        return np.asarray(out)

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
            kept, new = _Kept(cells[:0], (), np.zeros((0, 0))), cells
        blocks, n = list(kept.blocks), len(kept.gram)
        gram = np.empty((n + c * len(new),) * 2)
        gram[:n, :n] = kept.gram
        for some in np.array_split(new, math.ceil(len(new) / AT_A_TIME)):
            rows, start = self._influences(some), 0
            stop = n + len(rows)
            for block in blocks:
                gram[n:stop, start : start + len(block)] = product(rows, block.T)
                start += len(block)
            gram[n:stop, n:stop] = square(rows)
            gram[:n, n:stop] = gram[n:stop, :n].T
            blocks.append(rows)
            n = stop
        kept = self._kept = _Kept(np.concatenate([kept.cells, new]), tuple(blocks), gram)
        return kept

    def _influences(self, cells: Index) -> Floats:
        """Whitened influences (cell * component, reading)."""
        estimator = self._estimator
        std, c = estimator.readings.std, len(estimator.columns)
        give_way()
        rows = estimator.level(1).rows(cells, std, np.ones(len(std), dtype=bool))
        return np.ascontiguousarray(np.swapaxes(rows.reshape(c, len(cells), -1), 0, 1)).reshape(len(rows), -1)
