"""A contact model of a frame: traction that solves a constrained problem on some cells of a grid."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.cone import Solution
from palpate.inverse.contact.differences import Differences
from palpate.inverse.contact.products import Applied, Boxes, Products, by_products
from palpate.inverse.contact.quadratic import Penalty, Quadratic, formed_or_not
from palpate.inverse.linear.matrix_free.evidence import FrameAtSize, LinearAtSize
from palpate.inverse.linear.spectrum import Spectrum
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.grids import refined
from palpate.sensing.operator import Operator

__all__ = ["Columns", "ContactModel", "Level", "Normal", "Rounds", "dilated", "level_operator", "scattered"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


#: Unknowns of one frame whose normal matrix is kept for its other rounds, at most.
LARGEST_KEPT = 4096


def level_operator(operator: Operator, ratio: int) -> Operator:
    """The operator on cells ``ratio`` times finer."""
    if ratio == 1:
        return operator
    return Operator(
        operator.pad, operator.planes_of, refined(operator.surface, ratio), operator.boundary, recall=operator.recall
    )


class Level:
    """The operator and the differences on one grid."""

    def __init__(self, operator: Operator, ratio: int, columns: tuple[int, ...], readings: Readings) -> None:
        self.operator, self.ratio, self.columns, self.readings = operator, ratio, columns, readings
        self.grid = operator.surface
        self.differences = Differences(self.grid)
        self.boxes = Boxes(operator, columns)

    def matrix(self, cells: Index, noise: Floats, observed: Flags) -> Floats:
        """Whitened columns (reading, component * cell) of the readings that are observed."""
        full = self.operator.columns(self.columns, cells)[observed]
        return self.readings.white(full.reshape(len(full), -1) / noise[observed, None], observed)

    def normal(
        self,
        cells: Index,
        y: Floats,
        noise: Floats,
        observed: Flags,
        kept: dict[int, Columns] | None = None,
        *,
        products: bool = False,
        once: bool = False,
    ) -> Normal:
        """The normal equations of some cells, for readings ``y`` in units of the noise; ``kept`` is that of `Rounds`;
        ``products``: large contacts need no matrix; ``once``: they are solved once.
        """
        if products and by_products(self.operator, cells, len(self.columns), int(observed.sum()), once=once):
            applied = Applied(self.boxes, self.readings, self.grid.shape, cells, noise, observed)
            linear = self.readings.white(y[observed], observed) @ applied
            return Normal(self, cells, applied, linear.reshape(-1, len(cells)))
        recent = None if kept is None else kept.get(self.ratio)
        scale = None if recent is None else recent.scale_of(noise, observed)
        position = None if recent is None or scale is None else recent.places(cells)
        if recent is None or scale is None or position is None:
            recent, scale, position = Columns(self, cells, noise, observed), 1.0, np.arange(len(cells))
            if kept is not None and len(self.columns) * len(cells) <= LARGEST_KEPT:
                kept[self.ratio] = recent
        mine, factor = recent, scale
        matrix = mine.matrix.take(position, axis=2).reshape(len(mine.matrix), -1)
        matrix = matrix if factor == 1.0 else matrix * factor
        linear = matrix.T @ self.readings.white(y[observed], observed)
        return Normal(
            self, cells, matrix, linear.reshape(-1, len(cells)), source=lambda: mine.gram(position) * factor**2
        )


class Rounds(threading.local):
    """While a frame is solved: columns of the cells that its rounds have asked for so far, by the ratio of the level.

    They are let go of at its end, so that no frame's answer depends on another's. So is what a matrix-free linear model makes of the frame.
    """

    kept: dict[int, Columns] | None = None
    linear: FrameAtSize | None = None
    #: The readings that were projected last, by the spectrum.
    _projected: dict[int, tuple[Floats, Floats]] | None = None

    def __enter__(self) -> None:
        self.kept, self.linear, self._projected = {}, None, {}

    def __exit__(self, *error: object) -> None:
        self.kept = self.linear = self._projected = None

    def projected(self, spectrum: Spectrum, rows: Sequence[Floats]) -> Floats:
        """Readings in the basis of a spectrum: rounds that differ in their noise ask for the same."""
        flat = np.concatenate([r.ravel() for r in rows])
        known = None if self._projected is None else self._projected.get(id(spectrum))
        if known is not None and np.array_equal(known[0], flat):
            return known[1]
        out = np.asarray(spectrum.project(rows))
        if self._projected is not None:
            self._projected[id(spectrum)] = flat, out
        return out

    def of(self, linear: LinearAtSize) -> FrameAtSize:
        """What a matrix-free linear model makes of the frame."""
        if self.linear is None or self.linear.linear is not linear:
            self.linear = linear.frame()
        return self.linear


class Columns:
    """Whitened columns of cells, to which others are added, and their normal matrix where that is asked for.

    The rounds of a frame solve nearly the same cells at other noise.
    """

    def __init__(self, level: Level, cells: Index, noise: Floats, observed: Flags) -> None:
        self.level, self.noise, self.observed = level, noise, observed.copy()
        self.place = np.full(math.prod(level.grid.shape), -1, dtype=np.intp)
        self.place[cells] = np.arange(len(cells))
        self.count = len(cells)
        self.matrix = self._columns(cells)
        self._gram: Floats | None = None

    def _columns(self, cells: Index) -> Floats:
        """(reading, component, cell)."""
        matrix = self.level.matrix(cells, self.noise, self.observed)
        return matrix.reshape(len(matrix), -1, len(cells))

    def scale_of(self, noise: Floats, observed: Flags) -> float | None:
        """What the columns are to be multiplied by for another noise, where that is another for all readings alike."""
        if not np.array_equal(observed, self.observed):
            return None
        ratio = self.noise[observed] / noise[observed]
        first = float(ratio[0]) if len(ratio) else 1.0
        return first if bool((np.abs(ratio - first) <= 1e-13 * abs(first)).all()) else None

    def places(self, cells: Index) -> Index | None:
        """Places of cells among those that are kept, to which the missing are added; None where these would be too many."""
        new = cells[self.place[cells] < 0]
        if len(new) and self.matrix.shape[1] * (self.count + len(new)) > LARGEST_KEPT:
            return None
        if len(new):
            more, (m, c, n), k = self._columns(new), self.matrix.shape, len(new)
            self.matrix = np.concatenate([self.matrix, more], axis=2)
            if self._gram is not None:
                cross = (self.matrix.reshape(m, -1).T @ more.reshape(m, -1)).reshape(c, n + k, c, k)
                gram = np.empty((c, n + k, c, n + k))
                gram[:, :n, :, :n] = self._gram
                gram[:, :, :, n:] = cross
                gram[:, n:, :, :n] = cross[:, :n].transpose(2, 3, 0, 1)
                self._gram = gram
            self.place[new] = np.arange(n, n + k)
            self.count = n + k
        return np.asarray(self.place[cells])

    def gram(self, position: Index) -> Floats:
        """The normal matrix of the cells in these places."""
        m, c, n = self.matrix.shape
        if self._gram is None:
            flat = self.matrix.reshape(m, -1)
            self._gram = (flat.T @ flat).reshape(c, n, c, n)
        picks = (np.arange(c)[:, None] * n + position[None, :]).ravel()
        return np.asarray(self._gram.reshape(c * n, c * n).take(picks, axis=0).take(picks, axis=1))


@dataclass
class Normal:
    """Whitened columns of some cells of a level, and the right-hand side (component, cell) of their normal equations."""

    level: Level
    cells: Index
    matrix: Any  # an array, or `Applied`
    linear: Floats
    known: Floats | None = None
    source: Callable[[], Floats] | None = None

    @cached_property
    def gram(self) -> Floats:
        """The normal matrix, worked out when it is first asked for, by ``source`` where that is given."""
        if self.known is not None:
            return self.known
        return self.matrix.T @ self.matrix if self.source is None else self.source()

    def part(self, position: Index) -> Normal:
        """The same for some of the cells."""
        if isinstance(self.matrix, Applied):
            return Normal(self.level, self.cells[position], self.matrix.part(position), self.linear[:, position])
        c, n = self.linear.shape
        picks = (np.arange(c)[:, None] * n + position[None, :]).ravel()
        known = self.gram.take(picks, axis=0).take(picks, axis=1) if self._formed else None
        matrix = self.matrix.take(picks, axis=1)
        return Normal(self.level, self.cells[position], matrix, self.linear[:, position], known)

    def along(self, ray: Floats) -> Normal:
        """The same for traction that is ``ray`` (component,) times what is sought (1, cell)."""
        if isinstance(self.matrix, Applied):
            return Normal(self.level, self.cells, self.matrix.along(ray), (ray @ self.linear)[None])
        n = self.linear.shape[1]
        matrix = sum(a * self.matrix[:, i * n : (i + 1) * n] for i, a in enumerate(ray))
        known = None
        if self._formed:
            blocks = self.gram.reshape(len(ray), n, len(ray), n)
            known = np.einsum("c,cidj,d->ij", ray, blocks, ray, optimize=True)
        return Normal(self.level, self.cells, np.asarray(matrix), (ray @ self.linear)[None], known)

    def quadratic(self, penalty: Penalty) -> Quadratic:
        """The normal matrix with a penalty."""
        if isinstance(self.matrix, Applied):
            return Products(self.matrix, penalty)
        return formed_or_not(self.matrix.T, lambda: self.gram, penalty)

    @property
    def _formed(self) -> bool:
        return self.known is not None or "gram" in self.__dict__


@dataclass
class ContactModel:
    """One model of a frame: a solution on some cells of a level.

    ``contact``, where given, is the same on the cells that are in contact beyond doubt: the errors are its. Cells where noise presses
    now and then, beyond the array above all, are as free as any other on the face of the constraints, and would count in full. ``ray``
    is the traction over the pressure where that is one for all cells, and ``changes`` (change, component) is how it may change; ``hessian`` and
    ``penalty`` are then those of the pressure. ``shared`` (free, unknown) is what the errors owe to unknowns that act on many readings at once.
    ``compact``: it is sought on a few cells alone.
    """

    data: Normal
    hessian: Quadratic
    penalty: Penalty
    solution: Solution
    weight: float = 0.0
    contact: ContactModel | None = None
    ray: Floats | None = None
    changes: Floats | None = None
    shared: Floats | None = None
    compact: bool = False

    @property
    def level(self) -> Level:
        return self.data.level

    @property
    def cells(self) -> Index:
        return self.data.cells

    @property
    def squares(self) -> float:
        """Squares of what is left of the readings, less those of the readings themselves, in units of the noise."""
        t = self.solution.traction
        explained = self.data.matrix @ t.ravel()
        return float(explained @ explained) - 2.0 * float((t * self.data.linear).sum())

    @property
    def pressure(self) -> Floats:
        """Pressure on the cells of the level's grid."""
        return scattered(self.solution.traction[-1], self.cells, self.level.grid.shape)


def scattered(values: Floats, cells: Index, shape: tuple[int, ...]) -> Floats:
    out = np.zeros(math.prod(shape))
    out[cells] = values
    return out.reshape(shape)


def dilated(region: Flags, cells: int) -> Flags:
    import scipy.ndimage

    structure = np.ones((3,) * region.ndim, dtype=bool)
    return np.asarray(scipy.ndimage.binary_dilation(region, structure, iterations=cells))
