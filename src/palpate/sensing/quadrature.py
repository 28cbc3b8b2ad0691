"""Influence of a surface cell in any pad, computed from its matrix per wavevector only.

Close to its surface, every pad responds like a half-space of its uppermost material (`Uppermost`). That half-space is
determined from the pad's states as k grows: its surface compliance Y (displacement times k per traction) and the depth
factors P with u(z) = exp(i k P z) u(0), both functions of the wavevector's direction only. The integral over k then
has a closed form, for Q = P z + x.n of a point at (x, z) and a wave along n (Stroh 1962; T. C. T. Ting, Anisotropic
Elasticity, 1996):

    int exp(i k Q) dk = i Q^-1,      int exp(i k Q) k dk = -Q^-2,

and an integral over directions remains:

- depth > 0: panels that narrow towards n normal to x. The kernel of a point load is tabulated over distance and angular
order, and integrated over the cell by panels that narrow towards the point;
- depth 0: Fourier series in the direction. Each order of the kernel, exp(i n theta)/r or /r^2, is integrated over the rectangle
in closed form, edge by edge;
- line contact: closed form, with functions of the matrix P by Cauchy's integral, so that equal roots need no special case.

A pad that differs from that half-space at some wavelengths (layers) is transformed as isotropic layers are
(`palpate.sensing.layered`), with as many angular orders as its anisotropy requires.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property
from palpate.elastic.closed_form import across_edges
from palpate.elastic.pad import Complexes, Floats, Pad
from palpate.elastic.quantities import WaveFields
from palpate.errors import Unsupported

__all__ = ["Stack", "Uppermost", "as_stack", "uppermost"]

#: Relative change of the states between k and 2 k below which the surface counts as homogeneous.
SETTLED = 1e-11
#: Angular orders to try for the surface's functions of direction; a series must decrease to TAIL within half of them.
ORDERS = (16, 32, 64, 128)
TAIL = 1e-11
#: Gauss-Legendre nodes per panel in direction, per panel in distance, and per cell near the point.
NODES_DIRECTION, NODES_DISTANCE, NODES_CELL = 16, 16, 8
#: Cells within this many widths are integrated by panels that narrow towards the point.
NEAR_WIDTHS = 2.6
#: Powers of i.
_TURN = np.array([1, 1j, -1, -1j])


def _directions(angle: Floats) -> Floats:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _inverse(m: Complexes) -> Complexes:
    """Inverse of (..., 3, 3) by cofactors: faster than LAPACK on many small matrices."""
    out = np.empty_like(m)
    for i, j in itertools.product(range(3), range(3)):
        a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
        out[..., i, j] = m[..., a, c] * m[..., b, d] - m[..., a, d] * m[..., b, c]
    return out / np.einsum("...j,...j->...", m[..., 0, :], out[..., :, 0])[..., None, None]


def uppermost(pad: Pad, length: float) -> Uppermost:
    """The half-space that the pad responds like at wavelengths far below ``length`` [m], determined from its states.

    Raises
    ------
    Unsupported
        Where the states do not settle as k grows: the material changes without end towards the surface.
    """
    sides = _directions(np.arange(6) * (np.pi / 3) + 0.1)
    k = 1.0 / length
    before: Complexes | None = None
    settled = 0
    for _ in range(60):
        states = pad.states(np.full(6, k), sides, 0.0)
        if before is not None and np.isfinite(states).all():
            close = np.abs(states - before)[:, :3].max() <= SETTLED * np.abs(states)[:, :3].max()
            settled = settled + 1 if close else 0
            if settled == 3:
                return Uppermost(pad, k)
        before, k = states, 2.0 * k
    raise Unsupported(
        f"the surface compliance of {type(pad).__name__} does not settle as the wavelength falls, so the response next to a loaded "
        "cell cannot be found from its states. Give the pad a homogeneous layer at its surface, or a closed form of its own "
        "(influence, see palpate.elastic.Pad)."
    )


@dataclass(frozen=True)
class Stack:
    """A pad and its properties needed for quadrature.

    Attributes
    ----------
    surface_thickness : float
        Thickness of the uppermost material [m], or infinity.
    """

    pad: Pad
    surface: Uppermost
    surface_thickness: float


def as_stack(pad: Pad, length: float, depth: float) -> Stack:
    """``pad`` with its uppermost half-space; ``length`` [m] is the size of the region sought."""
    surface = uppermost(pad, length)
    sides = _directions(np.array([0.1, 1.3]))
    k = np.geomspace(1e-4 / length, max(surface.wavenumber, 40.0 / max(depth, 1e-3 * length)), 200)[:, None] * np.ones(
        2
    )
    directions = np.broadcast_to(sides, (*k.shape, 2))
    different = np.zeros(len(k), dtype=bool)
    for at in {0.0, depth}:
        states, expected = pad.states(k, directions, at), surface.states(k, directions, at)
        if not (np.abs(states[..., 3:, :]) < 100.0).all():
            raise Unsupported(
                f"the stresses of {type(pad).__name__} are not finite or grow with depth, at depth {at:g} m; check states()."
            )
        for rows in (slice(0, 3), slice(3, 6)):
            size = np.abs(expected[..., rows, :]).max()
            different |= (np.abs(states - expected)[..., rows, :] > 1e-9 * size).any(axis=(1, 2, 3))
    if not different.any() and pad.mean_compliance(0.0) is None:
        return Stack(pad, surface, math.inf)
    # The base of a layer h affects the surface by exp(-2 k h): 1e-9 with its factors at k h = 13.
    return Stack(pad, surface, 13.0 / float(k[different, 0].max()) if different.any() else length)


class Uppermost:
    """A homogeneous half-space, isotropic or not, of a pad's uppermost material; itself a `Pad`."""

    thickness = None

    def __init__(self, pad: Pad, wavenumber: float) -> None:
        self._pad, self.wavenumber = pad, wavenumber
        self._material = pad.compliance(0.0)

    def compliance(self, depth: float) -> Floats:
        """The surface's compliance, at every depth."""
        return self._material

    def mean_compliance(self, depth: float) -> None:
        """None, as for any half-space."""
        return

    def surface(self, direction: Floats) -> tuple[Complexes, Complexes]:
        """Y and P (..., 3, 3) for waves along ``direction``."""
        states = self._pad.states(np.full(direction.shape[:-1], self.wavenumber), direction, 0.0)
        y = states[..., :3, :]
        fields = WaveFields(states, y, direction, self._material)
        slope = np.stack([fields.gradient(i, "z") for i in "xyz"], axis=-2)
        return y, -1j * slope @ _inverse(y)

    def states(self, wavenumber: Floats, direction: Floats, depth: float) -> Complexes:
        """Fields of one wavevector, see `palpate.elastic.Pad.states`."""
        from scipy.linalg import expm

        y, p = self.surface(direction)
        propagator = expm(1j * np.asarray(wavenumber)[..., None, None] * depth * p) if depth else np.eye(3)
        displacement = propagator @ y
        return np.concatenate([displacement, _inverse(y) @ displacement], axis=-2)

    @cached_property
    def orders(self) -> int:
        """Angular orders that the functions of direction need."""
        for orders in ORDERS:
            y, p = self.surface(_directions(np.arange(2 * orders) * (np.pi / orders)))
            for part in (y, p):
                spectrum = np.abs(_series(part))
                if spectrum[orders // 2 : orders].max() > TAIL * spectrum.max():
                    break
            else:
                return orders
        raise Unsupported(
            f"the response of {type(self._pad).__name__} varies too sharply with direction for {ORDERS[-1]} angular orders; give "
            "the pad a closed form of its own (influence, see palpate.elastic.Pad)."
        )

    @cached_property
    def roots(self) -> tuple[float, float]:
        """Smallest imaginary part and largest modulus of the eigenvalues of P over all directions."""
        _, p = self.surface(_directions(np.arange(64) * (np.pi / 64)))
        values = np.linalg.eigvals(p)
        if not (np.isfinite(values).all() and values.imag.min() > 0):
            raise Unsupported(
                f"the states of {type(self._pad).__name__} do not decay with depth as those of a stable half-space do; check "
                "states() against compliance()."
            )
        return float(values.imag.min()), float(np.abs(values).max())

    # -- in space ------------------------------------------------------------------------------------------------------

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
        if len(offsets) == 1:

            def at(places: Sequence[Floats]) -> Floats:
                return self._line(places[0], widths[0], depth, channels, concentrated, damping)

            return at(offsets) if depth + damping or concentrated else across_edges(at, offsets, widths)
        y, x = offsets
        shape = (*y.shape, x.shape[-1])
        yy, xx = (np.broadcast_to(v, shape).ravel() for v in (y[..., :, None], x[..., None, :]))
        # The offsets of a lattice repeat, and so do some of scattered points.
        unit = min(widths)
        points, back = np.unique(np.round(np.stack([yy, xx]) / unit, 12), axis=1, return_inverse=True)
        yy, xx = points * unit
        if depth + damping == 0.0:
            values = self._on_surface(xx, yy, widths, channels)
        else:
            values = self._below(xx, yy, widths, depth, damping, channels, concentrated)
        out = values[:, :, np.reshape(back, -1)]
        return np.asarray(out.reshape(len(channels), 3, *shape))

    def _line(
        self, x: Floats, width: float, depth: float, channels: Sequence[str], concentrated: bool, damping: float
    ) -> Floats:
        direction = np.array([1.0, 0.0])
        y, p = self.surface(direction)
        node, weight = _cauchy(p)
        flat = x.ravel()
        out = np.empty((len(channels), 2, flat.size))
        for start in range(0, flat.size, 4096):
            part = flat[start : start + 4096, None]

            def q(shift: float, part: Floats = part) -> Complexes:
                return np.asarray(part + shift + (node * depth + 1j * damping))

            if concentrated:
                stress, level = 1j / q(0.0), -np.log(q(0.0))
            else:
                right, left = np.log(q(width / 2)), np.log(q(-width / 2))
                stress = 1j * (right - left) / width
                level = -(_times(q(width / 2), right) - _times(q(-width / 2), left)) / width + 1.0
            displacement = np.tensordot(level, weight, 1) @ y
            traction = np.tensordot(stress, weight, 1) @ y
            states = np.concatenate([traction, _inverse(y) @ traction], axis=-2)
            fields = WaveFields(states, displacement, np.broadcast_to(direction, (len(part), 2)), self._material)
            values = fields.read(channels)[..., [0, 2]].real * (width / np.pi)
            out[:, :, start : start + 4096] = np.moveaxis(values, 0, -1)
        return out.reshape(len(channels), 2, *x.shape)

    def _on_surface(self, x: Floats, y: Floats, widths: Sequence[float], channels: Sequence[str]) -> Floats:
        """(channel, 3, point) at depth 0: rectangle integrals of the kernel's angular orders."""
        count = 2 * self.orders
        direction = _directions(np.arange(2 * count) * (np.pi / count))
        compliance, _ = self.surface(direction)
        states = np.concatenate([compliance, np.broadcast_to(np.eye(3), compliance.shape)], axis=-2)
        nothing = np.zeros_like(compliance)
        dy, dx = widths
        lengths, angles, inside = _rectangle(x, y, dx, dy, count)
        out = np.zeros((x.size, len(channels), 3))
        # Displacement decreases like 1/k, all other quantities stay constant: each has its own kernel in space.
        for part, integral in (
            (WaveFields(np.zeros_like(states), compliance, direction, self._material), lengths),
            (WaveFields(states, nothing, direction, self._material), angles),
        ):
            coefficient = _series(part.read(channels))[:count]
            largest = np.abs(coefficient).max(axis=0)
            coefficient[np.abs(coefficient) < 1e-13 * largest.max()] = 0.0
            order = np.arange(count)
            factor = (_TURN[order % 4] / (2 * np.pi) * np.where(order == 0, 1.0, 2.0))[:, None, None] * coefficient
            if integral is angles:
                out += inside[:, None, None] * coefficient[0].real
                # On a cell's edge the logarithm is infinite for every order that varies with direction.
                singular = np.abs(coefficient[1:]).max(axis=0) > 0
                on_edge = np.asarray(~np.isfinite(integral).all(axis=1))
                clean = np.where(on_edge[:, None], 0.0, integral)
                out += np.tensordot(clean, factor, 1).real
                out[np.ix_(on_edge)] += np.where(singular, np.inf, 0.0)
            else:
                out += np.tensordot(integral, factor, 1).real
        return np.moveaxis(out, 0, -1)

    def _below(
        self,
        x: Floats,
        y: Floats,
        widths: Sequence[float],
        depth: float,
        damping: float,
        channels: Sequence[str],
        concentrated: bool,
    ) -> Floats:
        """(channel, 3, point) at a depth > 0: the point load's kernel integrated over the cell."""
        dy, dx = widths
        scale = self.roots[0] * depth + damping
        reach = float(np.hypot(np.abs(x).max() + dx, np.abs(y).max() + dy))
        kernel = self._point_kernel(depth, damping, channels, reach)
        out = np.empty((x.size, len(channels), 3))
        if concentrated:
            for rows in _chunks(np.arange(x.size)):
                out[rows] = dx * dy * kernel(x[rows], y[rows])
            return np.moveaxis(out, 0, -1)
        cells_away = np.maximum(np.abs(x) / dx, np.abs(y) / dy)
        smooth = scale >= 2.0 * max(dx, dy)  # then nowhere near enough to need narrow panels
        needs_panels = cells_away < (0.0 if smooth else NEAR_WIDTHS)
        group: npt.NDArray[np.bool_]
        for group, points_per_axis in (
            (~needs_panels & (cells_away < 9.0), 6),
            (~needs_panels & (cells_away >= 9.0), 4),
        ):
            node, weight = np.polynomial.legendre.leggauss(points_per_axis)
            for rows in _chunks(np.flatnonzero(group)):
                total = np.zeros((len(rows), len(channels), 3))
                for (i, u), (j, v) in itertools.product(zip(node, weight), zip(node, weight)):
                    total += u * v / 4 * kernel(x[rows] + i * dx / 2, y[rows] + j * dy / 2)
                out[rows] = dx * dy * total
        for row in np.flatnonzero(needs_panels):
            across, across_weight = _panels(x[row] - dx / 2, x[row] + dx / 2, scale)
            along, along_weight = _panels(y[row] - dy / 2, y[row] + dy / 2, scale)
            values = kernel(np.tile(across, len(along)), np.repeat(along, len(across)))
            out[row] = np.tensordot(np.outer(along_weight, across_weight).ravel(), values, 1)
        return np.moveaxis(out, 0, -1)

    def _point_kernel(
        self, depth: float, damping: float, channels: Sequence[str], reach: float
    ) -> Callable[[Floats, Floats], Floats]:
        """A function that returns the channels (point, channel, 3) at (x, y) of a point load, tabulated over distance
        and angular order.
        """
        from scipy.interpolate import CubicSpline

        low, high = self.roots
        scale = low * depth + damping
        # Directions: panels that double from the width of the peak at n normal to x.
        finest = 0.5 * scale / max(reach, high * depth + damping)
        edges = [0.0, min(finest, np.pi / 4)]
        while edges[-1] < np.pi / 2:
            edges.append(min(2.0 * edges[-1], edges[-1] + np.pi / 8, np.pi / 2))
        beta, weight = _gauss(np.array(edges), NODES_DIRECTION)
        beta, weight = np.concatenate([-beta[::-1], beta]), np.concatenate([weight[::-1], weight])
        # Distance: r = scale sinh t, Chebyshev-like panels of width 1.2 in t.
        panels = max(1, math.ceil(math.asinh(reach / scale) / 0.8))
        step = math.asinh(reach / scale) / panels
        corner = np.arange(panels + 1) * step
        t, _ = _gauss(corner, NODES_DISTANCE)
        count = self.orders  # the dependence on direction has decayed at half of them
        theta = np.arange(count) * (2 * np.pi / count)
        direction = _directions(theta[:, None] + np.pi / 2 + beta)
        y, p = self.surface(direction)
        inverse_y = _inverse(y)
        rows = len(channels)
        table = np.empty((len(t), count // 2 + 1, rows, 3), dtype=np.complex128)
        base = p * depth + 1j * damping * np.eye(3)
        sine = np.sin(beta)
        for i, radius in enumerate(scale * np.sinh(t)):
            q = base - radius * sine[:, None, None] * np.eye(3)
            inverse = _inverse(q)
            single = inverse @ y
            double = -inverse @ single
            states = np.concatenate([double, inverse_y @ double], axis=-2)
            fields = WaveFields(states, 1j * single, direction, self._material).read(channels)
            # Both half-turns of the direction: twice the real part.
            value = np.einsum("b,tbcs->tcs", weight, fields.real) / (2 * np.pi**2)
            table[i] = _series(value)[: count // 2 + 1]
        table[:, 1:] *= 2.0
        table *= (np.cosh(t) ** 2)[:, None, None, None]  # proportional to r^2 far away, where stress falls like 1/r^2
        sizes = np.abs(table).max(axis=0)
        needed = np.flatnonzero((sizes[:-1] > 1e-11 * sizes.max(axis=(0, 2))[:, None]).any(axis=(1, 2)))
        orders = int(needed[-1]) + 1 if len(needed) else 1
        # Resample for a spline, without loss.
        fine = np.linspace(0.0, corner[-1], 160 * panels + 1)
        spline = CubicSpline(fine, _resample(table[:, :orders], corner, fine).reshape(len(fine), -1), axis=0)
        size = (orders, rows, 3)

        def kernel(px: Floats, py: Floats) -> Floats:
            r = np.hypot(px, py)
            at = np.arcsinh(r / scale)
            values = spline(at).reshape(-1, *size)
            phase = np.exp(1j * np.arctan2(py, px)[:, None] * np.arange(orders))
            return np.asarray(np.einsum("pn,pncs->pcs", phase, values).real / (np.cosh(at) ** 2)[:, None, None])

        return kernel


def _series(values: Complexes | Floats) -> Complexes:
    """Fourier coefficients, orders 0, 1, ..., of functions sampled at equal angles along the first axis."""
    from scipy.fft import fft

    return np.asarray(fft(values, axis=0) / len(values))


def _times(a: Complexes, log: Complexes) -> Complexes:
    return np.asarray(np.where(a == 0, 0.0, a * np.where(a == 0, 0.0, log)))


def _gauss(edges: Floats, count: int) -> tuple[Floats, Floats]:
    t, w = np.polynomial.legendre.leggauss(count)
    low, high = edges[:-1, None], edges[1:, None]
    return ((low + high) / 2 + (high - low) / 2 * t).ravel(), ((high - low) / 2 * w).ravel()


def _panels(low: float, high: float, scale: float) -> tuple[Floats, Floats]:
    """Nodes and weights on [low, high] for a function that is smooth over max(scale, distance from 0)."""
    edges = {low, high}
    for sign, start, end in ((1.0, max(0.0, low), high), (-1.0, max(0.0, -high), -low)):
        at = start
        while at < end:
            if low < sign * at < high:
                edges.add(sign * at)
            at += max(scale, at)
    return _gauss(np.array(sorted(edges)), NODES_CELL)


def _chunks(rows: npt.NDArray[np.intp]) -> list[npt.NDArray[np.intp]]:
    return [rows[i : i + 4000] for i in range(0, len(rows), 4000)]


def _resample(table: Complexes, corner: Floats, fine: Floats) -> Complexes:
    """Values at ``fine`` from Gauss nodes in the panels between ``corner``."""
    node, _ = np.polynomial.legendre.leggauss(NODES_DISTANCE)
    vander = np.linalg.inv(np.polynomial.legendre.legvander(node, NODES_DISTANCE - 1))
    panel = np.clip(np.searchsorted(corner, fine, side="right") - 1, 0, len(corner) - 2)
    out = np.empty((len(fine), *table.shape[1:]), dtype=np.complex128)
    for i in range(len(corner) - 1):
        inside = panel == i
        local = 2 * (fine[inside] - corner[i]) / (corner[i + 1] - corner[i]) - 1
        basis = np.polynomial.legendre.legvander(local, NODES_DISTANCE - 1) @ vander
        out[inside] = np.tensordot(basis, table[i * NODES_DISTANCE : (i + 1) * NODES_DISTANCE], 1)
    return out


def _cauchy(p: Complexes) -> tuple[Complexes, Complexes]:
    """Nodes z_j and matrices R_j with f(P) = sum_j f(z_j) R_j for f analytic in the upper half-plane.

    Cauchy's integral on a circle of the disk w = (z - i c)/(z + i c), by the trapezoidal rule: it converges
    exponentially, and equal eigenvalues need no special case.
    """
    values = np.linalg.eigvals(p)
    c = float(np.exp(np.log(np.abs(values)).mean()))
    largest = float(np.abs((values - 1j * c) / (values + 1j * c)).max())
    radius = max(math.sqrt(largest), 0.15)
    count = math.ceil(38.0 / -math.log(radius))
    w = radius * np.exp(2j * np.pi * (np.arange(count) + 0.5) / count)
    node = 1j * c * (1 + w) / (1 - w)
    slope = 2j * c / (1 - w) ** 2 * w / count  # dz/dw dw/(2 pi i)
    return node, slope[:, None, None] * _inverse(node[:, None, None] * np.eye(3) - p)


def _rectangle(x: Floats, y: Floats, dx: float, dy: float, count: int) -> tuple[Complexes, Complexes, Floats]:
    """Integrals over the rectangle about (x, y) of exp(i n t)/r and n exp(i n t)/r^2 (point, n < count), and the
    fraction of the neighbourhood of the origin inside it.

    In polar coordinates both are integrals over the edges. With f the angle from an edge's normal and d its distance,
    int exp(i n f) sec f df = I_n, with I_n = 2 exp(i (n-1) f)/(i (n-1)) - I_{n-2}. On an edge the second integral is
    infinite (NaN).
    """
    left, right, low, high = x - dx / 2, x + dx / 2, y - dy / 2, y + dy / 2
    lengths = np.zeros((x.size, count), dtype=np.complex128)
    angles = np.zeros((x.size, count), dtype=np.complex128)
    order = np.arange(count)
    tiny = 1e-12 * min(dx, dy)
    on_edge = np.zeros(x.size, dtype=bool)
    # Quarter turns of the outward normal, distance along it, and the ends along the edge.
    for turn, d, start, stop in (
        (0, right, low, high),
        (1, high, -right, -left),
        (2, -left, -high, -low),
        (3, -low, left, right),
    ):
        size = np.maximum(np.abs(d), tiny)
        on_edge |= (np.abs(d) <= 1e3 * tiny) & (start <= 1e3 * tiny) & (stop >= -1e3 * tiny)
        difference = _secant(stop / size, count + 1) - _secant(start / size, count + 1)
        tangent = np.zeros_like(difference)
        tangent[:, 1:-1] = -0.5j * (difference[:, 2:] - difference[:, :-2])
        behind = (d < 0)[:, None]
        sign = np.where(order % 2, -1.0, 1.0)
        face = _TURN[turn * order % 4]
        difference, tangent = (
            np.where(behind, sign * v[:, :count].conj(), v[:, :count]) for v in (difference, tangent)
        )
        lengths += face * (np.where(behind, -1.0, 1.0) * size[:, None]) * difference
        with np.errstate(divide="ignore", invalid="ignore"):
            angles += np.where(order > 0, face * 1j * tangent, 0.0)
    angles[on_edge] = np.nan

    def part(a: Floats, b: Floats) -> Floats:
        inside = np.where((a < -tiny) & (b > tiny), 1.0, 0.0)
        return np.where((np.abs(a) <= tiny) | (np.abs(b) <= tiny), 0.5, inside)

    return lengths, angles, part(left, right) * part(low, high)


def _secant(tangent: Floats, count: int) -> Complexes:
    """I_n (point, n <= count) = int_0^f exp(i n f) sec f df, given tan f."""
    f = np.arctan(tangent)
    turn = np.exp(1j * f)
    out = np.empty((tangent.size, count + 1), dtype=np.complex128)
    out[:, 0] = np.arcsinh(tangent)
    out[:, 1] = f + 1j * np.log(np.hypot(1.0, tangent))
    power = turn.copy()
    for n in range(2, count + 1):
        out[:, n] = 2.0 * power / (1j * (n - 1)) - out[:, n - 2]
        power = power * turn
    return out
