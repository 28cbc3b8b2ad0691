"""Minima over the friction cone as functions of their problem: batches, and derivatives by the implicit function
theorem.

x = argmin 1/2 x'Hx - h'x over the cone solves x = P(x - d (Hx - h)). Where strict complementarity holds, P is
differentiable. Let W be the eigenvectors of its derivative with eigenvalues m > 0, which span the face that x lies on.
Then

    dx = W (W'HW + diag((1 - m)/(m d)))^-1 W' (dh - dH x),

where the second term is the curvature of the cone (`palpate.inverse.constrained.faces`). The map is symmetric, so that
the same map pulls gradients back. Many problems with one Hessian are solved together by the alternating direction
method of multipliers (Boyd et al., Foundations and Trends in Machine Learning 3, 2011, section 5.2), whose steps are
matrix products. Newton's method solves the remaining ones one by one.
"""

from __future__ import annotations

import math
from typing import Any

import array_api_compat
import numpy as np
import numpy.typing as npt

from palpate._threads import few_threads
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone, factored, minimise, step_sizes
from palpate.inverse.constrained.quadratic import Formed

__all__ = ["minima", "pulled_back", "together"]

#: Smallest number of problems with one Hessian that are solved together: its eigenvectors cost as much as some Newton
#: steps.
MANY = 16
#: Largest number of steps of the alternating direction method, and steps between two convergence tests. With a weight
#: sqrt(smallest * largest eigenvalue) it gains a digit in about 0.7 sqrt(condition) steps: 100 steps are enough for a
#: condition of 50, and beyond 2000 Newton's method is faster.
MOST, LOOK = 400, 20
#: Over-relaxation (Boyd et al., section 3.4.3: 1.5 to 1.8).
RELAXED = 1.7
#: Problems solved at a time: 150 MB of work for 432 unknowns.
PIECE = 4096
#: Residual, as in `cone.minimise`, at which a problem counts as solved: far enough below `cone.TOLERANCE` that both
#: methods agree to 1e-8.
SOLVED = 1e-12


def minima(hessian: npt.ArrayLike, linear: npt.ArrayLike, cone: Cone) -> Floats:
    """Minimisers (*batch, component * cell) of many problems; NaN where a problem was not solved to `cone.TOLERANCE`.

    Parameters
    ----------
    hessian : array (*batch, n, n)
        Symmetric, positive definite. Its batch axes may have length 1, or be fewer: they broadcast.
    linear : array (*batch, n)
    """
    h = np.asarray(linear, dtype=np.float64)
    c = len(cone.components)
    out = np.empty_like(h)
    with few_threads(h.shape[-1]):
        for matrix, where in _shared(hessian, h):
            quadratic = Formed(matrix)
            good = np.isfinite(matrix).all()
            left = where
            if good and len(where) >= MANY:
                index = tuple(np.transpose(where))
                out[index], solved = together(matrix, h[index], cone)
                left = [i for i, done in zip(where, solved) if not done]
            for i in left:
                if not good or not np.isfinite(h[i]).all():
                    out[i] = np.nan
                    continue
                found = minimise(quadratic, h[i].reshape(c, -1), cone)
                out[i] = found.traction.ravel() if found.converged else np.nan
    return out


