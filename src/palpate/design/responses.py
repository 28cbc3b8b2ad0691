"""Compute the readings of a press and their derivatives, with an operator on cells near the press only."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.elastic.pad import Floats, Pad
from palpate.errors import Unsupported
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.contacts import sampled
from palpate.sensing.grids import AreaGrid, Grid, LineGrid
from palpate.sensing.operator import Operator
from palpate.solutions import AreaContact, LineContact, hertz_line, hertz_point

__all__ = ["Responses", "array_middle", "pitch_of", "weights_of"]

#: Number of cells per depth and per contact radius: with two, readings and derivatives are within 1 % of exact ones.
CELLS = 2.0
#: Cells per depth and contact radius for the effect of a wrong depth or thickness, which is a difference of two operators.
COARSE_CELLS = 1.0
#: Largest number of cells along an axis of the grid near the press; wider grids have coarser cells.
MAX_CELLS = {1: 2000, 2: 121}
#: Step of finite differences as a fraction of depth plus contact radius, the length over which readings change.
STEP = 0.02
#: The same for second differences.
DRAWN = 0.1
#: Largest number of readings: more take minutes for each design.
MAX_READINGS = 20_000


def array_middle(planes: Sequence[Array]) -> Floats:
    """Return the middle of the working taxels (axis) [m], in the order of the array axes."""
    points = np.concatenate([p.points[p.valid.ravel()] for p in planes])
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def pitch_of(array: Array) -> float:
    """Return the distance of neighbouring taxels [m]: on a regular grid the larger of the two pitches, for scattered
    taxels the pitch of a square grid of the same density.
    """
    if not isinstance(array, ScatteredArray):
        return float(max(array.grid.spacings))
    extent = np.ptp(array.points, axis=0)
    n = len(array.points)
    if array.dimensions == 1:
        return float(extent[0]) / (n - 1)
    half = 0.5 * float(extent.sum()) / (n - 1)
    return half + math.sqrt(half**2 + float(np.prod(extent)) / (n - 1))


def weights_of(planes: Sequence[Array]) -> Floats:
    """Return 1/noise of each reading, in the order of the operator's rows."""
    parts = []
    for array in planes:
        if array.noise_std is None:
            names = ", ".join(array.channels)
            raise Unsupported(
                f"a design needs the noise of {names}: the resolution depends on it. Give the array noise=..., in the unit of the channel "
                '(in a file noise = "50 Pa"), from a datasheet or from frames at rest.'
            )
        parts.append(np.repeat(1.0 / np.asarray(array.noise_std), int(array.valid.sum())))
    return np.concatenate(parts)


