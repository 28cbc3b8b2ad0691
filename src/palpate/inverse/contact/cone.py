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

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate.elastic.pad import Floats

__all__ = ["TOLERANCE", "Cone", "Face", "Ray", "Solution", "cholesky", "minimise"]


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
        out[:-1] = shear * np.where(inside, 1.0, out[-1] / np.where(inside, 1.0, size)).astype(x.dtype, copy=False)
        return out

    def nearest(self, traction: Floats) -> Floats:
        """A traction (component, cell) brought into K (nearest in the scaled variables)."""
        scales = self.scales[:, None]
        return np.asarray(scales * self.project(traction / scales))

    def directions(self, v: Floats) -> tuple[Floats, Floats]:
        """Eigenvectors (cell, component, direction) and eigenvalues (direction, cell) of the projection's derivative."""
        c, n = v.shape
        basis = np.broadcast_to(np.eye(c), (n, c, c)).copy()
        values = np.ones((c, n))
        if self.free:
            return basis, values
        if not self.coupled:
            values[-1] = v[-1] > 0
            return basis, values
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


@dataclass(frozen=True)
class Solution:
    """Minimiser (component, cell), and how it was reached.

    ``residual`` is the largest entry of x - P_K(x - d (Hx - h)) over the largest entry of x. ``face`` and ``factor``, where
    asked for, are the directions free to move on the face of K that the solution lies on, and the Cholesky factor of H there:
    their covariance is the inverse.
    """

    traction: Floats
    residual: float
    steps: int
    converged: bool
    face: Face | None = None
    factor: Floats | None = None


#: Relative residual at which a solution counts as exact: the normal matrix of a problem of condition 1e6 leaves 1e-10.
TOLERANCE = 1e-9
#: Newton steps of one problem; the active set settles in ten or fewer unless it cycles.
STEPS = 60
#: It cycles if the residual has not become smaller by this factor in so many steps; it is then brought closer, so often at most.
SMALLER, PATIENCE, RESCUES = 0.999, 12, 3
#: Alternating steps of the first rescue, and how many times more each following one takes.
ALTERNATING, MORE = 60, 4
#: Over-relaxation of the alternating steps (1.5 to 1.8: S. Boyd et al., Foundations and Trends in Machine Learning 3, 2011, section 3.4.3).
RELAXATION, BACK = 1.6, 0.6
#: Eigenvalues of the projection's derivative below this count as zero: a direction that moves so little is fixed.
FREE = 1e-10


