"""What presses the pad: contact patches, radius of a ball or a flat, stiffness and texture, each with its interval or the reason why nothing tells it."""

from palpate.identify.findings import Finding, Identified, IdentifiedPress, Patch
from palpate.identify.identify import identify

__all__ = ["Finding", "Identified", "IdentifiedPress", "Patch", "identify"]
