"""Grids of the traction: uniform, cell-centred, on the surface."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, namespace
from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.elastic.quantities import COMPONENTS
from palpate.errors import InvalidInput

__all__ = [
    "AreaGrid",
    "Grid",
    "LineGrid",
    "block_means",
    "check_center",
    "check_count",
    "check_length",
    "divided",
    "refined",
    "repeated",
    "resampled",
    "unresolved",
]


def check_count(name: str, value: object, minimum: int = 2) -> int:
    """Return ``value`` as an int; raise `InvalidInput` unless it is a whole number >= ``minimum``."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < minimum:
        raise InvalidInput(f"{name} must be a whole number, at least {minimum}; got {value!r}.")
    return int(value)


def check_length(name: str, value: object, *, zero: bool = False, sign: bool = False) -> float:
    """Return ``value`` as a length [m]; raise `InvalidInput` if it is not a valid one."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise InvalidInput(f"{name} must be one number of metres; got {value!r}.")
    number = float(value)
    ok = math.isfinite(number) and (sign or number > 0 or (zero and number == 0))
    if not ok:
        kind = "finite" if sign else "finite and not negative" if zero else "finite and positive"
        raise InvalidInput(f"{name} must be {kind} [m]; got {value!r}.")
    return number


def pair(name: str, value: object, *, zero: bool = False, sign: bool = False) -> tuple[float, float]:
    """One length for both axes, or a pair (y, x) [m]."""
    if isinstance(value, tuple | list | np.ndarray):
        if len(value) != 2:
            raise InvalidInput(f"{name} must be one length or a pair; got {len(value)} numbers.")
        a, b = (check_length(name, v, zero=zero, sign=sign) for v in value)
        return a, b
    one = check_length(name, value, zero=zero, sign=sign)
    return one, one


def check_center(value: object) -> None:
    """Raise `InvalidInput` unless ``value`` is a place (x, y) [m]."""
    if not isinstance(value, tuple | list | np.ndarray):
        raise InvalidInput(f"center must be a place (x, y) in metres; got {value!r}.")
    pair("center", value, sign=True)


class _Flat:
    """Sums over the cells of a flat surface, whose traction components are along the pad's axes;
    `palpate.sensing.CurvedGrid` has the same members.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing import AreaGrid
    >>> grid = AreaGrid(shape=(2, 3), spacing=1e-3)
    >>> grid.areas.shape, grid.positions.shape, grid.bends, grid.labels
    ((2, 3), (2, 3, 3), False, {})

    >>> pressed = np.zeros((3, 2, 3))
    >>> pressed[2, 0, 2] = 1e6  # 1 MPa on the cell at x = 1 mm, y = -0.5 mm
    >>> float(grid.integral(pressed[2])), grid.cell_forces(pressed)[2, 0, 2].item()  # [N]
    (1.0, 1.0)

    >>> grid.total_force(pressed).tolist(), (1e3 * grid.total_moment(pressed)).round(6).tolist()  # [N], [N mm]
    ([0.0, 0.0, 1.0], [-0.5, -1.0, 0.0])

    >>> grid.force_axes([2]), grid.force_rows([2]).shape, grid.moment_rows([2]).shape  # pressure alone is sought
    ((2,), (1, 1, 2, 3), (3, 1, 2, 3))

    >>> grid.turned_errors(np.array([0.1, 0.1, 0.2]), pressed).tolist()  # the pad's axes are those of the contact
    [0.1, 0.1, 0.2]
    """

    if TYPE_CHECKING:  # no members: a dataclass would take them for defaults of its fields

        @property
        def dimensions(self) -> int: ...
        @property
        def shape(self) -> tuple[int, ...]: ...
        @property
        def axes(self) -> tuple[Floats, ...]: ...
        @property
        def cell(self) -> float: ...
        @property
        def components(self) -> tuple[str, ...]: ...

    @property
    def areas(self) -> Floats:
        """Area (on a line, length) of each cell (*surface)."""
        return np.full(self.shape, self.cell)

    @property
    def positions(self) -> Floats:
        """Centres of the cells (*surface, 3) in the pad's axes [m]."""
        places = [*np.meshgrid(*self.axes, indexing="ij")[::-1], *[np.zeros(self.shape)] * (3 - self.dimensions)]
        return np.stack(places, axis=-1)

    @property
    def bends(self) -> bool:
        """Whether the surface is curved, so that maps of it are unrolled."""
        return False

    @property
    def labels(self) -> dict[str, Any]:
        """Coordinates of labelled results besides the axes: none."""
        return {}

    def cell_forces(self, traction: Floats) -> Floats:
        """Force on each cell (..., axis, *surface) of a traction (..., component, *surface), along the pad's axes."""
        return traction * self.cell

    def force_axes(self, columns: Sequence[int]) -> tuple[int, ...]:
        """Axes of the pad that `force_rows` returns if ``columns`` are the components sought: the same."""
        return tuple(columns)

    def force_rows(self, columns: Sequence[int]) -> Floats:
        """Rows that sum traction to the net force (axis, component sought, *surface)."""
        n = len(columns)
        rows = np.zeros((n, n, *self.shape))
        rows[np.arange(n), np.arange(n)] = self.cell
        return rows

    def moment_rows(self, columns: Sequence[int]) -> Floats:
        """Rows that sum traction to the moments (moment, component sought, *surface)."""
        d, cell = self.dimensions, self.cell
        places = np.meshgrid(*self.axes, indexing="ij")[::-1]  # x, then y
        out = np.zeros((1 if d == 1 else 3, d + 1, *self.shape))
        if d == 1:
            out[0, 1] = -places[0] * cell
        else:
            x, y = places
            out[0, 2], out[1, 2] = y * cell, -x * cell
            out[2, 0], out[2, 1] = -y * cell, x * cell
        return out[:, list(columns)]

    def integral(self, x: Any) -> Any:
        """Integral of fields (..., *surface) over the surface."""
        return namespace(x).sum(x, axis=tuple(range(-self.dimensions, 0))) * self.cell

    def total_force(self, traction: Any) -> Any:
        """Net force (..., component) of a traction (..., component, *surface)."""
        return self.integral(traction)

    def total_moment(self, traction: Any) -> Any:
        """Moment of ``traction`` (..., component, *surface) [Pa] about the origin: (..., 3) [N m] about x, y and z on
        an area, (..., 1) [N] about y on a line; see `palpate.Touch.moment`.
        """
        xp, tail = namespace(traction), (slice(None),) * self.dimensions
        parts = [traction[(..., i, *tail)] for i in range(len(self.components))]
        x = from_numpy(self.axes[-1], traction)
        about_y = -self.integral(x * parts[-1])
        if self.dimensions == 1:
            return xp.stack([about_y], axis=-1)
        y = from_numpy(self.axes[0][:, None], traction)
        spin = self.integral(x * parts[1] - y * parts[0])
        return xp.stack([self.integral(y * parts[2]), about_y, spin], axis=-1)

    def turned_errors(self, errors: Floats, traction: Floats) -> Floats:
        """Convert errors of a force from a contact's axes (component,) to the pad's (axis,): equal if it is flat."""
        return errors


