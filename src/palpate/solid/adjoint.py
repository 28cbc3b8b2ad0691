"""Compute the displacement of the surface that belongs to each reading, by one adjoint solve a reading.

Of a solid that is its own mirror image, sensors at mirrored places share a solve.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.sensing.arrays import Array
from palpate.sensing.kernels import aperture_rule
from palpate.solid.making import FLAT, THROUGH

__all__ = ["fields", "mirrors"]

Index = npt.NDArray[np.intp]
Key = tuple[Any, ...]

#: Component of traction that a channel on a rigid base measures.
ON_BASE = {"stress_xz": 0, "stress_yz": 1, "stress_zz": 2}
#: Largest size of cached fields at the surface [bytes].
CACHE_BYTES = 2_000_000_000
#: Number of readings whose loads are held at a time.
BLOCK = 128
#: Mirrored positions agree to this fraction of the solid's width; meshers write eight digits.
SYMMETRIC = 1e-7
#: Decimals of the positions [m] of readings: 0.1 pm.
DIGITS = 13


def mirrors(pad: Any) -> tuple[Index | None, Index | None]:
    """See `SolidPad._mirrors`.

    The mirror image of every node must be a node, of every element an element, and of every fixed node a fixed one.
    """
    solid, found = pad.solid, []
    places = np.asarray(solid.basis.doflocs).T
    tree, width = cKDTree(places), float(np.ptp(places, axis=0).max())
    elements = {tuple(e) for e in np.sort(solid.dofs, axis=0).T.tolist()}
    rank = np.full(len(places), -1, dtype=np.intp)
    rank[pad._top] = np.arange(len(pad._top))
    for axis in (0, 1):
        sign = np.ones(3)
        sign[axis] = -1.0
        away, image = tree.query(places * sign)
        same = (
            away.max() < SYMMETRIC * width
            and np.array_equal(np.sort(image[solid.held]), solid.held)
            and {tuple(e) for e in np.sort(image[solid.dofs], axis=0).T.tolist()} == elements
            and (rank[image[pad._top]] >= 0).all()
        )
        found.append(rank[image[pad._top]] if same else None)
    return found[0], found[1]


def _images(pad: Any, keys: list[Key]) -> list[tuple[Key, list[int]]]:
    """Return for each reading one at a mirrored place with x >= 0 and y >= 0, where the solid allows, and the axes
    along which it is mirrored.
    """
    places = np.array([k[:3] for k in keys], dtype=np.float64)
    flips: list[list[int]] = [[] for _ in keys]
    for axis, order in enumerate(pad._mirrors):
        if order is None:
            continue
        sign = np.ones(3)
        sign[axis] = -1.0
        there = np.flatnonzero(places[:, axis] < 0.0)
        mirrored = places[there] * sign
        positions, axes = pad._at(*places[there].T)
        image, turned = pad._at(*mirrored.T)
        # the tangents of a chart, and a pad's own axes, must be mirrored as well
        alike = np.abs(image - positions * sign).max(axis=1) < SYMMETRIC * pad.thickness
        alike &= np.abs(turned - axes * sign * sign[:, None]).max(axis=(1, 2)) < SYMMETRIC
        for i in there[alike].tolist():
            flips[i].append(axis)
            places[i, axis] *= -1.0
    return [((*map(float, p), *k[3:]), f) for p, k, f in zip(places, keys, flips)]


def _mirrored(pad: Any, field: Floats, channel: str, flips: list[int]) -> Floats:
    """Return the field (axis, node of the surface) of the mirrored reading."""
    for axis in flips:
        field = field[:, pad._mirrors[axis]]
        signs = np.where(np.arange(3) == axis, -1.0, 1.0) * (-1.0 if "xy"[axis] in find_channel(channel).odd else 1.0)
        field = field * signs[:, None]
    return field


def fields(pad: Any, array: Array) -> Floats:
    """Return the displacements (reading, axis, node of the surface) for a unit of each reading of a `SolidPad`,
    ordered by taxel, then channel.
    """
    widths = tuple(float(w) for w in array.apertures)
    # the same taxel in a part of the array is at the same place but for rounding
    points = np.round(array.points, DIGITS).tolist()
    keys = [(x, y, float(array.depth), c, *widths) for y, x in points for c in array.channels]
    images = _images(pad, keys)
    missing = list(dict.fromkeys(k for k, _ in images if k not in pad._kept))
    for start in range(0, len(missing), BLOCK):
        some = missing[start : start + BLOCK]
        found = pad.solid.solve(*_loads(pad, array, some)).reshape(-1, 3, len(some))[pad._top]
        for column, key in enumerate(some):
            pad._kept[key] = np.ascontiguousarray(found[:, :, column].T)
    out = np.stack([_mirrored(pad, pad._kept[key], str(key[3]), flips) for key, flips in images])
    while len(pad._kept) > 1 and len(pad._kept) * out[0].nbytes > CACHE_BYTES:
        pad._kept.popitem(last=False)
    return out


def _loads(pad: Any, array: Array, some: list[Key]) -> tuple[Floats, Floats | None]:
    """Return the adjoint loads (unknown, reading), and the displacements that are prescribed to fixed nodes."""
    solid = pad.solid
    spacing = float(np.sqrt(np.ptp(pad.outline[0]) * np.ptp(pad.outline[1]))) / 100.0
    rules = [aperture_rule(w, array.depth, spacing, None) for w in array.apertures]
    loads = np.zeros((3 * solid.basis.N, len(some)))
    moved_base = np.zeros_like(loads) if pad._flush else None
    # stress jumps between elements: take the mean of both sides
    beside = 1e-6 * float(pad.thickness) / THROUGH
    around = [(d * beside, 0.5) for d in (-1.0, 1.0)]
    nodes = list(itertools.product(zip(*rules[0]), zip(*rules[1]), around, around, around))
    weights = np.array([math.prod(w for _, w in node) for node in nodes])
    moved = np.array([[b + e, a + d, f] for (a, _), (b, _), (d, _), (e, _), (f, _) in nodes])
    places = np.array([k[:3] for k in some])
    deep = places[:, 2] > pad.thickness * (1.0 - FLAT)
    glued = deep & solid.is_held(pad._at(*places.T)[0].T) if pad._flush and deep.any() else np.zeros_like(deep)
    groups = dict.fromkeys((str(k[3]), bool(g) and str(k[3]) in ON_BASE) for k, g in zip(some, glued))
    for name, on_base in groups:
        columns = np.array(
            [i for i, k in enumerate(some) if k[3] == name and (bool(glued[i]) and name in ON_BASE) is on_base]
        )
        middles = places[columns]
        if moved_base is not None and on_base:  # pressure and shear on the base: from its reactions
            spots = list(itertools.product(zip(*rules[0]), zip(*rules[1])))
            parts = np.array([v * w for (_, v), (_, w) in spots])
            steps = np.array([[b, a] for (a, _), (b, _) in spots])
            x, y = (middles[:, None, :2] + steps).reshape(-1, 2).T
            positions, axes = pad._at(x, y, np.full_like(x, pad.thickness))
            shape = (3, len(columns), len(spots))
            along = (axes[:, ON_BASE[name]] * np.tile(parts, len(columns))[:, None]).T.reshape(shape)
            each = solid.at_held(positions.T.reshape(shape), along)
            moved_base.reshape(-1, 3, len(some))[np.ix_(solid.held, np.arange(3), columns)] = each
            continue
        x, y, depth = (middles[:, None] + moved).reshape(-1, 3).T
        positions, axes = pad._at(x, y, depth)
        held, local = solid.at(positions.T, axes)
        rows = np.asarray(find_channel(name).read(local)) * np.tile(weights, len(columns))[:, None, None]
        unknowns = 3 * held.T[:, :, None] + np.arange(3)
        np.add.at(loads, (unknowns, np.repeat(columns, len(weights))[:, None, None]), rows)
    return loads, moved_base
