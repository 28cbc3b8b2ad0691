"""Describe the taxels for the page: positions, outlines, names, and the edge of the measured area."""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.channels import channel_unit
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.readings import checked_planes
from palpate.skin import Skin

__all__ = ["MAX_READINGS", "described", "edge", "flat_readings"]

#: Largest number of readings that are shown one by one; a page keeps those of the last minute.
MAX_READINGS = 4096
#: Size of a scattered taxel without an aperture, as a fraction of the distance to its neighbour.
TAXEL_SIZE = 0.7


def described(skin: Skin) -> list[dict[str, Any]]:
    """Return the planes of a skin: channels with units, and position (x, y), size [m] and name of each taxel; in line
    contact y is 0.
    """
    return [
        {
            "channels": list(p.channels),
            "units": [channel_unit(c) for c in p.channels],
            "round": isinstance(p, ScatteredArray),
            "x": _rounded(_points(p)[:, 0]),
            "y": _rounded(_points(p)[:, 1]),
            "size": _rounded(_size(p)),
            "names": _names(p),
            "works": np.ravel(p.valid).astype(bool).tolist(),
        }
        for p in skin.planes
    ]


def edge(skin: Skin) -> list[list[float]]:
    """Return the corners (x, y) [m] of the convex outline of all taxels, in order; in line contact the two ends."""
    corners = []
    for p in skin.planes:
        points, half = _points(p), 0.5 * np.asarray(_size(p))
        corners += [points + half * np.array(side) for side in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    every = np.concatenate(corners)
    if skin.surface.dimensions == 1:
        return [[float(every[:, 0].min()), 0.0], [float(every[:, 0].max()), 0.0]]
    from scipy.spatial import ConvexHull

    return [[float(v) for v in every[k]] for k in ConvexHull(every).vertices]


def flat_readings(reading: Any, skin: Skin) -> Any:
    """Return the readings of a frame in one row, in the order of `described`: plane, channel, taxel."""
    parts = checked_planes(reading, skin.planes, single=True)
    return np.concatenate([np.ravel(to_numpy(part)).astype(np.float64) for part in parts])


def _points(p: Array) -> Any:
    """Return positions (taxel, (x, y))."""
    points = np.asarray(p.points, dtype=np.float64)
    return np.column_stack([points[:, 0], np.zeros(len(points))]) if points.shape[1] == 1 else points[:, ::-1]


def _size(p: Array) -> tuple[float, float]:
    """Return width and height [m] of a taxel: its aperture or, if that is a point, a cell of the grid or a fraction of
    the distance to the next taxel.
    """
    apertures = [float(a) for a in p.apertures]
    points = np.asarray(p.points, dtype=np.float64)
    if min(apertures) <= 0.0:
        if isinstance(p, ScatteredArray):
            apertures = [TAXEL_SIZE * _spacing(points)] * len(apertures)
        else:
            apertures = [float(s) for s in p.grid.spacings]
    return (apertures[-1], apertures[0]) if len(apertures) == 2 else (apertures[0], 0.0)


def _spacing(points: Any) -> float:
    """Return the typical distance of a point from its neighbour."""
    from scipy.spatial import KDTree

    if len(points) < 2:
        return 1e-3
    return float(np.median(KDTree(points).query(points, k=2)[0][:, 1])) or 1e-3


def _names(p: Array) -> list[str]:
    """Return the names of the taxels in messages: row and column on a grid, otherwise the number."""
    return [",".join(map(str, place)) for place in np.ndindex(*p.shape)]


def _rounded(values: Any) -> list[float]:
    """Round to a nanometre, which suffices for a page."""
    return [round(float(v), 9) for v in values]
