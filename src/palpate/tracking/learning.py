"""The weight of the penalty and the noise, learned from the frames where they are not given."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.few_cells import contact_in_few_cells
from palpate.inverse.contact.rough import rough
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.tracking.background import Background
from palpate.tracking.discrepancy import Discrepancy

__all__ = ["NORMAL", "Learning", "rough_noise"]

#: Median magnitude of a standard normal variable.
NORMAL = 0.6745
#: The penalty is learned again when the energy of the readings has changed by this factor, the load thus by 2.
RELEARN = 4.0
#: The same where contact does not explain a frame: of the energy that is not noise. What was learned from a weak contact is too smooth for a strong one.
RELEARN_MISFIT = 3.0
#: A linear model that calls less than this part of what contact leaves noise follows noise too: 0.3 at least on the accuracy benchmark, 0.04 where a
#: contact of 0.9 pitches on 8 x 8 taxels of three channels, less than a pitch deep, was then read 2.4 times too large.
FOLLOWED = 0.15
#: The same of noise that was told: what contact leaves beyond it is what cells of the surface cannot follow. On 6 x 7 taxels of three channels, 1.3 mm
#: wide and 1.5 mm deep, a ball of 1 N was read as 4.2 N with noise of 0.06 % and friction given.
TOLD = 0.5
#: Cells of the surface cannot follow so much of the readings at the most: 0.006 to 0.04 of contacts wider than three cells (taxels 0.6 to 1.5 cells deep),
#: 0.19 of one half a cell wide. Broken taxels under a contact and garbage leave 0.26 and more.
COARSEST = 0.2
#: So few readings tell too little apart for a quick look, and all cells of theirs take milliseconds.
FEW_READINGS = 200
#: Until the thread has learned the penalty: so many times the weight at which a gradient of the size that explains the readings
#: over a depth counts as much as they do. Too smooth for some frames rather than too rough.
PROVISIONAL = 10.0
#: So many penalties in a row are dropped where the load has outgrown them while the thread learned.
OUTGROWN = 3
#: Standard deviations of its own by which the energy of readings is beyond noise.
BEYOND = 6.0
#: Noise that was learned is doubted where so many frames in a row, without contact, are so many times quieter.
DOUBTED_FRAMES, QUIETER = 4, 3.0
#: The noise that a frame of a contact tells is believed up to so many times what was known: more is another frame's to say.
LOUDER = 3.0


def rough_noise(used: Floats) -> float:
    """Noise of the readings used in a frame before it is learned: robust, and no less than what a pad is known to."""
    return max(float(np.median(np.abs(used))) / NORMAL, MODEL_ERROR * float(np.abs(used).max(initial=0.0)))


class Learning:
    """Penalty ``parameter``, ``noise`` (in units of the readings' standard deviations) and ``resolution`` [m]; None before they are known."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._estimator = estimator
        self.noise: float | None = 1.0 if estimator.noise_known else None
        self._told = self.noise  # given, or told by the zero
        self._from_contact = self.noise is None  # the noise is learned with the penalty, unless the baseline tells it
        self.parameter: float | None = None
        self.resolution: float | None = None
        self.discrepancy = Discrepancy()
        self._energy = self._signal = 0.0
        self._doubts = 0
        self._outgrown = 0  # penalties in a row that the load had outgrown when they were learned

    @property
    def noise_known(self) -> bool:
        """Whether the noise was given, or told by frames without contact."""
        return self.noise is not None and not self._from_contact

    def take_noise(self, noise: float | None) -> None:
        """The noise of the frames that were captured as the zero, where they tell it."""
        if noise is not None:
            self.discrepancy = Discrepancy(zeroed=True)
            if self.noise is None:
                self.noise, self._told, self._from_contact = noise, noise, False

    def state(self, noise: float) -> None:
        """The noise of a frame whose source knows it; no less than that of the zero."""
        self.noise, self._from_contact = max(noise, self._told or 0.0), False

    def in_contact(self, y: Floats) -> float | None:
        """The noise of a frame in contact: what is known, and what the pad's model and the cells of the surface cannot follow of the readings ``y``."""
        if self.noise is None or self._from_contact or not y.size:
            return self.noise
        return self.discrepancy.noise(self.noise, float(np.sqrt(np.mean(y**2))))

    def doubt(self, used: Floats) -> None:
        """Forget a noise that was learned from a frame unlike those that follow: contact would hide in it for ever."""
        quiet = float(np.median(np.abs(used))) / NORMAL
        loud = self._from_contact and self.noise is not None and 0.0 < QUIETER * quiet < self.noise
        self._doubts = self._doubts + 1 if loud else 0
        if self._doubts >= DOUBTED_FRAMES:
            self.noise, self._energy, self._doubts = None, 0.0, 0

    def anew(self) -> None:
        """Forget the penalty and what it was learned from; not the noise, without which a press that covers the array is taken for noise."""
        self.parameter, self.resolution, self._energy, self._signal, self._outgrown = None, None, 0.0, 0.0, 0

    def again(self, y: Floats, noise: float, largest: float) -> None:
        """Begin with a penalty that is too smooth rather than too rough, and learn from the next frame, whatever its load."""
        self._energy = 0.0
        if self._estimator.parameter is None:
            self.parameter = noise**2 * largest / max(float(y @ y), 1e-300) * PROVISIONAL

    def learn(
        self,
        y: Floats,
        noise: float,
        largest: float,
        background: Background,
        *,
        energy: float,
        leaving: Callable[[], Callable[[float], float]],
        misfit: bool = False,
    ) -> bool:
        """Learn by evidence from a frame in contact, again when the load has changed a lot; whether there is something new.

        ``largest`` is the largest entry of the normal matrix' diagonal, ``energy`` that of the readings as they came; with ``misfit``
        contact does not explain them. ``leaving`` gives, of a penalty, what contact that pushes in the region of interest leaves of ``y``.
        """
        estimator = self._estimator
        signal = max(energy - len(y) * noise**2, 0.0)
        if self.parameter is None and background.threaded:
            self.parameter = noise**2 * largest / max(energy, 1e-300) * PROVISIONAL
        changed = not (self._energy / RELEARN < energy < self._energy * RELEARN)
        changed |= misfit and not (self._signal / RELEARN_MISFIT < signal < self._signal * RELEARN_MISFIT)
        if estimator.parameter is not None:
            if self.parameter is None:
                self.resolution = estimator.resolution(estimator.parameter)
            self.parameter = estimator.parameter
            return False
        if not changed and "learn" not in background:
            return False
        leaves = leaving()  # of the region as it is now, not when the work begins
        rows = estimator.readings.planes(y * estimator.readings.std)
        known = None if self._from_contact else self.in_contact(y)

        def work() -> tuple[float, float, float, float, float]:
            with estimator.rounds:  # what a linear model makes of the frame is asked for several times
                return learned()

        def learned() -> tuple[float, float, float, float, float]:
            linear, floor = estimator.orders[1], MODEL_ERROR * float(np.abs(y).max())
            evidence = estimator.evidence(linear, rows, known)
            if evidence.scale < floor:
                # less noise than a pad is known to: the detail that it would show is not there
                evidence = estimator.evidence(linear, rows, floor)
            # no more than this is no sign of noise that the linear model follows, nor of cells that are too wide
            little = evidence.scale / FOLLOWED if known is None else known / TOLD
            # (where channels do not tell pressure from shear, it is no measure)
            left = 0.0
            if known is None or not estimator.ambiguous:
                # as smooth as that much noise would have it
                few = len(y) <= FEW_READINGS
                left = math.inf if few else leaves(estimator.evidence(linear, rows, little).parameter)
            give_way()
            if left > little:
                left = min(left, self._left(y, little))
            size = float(np.sqrt(np.mean(y**2)))
            # what contact leaves beyond the noise that was told is the cells', or too much for them: broken readings
            wide = known is not None and little < left <= COARSEST * size
            follows = wide if known is not None else left > little
            if follows:
                # a linear model of shallow channels follows noise too, and what wide cells cannot follow: a penalty for it lets pressure and
                # shear grow against each other
                evidence = estimator.evidence(linear, rows, max(left, floor))
            coarse = math.sqrt(left**2 - known**2) / size if wide and known is not None else 0.0
            return evidence.parameter, max(evidence.scale, floor if known is None else 0.0), energy, signal, coarse

        found: Any = background.result("learn", work)
        if found is None:
            return False
        chance = BEYOND * noise**2 * math.sqrt(2.0 * len(y))
        if background.threaded and signal > RELEARN * found[3] + chance and self._outgrown < OUTGROWN:
            # the load has outgrown what was learned meanwhile, and a penalty learned from a touch finds nothing in a press: what there is serves on
            self._outgrown += 1
            background.result("learn", work)
            return False
        self._outgrown = 0
        self.parameter, scale, self._energy, self._signal, coarse = found
        self.discrepancy.raised(math.hypot(self.discrepancy.share, coarse) if coarse else 0.0)
        self.resolution = estimator.resolution(self.parameter)
        if self._from_contact:
            # one frame of garbage must not make so much noise that contact hides in it
            self.noise = scale if self.noise is None else min(scale, LOUDER * self.noise)
        return True

    def _left(self, y: Floats, little: float) -> float:
        """What contact of one sign leaves of readings: the noise that a linear model is compared with. One that leaves ``little`` is enough."""
        estimator = self._estimator
        data, observed = y * estimator.readings.std, np.ones(len(y), dtype=bool)
        total = float(np.sqrt(np.mean(estimator.readings.white(y, observed) ** 2)))
        if not total > 0.0:
            return 0.0
        left = math.inf
        for sign in (1, -1):
            left = min(left, rough(estimator, sign * data, observed, total).left)
            if left <= little:
                return left
        small = contact_in_few_cells(estimator, data, observed)
        return left if small is None else min(left, small.left)
