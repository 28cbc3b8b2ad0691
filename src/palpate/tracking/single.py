"""A tracker's answer compared with that of its frame by itself.

What a tracker finds may hang on what came before: offsets, a penalty, readings left out. A single solve of the same readings, with the same zero and its
noise, hangs on nothing. It takes as long as many frames, so it is rare: when contact begins, when the load is another, and from time to time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.status import Status
from palpate.touch import Touch
from palpate.tracking.zero import FRAMES_FOR_NOISE

__all__ = ["BEGUN", "Alone", "Answer", "Comparison", "SingleSolve"]

#: How what is said begins where a contact is begun anew.
BEGUN = "followed from frame to frame this contact read"
#: Solves readings less their zero (one array per plane) by themselves, with the noise of frames at rest (the same, a list of them).
Alone = Callable[[list[Floats], list[list[Floats]]], Touch]
#: Noise that frames at rest tell is rounded up to powers of this: a skin that is prepared serves again.
NOISE_STEP = 1.1
#: Frames between two comparisons at least, of so many readings; if the last two answers parted; and of a load that changes while the tracker knows no more
#: than a single solve: one even penalty reads a small contact up to 60 % too high, and presses of ten frames are over before a longer wait is.
SPACING, READINGS, DOUBTED, GROWING = 64, 200, 16, 4
#: Standard deviations by which two answers that part are said to differ at most: less than the 1.96 of half an interval of 95 %.
REACH = 1.8
#: A comparison is due after so many frames, or where the load has changed by this factor.
AGAIN, ANOTHER = 512, 2.0


class SingleSolve:
    """What a skin's default method says of readings less their zero, with the noise of frames at rest; an `Alone`."""

    def __init__(self, skin: Any, components: Sequence[str], friction: float | None) -> None:
        self._skin, self._components = skin, components
        self._options = {} if friction is None else {"friction": friction}
        self._made: tuple[tuple[float, ...], Any] | None = None

    def __call__(self, readings: list[Floats], rest: list[list[Floats]]) -> Touch:
        planes = self._skin.planes
        frames = [np.stack(parts) for parts in zip(*rest)] if len(rest) >= FRAMES_FOR_NOISE else []
        levels = [np.sqrt((f[:, :, a.valid] ** 2).mean(axis=(0, 2))) for f, a in zip(frames, planes)]
        known = bool(levels) and all((level > 0).all() for level in levels)
        steps = tuple(np.ceil(np.log(np.concatenate(levels)) / math.log(NOISE_STEP)).tolist()) if known else ()
        if self._made is None or self._made[0] != steps:
            self._made = steps, self._zeroed(NOISE_STEP ** np.array(steps), known)
        found: Touch = self._made[1].reconstruct(
            readings if len(readings) > 1 else readings[0], components=self._components, **self._options
        )
        return found

    def _zeroed(self, noise: Floats, known: bool) -> Any:
        """The skin with this noise (channel of all planes,), without ends of ranges, which are those of raw readings."""
        planes = []
        for a in self._skin.planes:
            mine, noise = noise[: len(a.channels)], noise[len(a.channels) :]
            planes.append(replace(a, limits=None, noise=mine.tolist() if known and a.noise is None else a.noise))
        out = self._skin._with(self._skin.pad, planes)
        out._problem.zeroed = known
        return out


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
        if status.known and touch.has_intervals:
            low, high = (np.asarray(to_numpy(end), dtype=np.float64) for end in touch.interval(0.95, "force"))
        size = np.sqrt((to_numpy(touch.values).astype(np.float64) ** 2).sum(axis=0))
        share = getattr(touch, "discrepancy", None)
        return cls(
            force,
            low,
            high,
            status.known and status is not Status.UNEXPLAINED,
            float(touch.surface.integral(size)),
            0.0 if share is None else float(np.nan_to_num(share)),
        )

    def without_move(self, by: Floats) -> Answer:
        """The answer before a force ``by`` was added to it."""
        return replace(self, force=self.force - by, low=self.low - by, high=self.high - by)

    def without(self, share: float) -> Answer:
        """The answer whose interval has no room for an error of this ``share`` of the load (standard deviation)."""
        room = (1.96 * share * self.load) ** 2
        low = self.force - np.sqrt(np.maximum((self.force - self.low) ** 2 - room, 0.0))
        high = self.force + np.sqrt(np.maximum((self.high - self.force) ** 2 - room, 0.0))
        return replace(self, low=low, high=high)

    def holds(self, other: Answer) -> bool:
        """Whether the interval holds what another answer finds; where one is not known it does."""
        if not (self.explained and other.explained):
            return True
        with np.errstate(invalid="ignore"):
            return not bool(((other.force < self.low) | (other.force > self.high)).any())

    def parted(self, other: Answer) -> bool:
        """Whether the intervals of two answers do not meet; where one is not known they do."""
        if not (self.explained and other.explained):
            return False
        with np.errstate(invalid="ignore"):
            return bool(((self.low > other.high) | (other.low > self.high)).any())


class Comparison:
    """When a tracker's answer is compared, and what came of it.

    ``share`` is the error (standard deviation, as a part of the load) that brings the two answers together; ``refuted``: by itself the frame that was
    compared is not explained.
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

    def due(self, load: float, *, alike: bool) -> bool:
        """Whether the answer of a frame with this load is to be compared; called once a frame.

        ``alike``: the tracker knows no more of this frame than a single solve does (no offsets, no readings found wrong, no restart).
        """
        self._since += 1
        doubted = self.share > 0.0 or self.refuted or self.anew
        same = self._same(load)
        if self._since < (GROWING if alike and not same else DOUBTED if doubted else SPACING) * self._slow:
            return False
        return doubted or not same or self._since >= AGAIN * self._slow

    def _same(self, load: float) -> bool:
        """Whether the load is that of the last comparison, within the factor from which on another is due."""
        return self._load / ANOTHER < load < self._load * ANOTHER

    def refutes(self, load: float) -> bool:
        """Whether the frame that was compared is not explained, and a frame with this load is as good as that one."""
        return self.refuted and self._same(load)

    def reaching(self, carried: Floats, load: float) -> float:
        """The share that brings two answers together, and the one without what a single solve adds (a force ``carried``) into the interval."""
        return math.hypot(self.share, float(np.abs(carried).max(initial=0.0)) / (REACH * max(load, 1e-300)))

    def begun(self, load: float) -> None:
        """A comparison has begun."""
        self._since, self._load = 0, load

    def settle(self, tracked: Answer, alone: Answer) -> bool:
        """Take in two answers of a frame; False where the tracker must begin anew first."""
        self.refuted = not alone.explained
        own = tracked.without(self.share)
        if not own.parted(alone):
            # the answers meet; the tracker's interval holds what the other road finds
            self.share = 0.0 if own.holds(alone) else self._reaching(own, alone)
            self.anew = False
            return True
        if not self.anew and not self.share:
            self.anew = True
            return False
        self.share, self.anew = self._reaching(tracked, alone), False
        return True

    @staticmethod
    def _reaching(tracked: Answer, alone: Answer) -> float:
        """The share with which half an interval of 95 % reaches from one answer to the other, and a little beyond."""
        gap = float(np.abs(tracked.force - alone.force).max())
        return gap / (REACH * max(tracked.load, 1e-300))

    def words(self, tracked: Answer, alone: Answer, unit: str) -> str:
        """What is said when the tracker begins anew."""
        both = (f"{a.force[-1]:.3g} ({a.low[-1]:.3g} to {a.high[-1]:.3g}) {unit}" for a in (tracked, alone))
        return f"{BEGUN} {', by itself '.join(both)}: it is begun anew"
