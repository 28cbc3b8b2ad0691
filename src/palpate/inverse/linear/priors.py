"""Prior covariances of traction, with fast products."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from functools import reduce
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate._arrays import irfftn, is_numpy, namespace, rfftn
from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.grids import Grid
from palpate.sensing.maps import Cached

__all__ = ["DifferencePrior", "Prior", "SpectralPrior", "hilgers_prior", "wavenumbers"]

#: Wavenumber used for k = 0, as a fraction of the smallest other one: the mean then has 1e8 (first derivative) or 1e16
#: (second) times the variance of the longest wave, so that it is determined by any reading that depends on it.
MEAN_WAVENUMBER = 1e-4
#: Largest number of cells along an axis for which a sine transform by a matrix is faster than an FFT.
MATRIX = 512


class Prior(Protocol):
    """A covariance W of one traction component on a surface grid."""

    #: Identifies the prior on a given grid: priors with equal keys are equal.
    key: Hashable

    def covariance(self, x: Any) -> Any:
        """W x over the last axes."""
        ...

    def root(self, x: Floats) -> Floats:
        """x C over the last axes, where C is a root with C C^T = W."""
        ...

    def spectrum(self, k: Floats) -> Floats:
        """W per wavenumber [rad/m] of a periodic surface, for the orthonormal Fourier transform."""
        ...

    def variance(self) -> Floats:
        """The diagonal of W (*surface)."""
        ...

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Random tractions (count, *surface) of covariance W."""
        ...

    def symbol(self, size: tuple[int, ...]) -> Floats:
        """Spectrum of W far from the surface's edge, for the wavevectors of a real FFT of ``size`` cells."""
        ...


