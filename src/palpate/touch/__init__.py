"""The result: traction on the surface, numbers derived from it, and their errors.

In: an `Estimate` of each frame with its surface and calibration of errors.
Out: `Touch`: labelled maps, net force, intervals, summary, tables, files.
Open first: `result.py`.
"""

from palpate.touch.fields import CalibratedForce
from palpate.touch.joining import joined
from palpate.touch.result import Touch
from palpate.touch.table import Forces

__all__ = ["CalibratedForce", "Forces", "Touch", "joined"]
