"""The spectrum of a periodic surface: a small singular value decomposition per wavevector."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate._arrays import irfftn, namespace, rfftn
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.linear.priors import Prior, wavenumbers
from palpate.inverse.linear.spectrum import Spectrum, in_components
from palpate.sensing.maps import Cached
from palpate.sensing.operator import Operator, multiply, periodic_transfer

__all__ = ["FourierSpectrum"]


class FourierSpectrum(Spectrum):
    """Spectrum of a periodic surface: a small SVD per wavevector; coefficients are ordered by mode, then wavevector."""

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
        # Order modes first and wavevectors last, so that sums over modes and channels are a few products of whole
        # arrays.
        rank, modes, waves = s.shape[-1], u.shape[-1], u.shape[:-2]
        values = np.zeros((modes, *waves))
        values[:rank] = np.moveaxis(s, -1, 0) ** 2
        twice = np.full(waves, 2.0)
        twice[..., 0] = 1.0
        if grid.shape[-1] % 2 == 0:
            twice[..., -1] = 1.0
        half = np.repeat(twice[None], modes, axis=0)
        self._shape = values.shape
        self._norm = math.sqrt(math.prod(grid.shape))
        each = np.concatenate(scales).reshape(-1, *(1,) * grid.dimensions) * self._norm
        # For unscaled readings: (n, channel, *k).
        self._forward = np.ascontiguousarray(np.conj(np.moveaxis(u, (-1, -2), (0, 1)))) / each
        self._back = np.zeros((len(self.columns), modes, *waves), dtype=np.complex128)  # (component, n, *k)
        spread = root[..., None, :] * np.conj(vh[..., :rank, :])  # (*k, n, component)
        self._back[:, :rank] = np.moveaxis(spread, (-1, -2), (0, 1))
        # At k = 0 the displacement of a half-space contains no information: the mean traction is unknown, and an offset
        # is neither traction nor noise.
        self._twice = twice
        self._zero = (0,) * grid.dimensions
        zero: Any = (slice(None), *self._zero)
        blind = values[zero] == 0
        half[zero] = np.where(blind, 0.0, half[zero])
        seen = (np.abs(self._back[(slice(None), ~blind, *self._zero)]) ** 2).sum(axis=-1)
        self.mean_seen = seen > 0.5 * root[self._zero] ** 2
        self._root = np.ascontiguousarray(np.moveaxis(root, -1, 0))  # (component, *k)
        self.eigenvalues, self.multiplicity = values.ravel(), half.ravel()
        self._forward_of, self._back_of = Cached(self._forward), Cached(self._back * self._norm)

    @property
    def nbytes(self) -> int:
        return self._forward.nbytes + self._back.nbytes

    def project(self, readings: Sequence[Any]) -> Any:
        xp, grid = namespace(readings[0]), self.operator.surface
        forward = self._forward_of.like(readings[0])
        d = grid.dimensions
        spectra = [rfftn(r, grid.shape) for r in readings]
        data = spectra[0] if len(spectra) == 1 else xp.concat(spectra, axis=-1 - d)
        out = multiply(xp, forward, data, forward.shape[0], range(forward.shape[1]), d, adjoint=False)
        return xp.reshape(out, (*out.shape[: -1 - d], -1))

    def solve(self, weights: Any) -> Any:
        xp, grid = namespace(weights), self.operator.surface
        # Single-precision coefficients need the kind of the readings.
        back = self._back_of.like(xp.real(weights))
        d = grid.dimensions
        modes = xp.reshape(weights, (*weights.shape[:-1], *self._shape))
        spectrum = multiply(xp, back, modes, back.shape[0], range(back.shape[1]), d, adjoint=False)
        images = irfftn(spectrum, grid.shape, overwrite=True)
        return in_components(images, self.columns, len(grid.components), d)

    def sums(self, rows: Floats) -> tuple[Floats, Floats]:
        """As `Spectrum.sums`, without a mean that the readings do not determine."""
        spectrum = rfftn(rows, self.operator.surface.shape) / self._norm  # (row, component, *k)
        inner = (np.conj(self._back) * spectrum[:, :, None]).sum(axis=1)  # (row, n, *k)
        powers = self.multiplicity.reshape(self._shape) * np.abs(inner) ** 2
        whole = self._twice * (np.abs(spectrum) ** 2 * self._root**2).sum(axis=1)
        rest = whole - powers.sum(axis=1)
        rest[(slice(None), *self._zero)] = 0.0
        return powers.reshape(len(rows), -1), np.maximum(rest, 0.0).reshape(len(rows), -1).sum(axis=1)

    def cells(self) -> tuple[Floats, Floats, Floats]:
        """As `Spectrum.cells`: all cells are alike."""
        count = math.prod(self.operator.surface.shape)
        ones = (1,) * len(self._zero)
        half = self.multiplicity.reshape(self._shape)
        squares = half * np.abs(self._back) ** 2 / count  # (component, n, *k)
        rest = self._twice * self._root**2 / count - squares.sum(axis=1)
        rest[(slice(None), *self._zero)] = 0.0
        powers = squares.reshape(len(self.columns), -1).T
        total = np.maximum(rest, 0.0).reshape(len(self.columns), -1).sum(axis=1)
        return self.eigenvalues, powers.reshape(-1, len(self.columns), *ones), total.reshape(-1, *ones)
