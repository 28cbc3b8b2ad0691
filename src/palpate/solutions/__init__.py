"""Contacts and loads on a half-space in closed form, independent of the spectral code.

They make truth for simulations and tests, and the influence of one uniformly loaded surface cell, from which
`palpate.sensing` builds the non-periodic operator of a half-space.

In: sizes, loads and a pad or its moduli.
Out: contacts and loads with their traction, and their fields below the surface.
Open first: `area.py` (a plane pressed anywhere) or `line.py`.
"""

from palpate.solutions.area import (
    AreaContact,
    flat_punch,
    hertz_contact_radius,
    hertz_point,
    patch,
    point_load,
)
from palpate.solutions.elliptic import hertz_ellipse
from palpate.solutions.line import (
    LineContact,
    flat_punch_line,
    hertz_contact_half_width,
    hertz_line,
    line_load,
    strip,
)

__all__ = [
    "AreaContact",
    "LineContact",
    "flat_punch",
    "flat_punch_line",
    "hertz_contact_half_width",
    "hertz_contact_radius",
    "hertz_ellipse",
    "hertz_line",
    "hertz_point",
    "line_load",
    "patch",
    "point_load",
    "strip",
]
