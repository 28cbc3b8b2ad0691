"""Identification of what presses the pad: contact patches, radius of a ball or a flat, stiffness and texture.

In: readings, a skin and, if known, the indentation.
Out: each property with its interval, or the reason why the readings do not determine it.
Open first: `identify.py`.
"""

from palpate.identify.findings import Finding, Identified, IdentifiedPress, Patch
from palpate.identify.identify import identify

__all__ = ["Finding", "Identified", "IdentifiedPress", "Patch", "identify"]
