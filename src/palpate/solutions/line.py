"""Line contact (plane strain) on a half-plane, by complex potentials.

With zeta = x + i z and the Cauchy transform of a surface traction t, W = int t(s)/(zeta - s) ds, V' = W:

    pressure:  pi s_zz = -Im W + z Re W'    pi s_xx = -Im W - z Re W'     pi s_xz = z Im W'
    shear:     pi s_zz = z Im W'            pi s_xx = 2 Re W - z Im W'    pi s_xz = -Im W - z Re W'

and displacements from Hooke's law (see `line_fields`). They follow from superposing the Flamant and tangential line loads
s_ij = (2/pi) x_i x_j (z P + x Q)/r^4 (K. L. Johnson, Contact Mechanics, 1985, sections 2.2 to 2.7).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from palpate.elastic.half_space import Floats, HalfSpace
from palpate.elastic.quantities import check_channels
from palpate.errors import InvalidInput, Unsupported
from palpate.solutions._common import check_half_space, positive, slip_ratio, smoothed_modulus

__all__ = [
    "LineContact",
    "flat_punch_line",
    "hertz_contact_half_width",
    "hertz_line",
    "line_fields",
    "line_load",
    "potentials",
    "strip",
]

Complexes = npt.NDArray[Any]
Shape = Literal["load", "strip", "hertz", "punch"]


def potentials(shape: Shape, half_width: float, zeta: Complexes) -> tuple[Complexes, Complexes, Complexes]:
    """(W, W', V) of a traction of unit force per length; V is chosen so that V ~ ln zeta far away."""
    a = half_width
    zeta = np.asarray(zeta, dtype=np.complex128)
    with np.errstate(divide="ignore", invalid="ignore"):
        if shape == "load":
            inverse: Complexes = 1.0 / zeta
            return inverse, -(inverse**2), np.log(zeta)
        right: Complexes = zeta + a
        left: Complexes = zeta - a
        if shape == "strip":
            log_right, log_left = np.log(right), np.log(left)
            ends: Complexes = np.where(right == 0, 0.0, right * log_right) - np.where(left == 0, 0.0, left * log_left)
            return (
                (log_right - log_left) / (2 * a),
                (1.0 / right - 1.0 / left) / (2 * a),
                ends / (2 * a) - 1.0,
            )
        root = np.sqrt(right) * np.sqrt(left)
        outer = zeta + root
        if shape == "hertz":
            w = 2.0 / outer
            return w, -2.0 / (root * outer), (zeta / outer - 0.5) + np.log(outer) - math.log(2.0)
        return 1.0 / root, -zeta / root**3, np.log(outer) - math.log(2.0)


def line_fields(
    w: Complexes,
    dw: Complexes,
    v: Complexes,
    depth: npt.ArrayLike,
    component: str,
    pad: HalfSpace,
    channels: Sequence[str],
) -> Floats:
    """Channels (channel, ...) of a traction in ``component`` ("x" or "z") from its complex potentials."""
    mu, nu = pad.shear_modulus, pad.poissons_ratio
    z: Floats = np.asarray(depth, dtype=np.float64)
    xx: Floats
    zz: Floats
    xz: Floats

    def deep(part: Floats) -> Floats:  # z times a potential: 0 on the surface, even where the potential is singular
        return np.asarray(z * np.where(z == 0, 0.0, part))

    im_dw, re_dw = deep(dw.imag), deep(dw.real)
    if component == "z":
        xx, zz, xz = -w.imag - re_dw, -w.imag + re_dw, im_dw
        ux = (1 - 2 * nu) * v.imag + deep(w.real)
        uz = -2 * (1 - nu) * v.real - deep(w.imag)
    else:
        xx, zz, xz = 2 * w.real - im_dw, im_dw, -w.imag - re_dw
        ux = -2 * (1 - nu) * v.real + deep(w.imag)
        uz = deep(w.real) - (1 - 2 * nu) * v.imag
    xx, zz, xz = xx / math.pi, zz / math.pi, xz / math.pi
    half = 1.0 / (2.0 * mu)
    table: dict[str, Callable[[], Floats]] = {
        "stress_xx": lambda: xx,
        "stress_zz": lambda: zz,
        "stress_xz": lambda: xz,
        "stress_yy": lambda: nu * (xx + zz),
        "strain_xx": lambda: half * ((1 - nu) * xx - nu * zz),
        "strain_zz": lambda: half * ((1 - nu) * zz - nu * xx),
        "strain_xz": lambda: half * xz,
        "displacement_x": lambda: half / math.pi * ux,
        "displacement_z": lambda: half / math.pi * uz,
    }
    return np.stack([table[name]() for name in channels])


@dataclass(frozen=True)
class _Term:
    shape: Shape
    half_width: float
    force: float
    component: str


@dataclass(frozen=True)
class LineContact:
    """A line contact: a sum of closed-form tractions. Make one with `hertz_line`, `strip`, and so on.

    Attributes
    ----------
    half_width : float
        Half-width a of the contact [m] (0 for a line load).
    center : float
        Where its middle lies on the surface [m].
    """

    terms: tuple[_Term, ...]
    half_width: float
    center: float = 0.0

    @property
    def force(self) -> Floats:
        """Net force per length (x, z) [N/m]."""
        return np.array([sum(t.force for t in self.terms if t.component == c) for c in "xz"], dtype=np.float64)

    def traction(self, x: npt.ArrayLike) -> Floats:
        """Surface traction (q_x, p) [Pa] at positions x [m]: shape (2, ...); infinite at the edge of a punch."""
        zeta = np.asarray(x, dtype=np.float64) - self.center + 0j
        inside = np.abs(zeta.real) <= self.half_width
        out = np.zeros((2, *zeta.shape))
        for term in self.terms:
            if term.shape == "load":
                raise Unsupported("a line load has no finite traction; use averages(edges) or fields().")
            value = -potentials(term.shape, term.half_width, zeta)[0].imag / math.pi * term.force
            out["xz".index(term.component)] += np.where(inside, value, 0.0)
        return out

    def averages(self, edges: npt.ArrayLike) -> Floats:
        """Mean traction (q_x, p) [Pa] in the cells between consecutive ``edges`` [m]: exact, shape (2, n)."""
        points = np.asarray(edges, dtype=np.float64)
        zeta = points - self.center + 0j
        out = np.zeros((2, points.size - 1))
        for term in self.terms:
            cumulative = -potentials(term.shape, term.half_width, zeta)[2].imag / math.pi * term.force
            out["xz".index(term.component)] += np.diff(cumulative) / np.diff(points)
        return out

    def fields(self, pad: HalfSpace, channels: Sequence[str], x: npt.ArrayLike, depth: npt.ArrayLike) -> Floats:
        """Channels (channel, ...) at positions ``x`` and ``depth`` [m], broadcast together.

        The displacement of a half-plane is defined up to a constant: here u behaves like -(...) ln r far away.
        """
        check_half_space(pad)
        names = check_channels(channels, 1)
        xx, zz = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(depth, dtype=np.float64))
        zeta = (xx - self.center) + 1j * zz
        out = np.zeros((len(names), *zeta.shape))
        for t in self.terms:
            out += t.force * line_fields(*potentials(t.shape, t.half_width, zeta), zz, t.component, pad, names)
        return out

    def shifted(self, center: float) -> LineContact:
        """The same contact with its middle at ``center`` [m]."""
        return replace(self, center=float(center))

    def sliding(self, friction: float) -> LineContact:
        """The contact sliding: shear q_x = friction * p everywhere (negative ``friction`` drags to -x)."""
        if not math.isfinite(friction):
            raise InvalidInput(f"friction must be a finite number; got {friction!r}.")
        normal = tuple(t for t in self.terms if t.component == "z")
        return replace(self, terms=normal + tuple(replace(t, component="x", force=friction * t.force) for t in normal))

    def partial_slip(self, friction: float, tangential_force: float) -> LineContact:
        """Cattaneo's partial slip: a Hertz contact pulled by |Q| < mu P [N/m], stuck in |x| < c.

        q = mu [p(x; a) - (c/a) p(x; c)],   c/a = sqrt(1 - |Q|/(mu P))       (Johnson 1985, section 7.2)
        """
        if len(self.terms) != 1 or self.terms[0].shape != "hertz":
            raise Unsupported("partial_slip needs a frictionless Hertz contact; make one with hertz_line.")
        (normal,) = self.terms
        ratio = slip_ratio(friction, tangential_force, normal.force)
        stick = math.sqrt(1.0 - ratio)
        full = math.copysign(friction * normal.force, tangential_force)
        return replace(
            self,
            terms=(
                normal,
                replace(normal, component="x", force=full),
                _Term("hertz", stick * self.half_width, -full * stick**2, "x"),
            ),
        )


