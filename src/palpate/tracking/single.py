"""Compare a tracker's result with a single solve of the same frame.

The tracker's result may depend on earlier frames: offsets, penalty, excluded readings. A single solve of the same
readings, with the same zero and its noise, does not. A single solve takes as long as the tracker takes for many
frames. So the tracker compares the two only when a contact begins, when the load has changed by the factor `ANOTHER`,
some frames after a comparison in which they differed, and otherwise after `AGAIN` frames (`Comparison.due`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.contact.again import Models, keeping
from palpate.inverse.contact.no_contact import WIDE
from palpate.sensing.zero import FRAMES_FOR_NOISE
from palpate.status import Status
from palpate.touch import Touch

__all__ = ["BEGUN", "Alone", "Answer", "Compared", "Comparison", "Single", "SingleSolve"]

#: Beginning of the note when a contact is restarted.
BEGUN = "tracked from frame to frame, this contact read"


class Single(NamedTuple):
    """A single solve: its touch, the models that later frames of the contact can be solved with, if there are any, and
    the notes about the contact.
    """

    touch: Touch
    models: Models | None
    notes: tuple[str, ...] = ()


class Compared(NamedTuple):
    """What the tracker answered to a frame, the net force (component,) by its own model, and the readings (reading,) minus
    their zero.
    """

    answer: Answer
    own: Floats
    readings: Floats


#: A function that solves readings minus their zero (one array per plane, NaN where missing), with the noise of frames at
#: rest (a list of the same), or the given noise times the factor by which that of the zero increases it; and which
#: readings are saturated (one array per plane).
Alone = Callable[[list[Floats], list[list[Floats]], float, Sequence[Floats]], Single]
#: The noise at rest is rounded up to powers of this, so that a prepared skin can be reused.
NOISE_STEP = 1.1
#: Largest change of the zero's share of the noise, a factor, with which a prepared skin is used again.
ZERO_STEP = 1.05
#: Smallest number of frames between two comparisons: SPACING for READINGS readings; DOUBTED if the last two results
#: differed; GROWING while the load changes. With one even penalty the tracker reads a small contact up to 60 % too high,
#: and presses of ten frames end before a longer wait does; an offset that appears looks like such a change.
SPACING, READINGS, DOUBTED, GROWING = 64, 200, 16, 4
#: Number of standard deviations assigned to the difference of two results that disagree: below 1.96, half of a 95 %
#: interval, so that the interval includes both.
REACH = 1.8
#: A load below this part of the difference cannot be widened to it.
LEAST_LOAD = 1e-6
#: A comparison is due after this many frames, if the load has changed by the factor ANOTHER (UNZEROED: if the stream has
#: not been at rest), or, DOUBTED frames after the last one, if the shear has changed by the part TURNED of the load:
#: drift of a shear channel looks like drag.
AGAIN, ANOTHER, UNZEROED, TURNED = 512, 2.0, 1.2, 0.25


class SingleSolve:
    """Solve readings minus their zero with a skin's default method, and the noise of frames at rest; an `Alone`."""

    def __init__(self, skin: Any, components: Sequence[str], friction: float | None) -> None:
        self._skin, self._components = skin, components
        self._options = {} if friction is None else {"friction": friction}
        self._made: tuple[tuple[float, ...], float, Any] | None = None  # noise at rest, factor of the zero, skin

    def __call__(
        self, readings: list[Floats], rest: list[list[Floats]], noisier: float = 1.0, saturated: Sequence[Floats] = ()
    ) -> Single:
        planes = self._skin.planes
        frames = [np.stack(parts) for parts in zip(*rest)] if len(rest) >= FRAMES_FOR_NOISE else []
        levels = [np.sqrt(np.nanmean(f[:, :, a.valid] ** 2, axis=(0, 2))) for f, a in zip(frames, planes)]
        known = bool(levels) and all((level > 0).all() for level in levels)
        steps = tuple(np.ceil(np.log(np.concatenate(levels)) / math.log(NOISE_STEP)).tolist()) if known else ()
        made = self._made
        if made is None or made[0] != steps or not made[1] / ZERO_STEP <= noisier <= made[1] * ZERO_STEP:
            made = self._made = steps, noisier, self._zeroed(NOISE_STEP ** np.array(steps), known, noisier)
        one = readings if len(readings) > 1 else readings[0]
        skin = made[2]
        if any(flags.any() for flags in saturated):
            limits = [_limits(part, flags) for part, flags in zip(readings, saturated)]
            skin = self._alone(skin, [replace(a, limits=each) for a, each in zip(skin.planes, limits)])
        with keeping() as kept:
            touch = skin.reconstruct(one, components=self._components, **self._options)
        return Single(touch, kept.models, kept.notes)

    def _zeroed(self, noise: Floats, known: bool, noisier: float) -> Any:
        """The skin with this noise (channel of all planes,), or the given noise times ``noisier``; without saturation
        limits, which apply to raw readings.
        """
        planes = []
        for a in self._skin.planes:
            mine, noise = noise[: len(a.channels)], noise[len(a.channels) :]
            given = None if a.noise_std is None else [noisier * std for std in a.noise_std]
            planes.append(replace(a, limits=None, noise=mine.tolist() if known and given is None else given))
        out = self._alone(self._skin, planes)
        out._problem.zeroed = known
        return out

    @staticmethod
    def _alone(skin: Any, planes: Sequence[Any]) -> Any:
        """The skin with other arrays, for the tracker's readings: in the unit of the pad, and some may be missing."""
        out = skin._with(skin.pad, planes)
        out._calibration, out._gaps = None, True
        return out


