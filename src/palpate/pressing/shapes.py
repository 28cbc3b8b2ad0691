"""Curvature of a body at a point of contact."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["SHAPES", "Local", "local_shape"]

#: A place closer to an edge than this fraction of the body's smallest size counts as at the edge, because simulators
#: put a contact half its depth inside.
AT_EDGE = 0.02


@dataclass(frozen=True)
class Local:
    """The shape of a body around the place where it is touched, in the body's axes.

    Attributes
    ----------
    curvature : array (3, 3)
        Curvature [1/m] as a symmetric tensor in the tangential plane; 0 along flat or straight directions.
    known : bool
        False if the shape is unknown (a mesh): the curvature is then 0 without meaning.
    sharp : bool
        An edge or a corner, which no smooth contact touches.
    disc : float
        Radius [m] of the flat disc that is touched, 0 if there is none.
    center : array (3,)
        Middle of that disc.
    length : float
        Length of the straight line along which a cylinder or capsule touches [m], 0 if there is none.

    Examples
    --------
    >>> from palpate.pressing import local_shape
    >>> local_shape("sphere", [5e-3], [0.0, 0.0, 5e-3]).curvature.round(6).tolist()  # 1/R in both directions
    [[200.0, 0.0, 0.0], [0.0, 200.0, 0.0], [0.0, 0.0, 0.0]]
    """

    curvature: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    known: bool = True
    sharp: bool = False
    disc: float = 0.0
    center: Floats = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0


def local_shape(kind: str, size: Sequence[float], point: npt.ArrayLike) -> Local:
    """Return the shape of a body around a place on it.

    Parameters
    ----------
    kind : str
        One of `SHAPES`; anything else (a mesh) is not known.
    size : sequence of float
        [m]: of a sphere its radius; of a capsule or cylinder (axis z) radius and half-length; of an ellipsoid or box the half-axes.
    point : array (3,)
        A place on the body, or near to it, in its own axes [m].

    Returns
    -------
    Local

    Raises
    ------
    InvalidInput
        A place that is not three finite numbers.

    Examples
    --------
    >>> from palpate.pressing import local_shape
    >>> rod = local_shape("capsule", [5e-3, 20e-3], [5e-3, 0.0, 0.0])
    >>> rod.curvature.round(6).diagonal().tolist(), rod.length  # straight along z
    ([0.0, 200.0, 0.0], 0.04)

    >>> local_shape("box", [0.01, 0.01, 0.01], [0.01, 0.01, 0.0]).sharp, local_shape("mesh", [], [0.0, 0.0, 0.0]).known
    (True, False)
    """
    at = np.asarray(point, dtype=np.float64)
    if at.shape != (3,) or not np.isfinite(at).all():
        raise InvalidInput(f"point must be three finite numbers of metres; got {point!r}.")
    shape = SHAPES.get(kind)
    return Local(known=False) if shape is None else shape(np.asarray(size, dtype=np.float64), at)


def _plane(size: Floats, at: Floats) -> Local:
    return Local()


def _sphere(size: Floats, at: Floats) -> Local:
    return Local(_round(at) / size[0])


def _round(direction: Floats) -> Floats:
    """Return the identity in the plane normal to a direction."""
    length = float(np.linalg.norm(direction))
    unit = direction / length if length > 0 else np.array([0.0, 0.0, 1.0])
    return np.asarray(np.eye(3) - np.outer(unit, unit))


def _around(at: Floats, radius: float) -> Floats:
    """Return the curvature of a cylinder around the axis z."""
    across = np.array([-at[1], at[0], 0.0])
    across /= max(float(np.linalg.norm(across)), 1e-300)
    return np.asarray(np.outer(across, across) / radius)


def _capsule(size: Floats, at: Floats) -> Local:
    radius, half = size[:2]
    if abs(at[2]) > half * (1.0 + AT_EDGE):
        return _sphere(size, at - np.array([0.0, 0.0, math.copysign(half, at[2])]))
    return Local(_around(at, radius), length=2.0 * float(half))


def _cylinder(size: Floats, at: Floats) -> Local:
    radius, half = size[:2]
    near = AT_EDGE * min(radius, half)
    beside, beyond = math.hypot(at[0], at[1]) - radius, abs(at[2]) - half
    end = np.array([0.0, 0.0, math.copysign(half, at[2])])
    if abs(beside) < near and abs(beyond) < near:
        return Local(sharp=True, disc=float(radius), center=end, length=2.0 * half, curvature=_around(at, radius))
    if abs(beyond) < abs(beside):
        return Local(disc=float(radius), center=end)
    return Local(_around(at, radius), length=2.0 * float(half))


def _ellipsoid(size: Floats, at: Floats) -> Local:
    """Shape operator of sum (x/a)^2 = 1: its Hessian in the tangent plane, divided by the length of its gradient."""
    hessian = np.diag(2.0 / size[:3] ** 2)
    gradient = hessian @ at
    plane = _round(gradient)
    return Local(plane @ hessian @ plane / max(float(np.linalg.norm(gradient)), 1e-300))


def _box(size: Floats, at: Floats) -> Local:
    near = np.abs(np.abs(at) - size[:3]) < AT_EDGE * size[:3].min()
    return Local(sharp=bool(near.sum() > 1))


#: Curvature function of each kind of body, by its name in MuJoCo.
SHAPES: dict[str, Callable[[Floats, Floats], Local]] = {
    "plane": _plane,
    "sphere": _sphere,
    "capsule": _capsule,
    "cylinder": _cylinder,
    "ellipsoid": _ellipsoid,
    "box": _box,
}
