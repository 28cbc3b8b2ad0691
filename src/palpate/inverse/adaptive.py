"""method="adaptive": contact found from the readings alone, with nothing to tune.

What is known of contact before anything is measured: pressure never pulls, shear stays inside the friction cone, contact is
compact, and traction is smooth within it while it may jump at its edge. What is not known, the noise and how much traction
varies from place to place, is learned from the frame itself:

1. noise level and amplitude by marginal likelihood of the linear model (`palpate.inverse.parameter`); a frame that noise alone
   explains as well is reported as no contact;
2. the penalised problem with its constraints, solved exactly over the cells where contact is possible
   (`palpate.inverse.cone`), on a grid finer than the surface, because where in a cell an edge lies matters;
3. the penalty relearned from its own result: |grad t|^2 is weighed by 1/tau, where tau(x) is the local mean square
   gradient of the solution before. This is majorisation of log tau (M. Fazel, H. Hindi, S. Boyd, Proc. American Control Conf.
   2003, 2156-2162; with the posterior variance kept, the EM iteration of sparse Bayesian learning, M. E. Tipping, J. Mach.
   Learn. Res. 1, 2001, 211-244): edges become sharp where there are edges, the outside becomes quiet, the inside
   stays smooth;
4. the mean over weights of different reach, from none (step 2) to one cell, because one frame cannot say which is right: their
   spread is part of the error bar.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._arrays import from_numpy, to_numpy
from palpate.elastic.half_space import Floats
from palpate.errors import Unsupported
from palpate.inverse.cone import Cone, Solution, minimise
from palpate.inverse.parameter import tikhonov
from palpate.inverse.priors import DifferencePrior
from palpate.inverse.regularised import Regularised
from palpate.sensing.grids import AreaGrid, Grid, LineGrid
from palpate.sensing.operator import Operator

__all__ = ["Adaptive", "AdaptiveEstimate", "refined"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: Fine cells per surface cell and axis, on a line and on an area.
REFINEMENT = {1: 3, 2: 2}
#: Unknowns of one frame up to which the finer grid is used, and at all.
FINE_UNKNOWNS, LARGEST_UNKNOWNS = 3600, 9000
#: Gain in log evidence over noise alone below which a frame counts as empty.
CONTACT_EVIDENCE = 6.0
#: Reach of the local mean of |grad t|^2, in depths (0: one fine cell), and whether posterior variance is added.
MEMBERS: tuple[tuple[float, bool], ...] = ((1.0 / 3.0, False), (0.0, True))
#: Weights are relearned this many times.
ROUNDS = 5
#: Cells whose local scale tau is below this part of the largest are outside the contact.
QUIET = 1e-3
#: Smallest tau, as a part of the largest.
FLOOR = 1e-6


def refined(grid: Grid, ratio: int) -> Grid:
    """The same surface in cells ``ratio`` times finer along each axis."""
    if isinstance(grid, LineGrid):
        return LineGrid(count=grid.count * ratio, spacing=grid.spacing / ratio, center=grid.center)
    shape, spacings = grid.shape, grid.spacings
    return AreaGrid(
        shape=(shape[0] * ratio, shape[1] * ratio),
        spacing=(spacings[0] / ratio, spacings[1] / ratio),
        center=grid.center,
    )


@dataclass(frozen=True)
class AdaptiveEstimate:
    """One frame: traction (component, *surface), its covariance summary and how it went."""

    traction: Floats
    std: Floats
    force_std: Floats
    parameter: float
    noise_scale: float
    residual: float
    converged: bool
    contact: bool


class _Stencil:
    """Differences along each axis of a grid, traction being zero beyond its edge."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self.differences = []
        for axis, dx in enumerate(grid.spacings):
            factors = []
            for other, n in enumerate(grid.shape):
                if other == axis:
                    factors.append(scipy.sparse.diags_array([np.ones(n), -np.ones(n)], offsets=[0, -1], shape=(n + 1, n)) / dx)
                else:
                    factors.append(scipy.sparse.eye_array(n))
            product = factors[0]
            for factor in factors[1:]:
                product = scipy.sparse.kron(product, factor)
            self.differences.append(product.tocsr())

    def precision(self, weights: Sequence[Floats]) -> scipy.sparse.csr_array:
        """sum over edges of weight |difference|^2 cell, as a matrix over all cells."""
        total = None
        for d, w in zip(self.differences, weights):
            term = d.T @ scipy.sparse.diags_array(w.ravel() * self.grid.cell) @ d
            total = term if total is None else total + term
        return scipy.sparse.csr_array(total)

    def energy(self, squares: Sequence[Floats]) -> Floats:
        """Mean over the axes of squared differences on edges, brought to the cells."""
        total: Floats = np.zeros(self.grid.shape)
        for axis, s in enumerate(squares):
            n = self.grid.shape[axis]
            total = total + 0.5 * (s.take(range(n), axis=axis) + s.take(range(1, n + 1), axis=axis))
        return total / len(squares)

    def on_edges(self, cells: Floats) -> list[Floats]:
        """A field on cells brought to the edges of each axis."""
        out = []
        for axis in range(cells.ndim):
            width = [(0, 0)] * cells.ndim
            width[axis] = (1, 1)
            padded = np.pad(cells, width, mode="edge")
            n = cells.shape[axis]
            out.append(0.5 * (padded.take(range(n + 1), axis=axis) + padded.take(range(1, n + 2), axis=axis)))
        return out

    def edge_shape(self, axis: int) -> tuple[int, ...]:
        return tuple(n + (a == axis) for a, n in enumerate(self.grid.shape))


