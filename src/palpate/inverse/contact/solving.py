"""Solve one explanation of a frame. Readings used, noise, offsets and contact depend on each other, so repeat until
none changes.

Each attempt weights the linear model, solves for contact roughly, and checks the residual in this order: saturated
readings above their predicted value, outliers, sizes of offsets, noise of each channel, common noise. The first change
starts the next attempt.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.constrained.variances import taken_by
from palpate.inverse.contact import trace
from palpate.inverse.contact.cells import even_contact
from palpate.inverse.contact.explanation import Explanation, Solved
from palpate.inverse.contact.few_cells import contact_in_few_cells
from palpate.inverse.contact.observed import Observed
from palpate.inverse.contact.outliers import loaded_above
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.proposals.levels import in_range
from palpate.inverse.contact.score import gain_of, more_than_noise, noise_beyond
from palpate.inverse.contact.screening import loaded
from palpate.inverse.contact.systematic import change_of_nuisances
from palpate.inverse.fit import rms
from palpate.inverse.linear.evidence import LinearEvidence

__all__ = ["solve"]

Flags = npt.NDArray[np.bool_]
#: Attributes of `_Solving` that change between attempts, except the counts.
STATE = ("h", "known", "data", "rows", "observed", "near", "explained", "gained")


def solve(estimator: PreparedContact, h: Explanation, frame: Observed) -> Solved:
    """The solved models of one explanation of a frame; no models if noise explains it."""
    return _Solving(estimator, h, frame).run()


class _Solving:
    """State of one explanation while it is solved."""

    def __init__(self, estimator: PreparedContact, h: Explanation, frame: Observed) -> None:
        self.estimator, self.policy, self.h, self.frame = estimator, estimator.policy, h, frame
        self.sign = h.sign or 1
        self.data = self.sign * (frame.filled - estimator.shifts @ h.sizes)
        self.rows = estimator.readings.planes(self.data)
        #: Saturated readings, and for each whether the true value may be larger (True) or smaller.
        self.limited = frame.limited & frame.alive
        self.observed = frame.usable & ~self.limited
        self.upwards: Flags | None = None
        self.rounding = 0.0
        if frame.ends is not None:
            self.upwards = frame.ends.upper if h.sign >= 0 else frame.ends.lower
            self.rounding = float((frame.ends.step / (math.sqrt(12.0) * estimator.readings.std)).max(initial=0.0))
        #: Whether the linear model fits noise too, so that its evidence gives no noise level.
        self.follows = estimator.ambiguous or self._follows()
        #: Noise of each channel, in units of the whitening, if learned from the contact; `known` is the common noise.
        self.levels: Floats | None = None
        self.known, self.given, self.coarse = self._noise_at_first()
        #: Number of times the noise and the offsets were re-estimated.
        self.learned, self.refined = 0, 0
        #: Root mean square of the whitened readings at first, with which states are compared; the gain of `rested`.
        self.signal, self.gained = self.total, 0.0
        self.rested: dict[str, Any] = {}  # state in which the noise estimate settled far above the given noise
        #: The rough solution (component, cell) and the leading model, once they are made.
        self.first: Floats
        self.leading: ContactModel | None = None
        self.near = h.rough.traction if h.sign else None
        self.models: Iterator[ContactModel] = iter(())

    # -- initial values

    def _follows(self) -> bool:
        """Whether the linear model can fit any readings: as many components as channels, on shallow taxels."""
        estimator = self.estimator
        if estimator.noise_known or not self.h.sign:
            return False
        alone = estimator.start.evidence(estimator.orders[1], self.rows, None)
        return alone.scale < self.policy.noise.followed * self.h.rough.left

    def _noise_at_first(self) -> tuple[float | None, float, float]:
        """Initial noise (None: from the linear model); the given noise; and the residual noise of coarse cells beyond
        it.
        """
        estimator, h = self.estimator, self.h
        known: float | None = None
        coarse, least, given = 0.0, estimator.least_noise(self.data), 1.0
        if estimator.noise_known and self.rounding > self.policy.noise.step:
            known = given = math.hypot(1.0, self.rounding)
        if not h.sign:
            pass
        elif estimator.noise_known:
            learned = noise_beyond(given, h.rough.left, h.rough.free, self.policy)
            rules = self.policy.noise
            if learned > rules.again * given:
                coarse = max(learned, least)
                known = coarse if learned > rules.by_cells * given or not estimator.large else known
        elif h.present.any() or ((self.follows or not self.frame.usable.all()) and h.rough.left > 0):
            # A linear model takes the edges of filled-in regions for noise.
            known = max(h.rough.left, least)
        if h.noise is not None:
            known = max(h.noise, least)
        return known, given, coarse

    # -- attempts

    def run(self) -> Solved:
        """Solve the explanation."""
        for attempt in range(self.policy.noise.attempts):
            self._weigh()
            if not self._touches():
                if self._few_cells():
                    continue
                return self._solved([], explains=True)
            self._fit()
            # The last attempt keeps its readings, noise and nuisances, so that it makes models of them.
            last = attempt + 1 == self.policy.noise.attempts
            if not last and (self._more_at_ends() or self._outliers()):
                continue
            if not self.first[-1].any():
                break
            # Estimate noise and offsets from the first model only; make the others when these have settled.
            self.models = self.estimator.models(
                self.first, self.y, self.noise, self.observed, self.evidence, self.leading
            )
            self.leading = next(self.models)
            if last or not (self._offsets_moved(self.leading) or self._noise_changed(self.leading)):
                break
        left = rms(self.estimator.readings.whitened(self.data - self.explained, self.observed, self.noise))
        members = [self.leading, *self.models] if self.leading and self.first[-1].any() else []
        total = sum(m.weight for m in members)
        for m in members:  # models of hardly any weight were left out
            m.weight /= total
        trace.models(members)
        return self._solved(members, explains=left <= self.policy.detection.unexplained)

    def _weigh(self) -> None:
        """Fit the linear models, and set the noise of each reading."""
        estimator = self.estimator
        self.evidence: dict[int, LinearEvidence] = {
            order: estimator.start.evidence(linear, self.rows, self.known) for order, linear in estimator.orders.items()
        }
        self.scale = self.evidence[1].scale
        self.floor = max(estimator.least_noise(self.data), self.rounding)
        each = self.scale if self.levels is None else self.levels[estimator.noise.index]
        self.noise = estimator.readings.std * np.maximum(each, self.floor)

    def _touches(self) -> bool:
        """Whether the readings are more than noise, by evidence or because contact in a few cells was found."""
        of_channels = self.estimator.noise.uneven(self.data, self.observed, self.known)
        evident = more_than_noise(self.evidence[1].gain, of_channels, self.policy)
        return self.scale > 0 and (evident or self.h.noise is not None)

    def _few_cells(self) -> bool:
        """Whether readings that the linear model takes for noise are contact in a few cells."""
        small = None
        if self.scale > 0 and self.h.sign:
            small = contact_in_few_cells(self.estimator, self.data, self.observed)
        if small is None:
            return False
        self.h, self.known = replace(self.h, noise=small.left), max(small.left, self.floor)
        return True

    def _fit(self) -> None:
        """Solve for contact with one even penalty on surface cells."""
        found = self.evidence[1]
        self.first, self.explained, _ = even_contact(
            self.estimator, found.traction, self.y, self.noise, self.observed, found.weight, self.near
        )
        self.near = self.first

    # -- residual of the contact

    @property
    def y(self) -> Floats:
        """The readings in units of the noise."""
        return np.asarray(self.data / self.noise)

    def _refill(self) -> None:
        """Replace unused readings by the contact's prediction, for the linear model."""
        self.rows = self.estimator.readings.planes(np.where(self.observed, self.data, self.explained))

    def _more_at_ends(self) -> bool:
        """Use saturated readings that the contact predicts to be smaller; return whether there are any."""
        if self.upwards is None:
            return False
        less = np.where(self.upwards, self.explained < self.data, self.explained > self.data)
        short = self.limited & ~self.observed & less
        if not short.any():
            return False
        self.observed |= short
        self._refill()
        return True

    def _outliers(self) -> bool:
        """Remove outliers; return whether there were any."""
        estimator, policy, alive = self.estimator, self.policy, self.frame.alive
        level = np.maximum(self.noise, self.coarse * estimator.readings.std)
        wrong = estimator.noise.outliers(self.data, self.explained, level) & ~self.limited
        part = (wrong | ~self.observed)[alive].mean()
        few = part <= policy.screening.most and not loaded(wrong, self.data, self.explained, estimator.pairs, policy)
        if not few or not policy.parts.outliers or not (wrong & self.observed).any():
            return False
        residual = self.data - self.explained
        worst = int(np.argmax(np.where(wrong & self.observed, np.abs(residual) / level, 0.0)))
        if loaded_above(estimator, worst, residual, self.observed):
            return False
        self.observed &= ~wrong
        self._refill()
        return True

    def _offsets_moved(self, leading: ContactModel) -> bool:
        """Solve contact and nuisances together; return whether the nuisances changed."""
        if not self.h.present.any():
            return False
        change = change_of_nuisances(
            self.estimator,
            self.h,
            leading,
            self.data,
            self.noise,
            self.observed,
            sure=self.refined >= self.policy.noise.offset_rounds,
        )
        self.refined += 1
        sizes = self.h.sizes + self.sign * change
        if not change.any() or not in_range(self.estimator, self.estimator.shifts, sizes, self.frame.filled):
            return False
        self.h = replace(self.h, sizes=sizes)
        self.data = self.data - self.estimator.shifts @ change
        self._refill()
        return True

    # -- noise

    @property
    def total(self) -> float:
        """Root mean square of the whitened readings, without the nuisances."""
        return rms(self.estimator.readings.whitened(self.data, self.observed))

    def _noise_changed(self, leading: ContactModel) -> bool:
        """Re-estimate the noise from the residual, each channel first; return whether it changed."""
        estimator, parts = self.estimator, self.policy.parts
        if parts.channel_noise and not estimator.noise_known:
            own = estimator.noise.levels(leading, self.y, self.noise, self.observed, unequal=self.levels is None)
            if own is not None:
                return self._take_levels(own)
        if not parts.noise_again or (estimator.noise_known and not self.coarse):
            return False
        left = self._left_by(leading)
        changed = self._given_noise(left, taken_by(leading)) if estimator.noise_known else self._learned_noise(left)
        self.learned += changed
        return changed

    def _take_levels(self, own: Floats) -> bool:
        """Set the noise of each channel; False if it has settled, within half of the difference that justifies
        separate levels.
        """
        rules = self.policy.noise
        if self.levels is not None:
            settled = np.abs(np.log(own / self.levels)).max() < 0.5 * rules.unequal
            if settled or self.learned == rules.turns:
                return False
        self.levels, self.learned = own, self.learned + 1
        return True

    def _left_by(self, leading: ContactModel) -> float:
        """Residual noise of the leading model, in units of the whitening."""
        estimator = self.estimator
        left = estimator.noise.left(leading, self.y, self.observed, taken_by(leading))
        return float(left * (self.noise[0] / estimator.readings.std[0]))

    def _given_noise(self, left: float, taken: float) -> bool:
        """Update noise that is given up to a factor (`score.noise_beyond`): lower it to what the leading model leaves,
        because coarse cells leave more than fine ones; or raise it, if the given noise was tried. If the estimate
        settles far above the given noise, try that once, and keep what gains more.
        """
        policy, now = self.policy, self.given if self.known is None else self.known
        again, free = policy.noise.again, max(float(self.observed.sum()) - taken, 0.0)
        learned = max(noise_beyond(self.given, left, free, policy), self.floor)
        gain = gain_of(free, self.signal, max(left, self.given), self.floor)
        tried, count = now == self.given, self.learned < policy.noise.turns
        if tried and self.rested and gain < self.rested["gained"]:
            vars(self).update(self.rested)
        elif count and (learned * again < now or (tried and learned > again * now)):
            self.known = learned if learned > again * self.given else self.given
        elif now > policy.screening.deviations * self.given and not self.rested:
            self.gained = gain
            self.rested = {name: copy(getattr(self, name)) for name in STATE}
            self.known = self.given
        else:
            return False
        return True

    def _learned_noise(self, left: float) -> bool:
        """Update noise that is not given."""
        policy, ratio = self.policy, max(left, self.floor) / max(self.scale, self.floor)
        if self.follows and ratio < 1.0:
            ratio = 1.0 / ratio  # the first estimate was an upper limit
        if self.learned == policy.noise.turns_of_all or ratio < policy.noise.again:
            return False
        if left > max(policy.detection.most_left * self.total, policy.detection.unexplained * self.scale):
            return False  # most of the signal is in the residual: a pull, not noise
        self.known = left
        return True

    # -- result

    def _solved(self, members: list[ContactModel], *, explains: bool) -> Solved:
        return Solved(
            self.h,
            members,
            self.data,
            self.noise,
            self.observed,
            self.evidence[1].parameter,
            self.scale,
            self.levels,
            explains,
        )
