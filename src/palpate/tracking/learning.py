"""Learn the weight of the penalty and the noise from the frames, if they are not given."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.few_cells import contact_in_few_cells
from palpate.inverse.contact.noise import MEDIAN
from palpate.inverse.contact.rough import rough
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.tracking.background import Background
from palpate.tracking.discrepancy import Discrepancy

__all__ = ["ROUNDING", "Learning", "rough_noise"]

#: Relative rounding error of a reading minus its zero, in double precision.
ROUNDING = 1e-12
#: Learn the penalty again when the energy of the readings has changed by this factor, so the load by 2.
RELEARN = 4.0
#: The same if contact does not fit the frame, for the energy beyond noise: a penalty learned from a weak contact is too
#: smooth for a strong one.
RELEARN_MISFIT = 3.0
#: If the linear model's noise is below this fraction of the contact's residual, it fits noise too. The ratio was at
#: least 0.3 on the accuracy benchmark, and 0.04 for a contact of 0.9 pitches on 8 x 8 taxels of three channels, less
#: than a pitch deep, which was then read 2.4 times too large.
FOLLOWED = 0.15
#: The same if the noise is known: the residual beyond it is what surface cells cannot represent. On 6 x 7 taxels of
#: three channels, 1.3 mm wide and 1.5 mm deep, a ball of 1 N was read as 4.2 N with noise of 0.06 % and friction given.
TOLD = 0.5
#: Largest fraction of the readings that surface cells cannot represent: 0.006 to 0.04 for contacts wider than three
#: cells (taxels 0.6 to 1.5 cells deep), 0.19 for one half a cell wide. Broken taxels under a contact and garbage leave
#: 0.26 and more.
COARSEST = 0.2
#: With so few readings a quick check is unreliable, and solving on all cells takes only milliseconds.
FEW_READINGS = 200
#: Provisional penalty until the thread has learned one: this many times the weight at which gradients that explain the
#: readings over one depth cost as much as the misfit. Rather too smooth than too rough.
PROVISIONAL = 10.0
#: Largest number of consecutive penalties to discard because the load outgrew them while they were learned.
OUTGROWN = 3
#: Standard deviations by which the energy of the readings must exceed that of noise.
BEYOND = 6.0
#: A learned noise is discarded if this many consecutive frames without contact are QUIETER times below it.
DOUBTED_FRAMES, QUIETER = 4, 3.0
#: The noise learned from one frame in contact may be at most this many times the noise known before; a larger value
#: needs another frame.
LOUDER = 3.0


def rough_noise(used: Floats) -> float:
    """Robust noise estimate of the readings ``used`` before noise is learned, not below the model's accuracy."""
    return max(float(np.median(np.abs(used))) / MEDIAN, MODEL_ERROR * float(np.abs(used).max(initial=0.0)))


def typical_noise(std: Floats) -> float | None:
    """Median of the standard deviations that a source states, in units of the readings' own; None if it states none."""
    if (std < 0.0).any():
        raise InvalidInput("std must not be negative: standard deviations of the readings, NaN where there are none.")
    good = std[np.isfinite(std)]
    return float(np.median(good)) if good.size else None


class _Learned(NamedTuple):
    """Penalty and noise of a frame in contact, and the part of its readings that surface cells cannot represent."""

    parameter: float
    noise: float
    coarse: float


