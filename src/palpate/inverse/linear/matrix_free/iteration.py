"""Preconditioned conjugate gradients for several frames at once, each with its own parameter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg.blas import daxpy, saxpy

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.preconditioner import BalancedInverse

__all__ = ["Solved", "solve"]

#: Rounds of iterative refinement in double precision.
CYCLES = 8
#: In single precision, which is twice as fast, a cycle reduces its residual to this fraction.
SINGLE = 3e-5
#: If a cycle in single precision gains less than this factor, the next one uses double precision.
GAIN = 10.0


class Solved(NamedTuple):
    """Solutions (frame, n); their residuals relative to the right sides (frame,); number of products; coefficients of
    the traction, if solved by these (`palpate.inverse.linear.matrix_free.spaces.OnSurface`); and, unless checked, the
    residual vectors (frame, n).
    """

    rows: Floats
    residual: Floats
    products: int
    source: Floats | None = None
    rest: Floats | None = None


def solve(
    product: Callable[[Any], Any],
    inverse: Callable[[Any, Any], Any],
    right: Floats,
    parameter: Floats,
    *,
    tolerance: float | Floats,
    most: int,
    start: Floats | None = None,
    checked: bool = True,
    energy: bool = False,
) -> Solved:
    """Solve (M + lambda) u = right (frame, n) with each frame's ``parameter`` (frame,).

    M. R. Hestenes, E. Stiefel, J. Res. Natl. Bur. Stand. 49, 1952, 409-436. ``inverse(rows, which frames)``
    approximates (M + lambda)^{-1} and is symmetric and positive definite; it and ``product`` keep the precision of
    rows. Steps use single precision, and the residual is recomputed in double precision (iterative refinement: J. H.
    Wilkinson, Rounding Errors in Algebraic Processes, 1963). The returned residual is recomputed from the solution if
    ``checked``; otherwise it is that of the steps. With ``energy``, residuals r are measured by approximately r^T (M +
    lambda)^{-1} r, for problems whose parts differ in scale.
    """

    def length(rows: Any, frames: npt.NDArray[np.intp]) -> Floats:
        return np.sqrt(np.maximum(_products(rows, inverse(rows, frames) if energy else rows), 0.0))

    size = length(right, np.arange(len(right)))
    safe = np.where(size > 0, size, 1.0)
    out = np.zeros_like(right) if start is None else np.array(start)
    out[size == 0] = 0.0
    residual: Any = np.where(size > 0, 1.0, 0.0)
    before = np.full(len(right), np.inf)
    double = np.zeros(len(right), dtype=bool)
    spent, products = np.zeros(len(right), dtype=int), 0
    open_ = np.flatnonzero(size > 0)
    fresh, rest = start is None, None if checked else np.zeros_like(right)
    tolerance = np.broadcast_to(tolerance, size.shape)
    for _ in range(CYCLES):
        if not open_.size:
            break
        if fresh:
            r = right[open_]
        else:
            r = right[open_] - product(out[open_]) - parameter[open_, None] * out[open_]
            products += len(open_)
            residual[open_] = length(r, open_) / safe[open_]
            if rest is not None:
                rest[open_] = r
            # Stop at rounding, when double precision gains no more.
            going = (residual[open_] > tolerance[open_]) & (spent[open_] < most)
            going &= ~(double[open_] & (residual[open_] > 0.5 * before[open_]))
            double[open_] |= residual[open_] * GAIN > before[open_]
            before[open_] = residual[open_]
            open_, r = open_[going], r[going]
            if not open_.size:
                break
        fresh = False
        goal = tolerance[open_] / residual[open_]
        for precise in (False, True):
            here = np.flatnonzero(double[open_] == precise)
            if not here.size:
                continue
            frames = open_[here]
            kind = np.float64 if precise else np.float32
            scale = np.sqrt(_products(r[here], r[here]))[:, None]
            least = goal[here] if precise else np.maximum(goal[here], SINGLE)
            steps, made, left, kept = _descend(
                product, inverse, (r[here] / scale).astype(kind), parameter[frames], frames, least, most, energy
            )
            out[frames] += scale * steps
            spent[frames] += made
            products += int(made.sum())
            if rest is not None:
                residual[frames] *= left
                rest[frames] = scale * kept
        if not checked:
            break
    else:
        if open_.size:
            r = right[open_] - product(out[open_]) - parameter[open_, None] * out[open_]
            residual[open_] = length(r, open_) / safe[open_]
    return Solved(out, residual, products, rest=rest)


def _descend(
    product: Callable[[Any], Any],
    inverse: Any,
    right: Any,
    parameter: Floats,
    frames: npt.NDArray[np.intp],
    goal: Floats,
    most: int,
    energy: bool,
) -> tuple[Any, npt.NDArray[np.intp], Floats, Any]:
    """Solve for right sides of length 1 until the residuals fall to ``goal``: solutions, number of steps, residuals
    (frame,), residual vectors.
    """
    steps, left = np.zeros(len(right), dtype=int), np.ones(len(right))
    here = np.arange(len(right))
    lam = parameter[:, None].astype(right.dtype)
    first: Any = 0.0
    if isinstance(inverse, BalancedInverse) and right.dtype == np.float32:
        # solve the exact part first; it stays solved
        x, r = inverse.begin(right, frames)
        first, inverse = _products(right, x), inverse.within
    else:
        x, r = np.zeros_like(right), right.copy()
    rest = r.copy()
    z = inverse(r, frames)
    direction, rz = z, _products(r, z)
    first = np.maximum(first + rz, 1e-300)
    for _ in range(most):
        give_way()
        moved = product(direction)
        for m, part, d in zip(moved, lam, direction):
            _add(m, part[0], d)
        steps[here] += 1
        curvature = _products(direction, moved)
        # A curvature that is not positive is due to rounding: stop.
        positive = (curvature > 0) & (rz > 0)
        step = np.where(positive, rz / np.where(positive, curvature, 1.0), 0.0)
        for i, frame in enumerate(here):
            _add(x[frame], step[i], direction[i])
            _add(r[i], -step[i], moved[i])
        if energy:
            z = inverse(r, frames[here])
            left[here] = np.sqrt(np.maximum(_products(r, z), 0.0) / first[here])
        else:
            left[here] = np.sqrt(_products(r, r))
        going = (left[here] > goal[here]) & positive
        if not going.all():
            rest[here[~going]] = r[~going]
            here, r, lam, direction, rz = here[going], r[going], lam[going], direction[going], rz[going]
            z = z[going] if energy else z
            if not here.size:
                break
        if not energy:
            z = inverse(r, frames[here])
        new = _products(r, z)
        for i, part in enumerate(new / rz):
            _add(z[i], part, direction[i])
        direction, rz = z, new
    else:
        rest[here] = r
    return x, steps, left, rest


def _add(to: Any, factor: float, row: Any) -> None:
    """to += factor row, by BLAS, in place."""
    (saxpy if to.dtype == np.float32 else daxpy)(row, to, a=factor)


def _products(a: Any, b: Any) -> Floats:
    """Dot products a_f b_f of each frame by BLAS, which limits the rounding errors of single precision."""
    return np.array([float(np.dot(x, y)) for x, y in zip(a, b)])
