"""Where contact is sought: when it begins and ends, and when the region of interest moves."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import dilated
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.policy import Policy
from palpate.tracking.health import Flags, Index, Single
from palpate.tracking.region import NormalEquations, Region

__all__ = ["LOST", "TAKEN", "Search", "only_reading"]

#: Same values as in the contact method.
FAINT, MARGIN = Policy().extent.faint, Policy().extent.margin

#: Scores, in standard deviations, at which a contact begins and ends. Noise alone exceeds 5.5 on one cell in 5e7, so on
#: one of 1000 cells in one frame of 50 000 (four minutes at 200 Hz); 4 gives hysteresis.
TAKEN, LOST = 5.5, 4.0
#: The first region has the cells above LOST and above this fraction of the highest score.
LIKELY = 0.5
#: The region moves if the contact presses at its border in this many consecutive frames: noise does so only now and
#: then.
PRESSED = 4
#: It moves at once if the pressure there exceeds the contact threshold this many times.
SURELY_PRESSED = 4.0
#: It shrinks if it has TOO_LARGE times the cells that it needs, at least FEWEST.
TOO_LARGE, FEWEST = 2, 9
#: Frames between two such tests, which are not urgent.
SHRINK_EVERY = 8


def only_reading(equations: NormalEquations, y: Floats, level: Floats, unused: Flags) -> Flags | None:
    """Mask of the largest reading of a frame (whitened, ``y``) if no contact begins without it, else None; ``level`` is
    that of the scores at rest.
    """
    largest = np.arange(len(y)) == int(np.argmax(np.abs(y)))
    score = equations.score(equations.adjoint(np.where(largest, 0.0, y), unused))
    return None if float((np.abs(score) / level).max()) > TAKEN else largest


class Search:
    """Decides which cells the region should have."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._grid = estimator.operator.surface
        self._depth = estimator.depth
        self.clear()

    def clear(self) -> None:
        self._missing = np.zeros(math.prod(self._grid.shape), dtype=bool)  # cells where pressure is missing
        self._pressed = self._frames = 0

    def first(self, score: Floats) -> Index:
        """Cells of the first region of a contact, from every cell's score in standard deviations."""
        depth = math.ceil(self._depth / min(self._grid.spacings)) + 1
        peak = float(score.max())  # negative if the whole surface is pulled
        likely = score >= (max(min(LOST, peak), LIKELY * peak) if peak > 0 else peak)
        return np.flatnonzero(dilated(likely.reshape(self._grid.shape), depth))

    def next(self, region: Region, pressure: Single) -> Index | None:
        """Cells of the region to move to, which contains the contact and a margin; None if it stays."""
        peak = float(pressure.max(initial=0.0))
        active = pressure > FAINT * peak
        self._pressed = self._pressed + 1 if (active & region.border).any() else 0
        surely = bool((pressure[region.border] > SURELY_PRESSED * FAINT * peak).any())
        if not (surely or self._pressed >= PRESSED or self._missing.any()):
            self._frames = (self._frames + 1) % SHRINK_EVERY
            if self._frames or len(region.cells) <= TOO_LARGE * max(int(active.sum()), FEWEST):
                return None
            wanted = self._active(region, active)
            kept = int(dilated(wanted.reshape(self._grid.shape), MARGIN + 1).sum())
            if len(region.cells) <= TOO_LARGE * max(kept, FEWEST):
                return None
        wanted = self._active(region, active) | self._missing
        self._missing[:] = False
        cells = np.flatnonzero(dilated(wanted.reshape(self._grid.shape), MARGIN))
        return None if not len(cells) or np.array_equal(cells, region.cells) else cells

    def needed(self, region: Region, pressure: Single) -> Index:
        """Cells of the contact and a margin."""
        wanted = self._active(region, pressure > FAINT * float(pressure.max(initial=0.0)))
        return np.flatnonzero(dilated(wanted.reshape(self._grid.shape), MARGIN))

    def _active(self, region: Region, active: Flags) -> Flags:
        whole = np.zeros(math.prod(self._grid.shape), dtype=bool)
        whole[region.cells[active]] = True
        return whole

    def moved(self) -> None:
        """Restart the count of frames that press at the border: the region has moved."""
        self._pressed = 0

    def missing(self, cells: Flags) -> None:
        """Request cells outside the region where pressure is missing, and their neighbours."""
        if cells.any():
            self._missing |= dilated(cells.reshape(self._grid.shape), 1).ravel()
