"""Line contact (plane strain) on a half-plane: loads and their fields in closed form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import check_channels
from palpate.elastic.closed_form_line import Shape, line_fields, potentials
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import Floats, check_below
from palpate.errors import InvalidInput, Unsupported
from palpate.solutions._common import check_half_space, finite, positive, slip_ratio, smoothed_modulus

__all__ = [
    "LineContact",
    "flat_punch_line",
    "hertz_contact_half_width",
    "hertz_line",
    "line_load",
    "strip",
]


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
        Position of the middle on the surface [m].

    Examples
    --------
    >>> from palpate import HalfSpace, solutions
    >>> roller = solutions.hertz_line(half_width=1e-3, force=10.0)
    >>> roller.sliding(0.5).force.round(3).tolist()  # dragged towards +x
    [5.0, 10.0]

    >>> roller.partial_slip(0.5, 2.0).force.round(3).tolist()  # 2 N/m of the 5 N/m that friction bears
    [2.0, 10.0]

    >>> roller.shifted(2e-3).traction([0.0, 2e-3])[1].round(1).tolist()  # pressure [Pa] at two places
    [0.0, 6366.2]

    >>> roller.averages([-1e-3, 0.0, 1e-3])[1].round(3).tolist()  # means of two cells, 1 mm wide
    [5000.0, 5000.0]

    >>> pad = HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> roller.fields(pad, ["stress_zz"], 0.0, [0.0, 1e-3]).round(1).tolist()  # p0 and p0 / sqrt(2)
    [[6366.2, 4501.6]]
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
        places = np.asarray(x, dtype=np.float64) - self.center
        out = np.zeros((2, *places.shape))
        for term in self.terms:
            out["xz".index(term.component)] += term.force * _density(term, places)
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
        `InvalidInput` for a depth above the surface (negative): z grows into the pad.
        """
        check_half_space(pad)
        check_below(depth)
        names = check_channels(channels, 1)
        xx, zz = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(depth, dtype=np.float64))
        zeta = (xx - self.center) + 1j * zz
        out = np.zeros((len(names), *zeta.shape))
        constants = (pad.shear_modulus, pad.poissons_ratio)
        for t in self.terms:
            parts = potentials(t.shape, t.half_width, zeta)
            out += t.force * line_fields(parts, zz, t.component, constants, names)
        return out

    def shifted(self, center: float) -> LineContact:
        """The same contact with its middle at ``center`` [m]."""
        return replace(self, center=finite("center", center, "metres"))

    def sliding(self, friction: float) -> LineContact:
        """The contact sliding: shear q_x = friction * p everywhere (negative ``friction`` drags to -x)."""
        friction = finite("friction", friction, "(dimensionless)")
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


def _density(term: _Term, x: Floats) -> Floats:
    """Return the traction [Pa] of a unit force per length."""
    a = term.half_width
    if term.shape == "load":
        raise Unsupported("a line load has no finite traction; use averages(edges) or fields().")
    if term.shape == "strip":
        return np.where(np.abs(x) <= a, 0.5 / a, 0.0)
    inside = 1.0 - (x / a) ** 2
    root = np.sqrt(np.maximum(inside, 0.0))
    if term.shape == "hertz":
        return 2.0 / (math.pi * a) * root
    with np.errstate(divide="ignore"):
        return np.where(inside >= 0.0, 1.0 / (math.pi * a) / root, 0.0)


def _single(shape: Shape, half_width: float, force: float, component: str) -> LineContact:
    if component not in ("x", "z"):
        raise InvalidInput(f'component must be "x" (shear) or "z" (pressure) in line contact; got {component!r}.')
    if not math.isfinite(force):
        raise InvalidInput(f"force must be a finite number of N/m; got {force!r}.")
    return LineContact((_Term(shape, half_width, float(force), component),), half_width)


def line_load(*, force: float, component: str = "z") -> LineContact:
    """A concentrated line load (Flamant for "z") of ``force`` [N/m] at x = 0.

    Raises
    ------
    InvalidInput
        A number that is not finite, a size that is not positive, or a component that there is not.

    Examples
    --------
    >>> from palpate import HalfSpace, solutions
    >>> pad = HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> load = solutions.line_load(force=1.0)
    >>> load.fields(pad, ["stress_zz"], 0.0, 1e-3).round(2).tolist()  # 2 P / (pi z)
    [636.62]
    """
    return _single("load", 0.0, force, component)


def strip(*, half_width: float, traction: float, component: str = "z") -> LineContact:
    """Uniform ``traction`` [Pa] on |x| < ``half_width`` [m].

    Raises
    ------
    InvalidInput
        A number that is not finite, a size that is not positive, or a component that there is not.

    Examples
    --------
    >>> from palpate import HalfSpace, solutions
    >>> pad = HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> strip = solutions.strip(half_width=1e-3, traction=1000.0)
    >>> strip.fields(pad, ["stress_zz"], 0.0, 1e-3).round(1).tolist()  # (1/2 + 1/pi) p at the depth a
    [818.3]
    """
    a = positive("half_width", half_width, "metres")
    return _single("strip", a, 2.0 * a * traction, component)


def hertz_line(*, half_width: float, force: float) -> LineContact:
    """A cylinder: p = (2P/(pi a)) sqrt(1 - x^2/a^2), ``force`` P [N/m], ``half_width`` a [m] (Hertz 1882).

    Raises
    ------
    InvalidInput
        A half-width or force that is not positive and finite.

    Examples
    --------
    >>> from palpate import solutions
    >>> roller = solutions.hertz_line(half_width=1e-3, force=10.0)
    >>> roller.traction(0.0).round(1).tolist()  # (q_x, p) [Pa]; peak 2 P / (pi a)
    [0.0, 6366.2]
    """
    return _single("hertz", positive("half_width", half_width, "metres"), positive("force", force, "N/m"), "z")


def flat_punch_line(*, half_width: float, force: float) -> LineContact:
    """A flat rigid punch: p = P/(pi sqrt(a^2 - x^2)), ``force`` P [N/m], ``half_width`` a [m] (Sadowsky 1928).

    Raises
    ------
    InvalidInput
        A half-width or force that is not positive and finite.

    Examples
    --------
    >>> from palpate import solutions
    >>> punch = solutions.flat_punch_line(half_width=1e-3, force=10.0)
    >>> punch.traction(0.0).round(1).tolist()  # (q_x, p) [Pa]; P / (pi a) in the middle
    [0.0, 3183.1]
    """
    return _single("punch", positive("half_width", half_width, "metres"), positive("force", force, "N/m"), "z")


def hertz_contact_half_width(pad: HalfSpace, *, radius: float, force: float) -> float:
    """a = sqrt(4 P R/(pi E*)) [m]: a rigid cylinder of ``radius`` R [m] pressed with ``force`` P [N/m].

    Raises
    ------
    InvalidInput
        A radius or force that is not positive and finite.
    Unsupported
        A pad that is not a `HalfSpace`.

    Examples
    --------
    >>> from palpate import HalfSpace, solutions
    >>> pad = HalfSpace(youngs_modulus=3e5, poissons_ratio=0.5)  # E* = 4e5 Pa
    >>> round(solutions.hertz_contact_half_width(pad, radius=10e-3, force=100.0), 6)
    0.001784
    """
    return math.sqrt(
        4.0 * positive("force", force, "N/m") * positive("radius", radius, "metres") / (math.pi * smoothed_modulus(pad))
    )
