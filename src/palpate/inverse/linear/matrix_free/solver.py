"""The linear methods with a Tikhonov filter, at any size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate._arrays import from_numpy, is_numpy, to_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.estimate import Estimate, in_frames
from palpate.inverse.linear.matrix_free.memory import TOGETHER
from palpate.inverse.linear.matrix_free.patterns import SolvedPatterns
from palpate.inverse.linear.matrix_free.posterior import SampledVariances
from palpate.inverse.linear.matrix_free.rules import Search
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.parameter import Choice, check_rule, noise_variance, tikhonov
from palpate.inverse.linear.posterior import Variances
from palpate.inverse.linear.solution import LinearMethod, Solution, joined
from palpate.inverse.linear.spectrum import in_components

__all__ = ["MatrixFree"]

#: Residual, as a fraction of the readings, at which the iteration stops, in double (8 bytes) and single precision.
TOLERANCE = {8: 1e-8, 4: 1e-5}
#: If the parameter is learned, to a per cent or two, the tolerance is LEARNED times the estimate's misfit, at most
#: LARGEST times the readings. This acts like slightly more noise, which changes the traction by 1e-6 to 3e-5 of its
#: norm.
LEARNED, LARGEST = 1e-4, 3e-5
#: A frame with a smaller residual is solved; with a larger one its status is "not converged".
SOLVED = 1e-4
#: Largest number of steps of the iteration.
MAX_STEPS = 2000


@dataclass(frozen=True, kw_only=True)
class Iterated(Solution):
    """Frames that were solved by iteration, and the part of their readings that is not solved."""

    misfit: Floats


class MatrixFree(LinearMethod):
    """As `palpate.inverse.linear.regularised.Regularised` with Tikhonov's filter, on a matrix-free `System`."""

    patterns: SolvedPatterns | None = None

    def __init__(
        self,
        system: System,
        parameter: float | str,
        *,
        absolute: bool = False,
        nuisance: tuple[str, ...] | None = (),
    ) -> None:
        count = float(system.normal.count)
        super().__init__(system.operator, system.scales, system.noise_known, tikhonov, parameter, absolute, count)
        if isinstance(parameter, str):
            check_rule(parameter, tikhonov, noise_known=system.noise_known)
        self.system = system
        self.together = max(1, TOGETHER // system.normal.total)
        if nuisance != ():
            patterns = SolvedPatterns(system, nuisance, float(parameter) if absolute else None)
            self.patterns = patterns if patterns.all else None

    @property
    def variances(self) -> Variances:
        self.system.variances = self.system.variances or SampledVariances(self.system)
        return self.system.variances

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        like = readings[0]
        batch = tuple(like.shape[: -len(self.system.normal.shapes[0])])
        count = math.prod(batch)
        flat = [to_numpy(r).reshape(count, *r.shape[len(batch) :]) for r in readings]
        starts = range(0, count, self.together) or [0]
        found = joined([self._frames([r[i : i + self.together] for r in flat]) for i in starts])
        traction = found.traction.reshape(*batch, *found.traction.shape[1:]).astype(flat[0].dtype)
        traction = traction if is_numpy(like) else from_numpy(traction, like)
        out = self.estimate(replace(found, traction=traction), batch)
        short, said = found.misfit > SOLVED, list(out.said)
        if short.any():
            worst = float(found.misfit.max())
            said.append(
                f"the iteration did not reach its tolerance{in_frames(short, batch)}: it left {worst:.1g} of the readings unsolved after {MAX_STEPS} steps. "
                "Give the array its noise=..., or a larger parameter"
            )
        return replace(out, converged=(found.misfit <= SOLVED).reshape(batch), said=tuple(said))

    def _frames(self, readings: Sequence[Floats]) -> Iterated:
        """The solution of some frames, given as (frame, channel, *array) per plane."""
        system = self.system
        rows, floor = system.normal.rows(readings), self.noise_floor(readings, len(readings[0]))
        removed, first, start = None, None, None
        if self.patterns is not None:
            removed, first, start = self.patterns.removed_near(rows, floor)
            rows = removed.coefficients
        without, unsettled = np.zeros((2, len(rows)), dtype=bool)
        goal: float | Floats = TOLERANCE[readings[0].dtype.itemsize]
        if isinstance(self.parameter, str):
            found = Search(system, self.parameter, floor).find(rows, first, start)
            parameter, without, unsettled, start = found.parameter, found.without, found.unsettled, found.solutions
            if without.any():
                other = Search(system, "evidence", None if floor is None else floor[without]).find(rows[without])
                parameter[without], start[without] = other.parameter, other.solutions
                unsettled[without] = other.unsettled
            if system.space.of_readings:
                size = np.linalg.norm(rows, axis=1)
                noise = parameter * np.linalg.norm(start, axis=1) / np.where(size > 0, size, 1.0)
                goal = np.clip(LEARNED * noise, goal, max(goal, LARGEST))
        else:
            parameter = np.full(len(rows), float(self.parameter))
        solved, sought = system.space.estimate(rows, parameter, tolerance=goal, most=MAX_STEPS, start=start)
        residual = parameter**2 * (solved.rows**2).sum(axis=1)
        explained = parameter * (rows * solved.rows).sum(axis=1)
        free = np.full(len(rows), self.count)
        if floor is not None:
            free -= system.freedom.of(parameter)
        by_evidence = without | (self.parameter == "evidence")
        variance = noise_variance(explained, residual, free, self.count, by_evidence, floor)
        return Iterated(
            traction=self._everywhere(sought),
            choice=Choice(parameter, variance, residual, free, without, "evidence"),
            data=rows,
            floor=floor,
            removed=removed,
            unsettled=unsettled,
            misfit=solved.residual,
        )

    def again(self, readings: Sequence[Floats], parameter: Floats) -> Floats:
        space, out = self.system.space, []
        for i in range(0, len(parameter), self.together):
            part = slice(i, i + self.together)
            rows = self.system.normal.rows([r[part] for r in readings])
            out.append(space.traction(space.solve(rows, parameter[part], tolerance=SOLVED, most=MAX_STEPS)))
        return self._everywhere(np.concatenate(out))

    def _everywhere(self, sought: Floats) -> Floats:
        """Traction (frame, component, *surface) from that of the components sought."""
        return in_components(sought, self.system.columns, len(self.grid.components), self.grid.dimensions)
