"""The founding paper's model on the array's own grid: division of Fourier transforms, and the linear system it stands for.

Both take the traction as concentrated loads at the taxel positions, g_i = dx sum_j K(x_i - x_j) f_j. "dft" pretends that
the sum is circular and divides transforms; "linear" solves the sum as it stands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, irfftn, is_numpy, namespace, rfftn
from palpate._memory import require
from palpate.elastic.half_space import Pad
from palpate.errors import NotObservable, Unsupported
from palpate.inverse.regularised import LARGEST_BLOCK, Estimate
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid
from palpate.sensing.operator import Operator, sampled_kernel

__all__ = ["Division", "LinearSolve"]


def _check(planes: Sequence[Array], columns: Sequence[int], method: str) -> Grid:
    first = planes[0]
    if isinstance(first, ScatteredArray):
        raise Unsupported(
            f'method="{method}" needs a regular array (LineArray or AreaArray); use method="tikhonov" for scattered '
            "positions, or grid the recording first (Recording.gridded)."
        )
    grid: Grid = first.grid
    for other in planes[1:]:
        if isinstance(other, ScatteredArray) or other.grid != grid:
            raise Unsupported(f'method="{method}" needs all planes on one grid; use method="tikhonov".')
    if any(p.mask is not None for p in planes):
        raise Unsupported(f'method="{method}" needs every taxel; use method="tikhonov" when some are missing.')
    rows = sum(len(p.channels) for p in planes)
    if rows < len(columns):
        raise NotObservable(
            f'method="{method}" cannot find {len(columns)} components from {rows} channel{"s" if rows > 1 else ""}: '
            "ask for fewer with components=[...], or measure more."
        )
    return grid


class Division:
    """method="dft": divide the transform of the readings by that of the sampled, wrapped kernel.

    Several channels and components solve the small system of each wavevector (least squares when there are more channels
    than components). On even grids the lag of half the array is its own mirror image and takes the mean of both signs.
    """

    def __init__(self, pad: Pad, planes: Sequence[Array], columns: Sequence[int]) -> None:
        self.grid = _check(planes, columns, "dft")
        self.columns = list(columns)
        spectra = []
        for array in planes:
            kernel = sampled_kernel(pad, array).planes[0].kernel  # type: ignore[attr-defined]
            spectra.append(_wrapped_spectrum(kernel[:, self.columns], self.grid.shape))
        stacked = np.moveaxis(np.concatenate(spectra), (0, 1), (-2, -1))  # (*k, channel, component)
        with np.errstate(divide="ignore", invalid="ignore"):
            square = stacked.shape[-1] == stacked.shape[-2]
            self._inverse = _inverse(stacked) if square else np.linalg.pinv(stacked)
        if not np.isfinite(self._inverse).all():
            raise NotObservable(
                'method="dft" divides by zero: at some wavevector these channels do not see these components at all. '
                'Use method="tikhonov".'
            )
        singular = np.linalg.svd(stacked, compute_uv=False)
        self.condition = float(singular[..., 0].max() / singular[..., -1].min())

    def solve(self, readings: Sequence[Any]) -> Estimate:
        """Traction (..., component, *array) on the array's own grid."""
        xp, d = namespace(readings[0]), self.grid.dimensions
        data = xp.concat(list(readings), axis=-1 - d)
        spectrum = xp.moveaxis(rfftn(data, self.grid.shape), -1 - d, -1)
        inverse = from_numpy(self._inverse, readings[0])
        out = xp.matmul(inverse, spectrum[..., None])[..., 0]
        images = irfftn(xp.moveaxis(out, -1, -1 - d), self.grid.shape)
        return Estimate(_embed(xp, images, self.columns, self.grid), None, None, None)


class LinearSolve:
    """method="linear": solve the non-periodic system exactly (least squares where there are more readings)."""

    def __init__(self, pad: Pad, planes: Sequence[Array], columns: Sequence[int]) -> None:
        self.grid = _check(planes, columns, "linear")
        self.columns = list(columns)
        unknowns = math.prod(self.grid.shape) * len(self.columns)
        if unknowns > LARGEST_BLOCK:
            raise Unsupported(
                f'method="linear" solves a dense system, here of {unknowns} unknowns (limit {LARGEST_BLOCK}); use '
                'method="dft", or boundary="periodic" with method="tikhonov".'
            )
        readings = sum(math.prod(a.shape) * len(a.channels) for a in planes)
        # the map of all components twice, then what is sought of it: twice, its factors, and three more where it is not square
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

    def solve(self, readings: Sequence[Any]) -> Estimate:
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
        return Estimate(_embed(xp, images, self.columns, self.grid), None, None, None)


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


def _embed(xp: Any, images: Any, columns: Sequence[int], grid: Grid) -> Any:
    """Put the components sought among all components, zero elsewhere."""
    tail = (slice(None),) * grid.dimensions
    zero = xp.zeros_like(images[(..., 0, *tail)])
    parts = [
        images[(..., list(columns).index(i), *tail)] if i in columns else zero for i in range(len(grid.components))
    ]
    return xp.stack(parts, axis=-1 - grid.dimensions)
