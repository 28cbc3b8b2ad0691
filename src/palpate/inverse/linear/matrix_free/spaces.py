"""The space of the unknowns: readings, or traction if the readings are not on a lattice.

Both solve (M + lambda) u = y and have an approximate spectrum. `OnArray` preconditions by the lattice of a regular
array. `OnSurface`, for scattered positions, solves (H^T H + lambda) v = H^T y for the traction's sine coefficients v,
in which its prior is white, and sets u = (y - H v)/lambda. In sines H^T H is nearly diagonal: the influence of a cell
times the number of positions per cell.
"""

from __future__ import annotations

import abc
import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.linear.lumps import lumps
from palpate.inverse.linear.matrix_free.iteration import Solved, solve
from palpate.inverse.linear.matrix_free.lattice import Inverse
from palpate.inverse.linear.matrix_free.normal import Normal
from palpate.inverse.linear.matrix_free.preconditioner import Balanced, LongestCosines, LongestSines, approximation
from palpate.inverse.linear.priors import DifferencePrior
from palpate.sensing.maps import kernel_of
from palpate.sensing.operator import Convolution

__all__ = ["OnArray", "OnSurface", "Space", "Sums", "space"]


class Sums(NamedTuple):
    """For sums w^T t (row,), with u = (M + lambda)^{-1} H W w: w^T W w - u^T H W w, u^T u and, if requested, u^T (M +
    lambda)^{-1} u.
    """

    left: Floats
    size: Floats
    cross: Floats | None


class Space(abc.ABC):
    """A way to solve the system, with an approximate spectrum: ``eigenvalues`` (n,) and their multiplicities ``counts``."""

    normal: Normal
    eigenvalues: Floats
    counts: Floats
    #: Approximate largest eigenvalue of M.
    largest: float
    #: Whether the unknowns are readings: the squared coefficients of a row then add up to its squared length, so that
    #: approximate sums can be compared with their exact means, and the error of `forms` is the square of the residuals.
    of_readings: bool
    #: The start parameter, if the approximation is too coarse to choose one.
    first: float | None

    @property
    @abc.abstractmethod
    def nbytes(self) -> int:
        """Memory in bytes."""

    @abc.abstractmethod
    def powers(self, rows: Floats) -> Floats:
        """Squared coefficients (frame, n) of rows."""

    @abc.abstractmethod
    def solve(
        self,
        rows: Floats,
        parameter: Floats,
        *,
        tolerance: float | Floats,
        most: int,
        start: Floats | None = None,
        checked: bool = True,
    ) -> Solved:
        """(M + lambda)^{-1} rows, see `palpate.inverse.linear.matrix_free.iteration.solve`."""

    @abc.abstractmethod
    def traction(self, solved: Solved) -> Floats:
        """W H^T u: (frame, component sought, *surface)."""

    def estimate(
        self, rows: Floats, parameter: Floats, *, tolerance: float | Floats, most: int, start: Floats | None
    ) -> tuple[Solved, Floats]:
        """Solutions, checked, and their traction."""
        solved = self.solve(rows, parameter, tolerance=tolerance, most=most, start=start)
        return solved, self.traction(solved)

    def forms(self, rows: Floats, parameter: Floats, solved: Solved) -> tuple[Floats, Floats]:
        """y^T u and u^T u (frame,) for ``rows`` y, as accurately as the solutions allow."""
        return (rows * solved.rows).sum(axis=1), (solved.rows**2).sum(axis=1)

    @abc.abstractmethod
    def sums(self, rows: Floats, parameter: Floats, *, tolerance: float, most: int, slopes: bool) -> Sums:
        """See `Sums`, for sums ``rows`` w (row, component sought, *surface) of the traction, with one parameter each."""


def space(normal: Normal) -> Space:
    """The space that suits the layout."""
    regular = all(isinstance(p, Convolution) for p in normal.operator.planes)
    return OnArray(normal) if regular else OnSurface(normal)


#: Accept a solution whose checked residual exceeds the tolerance by at most this factor: the difference is rounding.
REACHED = 2.0
#: Smaller residuals need double precision.
SINGLE = 1e-6


