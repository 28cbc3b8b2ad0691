"""Error bars of frames that are solved by iteration, where no decomposition of the problem is available.

They are the same quantities as in `palpate.inverse.linear.posterior`, but estimated from additional solutions and from
random samples of the posterior.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.posterior import LONG, TIGHT, SampledVariances
from palpate.inverse.linear.matrix_free.rules import Search
from palpate.inverse.linear.parameter import mean_sizes
from palpate.inverse.linear.posterior import PATTERN, UNEXPLAINED, Source

__all__ = ["SampledSource"]


@dataclass(frozen=True)
class SampledSource(Source):
    """Computes the errors of some frames from solutions and random samples (`SampledVariances`)."""

    variances: SampledVariances

    def traction_error(self) -> Floats:
        return self._everywhere(np.sqrt(np.stack([v for v, _ in self._variances()])))

    def variance_reduction(self) -> Floats:
        prior = self.variances.prior
        sizes = self._sizes[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            parts = [1.0 - v / (size * prior) for (v, _), size in zip(self._variances(), sizes)]
        return self._everywhere(np.clip(np.stack(parts), 0.0, 1.0), fill=math.nan)

    def _variances(self) -> Iterator[tuple[Floats, int]]:
        """Variance (component sought, *surface) of each frame."""
        size, noise = self._sizes
        for i, lam in enumerate(np.reshape(self.known.parameter, -1)):
            first, second = self.variances.maps(float(lam))
            variance = size[i] * first + noise[i] * second
            if self._patterns is not None:
                variance = variance + (self._patterns[i] ** 2).sum(axis=0)
            yield variance, i

    def draws(self, count: int, rng: np.random.Generator) -> Floats:
        """Samples of the posterior (frame, draw, component, *surface): the estimate plus its errors for random
        traction and noise.
        """
        size, noise = self._sizes
        columns = list(self.variances.columns)
        out = np.repeat(self._all[:, None], count, axis=1)
        for i, lam in enumerate(np.reshape(self.known.parameter, -1)):
            error = self.variances.errors(float(lam), size[i], noise[i], count, rng)
            if self._patterns is not None:
                weights = rng.standard_normal((count, len(self._patterns[i])))
                error += np.tensordot(weights, self._patterns[i], axes=1)
            out[i][:, columns] += error
        return out

    def _summed(self, name: str, rows: Floats) -> Floats:
        first, second = self.variances.sums(name, rows, np.reshape(self.known.parameter, -1))
        size, noise = (each[:, None] for each in self._sizes)
        variance = size * first + noise * second
        if self._patterns is not None:
            flat = self._patterns.reshape(*self._patterns.shape[:2], -1)
            variance = variance + ((PATTERN * flat @ rows.reshape(len(rows), -1).T) ** 2).sum(axis=1)
        return np.asarray(variance)

    def _of_pressure(self, rows: Callable[[slice], Floats]) -> Floats:
        size, noise = self._sizes
        parameter = np.reshape(self.known.parameter, -1)
        parts = []
        for i in range(self._count):
            here = self._only_pressure(rows(slice(i, i + 1))[0])
            first, second = self.variances.own(here, np.full(len(here), parameter[i]))
            variance = size[i] * first + noise[i] * second
            if self._patterns is not None:
                flat = self._patterns[i].reshape(len(self._patterns[i]), -1)
                variance = variance + ((here.reshape(len(here), -1) @ flat.T) ** 2).sum(axis=1)
            parts.append(variance)
        return np.stack(parts)

    def _of_cells(self, cells: npt.NDArray[np.intp]) -> Floats:
        shape = self.variances.grid.shape

        def row(part: slice) -> Floats:
            out = np.zeros((1, 1, math.prod(shape)))
            out[0, 0, cells[part]] = 1.0
            return out.reshape(1, 1, *shape)

        return self._of_pressure(row)[:, 0]

    @cached_property
    def _sizes(self) -> tuple[Floats, Floats]:
        known, system = self.known, self.variances.system
        if known.amplitude is not None and known.noise is not None:
            return np.reshape(known.amplitude, -1), np.reshape(known.noise, -1)
        if known.rows is None:
            raise RuntimeError("neither the sizes of noise and traction are given nor what tells them")
        rows = known.rows.reshape(self._count, -1)
        floor = None if known.floor is None else np.reshape(known.floor, -1)
        parameter = np.reshape(known.parameter, -1)
        each = []
        for i, row in enumerate(rows):
            least = None if floor is None else floor[i : i + 1]
            each.append(mean_sizes(Search(system, "evidence", least).find(row[None]).curves, least))
        size, noise = (np.concatenate(values) for values in zip(*each))
        if floor is not None:
            left = 1.0 - system.freedom.of(parameter) / system.normal.count
            for blind in np.flatnonzero(left < UNEXPLAINED):
                noise[blind] = max(noise[blind], system.finest(rows[blind]))
            nothing = ~rows.any(axis=1)
            size, noise = np.where(nothing, np.nan, size), np.where(nothing, np.nan, noise)
        return size, noise

    @cached_property
    def _patterns(self) -> Floats | None:
        if self.known.patterns is None:
            return None
        system = self.variances.system
        rows = self.known.patterns.reshape(-1, self.known.patterns.shape[-1])
        each = np.repeat(np.reshape(self.known.parameter, -1), len(rows) // self._count)
        solved = system.solve(rows, each, tolerance=TIGHT, most=LONG)
        found = system.traction(solved)
        return found.reshape(self._count, -1, *found.shape[1:])
