"""An interior-point method for the quadratic programs of `palpate.inverse.constrained.cone`, used where Newton's
method cycles.

    minimise 1/2 x'Hx - h'x   with  x_i in K,    so that   s = Hx - h in K,   x_i's_i = 0  for every cell i,

where K is the second-order cone |q| <= p, or the half-space p >= 0. Both x and s stay inside while their product falls
to zero, along the direction of Y. E. Nesterov and M. J. Todd (SIAM J. Optim. 8, 1998, 324-364) with predictor and
corrector (S. Mehrotra, SIAM J. Optim. 2, 1992, 575-601; for these cones L. Vandenberghe, The CVXOPT linear and
quadratic cone program solvers, 2010). In the eigenvectors of the scaling of a cell, H only gains a diagonal, so that
each step needs one factor of H with all directions free. It takes 15 to 20 steps for any contact, including deep
taxels under friction, where Newton's method changes the set of sliding cells in every step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.faces import Face, slanted, straight

if TYPE_CHECKING:
    from palpate.inverse.constrained.factors import Factor
    from palpate.inverse.constrained.quadratic import Quadratic

__all__ = ["GAP", "STEPS", "interior"]

#: Tolerance of the objective (relative) and of the largest entry of the gradient: Newton's method then needs two more
#: steps.
GAP = 1e-8
#: Most steps; 15 to 20 are usual.
STEPS = 40
#: The iteration fails if neither residual nor gap has decreased by the factor SMALLER in PATIENCE steps. From a start that
#: is far too large the gap falls with the objective, so that their ratio stays.
SMALLER, PATIENCE = 0.99, 8
#: Tolerance of the gradient, as a part of that of the traction. Products leave a residual of single precision, while the gap
#: would fall for ever: then FEWER steps without progress are enough.
RESIDUAL, FEWER = 1e-2, 2
#: Distance of the start from the boundary, as a fraction of the largest pressure and of the largest gradient; and the
#: fraction of the way to the boundary that a step may go.
INSIDE, NEAR = 0.1, 0.99
#: Avoids division by zero.
_TINY = 1e-300


class Projecting(Protocol):
    """Interface to the set of a cell's tractions; `palpate.inverse.constrained.cone.Cone` implements it."""

    @property
    def coupled(self) -> bool: ...
    def project(self, x: Floats) -> Floats: ...


def interior(
    hessian: Quadratic, linear: Floats, cone: Projecting, start: Floats, tolerance: float = 0.0
) -> tuple[Floats, bool]:
    """The minimiser (component, cell) over a standard cone, starting near ``start``, and whether the iteration
    converged.

    ``tolerance`` is that of `palpate.inverse.constrained.cone.minimise` for traction; the tolerance of the objective
    is its square, that of the gradient a part of it (`RESIDUAL`); both are at least `GAP`.
    """
    goal, accuracy = max(GAP, tolerance * abs(tolerance)), max(GAP, tolerance * RESIDUAL)
    kind = _Second if cone.coupled else _Half
    x = cone.project(start)
    gradient = hessian.product(x) - linear
    largest = max(float(np.abs(linear).max()), _TINY)
    x[-1] += INSIDE * max(float(x[-1].max()), largest / float(hessian.diagonal().max()))
    s = kind.slack(cone, gradient)
    s[-1] += INSIDE * float(np.abs(gradient).max()) + 1e-12 * largest
    best, least, narrowest, since = x, np.inf, np.inf, 0
    # Factors from products may diverge: reject overflow.
    with np.errstate(all="ignore"):
        for _ in range(STEPS):
            give_way()
            dual = hessian.product(x) - linear - s
            gap = float(kind.product(x, s).sum())
            worth = abs(0.5 * float((x * (dual + s - linear)).sum()))
            # How many times too large the gap and the residual are.
            apart, missed = gap / max(worth, _TINY) / goal, float(np.abs(dual).max()) / largest / accuracy
            left = max(apart, missed)
            if not np.isfinite(left):
                break
            if left < SMALLER * least:
                best, least, since = x, left, 0
            else:
                since = 0 if gap < SMALLER * narrowest and apart > missed else since + 1
            narrowest = min(narrowest, gap)
            if left <= 1.0 or since > (PATIENCE if apart > missed else FEWER):
                break
            scaling = kind(x, s)
            factor = hessian.factor(scaling.face, scaling.more)
            ahead, beside = _step(scaling, factor, dual, -scaling.point)
            length = min(1.0, kind.room(x, ahead), kind.room(s, beside))
            reached = float(kind.product(x + length * ahead, s + length * beside).sum())
            centre = min(max(reached / max(gap, _TINY), 0.0), 1.0) ** 3
            ahead, beside = _step(scaling, factor, dual, scaling.corrected(ahead, beside, centre * gap / x.shape[1]))
            length = min(1.0, NEAR * min(kind.room(x, ahead), kind.room(s, beside)))
            if not (length > 0 and np.isfinite(ahead).all() and np.isfinite(beside).all()):
                break
            x, s = x + length * ahead, s + length * beside
    return best, least <= 1.0


def _step(scaling: _Second | _Half, factor: Factor, dual: Floats, target: Floats) -> tuple[Floats, Floats]:
    """The changes of x and s that remove the residual of H (``dual``) and bring their product to ``target``."""
    right = scaling.face.rotate(scaling.back(target) - dual)
    moved = scaling.face.unrotate(factor.solve(right.ravel()).reshape(right.shape))
    return moved, scaling.back(target - scaling.back(moved))


