"""Map from surface traction to readings, and its adjoint: by a matrix if small, otherwise by transforms."""

from __future__ import annotations

import math

import numpy as np

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.linear.whitening import Readings
from palpate.sensing.operator import Operator

__all__ = ["Responses"]

#: Largest number of entries for which a matrix is used: above, transforms are as fast.
SMALL = 500_000


class Responses:
    """The operator from the components sought (``columns``) to the vector of working readings."""

    def __init__(self, operator: Operator, columns: tuple[int, ...], readings: Readings) -> None:
        self.operator, self.columns, self.readings = operator, columns, readings

    def of(self, traction: Floats) -> Floats:
        """Readings A t (reading,) of a traction (component, cell), in its precision."""
        if self._matrix is not None:
            return np.asarray(self._matrix @ traction.ravel())
        grid = self.operator.surface
        full = np.zeros((len(grid.components), *grid.shape), dtype=traction.dtype)
        full[list(self.columns)] = traction.reshape(len(traction), *grid.shape)
        return self.readings.flat(self.operator.forward(full))

    def back(self, data: Floats, *, last: bool = False) -> Floats:
        """A' data (component, cell) for readings (reading,); ``last``: of the last component alone."""
        columns = self.columns[-1:] if last else self.columns
        if self._matrix is not None:
            cells = self._matrix.shape[1] // len(self.columns)
            matrix = self._matrix[:, -cells:] if last else self._matrix
            return np.asarray(data @ matrix).reshape(len(columns), -1)
        adjoint = self.operator.adjoint(self.readings.planes(data), columns)
        return np.asarray(adjoint.reshape(len(adjoint), -1))

    @cached_property
    def _matrix(self) -> Floats | None:
        """The matrix (reading, component * cell), if small enough to be faster than transforms; None otherwise."""
        cells = math.prod(self.operator.surface.shape)
        if len(self.readings.std) * len(self.columns) * cells > SMALL:
            return None
        full = self.operator.columns(self.columns, np.arange(cells))
        return np.asarray(full.reshape(len(full), -1))
