"""Influence of a surface cell on a sensing element in bonded layers.

The matrix of a wavevector has no closed form in space. It is transformed by quadrature over wavenumbers instead of a
DFT, so that no periodic copies of the pad appear, slowly decaying parts are integrated, and any position can be
requested.

Near the surface the matrix decays slowly with k. There the half-space response of the uppermost material, high-passed
by 1 - exp(-k d), is subtracted and added again in closed form (damping by exp(-k d) only moves the potentials down by
d). The remainder decays like exp(-k d), with d of the order of the first layer's thickness.

In area contact the matrix of direction alpha is a trigonometric polynomial sum_n c_n(k) exp(i n alpha), |n| <= 3, and

    (1/4 pi^2) int c_n(k) exp(i n alpha) exp(i k.x) d^2k = exp(i n theta) (i^n/2 pi) int c_n(k) J_n(k r) k dk.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats, Pad
from palpate.elastic.quantities import transfer

__all__ = ["Correction", "Surface"]

#: Exponent at which spectra are cut off: exp(-DIGITS).
DIGITS = 34.0
#: Highest angular order of a channel per traction.
ORDERS = 3
#: Angular orders below this fraction of a function's largest are rounding errors.
NOTHING = 1e-14
#: Spline values held at once: 16 MB.
LARGEST_TABLE = 2_000_000


class Surface(Pad, Protocol):
    """A half-space with an influence of its own."""

    def influence(
        self,
        offsets: Sequence[Floats],
        widths: Sequence[float],
        depth: float,
        channels: Sequence[str],
        *,
        concentrated: bool = False,
        damping: float = 0.0,
    ) -> Floats:
        """Channels per unit traction of one cell, see `palpate.HalfSpace.influence`."""
        ...


class Correction:
    """The difference between the response of a layered pad and the damped half-space of its first material.

    Attributes
    ----------
    half_space : Surface or None
        The subtracted half-space, or None.
    damping : float
        The depth d of its high-pass 1 - exp(-k d) [m].
    """

    def __init__(
        self,
        pad: Pad,
        surface: Surface,
        surface_thickness: float,
        depth: float,
        channels: Sequence[str],
        *,
        orders: int = ORDERS,
        decay: float = 1.0,
    ) -> None:
        """``surface`` is the half-space of the uppermost material, ``decay`` the slowest exp(-decay k z) of its waves
        and ``orders`` the highest angular order to include.
        """
        self.pad, self.depth, self.channels, self.orders = pad, depth, tuple(channels), orders
        first = surface_thickness
        self.half_space: Surface | None = surface if depth < 0.5 * first else None
        self.damping = first
        #: scale over which the remaining kernel varies
        self.scale = decay * (first if self.half_space is not None else depth)

    def _remaining(self, kx: Floats, ky: Floats, *, line: bool) -> npt.NDArray[np.complex128]:
        matrix = transfer(self.pad, kx, ky, self.depth, self.channels, line=line)
        if self.half_space is not None:
            high = -np.expm1(-np.hypot(kx, ky) * self.damping)
            matrix = (
                matrix - transfer(self.half_space, kx, ky, self.depth, self.channels, line=line) * high[..., None, None]
            )
        return matrix

    def _nodes(self, reach: float) -> tuple[Floats, Floats]:
        """Gauss-Legendre nodes and weights for int_0^infinity of a spectrum times a wave at distances up to ``reach``.

        Panels double in width from far below the slowest decay in the stack, then are as wide as the wave allows.
        """
        largest = DIGITS / self.scale
        widest = min(16.0 / max(reach, 1e-300), 2.0 / self.scale)
        start = 1e-7 / max(self.pad.thickness or 0.0, reach)
        edges = [0.0, start]
        while edges[-1] < largest:
            edges.append(edges[-1] + min(edges[-1], widest))
        t, w = np.polynomial.legendre.leggauss(16)
        low, high = np.array(edges[:-1])[:, None], np.array(edges[1:])[:, None]
        return ((low + high) / 2 + (high - low) / 2 * t).ravel(), ((high - low) / 2 * w).ravel()

    def line(self, x: Floats, spacing: float, aperture: float) -> Floats:
        """(channel, 2, ...) per unit traction of a cell of width ``spacing``, averaged over ``aperture``."""
        flat = x.ravel()
        reach = float(np.abs(flat).max(initial=0.0)) + spacing + aperture
        k, weight = self._nodes(reach)
        matrix = self._remaining(k, np.zeros_like(k), line=True)[..., [0, 2]]
        factor = weight / np.pi * spacing * np.sinc(k * spacing / (2 * np.pi)) * np.sinc(k * aperture / (2 * np.pi))
        spectrum = (matrix * factor[:, None, None]).reshape(k.size, -1)
        # The distances of a lattice repeat.
        distance, back = np.unique(np.round(np.abs(flat) / reach, 14), return_inverse=True)
        even, odd = np.empty((2, distance.size, spectrum.shape[1]))
        for start in range(0, distance.size, 2048):
            rows = slice(start, start + 2048)
            phase = (distance[rows, None] * reach) * k
            even[rows], odd[rows] = np.cos(phase) @ spectrum.real, np.sin(phase) @ spectrum.imag
        back = back.reshape(flat.shape)
        out = even[back] - np.sign(flat)[:, None] * odd[back]
        return np.moveaxis(out.reshape(*x.shape, len(self.channels), 2), (-2, -1), (0, 1))

    def area(
        self,
        offsets: Sequence[Floats],
        spacings: Sequence[float],
        rules: Sequence[tuple[Floats, Floats]],
        *,
        concentrated: bool,
    ) -> Floats:
        """(channel, 3, ..., ny, nx) per unit traction of a cell, averaged over the aperture's nodes."""
        sources = []
        for spacing in spacings:
            if concentrated:
                sources.append((np.zeros(1), np.ones(1)))
            else:
                few = 2 if spacing < self.scale / 8 else 2 + math.ceil(4.0 * spacing / self.scale)
                t, w = np.polynomial.legendre.leggauss(few)
                sources.append((t * spacing / 2, w / 2))
        nodes = [
            (np.add.outer(rule[0], source[0]).ravel(), np.multiply.outer(rule[1], source[1]).ravel())
            for rule, source in zip(rules, sources)
        ]
        y, x = offsets
        reach = math.hypot(*(float(np.abs(o).max() + np.abs(n).max()) for o, (n, _) in zip((y, x), nodes)))
        radial = self._radial(reach)
        out = np.empty((len(self.channels) * 3, *y.shape, x.shape[-1]))
        for place in np.ndindex(y.shape[:-1]):
            axes = [_Axis(offset[place], *points, reach) for offset, points in zip(offsets, nodes)]
            out[(slice(None), *place)] = radial.averaged(*axes)
        return float(np.prod(spacings)) * out.reshape(len(self.channels), 3, *out.shape[1:])

    def _radial(self, reach: float) -> _Radial:
        from scipy.special import j0, j1, jv

        k, weight = self._nodes(reach)
        count = 2 * self.orders + 2
        angles = np.arange(count) * (2 * np.pi / count)
        matrix = self._remaining(k[:, None] * np.cos(angles), k[:, None] * np.sin(angles), line=False)
        coefficients = np.moveaxis(
            np.tensordot(matrix, np.exp(-1j * np.outer(angles, np.arange(self.orders + 1))), (1, 0)), -1, 1
        )
        coefficients = coefficients.reshape(k.size, self.orders + 1, -1) / count
        step = self.scale / 32
        radii = [0.0]
        while radii[-1] < reach:
            radii.append(radii[-1] + max(step, radii[-1] / 200))
        r = np.array([*radii, radii[-1] + step])
        table = np.zeros((r.size, self.orders + 1, coefficients.shape[-1]), dtype=np.complex128)
        for start in range(0, r.size, 256):
            rows = slice(start, start + 256)
            phase = r[rows, None] * k
            small = phase < 1e-2
            safe = np.where(small, 1.0, phase)
            first, second = j0(phase), j1(phase)
            third = np.where(small, phase**2 / 8, 2 * second / safe - first)
            fourth = np.where(small, phase**3 / 48, 4 * third / safe - second)
            higher = (jv(n, phase) for n in range(4, self.orders + 1))
            for order, bessel in enumerate(itertools.chain((first, second, third, fourth), higher)):
                # Orders n and -n together: twice the real part of the positive one.
                factor = (1j**order) / (2 * np.pi) * (1.0 if order == 0 else 2.0)
                table[rows, order] = factor * ((bessel * (weight * k)) @ coefficients[:, order])
        return _Radial(r, table)


