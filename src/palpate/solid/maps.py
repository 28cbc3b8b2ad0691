"""Map of an array on many cells, as two factors: cells to the nodes of the surface, and nodes to readings.

A surface of 20,000 cells has some 2,000 nodes, so that the factors are a tenth of the matrix. Mirror symmetry makes the
second one block diagonal, a quarter again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import is_numpy
from palpate.elastic.channels import mirror_parity
from palpate.elastic.pad import Floats
from palpate.sensing.arrays import AreaArray, Array
from palpate.sensing.grids import Grid
from palpate.sensing.maps import Among, MatrixMap

__all__ = ["ThroughNodes", "mirrored_in"]

Index = npt.NDArray[np.intp]
#: Arrays and cells are centred to this fraction of the thickness.
CENTRED = 1e-9

#: Loads of a component of traction along an axis of the pad: a sparse matrix (cell, node).
Loads = Sequence[tuple[int, int, Any]]


class ThroughNodes(MatrixMap):
    """The map of an array in a `SolidPad`, whose adjoint is computed by its factors.

    ``fields`` (reading, axis, node) are those of `adjoint.fields`, in the order taxel, channel.
    """

    def __init__(self, pad: Any, array: Array, surface: Grid, matrix: Floats, fields: Floats, loads: Loads) -> None:
        super().__init__(matrix, array.shape)
        self._loads = loads
        ordered = fields.reshape(len(array.points), len(array.channels), -1).swapaxes(0, 1)
        self._folded = _Folded(ordered, array, pad._mirrors) if mirrored_in(pad, [array], surface) else None
        self._fields = ordered.reshape(len(fields), -1) if self._folded is None else None

    def adjoint(self, readings: Any, among: Among = None) -> Any:
        """The transpose of `forward`, by the factors for double precision in NumPy."""
        if not is_numpy(readings) or readings.dtype != np.float64:
            return super().adjoint(readings, among)
        batch = readings.shape[: -1 - len(self.taxels)]
        flat = readings.reshape(math.prod(batch), -1)
        if self._folded is not None:
            forces = self._folded.nodes(flat)
        else:
            forces = (flat @ self._fields).reshape(len(flat), 3, -1)
        wanted = range(self.count) if among is None else among
        out = np.zeros((len(flat), len(wanted), math.prod(self.cells)))
        for component, axis, load in self._loads:
            if component in wanted:
                out[:, list(wanted).index(component)] += (load @ forces[:, axis].T).T
        return out.reshape(*batch, len(wanted), *self.cells)


class _Folded:
    """Fields of a mirror-symmetric pad and array, in the four parities of readings."""

    def __init__(self, fields: Floats, array: Array, mirrors: tuple[Index, Index]) -> None:
        (rows, columns), channels = array.shape, array.channels
        count = fields.shape[-1] // 3
        own = np.arange(count)
        #: Nodes of one quadrant, and the images of these in all four.
        images = [own, mirrors[0], mirrors[1], mirrors[0][mirrors[1]]]
        quadrant = np.flatnonzero(own == np.min(images, axis=0))
        self.places = [image[quadrant] for image in images]
        self.count = count
        by_channel = fields.reshape(len(channels), rows, columns, 3, count)[..., quadrant]
        self.rows = (rows, columns)
        self.parts: list[tuple[list[tuple[int, int]], Floats, Floats]] = []
        half = [(rows + 1) // 2, (columns + 1) // 2]
        for sy, sx in itertools.product((1, -1), repeat=2):
            signs = [(sy * mirror_parity(c, "y"), sx * mirror_parity(c, "x")) for c in channels]
            parts = [
                _half(_half(part, y, half[0], 0), x, half[1], 1).reshape(half[0] * half[1], -1)
                for part, (y, x) in zip(by_channel, signs)
            ]
            # sign of the displacement along each axis of the pad in the images of a node
            turned = np.array(
                [[1.0, sx * (-1.0 if a == 0 else 1.0), sy * (-1.0 if a == 1 else 1.0), 0.0] for a in range(3)]
            )
            turned[:, 3] = turned[:, 1] * turned[:, 2]
            self.parts.append((signs, np.concatenate(parts), turned))
        self.half = half

    def nodes(self, flat: Floats) -> Floats:
        """Forces (frame, axis, node) of readings (frame, reading)."""
        images = flat.reshape(len(flat), -1, *self.rows)
        out = np.zeros((len(flat), 3, self.count))
        for signs, fields, turned in self.parts:
            folded = np.stack(
                [
                    _half(_half(images[:, c], y, self.half[0], 1), x, self.half[1], 2).reshape(len(flat), -1)
                    for c, (y, x) in enumerate(signs)
                ],
                axis=1,
            ).reshape(len(flat), -1)
            here = (folded @ fields).reshape(len(flat), 3, -1)
            part = np.empty_like(out)
            for place, sign in zip(self.places, turned.T):
                part[:, :, place] = sign[:, None] * here
            out += part
        return out


def mirrored_in(pad: Any, planes: Sequence[Array], surface: Grid) -> bool:
    """See `SolidPad.mirrored_in`."""
    if pad.chart is not None or not all(isinstance(a, AreaArray) and a.mask is None for a in planes):
        return False
    axes = [*surface.axes, *(x for a in planes if isinstance(a, AreaArray) for x in a.grid.axes)]
    if any(abs(float(x[0] + x[-1])) > CENTRED * pad.thickness for x in axes):
        return False
    return all(order is not None for order in pad._mirrors)


def _half(values: Floats, sign: int, half: int, axis: int) -> Floats:
    """Even (+1) or odd (-1) part along an axis, on its first half; the values stand for both halves together."""
    whole = values.shape[axis]
    part = 0.5 * (values + sign * np.flip(values, axis))
    part = np.take(part, np.arange(half), axis)
    weight = np.full(half, math.sqrt(2.0))
    if whole % 2:
        weight[-1] = 1.0
    return np.asarray(part * weight.reshape(-1, *(1,) * (values.ndim - axis - 1)))
