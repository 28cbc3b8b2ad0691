"""Convex quadratic programs over contact: pressure never pulls, and shear stays within friction.

    minimise 1/2 x'Hx - h'x   with  x_i in K  for every surface cell i,

where K is, by the components sought and the assumptions, the half-line p >= 0, the friction cone |q| <= mu p (which contains p >= 0), the
half-space p >= 0 with q free, or everything. The solver is a semismooth Newton method on the projected gradient
x = P_K(x - d (Hx - h)) (the primal-dual active set of M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13, 2002, 865-888,
generalised to second-order cones as by S. Hayashi, N. Yamashita, M. Fukushima, SIAM J. Optim. 15, 2005, 593-615). Directions that
the projection fixes are eliminated, so that a step is one Cholesky factorisation over the cells in contact; it ends in a
few steps, exactly. If it cycles, an interior-point method (`palpate.inverse.constrained.interior`) finishes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._threads import cached_property, give_way
from palpate.elastic.pad import Floats
from palpate.inverse.constrained import compiled
from palpate.inverse.constrained.faces import FREE, Face, slanted, straight
from palpate.inverse.constrained.factors import Factor
from palpate.inverse.constrained.interior import interior
from palpate.inverse.constrained.quadratic import Formed, Quadratic

__all__ = ["TOLERANCE", "Cone", "Solution", "factored", "minimise", "step_sizes"]


@dataclass(frozen=True)
class Cone:
    """The set each cell's traction lies in.

    ``components`` names the rows of a traction (component, cell). With ``friction`` (mu) the set is |q| <= mu p, without it p >= 0; with ``tension``
    allowed (or no pressure sought) it is everything.
    """

    components: tuple[str, ...]
    friction: float | None = None
    tension: bool = False

    @property
    def free(self) -> bool:
        """Whether there are no constraints."""
        return self.tension or "z" not in self.components

    @cached_property
    def coupled(self) -> bool:
        """Whether shear is tied to pressure by the friction."""
        return not self.free and self.friction is not None and len(self.components) > 1

    @cached_property
    def scales(self) -> Floats:
        """Scale of each component: with x = scale * u, the cone of u is the standard one, |q| <= p."""
        out = np.ones(len(self.components))
        if self.coupled:
            out[-1] = 1.0 / float(self.friction or 1.0)
        out.flags.writeable = False
        return out

    def project(self, x: Any, xp: Any = np) -> Any:
        """Nearest point of K in the scaled variables (*batch, component, cell), arrays of the namespace ``xp``."""
        if self.free:
            return x
        shear, p = x[..., :-1, :], x[..., -1:, :]
        zero = xp.zeros_like(p)
        if not self.coupled:
            return xp.concat([shear, xp.maximum(p, zero)], axis=-2)
        size = xp.sqrt(xp.sum(shear**2, axis=-2, keepdims=True))
        inside, one = size <= p, xp.ones_like(p)
        # below the polar cone, size <= -p, this is 0
        top = xp.where(inside, p, xp.maximum(0.5 * (p + size), zero))
        # without shear, below the cone's tip, the projection does not rotate
        kept = xp.where(inside, one, top / xp.where(size > 0, size, one))
        return xp.concat([shear * kept, top], axis=-2)

    def nearest(self, traction: Floats) -> Floats:
        """The traction in K nearest to a traction (component, cell), in the scaled variables."""
        scales = self.scales[:, None]
        return np.asarray(scales * self.project(traction / scales))

    def directions(self, v: Floats) -> tuple[Floats, Floats]:
        """Eigenvectors (cell, component, direction) and eigenvalues (direction, cell) of the projection's derivative."""
        c, n = v.shape
        basis = straight(n, c)
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
        # along the cone's generator (kept), across it (lost), and round the cone (shrunk)
        basis[edge] = slanted(shear[:, edge] / size[edge])
        values[1, edge] = 0.0
        if c == 3:
            values[2, edge] = 0.5 * (1.0 + p[edge] / size[edge])
        return basis, values


@dataclass(frozen=True)
class Solution:
    """Minimiser (component, cell), and how it was reached.

    ``residual`` is the largest entry of x - P_K(x - d (Hx - h)) over the largest entry of x. ``face`` and ``factor``, where
    requested, are the directions free to move on the face of K that the solution lies on, and a factor of H there: their
    covariance is the inverse. ``hard``: Newton's method cycled.
    """

    traction: Floats
    residual: float
    steps: int
    converged: bool
    face: Face | None = None
    factor: Factor | None = None
    hard: bool = False


