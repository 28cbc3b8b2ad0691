"""Pads known from measured presses instead of an elastic model.

In: a table of presses: place, force, readings and radius of the indenter.
Out: a pad that serves `Skin` like any other, with the error of its map.
Open first: `pad.py`.
"""

from palpate.measured.pad import Measured
from palpate.measured.table import Table

__all__ = ["Measured", "Table"]
