"""Grids, arrays of sensing elements, and the linear operator from surface traction to readings."""

from palpate.sensing.arrays import AreaArray, Array, LineArray, ScatteredArray
from palpate.sensing.grids import AreaGrid, Grid, LineGrid
from palpate.sensing.operator import Operator
from palpate.sensing.surface import default_surface

__all__ = [
    "AreaArray",
    "AreaGrid",
    "Array",
    "Grid",
    "LineArray",
    "LineGrid",
    "Operator",
    "ScatteredArray",
    "default_surface",
]
