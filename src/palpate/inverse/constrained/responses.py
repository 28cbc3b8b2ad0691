"""Readings of a surface traction, and the adjoint: a matrix if that is small, else transforms."""

from __future__ import annotations

import math

import numpy as np

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.operator import Operator

__all__ = ["Responses"]

#: Largest number of entries of an operator as a matrix: above, transforms are as fast.
SMALL = 500_000


class Responses:
    """The operator between the components sought, ``columns``, and the vector of working readings."""

    def __init__(self, operator: Operator, columns: tuple[int, ...], readings: Readings) -> None:
        self.operator, self.columns, self.readings = operator, columns, readings

    def of(self, traction: Floats) -> Floats:
        """A t (reading,) of traction (component, cell), in its precision."""
        if self._matrix is not None:
            return np.asarray(self._matrix @ traction.ravel())
        grid = self.operator.surface
        full = np.zeros((len(grid.components), *grid.shape), dtype=traction.dtype)
        full[list(self.columns)] = traction.reshape(len(traction), *grid.shape)
        return self.readings.flat(self.operator.forward(full))

    def back(self, data: Floats) -> Floats:
        """A' data (component, cell) of readings (reading,)."""
        if self._matrix is not None:
            return np.asarray(data @ self._matrix).reshape(len(self.columns), -1)
        adjoint = self.operator.adjoint(self.readings.planes(data))
        return np.asarray(adjoint.reshape(len(adjoint), -1)[list(self.columns)])

    @cached_property
    def _matrix(self) -> Floats | None:
        """(reading, component * cell), if it is so small that matrix products are faster than transforms."""
        cells = math.prod(self.operator.surface.shape)
        if len(self.readings.std) * len(self.columns) * cells > SMALL:
            return None
        full = self.operator.columns(self.columns, np.arange(cells))
        return np.asarray(full.reshape(len(full), -1))
