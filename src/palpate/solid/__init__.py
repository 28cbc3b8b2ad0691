"""Pads with edges or bends, by finite elements. Needs palpate[solid].

In: a box, dome, bend or mesh, and its material.
Out: a pad that makes its own maps (`response`, `patch`), and files of it.
Open first: `pad.py`.
"""

from palpate.solid.pad import SolidPad

__all__ = ["SolidPad"]
