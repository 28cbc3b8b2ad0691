"""The press that a sensor is designed for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.errors import InvalidInput
from palpate.units import is_number

__all__ = ["Press"]


@dataclass(frozen=True, kw_only=True)
class Press:
    """A ball that presses and drags: Hertz's pressure, with shear of the same shape.

    Parameters
    ----------
    force : float
        Normal force [N]; [N/m] in line contact.
    contact_radius : float
        Radius of the contact [m], not of the ball; half-width in line contact.
    shear : float
        Tangential force along +x over the normal force. Used only if the channels separate shear from pressure.
    friction : float
        Coefficient of friction of the friction reserve.
    center : (float, float), optional
        Place (x, y) [m]; by default the middle of the array. In line contact y is not used.

    Raises
    ------
    InvalidInput
        A number that is not finite or out of range; the message says what is accepted.

    Examples
    --------
    >>> from palpate.design import Press
    >>> press = Press(force=2.0, contact_radius=2e-3, shear=0.3, friction=0.6)
    >>> round(press.mean_pressure(2)), press.contact_area(1)  # F / (pi a^2) [Pa] of an area, 2 a [m] of a line
    (159155, 0.004)
    """

    force: float
    contact_radius: float
    shear: float = 0.0
    friction: float = 0.5
    center: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name, unit in (("force", "newtons"), ("contact_radius", "metres"), ("friction", "")):
            value = getattr(self, name)
            if not is_number(value) or not value > 0:
                raise InvalidInput(
                    f"{name} must be a positive number{f' of {unit}' if unit else ''}; got {value!r}. Write press {name}= such as "
                    f"{ {'force': 1.0, 'contact_radius': 2e-3, 'friction': 0.5}[name]:g}."
                )
        if not is_number(self.shear) or not 0.0 <= self.shear < self.friction:
            raise InvalidInput(
                f"shear must be at least 0 and below friction = {self.friction:g}, or the contact slips; got {self.shear!r}. Raise friction, or give less shear."
            )
        if self.center is not None:
            place = self.center
            if not isinstance(place, tuple | list) or len(place) != 2 or not all(is_number(v) for v in place):
                raise InvalidInput(f"center must be (x, y) in metres; got {place!r}.")
            object.__setattr__(self, "center", (float(place[0]), float(place[1])))

    def mean_pressure(self, dimensions: int) -> float:
        """F/(pi a^2) in area contact (2), F/(2 a) in line contact (1) [Pa]."""
        return self.force / self.contact_area(dimensions)

    def contact_area(self, dimensions: int) -> float:
        """pi a^2 [m^2] in area contact (2), 2 a [m] in line contact (1)."""
        return math.pi * self.contact_radius**2 if dimensions == 2 else 2.0 * self.contact_radius

    def components(self, names: tuple[str, ...]) -> dict[str, float]:
        """Return the net force of each component among ``names``; the drag is along x.

        Examples
        --------
        >>> from palpate.design import Press
        >>> Press(force=2.0, contact_radius=2e-3, shear=0.3).components(("x", "z"))
        {'x': 0.6, 'z': 2.0}
        """
        all_of_them = {"x": self.shear * self.force, "y": 0.0, "z": self.force}
        return {c: all_of_them[c] for c in names}
