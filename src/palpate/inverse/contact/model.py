"""A contact model of a frame: traction that solves a constrained problem on some cells of a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.cone import Solution
from palpate.inverse.contact.differences import Differences
from palpate.inverse.contact.quadratic import Penalty, Quadratic
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.grids import refined
from palpate.sensing.operator import Operator

__all__ = ["ContactModel", "Level", "Normal", "dilated", "level_operator", "scattered"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


def level_operator(operator: Operator, ratio: int) -> Operator:
    """The operator on cells ``ratio`` times finer."""
    if ratio == 1:
        return operator
    return Operator(operator.pad, operator.planes_of, refined(operator.surface, ratio), operator.boundary)


class Level:
    """The operator and the differences on one grid."""

    def __init__(self, operator: Operator, ratio: int, columns: tuple[int, ...], readings: Readings) -> None:
        self.operator, self.ratio, self.columns, self.readings = operator, ratio, columns, readings
        self.grid = operator.surface
        self.differences = Differences(self.grid)

    def matrix(self, cells: Index, noise: Floats, observed: Flags) -> Floats:
        """Whitened columns (reading, component * cell) of the readings that are observed."""
        full = self.operator.columns(self.columns, cells)[observed]
        return self.readings.white(full.reshape(len(full), -1) / noise[observed, None], observed)


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
class ContactModel:
    """One model of a frame: a solution on some cells of a level.

    ``contact``, where given, is the same on the cells that are in contact beyond doubt: the errors are its. Cells where noise presses
    now and then, beyond the array above all, are as free as any other on the face of the constraints, and would count in full. ``ray``
    is the traction over the pressure where that is one for all cells, and ``changes`` (change, component) is how it may change; ``hessian`` and
    ``penalty`` are then those of the pressure. ``shared`` (free, unknown) is what the errors owe to unknowns that act on many readings at once.
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


def scattered(values: Floats, cells: Index, shape: tuple[int, ...]) -> Floats:
    out = np.zeros(math.prod(shape))
    out[cells] = values
    return out.reshape(shape)


def dilated(region: Flags, cells: int) -> Flags:
    import scipy.ndimage

    structure = np.ones((3,) * region.ndim, dtype=bool)
    return np.asarray(scipy.ndimage.binary_dilation(region, structure, iterations=cells))
