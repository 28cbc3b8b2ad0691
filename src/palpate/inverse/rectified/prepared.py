"""What the rectified method needs of a skin, made once: fine cells, responses, kernels, patterns."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import scipy.fft

from palpate._memory import require
from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.fit import neighbours
from palpate.inverse.problem import Problem
from palpate.inverse.rectified.policy import Policy
from palpate.sensing.arrays import ScatteredArray
from palpate.sensing.grids import refined
from palpate.sensing.nuisance import nuisances
from palpate.sensing.operator import Operator

__all__ = ["Kernel", "Prepared"]

Cells = npt.NDArray[np.intp]


class Kernel:
    """Covariance of the latent field, Matern of order 5/2: (1 + a + a^2/3) exp(-a), a = sqrt(5) r / length.

    (C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, eq. 4.17.) On a regular grid it depends on the difference of
    cells alone: blocks of it are looked up, and products with the whole are convolutions.
    """

    def __init__(self, shape: tuple[int, ...], spacings: tuple[float, ...], length: float) -> None:
        self.shape = shape
        axes = [np.arange(n) * dx for n, dx in zip(shape, spacings)]
        r = np.sqrt(sum(x**2 for x in np.meshgrid(*axes, indexing="ij")))
        a = math.sqrt(5.0) * r / length
        table = (1.0 + a + a**2 / 3.0) * np.exp(-a)
        self.table = table.ravel()
        self.sizes = tuple(scipy.fft.next_fast_len(2 * n - 1, real=True) for n in shape)
        wrapped = np.zeros(self.sizes)
        signed = [np.concatenate([np.arange(n), np.arange(1 - n, 0)]) for n in shape]
        mesh = np.meshgrid(*signed, indexing="ij")
        wrapped[tuple(m % s for m, s in zip(mesh, self.sizes))] = table[tuple(np.abs(m) for m in mesh)]
        self.transfer = np.asarray(scipy.fft.rfftn(wrapped)).real

    def times(self, field: Floats) -> Floats:
        """The kernel times fields (..., cell)."""
        d = len(self.shape)
        axes = tuple(range(-d, 0))
        spread = scipy.fft.rfftn(field.reshape(*field.shape[:-1], *self.shape), s=self.sizes, axes=axes)
        out = scipy.fft.irfftn(spread * self.transfer, s=self.sizes, axes=axes)
        return np.asarray(out[(..., *(slice(n) for n in self.shape))]).reshape(field.shape)

    def block(self, cells: Cells) -> Floats:
        """The kernel among some cells (flat indices)."""
        index = np.zeros((len(cells), len(cells)), dtype=np.intp)
        for x, n in zip(np.unravel_index(cells, self.shape), self.shape):
            index = index * n + np.abs(x[:, None] - x[None, :])
        return np.asarray(self.table[index])


class Prepared:
    """Fine cells, responses, kernels and patterns of a skin.

    Attributes
    ----------
    responses : array (component, reading, cell)
        Scaled readings of unit traction, pressure last.
    scale : array (reading,)
        Unit of each reading: readings of a kind share one.
    coarser : Prepared or None
        The same on cells twice as large, on which explanations are tried first; on areas.
    """

    def __init__(
        self, problem: Problem, policy: Policy, friction: float | None, *, finer: Prepared | None = None
    ) -> None:
        self.problem, self.policy = problem, policy
        self.ratio: int
        self.scale: Floats
        self.planes = planes = problem.planes
        surface = problem.surface
        d = surface.dimensions
        if any(a.noise_correlation for a in planes):
            raise Unsupported(
                'method="rectified" takes noise to be independent from taxel to taxel; use method="adaptive", or leave out noise_correlation.'
            )
        n = sum(int(a.valid.sum()) * len(a.channels) for a in planes)
        pitch = max(_pitch(a) for a in planes)
        spacing = max(surface.spacings)
        margin = policy.margin if d == 1 and not problem.fixed else 0
        ratio = max(1, round(spacing / (policy.cell * pitch)))
        while ratio > 1 and math.prod((k + 2 * margin) * ratio for k in surface.shape) > policy.most_cells:
            ratio -= 1
        if finer is not None:
            ratio = finer.ratio // 2
        cells = math.prod((k + 2 * margin) * ratio for k in surface.shape)
        taxels = max(int(a.valid.sum()) for a in planes) if d == 2 else 0
        if taxels > policy.most_taxels or n > policy.most_readings or cells > policy.most_cells:
            raise Unsupported(
                f'method="rectified" serves up to {policy.most_taxels} taxels on an area, {policy.most_readings} readings and {policy.most_cells} cells; got '
                f'{taxels if d == 2 else n} taxels, {n} readings and {cells} cells. Use method="adaptive".'
            )
        require(
            8.0 * n * cells * (2.0 * len(surface.components) + 1.0),
            f'method="rectified": {n} readings and {cells} cells',
            'Use method="adaptive".',
        )
        self.ratio, self.margin, self.pitch = ratio, margin, pitch
        self.fine = fine = refined(surface, ratio, margin)
        self.components = len(problem.columns)
        self.n, self.cells = n, cells
        dense = Operator(problem.pad, planes, fine, problem.boundary, recall=problem.recall).dense()
        dense = dense.reshape(n, len(fine.components), cells)[:, list(problem.columns)]
        self.channel, kinds = _channels(planes)
        largest = np.abs(dense).max(axis=(1, 2))
        size = {kind: float(largest[kinds == kind].max()) for kind in np.unique(kinds)}
        #: readings of different kinds are made alike: each kind by its largest response
        self.scale = np.array([size[k] if size[k] > 0 else 1.0 for k in kinds]) if finer is None else finer.scale
        self.responses = np.ascontiguousarray((dense / self.scale[:, None, None]).transpose(1, 0, 2))
        self.kernels = [
            Kernel(fine.shape, tuple(s / pitch for s in fine.spacings), length) for length in policy.lengths
        ]
        self.count = len(np.unique(self.channel))
        given = [std for a in planes for std in (a.noise_std or ())]
        known = all(a.noise_std is not None for a in planes)
        first = np.array([self.scale[self.channel == c][0] for c in range(self.count)])
        self.noise: Floats | None = np.array(given) / first if known else None
        kinds_of = ("offset",) if problem.nuisance is None else problem.nuisance
        quiet = problem.nuisance is None and problem.zeroed
        self.patterns = [] if quiet else nuisances(planes, kinds_of)
        self.patterns_certain = problem.nuisance is not None
        rows = [p.rows / self.scale for p in self.patterns]
        self.pattern_size = np.array([float(np.abs(r).max(initial=0.0)) or 1.0 for r in rows])
        self.columns = np.stack([r / s for r, s in zip(rows, self.pattern_size)], axis=1) if rows else np.zeros((n, 0))
        self.friction = policy.friction if friction is None else friction
        self.pairs = neighbours(planes)
        self.mean = self._mean()
        self.inside = np.zeros(fine.shape, dtype=bool)
        m = margin * ratio
        self.inside[(slice(m, -m if m else None),) * d] = True
        #: amplitude of traction all over that makes the largest scaled reading 1
        self.start = 1.0 / float(np.abs(self.responses[-1].sum(axis=1)).max())

        self.coarser = (
            Prepared(problem, policy, friction, finer=self) if d == 2 and finer is None and ratio > 1 else None
        )
        #: what cells of this size do to a scaled reading, as a part of the largest (root mean square): a term of the noise
        self.detail = 0.0
        if self.coarser is not None:
            self.coarser.detail = self._lost()
            # the error of cells goes with their area
            self.detail = self.coarser.detail * (self.coarser.ratio / ratio) ** 2

    def _lost(self) -> float:
        """What the coarser cells change of the readings of rectified samples of the process, as a part of the largest reading (root mean square)."""
        coarse = self.coarser
        if coarse is None:
            return 0.0
        rng = np.random.default_rng(0)
        kernel = self.kernels[self.policy.first_length]
        errors = []
        for _ in range(self.policy.samples):
            # white noise through the root of the kernel, wrapped: its statistics are what counts
            white = scipy.fft.rfftn(rng.standard_normal(kernel.sizes))
            field = scipy.fft.irfftn(white * np.sqrt(np.maximum(kernel.transfer, 0.0)), s=kernel.sizes)
            p = np.maximum(field[tuple(slice(n) for n in self.fine.shape)] - 1.0, 0.0)
            exact = self.responses[-1] @ p.ravel()
            rough = coarse.responses[-1] @ _as_coarse(p, coarse.fine.shape).ravel()
            largest = float(np.abs(exact).max())
            if largest > 0:
                errors.append(float(np.mean((rough - exact) ** 2)) / largest**2)
        return math.sqrt(float(np.mean(errors))) if errors else 0.0

    def from_coarser(self, field: Floats) -> Floats:
        """A field (..., cell) of `coarser`, interpolated."""
        import scipy.ndimage

        coarse = self.coarser
        if coarse is None:
            return field
        factor = [a / b for a, b in zip(self.fine.shape, coarse.fine.shape)]
        out = np.empty((*field.shape[:-1], self.cells))
        for index in np.ndindex(field.shape[:-1]):
            part = field[index].reshape(coarse.fine.shape)
            out[index] = scipy.ndimage.zoom(part, factor, order=1, mode="nearest", grid_mode=True).ravel()
        return out

    def _mean(self) -> Floats:
        """Mean of the latent field (cell,): falls beyond the outermost taxels."""
        fine = self.fine
        places = np.stack([x.ravel() for x in np.meshgrid(*fine.axes, indexing="ij")], axis=1)
        points = np.concatenate([a.points[a.valid.ravel()] for a in self.planes]).reshape(-1, fine.dimensions)
        out = np.maximum(np.maximum(points.min(axis=0) - places, places - points.max(axis=0)), 0.0)
        away = np.clip(np.sqrt((out**2).sum(axis=1)) / self.pitch - 0.5, 0.0, 1.5)
        self.outside = (out > 0).any(axis=1)
        return np.asarray(self.policy.mean - self.policy.fall * away)

    def means(self, field: Floats) -> Floats:
        """Fields (..., fine cell) as means over the cells of the surface (..., cell)."""
        d, m, r = self.fine.dimensions, self.margin * self.ratio, self.ratio
        field = field.reshape(*field.shape[:-1], *self.fine.shape)[(..., *(slice(m, -m if m else None),) * d)]
        for axis in range(field.ndim - d, field.ndim):
            shape = (*field.shape[:axis], field.shape[axis] // r, r, *field.shape[axis + 1 :])
            field = field.reshape(shape).mean(axis=axis + 1)
        return field


def _as_coarse(field: Floats, shape: tuple[int, ...]) -> Floats:
    """Means of a fine field over the cells of a coarser grid of the same extent."""
    for axis, n in enumerate(shape):
        edges = np.linspace(0.0, field.shape[axis], n + 1)
        total = np.concatenate([np.zeros_like(field.take([0], axis)), np.cumsum(field, axis)], axis)
        low = np.floor(edges).astype(int)
        high = np.minimum(low + 1, field.shape[axis])
        weight = (edges - low).reshape([-1 if a == axis else 1 for a in range(field.ndim)])
        at = total.take(low, axis) * (1.0 - weight) + total.take(high, axis) * weight
        field = np.diff(at, axis=axis) / (edges[1] - edges[0])
    return field


def _pitch(array: object) -> float:
    if isinstance(array, ScatteredArray):
        import scipy.spatial

        points = array.points[array.valid.ravel()]
        return float(np.median(scipy.spatial.cKDTree(points).query(points, k=2)[0][:, 1]))
    return float(max(array.grid.spacings))  # type: ignore[attr-defined]


def _channels(planes: object) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.str_]]:
    """Number of the channel, and its unit, of each reading."""
    numbers, kinds, count = [], [], 0
    for array in planes:  # type: ignore[attr-defined]
        size = int(array.valid.sum())
        for name in array.channels:
            numbers.append(np.full(size, count))
            kinds.append(np.full(size, find_channel(name).kind.unit))
            count += 1
    return np.concatenate(numbers), np.concatenate(kinds)
