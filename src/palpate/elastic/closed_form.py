"""Boussinesq-Cerruti potentials of a half-space: every field of a load from derivatives of one harmonic function.

For a traction t acting on z = 0 of the body z > 0 let Omega = z ln(rho + z) - rho, and integrate t Omega over the
loaded area to F1, G1, H1 (for q_x, q_y, p). With psi1 = F1_x + G1_y + H1_z and psi = psi1_z
(K. L. Johnson, Contact Mechanics, 1985, eqs. 3.1 to 3.8):

    4 pi mu u_x = 2 F1_zz - H1_xz + 2 nu psi1_x - z psi_x      (u_y likewise)
    4 pi mu u_z = H1_zz + (1 - 2 nu) psi - z psi_z
    div u = (1 - 2 nu) psi_z / (2 pi mu)      so lambda div u = nu psi_z / pi, finite at nu = 1/2.

A *table* gives the partial derivatives of the harmonic function of unit traction by name ("xxz", sorted letters).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats

__all__ = [
    "AreaFields",
    "PatchPrimitives",
    "PointTable",
    "RectangleTable",
    "Table",
    "across_edges",
    "area_fields",
    "cell_influence_area",
    "lattice_table",
]


#: Distance from a cell's edge, as a fraction of the cell's width, within which a point counts as on the edge; and the
#: distances at which the field is evaluated on either side.
EDGE, BESIDE = 1e-9, (1e-6, 1e-7)


class Table(Protocol):
    """Derivatives of the harmonic function, by sorted index name."""

    def __getitem__(self, key: str) -> Any: ...


# u_i of a load along s, times 4 pi mu: terms (coefficient as a function of nu, derivative), plain and times z
_Terms = list[tuple[Callable[[float], float], str]]


def _displacement_terms(i: str, s: str) -> tuple[_Terms, _Terms]:
    if s == "z":
        if i == "z":
            return [(lambda nu: 2 * (1 - nu), "zz")], [(lambda nu: -1.0, "zzz")]
        return [(lambda nu: -(1 - 2 * nu), i + "z")], [(lambda nu: -1.0, i + "zz")]
    if i == "z":
        return [(lambda nu: 1 - 2 * nu, s + "z")], [(lambda nu: -1.0, s + "zz")]
    plain: _Terms = [(lambda nu: 2 * nu, i + s)]
    if i == s:
        plain.append((lambda nu: 2.0, "zz"))
    return plain, [(lambda nu: -1.0, i + s + "z")]


class AreaFields:
    """Fields of a unit traction along ``source`` ("x", "y" or "z") whose harmonic function is ``table``."""

    def __init__(self, table: Table, z: Any, source: str, constants: tuple[float, float]) -> None:
        self._table, self._z, self._source = table, z, source
        self._mu, self._nu = constants
        self._deep = bool(np.any(np.asarray(z) != 0))

    def _get(self, key: str) -> Any:
        return self._table["".join(sorted(key))]

    def _total(self, terms: _Terms, more: str = "") -> Any:
        """Return the sum of terms. Terms without weight are not evaluated (they may be singular)."""
        weighted = [(c(self._nu), key) for c, key in terms if c(self._nu) != 0.0]
        return sum(c * self._get(key + more) for c, key in weighted) if weighted else 0.0 * self._get("zz")

    def _gradient(self, i: str, j: str) -> Any:
        """du_i/dx_j times 4 pi mu."""
        plain, deep = _displacement_terms(i, self._source)
        out = self._total(plain, j)
        if j == "z":
            out = out + self._total(deep)
        if self._deep:
            out = out + self._z * self._total(deep, j)
        return out

    def _symmetric(self, ij: str) -> Any:
        i, j = ij[0], ij[1]
        return self._gradient(i, i) if i == j else 0.5 * (self._gradient(i, j) + self._gradient(j, i))

    def displacement(self, i: str) -> Any:
        """u_i."""
        plain, deep = _displacement_terms(i, self._source)
        out = self._total(plain)
        if self._deep:
            out = out + self._z * self._total(deep)
        return out / (4 * np.pi * self._mu)

    def gradient(self, i: str, j: str) -> Any:
        """du_i/dx_j."""
        return self._gradient(i, j) / (4 * np.pi * self._mu)

    def strain(self, ij: str) -> Any:
        """Strain, compression positive."""
        return -self._symmetric(ij) / (4 * np.pi * self._mu)

    def stress(self, ij: str) -> Any:
        """Stress, compression positive."""
        stress = -self._symmetric(ij) / (2 * np.pi)
        if ij[0] == ij[1] and self._nu != 0.0:
            stress = stress - self._nu / np.pi * self._get(self._source + "zz")
        return stress


def area_fields(
    table: Table, z: Any, source: str, constants: tuple[float, float], channels: Sequence[str]
) -> list[Any]:
    """Channels of a unit traction along ``source`` whose harmonic function is ``table``; ``constants`` are (mu, nu)."""
    fields = AreaFields(table, z, source, constants)
    return [find_channel(name).read(fields) for name in channels]


def across_edges(
    evaluate: Callable[[Sequence[Floats]], Floats], offsets: Sequence[Floats], widths: Sequence[float]
) -> Floats:
    """Return the influence (channel, component, *point) of a cell at its own depth, where it jumps at the cell's
    edges.

    On an edge or a corner it is the mean of all sides, so that a point there feels a half or a quarter of a pressure, whatever the rounding of
    its position; infinite where the sides have no finite mean. ``evaluate`` takes offsets, one array (..., n) per axis.
    """
    out = evaluate(offsets)
    lines = [np.abs(np.abs(o) - 0.5 * w) <= EDGE * w for o, w in zip(offsets, widths)]
    on = lines[0] if len(lines) == 1 else lines[0][..., :, None] | lines[1][..., None, :]
    if not on.any():
        return out
    sides = list(itertools.product((-1.0, 1.0), repeat=len(widths)))
    near, nearer = (
        np.mean([evaluate([o + sign * s * w for sign, o, w in zip(side, offsets, widths)]) for side in sides], axis=0)
        for s in BESIDE
    )
    inside = evaluate([np.array([0.2, 0.3]) * w for w in widths])
    size = np.abs(inside).max(axis=tuple(range(1, inside.ndim)))[:, None, None]
    out[..., on] = np.where(np.abs(near - nearer)[..., on] <= 1e-5 * size, nearer[..., on], np.inf)
    return out


def cell_influence_area(
    constants: tuple[float, float],
    offsets: Sequence[Floats],
    widths: Sequence[float],
    depth: float,
    channels: Sequence[str],
    *,
    concentrated: bool,
    damping: float,
) -> Floats:
    """Channels (channel, component, ..., ny, nx) per unit traction of one cell, see `palpate.HalfSpace.influence`."""
    y, x = offsets
    dy, dx = widths
    table: Table
    if concentrated:
        table, scale = PointTable(x[..., None, :], y[..., :, None], depth + damping), dx * dy
    else:
        table, scale = lattice_table(_edges(x, dx), _edges(y, dy), depth + damping), 1.0
    out = np.empty((len(channels), 3, *y.shape, x.shape[-1]))
    for column, component in enumerate("xyz"):
        for row, field in enumerate(area_fields(table, depth, component, constants, channels)):
            out[row, column] = scale * field
    return out


def _edges(centres: Floats, spacing: float) -> Floats:
    step = np.sign(centres[..., 1:2] - centres[..., :1]) * spacing / 2
    return np.concatenate([centres[..., :1] - step, centres + step], axis=-1)


class PointTable:
    """Derivatives of Omega itself: a point load at the origin. ``z`` may be complex (a distributed load)."""

    def __init__(self, x: Any, y: Any, z: Any) -> None:
        self.x, self.y, self.z = x, y, z
        self.rho = np.sqrt(x * x + y * y + z * z)
        self.sum = self.rho + z
        self._cache: dict[str, Any] = {}

    def __getitem__(self, key: str) -> Any:
        if key not in self._cache:
            self._cache[key] = self._compute(key)
        return self._cache[key]

    def _compute(self, key: str) -> Any:
        x, y, z, r, s = self.x, self.y, self.z, self.rho, self.sum
        swap = PointTable(y, x, z) if key in _SWAPPED else None
        if swap is not None:
            return swap[_SWAPPED[key]]
        # f and g: radial factors of Omega_xyz and of its x and y derivatives
        match key:
            case "zz":
                return 1 / r
            case "xz":
                return x / (r * s)
            case "xx":
                return -1 / s + x * x / (r * s**2)
            case "xy":
                return x * y / (r * s**2)
            case "zzz":
                return -z / r**3
            case "xzz":
                return -x / r**3
            case "xyz":
                return -x * y * self._f
            case "xxz":
                return 1 / (r * s) - x * x * self._f
            case "xxx":
                return -self["xyy"] - self["xzz"]
            case "xxy":
                return y / (r * s**2) - x * x * y * (3 * r + z) / (r**3 * s**3)
            case "zzzz":
                return -1 / r**3 + 3 * z * z / r**5
            case "xzzz":
                return 3 * x * z / r**5
            case "xxzz":
                return -1 / r**3 + 3 * x * x / r**5
            case "xyzz":
                return 3 * x * y / r**5
            case "xxyz":
                return -y * self._f + x * x * y * self._g
            case "xxxz":
                return -self["xyyz"] - self["xzzz"]
        raise KeyError(key)

    @property
    def _f(self) -> Any:
        return (2 * self.rho + self.z) / (self.rho**3 * self.sum**2)

    @property
    def _g(self) -> Any:
        r, z = self.rho, self.z
        return (8 * r**2 + 9 * r * z + 3 * z**2) / (r**5 * self.sum**3)


#: names whose formula is another's with x and y exchanged
_SWAPPED = {
    "yz": "xz",
    "yy": "xx",
    "yzz": "xzz",
    "yyz": "xxz",
    "yyy": "xxx",
    "xyy": "xxy",
    "yzzz": "xzzz",
    "yyzz": "xxzz",
    "xyyz": "xxyz",
    "yyyz": "xxxz",
}


class PatchPrimitives:
    """Derivatives of P(x, y, z) with P_xy = Omega: a rectangle's table is their difference over its corners.

    Functions of (x, z) or of (y, z) alone are dropped: they cancel in the corner difference.
    """

    def __init__(self, x: Any, y: Any, z: Any) -> None:
        self.x, self.y, self.z = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (x, y, z)))
        self.rho = np.sqrt(self.x**2 + self.y**2 + self.z**2)
        self._cache: dict[str, Floats] = {}

    def _keep(self, key: str, make: Callable[[], Floats]) -> Floats:
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]

    # the three elementary functions, each with its partner under x <-> y
    def _log(self, a: Floats, b: Floats, key: str) -> Floats:
        """ln(b + rho) up to a function of (a, z): asinh(b / sqrt(a^2 + z^2)), the same for either sign of b."""
        return self._keep(key, lambda: np.arcsinh(b / np.hypot(a, self.z)))

    def _times_log(self, a: Floats, b: Floats, key: str) -> Floats:
        log = self._log(a, b, key)
        return np.where(a == 0, 0.0, a * np.where(a == 0, 0.0, log))

    def _angle(self, a: Floats, b: Floats, key: str) -> Floats:
        """atan(b/a) - atan(b z/(a rho)), written without cancellation or jumps."""
        return self._keep(key, lambda: np.arctan2(a * b * (self.rho - self.z), a**2 * self.rho + b**2 * self.z))

    def __getitem__(self, key: str) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._keep("d" + key, lambda: self._compute(key))

    def _compute(self, key: str) -> Floats:
        x, y, z, r = self.x, self.y, self.z, self.rho
        s = r + z

        def solid() -> Floats:
            return np.arctan2(x * y, z * r)

        match key:
            case "zz":
                return self._times_log(x, y, "ly") + self._times_log(y, x, "lx") - z * solid()
            case "xx":
                return -self._times_log(x, y, "ly") + z * self._angle(x, y, "ax")
            case "yy":
                return -self._times_log(y, x, "lx") + z * self._angle(y, x, "ay")
            case "xy":
                return np.where(s == 0, 0.0, z * np.log(np.where(s == 0, 1.0, s)) - r)
            case "xz":
                return y * self._log_sum(s, y) + self._z_log(y, x) + x * self._angle(x, y, "ax")
            case "yz":
                return x * self._log_sum(s, x) + self._z_log(x, y) + y * self._angle(y, x, "ay")
            case "xxz":
                return self._angle(x, y, "ax")
            case "yyz":
                return self._angle(y, x, "ay")
            case "zzz":
                return -solid()
            case "xzz":
                return self._log(x, y, "ly")
            case "yzz":
                return self._log(y, x, "lx")
            case "xyz":
                return np.log(s)
            case "xxx":
                return y / s - self._log(x, y, "ly")
            case "yyy":
                return x / s - self._log(y, x, "lx")
            case "xxy":
                return -x / s
            case "xyy":
                return -y / s
            case "xyzz":
                return 1.0 / r
            case "xxyz":
                return x / (r * s)
            case "xyyz":
                return y / (r * s)
            case "xxzz":
                return -x * y / (r * (x**2 + z**2))
            case "yyzz":
                return -x * y / (r * (y**2 + z**2))
            case "zzzz":
                return x * y / r * (1.0 / (x**2 + z**2) + 1.0 / (y**2 + z**2))
            case "xzzz":
                return -y * z / (r * (x**2 + z**2))
            case "yzzz":
                return -x * z / (r * (y**2 + z**2))
            case "xxxz":
                return -y / (r * s) + y * z / (r * (x**2 + z**2))
            case "yyyz":
                return -x / (r * s) + x * z / (r * (y**2 + z**2))
        raise KeyError(key)

    @staticmethod
    def _log_sum(s: Floats, factor: Floats) -> Floats:
        return np.asarray(np.log(np.where(factor == 0, 1.0, s)))

    def _z_log(self, b: Floats, a: Floats) -> Floats:
        """z ln(rho + b) up to functions that cancel; 0 on the surface."""
        log = self._log(a, b, "ly" if a is self.x else "lx")
        return np.where(self.z == 0, 0.0, self.z * np.where(self.z == 0, 0.0, log))


class RectangleTable:
    """Table of a uniform unit traction on the rectangle |x| < a, |y| < b."""

    def __init__(self, x: Any, y: Any, z: Any, half_widths: tuple[float, float]) -> None:
        a, b = half_widths
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        self._corners = [(sx * sy, PatchPrimitives(x + sx * a, y + sy * b, z)) for sx in (1, -1) for sy in (1, -1)]

    def __getitem__(self, key: str) -> Floats:
        return np.asarray(sum(sign * corner[key] for sign, corner in self._corners))


class _LatticeTable:
    def __init__(self, corners: PatchPrimitives) -> None:
        self._corners = corners

    def __getitem__(self, key: str) -> Floats:
        return np.diff(np.diff(self._corners[key], axis=-2), axis=-1)


def lattice_table(x_edges: npt.ArrayLike, y_edges: npt.ArrayLike, z: float) -> Table:
    """Table (..., y, x) of equal rectangular cells: corners shared by neighbours are made once.

    ``x_edges`` (..., nx + 1) and ``y_edges`` (..., ny + 1) are the positions of a point relative to consecutive cell
    edges, both ascending or both descending.
    """
    return _LatticeTable(
        PatchPrimitives(np.asarray(x_edges)[..., None, :], np.asarray(y_edges)[..., :, None], np.float64(z))
    )
