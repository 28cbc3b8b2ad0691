"""Contacts of a simulator (points and forces) as traction on a pad.

In: `Contacts`: points, forces and the geometry of both bodies.
Out: traction whose force and moment are those of the contacts: Hertz's pressure where both bodies are smooth, even pressure on flats.
Open first: `spread.py`.
"""

from palpate.pressing.contacts import Contacts
from palpate.pressing.shapes import SHAPES, Local, local_shape
from palpate.pressing.spread import Pressed, Surface

__all__ = ["SHAPES", "Contacts", "Local", "Pressed", "Surface", "local_shape"]
