"""Numbers of a design, and values of the variables of a sweep, as columns of tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

__all__ = ["LENGTHS", "NUMBERS", "value_text"]

#: Columns of a table: name, factor from SI units, and unit in area contact (`Sweep.unit`).
NUMBERS: dict[str, tuple[str, float, str]] = {
    "force": ("standard deviation of the normal force", 1e3, "mN"),
    "shear": ("standard deviation of the shear force", 1e3, "mN"),
    "center": ("standard deviation of the centre", 1e3, "mm"),
    "radius": ("standard deviation of the contact radius", 1e3, "mm"),
    "friction_reserve": ("standard deviation of the friction reserve", 1e3, "mN"),
    "width": ("width of a point", 1e3, "mm"),
    "pair": ("smallest separable pair", 1e3, "mm"),
    "wavelength": ("shortest wave recovered", 1e3, "mm"),
    "noticed": ("smallest noticed force", 1e3, "mN"),
    "blind": ("blind part of the array", 1e2, "%"),
    "range": ("range", 1.0, "N"),
}
#: Variables that are lengths.
LENGTHS = ("depth", "thickness", "pitch", "aperture")


def value_text(axis: str, value: Any, unit: str = "") -> str:
    """Return a value of a variable as text."""
    if isinstance(value, tuple | list):
        if value and isinstance(value[0], str):
            return _channels_text(value)
        return " x ".join(f"{1e3 * v:.3g} mm" if axis in LENGTHS else str(v) for v in value)
    if value is None or isinstance(value, str):
        return value or "-"
    if axis in LENGTHS:
        return f"{1e3 * value:.3g} mm"
    if axis == "youngs_modulus":
        return f"{1e-3 * value:.3g} kPa"
    return f"{value:.3g}{f' {unit}' if unit and unit != '1' else ''}"


def _channels_text(names: Sequence[str]) -> str:
    """Return channels as short text, such as "stress xz yz zz"."""
    kinds: dict[str, list[str]] = {}
    for name in names:
        kind, _, indices = name.partition("_")
        kinds.setdefault(kind, []).append(indices)
    return ", ".join(" ".join([kind, *which]) for kind, which in kinds.items())