class Learning:
    """``parameter`` (penalty), ``noise`` (in standard deviations of readings), ``resolution`` [m]; None until known."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._estimator = estimator
        self.noise: float | None = 1.0 if estimator.noise_known else None
        self._told = self.noise  # given, or measured with the zero
        self._from_contact = self.noise is None  # the noise is learned with the penalty, unless the baseline gives it
        self.parameter: float | None = None
        self.resolution: float | None = None
        self.discrepancy = Discrepancy()
        self._energy = self._signal = 0.0
        self._doubts = 0
        self._before: tuple[float | None, bool] | None = (
            None  # noise, and whether a contact told it, before a source stated one
        )
        self._outgrown = 0  # consecutive penalties that the load outgrew while they were learned

    @property
    def noise_known(self) -> bool:
        """Whether the noise was given, or measured in frames without contact."""
        return self.noise is not None and not self._from_contact

    def take_noise(self, noise: float | None) -> None:
        """Take the noise of the frames of the zero, if they determine it."""
        if noise is not None:
            self.discrepancy = Discrepancy(zeroed=True)
            if self.noise is None:
                self.noise, self._told, self._from_contact = noise, noise, False

    def state(self, noise: float | None) -> None:
        """Set the noise of a frame whose source knows it; not below that of the zero. None: the source does not."""
        if noise is None:
            if self._before is not None:
                (self.noise, self._from_contact), self._before = self._before, None
            return
        if self._before is None:
            self._before = self.noise, self._from_contact
        self.noise, self._from_contact = max(noise, self._told or 0.0), False

    def in_contact(self, y: Floats) -> float | None:
        """Noise of a frame in contact: the known noise, plus errors of the pad's model and of the cell size for the
        readings ``y``.
        """
        if self.noise is None or self._from_contact or not y.size:
            return self.noise
        return self.discrepancy.noise(self.noise, float(np.sqrt(np.mean(y**2))))

    def doubt(self, used: Floats) -> None:
        """Discard a learned noise if the following frames are much quieter; otherwise contact would stay hidden in it."""
        quiet = float(np.median(np.abs(used))) / MEDIAN if used.size else 0.0
        loud = self._from_contact and self.noise is not None and 0.0 < QUIETER * quiet < self.noise
        self._doubts = self._doubts + 1 if loud else 0
        if self._doubts >= DOUBTED_FRAMES:
            self.noise, self._energy, self._doubts = None, 0.0, 0

    def anew(self) -> None:
        """Forget the penalty but not the noise: without it a press over the whole array would be taken for noise."""
        self.parameter, self.resolution, self._energy, self._signal, self._outgrown = None, None, 0.0, 0.0, 0

    def again(self, y: Floats, noise: float, largest: float) -> None:
        """Start with a penalty rather too smooth than too rough; learn again from the next frame, whatever its load."""
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
        """Learn by evidence from a frame in contact, again when the load has changed a lot; return whether anything
        changed.

        ``largest`` is the largest diagonal entry of the normal matrix, ``energy`` that of the original readings;
        ``misfit``: contact does not fit them. ``leaving`` returns a function from penalty to the residual of pushing
        contact in the region, for the readings ``y``.
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
        known = None if self._from_contact else self.in_contact(y)

        def work() -> tuple[_Learned, float, float]:
            with estimator.rounds:  # what a linear model makes of the frame is asked for several times
                return self._of_frame(y, known, leaves), energy, signal

        done: tuple[_Learned, float, float] | None = background.result("learn", work)
        if done is None:
            return False
        found, of_energy, of_signal = done
        chance = BEYOND * noise**2 * math.sqrt(2.0 * len(y))
        if background.threaded and signal > RELEARN * of_signal + chance and self._outgrown < OUTGROWN:
            # The load outgrew this penalty while it was learned. A penalty from a light touch fails in a press, so keep
            # the old one.
            self._outgrown += 1
            background.result("learn", work)
            return False
        self._outgrown, self._energy, self._signal = 0, of_energy, of_signal
        self.parameter = found.parameter
        self.discrepancy.raised(math.hypot(self.discrepancy.share, found.coarse) if found.coarse else 0.0)
        self.resolution = estimator.resolution(self.parameter)
        if self._from_contact:
            # A single frame of garbage must not raise the noise so much that contact is hidden.
            self.noise = found.noise if self.noise is None else min(found.noise, LOUDER * self.noise)
        return True

    def _of_frame(self, y: Floats, known: float | None, leaves: Callable[[float], float]) -> _Learned:
        """What a frame in contact tells, with the ``known`` noise or with its own; ``leaves`` as in `learn`."""
        estimator = self._estimator
        rows = estimator.readings.planes(y * estimator.readings.std)
        linear, floor = estimator.orders[1], MODEL_ERROR * float(np.abs(y).max())
        evidence = estimator.start.evidence(linear, rows, known)
        if evidence.scale < floor:
            # Noise below the accuracy of the pad: the detail that it would show is not real.
            evidence = estimator.start.evidence(linear, rows, floor)
        # A residual below this is no sign that the linear model fits noise, nor that cells are too wide.
        little = evidence.scale / FOLLOWED if known is None else known / TOLD
        # (For channels that cannot separate pressure from shear, this comparison is not valid.)
        left = 0.0
        if known is None or not estimator.ambiguous:
            # As smooth as this noise requires.
            few = len(y) <= FEW_READINGS
            left = math.inf if few else leaves(estimator.start.evidence(linear, rows, little).parameter)
        give_way()
        if left > little:
            left = min(left, self._left(y, little))
        size = float(np.sqrt(np.mean(y**2)))
        # A residual beyond the known noise comes from the cell size, or if too large from broken readings.
        wide = known is not None and little < left <= COARSEST * size
        if wide or (known is None and left > little):
            # With shallow taxels a linear model fits noise, and what wide cells cannot represent. A penalty for
            # that model lets pressure and shear grow against each other.
            evidence = estimator.start.evidence(linear, rows, max(left, floor))
        coarse = math.sqrt(left**2 - known**2) / size if wide and known is not None else 0.0
        return _Learned(evidence.parameter, max(evidence.scale, floor if known is None else 0.0), coarse)

    def _left(self, y: Floats, little: float) -> float:
        """Residual of contact of one sign, to compare with the linear model's noise; ends below ``little``."""
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
