"""Linear elasticity of a solid by quadratic finite elements that do not lock at Poisson's ratios near a half.

Displacement is quadratic (27 nodes in a hexahedron, 10 in a tetrahedron). On each element the change of volume is
projected: on functions linear in (x, y, z) in a hexahedron, on a constant in a tetrahedron. This is the mixed element
Q2/P1 (P2/P0) whose pressure is eliminated element by element (T. J. R. Hughes, The Finite Element Method, 1987,
sections 4.4 and 4.5; D. Boffi, F. Brezzi, M. Fortin, Mixed Finite Element Methods and Applications, 2013, section
8.6): both are stable, the matrix is positive definite, and no unknowns are added.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._extras import missing
from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.solid.places import Places, monomials, polynomials
from palpate.solid.reactions import Reactions

try:
    import scipy.sparse
    from scipy.sparse.linalg import splu
    from skfem import Basis, ElementHex2, ElementTetP2, FacetBasis
except ImportError as error:
    raise missing("solid pads", error) from error

__all__ = ["Factor", "LocalFields", "Solid"]

Index = npt.NDArray[np.intp]

#: Number of entries of element matrices that are computed at a time (200 MB).
AT_A_TIME = 25_000_000
#: Number of right-hand sides that are solved at a time.
BLOCK = 128
#: A point lies on a fixed facet if the weights of free nodes there sum to less: flat facets miss a curved base by 0.02 of
#: an element, where weights are up to four times that.
ON_FACET = 0.1


class Solid:
    """Stiffness of a mesh (scikit-fem's hexahedra or tetrahedra) of one isotropic material that is fixed at the nodes
    of some facets.

    Unknown ``3 * node + i`` is u_i of a node.
    """

    def __init__(self, mesh: Any, youngs_modulus: float, poissons_ratio: float, held: Index) -> None:
        self.mesh, self.modulus, self.ratio = mesh, youngs_modulus, poissons_ratio
        self.hexahedra = type(mesh).__name__.startswith("MeshHex")
        self.element = ElementHex2() if self.hexahedra else ElementTetP2()
        self.basis = Basis(mesh, self.element, intorder=4)
        self.shear = youngs_modulus / (2.0 * (1.0 + poissons_ratio))
        self.bulk = youngs_modulus / (3.0 * (1.0 - 2.0 * poissons_ratio))
        self.held_facets = np.asarray(held)
        self.held = np.unique(self.basis.get_dofs(held).flatten())
        every = 3 * self.held[:, None] + np.arange(3)
        self.free = np.setdiff1d(np.arange(3 * self.basis.N), every.ravel())

    @property
    def dofs(self) -> Index:
        """Nodes of each element (local, element)."""
        return np.asarray(self.basis.element_dofs)

    @cached_property
    def _gradients(self) -> tuple[Floats, Floats]:
        """Gradients of the shape functions (local, axis, element, point), and weights (element, point)."""
        found = np.stack([np.broadcast_to(f[0].grad, (3, *self.basis.dx.shape)) for f in self.basis.basis])
        return found, np.asarray(self.basis.dx)

    @cached_property
    def _projection(self) -> tuple[Floats, Floats, Floats]:
        """Middle (axis, element) and size (element) of each element, and the matrix (element, function, local, axis)
        that projects the change of volume.
        """
        gradients, weights = self._gradients
        places = np.asarray(self.basis.global_coordinates())  # (axis, element, point)
        volume = weights.sum(axis=1)
        middle = (places * weights).sum(axis=2) / volume
        size = np.cbrt(volume)
        functions = self._pressures((places - middle[..., None]) / size[:, None])
        mass = np.einsum("meq,neq,eq->emn", functions, functions, weights)
        loads = np.einsum("meq,iaeq,eq->emia", functions, gradients, weights)
        n = loads.shape
        return middle, size, np.linalg.solve(mass, loads.reshape(*n[:2], -1)).reshape(n)

    def _pressures(self, local: Floats) -> Floats:
        """Return the pressure functions (function, *points) at positions (axis, *points) relative to an element's
        middle, in units of its size.
        """
        one = np.ones((1, *local.shape[1:]))
        return np.concatenate([one, local]) if self.hexahedra else one

    @cached_property
    def stiffness(self) -> Any:
        """The full sparse matrix K, for the energy u'Ku / 2."""
        gradients, weights = self._gradients
        places = np.asarray(self.basis.global_coordinates())
        middle, size, project = self._projection
        nodes, elements = self.dofs.shape
        index = (3 * self.dofs.T[:, :, None] + np.arange(3)).reshape(elements, -1)
        eye, n = np.eye(3), 3 * nodes
        total: Any = scipy.sparse.csr_array((3 * self.basis.N,) * 2)
        step = max(1, AT_A_TIME // n**2)
        for start in range(0, elements, step):
            here = slice(start, start + step)
            g, w = gradients[:, :, here], weights[here]
            each = np.einsum("iaeq,jbeq,eq->eiajb", g, g, w, optimize=True)
            trace = np.einsum("eiaja->eij", each)
            k = self.shear * (
                trace[:, :, None, :, None] * eye[:, None, :] + each.transpose(0, 1, 4, 3, 2) - (2.0 / 3.0) * each
            )
            p = project[here]
            functions = self._pressures((places[:, here] - middle[:, here, None]) / size[here, None])
            mass = np.einsum("meq,neq,eq->emn", functions, functions, w)
            k = k + self.bulk * np.einsum("emia,emn,enjb->eiajb", p, mass, p, optimize=True)
            rows = np.repeat(index[here], n, axis=1)
            columns = np.tile(index[here], (1, n))
            total = total + scipy.sparse.coo_array((k.ravel(), (rows.ravel(), columns.ravel())), total.shape).tocsr()
        return total

    @cached_property
    def factor(self) -> Factor:
        """The factorised matrix of the unknowns that are free."""
        return Factor(self.stiffness[self.free][:, self.free])

    def solve(self, loads: Floats, moved: Floats | None = None) -> Floats:
        """Return the displacement (unknown, k) [m] for loads (unknown, k) [N] and the prescribed displacement
        ``moved`` (unknown, k) [m] of fixed nodes, by default zero.
        """
        out = np.zeros(loads.shape) if moved is None else moved.copy()
        if moved is not None:
            loads = loads - self.stiffness @ moved
        out[self.free] = self.factor.solve(loads[self.free])
        return out

    @cached_property
    def reactions(self) -> Reactions:
        """Computes the stress on the fixed facets from the reactions."""
        basis = FacetBasis(self.mesh, self.element, facets=self.held_facets, intorder=6)
        free = np.setdiff1d(self.mesh.boundary_facets(), self.held_facets)
        rim = np.unique(self.basis.get_dofs(free).flatten())
        return Reactions(basis, self.held, rim, self.basis.N)

    def is_held(self, points: Floats) -> npt.NDArray[np.bool_]:
        """Return whether points (axis, n) lie on fixed facets: only nodes that are fixed then move them."""
        nodes, fields = self.at(points)
        fixed = np.zeros(self.basis.N, dtype=bool)
        fixed[self.held] = True
        loose = np.abs(fields.displacement("x")[..., 0]) * ~fixed[nodes.T]
        return np.asarray(loose.sum(axis=1) < ON_FACET)

    def at_held(self, points: Floats, along: Floats) -> Floats:
        """Return prescribed displacements of the fixed nodes (node of `held`, axis, sum) that give sums of the stress
        on fixed facets: over points (axis, sum, n), along ``along`` (axis, sum, n).

        A sum of the reactions R times g equals the work of the loads if the fixed nodes move by -g.
        """
        sums, each = points.shape[1:]
        point, node, weight = self.reactions.at(points.reshape(3, -1).T)
        flat, size = node * sums + point // each, len(self.held) * sums
        right = [np.bincount(flat, weight * a[point], size) for a in along.reshape(3, -1)]
        return np.asarray(np.stack(right, dtype=np.float64).reshape(3, len(self.held), sums).transpose(1, 0, 2))

    @cached_property
    def places(self) -> Places:
        """Finds points in the mesh."""
        return Places(self.mesh, self.hexahedra)

    def at(self, points: Floats, axes: Floats | None = None) -> tuple[Index, LocalFields]:
        """Return the nodes (local, point) of the elements that contain ``points`` (axis, point), and the effect of
        their unknowns on the fields there.

        Fields are along ``axes`` (point, component, axis), by default those of the mesh. A point slightly outside the
        mesh is assigned to the nearest element.
        """
        cells, local, _ = self.places.find(points)
        functions = polynomials(self.element, len(self.dofs))
        powers, slopes = monomials(local)
        where, jacobian = self.places.mapped(local, cells)
        values = (powers @ functions).T  # (local, point)
        inverse = np.linalg.inv(jacobian)  # (point, local axis, axis)
        gradients = np.einsum("nmb,ml,nba->lan", slopes, functions, inverse, optimize=True)
        middle, size, project = self._projection
        pressures = self._pressures((where - middle[:, cells]) / size[cells])
        volume = np.einsum("mp,pmia->pia", pressures, project[cells])
        turn = np.broadcast_to(np.eye(3), (len(cells), 3, 3)) if axes is None else axes
        return self.dofs[:, cells], LocalFields(values, gradients, volume, self.shear, self.bulk, turn)

    def surface_load(self, facets: Index, pressure: float) -> Floats:
        """Return the loads (unknown,) [N] due to a uniform pressure on facets, along their normals into the solid."""
        basis = FacetBasis(self.mesh, self.element, facets=facets, intorder=6)
        out = np.zeros(3 * self.basis.N)
        for nodes, (function, *_) in zip(np.asarray(basis.element_dofs), basis.basis):
            part = np.einsum(
                "eq,aeq,eq->ea",
                np.broadcast_to(np.asarray(function), basis.dx.shape),
                np.asarray(basis.normals),
                basis.dx,
            )
            np.add.at(out, 3 * nodes[:, None] + np.arange(3), -pressure * part)
        return out


class LocalFields:
    """Displacement, strain and stress at points in a solid, as `palpate.elastic.channels.Fields`.

    Each method returns an array (point, local, axis): the field at a point, per unit of displacement of the function
    ``local`` of the element there along ``axis`` of the mesh. Field components such as "xz" are along the ``axes``
    (point, component, axis) that belong to the point.
    """

    def __init__(
        self, values: Floats, gradients: Floats, volume: Floats, shear: float, bulk: float, axes: Floats
    ) -> None:
        self._values, self._volume, self._axes = values.T, volume, axes
        self._gradients = np.einsum("lap,pja->pjl", gradients, axes, optimize=True)  # along each component
        self._shear, self._bulk = shear, bulk

    def displacement(self, i: str) -> Floats:
        """Return u_i."""
        return self._values[..., None] * self._axes[:, None, "xyz".index(i)]

    def gradient(self, i: str, j: str) -> Floats:
        """Return du_i/dx_j."""
        return self._gradients[:, "xyz".index(j), :, None] * self._axes[:, None, "xyz".index(i)]

    def strain(self, ij: str) -> Floats:
        """Return the strain, compression positive."""
        return -0.5 * (self.gradient(ij[0], ij[1]) + self.gradient(ij[1], ij[0]))

    def stress(self, ij: str) -> Floats:
        """Return the stress, compression positive."""
        shape = 2.0 * self._shear * self.strain(ij)
        if ij[0] != ij[1]:
            return shape
        trace = self.strain("xx") + self.strain("yy") + self.strain("zz")
        return shape - (2.0 / 3.0) * self._shear * trace - self._bulk * self._volume


class Factor:
    """A factorised positive definite matrix, by MKL's PARDISO if pypardiso is installed, otherwise by SuperLU."""

    def __init__(self, matrix: Any) -> None:
        try:
            from pypardiso import PyPardisoSolver
        except ImportError:
            order = {"SymmetricMode": True}
            self._lu: Any = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=order)
            self._solver: Any = None
            return
        self._upper = scipy.sparse.csr_array(scipy.sparse.triu(matrix))
        self._solver = PyPardisoSolver(mtype=2)
        self._solver.factorize(self._upper)

    def solve(self, loads: Floats) -> Floats:
        """Solve for right-hand sides (unknown, k)."""
        out = np.empty(loads.shape)
        for start in range(0, loads.shape[1], BLOCK):
            part = np.ascontiguousarray(loads[:, start : start + BLOCK])
            found = self._lu.solve(part) if self._solver is None else self._solver.solve(self._upper, part)
            out[:, start : start + BLOCK] = found.reshape(part.shape)
        return out
