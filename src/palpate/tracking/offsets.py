"""Offsets of the channels: drift that all taxels of a channel share, told from contact by taxels away from it.

    readings = A t + B c + noise,    c ~ N(m, V),    m, V carried from frame to frame

B has a column of ones for each channel. c is a random walk (R. E. Kalman, J. Basic Eng. 82, 1960, 35-45) about a rate that is learned from
what each frame corrects (T. R. Benedict and G. W. Bordner, IRE Trans. Autom. Control 7, 1962, 27-32: b = a^2/(2 - a)). In each frame c is
marginalised,

    (s^2 + B V B')^-1 = s^-2 (1 - B K B'),    K = (s^2 V^-1 + B'B)^-1,

so that contact is solved for with what is known of the offsets, and no better. What a frame tells about them is what no contact on
those cells explains, W'y with

    W = B - A X,    X = (A'A + penalty / n)^-1 A'B,    var(W'y) = s^2 B'W:

the penalty is about the contact, which is the same in n frames, and what it leaves of a contact's shear must not add up to an offset. A
contact that covers the array tells nothing, and V grows. A model that is not quite right (a depth, a modulus) leaves something too, d, the
same in each frame of the same contact: it is a state of its own, and what was there when the contact came is d rather than c.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.linear.whitening import Readings
from palpate.tracking.health import Flags, Index, Single

__all__ = ["Marginal", "Observed", "Offsets"]

#: Standard deviation of an offset about its rate after a second, as a part of the largest reading met: a contact that covers the array is
#: known to 0.8 % after a minute.
WALK = 0.001
#: A rate of drift is confirmed by frames that correct an offset by this part of what they tell; else it is forgotten with this time constant [s].
CONFIRMED, RATE_HOLDS = 0.03, 5.0
#: Without contact, the part of what all taxels of a channel share that one frame corrects.
CORRECTED = 0.2
#: Beyond so long without a frame [s] a rate of drift is forgotten: 3 % of the largest reading a second, followed for a second in one step, left
#: an offset that became a contact for good.
GAP = 0.25
#: Largest reading over noise that is assumed until there was a contact.
USUAL = 100.0
#: Share of a frame in what is remembered of the largest reading.
USUAL_SHARE = 0.1
#: Without contact, the zero follows what all taxels of a channel share, at no more than this part of the largest reading a second: pressing
#: is faster.
FASTEST = 0.03
#: A pad is known, and readings agree with each other, to this part of the largest reading: noise of less does not make offsets surer.
AGREE = 0.003
#: What the model leaves of a channel, as a part of the largest reading; it is another for another load or place of the contact, which is
#: where readings have changed by this part.
MODEL, ANOTHER = 0.01, 0.1
#: An offset moves by no more than so many of its standard deviations in a frame: more is no drift.
SURPRISE = 3.0
#: Offsets after a restart of the sensor, as a part of the largest reading.
JUMP = 0.5
#: Offsets are marginalised where one is known to no better than this part of the largest reading; else only taken out, and their variance is left
#: to the error bars: contact of which a common part counts for less is shrunk by its penalty (1 N dragged to a slip of 0.6 read 0.55).
UNSURE = 0.02
#: K is made again where noise or variances have changed by this part.
ALIKE = 0.05
#: An offset is worth a word beyond this part of the largest reading.
NOTABLE = 0.02


class Marginal(NamedTuple):
    """What marginalising offsets takes: K (channel, channel), and the sums B'W'W y over the readings used."""

    gain: Floats
    sums: Floats


class _Gain(NamedTuple):
    gain: Floats
    noise: float
    counts: Floats
    cov: Floats


class Observed(NamedTuple):
    """What each frame of a contact tells about the offsets: B'W (channel, channel), X (channel, component, cell) on ``cells``, A'W (channel,
    component, cell of the surface), for the readings that are not ``unused``.
    """

    counts: Floats
    cells: Index
    solved: Floats
    crossed: Floats
    unused: Flags

    def innovation(self, sums: Floats, slope: Single, cells: Index, traction: Floats) -> Floats:
        """W'(y - A t) from the sums B'y, A'y and traction (component, cell) on some cells."""
        k = len(sums)
        contact = self.solved.reshape(k, -1) @ slope[:, self.cells].ravel()
        rest = self.crossed[:, :, cells].reshape(k, -1) @ traction.ravel()
        return np.asarray(sums - contact - rest, dtype=np.float64)


