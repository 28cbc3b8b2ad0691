"""Measure how far two meshes of the same pad differ in the readings that they predict."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.sensing.arrays import Array
from palpate.sensing.grids import check_length
from palpate.solid.charts import surface_area

__all__ = ["assumed", "mesh_error", "through"]

#: Smallest number of cells between the middle of a press and its rim.
ACROSS = 4.0
#: Two pads have the same shape if their outlines and thicknesses agree to this fraction: flat facets depart from a
#: curve by up to 2 %.
SAME = 0.02
#: Fewer elements through the thickness are too few. Default meshes have 3 or 4.
ENOUGH = 2.6
#: Relative error of readings with one element through the thickness; it falls with the square of their number. With 2,
#: displacement of the surface and stress on a dome's core are 10 % off, stress on the base of a box 4 %, stress inside
#: 24 % (`mesh_error` with meshes of 5).
ONE_THROUGH = 0.4


def through(pad: Any) -> float:
    """Return the number of elements through the thickness of a solid pad: that of cubes as large as its elements."""
    area = surface_area(pad.vertices[pad.contact])
    split = 1 if pad.elements.shape[1] == 8 else 6  # tetrahedra in a cube
    return float(pad.thickness / np.cbrt(split * area * pad.thickness / len(pad.elements)))


def assumed(pad: Any) -> float | None:
    """Return the relative error that is assumed for the readings of a coarse mesh; None if the mesh is fine enough."""
    count = through(pad)
    return None if count >= ENOUGH else min(0.5, ONE_THROUGH / count**2)


def mesh_error(pad: Any, other: Any, array: Array, radius: float | None) -> float:
    """See `SolidPad.mesh_error`; both pads are solid ones, whose file imports this one."""
    size = 0.5 * pad.thickness if radius is None else check_length("radius", radius)
    mine, its = (np.array([*np.ravel(p.outline), p.thickness]) for p in (pad, other))
    material = (pad.youngs_modulus, pad.poissons_ratio) == (other.youngs_modulus, other.poissons_ratio)
    if np.abs(mine - its).max() > SAME * pad.thickness or type(pad.chart) is not type(other.chart) or not material:
        raise InvalidInput(
            "the other pad has another shape, surface or material. Compare two meshes of one pad: make it again with another element=."
        )
    if len(pad.elements) == len(other.elements) and np.array_equal(pad.vertices, other.vertices):
        raise InvalidInput("both pads have the same mesh. Make the other one with a smaller element=.")
    width = size / ACROSS
    squares = []
    for y, x in array.points:
        cells = int(2 * ACROSS)
        # use each pad's own chart: those of two mesh files differ slightly
        surfaces = [p.grid(shape=(cells, cells), spacing=width, center=(float(x), float(y))) for p in (pad, other)]
        across = [a - m for a, m in zip(surfaces[0].axes, (float(y), float(x)))]
        press = np.sqrt(np.maximum(0.0, 1.0 - (across[0][:, None] ** 2 + across[1] ** 2) / size**2))
        found, finer = (
            np.tensordot(p.response(array.at_base(p.thickness), s).dense(), press, axes=2).reshape(-1, 3)
            for p, s in zip((pad, other), surfaces)
        )
        squares.append(((found - finer) ** 2).sum(axis=0) / (finer**2).sum(axis=0))
    return float(np.sqrt(np.mean(squares)))
