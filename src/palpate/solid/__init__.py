"""Pads with edges, by finite elements."""

from palpate.solid.pad import SolidPad

__all__ = ["SolidPad"]