class _Second:
    """Scaling of second-order cones at x, s: W s = W^-1 x in every cell."""

    def __init__(self, x: Floats, s: Floats) -> None:
        c, n = x.shape
        size_x, size_s = np.sqrt(_inside(x)), np.sqrt(_inside(s))
        along = s / size_s
        along[:-1] *= -1.0
        along += x / size_x
        # Unit vector of the scaling: p^2 - q^2 = 1.
        along /= np.sqrt(_inside(along))
        self.along, self.size = along, np.sqrt(size_x / size_s)
        length = np.sqrt((along[:-1] ** 2).sum(axis=0))
        unit = np.where(length > 0, -along[:-1] / np.where(length > 0, length, 1.0), 0.0)
        unit[0, length == 0] = 1.0
        self.more: Floats = np.ones((c, n))
        self.more[0] = (along[-1] + length) ** 2
        self.more[1] = 1.0 / self.more[0]
        self.more = (self.more / self.size**2).ravel()
        self.face = Face(slanted(unit), np.ones((c, n)), True)
        self.point = self._times(s)

    @staticmethod
    def slack(cone: Projecting, gradient: Floats) -> Floats:
        return cone.project(gradient)

    @staticmethod
    def product(x: Floats, s: Floats) -> Floats:
        return np.asarray((x * s).sum(axis=0))

    def _times(self, v: Floats, sign: float = 1.0) -> Floats:
        """W v, or W^-1 v."""
        shear, pressure = sign * self.along[:-1], self.along[-1]
        dot = (shear * v[:-1]).sum(axis=0)
        out = np.empty_like(v)
        out[-1] = pressure * v[-1] + dot
        out[:-1] = v[:-1] + shear * (v[-1] + dot / (1.0 + pressure))
        return out * self.size if sign > 0 else out / self.size

    def back(self, v: Floats) -> Floats:
        return self._times(v, -1.0)

    def corrected(self, ahead: Floats, beside: Floats, centre: float) -> Floats:
        """The target of the second step: minus the second order of the products, plus their mean ``centre``."""
        right = -_arrow(self.point, self.point) - _arrow(self.back(ahead), self._times(beside))
        right[-1] += centre
        # Inverse of the arrow product.
        shear, pressure = self.point[:-1], self.point[-1]
        top = (pressure * right[-1] - (shear * right[:-1]).sum(axis=0)) / _inside(self.point)
        return np.concatenate([(right[:-1] - top * shear) / pressure, top[None]])

    @staticmethod
    def room(x: Floats, d: Floats) -> float:
        """How far x can go along d before it leaves the cone: the first root of p^2 - q^2."""
        a = d[-1] ** 2 - (d[:-1] ** 2).sum(axis=0)
        b = x[-1] * d[-1] - (x[:-1] * d[:-1]).sum(axis=0)
        c = _inside(x)
        root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
        met = (b**2 >= a * c) & ((a < 0) | (b < 0))
        with np.errstate(divide="ignore", invalid="ignore"):
            # Of the two formulas for the root, use the one without cancellation.
            first = np.where(b < 0, c / (root - b), (-b - root) / a)
        return float(np.where(met & (first > 0), first, np.inf).min())


class _Half:
    """The same scaling for p >= 0, with shear free or absent."""

    def __init__(self, x: Floats, s: Floats) -> None:
        c, n = x.shape
        self.size = np.sqrt(x[-1] / s[-1])
        self.more: Floats = np.zeros((c, n))
        self.more[-1] = 1.0 / self.size**2
        self.more = self.more.ravel()
        self.face = Face(straight(n, c), np.ones((c, n)), False)
        self.point: Floats = np.zeros((c, n))
        self.point[-1] = np.sqrt(x[-1] * s[-1])

    @staticmethod
    def slack(cone: Projecting, gradient: Floats) -> Floats:
        out = np.zeros_like(gradient)
        out[-1] = np.maximum(gradient[-1], 0.0)
        return out

    @staticmethod
    def product(x: Floats, s: Floats) -> Floats:
        return np.asarray(x[-1] * s[-1])

    def back(self, v: Floats) -> Floats:
        out = np.zeros_like(v)
        out[-1] = v[-1] / self.size
        return out

    def corrected(self, ahead: Floats, beside: Floats, centre: float) -> Floats:
        out = np.zeros_like(self.point)
        out[-1] = (centre - ahead[-1] * beside[-1]) / self.point[-1] - self.point[-1]
        return out

    @staticmethod
    def room(x: Floats, d: Floats) -> float:
        falling = d[-1] < 0
        return float((-x[-1][falling] / d[-1][falling]).min(initial=np.inf))


def _inside(x: Floats) -> Floats:
    """p^2 - q^2 of each cell: positive inside the cone."""
    size = np.sqrt((x[:-1] ** 2).sum(axis=0))
    return np.asarray(np.maximum((x[-1] - size) * (x[-1] + size), _TINY))


def _arrow(a: Floats, b: Floats) -> Floats:
    """The product of the cone's algebra, (p q' + p' q, x'x')."""
    return np.concatenate([a[-1] * b[:-1] + b[-1] * a[:-1], (a * b).sum(axis=0)[None]])
