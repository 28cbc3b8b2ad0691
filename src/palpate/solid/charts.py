"""Charts of the contact surfaces of meshes: a plane, a cap of a sphere, or any surface that is visible from above."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.curved import Chart, Frames, SphereChart

__all__ = ["MeshChart", "PlaneChart", "depths", "fitted_chart", "surface_area"]

Index = npt.NDArray[np.intp]

#: A surface counts as a cap of a sphere if its vertices deviate from the sphere by less than this fraction of its
#: radius, and if its area agrees with the cap's to `SAME_AREA`: facets of 12 degrees lose 0.4 % of the area.
ROUND, SAME_AREA = 1e-3, 0.03
#: Cosine of the steepest slope of a surface seen from above: cells there are five times as long as they appear.
STEEPEST = 0.2
#: Number of nearest triangles that are tried for a point.
TRIED = 24
#: A point outside a triangle by less than this fraction of it counts as inside.
EDGE_TOLERANCE = 1e-9


@dataclass(frozen=True, kw_only=True)
class PlaneChart:
    """A rectangle in the plane z = 0."""

    outline: tuple[tuple[float, float], tuple[float, float]]

    def frames(self, x: Floats, y: Floats) -> Frames:
        """Return the frames of the plane, with stretch 1 inside the rectangle."""
        (x0, x1), (y0, y1) = self.outline
        axes = np.broadcast_to(np.eye(3), (*np.shape(x), 3, 3))
        on = (x > x0) & (x < x1) & (y > y0) & (y < y1)
        return Frames(np.stack([x, y, np.zeros_like(x)], axis=-1), axes, on.astype(np.float64))


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshChart:
    """A surface of triangles or quadrilaterals that is completely visible from above: x and y are its coordinates.

    Normals are interpolated between the vertices; the stretch is constant on each facet, so that areas are those of
    the mesh.
    """

    vertices: Floats
    facets: Index

    def __post_init__(self) -> None:
        steep = float(np.abs(self._normals[:, 2]).min())
        if steep < STEEPEST or np.ptp(np.sign(self._normals[:, 2])) > 0:
            raise InvalidInput(
                f"the surface that is touched is too steep to be seen from above: facets are up to {math.degrees(math.acos(min(steep, 1.0))):.0f} degrees "
                f"off the plane (at most {math.degrees(math.acos(STEEPEST)):.0f}). Name the part of it that points along z as contact=, or give turned=True where its z points out of the pad."
            )

    @cached_property
    def _triangles(self) -> Floats:
        """Corners of the triangles (triangle, corner, axis)."""
        facets = np.asarray(self.facets)
        if facets.shape[1] == 4:
            # split each quadrilateral into two triangles, for either orientation of its corners
            around = np.array([_round(self.vertices[f]) for f in facets])
            facets = np.take_along_axis(facets, around, axis=1)
            facets = np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]])
        return np.asarray(self.vertices, dtype=np.float64)[facets]

    @cached_property
    def _areas(self) -> Floats:
        """Normal vectors (triangle, axis) with positive z, whose length is twice the area."""
        a, b, c = self._triangles.swapaxes(0, 1)
        found = np.cross(b - a, c - a)
        return np.asarray(found * np.where(found[:, 2:] < 0.0, -1.0, 1.0))

    @cached_property
    def _normals(self) -> Floats:
        return np.asarray(self._areas / np.linalg.norm(self._areas, axis=1, keepdims=True))

    @cached_property
    def _corner_normals(self) -> Floats:
        """Normals (triangle, corner, axis): the mean over the triangles that share a corner, weighted by area."""
        corners = self._triangles.reshape(-1, 3)
        size = float(np.ptp(corners, axis=0).max())
        _, where = np.unique(np.round(corners / size, 9), axis=0, return_inverse=True)
        where = where.ravel()
        total = np.zeros((where.max() + 1, 3))
        np.add.at(total, where, np.repeat(self._areas, 3, axis=0))
        return np.asarray(total[where].reshape(-1, 3, 3))

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._triangles.mean(axis=1)[:, :2])

    @cached_property
    def outline(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lowest and highest x, and lowest and highest y, of all facets [m]."""
        low, high = (getattr(self._triangles.reshape(-1, 3), name)(axis=0) for name in ("min", "max"))
        return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))

    @cached_property
    def area(self) -> float:
        """Area of all facets [m^2]."""
        return float(0.5 * np.linalg.norm(self._areas, axis=1).sum())

    def distances(self, points: Floats) -> Floats:
        """Return the distances [m] of points (n, axis) from the nearest facet."""
        corners = self._triangles
        tried = min(TRIED, len(corners))
        near = cKDTree(corners.mean(axis=1)).query(points, k=tried)[1].reshape(len(points), tried)
        a, b, c = np.moveaxis(corners[near], 2, 0)
        p, normal = points[:, None], self._normals[near]
        found = np.abs(np.einsum("nka,nka->nk", p - a, normal))
        inside = np.ones(near.shape, dtype=bool)
        beside = np.full(near.shape, np.inf)
        for start, stop, third in ((a, b, c), (b, c, a), (c, a, b)):
            edge, inwards = stop - start, np.cross(normal, stop - start)
            inwards *= np.sign(np.einsum("nka,nka->nk", third - start, inwards))[..., None]
            inside &= np.einsum("nka,nka->nk", p - start, inwards) >= 0.0
            along = np.einsum("nka,nka->nk", p - start, edge) / np.einsum("nka,nka->nk", edge, edge)
            away = p - start - np.clip(along, 0.0, 1.0)[..., None] * edge
            beside = np.minimum(beside, np.linalg.norm(away, axis=-1))
        return np.asarray(np.where(inside, found, beside).min(axis=1))

    def frames(self, x: Floats, y: Floats) -> Frames:
        """Return the frames on the facet above or below each point; beside the surface those of the nearest facet,
        with stretch 0.
        """
        shape = np.shape(x)
        places = np.stack([np.ravel(x), np.ravel(y)], axis=1)
        tried = min(TRIED, len(self._triangles))
        near = self._tree.query(places, k=tried)[1].reshape(len(places), tried)
        a = self._triangles[:, 0, :2]
        edges = np.stack([self._triangles[:, 1, :2] - a, self._triangles[:, 2, :2] - a], axis=-1)
        found = np.linalg.solve(edges[near], (places[:, None] - a[near])[..., None])[..., 0]
        shares = np.concatenate([1.0 - found.sum(axis=-1, keepdims=True), found], axis=-1)
        least = shares.min(axis=-1)
        best = least.argmax(axis=1)
        row = np.arange(len(places))
        triangle, share = near[row, best], np.clip(shares[row, best], 0.0, None)
        share = share / share.sum(axis=1, keepdims=True)
        positions = np.einsum("nc,nca->na", share, self._triangles[triangle])
        positions[:, :2] = places
        normals = np.einsum("nc,nca->na", share, self._corner_normals[triangle])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        # tangents: x and y, rotated like z into the normal
        n1, n2, n3 = normals.T
        first = np.stack([1.0 - n1**2 / (1.0 + n3), -n1 * n2 / (1.0 + n3), -n1], axis=-1)
        second = np.stack([-n1 * n2 / (1.0 + n3), 1.0 - n2**2 / (1.0 + n3), -n2], axis=-1)
        on = least[row, best] >= -EDGE_TOLERANCE
        stretch = np.where(on, 1.0 / self._normals[triangle, 2], 0.0)
        axes = np.stack([first, second, normals], axis=1)
        return Frames(positions.reshape(*shape, 3), axes.reshape(*shape, 3, 3), stretch.reshape(shape))