@dataclass
class _Level:
    """The operator on one grid."""

    operator: Operator
    stencil: _Stencil
    columns: tuple[int, ...]

    def matrix(self, cells: Index, noise: Floats) -> Floats:
        """Whitened columns (reading, component * cell)."""
        full = self.operator.columns(self.columns, cells)
        return np.asarray(full.reshape(len(full), -1) / noise[:, None])


class Adaptive:
    """The adaptive estimator, prepared once for an operator, the components sought and the constraints."""

    def __init__(self, operator: Operator, columns: Sequence[int], cone: Cone) -> None:
        self.cone, self.columns = cone, tuple(columns)
        if cone.free:
            raise Unsupported(
                'method="adaptive" lives on pressure that cannot pull: seek component z without tension, or use '
                'method="tikhonov".'
            )
        grid = operator.surface
        self.linear = Regularised(operator, [DifferencePrior(grid, 1)] * len(columns), columns, tikhonov, "evidence")
        self.scales = self.linear.scales
        self.coarse = _Level(operator, _Stencil(grid), self.columns)
        self.ratio = REFINEMENT[grid.dimensions]
        fine = refined(grid, self.ratio)
        self.fine = _Level(
            Operator(operator.pad, operator.planes_of, fine, operator.boundary), _Stencil(fine), self.columns
        )
        self.depth = max(min(a.depth for a in operator.planes_of), max(grid.spacings))
        self._rows = np.concatenate(
            [np.repeat(s, int(a.valid.sum())) for a, s in zip(operator.planes_of, self.scales)]
        )

    # -- one frame -----------------------------------------------------------------------------------------------------

    def frame(self, readings: Sequence[Floats]) -> AdaptiveEstimate:
        """Contact in one frame of readings, (channel, *array) per plane."""
        planes = self.coarse.operator.planes_of
        rows = self.coarse.operator.heard(readings)
        data = np.concatenate(
            [r.reshape(len(a.channels), -1)[:, a.valid.ravel()].ravel() for a, r in zip(planes, rows)]
        )
        estimate = self.linear.solve(rows)
        parameter, scale = float(np.ravel(estimate.parameter)[0]), float(np.ravel(estimate.noise_scale)[0])
        gain = self._gain(rows, parameter)
        if not (gain > CONTACT_EVIDENCE and scale > 0):
            return self._nothing(parameter, scale, data)
        noise = self._rows * scale
        y = data / noise
        weight = parameter / scale**2
        first = self._first(to_numpy(estimate.traction)[list(self.columns)], y, noise, weight)
        return self._second(first, y, noise, weight, parameter, scale)

    def _gain(self, rows: Sequence[Floats], parameter: float) -> float:
        """Log marginal likelihood of contact over that of noise alone."""
        values, counts = self.linear.spectrum.eigenvalues, self.linear.spectrum.multiplicity
        c2 = np.abs(to_numpy(self.linear.spectrum.project(rows)).astype(np.complex128)) ** 2 * counts
        ratio = values / parameter
        left, logdet = float((c2 / (1.0 + ratio)).sum()), float(counts @ np.log1p(ratio))
        total, m = float(c2.sum()), float(counts.sum())
        if total == 0.0:
            return 0.0
        if self.linear.noise_known:
            return 0.5 * (total - left - logdet)
        return 0.5 * (m * math.log(total / left) - logdet)

    def _nothing(self, parameter: float, scale: float, data: Floats) -> AdaptiveEstimate:
        shape = (len(self.coarse.operator.surface.components), *self.coarse.operator.surface.shape)
        residual = float(np.sqrt(np.mean((data / self._rows) ** 2)))
        zero = np.zeros(shape)
        return AdaptiveEstimate(zero, zero, np.zeros(shape[0]), parameter, scale, residual, True, False)

    def _first(self, linear: Floats, y: Floats, noise: Floats, weight: float) -> Floats:
        """The constrained solution on the surface grid (component, cell); cells are added until none is missing."""
        grid = self.coarse.operator.surface
        count = math.prod(grid.shape)
        precision = self.coarse.stencil.precision([np.full(self.coarse.stencil.edge_shape(a), weight) for a in range(grid.dimensions)])
        pressure = linear[-1]
        region = _grown(pressure > 0.15 * pressure.max(), 1).ravel()
        start = linear.reshape(len(linear), -1)
        for _ in range(12):
            cells = np.flatnonzero(region)
            self._check(len(cells) * len(self.columns))
            matrix = self.coarse.matrix(cells, noise)
            solution = self._minimise(matrix, precision, cells, y, start[:, cells])
            traction = np.zeros((len(self.columns), count))
            traction[:, cells] = solution.traction
            # a cell left out is missing if pressure there would lower the objective
            missing = self._misfit_gradient(matrix @ solution.traction.ravel() - y, noise)
            slope = missing - (precision @ traction.T).T
            pull = np.abs(self.cone.project(slope * self.cone.scales[:, None])[-1])
            pull[region] = 0.0
            reference = 1e-3 * float(np.abs(self._misfit_gradient(-y, noise)).max())
            wrong = pull > reference
            if not wrong.any():
                break
            region |= wrong
            start = traction
        return traction

    def _misfit_gradient(self, residual: Floats, noise: Floats) -> Floats:
        """A' N^-1 (y - A x) for every surface cell, (component, cell)."""
        parts, start = [], 0
        for array in self.coarse.operator.planes_of:
            working = int(array.valid.sum()) * len(array.channels)
            part = np.zeros((len(array.channels), array.valid.size))
            part[:, array.valid.ravel()] = (-residual / noise)[start : start + working].reshape(len(array.channels), -1)
            parts.append(part.reshape(len(array.channels), *array.shape))
            start += working
        adjoint = self.coarse.operator.adjoint(parts)
        return np.asarray(adjoint.reshape(len(adjoint), -1)[list(self.columns)])

    def _check(self, unknowns: int) -> None:
        if unknowns > LARGEST_UNKNOWNS:
            raise Unsupported(
                f"the contact covers {unknowns} unknowns, too many for method=\"adaptive\" (limit {LARGEST_UNKNOWNS}). Give a "
                'coarser surface (Skin(..., surface=...)), or use method="tikhonov".'
            )

    def _minimise(
        self,
        matrix: Floats,
        precision: scipy.sparse.csr_array | Sequence[scipy.sparse.csr_array],
        cells: Index,
        y: Floats,
        start: Floats,
        *,
        keep_face: bool = False,
    ) -> Solution:
        c, n = len(self.columns), len(cells)
        hessian = matrix.T @ matrix
        per_component = [precision] * c if isinstance(precision, scipy.sparse.csr_array) else list(precision)
        for i, q in enumerate(per_component):
            hessian[i * n : (i + 1) * n, i * n : (i + 1) * n] += q[cells][:, cells].toarray()
        return minimise(hessian, (matrix.T @ y).reshape(c, n), self.cone, start, keep_face=keep_face)

    def _second(
        self, first: Floats, y: Floats, noise: Floats, weight: float, parameter: float, scale: float
    ) -> AdaptiveEstimate:
        grid = self.coarse.operator.surface
        size = np.abs(first[-1]).reshape(grid.shape)
        region = _grown(size > 1e-3 * size.max(), 1)
        level, ratio = self.fine, self.ratio
        if int(region.sum()) * ratio**grid.dimensions * len(self.columns) > FINE_UNKNOWNS:
            level, ratio = self.coarse, 1
        cells = np.flatnonzero(_repeated(region, ratio))
        fine_grid = level.operator.surface
        count = math.prod(fine_grid.shape)
        start = np.stack([_repeated(t.reshape(grid.shape), ratio).ravel() for t in first])
        matrix = level.matrix(cells, noise)
        plain = level.stencil.precision([np.full(level.stencil.edge_shape(a), weight) for a in range(fine_grid.dimensions)])
        solution = self._minimise(matrix, plain, cells, y, start[:, cells], keep_face=True)
        converged = solution.converged
        summaries = [_summary(solution, cells, ratio, fine_grid, grid)]
        residuals = [matrix @ solution.traction.ravel() - y]
        for reach, keep_variance in MEMBERS:
            current, inside, columns = solution, cells, matrix
            width = max(reach * self.depth / min(fine_grid.spacings), 1.0)
            for _ in range(ROUNDS):
                tau = self._local_scales(level, current, inside, width, keep_variance)
                loud = tau.max(axis=0).ravel()
                pressure = current.traction[-1]
                keep = (loud[inside] > QUIET * loud.max()) | (pressure > QUIET * pressure.max())
                if not self.cone.coupled and len(self.columns) > 1:
                    # no shear outside contact
                    keep &= _grown(_scattered(current.traction[-1], inside, fine_grid.shape) > 0, 1).ravel()[inside]
                position = np.flatnonzero(keep)
                picks = (np.arange(len(self.columns))[:, None] * len(inside) + position[None, :]).ravel()
                columns, inside = columns[:, picks], inside[position]
                precisions = [
                    level.stencil.precision([1.0 / e / fine_grid.cell for e in level.stencil.on_edges(t)])
                    for t in np.maximum(tau, FLOOR * loud.max())
                ]
                current = self._minimise(
                    columns, precisions, inside, y, current.traction[:, position], keep_face=True
                )
            converged = converged and current.converged
            summaries.append(_summary(current, inside, ratio, fine_grid, grid))
            residuals.append(columns @ current.traction.ravel() - y)
        means = np.stack([s[0] for s in summaries])
        forces = np.stack([m.reshape(len(self.columns), -1).sum(axis=1) * grid.cell for m in means])
        variance = np.mean([s[1] for s in summaries], axis=0) + means.var(axis=0)
        force_variance = np.mean([s[2] for s in summaries], axis=0) + forces.var(axis=0)
        shape = (len(self.coarse.operator.surface.components), *grid.shape)
        traction, std, force_std = np.zeros(shape), np.zeros(shape), np.zeros(shape[0])
        traction[list(self.columns)] = means.mean(axis=0)
        std[list(self.columns)] = np.sqrt(variance)
        force_std[list(self.columns)] = np.sqrt(force_variance)
        misfit = float(np.sqrt(np.mean(np.mean(residuals, axis=0) ** 2)))
        del count
        return AdaptiveEstimate(traction, std, force_std, parameter, scale, misfit, converged, True)

    def _local_scales(self, level: _Level, solution: Solution, cells: Index, width: float, variance: bool) -> Floats:
        """tau (component, *fine): local mean of the squared gradient."""
        import scipy.ndimage

        grid = level.operator.surface
        out = []
        spread = _covariance(solution) if variance else None
        n = len(cells)
        for i in range(len(self.columns)):
            field = np.zeros(math.prod(grid.shape))
            field[cells] = solution.traction[i]
            squares = []
            for axis, d in enumerate(level.stencil.differences):
                square = (d @ field) ** 2
                if spread is not None:
                    local = d[:, cells]
                    block = spread[i * n : (i + 1) * n, i * n : (i + 1) * n]
                    square = square + _edge_variance(local, block)
                squares.append(square.reshape(level.stencil.edge_shape(axis)))
            energy = level.stencil.energy(squares)
            sigma = [width * min(grid.spacings) / dx for dx in grid.spacings]
            out.append(scipy.ndimage.gaussian_filter(energy, sigma, mode="constant"))
        return np.stack(out)

    # -- batches -------------------------------------------------------------------------------------------------------


