"""Contact surfaces that bend: a grid of cells on a chart, with positions, areas, normals and tangents.

A chart lays a curved surface out flat: its coordinates (x, y) [m] are those of the cells, of the array and of the result. Traction on a cell has three
components in the cell's own axes: along its two tangents, and along the normal into the pad. Net force and moment are sums of vectors in the pad's axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from palpate._arrays import from_numpy, namespace
from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.grids import AreaGrid, check_length

__all__ = ["Chart", "CurvedGrid", "CylinderChart", "Frames", "SphereChart"]

#: Points along each axis of a cell for sums of its area, force and moment. Inside, the error of midpoints is 1/24 of
#: the square of the angle between two; for a cell on the rim it is at most 1/8 of the cell along an axis.
SAMPLES = 4


@dataclass(frozen=True, eq=False)
class Frames:
    """A surface at some places.

    Attributes
    ----------
    positions : array (*places, 3) [m]
        In the pad's axes.
    axes : array (*places, component, 3)
        Unit vectors of the components of traction: two tangents, and the normal into the pad.
    stretch : array (*places)
        Area of the surface per area of the chart; 0 beside the surface.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing import SphereChart
    >>> frames = SphereChart(radius=10e-3, reach=np.pi / 2).frames(np.array([0.0]), np.array([0.0]))
    >>> frames.positions.tolist(), bool(np.allclose(frames.axes[0], np.eye(3))), frames.stretch.tolist()  # the top: axes of the pad
    ([[0.0, 0.0, 0.0]], True, [1.0])
    """

    positions: Floats
    axes: Floats
    stretch: Floats


@runtime_checkable
class Chart(Protocol):
    """A flat map of a curved surface.

    Examples
    --------
    >>> from palpate.sensing import Chart, SphereChart
    >>> chart = SphereChart(radius=10e-3, reach=1.0)
    >>> isinstance(chart, Chart), [[round(1e3 * x, 2) for x in pair] for pair in chart.outline]
    (True, [[-9.59, 9.59], [-9.59, 9.59]])

    >>> import numpy as np
    >>> chart.frames(np.zeros((2, 3)), np.zeros((2, 3))).axes.shape
    (2, 3, 3, 3)
    """

    @property
    def outline(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lowest and highest x, and lowest and highest y, of the chart [m]."""
        ...

    def frames(self, x: Floats, y: Floats) -> Frames:
        """The surface at coordinates (x, y) of the chart [m], of one shape."""
        ...


