"""Build meshes of pads of constant thickness on a rigid core: a flat mesh is laid on a curved surface and extended
inwards along its normals.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.sensing.curved import Chart

__all__ = ["disc", "laid_on", "rectangle"]

#: Where meshes are joined, positions are rounded to less than this fraction of the radius.
JOINED = 1e-5


def rectangle(length: float, width: float, thickness: float, step: float, through: int) -> Any:
    """Return hexahedra of a block, in (x, y, depth)."""
    from skfem import MeshHex

    counts = [max(1, round(s / step)) for s in (length, width)]
    axes = [np.linspace(-0.5 * s, 0.5 * s, n + 1) for s, n in zip((length, width), counts)]
    return MeshHex.init_tensor(*axes, np.linspace(0.0, thickness, through + 1))


def disc(radius: float, thickness: float, step: float, through: int) -> Any:
    """Return hexahedra of a round plate, in (x, y, depth): a square block in the middle, and four blocks from its
    sides to the rim.
    """
    from skfem import MeshHex

    count = max(
        2, round(1.25 * radius / step)
    )  # elements along the rim are then 1.26 steps long, those in the middle 0.8
    layers, depths = max(1, round(0.55 * radius / step)), np.linspace(0.0, 1.0, through + 1)
    half = 0.5  # of the radius
    line = np.linspace(-1.0, 1.0, count + 1)
    middle = MeshHex.init_tensor(half * line, half * line, depths)
    points, elements, known = [np.asarray(middle.p)], [np.asarray(middle.t)], middle.nvertices
    for turn in range(4):
        block = MeshHex.init_tensor(np.linspace(0.0, 1.0, layers + 1), line, depths)
        out, along, depth = np.asarray(block.p)
        x = (1.0 - out) * half + out * np.cos(0.25 * np.pi * along)
        y = (1.0 - out) * half * along + out * np.sin(0.25 * np.pi * along)
        for _ in range(turn):
            x, y = -y, x
        points.append(np.stack([x, y, depth]))
        elements.append(block.t + known)
        known += block.nvertices
    # corners that are equal to eight decimals are one
    corners, which = np.unique(np.hstack(points).round(decimals=8), axis=1, return_inverse=True)
    scaled = np.ascontiguousarray(corners * np.array([[radius], [radius], [thickness]]))
    return MeshHex(scaled, np.ascontiguousarray(which.ravel()[np.hstack(elements)]))


def laid_on(flat: Any, chart: Chart, *, rim: float | None = None) -> tuple[Any, Floats]:
    """Return a mesh of curved hexahedra (MeshHex2) whose upper side is the surface of the chart, and the coordinates
    of its nodes in the chart (node, 3).

    ``rim`` is the radius of a `disc`: nodes between its corners are put on the circle.
    """
    from skfem import Basis, ElementHex2, MeshHex2

    places = np.array(Basis(flat, ElementHex2(), intorder=1).doflocs)
    if rim is not None:
        away = np.hypot(places[0], places[1])
        corners = np.hypot(*np.asarray(flat.p)[:2])
        on = corners > rim * (1.0 - JOINED)
        angles = np.sort(np.arctan2(*np.asarray(flat.p)[1::-1, on]))
        chord = rim * math.cos(0.5 * float(np.diff(np.unique(angles.round(5))).max()))
        snapped = away > chord * (1.0 - JOINED)
        places[:2, snapped] *= rim / away[snapped]
    frames = chart.frames(places[0], places[1])
    moved = frames.positions + places[2][:, None] * frames.axes[:, 2]
    return MeshHex2(np.ascontiguousarray(moved.T), flat.t), places.T