@dataclass(frozen=True, kw_only=True)
class LineGrid(_Flat):
    """A line of ``count`` surface cells of width ``spacing`` [m], centred at ``center`` [m].

    Raises
    ------
    InvalidInput
        Fewer than 2 cells along an axis, or a spacing that is not positive and finite.

    Examples
    --------
    >>> import palpate as pp
    >>> grid = pp.LineGrid(count=4, spacing=1e-3)
    >>> grid.x.round(6).tolist()
    [-0.0015, -0.0005, 0.0005, 0.0015]

    >>> grid.edges.round(6).tolist()
    [-0.002, -0.001, 0.0, 0.001, 0.002]

    >>> grid.dimensions, grid.shape, grid.spacings, grid.cell, grid.components
    (1, (4,), (0.001,), 0.001, ('x', 'z'))

    >>> [len(axis) for axis in grid.axes]
    [4]
    """

    count: int
    spacing: float
    center: float = 0.0

    def __post_init__(self) -> None:
        check_count("count", self.count)
        check_length("spacing", self.spacing)
        check_length("center", self.center, sign=True)

    @property
    def dimensions(self) -> int:
        """Number of axes: 1."""
        return 1

    @property
    def shape(self) -> tuple[int, ...]:
        """(count,)."""
        return (self.count,)

    @property
    def spacings(self) -> tuple[float, ...]:
        """Spacing of each axis [m]."""
        return (self.spacing,)

    @property
    def x(self) -> Floats:
        """Cell centres [m]."""
        return self.center + (np.arange(self.count) - (self.count - 1) / 2) * self.spacing

    @property
    def axes(self) -> tuple[Floats, ...]:
        """Cell centres of each axis, in the order of the array axes."""
        return (self.x,)

    @property
    def edges(self) -> Floats:
        """Cell edges [m], ``count + 1`` of them."""
        return np.append(self.x - self.spacing / 2, self.x[-1] + self.spacing / 2)

    @property
    def cell(self) -> float:
        """Length of a cell [m]; a sum over cells times this approximates an integral."""
        return self.spacing

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the traction components, ("x", "z")."""
        return COMPONENTS[1]


@dataclass(frozen=True, kw_only=True)
class AreaGrid(_Flat):
    """A grid of ``shape`` (ny, nx) surface cells.

    ``spacing`` [m] is one number or (dy, dx); ``center`` is (x, y) [m].

    Raises
    ------
    InvalidInput
        Fewer than 2 cells, or a spacing that is not positive and finite.

    Examples
    --------
    >>> import palpate as pp
    >>> grid = pp.AreaGrid(shape=(2, 3), spacing=1e-3, center=(5e-3, 0.0))  # 2 rows, 3 columns
    >>> grid.x.round(6).tolist(), grid.y.round(6).tolist()
    ([0.004, 0.005, 0.006], [-0.0005, 0.0005])

    >>> grid.dimensions, grid.spacings, round(grid.cell, 9), grid.components
    (2, (0.001, 0.001), 1e-06, ('x', 'y', 'z'))

    >>> [len(axis) for axis in grid.axes]  # (y, x)
    [2, 3]
    """

    shape: tuple[int, int]
    spacing: float | tuple[float, float]
    center: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.shape) != 2:
            raise InvalidInput(f"shape must be (ny, nx); got {self.shape!r}.")
        for n in self.shape:
            check_count("shape", n, 1)
        if max(self.shape) < 2:
            raise InvalidInput("shape must have at least 2 cells; got 1 x 1.")
        pair("spacing", self.spacing)
        check_center(self.center)

    @property
    def dimensions(self) -> int:
        """Number of axes: 2."""
        return 2

    @cached_property
    def spacings(self) -> tuple[float, ...]:
        """(dy, dx) [m]."""
        return pair("spacing", self.spacing)

    @property
    def x(self) -> Floats:
        """Cell centres along x [m]."""
        return self.center[0] + (np.arange(self.shape[1]) - (self.shape[1] - 1) / 2) * self.spacings[1]

    @property
    def y(self) -> Floats:
        """Cell centres along y [m]."""
        return self.center[1] + (np.arange(self.shape[0]) - (self.shape[0] - 1) / 2) * self.spacings[0]

    @property
    def axes(self) -> tuple[Floats, ...]:
        """(y, x): cell centres of each axis, in the order of the array axes."""
        return (self.y, self.x)

    @property
    def cell(self) -> float:
        """Area of a cell [m^2]; a sum over cells times this approximates an integral."""
        return self.spacings[0] * self.spacings[1]

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the traction components, ("x", "y", "z")."""
        return COMPONENTS[2]


