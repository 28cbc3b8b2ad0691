"""Convex quadratic programs over contact: pressure never pulls, and shear stays within friction.

    minimise 1/2 x'Hx - h'x   with  x_i in K  for every surface cell i,

where K is, by what is sought and assumed, the half-line p >= 0, the friction cone |q| <= mu p (which contains p >= 0), the
half-space p >= 0 with q free, or everything. The solver is a semismooth Newton method on the projected gradient
x = P_K(x - d (Hx - h)) (the primal-dual active set of M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13, 2002, 865-888,
generalised to second-order cones as by S. Hayashi, N. Yamashita, M. Fukushima, SIAM J. Optim. 15, 2005, 593-615). Directions that
the projection fixes are eliminated, so that a step is one Cholesky factorisation over the cells in contact; it ends in a
few steps, exactly. Where it cycles, steps of the alternating direction method of multipliers bring it closer first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.contact.differences import Sparse
from palpate.inverse.contact.factors import Factor
from palpate.inverse.contact.quadratic import Formed, Quadratic
from palpate.inverse.contact.rows import Rows

__all__ = ["TOLERANCE", "Cone", "Face", "Ray", "Solution", "minimise"]


@dataclass(frozen=True)
class Cone:
    """The set each cell's traction lies in.

    ``components`` names the rows of a traction (component, cell). ``friction`` (mu) makes it |q| <= mu p; without it only
    p >= 0 holds; with ``tension`` allowed (or no pressure sought) nothing does.
    """

    components: tuple[str, ...]
    friction: float | None = None
    tension: bool = False

    @property
    def free(self) -> bool:
        """Whether nothing is constrained."""
        return self.tension or "z" not in self.components

    @property
    def coupled(self) -> bool:
        """Whether shear is tied to pressure by the friction."""
        return not self.free and self.friction is not None and len(self.components) > 1

    @property
    def scales(self) -> Floats:
        """Per component: x = scale * u makes the cone of u the standard one, |q| <= p."""
        out = np.ones(len(self.components))
        if self.coupled:
            out[-1] = 1.0 / float(self.friction or 1.0)
        return out

    def project(self, x: Floats) -> Floats:
        """Nearest point of K in the scaled variables (component, cell)."""
        if self.free:
            return x
        if not self.coupled:
            out = x.copy()
            out[-1] = np.maximum(x[-1], 0.0)
            return out
        shear, p = x[:-1], x[-1]
        size = np.sqrt((shear**2).sum(axis=0))
        inside = size <= p
        out = np.empty_like(x)
        # below the polar cone, size <= -p, this is 0
        out[-1] = np.where(inside, p, np.maximum(0.5 * (p + size), 0.0))
        # without shear, below the cone's tip, there is nothing to turn
        rest = np.where(inside | (size == 0.0), 1.0, size)
        out[:-1] = shear * np.where(inside, 1.0, out[-1] / rest).astype(x.dtype, copy=False)
        return out

    def nearest(self, traction: Floats) -> Floats:
        """A traction (component, cell) brought into K (nearest in the scaled variables)."""
        scales = self.scales[:, None]
        return np.asarray(scales * self.project(traction / scales))

    def directions(self, v: Floats) -> tuple[Floats, Floats]:
        """Eigenvectors (cell, component, direction) and eigenvalues (direction, cell) of the projection's derivative."""
        c, n = v.shape
        basis = _straight(n, c)
        values = np.ones((c, n))
        if self.free:
            return basis, values
        if not self.coupled:
            values[-1] = v[-1] > 0
            return basis, values
        basis = basis.copy()
        shear, p = v[:-1], v[-1]
        size = np.sqrt((shear**2).sum(axis=0))
        values[:, size <= -p] = 0.0
        edge = (size > p) & (size > -p)
        unit = shear[:, edge] / size[edge]
        root = np.sqrt(0.5)
        basis[edge] = 0.0
        # along the cone's generator (kept), across it (lost), and round the cone (shrunk)
        basis[edge, :-1, 0], basis[edge, -1, 0] = root * unit.T, root
        basis[edge, :-1, 1], basis[edge, -1, 1] = -root * unit.T, root
        values[1, edge] = 0.0
        if c == 3:
            basis[edge, 0, 2], basis[edge, 1, 2] = -unit[1], unit[0]
            values[2, edge] = 0.5 * (1.0 + p[edge] / size[edge])
        return basis, values


