"""Contacts that a simulator tells as points and forces, as traction on a pad.

A rigid-body simulator knows where bodies touch, with what force, and their geometry; it does not know how the force is spread. `Contacts` holds what it
knows, `spread` makes the traction: Hertz's pressure where both bodies are smooth (`shapes` tells the curvature), an even pressure over what is flat, and
shear as Cattaneo and Mindlin's. Force and moment of the traction are those of the contacts.
"""

from palpate.pressing.contacts import Contacts
from palpate.pressing.shapes import SHAPES, Local, local_shape
from palpate.pressing.spread import Pressed, Surface

__all__ = ["SHAPES", "Contacts", "Local", "Pressed", "Surface", "local_shape"]
