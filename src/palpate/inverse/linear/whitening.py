"""Vector of working readings: whitening of correlated noise, and marginalisation of nuisances."""

from __future__ import annotations

import copy
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
        self.sizes = [int(a.valid.sum()) for a in self.arrays]
        self.std = np.concatenate([np.repeat(s, n) for s, n in zip(scales, self.sizes)])
        self.independent = not any(a.noise_correlation for a in self.arrays)
        self._roots: dict[tuple[int, bytes], Floats] = {}

        #: Patterns (reading, nuisance) of any size, divided by the noise of the readings.
        self.patterns: Floats | None = None
        self._spans: dict[bytes, Floats] = {}

    def allowing(self, patterns: Floats | None) -> Readings:
        """A copy that marginalises ``patterns`` (reading, nuisance), in the unit of the channels: the part of readings
        that they explain has no weight.
        """
        out = copy.copy(self)
        out.patterns = None if patterns is None else patterns / self.std[:, None]
        out._spans = {}
        return out

    def sizes_of(self, scaled: Floats, observed: Flags) -> Floats:
        """Least-squares sizes (nuisance,) of the patterns in readings divided by ``std``."""
        if self.patterns is None:
            return np.zeros(0)
        white = self._uncorrelated(self.patterns[observed], observed)
        return np.asarray(np.linalg.lstsq(white, self._uncorrelated(scaled[observed], observed), rcond=1e-10)[0])

    def flat(self, rows: Sequence[Floats]) -> Floats:
        """One vector from one array (channel, *array) per plane."""
        return np.concatenate(
            [r.reshape(len(a.channels), -1)[:, a.valid.ravel()].ravel() for a, r in zip(self.arrays, rows)]
        )

    def planes(self, data: Floats) -> list[Floats]:
        """Inverse of `flat`; zero for missing taxels."""
        out: list[Floats] = []
        start = 0
        for array, n in zip(self.arrays, self.sizes):
            size = n * len(array.channels)
            part = np.zeros((len(array.channels), array.valid.size))
            part[:, array.valid.ravel()] = data[start : start + size].reshape(len(array.channels), n)
            out.append(part.reshape(len(array.channels), *array.shape))
            start += size
        return out

    @property
    def each_alone(self) -> bool:
        """Whether whitening leaves every reading unchanged."""
        return self.independent and self.patterns is None

    def white(self, scaled: Floats, observed: Flags) -> Floats:
        """Multiply rows (observed reading, ...), already divided by their noise, by R^{-1/2} of the ``observed``
        readings, and remove the part that the patterns explain.
        """
        out = self._uncorrelated(scaled, observed)
        if self.patterns is None:
            return out
        span = self._span(observed)
        return np.asarray(out - span @ (span.T @ out))

    def _span(self, observed: Flags) -> Floats:
        """Orthonormal columns (observed reading, nuisance) that span the patterns."""
        key = observed.tobytes()
        if key not in self._spans:
            if len(self._spans) >= CACHE_SIZE:
                self._spans.clear()
            white = self._uncorrelated(np.asarray(self.patterns)[observed], observed)
            size = np.sqrt((white**2).sum(axis=0))
            u, s, _ = np.linalg.svd(white / np.where(size > 0, size, 1.0), full_matrices=False)
            self._spans[key] = u[:, s > 1e-6]
        return self._spans[key]

    def _uncorrelated(self, scaled: Floats, observed: Flags) -> Floats:
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
