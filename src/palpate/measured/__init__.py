"""Pads that are known by what was measured on them: a table of presses instead of an elastic model."""

from palpate.measured.pad import Measured
from palpate.measured.table import Table

__all__ = ["Measured", "Table"]
