"""One account of a frame: traction that solves a constrained problem on some cells, and what follows from it.

Values and closed-form variances of every quantity, on the face of the constraints that the solution lies on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._batches import freeze, per_frame
from palpate.elastic.half_space import Floats
from palpate.inverse.cone import Solution, cholesky
from palpate.inverse.stencil import Sparse, Stencil
from palpate.inverse.whitening import Readings
from palpate.sensing.grids import Grid, refined
from palpate.sensing.operator import Operator

__all__ = ["Account", "Errors", "Level", "Normal"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Errors:
    """Standard deviations, in closed form, before calibration (`palpate.touch`).

    ``traction`` (*batch, component, *surface) [Pa]; ``force`` (*batch, component) [N or N/m]; ``moment`` (*batch, 3 or 1);
    ``center`` (*batch, 2 or 1) [m]; ``peak`` (*batch) [Pa]. ``detail`` is shaped like ``traction``: 1 - posterior over prior
    variance of each cell in contact, NaN elsewhere. The ``outer`` ones are no deviations but what each quantity owes to traction found
    beyond the outermost taxels, where nothing is measured: it is known to a part of itself.
    """

    traction: Floats = field(metadata=per_frame())
    force: Floats = field(metadata=per_frame())
    moment: Floats = field(metadata=per_frame())
    center: Floats = field(metadata=per_frame())
    peak: Floats = field(metadata=per_frame())
    detail: Floats = field(metadata=per_frame())
    outer_traction: Floats = field(metadata=per_frame())
    outer_force: Floats = field(metadata=per_frame())
    outer_moment: Floats = field(metadata=per_frame())
    outer_center: Floats = field(metadata=per_frame())
    outer_peak: Floats = field(metadata=per_frame())

    def __post_init__(self) -> None:
        freeze(self)

    @classmethod
    def gathered(cls, parts: Sequence[Errors | None], gather: Callable[[list[Any]], Any]) -> Errors:
        """Each array made of those of the parts (None where a part is)."""
        names = [f.name for f in fields(cls)]
        return cls(**{n: gather([None if p is None else getattr(p, n) for p in parts]) for n in names})


class Level:
    """The operator and the differences on one grid."""

    def __init__(self, operator: Operator, ratio: int, columns: tuple[int, ...], readings: Readings) -> None:
        self.ratio, self.columns, self.readings = ratio, columns, readings
        self.grid = operator.surface if ratio == 1 else refined(operator.surface, ratio)
        self.operator = (
            operator if ratio == 1 else Operator(operator.pad, operator.planes_of, self.grid, operator.boundary)
        )
        self.stencil = Stencil(self.grid)

    def matrix(self, cells: Index, noise: Floats, heard: Flags) -> Floats:
        """Whitened columns (reading, component * cell) of the readings that are heard."""
        full = self.operator.columns(self.columns, cells)[heard]
        return self.readings.white(full.reshape(len(full), -1) / noise[heard, None], heard)


@dataclass
class Normal:
    """Whitened columns of some cells of a level, and the right-hand side (component, cell) of their normal equations."""

    level: Level
    cells: Index
    matrix: Floats
    linear: Floats
    known: Floats | None = None

    @cached_property
    def gram(self) -> Floats:
        """The normal matrix, worked out when it is first asked for."""
        return self.matrix.T @ self.matrix if self.known is None else self.known

    def part(self, position: Index) -> Normal:
        """The same for some of the cells."""
        c, n = self.linear.shape
        picks = (np.arange(c)[:, None] * n + position[None, :]).ravel()
        known = self.gram[np.ix_(picks, picks)] if self._formed else None
        return Normal(self.level, self.cells[position], self.matrix[:, picks], self.linear[:, position], known)

    def along(self, ray: Floats) -> Normal:
        """The same for traction that is ``ray`` (component,) times what is sought (1, cell)."""
        n = self.linear.shape[1]
        matrix = sum(a * self.matrix[:, i * n : (i + 1) * n] for i, a in enumerate(ray))
        known = None
        if self._formed:
            blocks = self.gram.reshape(len(ray), n, len(ray), n)
            known = np.einsum("c,cidj,d->ij", ray, blocks, ray, optimize=True)
        return Normal(self.level, self.cells, np.asarray(matrix), (ray @ self.linear)[None], known)

    @property
    def _formed(self) -> bool:
        return self.known is not None or "gram" in self.__dict__


@dataclass
class Account:
    """One account of a frame: a solution on some cells of a level.

    ``contact``, where given, is the same on the cells that are in contact beyond doubt: the errors are its. Cells where noise presses
    now and then, beyond the array above all, are as free as any other on the face of the constraints, and would count in full. ``ray``
    is the traction over the pressure where that is one for all cells, and ``changes`` (change, component) is how it may change; ``hessian`` is
    then that of the pressure.
    """

    data: Normal
    hessian: Floats
    solution: Solution
    weight: float = 0.0
    contact: Account | None = None
    ray: Floats | None = None
    changes: Floats | None = None

    @property
    def level(self) -> Level:
        return self.data.level

    @property
    def cells(self) -> Index:
        return self.data.cells

    @property
    def pressure(self) -> Floats:
        """Pressure on the cells of the level's grid."""
        return scattered(self.solution.traction[-1], self.cells, self.level.grid.shape)


