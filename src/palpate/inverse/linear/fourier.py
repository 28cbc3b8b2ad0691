"""The spectrum of a periodic surface: a small singular value decomposition per wavevector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from palpate._arrays import from_numpy, irfftn, namespace, rfftn
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.linear.parameter import Tried, tried_on
from palpate.inverse.linear.priors import Prior, wavenumbers
from palpate.sensing.operator import Operator, periodic_transfer

__all__ = ["FourierSpectrum"]


class FourierSpectrum:
    """Spectrum of a periodic surface: a small SVD per wavevector."""

    eigenvalues: Floats
    multiplicity: Floats

    def __init__(
        self, operator: Operator, priors: Sequence[Prior], columns: Sequence[int], scales: Sequence[Floats]
    ) -> None:
        self.operator, self.columns = operator, list(columns)
        grid = operator.surface
        if any(a.mask is not None for a in operator.planes_of):
            raise Unsupported('boundary="periodic" cannot leave out taxels; use boundary="free", or fill them first.')
        if any(a.noise_correlation for a in operator.planes_of):
            raise Unsupported(
                'boundary="periodic" takes noise as independent; use boundary="free" for correlated noise.'
            )
        matrices = [
            periodic_transfer(operator.pad, grid, a) / s.reshape(-1, *(1,) * (1 + grid.dimensions))
            for a, s in zip(operator.planes_of, scales)
        ]
        stacked = np.moveaxis(np.concatenate(matrices)[:, self.columns], (0, 1), (-2, -1))
        k = wavenumbers(grid.shape, grid.spacings)
        root = np.sqrt(np.stack([prior.spectrum(k) for prior in priors], axis=-1))  # (*k, component)
        u, s, vh = np.linalg.svd(stacked * root[..., None, :], full_matrices=True)
        rank = s.shape[-1]
        values = np.zeros(u.shape[:-1])
        values[..., :rank] = s**2
        half = np.full(values.shape, 2.0)
        half[..., 0, :] = 1.0
        if grid.shape[-1] % 2 == 0:
            half[..., -1, :] = 1.0
        self._shape = values.shape
        self._forward = np.conj(np.swapaxes(u, -1, -2))  # (*k, n, channel)
        shape: tuple[int, ...] = values.shape
        self._back = np.zeros((*shape[:-1], len(self.columns), shape[-1]), dtype=np.complex128)
        self._back[..., :rank] = root[..., :, None] * np.conj(np.swapaxes(vh, -1, -2))[..., :rank]
        # at k = 0 a half-space's displacement sees nothing: the mean is unknown, not uncertain, and an offset is neither traction nor noise
        self._twice = half[..., 0].copy()
        self._zero = (0,) * grid.dimensions
        blind = values[self._zero] == 0
        half[self._zero][blind] = 0.0
        seen = (np.abs(self._back[self._zero][:, ~blind]) ** 2).sum(axis=-1)
        #: Whether the mean of each component sought can be known.
        self.mean_seen = seen > 0.5 * root[self._zero] ** 2
        self._root = root
        self.eigenvalues, self.multiplicity = values.ravel(), half.ravel()
        self._scales = scales
        self._norm = math.sqrt(math.prod(grid.shape))
        self._copies: dict[tuple[Any, ...], Any] = {}

    @cached_property
    def tried(self) -> Tried:
        """What the choice of Tikhonov's parameter asks of it whatever the readings."""
        return tried_on(self.eigenvalues, self.multiplicity)

    @property
    def nbytes(self) -> int:
        """Memory that it holds."""
        return self._forward.nbytes + self._back.nbytes

    def _prepared(self, like: Any) -> Any:
        # single-precision readings and coefficients share one key through the real dtype of the readings
        xp = namespace(like)
        key = (xp.__name__, str(like.dtype), str(getattr(like, "device", "")))
        if key not in self._copies:
            scales = [from_numpy(s.reshape(-1, *(1,) * self.operator.surface.dimensions), like) for s in self._scales]
            self._copies[key] = from_numpy(self._forward, like), from_numpy(self._back, like), scales
        return self._copies[key]

    def project(self, readings: Sequence[Any]) -> Any:
        xp, grid = namespace(readings[0]), self.operator.surface
        forward, _, scales = self._prepared(readings[0])
        d = grid.dimensions
        spectra = [rfftn(r / s, grid.shape) / self._norm for r, s in zip(readings, scales)]
        data = xp.moveaxis(xp.concat(spectra, axis=-1 - d), -1 - d, -1)
        out = xp.matmul(forward, data[..., None])[..., 0]
        return xp.reshape(out, (*out.shape[: -1 - d], -1))

    def solve(self, weights: Any) -> Any:
        xp, grid = namespace(weights), self.operator.surface
        _, back, _ = self._prepared(xp.real(weights))
        d = grid.dimensions
        batch = weights.shape[:-1]
        spectrum = xp.matmul(back, xp.reshape(weights, (*batch, *self._shape))[..., None])[..., 0]
        images = irfftn(xp.moveaxis(spectrum, -1, -1 - d) * self._norm, grid.shape)
        out = []
        for column in range(len(grid.components)):
            if column in self.columns:
                out.append(images[(..., self.columns.index(column), *(slice(None),) * d)])
            else:
                out.append(xp.zeros_like(images[(..., 0, *(slice(None),) * d)]))
        return xp.stack(out, axis=-1 - d)

    def sums(self, rows: Floats) -> tuple[Floats, Floats]:
        """(w'V_i)^2 (row, n) and w'(W - V V')w (row,) for ``rows`` w (row, component sought, *surface), without a mean that leaves no trace."""
        spectrum = np.moveaxis(rfftn(rows, self.operator.surface.shape) / self._norm, 1, -1)  # (row, *k, component)
        inner = (np.conj(self._back) * spectrum[..., :, None]).sum(axis=-2)  # (row, *k, n)
        powers = self.multiplicity.reshape(self._shape) * np.abs(inner) ** 2
        whole = self._twice * (np.abs(spectrum) ** 2 * self._root**2).sum(axis=-1)
        rest = whole - powers.sum(axis=-1)
        rest[(slice(None), *self._zero)] = 0.0
        return powers.reshape(len(rows), -1), np.maximum(rest, 0.0).reshape(len(rows), -1).sum(axis=1)

    def cells(self) -> tuple[Floats, Floats, Floats]:
        """The same of any cell: (n,), (n, component sought, 1...), (component sought, 1...)."""
        count = math.prod(self.operator.surface.shape)
        ones = (1,) * len(self._zero)
        half = self.multiplicity.reshape(self._shape)
        squares = half[..., None, :] * np.abs(self._back) ** 2 / count  # (*k, component, n)
        rest = self._twice[..., None] * self._root**2 / count - squares.sum(axis=-1)
        rest[self._zero] = 0.0
        powers = np.swapaxes(squares, -1, -2).reshape(-1, len(self.columns))
        total = np.maximum(rest, 0.0).reshape(-1, len(self.columns)).sum(axis=0)
        return self.eigenvalues, powers.reshape(-1, len(self.columns), *ones), total.reshape(-1, *ones)