def _limits(readings: Floats, saturated: Floats) -> Floats:
    """Limits (channel, 2, *array) that saturated readings are at: the upper one if they are positive."""
    low = np.where(saturated.astype(bool) & (readings < 0), readings, -math.inf)
    high = np.where(saturated.astype(bool) & (readings > 0), readings, math.inf)
    return np.stack([low, high], axis=1)


@dataclass(frozen=True)
class Answer:
    """Net force (component,) with its 95 % interval (NaN: unknown), whether readings are explained, total load.

    ``decided`` is False for a result that has bounds but no number; ``force`` is then their middle.
    """

    force: Floats
    low: Floats
    high: Floats
    explained: bool
    load: float
    decided: bool = True

    @classmethod
    def of(cls, touch: Touch) -> Answer:
        """Extract these values from a touch."""
        status = Status.SOLVED if touch.status is None else Status.coded(int(touch.status))
        force = to_numpy(touch.force).astype(np.float64)
        low, high = (np.full_like(force, math.nan),) * 2
        if status.known and touch.has_intervals:
            low, high = (np.asarray(to_numpy(end), dtype=np.float64) for end in touch.interval(0.95, "force"))
        size = np.sqrt((to_numpy(touch.values).astype(np.float64) ** 2).sum(axis=0))
        decided = bool(np.isfinite(force).all())
        if not decided:
            with np.errstate(invalid="ignore"):  # NaN if neither end is known
                force = 0.5 * (low + high)
        return cls(
            force,
            low,
            high,
            status.known and status is not Status.UNEXPLAINED and bool(np.isfinite(force).all()),
            float(touch.surface.integral(size)) if decided else 0.0,
            decided,
        )

    def without(self, share: float) -> Answer:
        """The result without the part of its interval that an error of ``share`` times the load causes."""
        room = (WIDE * share * self.load) ** 2
        low = self.force - np.sqrt(np.maximum((self.force - self.low) ** 2 - room, 0.0))
        high = self.force + np.sqrt(np.maximum((self.high - self.force) ** 2 - room, 0.0))
        return replace(self, low=low, high=high)

    def holds(self, other: Answer) -> bool:
        """Whether the interval contains the other result; True if one of them is unknown."""
        if not (self.explained and other.explained):
            return True
        with np.errstate(invalid="ignore"):
            return not bool(((other.force < self.low) | (other.force > self.high)).any())

    def beyond(self, other: Answer) -> float:
        """How far the finite ends of the other interval lie from this force: the largest distance of a component."""
        gaps = np.abs(np.stack([other.low, other.high]) - self.force)
        return float(gaps[np.isfinite(gaps)].max(initial=0.0)) if self.explained and other.explained else 0.0

    def meets(self, other: Answer) -> bool:
        """Whether this is a number, and the intervals are not disjoint."""
        return self.explained and self.decided and not other.parted(self)

    def parted(self, other: Answer) -> bool:
        """Whether the intervals of two results are disjoint; False if one of them is unknown."""
        if not (self.explained and other.explained):
            return False
        with np.errstate(invalid="ignore"):
            return bool(((self.low > other.high) | (other.low > self.high)).any())


