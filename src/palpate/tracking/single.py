"""A tracker's answer compared with that of its frame by itself.

What a tracker finds may hang on what came before: offsets, a penalty, readings left out. A single solve of the same readings, with the same zero and its
noise, hangs on nothing. It takes as long as many frames, so it is rare: when contact begins, when the load is another, and from time to time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.status import Status
from palpate.touch import Touch

__all__ = ["Alone", "Answer", "Comparison"]

#: Solves readings less their zero (one array per plane) by themselves, with the noise of frames at rest (the same, a list of them).
Alone = Callable[[list[Floats], list[list[Floats]]], Touch]
#: Frames between two comparisons at least, of so many readings; and if the last two answers parted.
SPACING, READINGS, DOUBTED = 64, 200, 16
#: Standard deviations by which two answers that part are said to differ at most: less than the 1.96 of half an interval of 95 %.
REACH = 1.8
#: A comparison is due after so many frames, or where the load has changed by this factor.
AGAIN, ANOTHER = 512, 3.0


@dataclass(frozen=True)
class Answer:
    """Net force (component,) with its interval of 95 %, NaN where it is not known; whether the readings are explained; the sum of the load."""

    force: Floats
    low: Floats
    high: Floats
    explained: bool
    load: float
    discrepancy: float = 0.0

    @classmethod
    def of(cls, touch: Touch) -> Answer:
        """What a touch says."""
        status = Status.SOLVED if touch.status is None else Status.coded(int(touch.status))
        force = to_numpy(touch.force).astype(np.float64)
        low, high = (np.full_like(force, math.nan),) * 2
        if status.known and touch.errors is not None:
            low, high = (np.asarray(to_numpy(end), dtype=np.float64) for end in touch.interval(0.95, "force"))
        size = np.sqrt((to_numpy(touch.values).astype(np.float64) ** 2).sum(axis=0))
        share = getattr(touch, "discrepancy", None)
        return cls(
            force,
            low,
            high,
            status.known and status is not Status.UNEXPLAINED,
            float(size.sum()) * touch.surface.cell,
            0.0 if share is None else float(np.nan_to_num(share)),
        )

    def parted(self, other: Answer) -> bool:
        """Whether the intervals of two answers do not meet; where one is not known they do."""
        if not (self.explained and other.explained):
            return False
        with np.errstate(invalid="ignore"):
            return bool(((self.low > other.high) | (other.low > self.high)).any())


class Comparison:
    """When a tracker's answer is compared, and what came of it.

    ``share`` is the error (standard deviation, as a part of the load) that brings the two answers together; ``refuted``: by itself the frame is not
    explained.
    """

    def __init__(self, readings: int) -> None:
        self._slow = max(readings / READINGS, 1.0)
        self._since = math.inf
        self._load = math.nan  # at the last comparison of this contact
        self.share, self.refuted = 0.0, False
        self.anew = False  # whether the tracker has just begun anew

    def release(self) -> None:
        """The contact has ended."""
        self._load = math.nan

    def due(self, load: float) -> bool:
        """Whether the answer of a frame with this load is to be compared; called once a frame."""
        self._since += 1
        doubted = self.share > 0.0 or self.refuted or self.anew
        if self._since < (DOUBTED if doubted else SPACING) * self._slow:
            return False
        same = self._load / ANOTHER < load < self._load * ANOTHER
        return doubted or not same or self._since >= AGAIN * self._slow

    def begun(self, load: float) -> None:
        """A comparison has begun."""
        self._since, self._load = 0, load

    def settle(self, tracked: Answer, alone: Answer) -> bool:
        """Take in two answers of a frame; False where the tracker must begin anew first."""
        self.refuted = not alone.explained
        if not tracked.parted(alone):
            self.share, self.anew = 0.0, False
            return True
        if not self.anew:
            self.anew = True
            return False
        gap = float(np.abs(tracked.force - alone.force).max())
        # half an interval of 95 % reaches from one to the other, and a little beyond
        self.share, self.anew = gap / (REACH * max(tracked.load, 1e-300)), False
        return True

    def words(self, tracked: Answer, alone: Answer, unit: str) -> str:
        """What is said when the tracker begins anew."""
        both = (f"{a.force[-1]:.3g} ({a.low[-1]:.3g} to {a.high[-1]:.3g}) {unit}" for a in (tracked, alone))
        return "followed from frame to frame this contact read {}, by itself {}: it is begun anew".format(*both)