@dataclass(frozen=True, kw_only=True)
class SphereChart:
    """A cap of a sphere in Lambert's azimuthal equal-area projection: rho = 2 R sin(theta / 2) at the angle theta from the top.

    J. P. Snyder, Map Projections: A Working Manual, 1987, chapter 24. Areas are exact; far from the top lengths along meridians shrink and those across
    grow: by 1.41 at the equator. The tangents are those of the top, carried along meridians.

    Attributes
    ----------
    radius : float
        [m].
    reach : float
        Angle from the top to the rim [rad], below pi.
    center : (float, float, float)
        Position of the top [m]; the middle of the sphere is a radius further along z.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing import SphereChart
    >>> chart = SphereChart(radius=10e-3, reach=np.pi / 2)
    >>> side = chart.frames(np.array([chart.outline[0][1]]), np.array([0.0]))  # the equator
    >>> (1e3 * side.positions[0]).round(6).tolist(), side.axes[0, 2].round(6).tolist()  # its normal points to the middle
    ([10.0, 0.0, 10.0], [-1.0, -0.0, 0.0])
    """

    radius: float
    reach: float
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_length("radius", self.radius)
        if not 0.0 < self.reach < math.pi:
            raise InvalidInput(f"reach must be an angle between 0 and pi [rad]; got {self.reach!r}.")

    @property
    def outline(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Outline of the disc onto which the cap is mapped."""
        rho = 2.0 * self.radius * math.sin(0.5 * self.reach)
        return (-rho, rho), (-rho, rho)

    def frames(self, x: Floats, y: Floats) -> Frames:
        """Positions, axes and stretch; beside the cap those of the sphere as far as it goes, with stretch 0."""
        rho = np.hypot(x, y)
        safe = np.where(rho > 0.0, rho, 1.0)
        cos, sin = np.where(rho > 0.0, x / safe, 1.0), np.where(rho > 0.0, y / safe, 0.0)
        half = np.clip(rho / (2.0 * self.radius), 0.0, 1.0)
        theta = 2.0 * np.arcsin(half)
        out, up = np.sin(theta), 1.0 - np.cos(theta)
        positions = np.stack([self.radius * out * cos, self.radius * out * sin, self.radius * up], axis=-1)
        down = np.stack([np.cos(theta) * cos, np.cos(theta) * sin, out], axis=-1)
        round_ = np.stack([-sin, cos, np.zeros_like(cos)], axis=-1)
        first = cos[..., None] * down - sin[..., None] * round_
        second = sin[..., None] * down + cos[..., None] * round_
        normal = np.stack([-out * cos, -out * sin, np.cos(theta)], axis=-1)
        limit = self.outline[0][1] * (1.0 + 1e-9)
        return Frames(
            positions + np.array(self.center),
            np.stack([first, second, normal], axis=-2),
            (rho <= limit).astype(np.float64),
        )


@dataclass(frozen=True, kw_only=True)
class CylinderChart:
    """Part of a cylinder whose axis is along y, unrolled: x is the length along the arc from the top. Lengths and areas are exact.

    Attributes
    ----------
    radius : float
        [m]; positive where the pad lies inside the cylinder (a finger), negative where it lies round it (the crook of a bend).
    length, width : float
        Size of the patch along the arc and along y [m].
    center : (float, float, float)
        Position of the middle of the patch [m].

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing import CylinderChart
    >>> crook = CylinderChart(radius=-10e-3, length=20e-3, width=15e-3)
    >>> side = crook.frames(np.array([10e-3]), np.array([0.0]))  # 1 rad along the arc: the surface has risen
    >>> (1e3 * side.positions[0]).round(2).tolist(), side.axes[0, 2].round(3).tolist()
    ([8.41, 0.0, -4.6], [0.841, 0.0, 0.54])

    >>> crook.outline
    ((-0.01, 0.01), (-0.0075, 0.0075))
    """

    radius: float
    length: float
    width: float
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_length("length", self.length)
        check_length("width", self.width)
        if not (math.isfinite(self.radius) and self.length < 2.0 * math.pi * abs(self.radius)):
            raise InvalidInput(
                f"a patch {self.length!r} m long does not fit on a cylinder of radius {self.radius!r} m. Give a shorter length, in metres."
            )

    @property
    def outline(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Outline of the unrolled patch."""
        return (-0.5 * self.length, 0.5 * self.length), (-0.5 * self.width, 0.5 * self.width)

    def frames(self, x: Floats, y: Floats) -> Frames:
        """Positions, axes and stretch (1 on the patch, 0 beside it)."""
        angle = x / self.radius
        zero, one = np.zeros_like(angle), np.ones_like(angle)
        sin, cos = np.sin(angle), np.cos(angle)
        positions = np.stack([self.radius * sin, y + zero, self.radius * (1.0 - cos)], axis=-1)
        axes = np.stack(
            [
                np.stack([cos, zero, sin], axis=-1),
                np.stack([zero, one, zero], axis=-1),
                np.stack([-sin, zero, cos], axis=-1),
            ],
            axis=-2,
        )
        on = (np.abs(x) <= 0.5 * self.length * (1.0 + 1e-9)) & (np.abs(y) <= 0.5 * self.width * (1.0 + 1e-9))
        return Frames(positions + np.array(self.center), axes, on.astype(np.float64))


@dataclass(frozen=True, kw_only=True)
class CurvedGrid(AreaGrid):
    """A grid of cells on a curved surface: `AreaGrid` in the coordinates of a `chart`.

    Attributes
    ----------
    chart : Chart
        Position and orientation of each cell.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing import CurvedGrid, SphereChart
    >>> chart = SphereChart(radius=10e-3, reach=np.pi / 2)
    >>> grid = CurvedGrid(shape=(40, 40), spacing=2 * chart.outline[0][1] / 40, chart=chart)
    >>> round(float(grid.areas.sum() / (2 * np.pi * 10e-3**2)), 2)  # the half sphere
    1.0

    >>> grid.frames.positions.shape, grid.frames.axes.shape
    ((40, 40, 3), (40, 40, 3, 3))

    Pressure of 1 kPa all round the half sphere is 1 kPa on the disc below it, along z; nothing turns it.

    >>> pressed = np.zeros((3, 40, 40))
    >>> pressed[2] = 1000.0
    >>> bool(np.isclose(grid.total_force(pressed)[2], 1000.0 * np.pi * 10e-3**2, rtol=0.02))
    True

    >>> bool(np.abs(grid.total_moment(pressed)).max() < 1e-9)
    True

    >>> grid.force_axes([2]), grid.force_rows([2]).shape, grid.moment_rows([2]).shape  # pressure alone makes all three
    ((0, 1, 2), (3, 1, 40, 40), (3, 1, 40, 40))

    A standard deviation along the normal alone splits into equal parts along the pad's axes, sqrt(1/3) each: over a half sphere the mean square of each
    component of the normal is 1/3.

    >>> grid.turned_errors(np.array([0.0, 0.0, 1.0]), pressed).round(2).tolist()
    [0.58, 0.58, 0.58]
    >>> grid.turned_errors(np.array([1.0]), pressed[2:]).round(2).tolist()  # the same, where pressure alone is sought
    [0.58, 0.58, 0.58]

    >>> grid.bends, sorted(grid.labels)[:2], grid.cell_forces(pressed).shape  # the cells' forces sum to the net force
    (True, ['area', 'normal_x'], (3, 40, 40))

    >>> round(float(grid.integral(pressed[2]) / grid.total_force(pressed)[2]), 1)  # a half sphere has twice the area of its disc
    2.0
    """

    chart: Chart

    @cached_property
    def frames(self) -> Frames:
        """The surface at the cells' centres."""
        y, x = np.meshgrid(*self.axes, indexing="ij")
        return self.chart.frames(x, y)

    @cached_property
    def _sums(self) -> tuple[Floats, Floats, Floats]:
        """For each cell: area (*surface) [m^2], and net force [m^2] and moment about the origin [m^3] of unit traction
        (axis of the pad, component, *surface).
        """
        inside = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
        area, force, moment = np.zeros(self.shape), np.zeros((3, 3, *self.shape)), np.zeros((3, 3, *self.shape))
        for down in inside * self.spacings[0]:
            for along in inside * self.spacings[1]:
                y, x = np.meshgrid(self.y + down, self.x + along, indexing="ij")
                here = self.chart.frames(x, y)
                weight = here.stretch * self.cell / SAMPLES**2
                area += weight
                pull = here.axes * weight[..., None, None]
                force += np.moveaxis(pull, (-1, -2), (0, 1))
                moment += np.moveaxis(np.cross(here.positions[..., None, :], pull), (-1, -2), (0, 1))
        return area, force, moment

    @property
    def areas(self) -> Floats:
        """Area of each cell [m^2]; for a cell on the rim, only the part on the surface."""
        return self._sums[0]

    @property
    def _force(self) -> Floats:
        return self._sums[1]

    @property
    def _moment(self) -> Floats:
        return self._sums[2]

    @property
    def positions(self) -> Floats:
        """Centres of the cells (*surface, 3) in the pad's axes [m]."""
        return self.frames.positions

    @property
    def bends(self) -> bool:
        """True: this surface is curved, and its maps are drawn unrolled."""
        return True

    @property
    def labels(self) -> dict[str, Any]:
        """Additional coordinates of labelled results: position of each cell, its normal into the pad, and its area."""
        out: dict[str, Any] = {"area": (("y", "x"), self.areas, {"units": "m2"})}
        for i, axis in enumerate("xyz"):
            out[f"position_{axis}"] = (("y", "x"), self.frames.positions[..., i], {"units": "m"})
            out[f"normal_{axis}"] = (("y", "x"), self.frames.axes[..., 2, i], {"units": "1"})
        return out

    def cell_forces(self, traction: Floats) -> Floats:
        """Force on each cell (..., axis, *surface) of a traction (..., component, *surface), along the pad's axes."""
        return np.asarray(np.einsum("acyx,...cyx->...ayx", self._force, traction))

    def force_axes(self, columns: Sequence[int]) -> tuple[int, ...]:
        """All three axes: pressure on a curved surface has a component along each."""
        return (0, 1, 2)

    def force_rows(self, columns: Sequence[int]) -> Floats:
        """Rows that sum traction to the net force (axis of the pad, component sought, *surface)."""
        return self._force[:, list(columns)]

    def moment_rows(self, columns: Sequence[int]) -> Floats:
        """Rows that sum traction to the moment about the origin (axis of the pad, component sought, *surface)."""
        return self._moment[:, list(columns)]

    def integral(self, x: Any) -> Any:
        """Integral of fields (..., *surface) over the surface."""
        return namespace(x).sum(x * from_numpy(self.areas, x), axis=(-2, -1))

    def total_force(self, traction: Any) -> Any:
        """Net force (..., 3) of a traction (..., component, *surface), in the pad's axes [N]."""
        return self._summed(self._force, traction)

    def total_moment(self, traction: Any) -> Any:
        """Moment (..., 3) about the origin [N m]."""
        return self._summed(self._moment, traction)

    def _summed(self, rows: Floats, traction: Any) -> Any:
        xp = namespace(traction)
        parts = [xp.sum(traction * from_numpy(row, traction), axis=(-3, -2, -1)) for row in rows]
        return xp.stack(parts, axis=-1)

    def turned_errors(self, errors: Floats, traction: Floats) -> Floats:
        """Convert errors (component sought,) of a force in the axes of a contact to errors (axis of the pad,), at the
        cells of ``traction`` (component, *surface).

        With one component sought, the error is that of the normal. With two, the first is taken for that of both
        tangents and the second for that of the normal, since the components are not stated.
        """
        errors = np.asarray(errors, dtype=np.float64)
        if len(errors) < 3:
            errors = np.array([errors[0] if len(errors) == 2 else 0.0] * (3 - len(errors)) + errors.tolist())
        weights = np.sqrt((np.nan_to_num(traction) ** 2).sum(axis=0)) * self.areas
        if not weights.sum() > 0.0:
            return np.full(3, float(np.max(errors)))
        turn = np.tensordot(weights, self.frames.axes**2, 2) / weights.sum()
        return np.asarray(np.sqrt(np.square(errors) @ turn))
