"""Minima over the friction cone as functions of their problem: batches of them, and their derivatives by the implicit function theorem.

x = argmin 1/2 x'Hx - h'x over the cone solves x = P(x - d (Hx - h)). Where strict complementarity holds P is differentiable there: with the
eigenvectors W of its derivative that are kept (eigenvalue m > 0), which span the face that x lies on,

    dx = W (W'HW + diag((1 - m)/(m d)))^-1 W' (dh - dH x),

the second term being the curvature of the cone (`palpate.inverse.constrained.faces`). The map is symmetric: what pulls gradients back is the same.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from palpate._threads import few_threads
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone, minimise
from palpate.inverse.constrained.faces import Face
from palpate.inverse.constrained.quadratic import Formed

__all__ = ["minima", "pulled_back"]


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
            for i in where:
                if not np.isfinite(h[i]).all() or not np.isfinite(matrix).all():
                    out[i] = np.nan
                    continue
                found = minimise(quadratic, h[i].reshape(c, -1), cone)
                out[i] = found.traction.ravel() if found.converged else np.nan
    return out


def pulled_back(
    hessian: npt.ArrayLike, linear: npt.ArrayLike, solution: npt.ArrayLike, gradient: npt.ArrayLike, cone: Cone
) -> Floats:
    """Gradients (*batch, n) with respect to ``linear`` of something whose gradients with respect to the minimisers are ``gradient``.

    That with respect to the Hessian is minus the symmetric part of its outer product with the solution.
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
            step = c / np.maximum(quadratic.diagonal().reshape(c, -1).sum(axis=0), 1e-300)
            for i in where:
                if not np.isfinite(x[i]).all() or not np.isfinite(g[i]).all():
                    out[i] = np.nan
                    continue
                u = x[i].reshape(c, -1) / scale
                v = u - step * (quadratic.product(u) - h[i].reshape(c, -1) * scale)
                face = Face(*cone.directions(v), cone.coupled)
                curved = (
                    (1.0 - face.kept) / (face.kept * face.spread(step)) if cone.coupled else np.zeros(len(face.index))
                )
                right = face.rotate(g[i].reshape(c, -1) * scale).ravel()[face.index]
                found = np.zeros(u.size)
                if len(face.index):
                    found[face.index] = quadratic.factor(face, curved).solve(right)
                out[i] = (face.unrotate(found.reshape(u.shape)) * scale).ravel()
    return out


def _shared(hessian: npt.ArrayLike, linear: Floats) -> list[tuple[Floats, list[tuple[int, ...]]]]:
    """Each Hessian with the places of the problems that have it."""
    matrix = np.asarray(hessian, dtype=np.float64)
    n, batch = linear.shape[-1], linear.shape[:-1]
    lead = (1,) * (len(batch) - matrix.ndim + 2) + matrix.shape[:-2]
    matrix = matrix.reshape(*lead, n, n)
    found: dict[tuple[int, ...], list[tuple[int, ...]]] = {}
    for i in np.ndindex(*batch):
        found.setdefault(tuple(j if m > 1 else 0 for j, m in zip(i, lead)), []).append(i)
    return [(np.ascontiguousarray(matrix[key]), where) for key, where in found.items()]
