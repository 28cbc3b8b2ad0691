"""Area contact on a half-space: point load, uniform rectangle, Hertz and punch circles, friction."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import check_channels
from palpate.elastic.closed_form import PointTable, RectangleTable, area_fields
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import Floats, check_below
from palpate.errors import InvalidInput, Unsupported
from palpate.solutions._common import check_half_space, finite, positive, slip_ratio, smoothed_modulus

__all__ = ["AreaContact", "flat_punch", "hertz_contact_radius", "hertz_point", "patch", "point_load"]

#: Fractions of a force below this are rounding errors.
ROUNDING = 1e-15
#: Steps of a grid differ by less than this fraction: positions in single precision pass.
UNEVEN = 1e-3

Shape = Literal["load", "patch", "hertz", "punch"]


@dataclass(frozen=True)
class _Term:
    shape: Shape
    size: tuple[float, float]  # half-widths of a patch, or (radius, radius)
    force: float
    component: str


class _CircleTable:
    """Table of an axisymmetric load of unit force by complex sources.

    The potential of a pressure on a circle is that of sources spread over imaginary depths,
    int_{-a}^{a} g(t) Omega(x, y, z + i t) dt, with g = 1/(2a) for a flat punch and 3(a^2 - t^2)/(4 a^3) for Hertz.
    The integrand is analytic up to a distance z from the path: Gauss-Legendre converges like exp(-2 n z/a).
    """

    def __init__(self, x: Floats, y: Floats, z: Floats, radius: float, shape: Shape) -> None:
        nearest = float(np.min(z))
        if nearest < 0.01 * radius:
            raise Unsupported(
                f"subsurface fields of a circular contact need depth >= 0.01 * radius = {0.01 * radius:g} m; got "
                f"{nearest:g} m. On the surface use traction()."
            )
        t, weight = np.polynomial.legendre.leggauss(2 * (20 + math.ceil(10.0 * radius / nearest)))
        t, weight = t * radius, weight * radius
        g = 1.0 / (2 * radius) if shape == "punch" else 3.0 * (radius**2 - t**2) / (4 * radius**3)
        half = t > 0  # the two halves of the path are complex conjugates; an even rule has no node at 0
        self._weight = (2.0 * weight * g)[half]
        self._depths = t[half]
        self._point = (x, y, z)

    def __getitem__(self, key: str) -> Floats:
        x, y, z = self._point
        out = np.zeros(np.broadcast_shapes(x.shape, y.shape, z.shape))
        for w, t in zip(self._weight, self._depths):
            out += w * PointTable(x, y, z + 1j * t)[key].real
        return out


@dataclass(frozen=True)
class AreaContact:
    """An area contact: a sum of closed-form tractions. Make one with `hertz_point`, `patch`, and so on.

    Attributes
    ----------
    size : (float, float)
        Half-widths in x and y [m]: the contact radius twice for a circle.
    center : (float, float)
        Position (x, y) of the middle on the surface [m].

    Examples
    --------
    >>> from palpate import HalfSpace, solutions
    >>> ball = solutions.hertz_point(contact_radius=1e-3, force=1.0)
    >>> ball.sliding(0.5).force.round(3).tolist()  # dragged towards +x
    [0.5, 0.0, 1.0]

    >>> ball.partial_slip(0.5, 0.2).force.round(3).tolist()  # 0.2 N of the 0.5 N that friction bears
    [0.2, 0.0, 1.0]

    >>> ball.shifted(2e-3, 0.0).traction([0.0, 2e-3], 0.0)[2].round(-2).tolist()  # pressure [Pa] at two places
    [0.0, 477500.0]

    >>> centres = [-0.5e-3, 0.5e-3]  # of four cells, 1 mm wide
    >>> cells = ball.averages(centres, centres)
    >>> (cells[2].sum() * 1e-6).round(9).item()  # pressure times area [N]: all of the force
    1.0

    >>> pad = HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> ball.fields(pad, ["stress_zz"], 0.0, 0.0, [0.5e-3, 1e-3]).round(-2).tolist()  # below its middle [Pa]
    [[382000.0, 238700.0]]
    """

    terms: tuple[_Term, ...]
    size: tuple[float, float]
    center: tuple[float, float] = (0.0, 0.0)

    @property
    def force(self) -> Floats:
        """Net force (x, y, z) [N]."""
        return np.array([sum(t.force for t in self.terms if t.component == c) for c in "xyz"], dtype=np.float64)

    def traction(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Floats:
        """Surface traction (q_x, q_y, p) [Pa] at positions x, y [m], broadcast: shape (3, ...); infinite at the edge of
        a punch.
        """
        xx, yy = np.broadcast_arrays(
            np.asarray(x, dtype=np.float64) - self.center[0], np.asarray(y, dtype=np.float64) - self.center[1]
        )
        out = np.zeros((3, *xx.shape))
        for term in self.terms:
            out["xyz".index(term.component)] += term.force * _density(term, xx, yy)
        return out

    def averages(self, x: npt.ArrayLike, y: npt.ArrayLike) -> Floats:
        """Mean traction (3, y, x) [Pa] in the cells of a uniform grid with centres ``x`` and ``y`` [m]: exact.

        Each axis may rise or fall. `InvalidInput` if it has fewer than two centres, or unequal steps.
        """
        (edges_x, dx), (edges_y, dy) = _cells("x", x), _cells("y", y)
        edges_x, edges_y = edges_x - self.center[0], edges_y - self.center[1]
        out = np.zeros((3, edges_y.size - 1, edges_x.size - 1))
        for t in self.terms:
            share = np.diff(np.diff(_share(t, edges_x[None, :], edges_y[:, None]), axis=0), axis=1)
            share *= math.copysign(1.0, dx * dy)
            share[share < ROUNDING] = 0.0  # remove rounding errors of differences of 1/4
            out["xyz".index(t.component)] += t.force * share / abs(dx * dy)
        return out

    def fields(
        self,
        pad: HalfSpace,
        channels: Sequence[str],
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        depth: npt.ArrayLike,
    ) -> Floats:
        """Channels (channel, ...) at positions x, y and ``depth`` [m], broadcast together.

        `InvalidInput` for a depth above the surface (negative): z grows into the pad.
        """
        check_half_space(pad)
        check_below(depth)
        names = check_channels(channels, 2)
        xx, yy, zz = np.broadcast_arrays(
            np.asarray(x, dtype=np.float64) - self.center[0],
            np.asarray(y, dtype=np.float64) - self.center[1],
            np.asarray(depth, dtype=np.float64),
        )
        out = np.zeros((len(names), *xx.shape))
        constants = (pad.shear_modulus, pad.poissons_ratio)
        for term in self.terms:
            if term.shape == "load":
                table: PointTable | RectangleTable | _CircleTable = PointTable(xx, yy, zz)
            elif term.shape == "patch":
                table = RectangleTable(xx, yy, zz, term.size)
            else:
                table = _CircleTable(xx, yy, zz, term.size[0], term.shape)
            scale = term.force / (4 * term.size[0] * term.size[1]) if term.shape == "patch" else term.force
            out += scale * np.stack(area_fields(table, zz, term.component, constants, names))
        return out

    def shifted(self, x: float, y: float) -> AreaContact:
        """The same contact with its middle at (x, y) [m]."""
        return replace(self, center=(finite("x", x, "metres"), finite("y", y, "metres")))

    def sliding(self, friction: float, *, direction: float = 0.0) -> AreaContact:
        """The contact sliding: shear of size friction * p towards ``direction`` [rad from +x]."""
        friction, direction = finite("friction", friction, "(dimensionless)"), finite("direction", direction, "radians")
        normal = tuple(t for t in self.terms if t.component == "z")
        shear = tuple(
            replace(t, component=c, force=friction * share * t.force)
            for t in normal
            for c, share in (("x", math.cos(direction)), ("y", math.sin(direction)))
        )
        return replace(self, terms=normal + shear)

    def partial_slip(self, friction: float, tangential_force: float, *, direction: float = 0.0) -> AreaContact:
        """Cattaneo-Mindlin partial slip: a Hertz contact pulled by |Q| < mu P [N], stuck in r < c.

            q = mu [p(r; a) - (c/a) p(r; c)],   c/a = (1 - |Q|/(mu P))^(1/3)

        towards ``direction`` [rad from +x] (R. D. Mindlin 1949; the small transverse component that the exact
        solution has for nu > 0 is left out, as there).
        """
        if len(self.terms) != 1 or self.terms[0].shape != "hertz":
            raise Unsupported("partial_slip needs a frictionless Hertz contact; make one with hertz_point.")
        (normal,) = self.terms
        ratio = slip_ratio(friction, tangential_force, normal.force)
        stick = (1.0 - ratio) ** (1.0 / 3.0)
        full = math.copysign(friction * normal.force, tangential_force)
        inner = (stick * self.size[0], stick * self.size[1])
        shear = []
        for c, share in (("x", math.cos(direction)), ("y", math.sin(direction))):
            shear.append(replace(normal, component=c, force=share * full))
            shear.append(_Term("hertz", inner, -share * full * stick**3, c))
        return replace(self, terms=(normal, *shear))


def _cells(name: str, centres: npt.ArrayLike) -> tuple[Floats, float]:
    """Return the edges and the step [m] of cells with these centres; the step is negative if they fall."""
    places = np.asarray(centres, dtype=np.float64)
    steps = np.diff(places) if places.ndim == 1 else np.zeros(0)
    step = float(steps.mean()) if steps.size else math.nan
    if not (step != 0.0 and np.abs(steps - step).max(initial=0.0) <= UNEVEN * abs(step)):
        raise InvalidInput(
            f"{name} must hold the centres of two or more cells of equal width [m]; got shape {places.shape}"
            f"{f' with steps of {steps.min():g} to {steps.max():g} m' if steps.size else ''}. Use those of an AreaGrid."
        )
    return np.append(places - step / 2, places[-1] + step / 2), step


def _share(term: _Term, x: Floats, y: Floats) -> Floats:
    """Return the fraction of a term's force on the rectangle between its middle and the corner (x, y); odd in x and in
    y.

    Of a circle of radius a, with R^2 = a^2 - x^2 - y^2 at a corner within it,

        int int dx dy/R = x atan(y/R) + y atan(x/R) - a atan(x y/(a R)),

    and of R itself the integral of a times that over a: x y R/3 + x (3 a^2 - x^2)/6 atan(y/R) + y (3 a^2 - y^2)/6 atan(x/R) -
    a^3/3 atan(x y/(a R)). A corner beyond it leaves two segments out of a quarter.
    """
    a, b = term.size
    if term.shape == "load":
        return np.sign(x) * np.sign(y) / 4
    if term.shape == "patch":
        return np.clip(x / a, -1.0, 1.0) * np.clip(y / b, -1.0, 1.0) / 4
    u, v = np.minimum(np.abs(x) / a, 1.0), np.minimum(np.abs(y) / a, 1.0)
    root = np.sqrt(np.maximum(1.0 - u**2 - v**2, 0.0))
    along, across, both = np.arctan2(v, root), np.arctan2(u, root), np.arctan2(u * v, root)
    if term.shape == "punch":
        inner = (u * along + v * across - both) / (2 * math.pi)
        outer = 0.25 - (1.0 - u) / 4 - (1.0 - v) / 4
    else:
        inner = u * v * root / 3 + u * (3 - u**2) / 6 * along + v * (3 - v**2) / 6 * across - both / 3
        inner *= 3 / (2 * math.pi)
        outer = 0.25 - (2 - 3 * u + u**3) / 8 - (2 - 3 * v + v**3) / 8
    return np.sign(x) * np.sign(y) * np.where(u**2 + v**2 < 1.0, inner, outer)


def _density(term: _Term, x: Floats, y: Floats) -> Floats:
    a, b = term.size
    if term.shape == "load":
        raise Unsupported("a point load has no finite traction; use fields().")
    if term.shape == "patch":
        return np.where((np.abs(x) <= a) & (np.abs(y) <= b), 1.0 / (4 * a * b), 0.0)
    inside = 1.0 - (x**2 + y**2) / a**2
    with np.errstate(divide="ignore"):
        if term.shape == "hertz":
            return np.where(inside > 0, 1.5 / (math.pi * a**2) * np.sqrt(np.maximum(inside, 0.0)), 0.0)
        return np.where(inside >= 0, 0.5 / (math.pi * a**2) / np.sqrt(np.maximum(inside, 0.0)), 0.0)


def _single(shape: Shape, size: tuple[float, float], force: float, component: str) -> AreaContact:
    if component not in ("x", "y", "z"):
        raise InvalidInput(f'component must be "x", "y" (shear) or "z" (pressure); got {component!r}.')
    if not math.isfinite(force):
        raise InvalidInput(f"force must be a finite number of newtons; got {force!r}.")
    return AreaContact((_Term(shape, size, float(force), component),), size)


def point_load(*, force: float, component: str = "z") -> AreaContact:
    """A point force [N] at the origin: Boussinesq ("z") or Cerruti ("x", "y").

    Raises
    ------
    InvalidInput
        A number that is not finite, a size that is not positive, or a component that there is not.

    Examples
    --------
    >>> from palpate import HalfSpace, solutions
    >>> pad = HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> load = solutions.point_load(force=1.0)
    >>> load.fields(pad, ["stress_zz"], 0.0, 0.0, 1e-3).round(-2).tolist()  # 3 P / (2 pi z^2)
    [477500.0]
    """
    return _single("load", (0.0, 0.0), force, component)


def patch(*, half_widths: tuple[float, float], traction: float, component: str = "z") -> AreaContact:
    """Uniform ``traction`` [Pa] on |x| < a, |y| < b, ``half_widths`` (a, b) [m] (Love 1929 for pressure).

    Raises
    ------
    InvalidInput
        A number that is not finite, a size that is not positive, or a component that there is not.

    Examples
    --------
    >>> from palpate import solutions
    >>> solutions.patch(half_widths=(1e-3, 2e-3), traction=1e4).force.round(6).tolist()  # 4 a b p
    [0.0, 0.0, 0.08]
    """
    a, b = (positive("half_widths", h, "metres") for h in half_widths)
    return _single("patch", (a, b), 4 * a * b * traction, component)


def hertz_point(*, force: float, contact_radius: float | None = None, radius: float | None = None) -> AreaContact:
    """A ball: p = (3P/(2 pi a^2)) sqrt(1 - r^2/a^2) within the ``contact_radius`` a [m], ``force`` P [N] (Hertz 1882).

    The radius a of the contact is not that of the ball: `hertz_contact_radius` computes it from the ball's radius, the force and the pad. ``radius`` is the
    former name of ``contact_radius``, and warns.

    Raises
    ------
    InvalidInput
        No radius or two of them, or a radius or force that is not positive and finite.

    Examples
    --------
    >>> from palpate import HalfSpace, solutions
    >>> ball = solutions.hertz_point(contact_radius=1e-3, force=1.0)
    >>> ball.traction(0.0, 0.0).round(-2).tolist()  # peak 3 P / (2 pi a^2)
    [0.0, 0.0, 477500.0]

    >>> pad = HalfSpace(youngs_modulus=3e5, poissons_ratio=0.5)
    >>> a = solutions.hertz_contact_radius(pad, radius=10e-3, force=1.0)  # of a ball of 20 mm across
    >>> round(solutions.hertz_point(contact_radius=a, force=1.0).size[0], 6)
    0.002657
    """
    if radius is not None:
        if contact_radius is not None:
            raise InvalidInput("contact_radius and radius are both given; radius is its former name: leave it out.")
        warnings.warn(
            "hertz_point(radius=...) is the radius of the contact, not of the ball: write contact_radius=. hertz_contact_radius computes it from the ball's.",
            FutureWarning,
            stacklevel=2,
        )
        contact_radius = radius
    if contact_radius is None:
        raise InvalidInput(
            "contact_radius is missing: the radius of the contact [m]; hertz_contact_radius(pad, radius=..., force=...) computes it from the ball's."
        )
    a = positive("contact_radius", contact_radius, "metres")
    return _single("hertz", (a, a), positive("force", force, "newtons"), "z")


def flat_punch(*, radius: float, force: float) -> AreaContact:
    """A flat circular punch: p = P/(2 pi a sqrt(a^2 - r^2)), ``force`` P [N], ``radius`` a [m] (Boussinesq).

    Raises
    ------
    InvalidInput
        A radius or force that is not positive and finite.

    Examples
    --------
    >>> from palpate import solutions
    >>> punch = solutions.flat_punch(radius=1e-3, force=1.0)
    >>> punch.traction(0.0, 0.0).round(-2).tolist()  # P / (2 pi a^2) in the middle
    [0.0, 0.0, 159200.0]
    """
    a = positive("radius", radius, "metres")
    return _single("punch", (a, a), positive("force", force, "newtons"), "z")


def hertz_contact_radius(pad: HalfSpace, *, radius: float, force: float) -> float:
    """a = (3 P R/(4 E*))^(1/3) [m]: a rigid ball of ``radius`` R [m] pressed with ``force`` P [N].

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
    >>> round(solutions.hertz_contact_radius(pad, radius=10e-3, force=1.0), 6)
    0.002657
    """
    product = positive("force", force, "newtons") * positive("radius", radius, "metres")
    return (3.0 * product / (4.0 * smoothed_modulus(pad))) ** (1.0 / 3.0)
