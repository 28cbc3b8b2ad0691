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

from palpate.elastic.half_space import Floats

__all__ = ["Cone", "Solution", "minimise"]


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
        top = np.clip(0.5 * (p + size), 0.0, None)
        inside, polar = size <= p, size <= -p
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(size > 0, top / size, 0.0)
        out = np.concatenate([shear * ratio, top[None]])
        out[:, inside] = x[:, inside]
        out[:, polar] = 0.0
        return np.asarray(out)

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

    ``residual`` is the largest entry of x - P_K(x - d (Hx - h)) over the largest entry of x; ``covariance_root`` solves
    posterior questions on the face of K that the solution lies on (None if not asked for).
    """

    traction: Floats
    residual: float
    steps: int
    converged: bool
    face: Floats | None = None
    factor: Floats | None = None


#: Relative residual at which a solution counts as exact.
TOLERANCE = 1e-9


def minimise(
    hessian: Floats,
    linear: Floats,
    cone: Cone,
    start: Floats | None = None,
    *,
    tolerance: float = TOLERANCE,
    steps: int = 60,
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
        Return the directions of the face (dense, (component * cell, free)) and the Cholesky factor of H on it.

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
    face = factor = None
    while True:
        v = x - step_size * gradient
        residual = x - cone.project(v)
        size = float(np.abs(residual).max()) / max(float(np.abs(x).max()), 1e-6 * reference)
        if size < 0.999 * best_size:
            best, best_size, since = x, size, 0
        else:
            since += 1
        if size <= tolerance or taken >= steps:
            break
        if since > 12:
            if rescues == 3:
                break
            x = _alternate(h_matrix, h_vector, cone, best, 60 * 4**rescues)
            rescues, since = rescues + 1, 0
            gradient = (h_matrix @ x.ravel()).reshape(c, n) - h_vector
            continue
        x, face, factor = _newton(h_matrix, cone, x, v, residual, step_size)
        gradient = (h_matrix @ x.ravel()).reshape(c, n) - h_vector
        taken += 1
    converged = best_size <= tolerance
    if keep_face:
        v = best - step_size * ((h_matrix @ best.ravel()).reshape(c, n) - h_vector)
        _, face, factor = _newton(h_matrix, cone, best, v, np.zeros_like(best), step_size)
        face = face * rows[:, None]
    return Solution(
        cone.project(best) * scale[:, None], best_size, taken, converged, *((face, factor) if keep_face else (None, None))
    )


def _newton(
    hessian: Floats, cone: Cone, x: Floats, v: Floats, residual: Floats, step_size: Floats
) -> tuple[Floats, Floats, Floats]:
    """One semismooth Newton step; also the directions that stay free and the factor of H on them."""
    import scipy.linalg

    c, n = x.shape
    basis, values = cone.directions(v)
    if cone.coupled:
        # in the eigenvectors W of the projection's derivative M: M = 0 gives the step at once, s = -r; elsewhere
        # (H s)_w + (1 - m)/(m d) s_w = -r_w/(m d)
        local = np.einsum("idk,di->ki", basis, residual)
        free = values.ravel() > 1e-10
        columns = np.zeros((c * n, c * n))
        cells = np.arange(n)
        for d in range(c):
            for k in range(c):
                columns[d * n + cells, k * n + cells] = basis[:, d, k]
        face = columns[:, free]
        fixed = -columns[:, ~free] @ local.ravel()[~free]
        reduced = face.T @ _banded_product(hessian, basis, free, c, n)
        m = values.ravel()[free]
        reach = np.tile(step_size, c)[free]
        reduced[np.diag_indices(len(reduced))] += (1.0 - m) / (m * reach)
        right = -local.ravel()[free] / (m * reach) - face.T @ (hessian @ fixed)
        factor = scipy.linalg.cholesky(reduced, lower=True, check_finite=False, overwrite_a=True)
        step = fixed + face @ scipy.linalg.cho_solve((factor, True), right, check_finite=False)
        return x + step.reshape(c, n), face, factor
    index = np.flatnonzero(values.ravel() > 0)
    lost = np.flatnonzero(values.ravel() == 0)
    step = np.zeros(c * n)
    step[lost] = -residual.ravel()[lost]
    reduced = hessian[np.ix_(index, index)]
    right = -(residual / step_size).ravel()[index]
    if len(lost) and step[lost].any():
        moved = lost[step[lost] != 0]
        right -= hessian[np.ix_(index, moved)] @ step[moved]
    factor = scipy.linalg.cholesky(reduced, lower=True, check_finite=False)
    step[index] = scipy.linalg.cho_solve((factor, True), right, check_finite=False)
    face = np.zeros((c * n, len(index)))
    face[index, np.arange(len(index))] = 1.0
    return x + step.reshape(c, n), face, factor


def _banded_product(hessian: Floats, basis: Floats, free: npt.NDArray[np.bool_], c: int, n: int) -> Floats:
    """H times the free directions, which mix only the components of one cell."""
    blocks = hessian.reshape(c * n, c, n)
    out = np.empty((c * n, int(free.sum())))
    start = 0
    for k in range(c):
        cells = np.flatnonzero(free[k * n : (k + 1) * n])
        part = out[:, start : start + len(cells)]
        part[:] = blocks[:, 0, cells] * basis[cells, 0, k]
        for d in range(1, c):
            part += blocks[:, d, cells] * basis[cells, d, k]
        start += len(cells)
    return out


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
        y = 1.6 * y - 0.6 * z
        z = cone.project(y + dual)
        dual = dual + y - z
    return z
