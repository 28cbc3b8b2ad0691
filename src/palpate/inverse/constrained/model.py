"""A contact model of a frame: the solution of a constrained problem on some cells of a grid."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Solution
from palpate.inverse.constrained.differences import Differences
from palpate.inverse.constrained.factors import Factor
from palpate.inverse.constrained.products import Applied, Boxes, Products, by_products
from palpate.inverse.constrained.quadratic import Formed, Penalty, Quadratic, formed_or_not
from palpate.inverse.linear.matrix_free.evidence import FrameAtSize, LinearAtSize
from palpate.inverse.linear.spectrum import Spectrum
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.operator import Operator

__all__ = [
    "MAX_CACHED_UNKNOWNS",
    "Columns",
    "ContactModel",
    "Later",
    "Level",
    "Normal",
    "Picked",
    "Rounds",
    "dilated",
    "scattered",
]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


#: Cache the normal matrix of a frame of up to this many unknowns between rounds.
MAX_CACHED_UNKNOWNS = 4096
#: Largest number of readings to remove from a cached matrix.
MAX_DOWNDATES = 16
#: Growth factor of the memory for cells when some are added.
ROOM = 1.25


#: Largest contact (cells, and entries of their columns: 200 MB) along a ray for which a matrix is formed, even if the
#: full contact is solved by products.
FEW_ALONG, ENTRIES_ALONG = 1200, 25_000_000


class Level:
    """The operator and the differences on one grid."""

    def __init__(self, operator: Operator, ratio: int, columns: tuple[int, ...], readings: Readings) -> None:
        self.operator, self.ratio, self.columns, self.readings = operator, ratio, columns, readings
        self.grid = operator.surface
        self.differences = Differences(self.grid)
        self.boxes = Boxes(operator, columns)
        #: Cache of `few_cells`: the readings, and the columns of all cells, as they are and orthogonalised.
        self.orthogonal: tuple[bytes, tuple[Floats, Floats]] | None = None

    def matrix(self, cells: Index, noise: Floats, observed: Flags) -> Floats:
        """Whitened columns (reading, component * cell) of the observed readings."""
        return np.ascontiguousarray(self.rows(cells, noise, observed).T)

    def rows(self, cells: Index, noise: Floats, observed: Flags) -> Floats:
        """The same as rows (component * cell, reading), the order in which they are gathered: each cell is contiguous."""
        full = self.operator.columns(self.columns, cells)
        full = full.transpose(1, 2, 0).reshape(-1, len(full))
        full = full if observed.all() else full[:, observed]
        full /= noise[observed]
        return np.ascontiguousarray(self.readings.white(full.T, observed).T)

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
        slides: bool = False,
    ) -> Normal:
        """The normal equations of some cells, for readings ``y`` in units of the noise.

        ``kept`` is the cache of `Rounds`; ``products``: solve large contacts by products instead of a matrix;
        ``once``, ``slides``: see `by_products`.
        """
        count = int(observed.sum())
        if products and by_products(self.operator, cells, len(self.columns), count, once=once, slides=slides):
            applied = Applied(self.boxes, self.readings, self.grid.shape, cells, noise, observed)
            linear = self.readings.white(y[observed], observed) @ applied
            return Normal(self, cells, applied, linear.reshape(-1, len(cells)))
        recent = None if kept is None else kept.get(self.ratio)
        picked = None if recent is None else recent.pick(cells, noise, observed)
        if picked is None:
            recent = Columns(self, cells, noise, observed)
            if kept is not None and len(self.columns) * len(cells) <= MAX_CACHED_UNKNOWNS:
                kept[self.ratio] = recent
            picked = Picked(recent, np.arange(len(cells)), 1.0, np.zeros(0, dtype=np.intp))
        return Normal(self, cells, picked, picked.linear(self.readings.white(y[observed], observed)))


class Rounds(threading.local):
    """Cache while a frame is solved: columns of the cells used so far, by the ratio of the level, and the matrix-free
    linear model of the frame.

    The cache is cleared at the end of the frame, so that no result depends on another frame.
    """

    kept: dict[int, Columns] | None = None
    linear: FrameAtSize | None = None
    #: The readings last projected, by spectrum.
    _projected: dict[int, tuple[Floats, Floats]] | None = None

    def __enter__(self) -> None:
        self.kept, self.linear, self._projected = {}, None, {}

    def __exit__(self, *error: object) -> None:
        self.kept = self.linear = self._projected = None

    def projected(self, spectrum: Spectrum, rows: Sequence[Floats]) -> Floats:
        """Readings in the basis of a spectrum, cached because rounds with other noise use the same."""
        flat = np.concatenate([r.ravel() for r in rows])
        known = None if self._projected is None else self._projected.get(id(spectrum))
        if known is not None and np.array_equal(known[0], flat):
            return known[1]
        out = np.asarray(spectrum.project(rows))
        if self._projected is not None:
            self._projected[id(spectrum)] = flat, out
        return out

    def of(self, linear: LinearAtSize) -> FrameAtSize:
        """The frame in a matrix-free linear model, cached."""
        if self.linear is None or self.linear.linear is not linear:
            self.linear = linear.frame()
        return self.linear


class Columns:
    """Whitened columns of a growing set of cells, and their normal matrix at first use.

    The rounds of a frame solve nearly the same cells with other noise. Rows (cell, component, reading) have spare
    room, so that adding cells copies nothing, and selecting cells copies row by row.
    """

    def __init__(self, level: Level, cells: Index, noise: Floats, observed: Flags) -> None:
        self.level, self.noise, self.observed = level, noise, observed.copy()
        self.place = np.full(math.prod(level.grid.shape), -1, dtype=np.intp)
        self.place[cells] = np.arange(len(cells))
        self.count = len(cells)
        self._room = self._rows(cells)
        self._gram: Floats | None = None

    def _rows(self, cells: Index) -> Floats:
        """(cell, component, reading)."""
        rows = self.level.rows(cells, self.noise, self.observed)
        return np.ascontiguousarray(rows.reshape(-1, len(cells), rows.shape[1]).transpose(1, 0, 2))

    @property
    def components(self) -> int:
        return self._room.shape[1]

    @property
    def rows(self) -> Floats:
        """(cell * component, reading)."""
        return self._room[: self.count].reshape(self.count * self.components, -1)

    def lost(self, observed: Flags) -> Index | None:
        """Indices of the readings that are no longer observed, if they are few and independent, so that they can be
        removed one by one; None otherwise.
        """
        if np.array_equal(observed, self.observed):
            return np.zeros(0, dtype=np.intp)
        gone = self.observed & ~observed
        if (observed & ~self.observed).any() or gone.sum() > MAX_DOWNDATES or 4 * gone.sum() > self.observed.sum():
            return None
        if not self.level.readings.independent:
            return None
        return np.flatnonzero(gone[self.observed])

    def pick(self, cells: Index, noise: Floats, observed: Flags) -> Picked | None:
        """The columns of cells with another noise and fewer readings, after adding missing cells; None if these are too
        many, or if the noise differs by more than a common factor.
        """
        lost = self.lost(observed)
        ratio = self.noise[observed] / noise[observed]
        scale = float(ratio[0]) if len(ratio) else 1.0
        if lost is None or (np.abs(ratio - scale) > 1e-13 * abs(scale)).any():
            return None
        new = cells[self.place[cells] < 0]
        if len(new) and self.components * (self.count + len(new)) > MAX_CACHED_UNKNOWNS:
            return None
        if len(new):
            more, c, n, k = self._rows(new), self.components, self.count, len(new)
            if n + k > len(self._room):
                room = np.empty((int(ROOM * (n + k)), *self._room.shape[1:]))
                room[:n] = self._room[:n]
                self._room = room
            self._room[n : n + k] = more
            self.count = n + k
            if self._gram is not None:
                before, added = self.rows[: c * n], more.reshape(c * k, -1)
                if c * (n + k) > len(self._gram):
                    gram = np.empty((int(ROOM * c * (n + k)),) * 2)
                    gram[: c * n, : c * n] = self._gram[: c * n, : c * n]
                    self._gram = gram
                old, both = slice(0, c * n), slice(c * n, c * (n + k))
                self._gram[both, old] = cross = added @ before.T
                self._gram[old, both] = cross.T
                self._gram[both, both] = added @ added.T
            self.place[new] = np.arange(n, n + k)
        return Picked(self, self.place[cells], scale, lost)

    def picks(self, position: Index) -> Index:
        """Indices of the rows (component, cell) of the cells at these positions."""
        return np.asarray((np.arange(self.components)[:, None] + position * self.components).ravel())

    @property
    def formed(self) -> bool:
        """Whether the normal matrix has been computed."""
        return self._gram is not None

    def gram(self, position: Index) -> Floats:
        """The normal matrix of the cells at these positions."""
        if self._gram is None:
            self._gram = self.rows @ self.rows.T
        picks = self.picks(position)
        return np.asarray(self._gram.take(picks, axis=0).take(picks, axis=1))


@dataclass(frozen=True)
class Picked:
    """A selection of columns times ``scale``, gathered only when needed: many problems use only the normal matrix."""

    columns: Columns
    position: Index
    scale: float
    lost: Index

    @property
    def readings(self) -> int:
        return self.columns.rows.shape[1] - len(self.lost)

    def part(self, position: Index) -> Picked:
        return Picked(self.columns, self.position[position], self.scale, self.lost)

    def linear(self, white: Floats) -> Floats:
        """The right-hand side (component, cell) for whitened readings."""
        kept = self.columns
        if len(self.lost):
            white = np.insert(white, self.lost - np.arange(len(self.lost)), 0.0)
        found = (kept.rows @ white).take(kept.picks(self.position))
        return np.asarray(found.reshape(kept.components, -1) * self.scale)

    def matrix(self) -> Floats:
        """The matrix (reading, component * cell)."""
        rows = self.columns.rows.take(self.columns.picks(self.position), axis=0)
        if len(self.lost):
            rows = np.delete(rows, self.lost, axis=1)
        if self.scale != 1.0:
            rows *= self.scale
        return rows.T

    def gram(self) -> Floats:
        if len(self.position) < self.columns.count and not self.columns.formed:
            found = self.matrix()
            return np.asarray(found.T @ found)
        found = self.columns.gram(self.position)
        if len(self.lost):
            gone = self.columns.rows[:, self.lost].take(self.columns.picks(self.position), axis=0)
            found -= gone @ gone.T
        found *= self.scale**2
        return found


@dataclass(frozen=True)
class Later:
    """A matrix (reading, component * cell) of ``readings`` rows that ``matrix`` computes at first use. With a known
    normal matrix few problems need it.
    """

    matrix: Callable[[], Floats]
    readings: int


@dataclass
class Normal:
    """Whitened columns of some cells of a level, and the right-hand side (component, cell) of their normal equations.

    ``given`` is the matrix: an array (reading, component * cell), `Applied`, or `Picked` or `Later`, which build it at
    first use; ``known`` is the normal matrix, if available.
    """

    level: Level
    cells: Index
    given: Any
    linear: Floats
    known: Floats | None = None

    @property
    def at_size(self) -> bool:
        """Whether the contact is too large for a matrix, so that products are used."""
        return isinstance(self.given, Applied)

    @cached_property
    def matrix(self) -> Any:
        """(reading, component * cell): an array, or `Applied`."""
        return self.given.matrix() if isinstance(self.given, Picked | Later) else self.given

    @cached_property
    def gram(self) -> Floats:
        """The normal matrix, computed at first use."""
        if self.known is not None:
            return self.known
        return self.given.gram() if isinstance(self.given, Picked) else self.matrix.T @ self.matrix

    def part(self, position: Index) -> Normal:
        """The normal equations of some of the cells."""
        if isinstance(self.given, Applied):
            return Normal(self.level, self.cells[position], self.given.part(position), self.linear[:, position])
        c, n = self.linear.shape
        picks = (np.arange(c)[:, None] * n + position[None, :]).ravel()
        known = self.gram.take(picks, axis=0).take(picks, axis=1) if self.formed else None
        if isinstance(self.given, Picked):
            given: Any = self.given.part(position)
        else:
            given = Later(lambda: self.matrix.take(picks, axis=1), self.readings)
        return Normal(self.level, self.cells[position], given, self.linear[:, position], known)

    def as_matrix(self) -> Normal:
        """Return this normal matrix with an explicit matrix of the readings instead of convolutions."""
        if not isinstance(self.given, Applied):
            return self
        rows = self.level.rows(self.cells, 1.0 / self.given.weight, self.given.observed)
        return Normal(self.level, self.cells, rows.T, self.linear)

    def along(self, ray: Floats) -> Normal:
        """Return the normal matrix for unknowns (1, cell) that multiply a fixed direction ``ray`` (component,) of the traction."""
        n = self.linear.shape[1]
        if isinstance(self.given, Applied):
            few = n <= FEW_ALONG and self.linear.size * len(self.given.weight) <= ENTRIES_ALONG
            if few and self.level.ratio > 1:
                # A third of the unknowns: a matrix is quickly formed and serves all models on parts of it, while
                # products would run on a finer grid.
                return self.as_matrix().along(ray)
            return Normal(self.level, self.cells, self.given.along(ray), (ray @ self.linear)[None])
        matrix = sum(a * self.matrix[:, i * n : (i + 1) * n] for i, a in enumerate(ray))
        known = None
        if self.formed:
            blocks = self.gram.reshape(len(ray), n, len(ray), n)
            known = np.einsum("c,cidj,d->ij", ray, blocks, ray, optimize=True)
        return Normal(self.level, self.cells, np.asarray(matrix), (ray @ self.linear)[None], known)

    def explained(self, pressure: Floats) -> Floats:
        """The normal matrix (component, component) of tractions that are a constant vector times a pressure."""
        c, n = self.linear.shape
        if self.formed:
            whole = self.gram.reshape(c, n, c, n)
            return np.asarray(np.einsum("i,cidj,j->cd", pressure, whole, pressure, optimize=True))
        seen = self.matrix.reshape(-1, c, n) @ pressure
        return np.asarray(seen.T @ seen)

    def quadratic(self, penalty: Penalty) -> Quadratic:
        """The normal matrix with a penalty."""
        if isinstance(self.given, Applied):
            return Products(self.given, penalty)
        if self.known is not None and not self.readings:  # blocks of cells have only a normal matrix
            return Formed(penalty.added(self.known.copy()))
        return formed_or_not(lambda: self.matrix.T, self.readings, lambda: self.gram, penalty)

    @property
    def readings(self) -> int:
        """Number of readings."""
        if isinstance(self.given, Picked | Later):
            return self.given.readings
        return len(self.matrix)

    @property
    def formed(self) -> bool:
        """Whether the normal matrix has been computed."""
        return self.known is not None or "gram" in self.__dict__


@dataclass
class ContactModel:
    """One model of a frame: a solution on some cells of a level.

    ``contact``, if given, is the same model on the cells that are certainly in contact; errors are computed from it.
    Otherwise cells where only noise presses, mostly beyond the array, would count fully in the errors. ``ray`` is the
    traction over the pressure if it is equal in all cells, and ``changes`` (change, component) its possible changes;
    ``hessian`` and ``penalty`` then belong to the pressure. ``shared`` (free, unknown) is the error due to unknowns
    that act on many readings. ``stated`` (free, unknown) is the change of traction due to the uncertainty of the pad,
    which no calibration constant scales. ``kind``: what distinguishes it from the other models of its frame.
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
    stated: Floats | None = None
    kind: str = ""
    #: Cache of `variances.taken_by`: the factor and the result.
    taken: tuple[Factor, float] | None = None

    @property
    def level(self) -> Level:
        return self.data.level

    @property
    def cells(self) -> Index:
        return self.data.cells

    @property
    def explained(self) -> Floats:
        """The whitened readings that it predicts."""
        return np.asarray(self.data.matrix @ self.solution.traction.ravel())

    @property
    def squares(self) -> float:
        """Squares of the residuals, minus those of the readings, in units of the noise."""
        t = self.solution.traction
        if self.data.formed:
            explained = float(t.ravel() @ (self.data.gram @ t.ravel()))
        else:
            explained = float((self.explained**2).sum())
        return explained - 2.0 * float((t * self.data.linear).sum())

    @property
    def pressure(self) -> Floats:
        """Pressure on the cells of the level's grid."""
        return scattered(self.solution.traction[-1], self.cells, self.level.grid.shape)


def scattered(values: Floats, cells: Index, shape: tuple[int, ...]) -> Floats:
    out = np.zeros(math.prod(shape))
    out[cells] = values
    return out.reshape(shape)


def dilated(region: Flags, cells: int) -> Flags:
    """The region and all within so many ``cells`` of it, diagonally too. SciPy's own takes five times as long."""
    out = region.copy()
    for axis, n in enumerate(region.shape):
        first, rest = ((slice(None),) * axis + (s,) for s in (slice(None, -1), slice(1, None)))
        for _ in range(min(cells, n - 1)):
            before = out.copy()
            out[rest] |= before[first]
            out[first] |= before[rest]
    return out