def _edge_variance(difference: scipy.sparse.csr_array, covariance: Floats) -> Floats:
    """Diagonal of D S D' for a sparse D with at most two entries in a row."""
    coo = (difference @ covariance)
    return np.asarray(difference.multiply(coo).sum(axis=1)).ravel()


def _covariance(solution: Solution) -> Floats:
    """Posterior covariance (component * cell, component * cell) on the face of the cone that the solution lies on."""
    import scipy.linalg

    assert solution.face is not None and solution.factor is not None
    half = scipy.linalg.solve_triangular(solution.factor, solution.face.T, lower=True, check_finite=False)
    return np.asarray(half.T @ half)


def _scattered(values: Floats, cells: Index, shape: tuple[int, ...]) -> Floats:
    out = np.zeros(math.prod(shape))
    out[cells] = values
    return out.reshape(shape)


def _repeated(field: npt.NDArray[np.generic], ratio: int) -> npt.NDArray[np.generic]:
    for axis in range(field.ndim):
        field = np.repeat(field, ratio, axis=axis)
    return field


def _grown(region: Flags, cells: int) -> Flags:
    import scipy.ndimage

    structure = np.ones((3,) * region.ndim, dtype=bool)
    return np.asarray(scipy.ndimage.binary_dilation(region, structure, iterations=cells))


