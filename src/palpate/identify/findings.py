"""Properties of an object: numbers with intervals, or the reason why they are not determined."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.elastic.pad import Floats
from palpate.touch.rounding import format_interval

__all__ = ["Finding", "Identified", "IdentifiedPress", "Patch"]

#: Units for display, by SI unit: factor and name.
READ = {"m": (1e3, "mm"), "m^2": (1e6, "mm^2"), "Pa": (1e-3, "kPa"), "N/m": (1e-3, "N/mm")}


@dataclass(frozen=True)
class Finding:
    """A number with its 95 % interval, or the reason why the readings do not determine it.

    Attributes
    ----------
    value : float
        In SI units; NaN if not determined.
    low, high : float
        Ends of the 95 % interval. They may bound a quantity without a value: "at least" has an infinite upper end.
    unit : str
    reason : str
        Why it is not determined, or an assumption; else "".

    Examples
    --------
    >>> from palpate.identify import Finding
    >>> str(Finding(0.0102, 0.0096, 0.0109, "m")), str(Finding.unknown("m", "nothing touches"))
    ('10.20 mm (9.60 to 10.90)', 'unknown: nothing touches')
    """

    value: float
    low: float = math.nan
    high: float = math.nan
    unit: str = "1"
    reason: str = ""

    @classmethod
    def unknown(cls, unit: str, reason: str, *, low: float = math.nan, high: float = math.nan) -> Finding:
        """Return a finding that the readings do not determine, for this ``reason``; it may have bounds."""
        return cls(math.nan, low, high, unit, reason)

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return math.isfinite(self.value)

    def __str__(self) -> str:
        if not self.known:
            return f"unknown: {self.reason}"
        factor, unit = READ.get(self.unit, (1.0, "" if self.unit == "1" else self.unit))
        return format_interval(self.value, self.low, self.high, factor=factor, unit=unit)


@dataclass(frozen=True)
class Patch:
    """One patch of contact.

    Attributes
    ----------
    force : tuple of Finding
        Net force (x, y, z) [N].
    center : tuple of Finding
        Middle (x, y) [m].
    area : Finding
        Area of the contact [m^2].
    contact_radius : Finding
        Radius of a round contact [m].

    Examples
    --------
    >>> from palpate.identify import Finding, Patch
    >>> one = Finding(1.0, 0.9, 1.1, "N")
    >>> print(Patch((one, one, one), (Finding(0.0, unit="m"),) * 2, Finding(1e-6, unit="m^2"), Finding(5e-4, unit="m")))
    1.00 N (0.90 to 1.10) at x 0 mm, y 0 mm, area 1 mm^2
    """

    force: tuple[Finding, Finding, Finding]
    center: tuple[Finding, Finding]
    area: Finding
    contact_radius: Finding

    def __str__(self) -> str:
        area = str(self.area) if self.area.known else f"({self.area})"
        return f"{self.force[2]} at x {self.center[0]}, y {self.center[1]}, area {area}"


@dataclass(frozen=True)
class Identified:
    """The object that presses the pad in one frame. Every `Finding` has a value with its interval, or a reason why it
    has none.

    Attributes
    ----------
    shape : str
        "ball", "flat" (a round flat punch), or "" if the readings do not decide: ``shape_reason`` then says why.
    patches : tuple of Patch
        The contacts, largest force first.
    count : Finding
        Their number.
    radius : Finding
        Radius of the ball, or of the flat [m].
    modulus : Finding
        Young's modulus over 1 - nu^2 of the object [Pa]; it needs the indentation.
    effective_modulus : Finding
        E* of pad and object together [Pa]: 1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2; it needs the indentation.
    stiffness : Finding
        Change of the normal force with the indentation [N/m].
    texture : Finding
        Power of the strongest wave of the pressure within the contact, relative to the pressure: (amplitude^2)/2.
    texture_wavelength : Finding
        Its wavelength [m].
    misfit : float
        Misfit probability: the probability of a residual at least this large from noise. Below 0.01 the patches do not explain the readings.

    Examples
    --------
    >>> from palpate.identify import Identified
    >>> Identified.nothing("nothing touches").radius.known
    False
    """

    shape: str
    shape_reason: str
    patches: tuple[Patch, ...]
    count: Finding
    radius: Finding
    modulus: Finding
    effective_modulus: Finding
    stiffness: Finding
    texture: Finding
    texture_wavelength: Finding
    misfit: float = math.nan

    @classmethod
    def nothing(cls, reason: str) -> Identified:
        """Return findings without any value, all for the same reason."""
        units = ("m", "Pa", "Pa", "N/m", "1", "m")
        count = Finding(0.0, 0.0, 0.0, "1") if reason == "nothing touches" else Finding.unknown("1", reason)
        none = [Finding.unknown(u, reason) for u in units]
        return cls("", reason, (), count, none[0], none[1], none[2], none[3], none[4], none[5])

    def __str__(self) -> str:
        lines = [f"shape           {self.shape or f'unknown: {self.shape_reason}'}"]
        many = len(self.patches) > 1
        lines += [f"{f'patch {i}' if many else 'patch':15} {p}" for i, p in enumerate(self.patches, 1)]
        if not self.patches:
            lines.append(f"patches         {self.count}")
        rows = {
            "radius": self.radius,
            "object modulus": self.modulus,
            "stiffness": self.stiffness,
            "texture power": self.texture,
        }
        lines += [f"{name:15} {_with_reason(found)}" for name, found in rows.items()]
        if self.texture_wavelength.known and self.texture.value > 0:
            lines.append(f"{'wavelength':15} {self.texture_wavelength}")
        return "\n".join(lines)


@dataclass(frozen=True)
class IdentifiedPress:
    """The object that presses, from all frames of a recording.

    Attributes
    ----------
    frames : tuple of Identified
        The findings of each single frame.
    growth : Finding
        n in contact radius ~ force^n: 1/3 for a ball, 0 for a flat.
    shape : str
        "ball" or "flat" if the growth or the frames distinguish them, else "".
    radius, modulus, effective_modulus, stiffness : Finding
        As of one frame, from all of them; stiffness at the largest force.

    Examples
    --------
    >>> from palpate.identify import Finding, Identified, IdentifiedPress
    >>> told = Finding.unknown("1", "one frame")
    >>> len(IdentifiedPress((Identified.nothing("nothing touches"),), told, "", told, told, told, told))
    1
    """

    frames: tuple[Identified, ...]
    growth: Finding
    shape: str
    radius: Finding
    modulus: Finding
    effective_modulus: Finding
    stiffness: Finding

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, index: int) -> Identified:
        return self.frames[index]

    @property
    def forces(self) -> Floats:
        """Normal force of all patches together in each frame [N]; 0 without contact, NaN if the patches or the force of
        one are unknown.
        """
        each = [sum(p.force[2].value for p in f.patches) if f.count.known else math.nan for f in self.frames]
        return np.array(each, dtype=np.float64)

    def __str__(self) -> str:
        rows = {
            "growth": self.growth,
            "radius": self.radius,
            "object modulus": self.modulus,
            "stiffness": self.stiffness,
        }
        counts = [len(f.patches) for f in self.frames]
        lines = [f"frames          {len(self)}, patches {min(counts)} to {max(counts)}"]
        lines += [f"{name:15} {_with_reason(found)}" for name, found in rows.items()]
        return "\n".join(lines)


def _with_reason(found: Finding) -> str:
    return f"{found}; {found.reason}" if found.known and found.reason else str(found)
