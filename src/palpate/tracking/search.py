"""Where contact is sought: when it begins and ends, and when the region of interest moves."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import dilated
from palpate.inverse.contact.cells import even_contact
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.prepared import TooLarge
from palpate.tracking.health import Flags, Index
from palpate.tracking.iteration import FAINT, Iteration, pressing
from palpate.tracking.region import NormalEquations

__all__ = ["LOST", "TAKEN", "Search", "around", "only_reading"]

#: Same value as in the contact method.
MARGIN = Policy().extent.margin

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
#: With more unknowns than this, choose cells by a rough solution instead of by scores. A displacement falls off as 1/r,
#: so that a contact of ten cells scores on the whole surface: 8700 unknowns, whose inverse took 30 s.
MANY = 1500


def only_reading(equations: NormalEquations, y: Floats, level: Floats, unused: Flags) -> Flags | None:
    """Mask of the largest reading of a frame (whitened, ``y``) if no contact begins without it, else None; ``level`` is
    that of the scores at rest.
    """
    largest = np.arange(len(y)) == int(np.argmax(np.abs(y)))
    score = equations.score(equations.adjoint(np.where(largest, 0.0, y), unused))
    return None if float((np.abs(score) / level).max()) > TAKEN else largest


def around(estimator: ConstrainedEstimator, cells: Flags) -> Flags:
    """Mask of the cells, and of all around them as far as the taxels are deep."""
    grid = estimator.operator.surface
    depth = math.ceil(estimator.depth / min(grid.spacings)) + 1
    return dilated(cells.reshape(grid.shape), depth).ravel()


class Search:
    """Decides which cells the region should have."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._estimator, self._grid = estimator, estimator.operator.surface
        self.clear()

    def clear(self) -> None:
        self._missing = np.zeros(math.prod(self._grid.shape), dtype=bool)  # cells where pressure is missing
        self._pressed = self._frames = 0

    def first(self, score: Floats, y: Floats, noise: float, unused: Flags, parameter: float) -> Index:
        """Cells of the first region of a contact, from every cell's score in standard deviations; the other arguments
        are those of `rough`.
        """
        by_score = self.scored(score)
        if not self.many(len(by_score)):
            return by_score
        pressed = self._pressed_roughly(y, noise, unused, parameter)
        by_solution = np.flatnonzero(around(self._estimator, pressed))
        return by_solution if pressed.any() and len(by_solution) < len(by_score) else by_score

    def scored(self, score: Floats) -> Index:
        """The cells with the highest scores, and those around them."""
        peak = float(score.max())  # negative if the whole surface is pulled
        likely = score >= (max(min(LOST, peak), LIKELY * peak) if peak > 0 else peak)
        return np.flatnonzero(around(self._estimator, likely))

    def many(self, cells: int) -> bool:
        """Whether so many cells are too many to invert their matrix without need."""
        return cells * len(self._estimator.columns) > MANY

    def rough(self, y: Floats, noise: float, unused: Flags, parameter: float) -> tuple[Floats, Floats]:
        """Pressure (cell,) of a rough solution, and the readings that it explains.

        ``y`` (reading,) and ``noise`` are in units of the readings' standard deviations; ``parameter`` is the penalty.
        """
        estimator, std = self._estimator, self._estimator.readings.std
        linear = estimator.start.evidence(estimator.orders[1], estimator.readings.planes(y * std), noise)
        weight = parameter / noise**2
        traction, explained, _ = even_contact(estimator, linear.traction, y / noise, noise * std, ~unused, weight)
        return traction[-1], explained / std

    def _pressed_roughly(self, y: Floats, noise: float, unused: Flags, parameter: float) -> Flags:
        """Mask of the cells that press in a rough solution; none if it has too many cells."""
        try:
            return pressing(self.rough(y, noise, unused, parameter)[0])
        except TooLarge:
            return np.zeros(math.prod(self._grid.shape), dtype=bool)

    def next(self, solution: Iteration) -> Index | None:
        """Cells of the region to move to, which contains the contact and a margin; None if it stays."""
        region, pressure, wanted = solution.region, solution.pressure, self._contact(solution)
        if region is None:
            return None
        self._pressed = self._pressed + 1 if wanted[region.cells[region.border]].any() else 0
        surely = bool((pressure[region.border] > SURELY_PRESSED * FAINT * float(pressure.max(initial=0.0))).any())
        if not (surely or self._pressed >= PRESSED or self._missing.any()):
            self._frames = (self._frames + 1) % SHRINK_EVERY
            if self._frames or len(region.cells) <= TOO_LARGE * max(int(wanted.sum()), FEWEST):
                return None
            kept = int(dilated(wanted.reshape(self._grid.shape), MARGIN + 1).sum())
            if len(region.cells) <= TOO_LARGE * max(kept, FEWEST):
                return None
        wanted = wanted | self._missing
        self._missing[:] = False
        cells = np.flatnonzero(dilated(wanted.reshape(self._grid.shape), MARGIN))
        return None if not len(cells) or np.array_equal(cells, region.cells) else cells

    def needed(self, solution: Iteration) -> Index:
        """Cells of the contact and a margin."""
        return np.flatnonzero(dilated(self._contact(solution).reshape(self._grid.shape), MARGIN))

    def _contact(self, solution: Iteration) -> Flags:
        """Mask of the surface's cells (cell,) that are in contact."""
        whole = np.zeros(math.prod(self._grid.shape), dtype=bool)
        if solution.contact is not None:
            whole[solution.contact[0]] = True
        return whole

    def moved(self) -> None:
        """Restart the count of frames that press at the border: the region has moved."""
        self._pressed = 0

    def request(self, cells: Flags, y: Floats, noise: float, unused: Flags, parameter: float) -> None:
        """Request cells outside the region where pressure is missing, and their neighbours; the other arguments are
        those of `rough`.
        """
        wanted = dilated(cells.reshape(self._grid.shape), 1).ravel()
        if (
            self.many(int(wanted.sum()))
            and (pressed := wanted & self._pressed_roughly(y, noise, unused, parameter)).any()
        ):
            wanted = pressed
        self._missing |= wanted
