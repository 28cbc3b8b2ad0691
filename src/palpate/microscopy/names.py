"""What the files of others call displacements along x and y, positions, and marks of bad vectors."""

from __future__ import annotations

import re
from collections.abc import Iterable

from palpate.units import plain_unit

__all__ = ["FLAGS", "POSITIONS", "STDS", "VECTORS", "plain", "unit_in", "which"]

#: Names of displacements along x and y that belong together, in lower case.
VECTORS = (
    ("u", "v"), ("ux", "uy"), ("u_x", "u_y"), ("dx", "dy"), ("displacement_x", "displacement_y"), ("disp_x", "disp_y"), ("u_filtered", "v_filtered"),
    ("u_original", "v_original"), ("u_smoothed", "v_smoothed"), ("u_component", "v_component"), ("ux1", "uy1"), ("vx", "vy"),
)  # fmt: skip
#: And of positions, standard deviations, and columns that mark bad vectors.
POSITIONS = (("x", "y"), ("xw", "yw"), ("pos_x", "pos_y"), ("px", "py"), ("column", "row"))
STDS = (("ex", "ey"), ("su", "sv"), ("std_u", "std_v"), ("u_std", "v_std"), ("uncertainty_u", "uncertainty_v"))
FLAGS = ("flags", "flag", "mask", "vector type", "typevector", "type", "chc")

_UNIT = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]")


def plain(name: str) -> str:
    """A column's name without its unit, quotes and case: 'U [px/frame]' is "u"."""
    return _UNIT.sub("", name).strip().strip("\"'").strip().lower().replace(" component", "_component")


def unit_in(name: str) -> str | None:
    """The unit that a name holds in brackets: 'u [px/frame]' says "px", 'u (um)' says "um"; None where it holds none."""
    found = _UNIT.search(name)
    if found is None:
        return None
    unit = re.sub(r"/\s*(frame|fr|pair)s?$", "", found[1].strip(), flags=re.IGNORECASE)
    return {"pixel": "px", "pixels": "px", "pix": "px"}.get(unit.lower(), plain_unit(unit))


def which(names: Iterable[str], pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """The pairs whose names are both there."""
    there = set(names)
    return [pair for pair in pairs if pair[0] in there and pair[1] in there]
