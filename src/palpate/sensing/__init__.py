"""Grids, arrays of sensing elements, and the operator from surface traction to readings.

In: a pad, an array and a surface.
Out: readings of a traction and the adjoint of that map; readings checked and labelled.
Open first: `operator.py`.
"""

from palpate.sensing.arrays import AreaArray, Array, LineArray, ScatteredArray
from palpate.sensing.curved import Chart, CurvedGrid, CylinderChart, Frames, SphereChart
from palpate.sensing.grids import AreaGrid, Grid, LineGrid
from palpate.sensing.maps import Body, LinearMap, MatrixMap
from palpate.sensing.operator import Operator
from palpate.sensing.surface import default_surface
from palpate.sensing.uncertainty import Uncertainty

__all__ = [
    "AreaArray",
    "AreaGrid",
    "Array",
    "Body",
    "Chart",
    "CurvedGrid",
    "CylinderChart",
    "Frames",
    "Grid",
    "LineArray",
    "LineGrid",
    "LinearMap",
    "MatrixMap",
    "Operator",
    "ScatteredArray",
    "SphereChart",
    "Uncertainty",
    "default_surface",
]
