"""Footprints: the area that a contact presses, as points that each carry a fraction of the force.

Every footprint is a set of points (contact, point, 2) [m] with non-negative weights (contact, point) that add up to 1.
A point carries the force of the area around it; `palpate.pressing.spread` distributes points over cells.
"""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats

__all__ = ["disc_points", "ellipse_points", "hull_points", "strip_points", "tilted"]

#: Smallest number of points along the radius of an ellipse: 8 give an error of 1e-3 of the largest reading, 12 a third
#: of that.
MIN_POINTS = 12
#: Largest number of Newton steps of `tilted`; an ordinary press needs six.
STEPS = 30
#: Largest tilt: the pressure changes by a factor exp(12) over a standard deviation of the footprint, so that
#: practically all of it is at one edge.
STEEPEST = 12.0
#: A polygon is convex if no corner lies beyond a side by more than this fraction of its size.
FLAT = 1e-12


def ellipse_points(count: int) -> tuple[Floats, Floats]:
    """Return points (point, 2) and weights of Hertz's pressure on the unit circle, with exact moments.

    With u = sqrt(1 - r^2) the fraction of the force within dr is 3 u^2 du: Gauss-Legendre quadrature in u, equal
    angles.
    """
    count = max(MIN_POINTS, count)
    t, w = np.polynomial.legendre.leggauss(count)
    u = 0.5 * (t + 1.0)
    radius = np.sqrt(1.0 - u**2)
    angles = 3 * count
    angle = 2.0 * np.pi * (np.arange(angles) + 0.5) / angles
    points = np.stack([np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()], axis=-1)
    return points, np.repeat(1.5 * w * u**2 / angles, angles)


def disc_points(count: int) -> tuple[Floats, Floats]:
    """Points (point, 2) and weights of a uniform pressure on the unit circle, by Gauss-Legendre quadrature in r^2."""
    count = max(MIN_POINTS, count)
    t, w = np.polynomial.legendre.leggauss(count)
    radius, angles = np.sqrt(0.5 * (t + 1.0)), 3 * count
    angle = 2.0 * np.pi * (np.arange(angles) + 0.5) / angles
    points = np.stack([np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()], axis=-1)
    return points, np.repeat(0.5 * w / angles, angles)


def strip_points(count: int) -> tuple[Floats, Floats]:
    """Return points (point, 2) on |u|, |v| < 1 and weights of Hertz's line pressure: sqrt(1 - v^2) across, uniform
    along.

    Across by Gauss-Chebyshev quadrature of the second kind, along by the midpoint rule.
    """
    along = (np.arange(max(MIN_POINTS, count)) + 0.5) * 2.0 / max(MIN_POINTS, count) - 1.0
    angle = np.pi * np.arange(1, MIN_POINTS + 1) / (MIN_POINTS + 1)
    across, weight = np.cos(angle), 2.0 / (MIN_POINTS + 1) * np.sin(angle) ** 2
    u, v = np.meshgrid(along, across, indexing="ij")
    return np.stack([u.ravel(), v.ravel()], axis=-1), np.tile(weight, len(along)) / len(along)


def hull_points(vertices: Floats, count: int) -> tuple[Floats, Floats]:
    """Return points and weights of a uniform pressure on the convex hulls of some places.

    Parameters
    ----------
    vertices : array (contact, vertex, 2)
        Three or more places that do not lie on a line, in any order; a place may be there more than once.
    count : int
        Points along a side of each triangle.

    Returns
    -------
    points (contact, point, 2), weights (contact, point)
    """
    ring = _hulls(vertices)
    corner = (ring != np.roll(ring, 1, axis=1)).any(axis=-1)[..., None]  # once each, however many repeat
    middle = (ring * corner).sum(axis=1, keepdims=True) / corner.sum(axis=1, keepdims=True)
    after = np.roll(ring, -1, axis=1)
    first, second = ring - middle, after - middle
    areas = 0.5 * np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
    # middles of the small triangles, which have equal areas: those oriented like the large one, and the inverted ones
    i, j = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    up, down = i + j < count, i + j < count - 1
    s = np.concatenate([(i[up] + 1 / 3) / count, (i[down] + 2 / 3) / count])
    t = np.concatenate([(j[up] + 1 / 3) / count, (j[down] + 2 / 3) / count])
    points = middle[:, None] + s[:, None] * first[:, :, None] + t[:, None] * second[:, :, None]
    whole = np.maximum(areas.sum(axis=1, keepdims=True), 1e-300)
    weights = np.repeat((areas / whole)[..., None] / len(s), len(s), axis=-1)
    n = len(vertices)
    return points.reshape(n, -1, 2), weights.reshape(n, -1)