#: Relative residual at which a solution counts as exact: the normal matrix of a problem of condition 1e6 leaves 1e-10.
TOLERANCE = 1e-9
#: Newton steps of one problem; the active set settles in ten or fewer unless it cycles.
STEPS = 60
#: Newton's method cycles if the residual has not decreased by the factor SMALLER in PATIENCE steps. Then run the
#: interior-point method once, followed by at most AFTER such rounds.
SMALLER, PATIENCE, AFTER = 0.999, 5, 1
#: Largest number of steps if only products with H are available, because each step then needs tens of them: with
#: identical readings it took minutes.
FEWER_STEPS = 30
#: Residual below which a factor of the same free directions is used again on a cone: they turn by as little, so that each further step leaves about this
#: part of what the one before left. It is also the accuracy of the errors that follow from that factor.
NEARLY = 3e-3
#: Such a step that leaves more than this part is followed by one with a new factor.
TURNED = 0.1


def minimise(
    hessian: Floats | Quadratic,
    linear: Floats,
    cone: Cone,
    start: Floats | None = None,
    *,
    tolerance: float = TOLERANCE,
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
        ``converged`` is False if the steps ran out; the traction then lies in the cone and is the best one met.
    """
    c, n = linear.shape
    scale = cone.scales
    hessian = Formed(hessian) if isinstance(hessian, np.ndarray) else hessian
    if hessian.slow:
        hessian = hessian.exactly()
    h_matrix = hessian
    if (scale != 1.0).any():
        h_matrix = h_matrix.scaled(scale)
    h_vector = linear * scale[:, None]
    start = np.zeros((c, n)) if start is None else start / scale[:, None]
    limits = compiled.Limits(tolerance, SMALLER, NEARLY, TURNED, FREE, STEPS, PATIENCE)
    found = compiled.newton(
        h_matrix, h_vector, start, free=cone.free, coupled=cone.coupled, limits=limits, keep_face=keep_face
    )
    if found is not None:
        if found.face is not None:
            found.face.scales = scale
        converged = found.residual <= tolerance
        return Solution(found.x * scale[:, None], found.residual, found.steps, converged, found.face, found.factor)
    step_size = step_sizes(h_matrix, c)
    x = cone.project(start)
    gradient = h_matrix.product(x) - h_vector
    reference = max(float(np.abs(step_size * h_vector).max()), 1e-300)
    best, best_gradient, best_size, since, taken = x, gradient, np.inf, 0, 0
    steps = FEWER_STEPS if h_matrix.by_products else STEPS
    inside: bool | None = None  # whether the interior-point method converged, if it ran
    known: tuple[Face, Factor] | None = None
    found_at = math.inf  # the residual that the factor was made at
    last = math.inf
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
        if since > (PATIENCE if inside is None else AFTER):
            if inside is not None:
                break
            h_matrix = h_matrix.exactly()
            x, inside = interior(h_matrix, h_vector, cone, best, tolerance)
            best_size, since = np.inf if inside else best_size, 0
            gradient = h_matrix.product(x) - h_vector
            known, last = None, math.inf
            continue
        keep = found_at <= NEARLY and size <= TURNED * last
        before, known = known, factored(h_matrix, cone, v, step_size, known, keep=keep)
        found_at, last = found_at if known is before else size, size
        x = _newton(h_matrix, *known, x, residual, step_size)
        if h_matrix.slow and not (exact := hessian.exactly()).by_products:
            near = cone.project(x) * scale[:, None]
            return minimise(exact, linear, cone, near, tolerance=tolerance, keep_face=keep_face)
        gradient = h_matrix.product(x) - h_vector
        taken += 1
    converged = best_size <= tolerance or bool(inside)
    traction, hard = cone.project(best) * scale[:, None], inside is not None
    if not keep_face:
        return Solution(traction, best_size, taken, converged, hard=hard)
    v = best - step_size * best_gradient
    face, factor = factored(h_matrix, cone, v, step_size, known, keep=found_at <= NEARLY)
    face.scales = scale
    return Solution(traction, best_size, taken, converged, face, factor, hard)


def step_sizes(hessian: Quadratic, components: int) -> Floats:
    """d of each cell: one over the mean of its diagonal entries."""
    diagonal = hessian.diagonal().reshape(components, -1)
    return np.asarray(components / np.maximum(diagonal.sum(axis=0), 1e-300))


def factored(
    hessian: Quadratic,
    cone: Cone,
    v: Floats,
    step_size: Floats,
    known: tuple[Face, Factor] | None = None,
    *,
    keep: bool = False,
) -> tuple[Face, Factor]:
    """The free directions of the projection of v, and the factor of H plus the cone's curvature there (`_newton`).

    ``known``, if given, is returned if the directions are the same, or with ``keep`` if as many are free and they have only turned.
    """
    face = Face(*cone.directions(v), cone.coupled)
    if known is not None and np.array_equal(face.free, known[0].free):
        same = np.array_equal(face.oblique, known[0].oblique)
        if same and (keep or not (cone.coupled and face.oblique.any())):
            return known
    if not cone.coupled:  # cache the complete value
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
