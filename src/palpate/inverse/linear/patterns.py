"""Nuisances (`palpate.sensing.nuisance`) in linear methods: subtracted from the readings, and included in the error
bars.

In the basis of the spectrum, readings are c = s v + B a + noise with v of variance sigma^2/lambda and a of variance
g^2 sigma^2, where the patterns B are scaled to a root mean square of one, for several g. With D = 1 + s^2/lambda and M
= B^T D^{-1} B = E diag(m) E^T,

    cov(a) = sigma^2 (g^{-2} + M)^{-1},   mean(a) = (g^{-2} + M)^{-1} B^T D^{-1} c,
    -2 log evidence = (c^T D^{-1} c - b^T (g^{-2} + M)^{-1} b)/sigma^2 + sum log D + sum log(1 + g^2 m) + n log sigma^2,

where b = B^T D^{-1} c; a is averaged over g by evidence. M depends on lambda only, so its eigenvectors are prepared
once.

A linear method cannot decide which patterns are present: its prior allows pressure everywhere equally, so that
evidence explained a third of a ball's net force by an offset (tried). The patterns are those that the user names, and
shifts of an image of a half-space, whose zero is undetermined.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._numbers import plain_number
from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.linear.parameter import TINY, candidates
from palpate.inverse.linear.spectrum import Spectrum
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.nuisance import Nuisance, nuisances
from palpate.sensing.operator import Operator

__all__ = ["Patterns", "Removed", "SpectrumPatterns"]

#: Prior sizes of a pattern (root mean square in the readings, relative to the noise), all equally likely.
SIZES = (0.3, 3.0, 30.0, 300.0, 3000.0)
#: Use every third candidate of the parameter: four per decade.
COARSE = 3
#: Models less probable than this are left out of the error bars.
IMPROBABLE = 1e-3
#: Note a pattern if it is at least this many standard deviations.
SURE = 2.0
#: Largest number of error directions from patterns: the largest ones are kept.
DIRECTIONS = 6


@dataclass(frozen=True)
class Removed:
    """For each frame: coefficients without the patterns (frame, n), their uncertainty (frame, direction, n), sizes and
    their standard deviations (frame, pattern).
    """

    coefficients: Floats
    directions: Floats
    sizes: Floats
    deviations: Floats


class Patterns(abc.ABC):
    """The patterns of an operator in a basis of the readings.

    ``kinds`` are the nuisances that the user names; None: none, except a shift for an image of a half-space.
    """

    def __init__(
        self,
        operator: Operator,
        project: Callable[[list[Floats]], Any],
        scales: Sequence[Floats],
        kinds: tuple[str, ...] | None,
        grid: Floats,
    ) -> None:
        channels = {c for a in operator.planes_of for c in a.channels}
        #: An image of a half-space has no zero of its own: its displacements are relative to points infinitely far
        #: away. (A sensor that also measures displacement_z is fixed to the pad.)
        self.adrift = operator.pad.thickness is None and channels <= {"displacement_x", "displacement_y"}
        readings = Readings(operator, scales)
        #: The parameters at which evidence is computed.
        self.grid, self.count = grid, len(readings.std)
        self.all: list[Nuisance] = []
        rows, units = [], []
        for pattern in nuisances(
            operator.planes_of, kinds if kinds is not None else ("offset",) if self.adrift else ()
        ):
            row = np.asarray(project([p[None] for p in readings.planes(pattern.rows)]))[0]
            size = math.sqrt(float((row**2).sum()) / self.count)
            if size > 0:
                self.all.append(pattern)
                units.append(1.0 / size)
                rows.append(row * units[-1])
        #: The patterns' rows, of root mean square one, and the size of each in its own unit.
        self.rows, self.units = np.array(rows), np.array(units)

    @abc.abstractmethod
    def removed(self, rows: Floats, floor: Floats | None) -> Removed:
        """``rows`` (frame, n) without the patterns; ``floor`` as in `amplitude`."""

    def score(self, left: Floats, logdet: Floats, floor: Floats | None) -> tuple[Floats, Floats]:
        """-2 log evidence and noise variance (frame, candidate), from the misfit plus penalty and the log determinant."""
        if floor is None:
            return left + logdet, np.ones_like(left)
        variance = np.maximum(np.maximum(left / self.count, floor[:, None]), TINY)
        return self.count * np.log(variance) + left / variance + logdet, variance

    def weighed(
        self, rows: Floats, floor: Floats | None, middle: Floats, explained: Floats, logdet: Floats, inner: Floats
    ) -> Removed:
        """``rows`` c without the patterns, given M (candidate, pattern, pattern), c^T D^{-1} c (frame, candidate), log det
        D (candidate,) and B^T D^{-1} c (frame, candidate, pattern).
        """
        values, vectors = np.linalg.eigh(middle)
        values = np.maximum(values, 0.0)
        along = np.einsum("gji,fgj->fgi", vectors, inner)
        sizes = SIZES[-1:] if self.adrift else SIZES
        scores, variances = [], []
        for g in sizes:
            taken = (along**2 / (g**-2 + values)).sum(axis=-1)
            score, variance = self.score(explained - taken, logdet + np.log1p(g**2 * values).sum(axis=-1), floor)
            scores.append(score)
            variances.append(variance)
        # Evidence of each size over all parameters.
        table = -0.5 * np.stack(scores, axis=1)  # (frame, size, candidate)
        top = table.max(axis=2, keepdims=True)
        total = np.log(np.exp(table - top).mean(axis=2)) + top[..., 0]
        chance = np.exp(total - total.max(axis=1, keepdims=True))
        chance /= chance.sum(axis=1, keepdims=True)
        best = table.argmax(axis=2)  # (frame, size)
        # Mean and covariance of the patterns' sizes over the models of each frame.
        count, q = len(rows), len(self.all)
        mean, second = np.zeros((count, q)), np.zeros((count, q, q))
        for i, g in enumerate(sizes):
            for f in np.flatnonzero(chance[:, i] > IMPROBABLE):
                at, p = best[f, i], chance[f, i]
                gain = 1.0 / (g**-2 + values[at])
                size = vectors[at] @ (gain * along[f, at])
                covariance = variances[i][f, at] * (vectors[at] * gain) @ vectors[at].T
                mean[f] += p * size
                second[f] += p * (covariance + np.outer(size, size))
        covariance = second - mean[:, :, None] * mean[:, None, :]
        eigenvalues, directions = np.linalg.eigh(covariance)
        kept = slice(-min(DIRECTIONS, q), None)
        root = directions[:, :, kept] * np.sqrt(np.maximum(eigenvalues[:, None, kept], 0.0))
        deviation = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
        return Removed(
            rows - mean @ self.rows,
            np.swapaxes(root, 1, 2) @ self.rows,
            mean * self.units,
            deviation * self.units,
        )

    def words(self, found: Removed, batch: tuple[int, ...]) -> list[str]:
        """Notes on the patterns found, and on those that cannot be separated from traction."""
        said = []
        for i, pattern in enumerate(self.all):
            size, deviation = found.sizes[:, i], found.deviations[:, i]
            there = np.abs(size) > SURE * deviation
            if there.any() and not batch:
                said.append(
                    f"{pattern.label}: {plain_number(size[0], 3)} +- {plain_number(deviation[0], 2)} {pattern.unit}, removed"
                )
            elif there.any():
                low, high = size[there].min(), size[there].max()
                said.append(
                    f"{pattern.label} in {int(there.sum())} of {len(there)} frames: {plain_number(low, 3)} to {plain_number(high, 3)} {pattern.unit}, removed"
                )
            open_ = ~there
            if self.adrift and pattern.kind == "offset" and open_.any():
                some = f" in {int(open_.sum())} of {len(open_)} frames" if batch else ""
                most = 2.0 * float(deviation[open_].max())
                said.append(
                    f"{pattern.label} (of up to {plain_number(most, 2)} {pattern.unit}) and a net force cannot be separated{some}: the intervals allow for "
                    "both. If the image cannot drift, pass Skin(..., nuisance=[])"
                )
        return said


class SpectrumPatterns(Patterns):
    """The patterns in the basis of a spectrum; ``parameter``: the only one to consider."""

    def __init__(
        self,
        spectrum: Spectrum,
        scales: Sequence[Floats],
        kinds: tuple[str, ...] | None,
        parameter: float | None = None,
    ) -> None:
        grid = candidates(spectrum.eigenvalues)[::COARSE] if parameter is None else np.array([parameter])
        super().__init__(spectrum.operator, spectrum.project, scales, kinds, grid)
        self.eigenvalues = spectrum.eigenvalues

    @cached_property
    def _tables(self) -> tuple[Floats, Floats, Floats]:
        """1/D (candidate, n), M (candidate, pattern, pattern) and log det D (candidate,)."""
        weights = 1.0 / (1.0 + self.eigenvalues / self.grid[:, None])
        middle = np.einsum("in,gn,jn->gij", self.rows, weights, self.rows, optimize=True)
        return weights, middle, -np.log(np.maximum(weights, TINY)).sum(axis=1)

    def removed(self, rows: Floats, floor: Floats | None) -> Removed:
        c, (weights, middle, logdet) = rows.astype(np.float64, copy=False), self._tables
        inner = np.stack([c @ (weights * row).T for row in self.rows], axis=-1)  # (frame, candidate, pattern)
        return self.weighed(c, floor, middle, c**2 @ weights.T, logdet, inner)
