"""Find the cells at and beyond the edge of the array."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.sensing.operator import Operator

__all__ = ["outside_taxels", "ring_of"]

Flags = npt.NDArray[np.bool_]


def outside_taxels(operator: Operator) -> Flags:
    """Mask of the surface cells that lie outside the outermost taxels."""
    grid = operator.surface
    points = np.concatenate([a.points[np.ravel(a.valid)] for a in operator.planes_of])
    out = np.zeros(grid.shape, dtype=bool)
    for axis, (x, dx) in enumerate(zip(grid.axes, grid.spacings)):
        low, high = points[:, axis].min() - 0.5 * dx, points[:, axis].max() + 0.5 * dx
        outside = (x < low - 1e-9 * dx) | (x > high + 1e-9 * dx)
        out |= outside.reshape([-1 if a == axis else 1 for a in range(grid.dimensions)])
    return out


def ring_of(outside: Flags) -> Flags:
    """Mask (cell,) of the cells above the outermost taxels, given the mask ``outside`` of the cells beyond them."""
    inside, d = ~outside, outside.ndim
    edge = np.zeros(outside.shape, dtype=bool)
    for axis in range(d):
        lines = np.flatnonzero(inside.any(axis=tuple(a for a in range(d) if a != axis)))
        for line in (lines[0], lines[-1]):
            place: list[Any] = [slice(None)] * d
            place[axis] = line
            edge[tuple(place)] = True
    return np.asarray((edge & inside).ravel())
