"""Traction force microscopy: displacement fields of other programs, or pictures of beads, in; what a cell does to its gel out."""

from palpate.microscopy.fields import Field
from palpate.microscopy.readers import is_field, read_field

__all__ = ["Field", "is_field", "read_field"]
