"""Where contact is sought: when it is taken up and given up, and when the region of interest moves."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import dilated
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.policy import Policy
from palpate.tracking.health import Flags, Index, Single
from palpate.tracking.region import Region

__all__ = ["LOST", "TAKEN", "Search"]

#: As the contact method has it.
FAINT, MARGIN = Policy().extent.faint, Policy().extent.margin

#: A contact is taken up where pressure somewhere is this many standard deviations from none, and given up below the second: noise
#: alone passes 5.5 on one cell in 5e7, on one of 1000 cells in one frame of 50 000 (four minutes at 200 Hz); 4 is hysteresis.
TAKEN, LOST = 5.5, 4.0
#: A region begins with the cells above LOST and above this part of the highest score.
LIKELY = 0.5
#: The region moves when the contact presses at its border in so many frames in a row: noise presses there now and then, a contact
#: that moves presses there again and again.
PRESSED = 4
#: It moves at once where pressure there is so many times what counts as contact.
SURELY_PRESSED = 4.0
#: It shrinks where it has so many times the cells that it needs, of which there are at least so many.
TOO_LARGE, FEWEST = 2, 9
#: Whether it has is asked once in so many frames: it is not urgent.
SHRINK_EVERY = 8


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
        peak = float(score.max())  # less than 0 where all of the surface is pulled
        likely = score >= (max(min(LOST, peak), LIKELY * peak) if peak > 0 else peak)
        return np.flatnonzero(dilated(likely.reshape(self._grid.shape), depth))

    def next(self, region: Region, pressure: Single) -> Index | None:
        """Cells of the region to move to, which keeps the contact inside with a margin; None: it stays."""
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
        """Cells of the contact with a margin."""
        wanted = self._active(region, pressure > FAINT * float(pressure.max(initial=0.0)))
        return np.flatnonzero(dilated(wanted.reshape(self._grid.shape), MARGIN))

    def _active(self, region: Region, active: Flags) -> Flags:
        whole = np.zeros(math.prod(self._grid.shape), dtype=bool)
        whole[region.cells[active]] = True
        return whole

    def moved(self) -> None:
        """The region has moved: count frames that press at its border afresh."""
        self._pressed = 0

    def missing(self, cells: Flags) -> None:
        """Cells outside the region where pressure is missing: they and their neighbours are wanted."""
        if cells.any():
            self._missing |= dilated(cells.reshape(self._grid.shape), 1).ravel()