def _single(shape: Shape, half_width: float, force: float, component: str) -> LineContact:
    if component not in ("x", "z"):
        raise InvalidInput(f'component must be "x" (shear) or "z" (pressure) in line contact; got {component!r}.')
    if not math.isfinite(force):
        raise InvalidInput(f"force must be a finite number of N/m; got {force!r}.")
    return LineContact((_Term(shape, half_width, float(force), component),), half_width)


def line_load(*, force: float, component: str = "z") -> LineContact:
    """A concentrated line load (Flamant for "z") of ``force`` [N/m] at x = 0."""
    return _single("load", 0.0, force, component)


def strip(*, half_width: float, traction: float, component: str = "z") -> LineContact:
    """Uniform ``traction`` [Pa] on |x| < ``half_width`` [m]."""
    a = positive("half_width", half_width, "metres")
    return _single("strip", a, 2.0 * a * traction, component)


def hertz_line(*, half_width: float, force: float) -> LineContact:
    """A cylinder: p = (2P/(pi a)) sqrt(1 - x^2/a^2), ``force`` P [N/m], ``half_width`` a [m] (Hertz 1882)."""
    return _single("hertz", positive("half_width", half_width, "metres"), positive("force", force, "N/m"), "z")


def flat_punch_line(*, half_width: float, force: float) -> LineContact:
    """A flat rigid punch: p = P/(pi sqrt(a^2 - x^2)), ``force`` P [N/m], ``half_width`` a [m] (Sadowsky 1928)."""
    return _single("punch", positive("half_width", half_width, "metres"), positive("force", force, "N/m"), "z")


def hertz_contact_half_width(pad: HalfSpace, *, radius: float, force: float) -> float:
    """a = sqrt(4 P R/(pi E*)) [m]: a rigid cylinder of ``radius`` R [m] pressed with ``force`` P [N/m]."""
    return math.sqrt(
        4.0 * positive("force", force, "N/m") * positive("radius", radius, "metres") / (math.pi * smoothed_modulus(pad))
    )
