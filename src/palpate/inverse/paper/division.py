"""The founding paper's division of Fourier transforms, on the array's own grid.

The traction consists of point loads at the taxel positions, g_i = dx sum_j K(x_i - x_j) f_j. The division treats this
sum as circular; `palpate.inverse.paper.linear_system` solves it exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, irfftn, namespace, rfftn
from palpate.elastic.pad import Pad
from palpate.errors import NotObservable
from palpate.inverse.estimate import Estimate
from palpate.inverse.method import Method
from palpate.inverse.paper.grid import common_grid, embed
from palpate.inverse.problem import Problem
from palpate.sensing.arrays import Array
from palpate.sensing.maps import kernel_of
from palpate.sensing.operator import sampled_kernel

__all__ = ["Division", "DivisionEstimator"]


@dataclass(frozen=True, kw_only=True)
class Division(Method):
    """The founding paper's method: division of discrete Fourier transforms, on the array's own grid; without noise only.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=121, pitch=0.5, depth=1.5, channels=["stress_zz"]))
    >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3.5, force=0.774))
    >>> touch = skin.reconstruct(readings, method=pp.paper.Division())
    >>> round(float(touch.force[1]), 2)  # per length
    0.77
    """

    name: ClassVar[str] = "dft"
    summary: ClassVar[str] = "the founding paper's division, on the array's own grid"

    def prepare(self, problem: Problem) -> DivisionEstimator:
        """The inverse of each wavevector's matrix."""
        self.check(problem)
        return DivisionEstimator(problem.pad, problem.planes, problem.columns)


class DivisionEstimator:
    """Divide the transform of the readings by that of the sampled, wrapped kernel.

    Several channels and components solve the small system of each wavevector (least squares when there are more channels
    than components). On even grids the lag of half the array is its own mirror image and takes the mean of both signs.
    """

    def __init__(self, pad: Pad, planes: Sequence[Array], columns: Sequence[int]) -> None:
        self.grid = common_grid(planes, columns, "dft")
        self.columns = list(columns)
        spectra = []
        for array in planes:
            kernel = kernel_of(sampled_kernel(pad, array).planes[0], "the founding paper's division")
            spectra.append(_wrapped_spectrum(kernel[:, self.columns], self.grid.shape))
        stacked = np.moveaxis(np.concatenate(spectra), (0, 1), (-2, -1))  # (*k, channel, component)
        with np.errstate(divide="ignore", invalid="ignore"):
            square = stacked.shape[-1] == stacked.shape[-2]
            self._inverse = _inverse(stacked) if square else np.linalg.pinv(stacked)
        if not np.isfinite(self._inverse).all():
            raise NotObservable(
                'method="dft" divides by zero: at some wavevector these components have no effect on these channels. '
                'Use method="tikhonov".'
            )
        singular = np.linalg.svd(stacked, compute_uv=False)
        self.condition = float(singular[..., 0].max() / singular[..., -1].min())

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction (..., component, *array) on the array's own grid."""
        xp, d = namespace(readings[0]), self.grid.dimensions
        data = xp.concat(list(readings), axis=-1 - d)
        spectrum = xp.moveaxis(rfftn(data, self.grid.shape), -1 - d, -1)
        inverse = from_numpy(self._inverse, readings[0])
        out = xp.matmul(inverse, spectrum[..., None])[..., 0]
        images = irfftn(xp.moveaxis(out, -1, -1 - d), self.grid.shape)
        return Estimate(embed(xp, images, self.columns, self.grid), None, None, None)

    @property
    def notes(self) -> tuple[str, ...]:
        """The notes of a result."""
        if self.condition > 1e8:
            return (f"division amplifies noise up to {self.condition:.1e} times",)
        return ()


def _wrapped_spectrum(kernel: npt.NDArray[np.float64], shape: tuple[int, ...]) -> npt.NDArray[np.complex128]:
    """Transform of lags -(n//2)..n//2 wrapped onto n points, from all lags -(n-1)..n-1."""
    for axis, n in enumerate(shape):
        half = n // 2
        position = 2 + axis
        wrapped = np.zeros((*kernel.shape[:position], n, *kernel.shape[position + 1 :]))
        target = np.moveaxis(wrapped, position, 0)
        source = np.moveaxis(kernel, position, 0)
        for lag in range(-half, half + 1):
            weight = 0.5 if n % 2 == 0 and abs(lag) == half else 1.0
            target[lag % n] += weight * source[lag + n - 1]
        kernel = wrapped
    return np.asarray(rfftn(kernel, shape))


def _inverse(stacked: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    if stacked.shape[-1] == 1:
        return np.asarray(1.0 / stacked)
    try:
        return np.asarray(np.linalg.inv(stacked))
    except np.linalg.LinAlgError:
        return np.full_like(stacked, np.inf)