def spread(solution: Solution, rows: Any) -> Floats:
    """Z (free, row) with Z'Z the posterior covariance of rows' x, on the face of the cone that the solution lies on.

    ``rows`` (row, component * cell), dense or sparse.
    """
    import scipy.linalg

    if solution.face is None or solution.factor is None:
        raise RuntimeError("the solution was found without its face")
    dense = rows.toarray() if scipy.sparse.issparse(rows) else rows
    right = solution.face.columns(np.asarray(dense)).T
    return np.asarray(scipy.linalg.solve_triangular(solution.factor, right, lower=True, check_finite=False))


def scattered(values: Floats, cells: Index, shape: tuple[int, ...]) -> Floats:
    out = np.zeros(math.prod(shape))
    out[cells] = values
    return out.reshape(shape)


def spread_out(variance: Floats, cells: int = 1) -> Floats:
    """The error of where the contact ends belongs to the cells just outside it too: its mean next to it, its largest farther on."""
    import scipy.ndimage

    near = (3,) * (variance.ndim - 1)
    out = np.maximum(variance, scipy.ndimage.uniform_filter(variance, (1, *near), mode="nearest"))
    if cells > 1:
        far = (2 * cells + 1,) * (variance.ndim - 1)
        out = np.where(variance > 0, out, scipy.ndimage.maximum_filter(variance, (1, *far), mode="nearest"))
    return np.asarray(out)


def detail_of(account: Account, grid: Grid) -> Floats:
    """1 - posterior over prior variance of traction on the surface's cells (component, *surface); NaN out of contact."""
    import scipy.linalg

    face = account.solution.face
    c, n = account.solution.traction.shape
    out = np.full((c, math.prod(grid.shape)), math.nan)
    if face is None or not len(face.index):
        return out.reshape(c, *grid.shape)
    prior = cholesky(face.restrict(account.hessian - account.data.gram))
    share, surface_cells = shares(account, grid)
    for i in range(c):
        rows = np.zeros((len(surface_cells), c * n))
        rows[:, i * n : (i + 1) * n] = share.toarray()
        before = scipy.linalg.solve_triangular(prior, face.columns(rows).T, lower=True, check_finite=False)
        with np.errstate(divide="ignore", invalid="ignore"):
            out[i, surface_cells] = 1.0 - (spread(account.solution, rows) ** 2).sum(axis=0) / (before**2).sum(axis=0)
    return out.reshape(c, *grid.shape)


def shares(account: Account, grid: Grid) -> tuple[Sparse, Index]:
    """Means over the fine cells of each surface cell, and which surface cells those are."""
    level, ratio, n = account.level, account.level.ratio, len(account.cells)
    places = np.unravel_index(account.cells, level.grid.shape)
    flat = np.ravel_multi_index(tuple(p // ratio for p in places), grid.shape)
    surface_cells, inverse = np.unique(flat, return_inverse=True)
    share = scipy.sparse.csr_array(
        (np.full(n, 1.0 / ratio**grid.dimensions), (inverse, np.arange(n))), shape=(len(surface_cells), n)
    )
    return share, surface_cells


Quantity = tuple[Floats, Floats]


def quantities(account: Account, grid: Grid, inside: Flags) -> tuple[Quantity, Quantity, Quantity, Quantity, Quantity]:
    """(value, variance) of traction on the surface's cells, net force, moment, centre of pressure and peak pressure.

    The numbers are those of the cells ``inside``.
    """
    level = account.level
    c, n = account.solution.traction.shape
    places = np.unravel_index(account.cells, level.grid.shape)
    share, surface_cells = shares(account, grid)
    mean, variance = np.zeros((2, c, math.prod(grid.shape)))
    for i in range(c):
        mean[i, surface_cells] = share @ account.solution.traction[i]
        rows = np.zeros((len(surface_cells), c * n))
        rows[:, i * n : (i + 1) * n] = share.toarray()
        variance[i, surface_cells] = (spread(account.solution, rows) ** 2).sum(axis=0)
    kept = inside[tuple(p // level.ratio for p in places)].astype(np.float64)
    cell = level.grid.cell * kept
    axes = [axis[p] for axis, p in zip(level.grid.axes, places)][::-1]  # x, then y

    def linear(weights: Floats) -> Quantity:
        """Of sums of traction (quantity, component, cell)."""
        rows = weights.reshape(len(weights), -1)
        return rows @ account.solution.traction.ravel(), (spread(account.solution, rows) ** 2).sum(axis=0)

    force_rows = np.zeros((c, c, n))
    force_rows[np.arange(c), np.arange(c)] = cell
    p = account.solution.traction[-1] * kept
    total = float(p.sum()) or 1.0
    center = np.array([float((x * p).sum()) / total for x in axes])
    center_rows = np.zeros((len(axes), c, n))
    for i, x in enumerate(axes):
        center_rows[i, -1] = kept * (x - center[i]) / total
    if len(axes) == 1:
        moment_rows = np.zeros((1, c, n))
        moment_rows[0, -1] = -axes[0] * cell
    else:
        moment_rows = np.zeros((3, c, n))
        moment_rows[0, -1], moment_rows[1, -1] = axes[1] * cell, -axes[0] * cell
        if c == 3:
            moment_rows[2, 0], moment_rows[2, 1] = -axes[1] * cell, axes[0] * cell
    top = int(np.argmax(np.where(inside.ravel(), mean[-1], -1.0)))
    return (
        (mean.reshape(c, *grid.shape), variance.reshape(c, *grid.shape)),
        linear(force_rows),
        linear(moment_rows),
        (center, linear(center_rows)[1]),
        (mean[-1, top], variance[-1, top]),
    )
