"""Common part of the comparison methods: all have the same call, solve for the whole map, and never let pressure pull.

One file each: `non_negative`, `elastic_net`, `total_variation`, `maximum_entropy`, `network`. Except for the first,
the parameter is the largest whose misfit still equals the noise (V. A. Morozov's discrepancy principle, 1966). The
noise is the array's own or, if not given, the one that maximises the likelihood of the linear model.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from palpate._arrays import from_numpy
from palpate._memory import require
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.constrained.differences import Differences
from palpate.inverse.estimate import Estimate, batch_of, frames_of
from palpate.inverse.linear.memory import check_spectrum
from palpate.inverse.linear.parameter import by_discrepancy, tikhonov
from palpate.inverse.linear.priors import DifferencePrior
from palpate.inverse.linear.regularised import Regularised
from palpate.inverse.linear.whitening import Readings
from palpate.inverse.method import Method, Needs
from palpate.inverse.problem import Problem

__all__ = ["Comparison", "Frame", "Found", "WholeMap"]  # noqa: RUF022

#: Largest number of unknowns.
LARGEST = 6000


@dataclass(frozen=True, kw_only=True)
class Comparison(Method):
    """Base class of the comparison methods."""

    needs: ClassVar[Needs] = Needs(free_boundary=True, pressure=True)
    comparison: ClassVar[bool] = True


@dataclass
class Frame:
    """One frame, whitened: the misfit is 1/2 |matrix t - data|^2, of traction t (component, cell)."""

    matrix: Floats
    data: Floats
    gram: Floats
    linear: Floats
    shape: tuple[int, int]

    def misfit(self, x: Floats) -> float:
        """Root mean square misfit of a traction."""
        return float(np.sqrt(np.mean((self.matrix @ x.ravel() - self.data) ** 2)))


@dataclass(frozen=True)
class Found:
    """Traction (component, cell) of one frame, the parameter, whether it converged, and the settling time."""

    traction: Floats
    parameter: float = math.nan
    converged: bool = True
    settling: float = math.nan


class WholeMap(abc.ABC):
    """Matrix and linear model of the whole map, and the loop over frames."""

    #: Whether the method has a parameter, and whether it has a settling time.
    has_parameter: ClassVar[bool] = True
    settles: ClassVar[bool] = False

    def __init__(self, problem: Problem, name: str, parameter: float | None = None) -> None:
        check_spectrum(problem.pad, problem.planes, problem.surface, len(problem.columns))
        unknowns = len(problem.columns) * math.prod(problem.surface.shape)
        readings = sum(int(a.valid.sum()) * len(a.channels) for a in problem.planes)
        if unknowns > LARGEST:
            raise Unsupported(
                f'method="{name}" keeps the whole map, and {unknowns} unknowns are too many (limit {LARGEST}). Give a '
                'coarser surface (Skin(..., surface=...)), or use method="adaptive" or "tikhonov".'
            )
        # Twice the whole map, the unknowns scaled and whitened, and a few normal matrices.
        require(
            8.0 * readings * (2.0 * len(problem.surface.components) * math.prod(problem.surface.shape) + 2.0 * unknowns)
            + 48.0 * unknowns**2,
            f'method="{name}": {readings} readings and {unknowns} unknowns',
            'Use method="adaptive" or "tikhonov".',
        )
        self.operator, self.columns, self.parameter = problem.operator, list(problem.columns), parameter
        self.grid = problem.surface
        self.cone = Cone(problem.components)
        priors = [DifferencePrior(self.grid, 1)] * len(self.columns)
        self.linear = Regularised(problem.decomposition(priors), tikhonov, "evidence")
        self.noise_known = self.linear.noise_known
        self.differences = Differences(self.grid)
        self.readings = Readings(self.operator, self.linear.scales)
        self._all = np.ones(len(self.readings.std), dtype=bool)
        self._matrix, self._gram = problem.kept.get(("whole map", problem.columns), self._formed)

    def _formed(self) -> tuple[Floats, Floats]:
        dense = self.operator.dense().reshape(-1, len(self.grid.components), math.prod(self.grid.shape))
        scaled = dense[:, self.columns].reshape(len(dense), -1) / self.readings.std[:, None]
        matrix = self.readings.white(scaled, self._all)
        return matrix, matrix.T @ matrix

    @abc.abstractmethod
    def minimised(self, p: Frame, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """The traction for a parameter, and whether the iteration converged."""

    def unit(self, p: Frame) -> float:
        """The parameter at which the traction becomes zero."""
        return float(np.abs(p.linear).max())

    def frame(self, p: Frame, start: Floats, noise: float) -> Found:
        """Solve one frame, from a first guess and the noise scale."""
        if self.parameter is not None:
            x, converged = self.minimised(p, self.parameter, start)
            return Found(x, self.parameter, converged)
        state = [start, True]

        def misfit(parameter: float) -> float:
            state[:] = self.minimised(p, parameter, state[0])  # type: ignore[arg-type]
            return p.misfit(state[0])  # type: ignore[arg-type]

        parameter = by_discrepancy(misfit, noise, self.unit(p))
        return Found(np.asarray(state[0]), parameter, bool(state[1]))

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane; every frame is decided alone."""
        grid, batch = self.grid, batch_of(readings, self.operator)
        count = math.prod(batch)
        values = np.zeros((count, len(grid.components), *grid.shape))
        parameters, noises, residuals, settling = (np.zeros(count) for _ in range(4))
        converged = np.ones(count, dtype=bool)
        shape = (len(self.columns), math.prod(grid.shape))
        for i, frame in enumerate(frames_of(readings, self.operator)):
            rows = self.operator.observed(frame)
            start = self.linear.solve(rows)
            noise = float(np.asarray(start.noise_scale).ravel()[0])
            first = np.asarray(start.traction)[self.columns].reshape(shape)
            y = self.readings.white(self.readings.flat(rows) / self.readings.std, self._all)
            p = Frame(self._matrix, y, self._gram, (self._matrix.T @ y).reshape(shape), shape)
            found = (
                self.frame(p, self.cone.nearest(first), noise) if y.any() else Found(np.zeros(shape), 0.0, True, 0.0)
            )
            values[i][self.columns] = found.traction.reshape(len(self.columns), *grid.shape)
            parameters[i], converged[i], settling[i] = found.parameter, found.converged, found.settling
            noises[i] = noise
            residuals[i] = p.misfit(found.traction) / (1.0 if self.noise_known else max(noise, 1e-300))
        scale = noises.reshape(batch)
        return Estimate(
            from_numpy(values.reshape((*batch, *values.shape[1:])), readings[0]),
            parameters.reshape(batch) if self.has_parameter else None,
            scale,
            residuals.reshape(batch),
            converged=converged.reshape(batch),
            settling=settling.reshape(batch) if self.settles else None,
            noise_std=scale[..., None] * np.concatenate(self.linear.scales),
            said=self._notes(converged, batch),
        )

    def _notes(self, converged: Any, batch: tuple[int, ...]) -> tuple[str, ...]:
        """A remedy if the iteration did not converge."""
        if converged.all():
            return ()
        where = f" in {np.count_nonzero(~converged)} of {len(converged)} frames" if batch else ""
        larger = "a larger parameter helps, or " if self.has_parameter else ""
        return (
            f'the iteration did not reach its tolerance{where}: the last traction met is given; {larger}method="tikhonov", which has no such iteration',
        )
