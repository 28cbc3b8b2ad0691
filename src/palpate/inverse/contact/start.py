"""The linear models from which the search for contact starts, dense or matrix-free, and their screening for broken
readings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import Rounds
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.screening import Screened, linear_noise, noise_at_size, screened
from palpate.inverse.linear.evidence import LinearEvidence, linear_evidence
from palpate.inverse.linear.matrix_free.evidence import LinearAtSize
from palpate.inverse.linear.matrix_free.path import LinearModel
from palpate.inverse.linear.whitening import Readings

__all__ = ["LinearStart"]

Flags = npt.NDArray[np.bool_]


class LinearStart:
    """Linear models of a problem, applied to one frame at a time."""

    def __init__(
        self,
        orders: Mapping[int, LinearModel],
        readings: Readings,
        parameter: float | None,
        rounds: Rounds,
        policy: Policy,
    ) -> None:
        self.orders, self.readings, self.parameter, self.policy = orders, readings, parameter, policy
        self._rounds = rounds
        #: Patterns of possible offsets, and these patterns in the basis of each linear model.
        self._shifts: tuple[Floats, list[Floats]] | None = None

    def freedom(self, parameter: float) -> float:
        """Degrees of freedom of the traction that are determined by the data rather than by the penalty."""
        linear = self.orders[1]
        if isinstance(linear, LinearAtSize):
            return linear.freedom(parameter)
        spectrum = linear.spectrum
        return float(spectrum.multiplicity @ (spectrum.eigenvalues / (spectrum.eigenvalues + parameter)))

    def residual_lacks(self, parameter: float) -> float:
        """Degrees of freedom that noise loses in the residual of the linear model: tr(2H - H^2), where H takes readings to
        predictions (T. J. Hastie, R. J. Tibshirani, Generalized Additive Models, 1990, 3.5). More than `freedom`, tr(H), because the
        penalty shrinks what it does not remove. Matrix-free models give tr(H).
        """
        linear = self.orders[1]
        if isinstance(linear, LinearAtSize):
            return linear.freedom(parameter)
        kept = linear.spectrum.eigenvalues / (linear.spectrum.eigenvalues + parameter)
        return float(linear.spectrum.multiplicity @ (kept * (2.0 - kept)))

    def evidence(
        self, linear: LinearModel, rows: Sequence[Floats], known: float | None, patterns: Floats | None = None
    ) -> LinearEvidence:
        """Fit of a linear model to a frame. ``known`` fixes the noise level, in units of the whitening; None: the
        arrays' own, or estimated.
        """
        if isinstance(linear, LinearAtSize):
            return self._rounds.of(linear).evidence(rows, self.parameter, known, patterns)
        projected = self._rounds.projected(linear.spectrum, rows)
        return linear_evidence(linear, rows, self.parameter, known, patterns, projected=projected)

    def noise(
        self, data: Floats, total: float, observed: Flags, *, given: bool = True
    ) -> tuple[LinearEvidence, float, float]:
        """The linear model with a noise level consistent with its residual, that level, and the degrees of freedom of
        the residual.

        Unobserved readings become free unknowns; a matrix-free model uses their filled-in values instead.
        """
        linear, rows, n = self.orders[1], self.readings.planes(data), len(data)
        if isinstance(linear, LinearAtSize):
            return noise_at_size(self._rounds.of(linear), rows, total, self.policy, given=given)
        patterns = None
        missing = np.flatnonzero(~observed)
        if len(missing):
            each = [np.where(np.arange(n) == i, self.readings.std, 0.0) for i in missing]
            patterns = np.stack([self.projected(self.readings.planes(e)) for e in each])
        return linear_noise(linear if given else replace(linear, noise_known=False), rows, total, self.policy, patterns)

    def projected(self, rows: Sequence[Floats]) -> Floats:
        """Readings in the basis of the linear model."""
        linear = self.orders[1]
        return np.asarray(linear.project(rows) if isinstance(linear, LinearAtSize) else linear.spectrum.project(rows))

    def screened(self, data: Floats, observed: Flags, shifts: Floats) -> Screened:
        """Broken readings of a frame, and their predicted values; ``shifts`` as in `screening.screened`. None of a large array: there a rough
        contact shows them (`outliers`).
        """
        linear = self.orders[1]
        if isinstance(linear, LinearAtSize):
            return Screened(np.zeros(len(data), dtype=bool), np.zeros(len(data)))
        if self._shifts is None or self._shifts[0] is not shifts:
            self._shifts = shifts, [self.projected(self.readings.planes(column)) for column in shifts.T]
        return screened(linear, self.readings, data, observed, shifts, self.policy, self._shifts[1])
