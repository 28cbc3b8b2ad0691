"""The system that a Tikhonov filter solves in the space of the readings.

With the readings y divided by their noise and a prior covariance W of the traction, H = N^{-1/2} A and

    (H W H^T + lambda) u = y,      t = W H^T u

(W. Menke, Geophysical Data Analysis, 1989, section 5): as many unknowns as readings, whatever the surface grid. Products are those of
the operator (FFTs); nothing of the size of a matrix is formed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.memory import AT_A_TIME
from palpate.inverse.linear.priors import Prior
from palpate.inverse.linear.whitening import axis_roots
from palpate.sensing.arrays import ScatteredArray
from palpate.sensing.operator import Operator

__all__ = ["Normal"]


class Normal:
    """M = H W H^T as products with rows of readings (frame, n): all taxels by plane and channel, missing ones zero.

    Attributes
    ----------
    total : int
        Entries of a row.
    count : int
        Working readings.
    valid : array (n,) or None
        Which of them work; None: all.
    """

    def __init__(
        self, operator: Operator, priors: Sequence[Prior], columns: Sequence[int], scales: Sequence[Floats]
    ) -> None:
        self.operator, self.priors, self.columns = operator, list(priors), list(columns)
        self.shapes = [(len(a.channels), *a.shape) for a in operator.planes_of]
        self.sizes = [math.prod(s) for s in self.shapes]
        self.total = sum(self.sizes)
        self._scales = [s.reshape(-1, *(1,) * (len(shape) - 1)) for s, shape in zip(scales, self.shapes)]
        self._gains = [1.0 / s for s in self._scales]
        self._roots = [axis_roots(a) for a in operator.planes_of]
        masked = any(a.mask is not None for a in operator.planes_of)
        self.valid = (
            np.concatenate([np.tile(a.valid.ravel(), len(a.channels)) for a in operator.planes_of]) if masked else None
        )
        self.count = self.total if self.valid is None else int(self.valid.sum())
        surface = operator.surface
        padded = max(math.prod(getattr(p, "size", shape)) for p, shape in zip(operator.planes, self.shapes))
        held = 4 * padded * (len(surface.components) + max(s[0] for s in self.shapes))
        #: Frames multiplied at a time.
        self.chunk = max(1, AT_A_TIME // held)

    def rows(self, readings: Sequence[Floats]) -> Floats:
        """Whitened readings N^{-1/2} y (frame, n) from readings (frame, channel, *array), one array per plane."""
        parts = [
            np.where(a.valid, np.asarray(r, dtype=np.float64), 0.0) for a, r in zip(self.operator.planes_of, readings)
        ]
        return self.joined(self._whitened(parts))

    def scale(self, plane: int, channel: int) -> float:
        """Standard deviation that a channel is divided by."""
        return float(self._scales[plane].ravel()[channel])

    def whiteness(self, plane: int, waves: tuple[int, ...], size: tuple[int, ...]) -> Floats | None:
        """Spectrum of R^{-1}, the inverse of the noise's correlation, at the first ``waves`` of FFTs of ``size``; None
        for independent noise.
        """
        array = self.operator.planes_of[plane]
        if not array.noise_correlation or isinstance(array, ScatteredArray):
            return None
        spectra = []
        for count, n, pitch in zip(waves, size, array.grid.spacings):
            # The inverse of exp(-|x|/length) on a lattice is tridiagonal.
            part = math.exp(-pitch / array.noise_correlation)
            wave = 2.0 * part * np.cos(2 * np.pi * np.arange(count) / n)
            spectra.append((1.0 + part**2 - wave) / (1.0 - part**2))
        return np.asarray(reduce(np.multiply.outer, spectra))

    def joined(self, planes: Sequence[Floats]) -> Floats:
        """Rows (frame, n) from one array (frame, channel, *array) per plane, missing taxels zero."""
        parts = [p.reshape(len(p), -1) for p in planes]
        rows = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
        return rows if self.valid is None else rows * self.valid

    def planes(self, rows: Floats) -> list[Floats]:
        """(frame, channel, *array) per plane."""
        out, start = [], 0
        for shape, size in zip(self.shapes, self.sizes):
            out.append(rows[:, start : start + size].reshape(len(rows), *shape))
            start += size
        return out

    def traction(self, rows: Floats) -> Floats:
        """W H^T u: (frame, component sought, *surface)."""
        return self.chunked(lambda some: self.covariance(self.seen(some)), rows)

    def readings(self, traction: Floats) -> Floats:
        """H t (frame, n) of (frame, component sought, *surface)."""
        return self.chunked(
            lambda some: self.joined(self._whitened(self.operator.forward(some, self.columns))), traction
        )

    def apply(self, rows: Floats) -> Floats:
        """M u."""
        return self.chunked(lambda some: self.readings(self.traction(some)), rows)

    def covariance(self, traction: Floats) -> Floats:
        """W t."""
        if all(prior.key == self.priors[0].key for prior in self.priors):
            return np.asarray(self.priors[0].covariance(traction))
        return np.stack([prior.covariance(traction[:, i]) for i, prior in enumerate(self.priors)], axis=1)

    def chunked(self, function: Callable[[Floats], Floats], rows: Floats) -> Floats:
        """Apply ``function`` to rows in chunks, to limit memory."""
        if len(rows) <= self.chunk:
            return function(rows)
        return np.concatenate([function(rows[i : i + self.chunk]) for i in range(0, len(rows), self.chunk)])

    def seen(self, rows: Floats) -> Floats:
        """A^T N^{-1/2} u: (frame, component sought, *surface)."""
        return np.asarray(self.operator.adjoint(self._whitened(self.planes(rows)), self.columns))

    def _whitened(self, parts: Sequence[Floats]) -> list[Floats]:
        """Multiply by N^{-1/2}, which is symmetric."""
        out: list[Floats] = []
        for part, scale, roots in zip(parts, self._gains, self._roots):
            part = part * scale.astype(part.dtype)
            if roots is not None:
                part = part @ roots[-1].astype(part.dtype)
                if len(roots) == 2:
                    part = roots[0].astype(part.dtype) @ part
            out.append(part)
        return out