def minimise(
    hessian: Floats,
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
    hessian : array (component * cell, component * cell)
        Symmetric, positive definite; component-major.
    linear : array (component, cell)
    cone : Cone
    start : array (component, cell), optional
        A guess; a good one saves steps and changes nothing else.
    keep_face : bool
        Return the face that the solution lies on and the Cholesky factor of H on it.

    Returns
    -------
    Solution
        ``converged`` is False where the steps ran out; the traction then lies in the cone and is the best one met.
    """
    c, n = linear.shape
    scale = cone.scales
    rows = np.repeat(scale, n)
    h_matrix = hessian if (scale == 1.0).all() else hessian * rows[:, None] * rows[None, :]
    h_vector = linear * scale[:, None]
    step_size = c / np.maximum(np.diagonal(h_matrix).reshape(c, n).sum(axis=0), 1e-300)
    x = cone.project(np.zeros((c, n)) if start is None else start / scale[:, None])
    gradient = (h_matrix @ x.ravel()).reshape(c, n) - h_vector
    reference = max(float(np.abs(step_size * h_vector).max()), 1e-300)
    best, best_size, since, taken = x, np.inf, 0, 0
    rescues = 0
    face: Face | None = None
    factor: Floats | None = None
    while True:
        v = x - step_size * gradient
        residual = x - cone.project(v)
        size = float(np.abs(residual).max()) / max(float(np.abs(x).max()), 1e-6 * reference)
        if size < SMALLER * best_size:
            best, best_size, since = x, size, 0
        else:
            since += 1
        if size <= tolerance or taken >= steps:
            break
        if since > PATIENCE:
            if rescues == RESCUES:
                break
            x = _alternate(h_matrix, h_vector, cone, best, ALTERNATING * MORE**rescues)
            rescues, since = rescues + 1, 0
            gradient = (h_matrix @ x.ravel()).reshape(c, n) - h_vector
            continue
        x = _newton(h_matrix, cone, x, v, residual, step_size)[0]
        gradient = (h_matrix @ x.ravel()).reshape(c, n) - h_vector
        taken += 1
    converged = best_size <= tolerance
    if keep_face:
        v = best - step_size * ((h_matrix @ best.ravel()).reshape(c, n) - h_vector)
        _, face, factor = _newton(h_matrix, cone, best, v, np.zeros_like(best), step_size)
        face.scales = scale
    return Solution(
        cone.project(best) * scale[:, None],
        best_size,
        taken,
        converged,
        *((face, factor) if keep_face else (None, None)),
    )


def _newton(
    hessian: Floats, cone: Cone, x: Floats, v: Floats, residual: Floats, step_size: Floats
) -> tuple[Floats, Face, Floats]:
    """One semismooth Newton step; also the directions that stay free and the factor of H on them.

    In the eigenvectors W of the projection's derivative, with eigenvalues m: where m = 0 the step is known at once,
    s_w = -r_w; elsewhere (W'H s)_w + (1 - m)/(m d) s_w = -r_w/(m d).
    """
    import scipy.linalg

    c, n = x.shape
    basis, values = cone.directions(v)
    face = Face(basis, values > FREE, cone.coupled)
    local = face.rotate(residual)
    m = values.ravel()[face.index]
    reach = np.tile(step_size, c)[face.index]
    known = np.where(face.free, 0.0, -local).reshape(c, n)
    fixed = face.unrotate(known)
    reduced = face.restrict(hessian)
    reduced[np.diag_indices(len(reduced))] += (1.0 - m) / (m * reach)
    right = -local.ravel()[face.index] / (m * reach)
    if fixed.any():
        right -= face.rotate((hessian @ fixed.ravel()).reshape(c, n)).ravel()[face.index]
    factor = cholesky(reduced)
    found = np.zeros(c * n)
    found[face.index] = scipy.linalg.cho_solve((factor, True), right, check_finite=False)
    return x + fixed + face.unrotate(found.reshape(c, n)), face, factor


def cholesky(matrix: Floats) -> Floats:
    """Lower factor; where rounding makes the matrix indefinite, of the matrix plus as little of the identity as helps."""
    import scipy.linalg

    diagonal = np.diagonal(matrix).copy()
    for jitter in (0.0, 1e-14, 1e-12, 1e-10):
        matrix[np.diag_indices(len(matrix))] = diagonal * (1.0 + jitter) + jitter * diagonal.max(initial=0.0)
        try:
            return np.asarray(scipy.linalg.cholesky(matrix, lower=True, check_finite=False))
        except np.linalg.LinAlgError:
            continue
    raise np.linalg.LinAlgError("the quadratic program is not positive definite")


class Face:
    """Free directions of every cell: some of the columns of an orthogonal matrix that mixes the components of one cell."""

    def __init__(self, basis: Floats, free: npt.NDArray[np.bool_], mixed: bool) -> None:
        self.basis, self.free, self.mixed = basis, free, mixed
        self.index = np.flatnonzero(free.ravel())
        self.scales: Floats = np.ones(len(free))

    def rotate(self, x: Floats) -> Floats:
        """W'x of (component, cell)."""
        return np.einsum("idk,di->ki", self.basis, x) if self.mixed else x

    def unrotate(self, x: Floats) -> Floats:
        """W x of (direction, cell)."""
        return np.einsum("idk,ki->di", self.basis, x) if self.mixed else x

    def directions(self) -> scipy.sparse.csr_array:
        """W' (free direction, component * cell), with the cone's scales taken out."""
        c, n = self.free.shape
        direction, cell = np.divmod(self.index, n)
        values = self.basis[cell, :, direction] * self.scales
        places = np.arange(c)[None, :] * n + cell[:, None]
        ends = np.arange(0, values.size + 1, c)
        return scipy.sparse.csr_array((values.ravel(), places.ravel(), ends), shape=(len(cell), c * n))

    def columns(self, rows: Floats) -> Floats:
        """rows W, of an array (m, component * cell)."""
        if not self.mixed:
            return np.asarray(rows[:, self.index])
        return np.asarray((self.directions() @ rows.T).T)

    def restrict(self, matrix: Floats) -> Floats:
        """W' matrix W of a symmetric matrix."""
        if not self.mixed:
            return np.asarray(matrix[np.ix_(self.index, self.index)])
        directions = self.directions()
        # rows are gathered twice: sparse times dense is fast where the dense array's rows lie together
        return np.asarray(directions @ np.ascontiguousarray((directions @ matrix).T))


class Ray(Face):
    """Free directions of cells whose traction is one vector (component,) times a pressure, and of that vector's changes.

    ``turned`` (change, component * cell) is what the changes that are possible do to the traction.
    """

    def __init__(self, ray: Floats, free: npt.NDArray[np.bool_], turned: Floats) -> None:
        c, n = len(ray), len(free)
        basis = np.zeros((n, c, c))
        basis[:, :, 0] = ray
        flags = np.zeros((c, n), dtype=bool)
        flags[0] = free
        super().__init__(basis, flags, True)
        self.turned = turned

    def directions(self) -> scipy.sparse.csr_array:
        return scipy.sparse.csr_array(scipy.sparse.vstack([super().directions(), scipy.sparse.csr_array(self.turned)]))


def _alternate(hessian: Floats, linear: Floats, cone: Cone, x: Floats, count: int) -> Floats:
    """Alternating direction method of multipliers, over-relaxed, from x."""
    import scipy.linalg

    size = linear.size
    rho = float(np.sqrt(np.diagonal(hessian).max() * np.diagonal(hessian).mean()))
    factor = scipy.linalg.cho_factor(hessian + rho * np.eye(size), check_finite=False)
    z = x.copy()
    dual = np.zeros_like(x)
    for _ in range(count):
        y = scipy.linalg.cho_solve(factor, (linear + rho * (z - dual)).ravel(), check_finite=False).reshape(x.shape)
        y = RELAXATION * y - BACK * z
        z = cone.project(y + dual)
        dual = dual + y - z
    return z