class Responses:
    """Readings for unit forces of a round contact near one place, and their derivatives.

    Cells are half of the depth or of the contact radius wide, and cover only the surroundings of ``middle``, which is
    in the order of the array axes, up to ``reach`` [m].
    """

    def __init__(self, pad: Pad, planes: Sequence[Array], middle: Floats, reach: float, radius: float) -> None:
        self.pad, self.planes, self.middle = pad, tuple(planes), middle
        self.dimensions = planes[0].dimensions
        readings = sum(len(p.channels) * int(p.valid.sum()) for p in planes)
        if readings > MAX_READINGS:
            raise Unsupported(
                f"{readings:,} readings are too many for a design (at most {MAX_READINGS:,}). Describe a part of the array, a few depths wider than the press."
            )
        # readings do not resolve less than a taxel's aperture, however near the surface the taxel lies
        depth = min(max(p.depth, 0.5 * max(p.apertures)) for p in planes)
        self.length = depth + radius
        self.step = STEP * self.length
        self.grid = _around(planes[0], middle, reach + DRAWN * self.length, min(d for d in (depth, radius) if d > 0.0))
        self.operator = Operator(pad, planes, self.grid)
        self._rows = [p.valid.ravel() for p in planes]

    def coarse(self, radius: float) -> Responses:
        """Return the responses on few, coarse cells under one contact."""
        depth = min(max(p.depth, 0.5 * max(p.apertures)) for p in self.planes)
        fine = min(d for d in (depth, radius) if d > 0.0) * CELLS / COARSE_CELLS
        out = object.__new__(Responses)
        vars(out).update(vars(self))
        out.grid = _around(self.planes[0], self.middle, radius, fine)
        out.operator = Operator(self.pad, self.planes, out.grid)
        return out

    def contact(self, center: Floats, radius: float) -> Floats:
        """Return the traction of unit force (*cell) [Pa] at ``center``, which is in the order of the array axes."""
        found: LineContact | AreaContact
        if self.dimensions == 1:
            found = hertz_line(half_width=radius, force=1.0).shifted(float(center[0]))
        else:
            found = hertz_point(contact_radius=radius, force=1.0).shifted(float(center[1]), float(center[0]))
        cells = np.asarray(sampled(found, self.grid)[-1])
        # cells spread a load that is at a distance u from their middle: this adds a variance of h^2/12 + u^2, on average h^2/6, which is subtracted
        for axis in range(self.dimensions):
            cells = cells - (np.roll(cells, 1, axis) - 2.0 * cells + np.roll(cells, -1, axis)) / 12.0
        return cells

    def derivatives(self, center: Floats, radius: float) -> list[Floats]:
        """Return the traction of unit force and its derivatives with respect to the place along each array axis and to
        the radius (*cell).
        """
        out = [self.contact(center, radius)]
        for axis in range(self.dimensions):
            move = np.zeros(self.dimensions)
            move[axis] = self.step
            out.append((self.contact(center + move, radius) - self.contact(center - move, radius)) / (2.0 * self.step))
        change = min(self.step, 0.2 * radius)
        out.append((self.contact(center, radius + change) - self.contact(center, radius - change)) / (2.0 * change))
        return out

    def elongated(self, center: Floats, radius: float, axis: int) -> Floats:
        """Return the second derivative (*cell) of the traction of unit force with respect to the contact's place along
        an axis: the direction in which it changes if the contact is elongated.
        """
        move = np.zeros(self.dimensions)
        move[axis] = step = DRAWN * self.length
        sides = self.contact(center + move, radius) + self.contact(center - move, radius)
        return np.asarray((sides - 2.0 * self.contact(center, radius)) / step**2)

    def read(self, shapes: Floats, forces: Floats, operator: Operator | None = None) -> Floats:
        """Return readings (n, reading) of shapes (n, *cell) multiplied by forces (n, component)."""
        traction = np.einsum("n...,nc->nc...", shapes, forces)
        found = (operator or self.operator).forward(traction)
        n = len(shapes)
        return np.concatenate(
            [
                np.asarray(part).reshape(n, len(p.channels), -1)[:, :, rows].reshape(n, -1)
                for part, p, rows in zip(found, self.planes, self._rows)
            ],
            axis=1,
        )


def _around(array: Array, middle: Floats, reach: float, fine: float) -> Grid:
    """Return cells around a place. If the array is regular, a pitch has a whole number of cells, and taxels lie above
    centres of cells.
    """
    counts, spacings, centers = [], [], []
    for axis, place in enumerate(middle):
        width = max(fine / CELLS, 2.0 * reach / MAX_CELLS[array.dimensions])
        start = float(place)
        if not isinstance(array, ScatteredArray):
            pitch = array.grid.spacings[axis]
            width = pitch / math.ceil(pitch / width * (1 - 1e-9))
            if array.shape[axis] > 1 or array.dimensions == 1:
                start = float(array.grid.axes[axis][0])
        low, high = math.floor((place - reach - start) / width), math.ceil((place + reach - start) / width)
        counts.append(max(high - low + 1, 3))
        spacings.append(width)
        centers.append(start + 0.5 * (low + low + counts[-1] - 1) * width)
    if len(counts) == 1:
        return LineGrid(count=counts[0], spacing=spacings[0], center=centers[0])
    return AreaGrid(shape=(counts[0], counts[1]), spacing=(spacings[0], spacings[1]), center=(centers[1], centers[0]))
