"""Parts of the normal matrix A'A of whitened readings, cached for the cells that a contact moves over.

For readings with independent noise: columns of A and their products are kept while the contact moves, so that only
those of new cells are computed.
"""

from __future__ import annotations

import numpy as np

from palpate._threads import Lock, give_way
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import Columns, Picked
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.tracking.boxes import Alike, Box
from palpate.tracking.health import Flags, Index

__all__ = ["Grams", "picked"]

#: Drop cached columns if they are this many times more than needed; keep no box of more than this many entries (160 MB).
LARGER, ENTRIES = 3.0, 20_000_000


def picked(matrix: Floats, components: int, count: int, places: Index) -> Floats:
    """The part of a normal matrix of ``count`` cells that belongs to the cells ``places`` (a copy)."""
    picks = (np.arange(components)[:, None] * count + places[None, :]).ravel()
    return np.asarray(matrix.take(picks, axis=0).take(picks, axis=1))


class Grams:
    """A'A of some cells, with all readings or without a few. Never changed in place, so that threads may share it."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._estimator = estimator
        self._columns: Columns | None = None
        self._lock = Lock()
        self._alike = Alike(estimator)
        self._boxes: tuple[Box, ...] = ()  # the last two: work on the previous region may still run

    def holds(self, cells: Index) -> bool:
        """Whether A'A of these cells is cached."""
        where = np.unravel_index(cells, self._estimator.operator.surface.shape)
        if any(box.places(where) is not None for box in self._boxes):
            return True
        kept = self._columns
        return kept is not None and bool((kept.place[cells] >= 0).all())

    def of(self, cells: Index, unused: Flags) -> Floats:
        """(component * cell, component * cell), component-major."""
        if (boxed := self._boxed(cells, unused)) is not None:
            return boxed
        level, std = self._estimator.level(1), self._estimator.readings.std
        with self._lock:
            kept = self._columns
            picked = None if kept is None or kept.count > LARGER * len(cells) else kept.pick(cells, std, ~unused)
            if picked is None:
                give_way()
                self._columns = kept = Columns(level, cells, std, ~unused)
                picked = Picked(kept, np.arange(len(cells)), 1.0, np.zeros(0, dtype=np.intp))
            return picked.gram()

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
