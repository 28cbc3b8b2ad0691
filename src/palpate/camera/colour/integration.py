"""Integrate slopes to depth: the surface with the weighted least-squares fit to the slopes (a weighted Poisson
equation).

Minimise over u the sum over neighbours of w (u_b - u_a - g . (x_b - x_a))^2, by conjugate gradients. The
preconditioner solves the equation with equal weights by cosine transforms (D. C. Ghiglia, L. A. Romero, J. Opt. Soc.
Am. A 11, 1994, 107-117). The edge of the picture is free, so that depth is undetermined by a constant, which is chosen
so that the median along the edge is zero.
"""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["integrate"]

#: Relative residual at which the iteration stops, a hundredth of the error of slopes; and largest number of steps (one
#: suffices for equal weights).
TOLERANCE, MOST = 1e-5, 600


def integrate(slopes: Floats, weight: Floats, places: Floats) -> Floats:
    """Depth (*more, row, column) [m] from slopes (*more, 2, row, column), with ``weight`` (row, column) and ``places``
    (2, row, column) [m].

    Raises
    ------
    InvalidInput
        Weights so uneven that the iteration does not converge.
    """
    lead = slopes.shape[:-3]
    flat = slopes.reshape(-1, *slopes.shape[-3:])
    steps = [np.diff(places, axis=axis) for axis in (1, 2)]
    weights = [_between(weight, axis) for axis in (0, 1)]
    top = max(float(w.max(initial=0.0)) for w in weights)
    if not top > 0:
        return np.zeros((*lead, *slopes.shape[-2:]))
    weights = [w / top for w in weights]
    out = []
    for part in flat:
        wanted = []
        for axis, step in enumerate(steps):
            mean = 0.5 * (
                part.take(range(1, part.shape[1 + axis]), 1 + axis)
                + part.take(range(part.shape[1 + axis] - 1), 1 + axis)
            )
            wanted.append((mean * step).sum(axis=0))
        depth = _solved(weights, wanted)
        edge = np.concatenate([depth[0], depth[-1], depth[:, 0], depth[:, -1]])
        out.append(depth - np.median(edge))
    return np.stack(out).reshape(*lead, *slopes.shape[-2:])


def _between(weight: Floats, axis: int) -> Floats:
    """Weight of the difference of two neighbours: the smaller of their weights."""
    n = weight.shape[axis]
    return np.asarray(np.minimum(weight.take(range(1, n), axis), weight.take(range(n - 1), axis)))


def _spread(weights: list[Floats], values: list[Floats]) -> Floats:
    """Transpose of the weighted differences."""
    rows, columns = weights[0].shape[0] + 1, weights[0].shape[1]
    out = np.zeros((rows, columns))
    down, across = weights[0] * values[0], weights[1] * values[1]
    out[1:] += down
    out[:-1] -= down
    out[:, 1:] += across
    out[:, :-1] -= across
    return out


def _solved(weights: list[Floats], wanted: list[Floats]) -> Floats:
    from scipy.fft import dctn, idctn

    right = _spread(weights, wanted)
    rows, columns = right.shape
    eigen = (
        4.0 - 2.0 * np.cos(np.pi * np.arange(rows) / rows)[:, None] - 2.0 * np.cos(np.pi * np.arange(columns) / columns)
    )
    eigen[0, 0] = np.inf

    def precondition(r: Floats) -> Floats:
        return np.asarray(idctn(dctn(r, norm="ortho") / eigen, norm="ortho"))

    depth = np.zeros_like(right)
    residual = right - right.mean()
    size = float(np.linalg.norm(residual))
    if size == 0.0:
        return depth
    z = precondition(residual)
    direction, rho = z, float((residual * z).sum())
    for _ in range(MOST):
        along = _spread(weights, [np.diff(direction, axis=0), np.diff(direction, axis=1)])
        step = rho / float((direction * along).sum())
        depth += step * direction
        residual -= step * along
        if float(np.linalg.norm(residual)) <= TOLERANCE * size:
            return depth
        z = precondition(residual)
        new = float((residual * z).sum())
        direction = z + (new / rho) * direction
        rho = new
    raise InvalidInput(
        f"the slopes of {rows} x {columns} pixels were not integrated within {MOST} steps: most of the picture is masked. Clean the gel, or take pictures that are not saturated."
    )