#: Any kind of grid of surface cells.
Grid = LineGrid | AreaGrid


def refined(grid: Grid, ratio: int, margin: int = 0) -> Grid:
    """A grid of the same surface, ``margin`` cells wider on each side, with cells ``ratio`` times finer."""
    counts = [(n + 2 * margin) * ratio for n in grid.shape]
    if isinstance(grid, LineGrid):
        return LineGrid(count=counts[0], spacing=grid.spacing / ratio, center=grid.center)
    dy, dx = grid.spacings
    return replace(grid, shape=(counts[0], counts[1]), spacing=(dy / ratio, dx / ratio))


def divided(grid: Grid, counts: Sequence[int]) -> Grid:
    """A grid of the same surface with ``counts`` cells along the axes."""
    widths = [n * dx / count for n, dx, count in zip(grid.shape, grid.spacings, counts)]
    if isinstance(grid, LineGrid):
        return LineGrid(count=counts[0], spacing=widths[0], center=grid.center)
    return replace(grid, shape=(counts[0], counts[1]), spacing=(widths[0], widths[1]))


def resampled(field: Floats, counts: Sequence[int]) -> Floats:
    """A field (..., *cells) on ``counts`` cells of the same surface; its integral over the surface stays the same.

    Within a cell the field is linear, with the smaller of the differences to both neighbours as its slope, or 0 if
    they differ in sign: no cell gets a new extreme, and no pressure becomes negative. NaN stays NaN.
    """
    d = len(counts)
    missing = np.isnan(field)
    whole = np.where(missing, 0.0, field)
    maps = [_overlaps(n, count) for n, count in zip(field.shape[-d:], counts)]
    out = _along([m for m, _ in maps], whole)
    for axis in range(d):
        slope, _ = _slopes(whole, axis - d)
        out += _along([tilt if a == axis else m for a, (m, tilt) in enumerate(maps)], slope)
    if missing.any():
        out[_along([m for m, _ in maps], missing.astype(np.float64)) > 0.5] = np.nan
    return out


