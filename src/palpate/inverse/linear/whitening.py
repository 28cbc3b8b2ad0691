"""Vector of working readings: whitening of correlated noise, and marginalisation of nuisances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.operator import Operator

__all__ = ["Readings", "axis_roots", "inverse_root"]

Flags = npt.NDArray[np.bool_]

#: Number of cached roots, one for each set of working taxels.
CACHE_SIZE = 16


def inverse_root(points: Floats, length: float) -> Floats:
    """R^{-1/2}, symmetric, of the correlation R = exp(-sum |dx|/length) between ``points`` (taxel, axis)."""
    distance = np.abs(points[:, None, :] - points[None, :, :]).sum(axis=-1)
    values, vectors = np.linalg.eigh(np.exp(-distance / length))
    return np.asarray((vectors / np.sqrt(values)) @ vectors.T)


def axis_roots(array: Array) -> list[Floats] | None:
    """R^{-1/2} for each axis of a regular array, whose product is R^{-1/2} of the array; None for independent noise.

    They are symmetric and stationary, so that they commute with the array's mirror symmetry.
    """
    if not array.noise_correlation or isinstance(array, ScatteredArray):
        return None
    return [inverse_root(x[:, None], array.noise_correlation) for x in array.grid.axes]


class Readings:
    """One vector of all working readings (plane, channel, taxel), and its whitening.

    ``scales`` are the standard deviations of each channel of each plane; ``std`` holds them for every reading.
    """

    def __init__(self, operator: Operator, scales: Sequence[Floats]) -> None:
        self.arrays = operator.planes_of
        self._valid = [np.flatnonzero(a.valid) for a in self.arrays]
        self.sizes = [len(v) for v in self._valid]
        self.std = np.concatenate([np.repeat(s, n) for s, n in zip(scales, self.sizes)])
        self.independent = not any(a.noise_correlation for a in self.arrays)
        self._roots: dict[tuple[int, bytes], Floats] = {}

    def flat(self, rows: Sequence[Floats]) -> Floats:
        """One vector from one array (channel, *array) per plane."""
        return np.concatenate(
            [r.reshape(len(a.channels), -1)[:, v].ravel() for a, v, r in zip(self.arrays, self._valid, rows)]
        )

    def planes(self, data: Floats) -> list[Floats]:
        """Inverse of `flat`; zero for missing taxels."""
        out: list[Floats] = []
        start = 0
        for array, valid in zip(self.arrays, self._valid):
            size = len(valid) * len(array.channels)
            part = np.zeros((len(array.channels), math.prod(array.shape)))
            part[:, valid] = data[start : start + size].reshape(len(array.channels), len(valid))
            out.append(part.reshape(len(array.channels), *array.shape))
            start += size
        return out

    def whitened(self, data: Floats, observed: Flags, noise: Floats | None = None) -> Floats:
        """Whitened rows (observed reading, ...) of ``data`` (reading, ...) with this ``noise`` (reading,); None: `std`."""
        noise = self.std if noise is None else noise
        return self.white(data[observed] / noise[observed].reshape(-1, *[1] * (data.ndim - 1)), observed)

    def white(self, scaled: Floats, observed: Flags) -> Floats:
        """Multiply rows (observed reading, ...), already divided by their noise, by R^{-1/2} of the ``observed`` readings."""
        if self.independent:
            return scaled
        out = np.array(scaled)
        first, start = 0, 0
        for i, (array, n) in enumerate(zip(self.arrays, self.sizes)):
            for _ in array.channels:
                chosen = observed[first : first + n]
                count = int(chosen.sum())
                if array.noise_correlation and count:
                    out[start : start + count] = self._root(i, chosen) @ out[start : start + count]
                first, start = first + n, start + count
        return out

    def _root(self, plane: int, chosen: Flags) -> Floats:
        key = (plane, chosen.tobytes())
        if key not in self._roots:
            if len(self._roots) >= CACHE_SIZE:  # taxels come and go in a long stream
                self._roots.clear()
            array = self.arrays[plane]
            axes = axis_roots(array)
            if axes is not None and array.mask is None and chosen.all():
                self._roots[key] = reduce(np.kron, axes)
            else:
                points = array.points[array.valid.ravel()][chosen]
                self._roots[key] = inverse_root(points, array.noise_correlation)
        return self._roots[key]
