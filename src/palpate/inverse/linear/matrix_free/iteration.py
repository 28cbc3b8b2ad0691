"""Preconditioned conjugate gradients for several frames at once, each with its own parameter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats

__all__ = ["Solved", "solve"]

#: Iterations after which the residual is worked out anew, so that rounding does not pass for convergence.
RESTARTS = 3


class Solved(NamedTuple):
    """Solutions (frame, n), their residuals over the right sides (frame,), and the products that were made."""

    rows: Floats
    residual: Floats
    products: int

    def reached(self, tolerance: float) -> npt.NDArray[np.bool_]:
        """Whether each frame reached the tolerance."""
        return np.asarray(self.residual <= tolerance)


def solve(
    product: Callable[[Floats], Floats],
    inverse: Callable[[Floats, Any], Floats],
    right: Floats,
    parameter: Floats,
    *,
    tolerance: float,
    most: int,
    start: Floats | None = None,
) -> Solved:
    """(M + lambda) u = right (frame, n) for each frame's ``parameter`` (frame,).

    M. R. Hestenes, E. Stiefel, J. Res. Natl. Bur. Stand. 49, 1952, 409-436. ``inverse(rows, which frames)`` is about (M + lambda)^{-1}, symmetric and
    positive definite. The residual that is returned is worked out from the solution.
    """
    size = _length(right)
    safe = np.where(size > 0, size, 1.0)
    out = np.zeros_like(right) if start is None else np.array(start)
    products = 0
    residual: Any = np.zeros(len(right))
    r: Floats
    open_ = np.flatnonzero(size > 0)
    out[size == 0] = 0.0
    for _ in range(RESTARTS):
        if not open_.size:
            break
        x, lam = out[open_], parameter[open_, None]
        if products or start is not None:
            r = right[open_] - product(x) - lam * x
            products += len(open_)
            residual[open_] = _length(r) / safe[open_]
            going = residual[open_] > tolerance
            if not going.any() or products > most * len(right):
                break
            open_, x, r, lam = open_[going], x[going], r[going], lam[going]
        else:
            r = right[open_].copy()
        steps = _descend(product, inverse, x, r, lam, open_, tolerance * safe[open_], most)
        out[open_] = x
        products += steps
    else:
        if open_.size:
            r = right[open_] - product(out[open_]) - parameter[open_, None] * out[open_]
            residual[open_] = _length(r) / safe[open_]
    return Solved(out, residual, products)


def _length(rows: Floats) -> Any:
    return np.sqrt(np.einsum("fn,fn->f", rows, rows))


def _descend(
    product: Callable[[Floats], Floats],
    inverse: Callable[[Floats, Any], Floats],
    x: Floats,
    r: Floats,
    lam: Floats,
    frames: npt.NDArray[np.intp],
    goal: Floats,
    most: int,
) -> int:
    """Improve ``x`` (frame, n) in place; returns products made."""
    here = np.arange(len(x))
    r_here, lam_here, goal_here = r, lam, goal
    z = inverse(r_here, frames[here])
    direction = z.copy()
    rz = np.einsum("fn,fn->f", r_here, z)
    products = 0
    for _ in range(most):
        moved = product(direction)
        moved += lam_here * direction
        products += len(here)
        curvature = np.einsum("fn,fn->f", direction, moved)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(curvature > 0, rz / curvature, 0.0)[:, None]
        x[here] += step * direction
        r_here = r_here - step * moved
        # a curvature that is not positive is rounding: nothing more is to be had
        going = (_length(r_here) > goal_here) & (step[:, 0] > 0)
        if not going.all():
            here, r_here, lam_here, goal_here = here[going], r_here[going], lam_here[going], goal_here[going]
            direction, rz = direction[going], rz[going]
            if not len(here):
                break
        z = inverse(r_here, frames[here])
        new = np.einsum("fn,fn->f", r_here, z)
        direction = z + (new / rz)[:, None] * direction
        rz = new
    return products
