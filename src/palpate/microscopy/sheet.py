"""Tension in a sheet of cells, from the traction below it (monolayer stress microscopy).

With N the tension (force per length, stress times thickness) and T the traction of the cells on the gel, each piece of the sheet is in balance:

    div N = T   in the sheet,      N n = 0   where it ends freely.

That is two equations for three unknowns. As is usual, the third comes from a plane elastic sheet, even and isotropic, in plane stress (D. T. Tambe et al., Nat. Mater. 10, 2011, 469-475;
PLoS ONE 8, 2013, e55172): N = C : strain of an unobserved displacement, where only Poisson's ratio matters. Cells are no such sheet: each contracts,
and balanced contractions leave no traction. The samples therefore include random tensions of the cells with an unknown length scale, besides
Poisson's ratio, the traction's own samples and the forces at the edges of the view.

The mean of the average tension needs none of this: with free edges it is -(1/2A) int T . x dA.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.ndimage
import scipy.sparse
import scipy.sparse.linalg

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.microscopy.sheetmesh import Elements, Shape, elements_of, triangles

__all__ = ["Loads", "Sheet", "sheet_of"]

#: Forces at the edge of the view are correlated over ALONG times the size of the sheet, and one tension all round is
#: added; they are solved for at PLACES points.
ALONG, PLACES = 0.25, 120
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Sheet:
    """A sheet of finite elements that is prepared for loads, once for each Poisson's ratio.

    Attributes
    ----------
    elements : Elements
    edge : tuple
        Where it continues outside the view: points of integration, displacement there, lengths, and normals.
    """

    elements: Elements
    edge: tuple[Floats, Any, Floats, Floats]

    def __post_init__(self) -> None:
        object.__setattr__(self, "_solvers", {})
        e = self.elements
        mass = (e.straight.T @ scipy.sparse.diags_array(e.area) @ e.straight).tocsc()
        object.__setattr__(self, "_mass", scipy.sparse.linalg.splu(mass))

    @property
    def surface(self) -> float:
        """Area of the sheet [m^2]."""
        return float(self.elements.area.sum())

    def body(self, traction: Floats) -> Floats:
        """Loads (dof,) due to a traction on the gel (2, q) [Pa]; the gel acts on the sheet with the opposite sign."""
        e = self.elements
        return np.asarray(-sum(v.T @ (e.area * t) for v, t in zip(e.value, traction)))

    def own(self, tension: Floats) -> Floats:
        """Return the loads due to a tension (3, q) [N/m] that cells generate themselves."""
        e = self.elements
        return np.asarray(-sum(s.T @ (e.area * n) for s, n in zip((e.strain[0], e.strain[1], e.strain[2]), tension)))

    def pulled(self, line: Floats) -> Floats:
        """Return the loads due to forces per length (2, q) [N/m] at the edge of the view."""
        _, value, lengths, _ = self.edge
        return np.asarray(sum(v.T @ (lengths * g) for v, g in zip(value, line)))

    def resultant(self, loads: Floats) -> Floats:
        """Return the forces along x and y [N] and the torque about the middle [N m] of loads."""
        return np.asarray(self.elements.rigid @ loads)

    def balance(self, traction: Floats) -> tuple[Floats, Floats]:
        """Subtract a uniform traction and a uniform rotation from a traction (2, q), so that force and torque vanish.
        Return the result and what was subtracted (2, q).
        """
        e = self.elements
        x, y = (e.points - e.corners.mean(axis=0)).T
        one, none = np.ones_like(x), np.zeros_like(x)
        patterns = np.stack([[one, none], [none, one], [-y, x]])
        loads = np.stack([self.resultant(self.body(p)) for p in patterns], axis=1)
        size = np.linalg.solve(loads, self.resultant(self.body(traction)))
        extra = np.tensordot(size, patterns, 1)
        return traction - extra, extra

    def tension(self, loads: Floats, ratio: float, own: Floats | None = None) -> Floats:
        """Return the tension (3: xx, yy, xy; node) [N/m] at the corners under balanced loads; ``own`` (3, q) adds the
        tension that cells generate themselves.
        """
        e = self.elements
        solvers: dict[float, Any] = self._solvers  # type: ignore[attr-defined]
        stiff = _stiffness(ratio)
        if ratio not in solvers:
            weight = scipy.sparse.diags_array(e.area)
            s = e.strain
            k: Any = sum(stiff[i, j] * (s[i].T @ weight @ s[j]) for i in range(3) for j in range(3) if stiff[i, j])
            free = np.setdiff1d(np.arange(k.shape[0]), e.pinned)
            solvers[ratio] = scipy.sparse.linalg.splu(k.tocsc()[free][:, free]), free
        solver, free = solvers[ratio]
        w = np.zeros(len(loads))
        w[free] = solver.solve(loads[free])
        strain = np.stack([s @ w for s in e.strain])
        found = stiff @ strain
        if own is not None:
            found = found + own
        mass: Any = self._mass  # type: ignore[attr-defined]
        return np.stack([mass.solve(np.asarray(e.straight.T @ (e.area * n))) for n in found])


def _stiffness(ratio: float) -> Floats:
    """Plane-stress stiffness for modulus times thickness 1; given forces alone, the value does not matter."""
    return np.array([[1.0, ratio, 0.0], [ratio, 1.0, 0.0], [0.0, 0.0, 0.5 * (1.0 - ratio)]]) / (1.0 - ratio**2)


def sheet_of(shape: Shape, spacing: float, view: tuple[float, float, float, float] | None = None) -> Sheet:
    """Build a sheet on a shape, with triangles of about ``spacing`` [m]. At the sides of ``view`` (left, right, top,
    bottom) [m] the sheet continues outside.
    """
    points, corners = triangles(shape, spacing)
    if len(corners) < 8:
        raise InvalidInput(
            f"the sheet holds {len(corners)} triangles: it is too small for its vectors. Give a larger mask, or vectors that lie closer."
        )
    e = elements_of(points, corners)

    def on(x: Floats) -> Flags:
        if view is None:
            return np.zeros(x.shape[1], dtype=bool)
        left, right, top, bottom = view
        near = 0.6 * shape.side
        return np.asarray((x[0] < left + near) | (x[0] > right - near) | (x[1] < top + near) | (x[1] > bottom - near))

    return Sheet(e, e.border(on))


@dataclass(eq=False)
class Loads:
    """Samples of what a sheet carries besides traction: forces at the edge of the view, and tensions of the cells' own, both about as large as ``scale`` [N/m]."""

    sheet: Sheet
    scale: float
    rng: np.random.Generator

    def __post_init__(self) -> None:
        where, _, _, normals = self.sheet.edge
        self.extent = float(np.ptp(self.sheet.elements.corners, axis=0).max())
        if len(where):
            # nodes of a coarse line load along the edge
            step = max(1, len(where) // PLACES)
            self.nodes = where[::step]
            apart = np.linalg.norm(self.nodes[:, None] - self.nodes[None], axis=2)
            near = np.linalg.norm(where[:, None] - self.nodes[None], axis=2).argmin(axis=1)
            n = normals[::step]
            length = ALONG * self.extent
            like = np.exp(-0.5 * (apart / length) ** 2)
            # one tension all round, and one that changes along the edge, each way
            x, y = n[:, :1], n[:, 1:]
            pulls = np.block([[like + x * x.T, x * y.T], [y * x.T, like + y * y.T]])
            self.covariance = self.scale**2 * (pulls + 1e-9 * np.eye(len(pulls)))
            self.factor = np.linalg.cholesky(self.covariance)
            self.spread = near
            unit = np.eye(len(pulls))
            self.moves = np.stack([self.sheet.resultant(self._load(u)) for u in unit], axis=1)

    def _load(self, values: Floats) -> Floats:
        line = values.reshape(2, -1)[:, self.spread]
        return self.sheet.pulled(line)

    def edge(self, missing: Floats, *, mean: bool) -> Floats:
        """Loads (dof,) at the edge of the view that carry forces and torque ``missing`` (3,); the likeliest, or drawn."""
        cross = self.covariance @ self.moves.T
        inner = self.moves @ cross
        values = (
            np.zeros(len(self.covariance)) if mean else self.factor @ self.rng.standard_normal(len(self.covariance))
        )
        values = values + cross @ np.linalg.solve(inner, missing - self.moves @ values)
        return self._load(values)

    def own(self, finest: float, largest: float) -> Floats:
        """A tension (3, q) of the cells' own of mean square ``scale`` [N/m], even over patches of a size drawn between two."""
        length = math.exp(self.rng.uniform(math.log(finest), math.log(max(largest, 1.01 * finest))))
        points = self.sheet.elements.points
        low = points.min(axis=0) - 2 * length
        side = 0.5 * length
        shape = [math.ceil((h - a) / side) + 5 for a, h in zip(low[::-1], points.max(axis=0)[::-1])]
        field = self.rng.standard_normal((3, *shape))
        field = np.stack([scipy.ndimage.gaussian_filter(f, length / (2 * side)) for f in field])
        field /= field.std()
        at = ((points - low) / side)[:, ::-1].T
        isotropic, along, across = (scipy.ndimage.map_coordinates(f, at, order=1) for f in field)
        return self.scale * np.stack([isotropic + along, isotropic - along, across]) / math.sqrt(2.0)