class _Axis:
    """Weighted sums along one axis over points offset + node: each distinct distance from 0 once, and its weights."""

    def __init__(self, offset: Floats, node: Floats, weight: Floats, reach: float) -> None:
        points = offset[:, None] + node
        # Mirror images share their distance.
        distance, back = np.unique(np.round(np.abs(points) / reach, 14), return_inverse=True)
        self.distance = distance * reach
        back = back.reshape(points.shape)
        rows = np.arange(len(offset))[:, None]
        self.even, self.odd = np.zeros((2, len(offset), len(distance)))
        np.add.at(self.even, (rows, back), weight)
        np.add.at(self.odd, (rows, back), weight * np.sign(points))


class _Radial:
    """Functions of the plane by angular order: sum_n Re(f_n(r) exp(i n theta)), with splines f_n."""

    def __init__(self, r: Floats, table: npt.NDArray[np.complex128]) -> None:
        """``table`` is f (distance, order, function)."""
        from scipy.interpolate import CubicSpline

        self.count = table.shape[-1]
        parts = np.stack([table.real, -table.imag], axis=1)  # of cos(n theta) and of sin(n theta)
        sizes = np.abs(parts).max(axis=0)
        self.sine, self.order, self.function = np.nonzero(sizes > NOTHING * sizes.max(axis=(0, 1)))
        self._spline = CubicSpline(r, parts[:, self.sine, self.order, self.function], axis=0)

    def averaged(self, y: _Axis, x: _Axis) -> Floats:
        """(function, ny, nx): sums over the points of both axes, from one quadrant of the plane."""
        out = np.zeros((self.count, len(y.even), len(x.even)))
        rows = max(1, LARGEST_TABLE // (len(x.distance) * max(len(self.order), 1)))
        for start in range(0, len(y.distance), rows):
            some = slice(start, start + rows)
            yy, xx = y.distance[some, None], x.distance
            values = np.moveaxis(self._spline(np.hypot(yy, xx)), -1, 0)
            angle = np.arctan2(yy, xx)
            # cos(n theta) is even in y, sin(n theta) odd; in x they are even or odd as n is.
            for sine, odd in itertools.product((0, 1), (0, 1)):
                chosen = np.flatnonzero((self.sine == sine) & (self.order % 2 == odd))
                along_y, along_x = (y.odd if sine else y.even), (x.even if sine == odd else x.odd)
                for order in np.unique(self.order[chosen]):
                    which = chosen[self.order[chosen] == order]
                    wave = np.sin(order * angle) if sine else np.cos(order * angle)
                    # Each function has an angular order only once.
                    out[self.function[which]] += along_y[:, some] @ (values[which] * wave) @ along_x.T
        return out
