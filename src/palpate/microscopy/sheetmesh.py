"""Triangulate a sheet of cells: the outline of a mask, points inside it, and quadratic elements with the matrices that
the tension needs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.ndimage
import scipy.sparse
import scipy.spatial

from palpate._extras import require
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["Elements", "Shape", "elements_of", "triangles"]

Flags = npt.NDArray[np.bool_]
#: Sparse matrices: scipy's stubs do not distinguish their types.
Sparse: TypeAlias = Any

#: Standard deviation, in squares of the mask, of the Gaussian that smooths its outline.
EVEN = 0.8
#: Inner points keep at least FREE times the spacing from the outline. At the outline, triangles flatter than FLAT (1:
#: equilateral) are left out.
FREE, FLAT = 0.6, 0.05
#: Number of rounds that move each inner point to the mean of its neighbours.
RELAXED = 4
#: Degree of polynomials that are integrated exactly: the stiffness of straight quadratic triangles needs 2, loads need
#: 4.
DEGREE = 4


@dataclass(frozen=True, eq=False)
class Shape:
    """A region: ``mask`` (row, column) on squares of side ``side`` [m], the first centred on ``start`` (x, y) [m]."""

    mask: Flags
    start: tuple[float, float]
    side: float

    def __post_init__(self) -> None:
        even = scipy.ndimage.gaussian_filter(np.pad(self.mask, 3).astype(np.float64), EVEN)
        object.__setattr__(self, "_even", even)

    def outlines(self) -> list[Floats]:
        """Return closed lines (n, 2) [m] round the mask and its holes."""
        require("sheets of cells", "contourpy")
        from contourpy import contour_generator

        even: Any = self._even  # type: ignore[attr-defined]
        lines = contour_generator(z=even).lines(0.5)
        return [np.asarray(line) * self.side + np.array(self.start) - 3 * self.side for line in lines if len(line) > 3]

    def within(self, points: Floats) -> Flags:
        """Return which of the points (n, 2) [m] lie inside."""
        even: Any = self._even  # type: ignore[attr-defined]
        at = (points - np.array(self.start)) / self.side + 3
        return np.asarray(scipy.ndimage.map_coordinates(even, at[:, ::-1].T, order=1, mode="constant") > 0.5)


def _resampled(line: Floats, spacing: float) -> Floats:
    """Return points along a closed line, about ``spacing`` apart."""
    closed = line if np.array_equal(line[0], line[-1]) else np.vstack([line, line[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    count = max(6, round(along[-1] / spacing))
    at = along[-1] * np.arange(count) / count
    return np.stack([np.interp(at, along, c) for c in closed.T], axis=1)


def triangles(shape: Shape, spacing: float) -> tuple[Floats, npt.NDArray[np.int64]]:
    """Points (n, 2) [m] and triangles (m, 3): the Delaunay triangulation of its outline and an inner lattice."""
    lines = shape.outlines()
    if not lines:
        raise InvalidInput("the sheet has no outline: its mask is empty.")
    border = np.concatenate([_resampled(line, spacing) for line in lines])
    low, high = border.min(axis=0), border.max(axis=0)
    rows = np.arange(low[1], high[1], spacing * math.sqrt(0.75))
    columns = np.arange(low[0], high[0] + spacing, spacing)
    lattice = np.stack(np.meshgrid(columns, rows), axis=-1)
    lattice[1::2, :, 0] += 0.5 * spacing
    inner = lattice.reshape(-1, 2)
    dense = np.concatenate([_resampled(line, 0.2 * spacing) for line in lines])
    tree = scipy.spatial.cKDTree(dense)

    def free(points: Floats) -> Flags:
        return shape.within(points) & (tree.query(points)[0] > FREE * spacing)

    inner = inner[free(inner)]
    for round_ in range(RELAXED + 1):
        points = np.concatenate([border, inner])
        found = scipy.spatial.Delaunay(points).simplices
        corners = points[found]
        keep = shape.within(corners.mean(axis=1))
        edges = corners - np.roll(corners, 1, axis=1)
        area = 0.5 * np.abs(edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0])
        keep &= area * 4 / math.sqrt(3) > FLAT * (edges**2).sum(axis=(1, 2)) / 3
        found = found[keep]
        if round_ == RELAXED:
            break
        pairs = np.concatenate([found[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2))])
        total = np.stack([np.bincount(pairs[:, 0], points[pairs[:, 1], c], len(points)) for c in (0, 1)], axis=1)
        count = np.bincount(pairs[:, 0], minlength=len(points))
        moved = (total / np.maximum(count, 1)[:, None])[len(border) :]
        inner = np.where(free(moved)[:, None], moved, inner)
    used, renumbered = np.unique(found, return_inverse=True)
    return points[used], renumbered.reshape(found.shape)


@dataclass(frozen=True, eq=False)
class Elements:
    """Quadratic triangles as sparse matrices that map degrees of freedom to the integration points.

    Attributes
    ----------
    points : array (q, 2)
        Points of integration [m], ``area`` (q,) of each [m^2].
    strain : three matrices (q, dof)
        xx, yy and twice xy from the sheet's displacement.
    value : two matrices (q, dof)
        The displacement along x and y.
    straight : matrix (q, node)
        Of a linear interpolation between corners, in which tension is given back; ``corners`` (node, 2) [m].
    rigid : array (3, dof)
        Shifts and a rotation about the middle.
    pinned : array (3,) of int
        Three of the displacement's unknowns that keep it from moving as a whole.
    """

    mesh: Any
    basis: Any
    points: Floats
    area: Floats
    strain: tuple[Sparse, Sparse, Sparse]
    value: tuple[Sparse, Sparse]
    straight: Sparse
    corners: Floats
    rigid: Floats
    pinned: npt.NDArray[np.intp]

    def border(self, on: Any) -> tuple[Floats, tuple[Sparse, Sparse], Floats, Floats]:
        """Return, for the boundary edges for which ``on(x)`` holds (x: (2, edge), their midpoints): integration points
        (q, 2), matrices of the displacement there, lengths, and outward normals (q, 2).
        """
        from skfem import FacetBasis

        facets = self.mesh.boundary_facets()
        middles = self.mesh.p[:, self.mesh.facets[:, facets]].mean(axis=1)
        picked = facets[on(middles)]
        if not len(picked):
            nothing = scipy.sparse.csr_array((0, self.basis.N))
            return np.zeros((0, 2)), (nothing, nothing), np.zeros(0), np.zeros((0, 2))
        basis = FacetBasis(self.mesh, self.basis.elem, facets=picked, intorder=DEGREE)
        where = np.asarray(basis.global_coordinates()).reshape(2, -1).T
        normals = np.asarray(basis.normals).reshape(2, -1).T
        return where, _values(basis), np.asarray(basis.dx).ravel(), normals


def _matrix(basis: Any, of: Any) -> Sparse:
    """Return the matrix (q, dof) of one quantity of each shape function."""
    count, shape = basis.N, basis.dx.shape
    number = np.arange(basis.dx.size).reshape(shape)
    rows, columns, data = [], [], []
    for i in range(basis.Nbfun):
        values = np.broadcast_to(of(basis.basis[i][0]), shape)
        rows.append(number.ravel())
        columns.append(np.broadcast_to(basis.element_dofs[i][:, None], shape).ravel())
        data.append(values.ravel())
    return scipy.sparse.csr_array(
        (np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(basis.dx.size, count)
    )


def _values(basis: Any) -> tuple[Sparse, Sparse]:
    return _matrix(basis, lambda f: np.asarray(f)[0]), _matrix(basis, lambda f: np.asarray(f)[1])


def elements_of(points: Floats, corners: npt.NDArray[np.int64]) -> Elements:
    """Build quadratic elements on triangles (m, 3) of points (n, 2) [m]."""
    require("sheets of cells", "skfem")
    from skfem import Basis, ElementTriP1, ElementTriP2, ElementVector, MeshTri

    # lengths in units of the sheet's size, to avoid tiny numbers
    mesh = MeshTri(np.ascontiguousarray(points.T), np.ascontiguousarray(corners.T))
    basis = Basis(mesh, ElementVector(ElementTriP2()), intorder=DEGREE)
    plain = Basis(mesh, ElementTriP1(), intorder=DEGREE)
    strain = (
        _matrix(basis, lambda f: f.grad[0, 0]),
        _matrix(basis, lambda f: f.grad[1, 1]),
        _matrix(basis, lambda f: f.grad[0, 1] + f.grad[1, 0]),
    )
    where = np.asarray(basis.global_coordinates()).reshape(2, -1).T
    at = np.asarray(basis.doflocs)
    along = np.zeros(basis.N, dtype=int)
    for name, axis in (("u^1", 0), ("u^2", 1)):
        along[basis.get_dofs(elements=True).all([name])] = axis
    middle = points.mean(axis=0)
    x, y = at[0] - middle[0], at[1] - middle[1]
    rigid = np.stack([(along == 0) * 1.0, (along == 1) * 1.0, np.where(along == 0, -y, x)])
    first = int(np.argmin(x))
    far = np.hypot(at[0] - at[0, first], at[1] - at[1, first])
    other = int(np.argmax(far))
    same = np.flatnonzero((at == at[:, [first]]).all(axis=0))
    away = np.flatnonzero((at == at[:, [other]]).all(axis=0))
    axis = 1 if abs(at[0, other] - at[0, first]) >= abs(at[1, other] - at[1, first]) else 0
    pinned = np.array([*same, *(d for d in away if along[d] == axis)])
    return Elements(
        mesh, basis, where, np.asarray(basis.dx).ravel(), strain, _values(basis), _matrix(plain, np.asarray), points, rigid, pinned,
    )  # fmt: skip
