"""Offsets of the channels: drift common to all taxels of a channel, separated from contact by taxels away from it.

    readings = A t + B c + noise,    c ~ N(m, V),    m, V carried from frame to frame

B has a column of ones for each channel. c is a random walk (R. E. Kalman, J. Basic Eng. 82, 1960, 35-45) about a rate
that is learned from the correction in each frame (T. R. Benedict and G. W. Bordner, IRE Trans. Autom. Control 7, 1962,
27-32: b = a^2/(2 - a)). In each frame c is marginalised,

    (s^2 + B V B')^-1 = s^-2 (1 - B K B'),    K = (s^2 V^-1 + B'B)^-1,

so that the contact is solved with the present uncertainty of the offsets. Only the part of the readings y that no
traction on the cells in contact explains tells about the offsets. It is W'y with

    W = B - A X,    X = (A'A + penalty / n)^-1 A'B,    var(W'y) = s^2 B'W.

A contact stays the same for about n frames (`SAME` in `palpate.tracking.errors`), so that each of them has only an n-th
of its penalty. With the whole penalty in each frame, the shear that the penalty removes from the contact would be
taken for an offset, and this offset would grow from frame to frame. A contact that covers the array gives no
information, and V grows. An inexact model (depth, modulus) adds a residual d that is the same in each frame of one
contact. d is a state of its own: an offset that appears together with a contact is assigned to d rather than to c.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.sensing.arrays import Array
from palpate.sensing.nuisance import nuisances
from palpate.touch import Touch
from palpate.tracking.health import Flags, Index

__all__ = ["Marginal", "Observed", "Offsets"]

#: Random walk of an offset about its rate: standard deviation after a second, as a fraction of the largest reading.
#: After a minute under a contact that covers the array, the offset is known to 0.8 %.
WALK = 0.001
#: A rate of drift is confirmed by frames that correct an offset by this fraction of their information; otherwise it
#: decays with this time constant [s].
CONFIRMED, RATE_HOLDS = 0.03, 5.0
#: Without contact, the fraction of the common offset of a channel that one frame corrects.
CORRECTED = 0.2
#: After a gap this long [s] without a frame, forget the rate of drift: 3 % of the largest reading per second,
#: extrapolated over a second, left an offset that became a permanent contact.
GAP = 0.25
#: Assumed ratio of largest reading to noise before the first contact.
USUAL = 100.0
#: Weight of a new frame in the running average of the largest reading.
USUAL_SHARE = 0.1
#: Without contact, the zero follows the common offset of a channel by at most this fraction of the largest reading per
#: second: pressing is faster.
FASTEST = 0.03
#: Accuracy of pad and readings as a fraction of the largest reading: a lower noise does not make offsets more certain.
AGREE = 0.003
#: Model error of a channel as a fraction of the largest reading; it changes when the contact changes load or place,
#: that is when readings change by the fraction ANOTHER.
MODEL, ANOTHER = 0.01, 0.1
#: Largest change of an offset in one frame, in its standard deviations: more is not drift.
SURPRISE = 3.0
#: Marginalise offsets only if one is less certain than this fraction of the largest reading. Otherwise just subtract
#: them and add their variance to the error bars: marginalising weakens the common part of the contact, which the
#: penalty then shrinks (1 N dragged to a slip of 0.6 read 0.55).
UNSURE = 0.02
#: Report an offset beyond this fraction of the largest reading.
NOTABLE = 0.02


class Marginal(NamedTuple):
    """Quantities that marginalise offsets: the gain K (channel, channel), and the sums (channel,) of the products of B
    with the readings in use, both whitened.
    """

    gain: Floats
    sums: Floats


class Observed(NamedTuple):
    """Information about the offsets in each frame of a contact: B'W (channel, channel), X (channel, component, cell)
    on ``cells``, A'W (channel, component, cell of the surface), for the readings that are not ``unused``.
    """

    counts: Floats
    cells: Index
    solved: Floats
    crossed: Floats
    unused: Flags

    def innovation(self, sums: Floats, slope: Floats, cells: Index, traction: Floats) -> Floats:
        """W'(y - A t) from the sums B'y, A'y and traction (component, cell) on some cells."""
        k = len(sums)
        contact = self.solved.reshape(k, -1) @ slope[:, self.cells].ravel()
        rest = self.crossed[:, :, cells].reshape(k, -1) @ traction.ravel()
        return np.asarray(sums - contact - rest, dtype=np.float64)