@lru_cache(maxsize=16)
def _straight(n: int, c: int) -> Floats:
    """Directions (cell, component, direction) that are the components."""
    return np.broadcast_to(np.eye(c), (n, c, c))


@dataclass(frozen=True)
class Solution:
    """Minimiser (component, cell), and how it was reached.

    ``residual`` is the largest entry of x - P_K(x - d (Hx - h)) over the largest entry of x. ``face`` and ``factor``, where
    asked for, are the directions free to move on the face of K that the solution lies on, and a factor of H there: their
    covariance is the inverse.
    """

    traction: Floats
    residual: float
    steps: int
    converged: bool
    face: Face | None = None
    factor: Factor | None = None


#: Relative residual at which a solution counts as exact: the normal matrix of a problem of condition 1e6 leaves 1e-10.
TOLERANCE = 1e-9
#: Newton steps of one problem; the active set settles in ten or fewer unless it cycles.
STEPS = 60
#: It cycles if the residual has not become smaller by this factor in so many steps; it is then brought closer, so often at most.
SMALLER, PATIENCE, RESCUES = 0.999, 12, 3
#: The same where H is known by products alone, and each step takes tens of them: readings that are all alike took minutes.
FEWER_STEPS, FEWER_RESCUES = 30, 1
#: Alternating steps of the first rescue, and how many times more each following one takes.
ALTERNATING, MORE = 60, 4
#: Over-relaxation of the alternating steps (1.5 to 1.8: S. Boyd et al., Foundations and Trends in Machine Learning 3, 2011, section 3.4.3).
RELAXATION, BACK = 1.6, 0.6
#: Eigenvalues of the projection's derivative below this count as zero: a direction that moves so little is fixed.
FREE = 1e-10


def minimise(
    hessian: Floats | Quadratic,
    linear: Floats,
    cone: Cone,
    start: Floats | None = None,
    *,
    tolerance: float = TOLERANCE,
    steps: int = STEPS,
    keep_face: bool = False,
) -> Solution:
    """Minimise 1/2 x'Hx - h'x over the cone.

    Parameters
    ----------
    hessian : array (component * cell, component * cell) or Quadratic
        Symmetric, positive definite; component-major.
    linear : array (component, cell)
    cone : Cone
    start : array (component, cell), optional
        A guess; a good one saves steps and changes nothing else.
    keep_face : bool
        Return the face that the solution lies on and a factor of H on it.

    Returns
    -------
    Solution
        ``converged`` is False where the steps ran out; the traction then lies in the cone and is the best one met.
    """
    c, n = linear.shape
    scale = cone.scales
    h_matrix: Quadratic = Formed(hessian) if isinstance(hessian, np.ndarray) else hessian
    if (scale != 1.0).any():
        h_matrix = h_matrix.scaled(scale)
    h_vector = linear * scale[:, None]
    step_size = c / np.maximum(h_matrix.diagonal().reshape(c, n).sum(axis=0), 1e-300)
    x = cone.project(np.zeros((c, n)) if start is None else start / scale[:, None])
    gradient = h_matrix.product(x) - h_vector
    reference = max(float(np.abs(step_size * h_vector).max()), 1e-300)
    best, best_gradient, best_size, since, taken = x, gradient, np.inf, 0, 0
    most = RESCUES
    if h_matrix.by_products:
        steps, most = min(steps, FEWER_STEPS), FEWER_RESCUES
    rescues = 0
    known: tuple[Face, Factor] | None = None
    while True:
        give_way()
        v = x - step_size * gradient
        residual = x - cone.project(v)
        size = float(np.abs(residual).max()) / max(float(np.abs(x).max()), 1e-6 * reference)
        if size < SMALLER * best_size:
            best, best_gradient, best_size, since = x, gradient, size, 0
        else:
            since += 1
        if size <= tolerance or taken >= steps:
            break
        if since > PATIENCE:
            if rescues == most:
                break
            x = _alternate(h_matrix, h_vector, cone, best, ALTERNATING * MORE**rescues)
            rescues, since = rescues + 1, 0
            gradient = h_matrix.product(x) - h_vector
            continue
        known = _factored(h_matrix, cone, v, step_size, known)
        x = _newton(h_matrix, *known, x, residual, step_size)
        gradient = h_matrix.product(x) - h_vector
        taken += 1
    converged = best_size <= tolerance
    if keep_face:
        face, factor = _factored(h_matrix, cone, best - step_size * best_gradient, step_size, known)
        face.scales = scale
        known = face, factor
    return Solution(
        cone.project(best) * scale[:, None],
        best_size,
        taken,
        converged,
        *(known if keep_face and known is not None else (None, None)),
    )


