"""The result: traction on the surface, what can be read off it, and how sure it is."""

from palpate.touch.joining import joined
from palpate.touch.result import Touch
from palpate.touch.table import Forces

__all__ = ["Forces", "Touch", "joined"]