class OnArray(Space):
    """The readings of a regular array: preconditioned by its lattice, with the longest waves solved exactly."""

    def __init__(self, normal: Normal) -> None:
        self.normal = normal
        self.approximate = approximation(normal)
        self._balanced = Balanced(normal.apply, LongestCosines(normal), self.approximate.at)
        self.eigenvalues, self.counts = self.approximate.eigenvalues, self.approximate.counts
        self.largest = self._balanced.largest
        # The approximation takes missing readings for edges, and these for signal.
        self.first = (
            _safe(self.eigenvalues, self.counts, self.largest, normal.count) if normal.valid is not None else None
        )
        self.of_readings = True
        #: Root mean square of the eigenvalues.
        self._mean = math.sqrt(float(self.counts @ self.eigenvalues**2) / float(self.counts.sum()))

    @property
    def nbytes(self) -> int:
        return self.approximate.nbytes + self._balanced.nbytes

    def powers(self, rows: Floats) -> Floats:
        return self.approximate.powers(rows)

    def solve(
        self,
        rows: Floats,
        parameter: Floats,
        *,
        tolerance: float | Floats,
        most: int,
        start: Floats | None = None,
        checked: bool = True,
    ) -> Solved:
        return solve(
            self.normal.apply,
            self._balanced.at(parameter),
            rows,
            parameter,
            tolerance=tolerance,
            most=most,
            start=start,
            checked=checked,
        )

    def traction(self, solved: Solved) -> Floats:
        return self.normal.traction(solved.rows)

    def estimate(
        self, rows: Floats, parameter: Floats, *, tolerance: float | Floats, most: int, start: Floats | None
    ) -> tuple[Solved, Floats]:
        """As `Space.estimate`, checked by the readings of the traction."""
        size = np.linalg.norm(rows, axis=1)
        goal = np.broadcast_to(tolerance, size.shape)
        if start is None or float(goal.min()) < SINGLE:
            return super().estimate(rows, parameter, tolerance=tolerance, most=most, start=start)
        # The start is off by the uncertainty of the parameter; steps in single precision do the rest.
        kind = np.float32 if self._rounded(start, goal * size) else np.float64
        left = rows - self.normal.apply(start.astype(kind)) - parameter[:, None] * start
        near, there = np.linalg.norm(left, axis=1), size > 0
        part = np.where(near > 0, goal * size / np.where(near > 0, near, 1.0), 1.0)
        solved = self.solve(left, parameter, tolerance=np.minimum(part, 1.0), most=most, start=None, checked=False)
        out, residual, products = start + solved.rows, np.zeros(len(rows)), solved.products + len(rows)
        traction = self.normal.traction(out)
        # single precision suffices for a smooth traction
        left = rows - self.normal.readings(traction.astype(np.float32)) - parameter[:, None] * out
        residual[there] = np.linalg.norm(left, axis=1)[there] / size[there]
        more = np.flatnonzero(residual > REACHED * goal)
        if more.size:
            goal = goal[more]
            again = self.solve(rows[more], parameter[more], tolerance=goal, most=most, start=out[more], checked=True)
            out[more], residual[more] = again.rows, again.residual
            traction[more], products = self.traction(again), products + again.products
        return Solved(out, residual, products), traction

    def _rounded(self, rows: Floats, error: Floats) -> bool:
        """Whether rounding of M u in single precision is less than a fifth of ``error`` (frame,)."""
        return bool((2.0**-24 * self._mean * np.linalg.norm(rows, axis=1) < 0.2 * error).all())

    def forms(self, rows: Floats, parameter: Floats, solved: Solved) -> tuple[Floats, Floats]:
        """Quadratic forms to second order in the residuals r: y^T A^{-1} y = y^T u + u^T r + r^T A^{-1} r, and
        similarly for the square.
        """
        u, r = solved.rows, solved.rest
        first, second = super().forms(rows, parameter, solved)
        if r is None:
            return first, second
        inverse, frames = self._balanced.at(parameter), np.arange(len(rows))

        def solved_about(of: Floats) -> Floats:
            size = np.maximum(np.linalg.norm(of, axis=1, keepdims=True), 1e-300)
            return np.asarray(size * inverse((of / size).astype(np.float32), frames))

        near, moved = solved_about(r), solved_about(u)
        first += (u * r).sum(axis=1) + (near * r).sum(axis=1)
        second += 2.0 * (moved * r).sum(axis=1) + (near**2).sum(axis=1)
        return first, second

    def sums(self, rows: Floats, parameter: Floats, *, tolerance: float, most: int, slopes: bool) -> Sums:
        weighted = self.normal.covariance(rows)
        right = self.normal.readings(weighted)

        def inverse(of: Floats, part: float) -> Floats:
            return self.solve(of, parameter, tolerance=part, most=most, start=None, checked=True).rows

        u = inverse(right, tolerance)
        whole = (rows * weighted).reshape(len(rows), -1).sum(axis=1)
        size = (u**2).sum(axis=1)
        cross = (u * inverse(u, 1e-4)).sum(axis=1) if slopes else None
        return Sums(np.maximum(whole - (u * right).sum(axis=1), parameter * size), size, cross)