class Comparison:
    """Decides when to compare a tracker's result with a single solve, and keeps the outcome.

    ``share`` is the error (standard deviation, as a fraction of the load) that makes the two results agree;
    ``refuted``: the single solve does not explain the frame. ``rested``: whether frames at rest have shown the zero; if
    not, an offset may pass for a wide contact, so that a smaller change of the load is compared.
    """

    def __init__(self, readings: int, *, rested: bool) -> None:
        self.rested, self._unzeroed = rested, 0.0  # and how far the single solve's interval reached from the force
        self._slow = max(readings / READINGS, 1.0)
        self._since = math.inf
        self._load = math.nan  # at the last comparison of this contact
        self._shear: Floats = np.zeros(1)  # the same
        self.share, self.refuted = 0.0, False
        self.anew = False  # whether the tracker has just restarted

    def release(self) -> None:
        """Forget the load: the contact has ended."""
        self._load = math.nan

    def due(self, load: float, shear: Floats, *, stale: bool = False, missing: bool = False) -> bool:
        """Whether to compare a frame with this load and shear (component,); call it once a frame. ``stale``: the models of
        the last single solve do not explain it, or its load has outgrown them; ``missing``: it had none that can be used.
        """
        self._since += 1
        turned = float(np.linalg.norm(shear - self._shear)) / max(load, 1e-300)
        doubted = self.share > 0.0 or self.refuted or self.anew or missing or turned > TURNED
        same = self._same(load) and turned < ANOTHER - 1.0 and not stale
        if self._since < (GROWING if not same else DOUBTED if doubted else SPACING) * self._slow:
            return False
        return doubted or not same or self._since >= AGAIN * self._slow

    def _same(self, load: float) -> bool:
        """Whether the load is close to that of the last comparison."""
        factor = ANOTHER if self.rested else UNZEROED
        return self._load / factor < load < self._load * factor

    def refutes(self, load: float) -> bool:
        """Whether the compared frame was unexplained, and this load is similar to its load."""
        return self.refuted and self._same(load)

    def reaching(self, apart: float, load: float) -> float:
        """The share that makes two results agree and reaches as far as the force ``apart``; before a rest, as far as the
        interval of the single solve.
        """
        force = apart + (0.0 if self.rested else self._unzeroed)
        return math.hypot(self.share, force / (REACH * max(load, 1e-300)))

    def begun(self, load: float, shear: Floats) -> None:
        """Record that a comparison has begun."""
        self._since, self._load, self._shear = 0, load, shear

    def settle(self, tracked: Answer, alone: Answer) -> bool:
        """Process the two results of a frame; False if the tracker must restart first."""
        self.refuted = not alone.explained
        own = tracked.without(self.reaching(0.0, tracked.load))
        self._unzeroed = own.beyond(alone)
        if not own.parted(alone):
            # The results agree; widen the tracker's interval to contain the single solve's force.
            self.share = 0.0 if own.holds(alone) else self._reaching(own, alone)
            self.anew = False
            return True
        if not self.anew and not (self.share and self.rested):
            self.anew = True
            return False
        self.share, self.anew = self._reaching(tracked, alone), False
        return True

    @staticmethod
    def _reaching(tracked: Answer, alone: Answer) -> float:
        """The error, as a fraction of the load (standard deviation), for which half of a 95 % interval just exceeds the
        largest difference between two results in a force component.
        """
        gap = float(np.abs(tracked.force - alone.force).max())
        return gap / (REACH * max(tracked.load, LEAST_LOAD * gap, 1e-300))

    def words(self, tracked: Answer, alone: Answer, unit: str) -> str:
        """Note when the tracker restarts a contact: the last component of both forces, with intervals and ``unit``."""
        both = (f"{a.force[-1]:.3g} ({a.low[-1]:.3g} to {a.high[-1]:.3g}) {unit}" for a in (tracked, alone))
        return f"{BEGUN} {', from this frame alone '.join(both)}: the tracker restarts the contact"