def together(hessian: Any, linear: Any, cone: Cone) -> tuple[Any, Any]:
    """Minimisers (problem, component * cell) of many problems with one Hessian, and whether each was solved to
    `SOLVED` (problem,).

    Parameters
    ----------
    hessian : array (n, n)
        Symmetric, positive definite, in double precision; of NumPy or PyTorch, on any device.
    linear : array (problem, n)
    """
    xp = array_api_compat.array_namespace(linear)
    c = len(cone.components)
    scale = xp.asarray(np.repeat(cone.scales, linear.shape[1] // c), device=array_api_compat.device(linear))
    matrix, h = hessian * scale * scale[:, None], linear * scale
    values, vectors = xp.linalg.eigh(matrix)
    weight = float(values[0] * values[-1]) ** 0.5 if float(values[0]) > 0 else math.nan
    inverse = (vectors / (values + weight)) @ vectors.T
    diagonal = xp.reshape(xp.linalg.diagonal(matrix), (c, -1))
    step = xp.reshape(xp.zeros_like(diagonal) + c / xp.sum(diagonal, axis=0), (-1,))

    parts = [_alternating(h[i : i + PIECE], matrix, inverse, weight, step, cone) for i in range(0, h.shape[0], PIECE)]
    return xp.concat([x for x, _ in parts], axis=0) * scale, xp.concat([solved for _, solved in parts], axis=0)


def _alternating(h: Any, matrix: Any, inverse: Any, weight: float, step: Any, cone: Cone) -> tuple[Any, Any]:
    """`together` in the scaled variables, for as many problems as fit in memory."""
    xp = array_api_compat.array_namespace(h)
    shape = (h.shape[0], len(cone.components), -1)

    def project(v: Any) -> Any:
        return xp.reshape(cone.project(xp.reshape(v, shape), xp), h.shape)

    x, u = xp.zeros_like(h), xp.zeros_like(h)
    for count in range(1, MOST + 1):
        pulled = RELAXED * ((h + weight * (x - u)) @ inverse) + (1.0 - RELAXED) * x + u
        x = project(pulled)
        u = pulled - x
        if count % LOOK == 0 or count == MOST:
            off = xp.max(xp.abs(x - project(x - step * (x @ matrix - h))), axis=1)
            solved = off <= SOLVED * xp.max(xp.abs(x), axis=1)
            if bool(xp.all(solved)):
                break
    return x, solved


def pulled_back(
    hessian: npt.ArrayLike, linear: npt.ArrayLike, solution: npt.ArrayLike, gradient: npt.ArrayLike, cone: Cone
) -> Floats:
    """Gradients (*batch, n) with respect to ``linear`` of a function whose gradients with respect to the minimisers
    are ``gradient``.

    The gradient with respect to the Hessian is minus the symmetric part of the outer product of this result with the
    solution.
    """
    h = np.asarray(linear, dtype=np.float64)
    x, g = (np.broadcast_to(np.asarray(v, dtype=np.float64), h.shape) for v in (solution, gradient))
    c = len(cone.components)
    scale = cone.scales[:, None]
    out = np.empty_like(h)
    with few_threads(h.shape[-1]):
        for matrix, where in _shared(hessian, h):
            quadratic = Formed(matrix)
            if (cone.scales != 1.0).any():
                quadratic = quadratic.scaled(cone.scales)
            step = step_sizes(quadratic, c)
            for i in where:
                if not np.isfinite(x[i]).all() or not np.isfinite(g[i]).all():
                    out[i] = np.nan
                    continue
                u = x[i].reshape(c, -1) / scale
                v = u - step * (quadratic.product(u) - h[i].reshape(c, -1) * scale)
                face, factor = factored(quadratic, cone, v, step)
                right = face.rotate(g[i].reshape(c, -1) * scale).ravel()[face.index]
                found = np.zeros(u.size)
                found[face.index] = factor.solve(right)
                out[i] = (face.unrotate(found.reshape(u.shape)) * scale).ravel()
    return out


def _shared(hessian: npt.ArrayLike, linear: Floats) -> list[tuple[Floats, list[tuple[int, ...]]]]:
    """Each distinct Hessian, with the indices of its problems."""
    matrix = np.asarray(hessian, dtype=np.float64)
    n, batch = linear.shape[-1], linear.shape[:-1]
    lead = (1,) * (len(batch) - matrix.ndim + 2) + matrix.shape[:-2]
    matrix = matrix.reshape(*lead, n, n)
    found: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    for i in np.ndindex(*batch):
        found.setdefault(tuple(j if m > 1 else 0 for j, m in zip(i, lead)), []).append(i)
    return [(np.ascontiguousarray(matrix[key]), where) for key, where in found.items()]