class Offsets:
    """Mean and covariance of the channels' offsets, in units of the readings' standard deviations."""

    def __init__(self, estimator: ConstrainedEstimator) -> None:
        self._readings, self.index = estimator.readings, estimator.noise.index
        self.columns: Floats = np.eye(estimator.noise.count)[self.index]
        self._unused: bytes | None = None
        self.reset()

    def reset(self) -> None:
        """Restore the state before the first frame."""
        self._largest = self._scale = 0.0
        self.rate: Floats = np.zeros(self.columns.shape[1])
        self._elapsed = 0.0
        self._share: Floats = np.zeros_like(self.rate)
        self.clear()

    def clear(self) -> None:
        """Set the offsets to zero, with certainty."""
        k = self.columns.shape[1]
        self.mean: Floats = np.zeros(k)
        self._model: Floats = np.zeros(k)  # d
        self._both: Floats = np.zeros((2 * k, 2 * k))  # covariance of c and d
        self._reference: Floats | None = None  # readings for which d was estimated
        self._unobserved = 0.0  # time without information about the offsets [s]
        self._unused = None

    def forget(self) -> None:
        """Forget the offsets and the rate of their drift."""
        self.clear()
        self.rate = np.zeros_like(self.rate)

    # -- present knowledge
    # ----------------------------------------------------------------------------------------------

    @property
    def cov(self) -> Floats:
        """Covariance V of the offsets (channel, channel)."""
        k = len(self.mean)
        return self._both[:k, :k]

    def scale(self, noise: float | None, y: Floats) -> float:
        """Expected largest reading; until the noise is known, from the frame itself."""
        if self._largest > 0:
            return self._largest
        return float(np.abs(y).max(initial=0.0)) if noise is None else USUAL * noise

    def _level(self, noise: float) -> float:
        return math.hypot(noise, AGREE * max(self._largest, self._scale))

    def seen(self, y: Floats, noise: float) -> None:
        """Record the readings of a contact that fits."""
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
        """Let offsets drift over ``elapsed`` seconds; ``observed``: whether the last frame told about them."""
        self._scale, self._elapsed = scale, min(max(elapsed, 0.0), 1.0)
        self.rate = np.where(self._share > CONFIRMED, 1.0, math.exp(-self._elapsed / RATE_HOLDS)) * self.rate
        self._share = np.zeros_like(self.rate)
        self._unobserved = 0.0 if observed else self._unobserved + self._elapsed
        step = WALK * scale * math.sqrt(self._elapsed)
        k = len(self.mean)
        both = self._both.copy()
        both[:k, :k] += step**2 * np.eye(k)
        self._both = both

    def go_on(self, elapsed: float) -> None:
        """Extrapolate the offsets at their rate since the last frame; forget the rate after a gap."""
        if elapsed > GAP:
            self.rate = np.zeros_like(self.rate)
        self.mean = self.mean + self.rate * max(elapsed, 0.0)

    def _corrected(self, by: Floats, share: Floats) -> None:
        """Learn the rate from the correction ``by`` in a frame, made with the gain ``share``."""
        self._share = share
        if self._elapsed > 0:
            most = FASTEST * self._scale
            since = max(self._elapsed, self._unobserved)
            self.rate = np.clip(self.rate + share / (2.0 - share) * by / since, -most, most)

    def take(self, alone: Touch, planes: Sequence[Array], std: Floats) -> None:
        """Take the offsets, and their errors, that a single solve of readings with the units ``std`` (reading,) found, if
        it found any.
        """
        labels = [n.label for n in nuisances(planes, ["offset"])]
        names = [name for name, _ in alone.nuisance_names]
        if alone.nuisance is None or alone.nuisance_std is None or not set(labels) <= set(names):
            return
        chosen, unit = (
            [names.index(label) for label in labels],
            std[np.searchsorted(self.index, np.arange(len(labels)))],
        )
        sizes = to_numpy(alone.nuisance)[chosen]
        if not (np.isfinite(sizes).all() and sizes.any()):
            return
        k = len(labels)
        self.clear()  # the model error of this contact may hold a part of them
        self.mean = np.asarray(sizes / unit, dtype=np.float64)
        self._both[:k, :k] = np.diag((to_numpy(alone.nuisance_std)[chosen] / unit) ** 2)

    def beyond(self, noise: float | None) -> bool:
        """Whether an offset exceeds the noise."""
        return float(np.abs(self.mean).max(initial=0.0)) > (noise or 0.0)

    def value(self) -> Floats:
        """The offset to subtract from each reading (reading,)."""
        return np.asarray(self.mean[self.index])

    # -- one frame
    # -------------------------------------------------------------------------------------------------------

    def counts(self, unused: Flags) -> Floats:
        """B'W'W B over the readings in use, (channel, channel)."""
        key = unused.tobytes()
        if self._unused != key:
            used = ~unused
            self._white = np.zeros_like(self.columns)
            self._white[used] = self._readings.white(self.columns[used], used)
            self._counts = self._white.T @ self._white
            self._unused = key
        return self._counts

    def marginal(self, y: Floats, unused: Flags, noise: float) -> Marginal:
        """Marginal of a frame minus the mean offsets."""
        counts = self.counts(unused)
        used = ~unused
        sums = np.asarray(self._white[used].T @ self._readings.white(y[used], used))
        if np.diagonal(self.cov).max() < (UNSURE * max(self._largest, self._scale)) ** 2:
            return Marginal(np.zeros_like(counts), sums)
        # K = V (s^2 + N V)^-1
        gain = np.linalg.solve((self._level(noise) ** 2 * np.eye(len(counts)) + counts @ self.cov).T, self.cov.T).T
        return Marginal(0.5 * (gain + gain.T), sums)

    def update(self, counts: Floats, innovation: Floats, noise: float) -> None:
        """Kalman update with a frame's information B'W (channel, channel) and innovation W'(y - A t)."""
        most = SURPRISE * np.sqrt(np.maximum(np.diagonal(self.cov), 0.0))
        k = len(self.mean)
        summed = self._both[:, :k] + self._both[:, k:]  # covariance with c + d, which is observed
        weight = self._level(noise) ** 2 * np.eye(k) + counts @ (summed[:k] + summed[k:])
        gain = np.linalg.solve(weight.T, summed.T).T
        both = self._both - gain @ counts @ summed.T
        self._both = 0.5 * (both + both.T)
        change = gain @ (innovation - counts @ self._model)
        by = np.clip(change[:k], -most, most)
        self.mean, self._model = self.mean + by, self._model + change[k:]
        self._corrected(by, np.clip(np.diagonal(gain[:k] @ counts), 0.0, 1.0))

    def shared(self, y: Floats, unused: Flags) -> Floats:
        """Common offset of the taxels of each channel: medians over the readings in use, (channel,)."""
        out = np.zeros(len(self.mean))
        for c in range(len(out)):
            mine = y[(self.index == c) & ~unused]
            out[c] = np.median(mine) if len(mine) else 0.0
        return out

    def follow(self, y: Floats, unused: Flags) -> Floats:
        """Drift to add to the zero after a frame without contact (reading,)."""
        most, share = FASTEST * self._scale * self._elapsed, np.full(len(self.mean), CORRECTED)
        by = share * self.shared(y, unused)
        step = np.clip(self.rate * self._elapsed + by, -most, most)
        self._corrected(np.clip(by, -most, most), share)
        return np.asarray(step[self.index])

    def notable(self) -> Floats:
        """The offsets large enough to report (0 for the others)."""
        if np.abs(self.mean).max() <= NOTABLE * self._scale:
            return np.zeros_like(self.mean)
        sure = np.abs(self.mean) > 4.0 * np.sqrt(np.maximum(np.diagonal(self.cov), 0.0))
        return np.where(sure & (np.abs(self.mean) > NOTABLE * self._scale), self.mean, 0.0)
