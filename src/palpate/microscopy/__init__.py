"""Traction force microscopy: forces of cells, sheets and pillars on a gel.

In: displacement fields of other programs, or pictures of beads before and after.
Out: strain energy, contractility, moment, adhesions and tensions, each with its interval.
Open first: `cell.py`.
"""

from palpate.microscopy.beads import bead_displacements
from palpate.microscopy.cell import CellForces, Quantity, cell_forces
from palpate.microscopy.fields import Field
from palpate.microscopy.film import Film
from palpate.microscopy.labels import LabelForce, forces_of_labels, read_labels
from palpate.microscopy.masks import on_grid, read_mask
from palpate.microscopy.pictures import read_pair, read_picture
from palpate.microscopy.pillars import Pillar, PillarForces, pillar_forces, read_pillars
from palpate.microscopy.pixelsize import PixelSize, pixel_size
from palpate.microscopy.readers import is_field, read_field
from palpate.microscopy.series import frames_of_field
from palpate.microscopy.tension import BorderTension, RegionTension, SheetTension, sheet_tension

__all__ = [
    "BorderTension",
    "CellForces",
    "Field",
    "Film",
    "LabelForce",
    "Pillar",
    "PillarForces",
    "PixelSize",
    "Quantity",
    "RegionTension",
    "SheetTension",
    "bead_displacements",
    "cell_forces",
    "forces_of_labels",
    "frames_of_field",
    "is_field",
    "on_grid",
    "pillar_forces",
    "pixel_size",
    "read_field",
    "read_labels",
    "read_mask",
    "read_pair",
    "read_picture",
    "read_pillars",
    "sheet_tension",
]