def _round(corners: Floats) -> Index:
    """Return the order of four corners around their middle, seen from above."""
    about = corners[:, :2] - corners[:, :2].mean(axis=0)
    return np.argsort(np.arctan2(about[:, 1], about[:, 0]))


def fitted_chart(vertices: Floats, facets: Index, flat: float) -> Chart | None:
    """Return the chart of the facets: None for a rectangle in a plane (to a fraction ``flat`` of its width), the chart
    of a sphere for a cap around z, otherwise that of a surface seen from above.
    """
    points = vertices[np.unique(facets)]
    width = float(np.ptp(points, axis=0).max())
    if float(np.ptp(points[:, 2])) <= flat * width:
        chart = MeshChart(vertices=vertices, facets=facets)
        (x0, x1), (y0, y1) = chart.outline
        return None if abs(chart.area - (x1 - x0) * (y1 - y0)) < 1e-6 * chart.area else chart
    rows = np.column_stack([2.0 * points, np.ones(len(points))])
    solved = np.linalg.lstsq(rows, (points**2).sum(axis=1), rcond=None)[0]
    middle, radius = solved[:3], math.sqrt(max(solved[3] + float(solved[:3] @ solved[:3]), 0.0))
    away = np.linalg.norm(points - middle, axis=1)
    if radius < 1e3 * width and np.abs(away - radius).max() < ROUND * radius and middle[2] > points[:, 2].min():
        reach = float(np.arccos(np.clip((middle[2] - points[:, 2]) / radius, -1.0, 1.0)).max())
        corners = vertices[facets]
        flat_area = surface_area(corners)
        if (
            reach < 0.99 * math.pi
            and abs(2.0 * math.pi * radius**2 * (1.0 - math.cos(reach)) / flat_area - 1.0) < SAME_AREA
        ):
            top = (float(middle[0]), float(middle[1]), float(middle[2] - radius))
            return SphereChart(radius=radius, reach=reach, center=top)
    return MeshChart(vertices=vertices, facets=facets)


def depths(chart: Chart | None, points: Floats, contact: Floats) -> Floats:
    """Return how far points (n, axis) lie below the surface that is touched [m], whose vertices are ``contact``."""
    if chart is None:
        return points[:, 2]
    if isinstance(chart, SphereChart):
        middle = np.array(chart.center) + np.array([0.0, 0.0, chart.radius])
        return np.asarray(chart.radius - np.linalg.norm(points - middle, axis=1))
    if isinstance(chart, MeshChart):
        return chart.distances(points)
    return np.asarray(cKDTree(contact).query(points)[0])  # of a sheet, whose vertices lie one above another


def surface_area(corners: Floats) -> float:
    """Return the total area of facets (facet, corner, axis)."""
    total = 0.0
    for facet in corners:
        if len(facet) == 3:
            total += 0.5 * float(np.linalg.norm(np.cross(facet[1] - facet[0], facet[2] - facet[0])))
            continue
        # corners may be listed in any order: the largest of the three ways to cut it is the quadrilateral
        a, b, c, d = facet
        total += max(
            0.5 * float(np.linalg.norm(np.cross(p, q))) for p, q in ((c - a, d - b), (b - a, d - c), (d - a, b - c))
        )
    return total
