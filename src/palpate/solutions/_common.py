"""Shared code of line and area solutions."""

from __future__ import annotations

from typing import Any

from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import offered
from palpate.errors import InvalidInput, Unsupported
from palpate.units import is_number

__all__ = ["check_half_space", "finite", "positive", "slip_ratio", "smoothed_modulus"]


def positive(name: str, value: float, unit: str) -> float:
    """``value`` as a float, or `InvalidInput` unless it is positive and finite, with squares that are too."""
    number = finite(name, value, unit)
    if not 1e-60 < number < 1e60:
        raise InvalidInput(f"{name} must be a positive, finite number of {unit}; got {value!r}.")
    return number


def finite(name: str, value: Any, unit: str) -> float:
    """``value`` as a float, or `InvalidInput` unless it is a finite number."""
    if not is_number(value):
        raise InvalidInput(f"{name} must be a finite number of {unit}; got {value!r}.")
    return float(value)


def smoothed_modulus(pad: HalfSpace) -> float:
    """Plane-strain modulus E* = E/(1 - nu^2) [Pa] of a pad pressed by a rigid body."""
    if not isinstance(pad, HalfSpace):
        raise Unsupported(
            f"the radius of a contact is known in closed form on a HalfSpace only; got {type(pad).__name__}. On any pad, "
            "give hertz_point(contact_radius=...) or hertz_line(half_width=...) the size of the contact itself."
        )
    return pad.youngs_modulus / (1.0 - pad.poissons_ratio**2)


def check_half_space(pad: object) -> None:
    """Raise `Unsupported` unless ``pad`` is a `HalfSpace` whose closed forms hold (no subclass changed its states)."""
    if not isinstance(pad, HalfSpace) or not offered(pad, "influence"):
        raise Unsupported(
            f"closed-form fields are those of a HalfSpace; got {type(pad).__name__}. Use Skin(pad, array).sense(contact)."
        )


def slip_ratio(friction: float, tangential_force: float, normal_force: float) -> float:
    """|Q|/(mu P), or `InvalidInput` if the contact would slide."""
    ratio = abs(tangential_force) / (positive("friction", friction, "(dimensionless)") * normal_force)
    if not ratio < 1.0:
        raise InvalidInput(
            f"the tangential force {tangential_force:g} reaches friction * normal force = {friction * normal_force:g}: "
            "the contact slides as a whole. Use sliding(friction), or a smaller tangential force."
        )
    return ratio
