"""The linear methods with a Tikhonov filter, at any size."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from palpate.inverse.linear.parameter import MODEL_ERROR, TINY, check_parameter, check_rule, tikhonov
from palpate.inverse.linear.patterns import Removed
from palpate.inverse.linear.posterior import UNEXPLAINED, LinearErrors, Uncertainty

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


class MatrixFree:
    """As `palpate.inverse.linear.regularised.Regularised` with Tikhonov's filter, on a matrix-free `System`."""

    def __init__(
        self,
        system: System,
        parameter: float | str,
        *,
        absolute: bool = False,
        nuisance: tuple[str, ...] | None = (),
    ) -> None:
        check_parameter(parameter)
        if isinstance(parameter, str):
            check_rule(parameter, tikhonov, noise_known=system.noise_known)
        self.system, self.parameter, self.absolute = system, parameter, absolute
        self.operator, self.grid = system.operator, system.operator.surface
        self.scales, self.noise_known = system.scales, system.noise_known
        self.patterns: SolvedPatterns | None = None
        if nuisance != ():
            known = float(parameter) if absolute else None
            self.patterns = SolvedPatterns(system, self.operator, self.scales, nuisance, known)

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array per plane."""
        like = readings[0]
        batch = tuple(like.shape[: -len(self.system.normal.shapes[0])])
        count = math.prod(batch)
        flat = [to_numpy(r).reshape(count, *r.shape[len(batch) :]) for r in readings]
        tolerance = TOLERANCE[flat[0].dtype.itemsize]
        together = max(1, TOGETHER // self.system.normal.total)
        parts = [self._frames([r[i : i + together] for r in flat], tolerance) for i in range(0, count, together)] or [
            self._frames(flat, tolerance)
        ]
        joined: dict[str, Any] = {
            name: None if parts[0][name] is None else np.concatenate([p[name] for p in parts]) for name in parts[0]
        }
        removed = joined.pop("directions")
        traction = joined["traction"].reshape(*batch, *joined["traction"].shape[1:])
        traction = traction.astype(flat[0].dtype) if is_numpy(like) else from_numpy(traction, like)
        chosen, variance = joined["parameter"].reshape(batch), joined["variance"].reshape(batch)
        scale = np.sqrt(variance)
        ones = np.ones(batch) if self.absolute else None
        known = Uncertainty(
            chosen,
            ones,
            ones,
            floor=None if self.noise_known else joined["floor"].reshape(batch),
            patterns=None if removed is None else removed.reshape(*batch, *removed.shape[1:]),
            data=None if self.absolute else joined["rows"].reshape(*batch, -1),
        )
        variances = self.system.variances = self.system.variances or SampledVariances(self.system)
        errors = LinearErrors.of(variances, tikhonov, traction, known)
        return Estimate(
            traction,
            chosen,
            scale,
            np.sqrt(joined["left"] / self.system.normal.count).reshape(batch) / np.maximum(scale, TINY),
            errors=errors,
            converged=(joined["misfit"] <= SOLVED).reshape(batch),
            noise_std=scale[..., None] * np.concatenate(self.scales),
            said=self._notes(joined, batch),
        )

    def _frames(self, readings: Sequence[Floats], tolerance: float) -> dict[str, Any]:
        """Traction and other results of some frames, given as (frame, channel, *array) per plane; all results have the
        frame axis first.
        """
        system = self.system
        rows = system.normal.rows(readings)
        floor = None if self.noise_known else self._floor(readings)
        taken = None if self.patterns is None else self.patterns.taken_out(rows, floor)
        removed, first, start = (None, None, None) if taken is None else taken
        if removed is not None:
            rows = removed.coefficients
        without, unsettled = np.zeros((2, len(rows)), dtype=bool)
        if isinstance(self.parameter, str):
            found = Search(system, self.parameter, floor).find(rows, first, start)
            parameter, without, unsettled, start = found.parameter, found.without, found.unsettled, found.solutions
            if without.any():
                other = Search(system, "evidence", None if floor is None else floor[without]).find(rows[without])
                parameter[without], start[without] = other.parameter, other.solutions
                unsettled[without] = other.unsettled
        else:
            parameter = np.full(len(rows), float(self.parameter))
        goal: float | Floats = tolerance
        if isinstance(self.parameter, str) and start is not None and system.space.corrected:
            size = np.linalg.norm(rows, axis=1)
            noise = parameter * np.linalg.norm(start, axis=1) / np.where(size > 0, size, 1.0)
            goal = np.clip(LEARNED * noise, tolerance, max(tolerance, LARGEST))
        solved, sought = system.space.estimate(rows, parameter, tolerance=goal, most=MAX_STEPS, start=start)
        left = parameter**2 * (solved.rows**2).sum(axis=1)
        explained = parameter * (rows * solved.rows).sum(axis=1)
        variance = np.ones(len(rows))
        free = np.full(len(rows), float(system.normal.count))
        if floor is not None:
            free -= system.freedom.of(parameter)
            by_evidence = (self.parameter == "evidence") | without
            variance = np.where(by_evidence, explained / system.normal.count, left / np.maximum(free, 1.0))
            variance = np.maximum(variance, floor)
        blind = np.zeros(len(rows), dtype=bool)
        if floor is not None:
            blind = free / system.normal.count < UNEXPLAINED
        traction = np.zeros((len(rows), len(self.grid.components), *self.grid.shape))
        traction[:, list(system.columns)] = sought
        return {
            "traction": traction,
            "parameter": parameter,
            "variance": variance,
            "left": left,
            "misfit": solved.residual,
            "without": without,
            "unsettled": unsettled,
            "blind": blind,
            "rows": rows,
            "floor": floor,
            "directions": None if removed is None else removed.directions,
            "sizes": None if removed is None else removed.sizes,
            "deviations": None if removed is None else removed.deviations,
        }

    def again(self, readings: Sequence[Floats], parameter: Floats) -> Floats:
        """Traction (frame, component, *surface) of readings (frame, channel, *array) per plane with given parameters (frame,), without subtracting
        nuisances.
        """
        out = np.zeros((len(parameter), len(self.grid.components), *self.grid.shape))
        together = max(1, TOGETHER // self.system.normal.total)
        for i in range(0, len(parameter), together):
            part = slice(i, i + together)
            rows = self.system.normal.rows([r[part] for r in readings])
            solved = self.system.space.solve(rows, parameter[part], tolerance=SOLVED, most=MAX_STEPS)
            out[part, list(self.system.columns)] = self.system.space.traction(solved)
        return out

    def _floor(self, readings: Sequence[Floats]) -> Floats:
        """Lower bound of the noise variance of each frame (frame,), relative to the whitening."""
        largest: Any = np.zeros(len(readings[0]))
        for array, scale, values in zip(self.operator.planes_of, self.scales, readings):
            rows = np.abs(values.reshape(len(values), len(scale), -1)[..., array.valid.ravel()])
            largest = np.maximum(largest, (rows.max(axis=-1) / scale).max(axis=-1))
        return np.asarray((MODEL_ERROR * largest) ** 2)

    def _notes(self, found: dict[str, Any], batch: tuple[int, ...]) -> tuple[str, ...]:
        """The notes on the frames."""
        said: list[str] = []
        if self.patterns is not None and found["sizes"] is not None:
            empty = np.zeros((len(found["sizes"]), 0))
            said += self.patterns.words(Removed(empty, empty, found["sizes"], found["deviations"]), batch)
        if found["without"].any():
            said.append(
                f'rule="{self.parameter}": the curve has no corner{in_frames(found["without"], batch)}, so "evidence" chose the parameter there'
            )
        if found["unsettled"].any():
            said.append(
                f'rule="{self.parameter}" did not settle on a parameter{in_frames(found["unsettled"], batch)}: the last one tried is used. Give '
                "parameter=..., or the array its noise=..."
            )
        if isinstance(self.parameter, str) and found["blind"].any():
            said.append(
                f"noise cannot be separated from traction{in_frames(found['blind'], batch)}, which explains the readings at every wavelength: "
                "fine detail of the map may be noise. Give the array its noise=..., and noise_correlation=... if neighbours share it, as windows that overlap do"
            )
        short = found["misfit"] > SOLVED
        if short.any():
            worst = float(found["misfit"].max())
            said.append(
                f"the iteration did not reach its tolerance{in_frames(short, batch)}: it left {worst:.1g} of the readings unsolved after {MAX_STEPS} steps. "
                "Give the array its noise=..., or a larger parameter"
            )
        return tuple(said)