#: Number of the longest sines along each axis of a component that are solved exactly.
LONG_SINES = {2: 5, 1: 16}
#: Start the search at the parameter whose degrees of freedom are this fraction of the readings: solutions there take
#: few steps.
USED = 0.2
#: Factor on the tolerance if residuals are measured in the energy norm, where e has the square of the error.
ENERGY = 10.0


class OnSurface(Space):
    """The sine coefficients of the traction, with the longest waves solved exactly."""

    def __init__(self, normal: Normal) -> None:
        self.normal = normal
        #: Priors that are white in sines; other priors have no such root.
        self._priors = [p for p in normal.priors if isinstance(p, DifferencePrior)]
        if len(self._priors) < len(normal.priors):
            raise TypeError("sines need the prior of Tikhonov's method")
        self._shape = (len(normal.columns), *normal.operator.surface.shape)
        diagonal = self._modes().ravel()
        self.eigenvalues = np.maximum(diagonal, 1e-16 * float(diagonal.max()))
        #: Modes extend over the whole surface, readings only cover the positions.
        self.counts = np.full(self.eigenvalues.size, self._covered)
        few = LONG_SINES[len(self._shape) - 1]
        places = [range(self._shape[0]), *(range(min(few, n)) for n in self._shape[1:])]
        index = [np.ravel_multi_index(place, self._shape) for place in itertools.product(*places)]
        self._balanced = Balanced(self._product, LongestSines(index, self.eigenvalues.size), self._smooth)
        self.largest = self._balanced.largest
        self.of_readings = False
        self.first = _safe(self.eigenvalues, self.counts, self.largest, normal.count)

    @property
    def nbytes(self) -> int:
        return 2 * self.eigenvalues.nbytes + self._balanced.nbytes

    def powers(self, rows: Floats) -> Floats:
        """Squared coefficients (frame, n): those of H^T y divided by the eigenvalues, scaled so that their sum does
        not exceed |y|^2.
        """
        seen = self._back(rows) ** 2 / self.eigenvalues
        total, whole = seen.sum(axis=1), (rows**2).sum(axis=1)
        return np.asarray(seen * np.minimum(1.0, whole / np.where(total > 0, total, 1.0))[:, None])

    def solve(
        self,
        rows: Floats,
        parameter: Floats,
        *,
        tolerance: float | Floats,
        most: int,
        start: Floats | None = None,
        checked: bool = True,
    ) -> Solved:
        """(M + lambda)^{-1} rows; ``start`` is ignored, because it would have to be far more accurate than it is."""
        found = self._inverse(self._back(rows), parameter, tolerance, most, checked=checked)
        u = (rows - self._forth(found.rows)) / parameter[:, None]
        return Solved(u, found.residual, found.products, found.rows)

    def traction(self, solved: Solved) -> Floats:
        if solved.source is None:
            raise RuntimeError("what was solved elsewhere has no coefficients on the surface")
        return self._coloured(solved.source)

    def sums(self, rows: Floats, parameter: Floats, *, tolerance: float, most: int, slopes: bool) -> Sums:
        """As `Space.sums`: lambda x^T C^T w with x = (H^T H + lambda)^{-1} C^T w, and u = H x."""
        right = self._whitened(rows)
        x = self._inverse(right, parameter, tolerance, most, checked=True).rows
        u = self._forth(x)
        cross = None
        if slopes:
            again = self._inverse(x, parameter, 1e-4, most, checked=True).rows
            cross = (u * self._forth(again)).sum(axis=1)
        return Sums(parameter * (x * right).sum(axis=1), (u**2).sum(axis=1), cross)

    def _inverse(
        self, right: Floats, parameter: Floats, tolerance: float | Floats, most: int, *, checked: bool
    ) -> Solved:
        """(H^T H + lambda)^{-1} right."""
        return solve(
            self._product,
            self._balanced.at(parameter),
            right,
            parameter,
            tolerance=ENERGY * tolerance,
            most=most,
            checked=checked,
            energy=True,
        )

    def _product(self, v: Any) -> Any:
        """H^T H v."""
        return self._back(self._forth(v))

    def _smooth(self, parameter: Floats) -> Inverse:
        return lambda v, which: v / (self.eigenvalues + parameter[which, None]).astype(v.dtype)

    def _forth(self, v: Any) -> Any:
        """H v for coefficients in sines (frame, n)."""
        return self.normal.chunked(lambda some: self.normal.readings(self._coloured(some)), v)

    def _coloured(self, v: Any) -> Any:
        """C v: traction (frame, component sought, *surface)."""
        waves = v.reshape(len(v), *self._shape)
        return np.stack([p.coloured(waves[:, i]) for i, p in enumerate(self._priors)], axis=1)

    def _whitened(self, rows: Any) -> Any:
        """C^T w (row, n)."""
        parts = [p.root(rows[:, i]).reshape(len(rows), -1) for i, p in enumerate(self._priors)]
        return np.concatenate(parts, axis=1)

    def _back(self, rows: Any) -> Any:
        """H^T y."""
        return self.normal.chunked(lambda some: self._whitened(self.normal.seen(some)), rows)

    def _modes(self) -> Floats:
        """Approximate diagonal of H^T H in sines: positions per cell, times the influence of a cell, times the prior."""
        normal = self.normal
        grid = normal.operator.surface
        out: Any = np.zeros(self._shape)
        covered = []
        for p, (array, plane) in enumerate(zip(normal.operator.planes_of, normal.operator.planes)):
            points = array.points[array.valid.ravel()]
            extent = [max(float(np.ptp(points[:, a])), dx) for a, dx in enumerate(grid.spacings)]
            area = min(1.0, math.prod(e / (n * dx) for e, n, dx in zip(extent, grid.shape, grid.spacings)))
            covered.append(area)
            density = len(points) / (area * math.prod(grid.shape))
            kernel = kernel_of(plane, "a problem of so many readings")
            for c in range(len(array.channels)):
                waves = _sines(kernel[c][normal.columns], grid.shape)
                out = out + density * waves / normal.scale(p, c) ** 2
        self._covered = float(np.mean(covered))
        return np.asarray(out * np.stack([prior.in_sines for prior in self._priors]))


