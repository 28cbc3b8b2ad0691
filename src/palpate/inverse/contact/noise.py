"""Noise of a frame, estimated from the residual of the contact; outliers."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.constrained.variances import taken_of_each
from palpate.inverse.contact.policy import Policy
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.operator import Operator

__all__ = ["ChannelNoise"]

Flags = npt.NDArray[np.bool_]

#: Median of |x| of a standard Gaussian.
MEDIAN = 0.6745


class ChannelNoise:
    """Noise level of each channel. ``index`` (reading,) is the channel of each working reading."""

    def __init__(self, operator: Operator, readings: Readings, known: bool, policy: Policy) -> None:
        self.readings, self.known, self.policy = readings, known, policy
        self.index = np.repeat(
            np.arange(sum(len(a.channels) for a in operator.planes_of)),
            [n for a, n in zip(operator.planes_of, readings.sizes) for _ in a.channels],
        )
        self.count = int(self.index[-1]) + 1

    def alive(self, data: Floats) -> Flags:
        """False for readings of a broken channel: all its values are equal while other channels vary."""
        same = self._same(data)
        return np.asarray(~same[self.index] if not same.all() else np.ones(len(data), dtype=bool))

    def _same(self, data: Floats) -> Flags:
        """Mask of the channels (channel,) whose values are all equal."""
        ends = np.searchsorted(self.index, np.arange(self.count + 1))
        fewest = self.policy.noise.fewest
        return np.array([b - a > fewest and np.ptp(data[a:b]) == 0 for a, b in itertools.pairwise(ends)])

    def unlike(self, data: Floats) -> Floats:
        """The readings, with a trace of noise added if every channel has a single constant value. Otherwise an offset
        would fit them exactly, and the residual would be divided by zero.
        """
        if not self._same(data).all():
            return data
        trace = self.policy.work.trace * np.random.default_rng(1).standard_normal(len(data))
        return np.asarray(data * (1.0 + trace))

    def uneven(self, data: Floats, observed: Flags, known: float | None) -> float:
        """Log likelihood gained by one noise level per channel instead of one common level, if the readings are noise
        alone. ``known`` is the common level in units of the readings' standard deviations; None: from the readings.

        A contact is accepted only if its log evidence exceeds this gain (`score.more_than_noise`): channels whose noise
        is unequal must not look like contact.
        """
        if self.known or self.count == 1 or not self.policy.parts.uneven_evidence:
            return 0.0
        channel = self.index[observed]
        white = self.readings.whitened(data, observed)
        power, count = np.bincount(channel, white**2), np.bincount(channel)
        power, count = power[power > 0], count[power > 0]
        if not len(power) or (count < self.policy.noise.fewest).any():
            return 0.0
        common = power.sum() / count.sum() if known is None else known**2
        own = power / count
        return 0.5 * float((power / common - count + count * np.log(common / own)).sum())

    def levels(
        self, member: ContactModel, y: Floats, noise: Floats, observed: Flags, *, unequal: bool
    ) -> Floats | None:
        """Noise level of each channel in units of the whitening, from its residual and the degrees of freedom that the
        contact used.

        With ``unequal``, None if the levels do not differ significantly from a common one.
        """
        policy = self.policy
        if self.count == 1:
            return None
        channel, limit = self.index[observed], policy.noise.unequal
        misfit = member.explained - self.readings.white(y[observed], observed)
        count = np.bincount(channel, minlength=self.count)
        alive = count > 0
        if (count[alive] < policy.noise.fewest).any():
            return None
        power = np.bincount(channel, misfit**2, minlength=len(count))[alive]
        if unequal and np.ptp(np.log(np.maximum(power / count[alive], 1e-300))) < 2.0 * limit:
            return None
        took = np.bincount(channel, taken_of_each(member), minlength=len(count))
        free = np.maximum((count - took)[alive], 1.0)
        off = 0.5 * np.log(np.maximum(power / free, 1e-300) * free.sum() / power.sum())
        # the logarithm of a root mean square of n readings has the standard error 1/sqrt(2 n)
        if unequal and not (np.abs(off) > limit + policy.noise.unequal_errors / np.sqrt(2.0 * free)).any():
            return None
        out = (noise / self.readings.std)[np.searchsorted(self.index, np.arange(len(count)))]
        out[alive] *= np.sqrt(power / free)
        return np.asarray(out)

    def left(self, member: ContactModel, y: Floats, observed: Flags, took: float) -> float:
        """Root mean square of the whitened residual per degree of freedom that the contact, which uses ``took``, leaves."""
        free = max(float(observed.sum()) - took, 1.0)
        misfit = member.explained - self.readings.white(y[observed], observed)
        return float(np.sqrt((misfit**2).sum() / free))

    def outliers(self, data: Floats, explained: Floats, noise: Floats) -> Flags:
        """Mask of outliers: residuals far beyond the noise and beyond most other residuals."""
        policy = self.policy
        residual = np.abs(data - explained) / noise
        typical = max(1.0, float(np.median(residual)) / MEDIAN)
        gross = policy.screening.gross * float(np.abs(explained / noise).max())
        return np.asarray(residual > max(policy.screening.deviations * typical, gross))