def _hulls(vertices: Floats) -> Floats:
    """Return the corners (contact, corner, 2) of convex hulls in order; the last one repeats where there are fewer."""
    away = vertices - vertices.mean(axis=1, keepdims=True)
    order = np.argsort(np.arctan2(away[..., 1], away[..., 0]), axis=1)
    ring = np.take_along_axis(vertices, order[..., None], axis=1)
    side, seen = np.roll(ring, -1, axis=1) - ring, ring[:, None] - ring[:, :, None]
    left = side[:, :, None, 0] * seen[..., 1] - side[:, :, None, 1] * seen[..., 0]
    # a place inside puts others on the wrong side of the ring
    inside = np.flatnonzero((left < -FLAT * (away**2).sum(axis=-1).max(axis=1)[:, None, None]).any(axis=(1, 2)))
    if not len(inside):
        return ring
    from scipy.spatial import ConvexHull

    for i in inside:
        corners = vertices[i, ConvexHull(vertices[i]).vertices]
        ring[i] = corners[np.minimum(np.arange(ring.shape[1]), len(corners) - 1)]
    return ring


def tilted(points: Floats, weights: Floats, center: Floats) -> tuple[Floats, Floats]:
    """Return the footprint with its centre of pressure moved to ``center`` (contact, 2): weights are multiplied by
    exp(c . x), so that they stay positive.

    Of all pressures with that centre this one is nearest to the original (in relative entropy). c minimises a convex
    function and is found by Newton's method. If ``center`` lies outside the footprint, the pressure moves to its edge,
    and the footprint is shifted by the rest.
    """
    middle = (weights[..., None] * points).sum(axis=1, keepdims=True)
    size = np.sqrt((weights * ((points - middle) ** 2).sum(axis=-1)).sum(axis=1))
    size = np.maximum(size, 1e-12)[:, None, None]
    x = (points - middle) / size
    target = (center[:, None] - middle) / size
    tilt = np.zeros((len(points), 1, 2))
    found = weights
    for _ in range(STEPS):
        exponent = (x * tilt).sum(axis=-1)
        found = weights * np.exp(exponent - exponent.max(axis=1, keepdims=True))
        found = found / found.sum(axis=1, keepdims=True)
        mean = (found[..., None] * x).sum(axis=1, keepdims=True)
        left = target - mean
        going = np.abs(left).max(axis=-1, keepdims=True) > 1e-13
        if not going.any():
            break
        away = x - mean
        spread = np.einsum("nk,nki,nkj->nij", found, away, away)
        spread += 1e-6 * np.eye(2) * (1e-6 + np.trace(spread, axis1=1, axis2=2))[:, None, None]
        step = np.linalg.solve(spread, left[:, 0, :, None])[:, None, :, 0]
        step *= np.minimum(1.0, 1.0 / np.maximum(np.linalg.norm(step, axis=-1, keepdims=True), 1e-300))
        tilt = tilt + np.where(going, step, 0.0)
        tilt *= np.minimum(1.0, STEEPEST / np.maximum(np.linalg.norm(tilt, axis=-1, keepdims=True), 1e-300))
    mean = (found[..., None] * points).sum(axis=1, keepdims=True)
    return points + (center[:, None] - mean), found