def _safe(eigenvalues: Floats, counts: Floats, largest: float, readings: int) -> float:
    """A parameter with few degrees of freedom."""
    nodes, weights = lumps(eigenvalues)
    trial = largest * 10.0 ** -np.arange(0.0, 16.0, 0.25)
    used = (nodes / (nodes + trial[:, None])) @ (weights @ counts)
    return float(trial[np.argmin(np.abs(used - USED * readings))])


def _sines(kernel: Floats, shape: Sequence[int]) -> Floats:
    """|transform|^2 (component, *surface) of influences (component, *lag) at the waves of sines over the surface."""
    from scipy.fft import rfftn

    for axis, n in enumerate(shape):
        size = 2 * (n + 1)
        count = kernel.shape[1 + axis]
        # lags as they come: a shift turns no more than the phase. Those beyond the size wrap round
        moved = np.moveaxis(kernel, 1 + axis, 0)
        whole = np.zeros((size, *moved.shape[1:]))
        np.add.at(whole, np.arange(count) % size, moved)
        kernel = np.moveaxis(whole, 0, 1 + axis)
    waves = np.abs(rfftn(kernel, axes=tuple(range(1, kernel.ndim)))) ** 2
    return np.asarray(waves[(slice(None), *(slice(1, n + 1) for n in shape))])