def _factored(
    hessian: Quadratic, cone: Cone, v: Floats, step_size: Floats, known: tuple[Face, Factor] | None
) -> tuple[Face, Factor]:
    """The directions that the projection of v leaves free, and the factor there of H and of what shrinks them (`_newton`)."""
    face = Face(*cone.directions(v), cone.coupled)
    straight = known is not None and not (cone.coupled and (face.oblique.any() or known[0].oblique.any()))
    if known is not None and straight and np.array_equal(face.free, known[0].free):
        return known
    if not cone.coupled:  # what is kept is kept whole
        return face, hessian.factor(face, np.zeros(len(face.index)))
    return face, hessian.factor(face, (1.0 - face.kept) / (face.kept * face.spread(step_size)))


def _newton(hessian: Quadratic, face: Face, factor: Factor, x: Floats, residual: Floats, step_size: Floats) -> Floats:
    """One semismooth Newton step.

    In the eigenvectors W of the projection's derivative, with eigenvalues m: where m = 0 the step is known at once,
    s_w = -r_w; elsewhere (W'H s)_w + (1 - m)/(m d) s_w = -r_w/(m d).
    """
    local = face.rotate(residual)
    fixed = face.unrotate(np.where(face.free, 0.0, -local))
    right = -local.ravel()[face.index] / (face.kept * face.spread(step_size))
    if fixed.any():
        right -= face.rotate(hessian.product(fixed)).ravel()[face.index]
    found = np.zeros(x.size)
    found[face.index] = factor.solve(right)
    return x + fixed + face.unrotate(found.reshape(x.shape))