class Offsets:
    """Mean and covariance of the channels' offsets, in units of the readings' standard deviations."""

    def __init__(self, readings: Readings) -> None:
        self._readings = readings
        parts = [n for a, n in zip(readings.arrays, readings.sizes) for _ in a.channels]
        index = np.repeat(np.arange(len(parts)), parts)
        self.index = index
        self.columns = np.asarray(index[:, None] == np.arange(len(parts))[None, :], dtype=np.float64)
        self._unused: bytes | None = None
        self.reset()

    def reset(self) -> None:
        """As before the first frame."""
        self._largest = self._scale = 0.0
        self.rate: Floats = np.zeros(self.columns.shape[1])
        self._elapsed = 0.0
        self._share: Floats = np.zeros_like(self.rate)
        self.clear()

    def clear(self) -> None:
        """The zero is right."""
        k = self.columns.shape[1]
        self.mean: Floats = np.zeros(k)
        self._model: Floats = np.zeros(k)  # d
        self._both: Floats = np.zeros((2 * k, 2 * k))  # covariance of c and d
        self._reference: Floats | None = None  # readings that d belongs to
        self._unobserved = 0.0  # for how long no frame has observed them [s]
        self._gain: _Gain | None = None
        self._unused = None

    # -- what is known of them -------------------------------------------------------------------------------------------

    @property
    def cov(self) -> Floats:
        """Covariance V of the offsets (channel, channel)."""
        k = len(self.mean)
        return self._both[:k, :k]

    def state(self) -> tuple[Floats, ...]:
        """What `restore` needs."""
        return self.mean, self._model, self._both, self.rate

    def restore(self, state: tuple[Floats, ...]) -> None:
        """Take back what was learned since."""
        self.mean, self._model, self._both, self.rate = state

    def scale(self, noise: float | None, y: Floats) -> float:
        """The largest reading that is to be expected; until the noise is known, from the frame itself."""
        if self._largest > 0:
            return self._largest
        return float(np.abs(y).max(initial=0.0)) if noise is None else USUAL * noise

    def _level(self, noise: float) -> float:
        return math.hypot(noise, AGREE * max(self._largest, self._scale))

    def seen(self, y: Floats, noise: float) -> None:
        """Readings of a contact that was explained."""
        now = float(np.abs(y).max(initial=0.0))
        self._largest += (USUAL_SHARE if self._largest > 0 else 1.0) * (now - self._largest)
        other, before = 1.0, self._reference
        if before is not None:
            change = float(((y - before) ** 2).sum()) - 2.0 * len(y) * noise**2
            other = math.sqrt(max(change, 0.0) / max(float(before @ before), 1e-300))
        if before is None or other > ANOTHER:
            self._reference = y
            k = len(self.mean)
            both = self._both.copy()
            both[k:, k:] += (MODEL * now * min(other, 1.0)) ** 2 * np.eye(k)
            self._both = both

    def pass_time(self, elapsed: float, scale: float, *, observed: bool = True) -> None:
        """Offsets walk while time passes; ``observed``: whether the last frame told them."""
        self._scale, self._elapsed = scale, min(max(elapsed, 0.0), 1.0)
        self.rate = np.where(self._share > CONFIRMED, 1.0, math.exp(-self._elapsed / RATE_HOLDS)) * self.rate
        self._share = np.zeros_like(self.rate)
        self._unobserved = 0.0 if observed else self._unobserved + self._elapsed
        step = WALK * scale * math.sqrt(self._elapsed)
        k = len(self.mean)
        both = self._both.copy()
        both[:k, :k] += step**2 * np.eye(k)
        most = float(np.diagonal(both).max())
        if most > (JUMP * scale) ** 2:
            both = both * ((JUMP * scale) ** 2 / most)
        self._both = both

    def go_on(self, elapsed: float) -> None:
        """The offsets have gone on at their rate since the last frame; a rate is not known across a gap."""
        if elapsed > GAP:
            self.rate = np.zeros_like(self.rate)
        self.mean = self.mean + self.rate * max(elapsed, 0.0)

    def _corrected(self, by: Floats, share: Floats) -> None:
        """Learn the rate from what a frame corrects, ``share`` of what it tells."""
        self._share = share
        if self._elapsed > 0:
            most = FASTEST * self._scale
            since = max(self._elapsed, self._unobserved)
            self.rate = np.clip(self.rate + share / (2.0 - share) * by / since, -most, most)

    def jump(self) -> None:
        """Nothing is known of them any more: the sensor began anew."""
        k = len(self.mean)
        self._both = np.zeros((2 * k, 2 * k))
        self._both[:k, :k] = (JUMP * self._scale) ** 2 * np.eye(k)
        self._model, self.rate = np.zeros(k), np.zeros(k)

    def may_have_jumped(self, actual: Floats) -> bool:
        """Whether readings (NaN where missing) are no larger than a contact on a zero that jumped could make them."""
        largest = float(np.abs(actual[np.isfinite(actual)]).max(initial=0.0))
        return self._largest == 0 or largest <= (1.0 + 2.0 * JUMP) * self._largest

    def plausible(self, before: Floats) -> bool:
        """Whether the offsets have changed by no more than a zero may jump."""
        return bool((np.abs(self.mean - before) < JUMP * self._scale).all())

    def value(self) -> Floats:
        """The offset of each reading (reading,) that is taken out."""
        return np.asarray(self.mean[self.index])

    # -- one frame -------------------------------------------------------------------------------------------------------

    def counts(self, unused: Flags) -> Floats:
        """B'W'W B over the readings used, (channel, channel)."""
        key = unused.tobytes()
        if self._unused != key:
            used = ~unused
            self._white = np.zeros_like(self.columns)
            self._white[used] = self._readings.white(self.columns[used], used)
            self._counts = self._white.T @ self._white
            self._unused = key
        return self._counts

    def marginal(self, y: Floats, unused: Flags, noise: float) -> Marginal:
        """Of a frame less the mean offsets."""
        counts = self.counts(unused)
        if self._readings.independent:
            sums = np.asarray(self._white.T @ np.where(unused, 0.0, y))
        else:
            used = ~unused
            sums = np.asarray(self._white[used].T @ self._readings.white(y[used], used))
        kept, variance = self._gain, np.diagonal(self.cov)
        if variance.max() < (UNSURE * max(self._largest, self._scale)) ** 2:
            return Marginal(np.zeros_like(counts), sums)
        if (
            kept is None
            or not abs(noise - kept.noise) <= ALIKE * noise
            or kept.counts is not counts
            or not (np.abs(variance - np.diagonal(kept.cov)) <= ALIKE * variance.max()).all()
        ):
            # K = V (s^2 + N V)^-1
            gain = np.linalg.solve((self._level(noise) ** 2 * np.eye(len(counts)) + counts @ self.cov).T, self.cov.T).T
            kept = self._gain = _Gain(0.5 * (gain + gain.T), noise, counts, self.cov)
        return Marginal(kept.gain, sums)

    def update(self, counts: Floats, innovation: Floats, noise: float) -> None:
        """Take in a frame that tells B'W (channel, channel) and W'(y - A t) about them."""
        most = SURPRISE * np.sqrt(np.maximum(np.diagonal(self.cov), 0.0))
        k = len(self.mean)
        summed = self._both[:, :k] + self._both[:, k:]  # covariance with c + d, which is what shows
        weight = self._level(noise) ** 2 * np.eye(k) + counts @ (summed[:k] + summed[k:])
        gain = np.linalg.solve(weight.T, summed.T).T
        both = self._both - gain @ counts @ summed.T
        self._both = 0.5 * (both + both.T)
        change = gain @ (innovation - counts @ self._model)
        by = np.clip(change[:k], -most, most)
        self.mean, self._model = self.mean + by, self._model + change[k:]
        self._corrected(by, np.clip(np.diagonal(gain[:k] @ counts), 0.0, 1.0))

    def shared(self, y: Floats, unused: Flags) -> Floats:
        """What all taxels of each channel share: medians over the readings used, (channel,)."""
        out = np.zeros(len(self.mean))
        for c in range(len(out)):
            mine = y[(self.index == c) & ~unused]
            out[c] = np.median(mine) if len(mine) else 0.0
        return out

    def follow(self, y: Floats, unused: Flags) -> Floats:
        """Drift to take into the zero in a frame without contact (reading,)."""
        most, share = FASTEST * self._scale * self._elapsed, np.full(len(self.mean), CORRECTED)
        by = share * self.shared(y, unused)
        step = np.clip(self.rate * self._elapsed + by, -most, most)
        self._corrected(np.clip(by, -most, most), share)
        return np.asarray(step[self.index])

    def notable(self) -> Floats:
        """The offsets that are worth a word (0 elsewhere)."""
        if np.abs(self.mean).max() <= NOTABLE * self._scale:
            return np.zeros_like(self.mean)
        sure = np.abs(self.mean) > 4.0 * np.sqrt(np.maximum(np.diagonal(self.cov), 0.0))
        return np.where(sure & (np.abs(self.mean) > NOTABLE * self._scale), self.mean, 0.0)
