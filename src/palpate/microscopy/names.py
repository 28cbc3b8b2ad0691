"""Names that other programs give to displacements along x and y, to positions, and to marks of bad vectors."""

from __future__ import annotations

import re
from collections.abc import Iterable

from palpate.units import UNITS, plain_unit

__all__ = [
    "BOTH_STDS",
    "FLAGS",
    "FRAMES",
    "OUT_OF_PLANE",
    "POSITIONS",
    "STDS",
    "UNIT_NAMES",
    "VECTORS",
    "plain",
    "unit_in",
    "unit_of",
    "units_of",
    "which",
]

#: Pairs of names of displacements along x and y, in lower case.
VECTORS = (
    ("upost", "vpost"), ("u", "v"), ("ux", "uy"), ("u_x", "u_y"), ("dx", "dy"), ("displacement_x", "displacement_y"), ("disp_x", "disp_y"), ("u_filtered", "v_filtered"),
    ("u_original", "v_original"), ("u_smoothed", "v_smoothed"), ("u_component", "v_component"), ("ux1", "uy1"), ("vx", "vy"), ("umat", "vmat"),
)  # fmt: skip
#: Names of positions, of standard deviations, and of columns that mark bad vectors.
POSITIONS = (
    ("x", "y"), ("xw", "yw"), ("pos_x", "pos_y"), ("px", "py"), ("column", "row"), ("ref_x", "ref_y"), ("xvec", "yvec"), ("x_vec", "y_vec"),
    ("xpos", "ypos"), ("x_pos", "y_pos"), ("xgrid", "ygrid"), ("gridx", "gridy"), ("x0", "y0"),
)  # fmt: skip
STDS = (
    ("ex", "ey"), ("su", "sv"), ("std_u", "std_v"), ("u_std", "v_std"), ("ustd", "vstd"), ("stdu", "stdv"), ("uxstd", "uystd"), ("ux_std", "uy_std"), ("std_ux", "std_uy"),
    ("uncertainty_u", "uncertainty_v"), ("sigma_u", "sigma_v"), ("u_sigma", "v_sigma"), ("u_err", "v_err"), ("err_u", "err_v"),
)  # fmt: skip
#: Names of one standard deviation for both components.
BOTH_STDS = ("std", "ustd", "u_std", "sigma")
#: Names of the displacement out of the plane.
OUT_OF_PLANE = ("w", "uz", "u_z", "dz", "displacement_z", "disp_z")
#: Names of the number of the frame, in tables with several frames.
FRAMES = ("frame", "frames", "frame_number", "frame number", "timepoint")
#: Names of entries that state the units of positions and displacements.
UNIT_NAMES = ("units", "unit")
FLAGS = ("flags", "flag", "mask", "vector type", "typevector", "type", "chc")

_WRITTEN = {
    **dict.fromkeys(("pixel", "pixels", "pix", "px"), "px"), **dict.fromkeys(("micron", "microns", "micrometer", "micrometre", "micrometers", "micrometres"), "um"),
    **{unit.lower(): unit for unit in UNITS["length"]},
}  # fmt: skip
_UNIT = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]")


def plain(name: str) -> str:
    """A column's name without its unit, quotes and case: 'U [px/frame]' is "u"."""
    return _UNIT.sub("", name).strip().strip("\"'").strip().lower().replace(" component", "_component")


def unit_in(name: str) -> str | None:
    """Return the unit in brackets of a name, or None: 'u [px/frame]' gives "px", 'u (um)' gives "um"."""
    found = _UNIT.search(name)
    if found is None:
        return None
    return unit_of(found[1])


def unit_of(text: str) -> str | None:
    """Return the canonical name of a unit: "px" for "pixels/frame", "um" for "microns"; None if it is not a unit."""
    unit = re.sub(r"/\s*(frame|fr|pair)s?$", "", text.strip().strip("[]").strip(), flags=re.IGNORECASE)
    return _WRITTEN.get(unit.lower(), plain_unit(unit)) or None


def units_of(text: str) -> tuple[str | None, str | None]:
    """Units of positions and displacements in a text: "[px] respectively [px/frame]" (PIVlab), or one for both."""
    parts = re.split(r"\s+respectively\s+|\s*;\s*|\s*,\s*", text.strip())
    return (unit_of(parts[0]), unit_of(parts[1])) if len(parts) == 2 else (unit_of(text), unit_of(text))


def which(names: Iterable[str], pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the pairs of which both names are present."""
    there = set(names)
    return [pair for pair in pairs if pair[0] in there and pair[1] in there]