class Face:
    """Free directions of every cell: some of the columns of an orthogonal matrix (cell, component, direction) that mixes the components of
    one cell.

    ``values`` (direction, cell) is how much a projection keeps of each direction: those of which it keeps nothing are fixed.
    """

    def __init__(self, basis: Floats, values: Floats, mixed: bool) -> None:
        self.basis, self.free, self.mixed = basis, values > FREE, mixed
        self.index = np.flatnonzero(self.free.ravel())
        self.kept = values.ravel()[self.index]
        self.scales: Floats = np.ones(len(self.free))

    @cached_property
    def oblique(self) -> npt.NDArray[np.bool_]:
        """Cells whose directions are not the components."""
        if not self.mixed:
            return np.zeros(len(self.basis), dtype=bool)
        return np.asarray((self.basis != np.eye(len(self.free))).any(axis=(1, 2)))

    def spread(self, cells: Floats) -> Floats:
        """A value of each cell, for each free direction."""
        return np.asarray(cells[self.index % len(cells)])

    def rotate(self, x: Floats) -> Floats:
        """W'x of (component, cell)."""
        return np.einsum("idk,di->ki", self.basis, x) if self.mixed else x

    def unrotate(self, x: Floats) -> Floats:
        """W x of (direction, cell)."""
        return np.einsum("idk,ki->di", self.basis, x) if self.mixed else x

    def directions(self) -> Sparse:
        """W' (free direction, component * cell), with the cone's scales taken out."""
        c, n = self.free.shape
        direction, cell = np.divmod(self.index, n)
        values = self.basis[cell, :, direction] * self.scales
        places = np.arange(c)[None, :] * n + cell[:, None]
        there = values != 0.0
        ends = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
        return scipy.sparse.csr_array((values[there], places[there], ends), shape=(len(cell), c * n))

    def columns(self, rows: Floats) -> Floats:
        """rows W, of an array (m, component * cell)."""
        if not self.mixed:
            return np.asarray(rows[:, self.index])
        return np.asarray((self.directions() @ rows.T).T)

    def rows(self, rows: Rows) -> Rows:
        """rows W, of sparse rows over (component, cell)."""
        c, n = self.free.shape
        if len(self.index) == c * n and not self.mixed and (self.scales == 1.0).all():
            return rows
        place = np.full((c, n), -1, dtype=np.intp)
        place.ravel()[self.index] = np.arange(len(self.index))
        if not self.oblique.any():
            col, row = place.ravel()[rows.col], rows.row
            value = rows.value * self.scales[rows.col // n]
            kept = col >= 0
        else:
            component, cell = np.divmod(rows.col, n)
            values = (rows.value * self.scales[component])[:, None] * self.basis[cell, component]
            col, value = place[:, cell].T.ravel(), values.ravel()
            row, kept = np.repeat(rows.row, c), (col >= 0) & (value != 0.0)
        return Rows(row[kept], col[kept], value[kept], rows.count)

    def gathered(self, columns: Floats, order: npt.NDArray[np.intp]) -> Floats:
        """W' columns of an array (component * cell, m), in some order of the free directions."""
        places = self.index[order]
        out = np.ascontiguousarray(columns[places])
        if not self.mixed:
            return out
        c, n = self.free.shape
        direction, cell = np.divmod(places, n)
        turned = np.flatnonzero(self.oblique[cell])
        if len(turned):
            # as a sparse product: one pass over the columns
            weights = self.basis[cell[turned], :, direction[turned]]
            where = cell[turned][:, None] + n * np.arange(c)
            ends = np.arange(0, weights.size + 1, c)
            mixed = scipy.sparse.csr_array((weights.ravel(), where.ravel(), ends), shape=(len(turned), c * n))
            out[turned] = mixed @ columns
        return out

    def restrict(self, matrix: Floats) -> Floats:
        """W' matrix W of a symmetric matrix."""
        if not self.oblique.any():
            if len(self.index) == len(matrix):
                return matrix.copy()
            return np.asarray(matrix.take(self.index, axis=0).take(self.index, axis=1))
        every = np.arange(len(self.index))
        return self.gathered(np.ascontiguousarray(self.gathered(matrix, every).T), every)


class Ray(Face):
    """Free directions of cells whose traction is one vector (component,) times a pressure, and of that vector's changes.

    ``turned`` (change, component * cell) is what the changes that are possible do to the traction.
    """

    def __init__(self, ray: Floats, free: npt.NDArray[np.bool_], turned: Floats) -> None:
        c, n = len(ray), len(free)
        basis = np.zeros((n, c, c))
        basis[:, :, 0] = ray
        values = np.zeros((c, n))
        values[0] = free
        super().__init__(basis, values, True)
        self.turned = turned

    def directions(self) -> Sparse:
        return scipy.sparse.csr_array(scipy.sparse.vstack([super().directions(), scipy.sparse.csr_array(self.turned)]))

    def rows(self, rows: Rows) -> Rows:
        return replace(super().rows(rows), others=rows.times(self.turned.T))


def _alternate(hessian: Quadratic, linear: Floats, cone: Cone, x: Floats, count: int) -> Floats:
    """Alternating direction method of multipliers, over-relaxed, from x."""
    diagonal = hessian.diagonal()
    rho = float(np.sqrt(diagonal.max() * diagonal.mean()))
    whole = Face(np.broadcast_to(np.eye(len(x)), (x.shape[1], len(x), len(x))), np.ones(x.shape), cone.coupled)
    factor = hessian.factor(whole, np.full(x.size, rho))
    z = x.copy()
    dual = np.zeros_like(x)
    for _ in range(count):
        y = factor.solve((linear + rho * (z - dual)).ravel()).reshape(x.shape)
        y = RELAXATION * y - BACK * z
        z = cone.project(y + dual)
        dual = dual + y - z
    return z