class DifferencePrior:
    """Tikhonov's penalty: int |D^m t|^2/scale over the surface, of order m = 0, 1 or 2, with t = 0 beyond its edge.

    With second differences and zero beyond the edge, the penalty is diagonal in the sine transform (DST-I), with
    eigenvalues (sum over axes of (2/dx sin(pi j/(2(n+1))))^2)^m per cell.
    """

    def __init__(self, grid: Grid, order: int, scale: float = 1.0) -> None:
        if order not in (0, 1, 2):
            raise InvalidInput(f"order must be 0, 1 or 2; got {order!r}.")
        self.grid, self.order = grid, order
        self.key: Hashable = ("difference", order, scale)
        waves = [
            2 / dx * np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1))) for n, dx in zip(grid.shape, grid.spacings)
        ]
        self.scale = scale
        self._in_sines = Cached(scale / (grid.cell * _summed([w**2 for w in waves]) ** order))

    @cached_property
    def _sines(self) -> list[Cached]:
        """Matrix of the DST-I for each axis. For long axes they need much memory and are only built if no FFT is
        available.
        """
        j = [np.arange(1, n + 1) for n in self.grid.shape]
        return [Cached(math.sqrt(2 / (len(i) + 1)) * np.sin(np.pi * np.outer(i, i) / (len(i) + 1))) for i in j]

    def half_sines(self, halves: Sequence[Floats], parities: Sequence[int]) -> list[Floats]:
        """For each axis, the sines of this parity (entry, sine) in the basis of half of it: every other one, from the
        first if even (1).
        """
        return [
            basis @ sines.value[:, (0 if sign > 0 else 1) :: 2]
            for basis, sines, sign in zip(halves, self._sines, parities)
        ]

    @property
    def in_sines(self) -> Floats:
        """W in sines (*surface)."""
        return self._in_sines.value

    def covariance(self, x: Any) -> Any:
        """W x over the last axes, in the array kind of ``x``."""
        return self._transform(self._in_sines.like(x) * self._transform(x))

    def root(self, x: Floats) -> Floats:
        """x C, with C = DST diag(sqrt W)."""
        return np.asarray(np.sqrt(self._in_sines.like(x)) * self._transform(x))

    def coloured(self, x: Floats) -> Floats:
        """C x, with the same C."""
        return np.asarray(self._transform(np.sqrt(self._in_sines.like(x)) * x))

    def variance(self) -> Floats:
        """The diagonal of W (*surface)."""
        if self.order == 0:
            return self.in_sines
        squares = [s.value**2 for s in self._sines]
        return squares[0] @ self.in_sines if len(squares) == 1 else squares[0] @ self.in_sines @ squares[1].T

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Random tractions (count, *surface) of covariance W."""
        return self.coloured(rng.standard_normal((count, *self.grid.shape)))

    def symbol(self, size: tuple[int, ...]) -> Floats:
        """Spectrum of the difference penalty; t = 0 at the edge determines the mean."""
        parts = []
        for n, wave, dx in zip(self.grid.shape, _frequencies(size), self.grid.spacings):
            edge = (2 / dx * np.sin(np.pi / (2 * (n + 1)))) ** 2
            parts.append((2 / dx * np.sin(np.pi * wave)) ** 2 + edge)
        return np.asarray(self.scale / (self.grid.cell * _summed(parts) ** self.order))

    def _transform(self, x: Any) -> Any:
        """The DST-I over the last axes."""
        if self.order == 0:
            return x  # W is a multiple of the identity in any basis
        if is_numpy(x) and max(self.grid.shape) > MATRIX:
            import scipy.fft

            return scipy.fft.dstn(x, type=1, axes=tuple(range(-self.grid.dimensions, 0)), norm="ortho")
        xp, sines = namespace(x), [s.like(x) for s in self._sines]
        if len(sines) == 1:
            return xp.matmul(x[..., None, :], sines[0])[..., 0, :]
        return xp.matmul(sines[0], xp.matmul(x, sines[1]))

    def spectrum(self, k: Floats) -> Floats:
        """1/(cell k^{2m}); the mean (k = 0), whose derivative is zero, is left practically free."""
        smallest = k[k > 0].min()
        return np.asarray(
            self.scale / (self.grid.cell * np.where(k > 0, k, MEAN_WAVENUMBER * smallest) ** (2 * self.order))
        )


class SpectralPrior:
    """Prior of a stationary, isotropic traction with power spectral density S(|k|) [Pa^2 m per axis]."""

    def __init__(
        self, grid: Grid, density: Callable[[Floats], npt.ArrayLike], scale: float = 1.0, key: Hashable = None
    ) -> None:
        self.grid, self._density = grid, density
        self.key: Hashable = ("density", density, scale) if key is None else key
        self.scale = scale
        self._size = tuple(2 * n for n in grid.shape)
        k = wavenumbers(self._size, grid.spacings)
        self._table = Cached(self._evaluate(k) / grid.cell)

    def _evaluate(self, k: Floats) -> Floats:
        try:
            value = np.asarray(self._density(k), dtype=np.float64) * self.scale
        except (TypeError, ValueError) as error:  # it returns no number, or accepts no array
            raise InvalidInput(
                f"spectrum must be a function that takes an array of wavenumbers [rad/m] and returns densities of the same shape; this one fails: {error}."
            ) from error
        if value.shape != k.shape or not np.isfinite(value).all() or (value < 0).any():
            raise InvalidInput(
                "spectrum must be a function of wavenumber [rad/m] (an array) that returns finite densities >= 0 of the same shape, at k = 0 too."
            )
        return value

    def covariance(self, x: Any) -> Any:
        """W x: convolution with the correlation function on a grid twice as wide."""
        out = irfftn(self._table.like(x) * rfftn(x, self._size), self._size)
        return out[(..., *(slice(0, n) for n in self.grid.shape))]

    def variance(self) -> Floats:
        """The diagonal of W (*surface)."""
        return np.full(self.grid.shape, irfftn(self._table.value, self._size).ravel()[0])

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Random tractions (count, *surface) of covariance W."""
        out: Any = self.root(rng.standard_normal((count, *self._size)))
        return np.asarray(out[(..., *(slice(0, n) for n in self.grid.shape))])

    def symbol(self, size: tuple[int, ...]) -> Floats:
        """S(k)/cell."""
        return self._evaluate(wavenumbers(size, self.grid.spacings)) / self.grid.cell

    def root(self, x: Floats) -> Floats:
        """x C with C = (restriction to the surface) times a Fourier root on the wider grid, as real columns."""
        return np.asarray(irfftn(np.sqrt(self._table.value) * rfftn(x, self._size), self._size))

    def spectrum(self, k: Floats) -> Floats:
        """S(k)/cell."""
        return self._evaluate(k) / self.grid.cell


def wavenumbers(size: tuple[int, ...], spacings: tuple[float, ...]) -> Floats:
    """|k| [rad/m] on the half-spectrum of a real FFT."""
    return np.sqrt(_summed([(2 * np.pi * wave / dx) ** 2 for wave, dx in zip(_frequencies(size), spacings)]))


def _frequencies(size: tuple[int, ...]) -> list[Floats]:
    """Frequencies [1/sample] along each axis of the half-spectrum of a real FFT."""
    return [*(np.fft.fftfreq(n) for n in size[:-1]), np.fft.rfftfreq(size[-1])]


def _summed(parts: list[Floats]) -> Floats:
    """The sum of functions of one axis each, on the grid of all axes."""
    return np.asarray(reduce(np.add.outer, parts))


def hilgers_prior(grid: Grid, length: float) -> SpectralPrior:
    """The reproducing kernel of a Sobolev space with correlation ``length`` [m].

    J. W. Hilgers (SIAM J. Numer. Anal. 13, 1976, 172-184) showed that regularising a first-kind equation K f = g in
    the norm of a reproducing-kernel Hilbert space with kernel Q gives f = Q K* (K Q K* + alpha)^{-1} g. Here Q is the
    kernel of the Sobolev norm int t^2 + l^2 |t'|^2 on a line, exp(-|x|/l), and of its square on an area (the first
    power has no bounded kernel in two dimensions): spectrum (1 + l^2 k^2)^{-d} in d dimensions.
    """
    d = grid.dimensions
    return SpectralPrior(grid, lambda k: length**d * (1.0 + (length * k) ** 2) ** (-d), key=("hilgers", length))
