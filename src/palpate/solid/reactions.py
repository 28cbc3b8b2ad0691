"""Compute the stress on the fixed facets from the reactions there.

The reactions R_i are integrals of the stress t on the fixed facets times the shape functions N_i of their nodes; they
converge faster than the stress of elements (T. J. R. Hughes et al., J. Comput. Phys. 163, 467, 2000). The solution t
of M t = R, where M_ij is the integral of N_i N_j, alternates between corners and middles of elements. A reading
therefore uses the polynomial that fits t best on the facets around a point (O. C. Zienkiewicz, J. Z. Zhu, Int. J.
Numer. Methods Eng. 33, 1331, 1992), on a mesh of any shape.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from palpate.elastic.pad import Floats

__all__ = ["Reactions"]

Index = npt.NDArray[np.intp]

#: Powers (a, b) of x^a y^b: up to third degree, and the mixed ones of fourth degree. Adding x^4 and y^4 would keep the
#: alternating part, and without the mixed ones the fit is too wide: stress at the base compared with a layer, and in a
#: dome compared with finer elements (benchmarks/solid.py), would be off by 2 to 3 times as much.
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3), (2, 2), (3, 1), (1, 3))
#: Candidate numbers of fitted powers: the largest with at least 1.5 nodes for each power is used.
FITTED = (13, 10, 6, 3, 1)
#: A facet may contain a point if its plane passes within this fraction of the facet's size: on a sphere, for elements
#: that span an eighth of a circle.
CLOSE = 0.1
#: Number of facets that are tried.
TRIED = 12


class Reactions:
    """The fixed part of a mesh: ``nodes`` in order, on ``facets`` with the integration points and shape functions of a
    scikit-fem basis; the nodes of ``rim`` also lie on facets that are free.
    """

    def __init__(self, basis: Any, nodes: Index, rim: Index, count: int) -> None:
        place = np.full(count, -1, dtype=np.intp)
        place[nodes] = np.arange(len(nodes))
        local = place[np.asarray(basis.element_dofs)]  # (local, facet): -1 for nodes that are not fixed
        self.weights = np.asarray(basis.dx)  # (facet, point)
        values = np.stack([np.broadcast_to(np.asarray(f[0]), self.weights.shape) for f in basis.basis])
        on = (local >= 0).T
        size = int(on.sum(axis=1).max())
        if not (on.sum(axis=1) == size).all():
            raise ValueError("facets of a mesh have different numbers of nodes")
        facets = len(self.weights)
        #: Nodes of each facet (facet, node), and their shape functions (facet, node, point).
        self.nodes = local.T[on].reshape(facets, size)
        self.values = values.transpose(1, 0, 2)[on].reshape(facets, size, -1)
        self.points = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)  # (facet, point, axis)
        self.count = len(nodes)
        self._rim = np.isin(nodes, rim)
        area = self.weights.sum(axis=1)
        self.middles = np.einsum("fqa,fq->fa", self.points, self.weights) / area[:, None]
        self.sizes = np.sqrt(area)
        self.normals = np.einsum("afq,fq->fa", np.asarray(basis.normals), self.weights) / area[:, None]
        self.normals /= np.linalg.norm(self.normals, axis=1, keepdims=True)
        self._tree = cKDTree(self.middles)
        self._of_node: list[list[int]] = [[] for _ in range(self.count)]
        for facet, some in enumerate(self.nodes.tolist()):
            for node in some:
                self._of_node[node].append(facet)
        self._known: dict[int, tuple[Index, Floats, Floats]] = {}

    def _around(self, points: Floats) -> tuple[Index, Index, Floats]:
        """Return entries (point, facet, share): the facets whose fits are averaged at points (n, axis), so that a
        reading is a continuous function of position.
        """
        tried = min(TRIED, len(self.middles))
        near = self._tree.query(points, k=tried)[1].reshape(len(points), tried)
        way = points[:, None] - self.middles[near]
        close = np.abs(np.einsum("nka,nka->nk", way, self.normals[near])) < CLOSE * self.sizes[near]
        share = np.where(close, np.maximum(1.0 - np.linalg.norm(way, axis=2) / self.sizes[near], 0.0) ** 2, 0.0)
        none = ~(share.sum(axis=1) > 0.0)
        share[none, close[none].argmax(axis=1)] = 1.0
        point, rank = np.nonzero(share)
        return point, near[point, rank], (share / share.sum(axis=1, keepdims=True))[point, rank]

    def _patch(self, facet: int) -> tuple[Index, Floats, Floats]:
        """Return the nodes of the fit around a facet, the matrix that gives their weights from the polynomials at a
        point, and the axes (3, axis) of the polynomials in units of the facet's size.
        """
        if facet in self._known:
            return self._known[facet]
        around = sorted({f for node in self.nodes[facet].tolist() for f in self._of_node[node]})
        # leave out fixed facets on another side of the solid: their stress is unrelated
        around = [f for f in around if self.normals[f] @ self.normals[facet] > 0.5]
        inside = set(around)
        nodes = np.unique(self.nodes[around])
        nodes = np.array([i for i in nodes.tolist() if all(f in inside for f in self._of_node[i])], dtype=np.intp)
        if not self._rim[self.nodes[facet]].any():  # stress is infinite on the rim: leave it out where it is not near
            nodes = nodes[~self._rim[nodes]]
        normal = self.normals[facet]
        first = np.eye(3)[np.argmin(np.abs(normal))]
        first = first - (first @ normal) * normal
        first /= np.linalg.norm(first)
        axes = np.stack([first, np.cross(normal, first)]) / self.sizes[facet]
        rank = np.full(self.count, -1, dtype=np.intp)
        rank[nodes] = np.arange(len(nodes))
        kept = next((k for k in FITTED if 1.5 * k <= len(nodes)), 1)
        mass, moments = np.zeros((len(nodes),) * 2), np.zeros((len(nodes), kept))
        for f in around:
            mine = rank[self.nodes[f]]
            there = mine >= 0
            values, weights = self.values[f][there], self.weights[f]
            powers = _powers((self.points[f] - self.middles[facet]) @ axes.T, kept)
            mass[np.ix_(mine[there], mine[there])] += (values * weights) @ values.T
            moments[mine[there]] += (values * weights) @ powers
        # the smallest weights for which the weighted reactions of every polynomial equal its value at the point
        spread = np.linalg.solve(mass, moments)
        made = spread @ np.linalg.inv(moments.T @ spread)
        self._known[facet] = nodes, made, axes
        return self._known[facet]

    def at(self, points: Floats) -> tuple[Index, Index, Floats]:
        """Return entries (point, node, weight): sums of weighted reactions give the stress at points (n, axis)."""
        rows, columns, entries = [], [], []
        point, facets, share = self._around(points)
        for facet in np.unique(facets).tolist():
            here = facets == facet
            mine = point[here]
            nodes, made, axes = self._patch(facet)
            weights = _powers((points[mine] - self.middles[facet]) @ axes.T, made.shape[1]) @ made.T
            rows.append(np.repeat(mine, len(nodes)))
            columns.append(np.tile(nodes, len(mine)))
            entries.append((weights * share[here, None]).ravel())
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(entries)


def _powers(places: Floats, count: int) -> Floats:
    """Return the powers (n, power) at positions (n, 2)."""
    x, y = places.T
    return np.stack([x**a * y**b for a, b in POWERS[:count]], axis=-1)
