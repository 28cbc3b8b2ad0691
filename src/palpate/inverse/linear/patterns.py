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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._numbers import plain_number
from palpate.elastic.pad import Floats
from palpate.inverse.linear.parameter import TINY, candidates
from palpate.inverse.linear.spectrum import Spectrum
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.nuisance import Nuisance, nuisances
from palpate.sensing.operator import Operator

__all__ = ["Patterns", "Removed", "Weighed"]

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

    coefficients: Any
    directions: Floats
    sizes: Floats
    deviations: Floats


@dataclass(frozen=True)
class Weighed:
    """A set of patterns: their indices, and the eigenvectors and eigenvalues of M for each candidate (candidate, ...)."""

    members: tuple[int, ...]
    vectors: Floats
    values: Floats

    @classmethod
    def of(cls, members: tuple[int, ...], middle: Floats) -> Weighed:
        """From M (candidate, pattern, pattern)."""
        values, vectors = np.linalg.eigh(middle)
        return cls(members, vectors, np.maximum(values, 0.0))


class Patterns:
    """The patterns of an operator in the basis of a spectrum.

    ``kinds`` are the nuisances that the user names; None: none, except a shift for an image of a half-space.
    """

    def __init__(
        self,
        operator: Operator,
        spectrum: Spectrum,
        scales: Sequence[Floats],
        kinds: tuple[str, ...] | None,
        parameter: float | None = None,
    ) -> None:
        self.spectrum = spectrum
        self._expanded(operator, spectrum.project, scales, kinds)
        self.grid = candidates(spectrum.eigenvalues)[::COARSE] if parameter is None else np.array([parameter])
        self.sets = [self._prepared(members) for members in self.members]

    def _expanded(
        self,
        operator: Operator,
        project: Callable[[list[Floats]], Any],
        scales: Sequence[Floats],
        kinds: tuple[str, ...] | None,
    ) -> None:
        """Compute the patterns, their rows in a basis of the readings (root mean square one), and their sets."""
        channels = {c for a in operator.planes_of for c in a.channels}
        #: An image of a half-space has no zero of its own: its displacements are relative to points infinitely far
        #: away. (A sensor that also measures displacement_z is fixed to the pad.)
        self.adrift = operator.pad.thickness is None and channels <= {"displacement_x", "displacement_y"}
        wanted = kinds if kinds is not None else ("offset",) if self.adrift else ()
        self.all: list[Nuisance] = list(nuisances(operator.planes_of, wanted))
        readings = Readings(operator, scales)
        rows = [[p[None] for p in readings.planes(n.rows)] for n in self.all]
        self.rows = np.concatenate([np.asarray(project(r)) for r in rows]) if rows else np.zeros((0, 0))
        size = np.sqrt((self.rows**2).sum(axis=1) / len(readings.std)) if rows else np.zeros(0)
        self.units = np.where(size > 0, 1.0 / np.where(size > 0, size, 1.0), 0.0)
        self.rows = self.rows * self.units[:, None]
        self.members = self._sets(kinds)

    def _sets(self, kinds: tuple[str, ...] | None) -> list[tuple[int, ...]]:
        named = kinds if kinds is not None else ("offset",) if self.adrift else ()
        found = tuple(i for i, n in enumerate(self.all) if n.kind in named and self.units[i] > 0)
        return [found] if found else []

    def _prepared(self, members: tuple[int, ...]) -> Weighed:
        rows = self.rows[list(members)]
        weights = 1.0 / (1.0 + self.spectrum.eigenvalues[None, :] / self.grid[:, None])
        return Weighed.of(members, np.einsum("in,gn,jn->gij", rows, weights, rows, optimize=True))

    def removed(self, coefficients: Any, floor: Floats | None) -> Removed | None:
        """``coefficients`` (frame, n) without the patterns; None if there are none. ``floor``: as in `amplitude`."""
        if not self.sets:
            return None
        c = np.asarray(coefficients, dtype=np.float64)
        weights = 1.0 / (1.0 + self.spectrum.eigenvalues[None, :] / self.grid[:, None])
        explained = c**2 @ weights.T  # (frame, candidate)
        logdet = -np.log(np.maximum(weights, TINY)).sum(axis=1)
        inner = np.stack([c @ (weights * row).T for row in self.rows], axis=-1)  # (frame, candidate, pattern)
        return self.weighed(c, float(c.shape[1]), floor, self.sets, explained, logdet, inner)

    def weighed(
        self,
        c: Floats,
        n: float,
        floor: Floats | None,
        sets: Sequence[Weighed],
        explained: Floats,
        logdet: Floats,
        inner: Floats,
    ) -> Removed:
        """``c`` without the patterns, given c^T D^{-1} c (frame, candidate), log det D (candidate,) and B^T D^{-1} c
        (frame, candidate, pattern).
        """

        def score(left: Floats, more: Floats) -> tuple[Floats, Floats]:
            """-2 log evidence and noise variance."""
            if floor is None:
                return left + logdet + more, np.ones_like(left)
            variance = np.maximum(np.maximum(left / n, floor[:, None]), TINY)
            return n * np.log(variance) + left / variance + logdet + more, variance

        models: list[tuple[Weighed, float]] = []
        scores = []
        along = {}
        for each in sets:
            along[each.members] = np.einsum("gji,fgj->fgi", each.vectors, inner[..., list(each.members)])
            for g in SIZES[-1:] if self.adrift else SIZES:
                gain = 1.0 / (g**-2 + each.values)  # (candidate, direction)
                taken = (along[each.members] ** 2 * gain).sum(axis=-1)
                scores.append(score(explained - taken, np.log1p(g**2 * each.values).sum(axis=-1)))
                models.append((each, g))
        # Evidence of each model over all parameters.
        table = np.stack([-0.5 * s for s, _ in scores], axis=1)  # (frame, model, candidate)
        top = table.max(axis=2, keepdims=True)
        total = np.log(np.exp(table - top).mean(axis=2)) + top[..., 0]
        chance = np.exp(total - total.max(axis=1, keepdims=True))
        chance /= chance.sum(axis=1, keepdims=True)
        best = table.argmax(axis=2)  # (frame, model)
        return self._mixed(c, models, chance, best, along, [v for _, v in scores])

    def _mixed(
        self,
        c: Floats,
        models: list[tuple[Weighed, float]],
        chance: Floats,
        best: Any,
        along: dict[tuple[int, ...], Floats],
        variances: list[Floats],
    ) -> Removed:
        """Mean and covariance of the patterns' sizes over the models of each frame."""
        count, q = len(c), len(self.all)
        mean, second = np.zeros((count, q)), np.zeros((count, q, q))
        for i, (model, g) in enumerate(models):
            members = list(model.members)
            for f in np.flatnonzero(chance[:, i] > IMPROBABLE):
                at, p = best[f, i], chance[f, i]
                gain = 1.0 / (g**-2 + model.values[at])
                vectors = model.vectors[at]
                size = vectors @ (gain * along[model.members][f, at])
                covariance = variances[i][f, at] * (vectors * gain) @ vectors.T
                mean[f, members] += p * size
                second[f][np.ix_(members, members)] += p * (covariance + np.outer(size, size))
        covariance = second - mean[:, :, None] * mean[:, None, :]
        eigenvalues, vectors = np.linalg.eigh(covariance)
        kept = slice(-min(DIRECTIONS, q), None)
        root = vectors[:, :, kept] * np.sqrt(np.maximum(eigenvalues[:, None, kept], 0.0))
        deviation = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0))
        return Removed(
            c - mean @ self.rows,
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
