"""Bad readings: count them, exclude them, and use them again when they are good."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.policy import Policy
from palpate.sensing.limits import at_ends

__all__ = ["ENOUGH", "Flags", "Float32", "Health", "Index", "ReadingCheck", "clipped"]

#: Same values as in the contact method.
FAR, MOVED = Policy().screening.deviations, Policy().screening.moved

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]
Float32 = npt.NDArray[np.float32]

#: Consecutive bad frames (or checks) after which a reading is excluded; a glitch of a frame or two is none. It returns
#: after eight times as many good ones, so that a loose contact does not come and go.
BAD, GOOD = 5, 40
#: Frames for which a reading, or the whole sensor, may repeat itself exactly: a quarter of a second at 200 Hz.
STUCK = 50
#: A reading is stuck if its run of repeats is, at the rate it repeated before, less probable than this per frame ...
CHANCE = 1e-6
#: ... after at least BEFORE frames, with at least FEWEST_REPEATS repeats, ...
BEFORE, FEWEST_REPEATS = 20, 3
#: ... and a run this many times longer than that of most readings: a coarse converter repeats itself everywhere.
ALONE = 5
#: A reading is at rest if it is below this fraction of the largest.
RESTING = 0.01
#: A sensor counts as frozen only if at most this fraction of its earlier frames repeated themselves.
SELDOM = 0.1
#: A channel is saturated if at least CEILING readings share its largest value, and at least this fraction of the others
#: differ.
CEILING, ALIKE = 2, 0.9
#: Above this fraction of saturated readings in a channel, the others do not determine the load. For balls on 6 x 6 and
#: 10 x 10 taxels, the truth was above the interval in none of 16 frames with up to 15 % saturated, in one of 6 with up
#: to 25 %, and on 8 x 8 in one with 19 %.
MOST_CLIPPED = 0.15
#: A frame is solved if at least this fraction of the readings is finite, in range and in use; with half of the taxels
#: the spacing is 1.4 times as wide.
ENOUGH = 0.5


@dataclass
class Health:
    """Counts of the frames so far, and the state of the taxels.

    ``str()`` gives a summary. ``frames``: received; ``late``: with the time of the frame before; ``restarts``: with an
    earlier time, because the sensor's clock restarted; ``unknown``: without a result (see `Status`); ``approximate``:
    result before the tolerance was reached; ``repeated``: identical to the frame before, bit by bit; ``rezeroed``:
    frames in which the zero followed drift. ``left_out`` (reading) is True for readings that are not used now, with
    ``reasons`` (reading): "", "missing", "stuck", "out of range" or "unexplained"; ``label`` names a reading.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=5, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
    >>> tracker = skin.track()
    >>> for _ in range(3):
    ...     touch = tracker.step([[0.0] * 5] * 2, time=0.5)  # always the same time
    >>> tracker.health.frames, tracker.health.late
    (3, 2)
    """

    frames: int = 0
    late: int = 0
    restarts: int = 0
    unknown: int = 0
    approximate: int = 0
    repeated: int = 0
    rezeroed: int = 0
    left_out: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool), repr=False)
    reasons: npt.NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, dtype="<U12"), repr=False)
    label: Callable[[int], str] = field(default=str, repr=False)

    def __str__(self) -> str:
        rows = np.flatnonzero(self.left_out)
        named = [f"{self.label(int(r))} ({self.reasons[r]})" for r in rows[:8]]
        if len(rows) > 8:
            named.append(f"{len(rows) - 8} more")
        return (
            f"{self.frames} frames, {self.late} late, {self.approximate} approximate, {self.repeated} repeated, "
            f"{self.unknown} unknown, {self.restarts} restarts of the clock; left out: {', '.join(named) or 'none'}"
        )


def clipped(flat: Floats, index: npt.NDArray[np.intp], far: Flags) -> Flags:
    """Mask of saturated readings: several of one channel (``index``) have exactly its largest magnitude, while few
    others are equal; or most of them have it, ``far`` from a known zero.

    A coarse converter repeats values everywhere, a saturated one only at its ends.
    """
    out = np.zeros(len(flat), dtype=bool)
    finite = np.isfinite(flat)
    came = np.where(finite, flat, 0.0)
    starts = np.searchsorted(index, np.arange(int(index[-1]) + 1))
    for extreme in (np.maximum, np.minimum):
        ends = extreme.reduceat(came, starts)
        at = came == ends[index]
        for channel in np.flatnonzero((ends != 0.0) & (np.add.reduceat(at, starts, dtype=np.intp) >= CEILING)):
            mine = (index == channel) & finite
            others = came[mine & ~at]
            differ = not others.size or len(np.unique(others)) > ALIKE * len(others)
            if differ and ((mine & at).sum() <= ENOUGH * mine.sum() or far[mine & at].all()):
                out |= mine & at
    return out


class ReadingCheck:
    """Decides frame by frame which readings are used; records its findings in a `Health`.

    ``limits`` (reading) are the largest magnitudes that the pad can cause, ``ends`` the low and high limits of each
    reading's range if given; ``std`` is the unit of readings minus their zero.
    """

    def __init__(
        self, health: Health, limits: Floats, ends: tuple[Floats, Floats] | None = None, std: Floats | float = 1.0
    ) -> None:
        n = len(limits)
        self.health, self._limits, self._ends, self._std = health, limits, ends, std
        self._bad = np.zeros(n, dtype=np.int32)  # bad frames in a row; negative: good ones
        self._gone = np.zeros(n, dtype=np.int32)  # frames in a row in which a reading was missing or out of range
        self._repeats = np.zeros(n, dtype=np.int32)
        self._repeated, self._compared = (
            np.zeros(n, dtype=np.int64),
            0,
        )  # repeats, and frames in which not all readings repeated
        self._stuck = np.zeros(n, dtype=bool)
        self._resting = np.zeros(n, dtype=bool)  # next to their zero in the last frame
        self._last: Floats | None = None
        self._frames_repeated = 0  # whole frames in a row that repeated themselves
        self._uniform, self._uniforms = False, 0  # whether all readings of the last frame are one number; such frames
        self._absent = np.zeros(n, dtype=bool)  # not usable in this frame, besides those left out
        self.suspects = np.zeros(n, dtype=bool)  # not explained at the last look
        self.clipped = np.zeros(n, dtype=bool)  # at a given or evident end of their range in this frame
        self.overload = False  # whether so many are that the load has no upper end

    @property
    def unused(self) -> Flags:
        """Readings not used in this frame."""
        return self.health.left_out | self._absent | self.suspects

    def usable(self, flat: Floats) -> Flags:
        """Mask of the readings that are finite and in range; also counts the others, and those that repeat themselves."""
        health = self.health
        finite = np.isfinite(flat)
        with np.errstate(invalid="ignore"):
            wild = finite & (np.abs(flat) > self._limits)
        gone = ~finite | wild
        whole = bool((gone & ~health.left_out).mean() > 1.0 - ENOUGH)  # the sensor fails as a whole, not single taxels
        if not whole:
            self._gone = np.where(gone, self._gone + 1, 0)
            self._bad[gone & health.left_out] += 1
            self._leave_out(~finite & (self._gone >= BAD), "missing")
            self._leave_out(wild & (self._gone >= BAD), "out of range")
        self._uniform = len(flat) >= FEWEST_REPEATS and bool((flat == flat[0]).all())
        self._uniforms += self._uniform
        if self._last is not None:
            same = flat == self._last
            if same.all() or np.array_equal(flat, self._last, equal_nan=True):
                health.repeated += 1
                self._frames_repeated += 1
            else:
                self._frames_repeated = 0
                self._repeats = np.where(same, self._repeats + 1, 0)
                self._compared += 1
                self._repeated += same
                self._stuck = self._stand_still() & finite & ~wild
                self.count(self._stuck, "stuck")
        self._last = flat
        # An excluded reading returns after many good frames.
        settled = finite & ~wild & (self._repeats == 0)
        if health.left_out.any():
            again = settled & health.left_out & (health.reasons != "unexplained")
            self._bad = np.where(again, self._bad - 1, self._bad)
            back = health.left_out & (self._bad <= -GOOD)
            health.left_out[back], health.reasons[back], self._bad[back] = False, "", 0
        return ~gone & ~self._stuck

    def _stand_still(self) -> Flags:
        """Mask of stuck readings: they repeat themselves, which they seldom did before, while others still change."""
        if self._repeats.max() < FEWEST_REPEATS:
            return np.zeros(len(self._repeats), dtype=bool)
        before = self._compared - self._repeats
        rate = (self._repeated - self._repeats + 1.0) / (before + 2.0)
        often = (self._repeats * np.log(rate) < math.log(CHANCE)) & (before >= BEFORE)
        # A saturated reading repeats itself for that reason, and a coarse sensor may repeat its zero.
        return often & (self._repeats > ALONE * np.median(self._repeats)) & ~self.clipped & ~self._resting

    @property
    def unexplained(self) -> Flags:
        """Readings that are excluded because no contact explains them."""
        return self.health.left_out & (self.health.reasons == "unexplained")

    @property
    def lacks(self) -> Flags:
        """Readings that are excluded for another reason."""
        return self.health.left_out & (self.health.reasons != "unexplained")

    def present(self, readings: Floats) -> Floats:
        """The same readings; notes which the frame lacks. `zeroed` does it anew for frames that are solved."""
        self._absent = ~np.isfinite(readings) & ~self.health.left_out
        return readings

    def enough(self, usable: Flags) -> bool:
        """Whether enough readings are usable to solve the frame."""
        return bool((usable & ~self.health.left_out).sum() >= max(1.0, ENOUGH * len(usable)))

    def zeroed(self, y: Floats, flat: Floats, index: npt.NDArray[np.intp], noise: float) -> Floats:
        """A frame with 0 for unused readings. Saturation is found in the original readings (``flat``), far above the
        ``noise``.
        """
        high, low = at_ends(flat, self._ends, y * self._std)
        self._uniform &= bool(np.nan_to_num(y).any())  # the zero itself is no failure
        size = np.abs(y)
        self.clipped = clipped(flat, index, (size > MOVED * noise) & (y * self._std != flat)) | high | low
        self.clipped &= np.isfinite(y)  # a reading that is out of range has no value, not even as a bound
        self._resting = size < RESTING * float(size[np.isfinite(size)].max(initial=0.0))
        came = np.bincount(index, np.isfinite(flat))
        # At rest, coarsely rounded readings are often equal; so saturation counts only far from zero.
        at_end = high | low | (self.clipped & (size > FAR * noise))
        same = self.clipped & (size > MOVED * noise)
        shares = [np.bincount(index, flags) / np.maximum(came, 1) for flags in (at_end, same)]
        self.overload = bool((shares[0] > MOST_CLIPPED).any() or (shares[1] > ENOUGH).any())
        # If few readings are saturated, the others determine them. If many are, use their values as lower bounds.
        absent = ~np.isfinite(y) if self.overload else ~np.isfinite(y) | self.clipped
        self._absent = absent & ~self.health.left_out
        return self.used(y)

    def used(self, y: Floats) -> Floats:
        """A frame with 0 for unused readings."""
        return np.where(self.unused, 0.0, y)

    def count(self, bad: Flags, reason: str) -> None:
        """Count these readings as bad once more, and exclude those that were bad too often."""
        self._bad[bad] = np.maximum(self._bad[bad], 0) + 1
        self._leave_out(bad & (self._bad >= BAD), reason)

    def judge(self, wrong: Flags, rest: Floats, limit: float, frames: int) -> None:
        """Count readings that the contact does not fit; ``rest`` is the residual of each, checked once in ``frames``
        frames.

        They are suspects, and not used, until the next check.
        """
        self.count(wrong, "unexplained")
        right = ~wrong & ~self.unused & (self._repeats == 0)
        self._bad[right] = np.minimum(self._bad[right], 0)
        self.suspects = wrong & ~self.health.left_out
        self.forgive(np.abs(rest) < limit, frames)

    def pardon(self) -> None:
        """Use all readings again that were excluded as unexplained."""
        health, doubted = self.health, self.unexplained
        health.left_out[doubted], health.reasons[doubted], self._bad[doubted] = False, "", 0
        self.suspects[:] = False

    def forgive(self, right: Flags, frames: int) -> None:
        """Use readings again that were excluded as unexplained and have been good for long enough."""
        health, doubted = self.health, self.unexplained
        if doubted.any():
            good = right[doubted]
            self._bad[doubted] = np.where(good, np.minimum(self._bad[doubted], 0) - frames, BAD)
            back = doubted & (self._bad <= -GOOD)
            health.left_out[back], health.reasons[back], self._bad[back] = False, "", 0

    @property
    def frozen(self) -> bool:
        """Whether all readings repeat themselves, or are one number, which they seldom did before."""
        health = self.health
        earlier = health.frames - 1 - self._frames_repeated
        repeats = self._frames_repeated >= STUCK and health.repeated - self._frames_repeated < SELDOM * earlier
        seldom = earlier >= BEFORE and self._uniforms - self._frames_repeated - 1 < SELDOM * earlier
        return repeats or (self._uniform and seldom)

    def _leave_out(self, bad: Flags, reason: str) -> None:
        health = self.health
        new = bad & ~health.left_out
        self._bad[new] = BAD
        health.left_out[new], health.reasons[new] = True, reason
        self._absent &= ~new