def _summary(solution: Solution, cells: Index, ratio: int, fine: Grid, grid: Grid) -> tuple[Floats, Floats, Floats]:
    """Mean traction and its variance on the surface's own cells, and the variance of the net force."""
    import scipy.linalg

    assert solution.face is not None and solution.factor is not None
    c, n = solution.traction.shape
    places = np.unravel_index(cells, fine.shape)
    flat = np.ravel_multi_index(tuple(p // ratio for p in places), grid.shape)
    coarse, inverse = np.unique(flat, return_inverse=True)
    share = scipy.sparse.csr_array(
        (np.full(n, 1.0 / ratio**fine.dimensions), (inverse, np.arange(n))), shape=(len(coarse), n)
    )
    mean, variance, force = np.zeros((c, math.prod(grid.shape))), np.zeros((c, math.prod(grid.shape))), np.zeros(c)
    for i in range(c):
        rows = share @ solution.face[i * n : (i + 1) * n]
        half = scipy.linalg.solve_triangular(solution.factor, rows.T, lower=True, check_finite=False)
        mean[i, coarse] = share @ solution.traction[i]
        variance[i, coarse] = (half**2).sum(axis=0)
        force[i] = float((half.sum(axis=1) ** 2).sum()) * grid.cell**2
    return mean.reshape(c, *grid.shape), variance.reshape(c, *grid.shape), force