def unresolved(field: Floats, counts: Sequence[int]) -> Floats:
    """Standard deviation (..., *counts) of a field within its cells that `resampled` does not follow: the difference
    between the slopes to both neighbours, uniformly distributed over the cell along each axis.
    """
    d = len(counts)
    squares = np.zeros(field.shape)
    for axis in range(d):
        slope, steepest = _slopes(field, axis - d)
        squares += (steepest - np.abs(slope)) ** 2 / 12.0
    maps = [_overlaps(n, count)[0] for n, count in zip(field.shape[-d:], counts)]
    return np.sqrt(_along(maps, squares))


def _slopes(field: Floats, axis: int) -> tuple[Floats, Floats]:
    """The smaller of the differences to both neighbours, 0 if they differ in sign; and the larger magnitude."""
    step = np.diff(field, axis=axis)
    none = np.zeros_like(field.take([0], axis=axis))
    before, after = np.concatenate([none, step], axis), np.concatenate([step, none], axis)
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0.0, smaller, 0.0), np.maximum(np.abs(before), np.abs(after))


def _along(matrices: Sequence[Floats], field: Floats) -> Floats:
    """Apply one matrix (new, old) along each of the last axes."""
    for axis, matrix in enumerate(matrices):
        place = axis - len(matrices)
        field = np.moveaxis(np.moveaxis(field, place, -1) @ matrix.T, -1, place)
    return np.ascontiguousarray(field)


def _overlaps(cells: int, count: int) -> tuple[Floats, Floats]:
    """For ``count`` new cells on ``cells`` old ones: the part of each new cell that lies in each old one, and the same
    times the mean distance from the middle of the old cell, in its width; both (new, old).
    """
    ends = np.arange(count + 1) * (cells / count)
    low = np.maximum(ends[:-1, None], np.arange(cells))
    high = np.minimum(ends[1:, None], np.arange(cells) + 1.0)
    part = np.maximum(high - low, 0.0) * (count / cells)
    return part, part * (0.5 * (low + high) - (np.arange(cells) + 0.5))


def block_means(field: Floats, ratio: int, axes: int) -> Floats:
    """Means over blocks of ``ratio`` cells along each of the last ``axes`` axes."""
    for axis in range(field.ndim - axes, field.ndim):
        shape = (*field.shape[:axis], field.shape[axis] // ratio, ratio, *field.shape[axis + 1 :])
        field = field.reshape(shape).mean(axis=axis + 1)
    return field


def repeated(field: npt.NDArray[Any], ratio: int) -> npt.NDArray[Any]:
    """Repeat each cell of a field ``ratio`` times along each axis."""
    for axis in range(field.ndim):
        field = np.repeat(field, ratio, axis=axis)
    return field
