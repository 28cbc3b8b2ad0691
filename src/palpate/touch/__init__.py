"""The result: traction on the surface, what can be read off it, and how sure it is."""

from palpate.touch.result import Touch, joined

__all__ = ["Touch", "joined"]
