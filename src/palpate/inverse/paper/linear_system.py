"""Solve exactly the linear system that the founding paper solves approximately, by division (`Division`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, is_numpy, namespace
from palpate._memory import require
from palpate.elastic.pad import Pad
from palpate.errors import NotObservable, Unsupported
from palpate.inverse.estimate import Estimate
from palpate.inverse.linear.spectrum import LARGEST_BLOCK
from palpate.inverse.method import Method
from palpate.inverse.paper.grid import common_grid, embed
from palpate.inverse.problem import Problem
from palpate.sensing.arrays import Array
from palpate.sensing.operator import Operator, sampled_kernel

__all__ = ["LinearSystem", "LinearSystemEstimator"]


@dataclass(frozen=True, kw_only=True)
class LinearSystem(Method):
    """The linear system that `Division` treats as circular, solved exactly; only for readings without noise.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=121, pitch=0.5, depth=1.5, channels=["stress_zz"]))
    >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3.5, force=0.774))
    >>> touch = skin.reconstruct(readings, method=pp.paper.LinearSystem())
    >>> round(float(touch.force[1]), 2)  # per length
    0.77
    """

    name: ClassVar[str] = "linear"
    summary: ClassVar[str] = "the linear system that the division stands for, on the array's own grid"

    def prepare(self, problem: Problem) -> LinearSystemEstimator:
        """Build the matrix from traction to readings."""
        self.check(problem)
        return LinearSystemEstimator(problem.pad, problem.planes, problem.columns)


class LinearSystemEstimator:
    """Solve the non-periodic system exactly (least squares if there are more readings)."""

    def __init__(self, pad: Pad, planes: Sequence[Array], columns: Sequence[int]) -> None:
        self.grid = common_grid(planes, columns, "linear")
        self.columns = list(columns)
        unknowns = math.prod(self.grid.shape) * len(self.columns)
        if unknowns > LARGEST_BLOCK:
            raise Unsupported(
                f'method="linear" solves a dense system, here of {unknowns} unknowns (limit {LARGEST_BLOCK}); use '
                'method="dft", or boundary="periodic" with method="tikhonov".'
            )
        readings = sum(math.prod(a.shape) * len(a.channels) for a in planes)
        # Twice the map of all components, then of the components sought: twice, its factors, and three more if it is
        # not square.
        require(
            8.0 * math.prod(self.grid.shape) * readings * (2.0 * len(self.grid.components) + 6.0 * len(self.columns)),
            f'method="linear": {readings} readings and {unknowns} unknowns',
            'Use method="dft".',
        )
        operators: list[Operator] = [sampled_kernel(pad, a) for a in planes]
        blocks = [
            op.dense().reshape(-1, len(self.grid.components), *self.grid.shape)[:, self.columns] for op in operators
        ]
        self._operators = operators
        self._matrix = np.concatenate([b.reshape(len(b), -1) for b in blocks])
        self._factors: Any = None
        square = self._matrix.shape[0] == self._matrix.shape[1]
        self._pinv: npt.NDArray[np.float64] | None = None if square else np.linalg.pinv(self._matrix)
        if square and np.linalg.cond(self._matrix) > 1e15:
            raise NotObservable(
                'method="linear" meets a singular system: these channels do not fix these components. Use '
                'method="tikhonov", which says what it can.'
            )

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction (..., component, *array) on the array's own grid."""
        xp, d = namespace(readings[0]), self.grid.dimensions
        data = xp.concat(
            [xp.reshape(op._project(0, r), (*r.shape[: -1 - d], -1)) for op, r in zip(self._operators, readings)],
            axis=-1,
        )
        if self._pinv is not None:
            flat = xp.matmul(data, from_numpy(self._pinv, data).T)
        elif is_numpy(data):
            import scipy.linalg

            if self._factors is None:
                self._factors = scipy.linalg.lu_factor(self._matrix)
            columns = data.reshape(-1, data.shape[-1]).T
            flat = scipy.linalg.lu_solve(self._factors, columns).T.reshape(data.shape).astype(data.dtype, copy=False)
        else:
            flat = xp.linalg.solve(from_numpy(self._matrix, data), data[..., None])[..., 0]
        images = xp.reshape(flat, (*data.shape[:-1], len(self.columns), *self.grid.shape))
        return Estimate(embed(xp, images, self.columns, self.grid), None, None, None)
