"""Find points in a mesh: the element that contains each, and its local coordinates there.

scikit-fem's own finders assume flat facets, and refuse a point slightly outside the mesh. On a curved solid points of
the surface can be outside; here they are assigned to the nearest element.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from palpate._threads import cached_property
from palpate.elastic.pad import Floats

__all__ = ["Places", "monomials", "polynomials"]

Index = npt.NDArray[np.intp]

#: Number of elements tried for a point, nearest middles first: all around a vertex, where some are four times as long
#: as wide.
TRIED = 24
#: Number of elements tried if none of these contains the point.
MORE_CANDIDATES = 200
#: Newton steps to find the local coordinates; they converge quadratically, because an element is nearly a
#: parallelepiped.
STEPS = 12
#: A point outside an element by less than this fraction of it counts as inside.
INSIDE_TOLERANCE = 1e-6
#: If a point is further outside than this, more elements are tried: quadratic elements that span a quarter of a sphere
#: in two have errors of 3e-3.
RETRY_DISTANCE = 0.02
#: Number of points that are located at a time.
BLOCK = 20_000


class Places:
    """Finds points in a mesh of scikit-fem."""

    def __init__(self, mesh: Any, hexahedra: bool) -> None:
        self.mesh, self.hexahedra = mesh, hexahedra
        nodes = np.asarray(mesh.doflocs)[:, np.asarray(mesh.dofs.element_dofs)]  # (axis, local, element)
        self._polynomials = np.einsum("ml,ale->eam", polynomials(mesh.elem(), nodes.shape[1]), nodes)

    @cached_property
    def _tree(self) -> Any:
        corners = np.asarray(self.mesh.doflocs)[:, np.asarray(self.mesh.t)]
        return cKDTree(corners.mean(axis=1).T)

    def find(self, points: Floats) -> tuple[Index, Floats, Floats]:
        """Return for points (axis, n): their elements, the local coordinates there (axis, n), and how far outside its
        element each lies, as a fraction of the element (n,).
        """
        cells = np.empty(points.shape[1], dtype=np.intp)
        local, outside = np.empty(points.shape), np.empty(points.shape[1])
        for start in range(0, points.shape[1], BLOCK):
            here = slice(start, start + BLOCK)
            cells[here], local[:, here], outside[here] = self._nearest(points[:, here], TRIED)
        lost = np.flatnonzero(outside > RETRY_DISTANCE)
        count = len(np.asarray(self.mesh.t).T)
        if len(lost) and count > TRIED:
            step = max(1, BLOCK * TRIED // MORE_CANDIDATES)
            for start in range(0, len(lost), step):
                some = lost[start : start + step]
                cells[some], local[:, some], outside[some] = self._nearest(points[:, some], MORE_CANDIDATES)
        return cells, self._clamped(local), outside

    def _nearest(self, points: Floats, tried: int) -> tuple[Index, Floats, Floats]:
        tried = min(tried, np.asarray(self.mesh.t).shape[1])
        near = self._tree.query(points.T, k=tried)[1].reshape(points.shape[1], tried)
        best = np.full(points.shape[1], np.inf)
        cells, local = near[:, 0].copy(), np.zeros(points.shape)
        for rank in range(tried):
            todo = np.flatnonzero(best > INSIDE_TOLERANCE)
            if not len(todo):
                break
            place = self._inverted(points[:, todo], near[todo, rank])
            off = self._outside(place)
            better = off < best[todo]
            chosen = todo[better]
            best[chosen], cells[chosen], local[:, chosen] = off[better], near[chosen, rank], place[:, better]
        return cells, local, best

    def _inverted(self, points: Floats, cells: Index) -> Floats:
        """Return local coordinates (axis, n) in elements by Newton's method; infinite if it does not converge."""
        out = np.full(points.shape, 0.5 if self.hexahedra else 0.25)
        todo = np.arange(points.shape[1])
        for _ in range(STEPS):
            place, slope = self.mapped(out[:, todo], cells[todo])
            step = np.linalg.solve(slope, (points[:, todo] - place).T[..., None])[..., 0].T
            out[:, todo] = np.clip(out[:, todo] + step, -1.0, 2.0)  # points further outside belong to no element
            todo = todo[np.abs(step).max(axis=0) > 1e-12]
            if not len(todo):
                break
        out[:, todo] = np.inf
        return out

    def mapped(self, local: Floats, cells: Index) -> tuple[Floats, Floats]:
        """Return the points (axis, n) of local coordinates (axis, n) in elements, and the Jacobians (n, axis, local
        axis).
        """
        values, gradients = monomials(local)
        here = self._polynomials[cells]
        return np.einsum("nam,nm->an", here, values), here @ gradients

    def _outside(self, local: Floats) -> Floats:
        """Return how far outside the reference element each point lies (n,)."""
        off = np.maximum(0.0, -local.min(axis=0))
        if self.hexahedra:
            return np.asarray(np.maximum(off, local.max(axis=0) - 1.0))
        return np.asarray(np.maximum(off, local.sum(axis=0) - 1.0))

    def _clamped(self, local: Floats) -> Floats:
        """Return approximately the nearest point in the reference element."""
        if self.hexahedra:
            return np.clip(local, 0.0, 1.0)
        all_four = np.clip(np.concatenate([local, 1.0 - local.sum(axis=0, keepdims=True)]), 0.0, None)
        return np.asarray(all_four[:3] / all_four.sum(axis=0))


def monomials(local: Floats) -> tuple[Floats, Floats]:
    """Return x^a y^b z^c with a, b, c = 0, 1, 2 at points (axis, n): values (n, 27), and gradients (n, 27, axis)."""
    one, zero = np.ones_like(local), np.zeros_like(local)
    powers = np.stack([one, local, local**2], axis=-1)  # (axis, n, power)
    slopes = np.stack([zero, one, 2.0 * local], axis=-1)

    def product(x: Floats, y: Floats, z: Floats) -> Floats:
        return (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).reshape(len(x), 27)

    gradients = [product(*(slopes[i] if i == axis else powers[i] for i in range(3))) for axis in range(3)]
    return product(*powers), np.stack(gradients, axis=-1)


def polynomials(element: Any, count: int) -> Floats:
    """Return the ``count`` shape functions of an element of scikit-fem in terms of `monomials` (monomial, function).
    This covers all of its Lagrange elements up to second degree.
    """
    sites = np.random.default_rng(0).uniform(0.0, 1.0, (3, 64))
    values = np.stack([np.broadcast_to(element.lbasis(sites, i)[0], 64) for i in range(count)], axis=1)
    return np.asarray(np.linalg.lstsq(monomials(sites)[0], values, rcond=None)[0])
