"""Scale the standard deviations of the model to intervals that contain the truth as often as they state.

The constants are data: ``constants.json`` beside this file, written by ``palpate bench calibration --write``, with the
population, seed and version of the code that made each entry. One entry serves one method and one `Case`: line, area
with pressure alone, area with shear (with or without channels that separate the two), few or many taxels; the kind of
channels; half-space or layers. A case without its own entry uses the nearest
one and says so.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats, Pad
from palpate.errors import Unsupported
from palpate.sensing.arrays import Array

__all__ = [
    "AMBIGUOUS",
    "FEW",
    "FEW_TAXELS",
    "GAUSSIAN",
    "QUANTITIES",
    "Calibration",
    "Case",
    "Constants",
    "calibrated",
    "constants",
    "contact_kind",
]

#: Methods whose error bars are those of a Gaussian model, in which traction may have either sign. Without calibration
#: they are used unchanged.
GAUSSIAN = ("tikhonov", "local", "hilgers", "truncated", "wiener")
#: Area contact in which the channels alone do not separate pressure from shear.
AMBIGUOUS = "area, ambiguous"
#: Suffix for an area contact with fewer taxels than FEW_TAXELS: there noise creates pressure on only few cells beside
#: the contact, which adds little to the force.
FEW, FEW_TAXELS = ", few taxels", 144
#: Normal deviation beyond which a probability counts as 0, and number of bisection steps that find one.
FARTHEST, HALVINGS = 38.0, 45
#: Quantities that have constants.
QUANTITIES = ("traction", "force", "moment", "center_of_pressure", "peak_pressure", "slip_margin")


@dataclass(frozen=True)
class Calibration:
    """Distribution of a quantity's error in units of the model's standard deviation: b + s t_nu, with shift b, scale s
    and Student's t.

    Attributes
    ----------
    shift : float
        b, the error's median.
    scale : float
        s.
    freedom : float
        Degrees of freedom nu of Student's distribution.
    """

    shift: float = 0.0
    scale: float = 1.0
    freedom: float = 1e6

    def quantile(self, level: float) -> float:
        """Return half the width of the central interval of this level, in units of ``scale``."""
        import scipy.special

        return float(scipy.special.stdtrit(self.freedom, 0.5 * (1.0 + level)))

    def above(
        self,
        limit: Floats | float,
        value: Floats,
        std: Floats,
        outside: Floats,
        stated: Floats | float = 0.0,
        beyond: Floats | float = 0.0,
    ) -> Floats:
        """Return the probability that the true value lies above ``limit``: that of the level at which the interval
        from `bounds` ends at the limit.
        """
        import scipy.special

        size, stated = np.hypot(self.scale * std, outside), np.asarray(stated)
        gap = np.asarray(limit - value - self.shift * std)
        stated = np.hypot(stated, np.where(gap * np.sign(value) > 0, beyond, 0.0) / Calibration().quantile(0.95))
        # bisect for the normal deviation at which half the width of the interval equals the gap
        low, high = np.zeros(np.shape(gap)), np.full(np.shape(gap), FARTHEST)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            with np.errstate(invalid="ignore"):  # no size, far out
                reach = np.hypot(
                    size * scipy.special.stdtrit(self.freedom, scipy.special.ndtr(-middle)), stated * middle
                )
            short = reach < np.abs(gap)
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        chance = np.where((size > 0) | (stated > 0), scipy.special.ndtr(-np.sign(gap) * low), value > limit)
        # for an unknown value neither exceeding the limit nor staying below it can be excluded
        return np.asarray(np.where(np.isfinite(size + stated + value), chance, np.nan), dtype=np.float64)

    def bounds(
        self,
        level: float,
        value: Floats,
        std: Floats,
        outside: Floats,
        floor: Floats,
        *,
        stated: Floats | float = 0.0,
        away: bool = False,
        beyond: Floats | float = 0.0,
    ) -> tuple[Floats, Floats]:
        """Return the ends of the central interval of a level, none below ``floor``. ``stated`` is a standard deviation
        that is normal and not scaled. With ``away`` the shift is away from zero. ``beyond`` is what may be missing
        from the value at a level of 95 %; it widens the interval only on the side away from zero.
        """
        half = self.quantile(level) * np.hypot(self.scale * std, outside)
        half = np.hypot(half, Calibration().quantile(level) * stated)
        middle = value + std * (self.shift * np.sign(value) if away else self.shift)
        plain = Calibration()
        far = np.hypot(half, plain.quantile(level) / plain.quantile(0.95) * beyond)
        below, above = np.where(np.asarray(value) < 0, far, half), np.where(np.asarray(value) > 0, far, half)
        return np.maximum(middle - below, floor), np.maximum(middle + above, floor)

    def standardised(self, truth: Floats, value: Floats, std: Floats, outside: Floats) -> Floats:
        """Return (truth - value)/std in such a form that `bounds` for a value of 0 and a std of 1 contains it if the
        true bounds contain the truth.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            far = self.shift + (truth - value - self.shift * std) * self.scale / np.hypot(self.scale * std, outside)
            return np.asarray(np.where(outside > 0, far, (truth - value) / std))


@dataclass(frozen=True)
class Case:
    """The case that a set of constants is for.

    Attributes
    ----------
    contact : str
        "line", "area" (pressure alone), "area with shear", or "area, ambiguous": with shear that the channels alone do
        not separate from pressure; ", few taxels" follows the second and third on arrays of 144 taxels or less.
    sensing : str
        Kind of the channels: "stress", "strain", "displacement", or "mixed".
    body : str
        "half-space" or "layers".
    """

    contact: str
    sensing: str = "stress"
    body: str = "half-space"

    @classmethod
    def of(cls, pad: Pad, planes: Sequence[Array], components: Sequence[str], *, ambiguous: bool = False) -> Case:
        """Return the case of a pad, its arrays and the components that are estimated. ``ambiguous`` means that the
        channels alone do not separate the components.
        """
        kinds = {find_channel(c).kind.name for p in planes for c in p.channels}
        layered = getattr(pad, "thickness", None) is not None
        contact = contact_kind(planes[0].dimensions, components)
        if planes[0].dimensions == 2:
            few = max(int(p.valid.sum()) for p in planes) <= FEW_TAXELS
            contact = AMBIGUOUS if ambiguous else contact + FEW * few
        return cls(
            contact,
            kinds.pop() if len(kinds) == 1 else "mixed",
            "layers" if layered else "half-space",
        )

    @property
    def whatever_size(self) -> Case:
        """The case without the distinction by number of taxels."""
        return replace(self, contact=self.contact.removesuffix(FEW))

    def __str__(self) -> str:
        return f"{self.contact}, {self.sensing}, {self.body}"


@dataclass(frozen=True)
class Constants:
    """Constants of one method and case.

    Attributes
    ----------
    method, case
        The method and the case that they are for.
    quantities : mapping
        `Calibration` of each quantity.
    outside : float
        Relative standard deviation of the part of a quantity that is estimated outside the outermost taxels.
    population : mapping
        Origin of the constants: description, frames, seed, version of the code.
    """

    method: str
    case: Case
    quantities: Mapping[str, Calibration]
    outside: float
    population: Mapping[str, Any]

    @property
    def signed(self) -> bool:
        """Whether this method may return negative pressure."""
        return self.method in GAUSSIAN

    @property
    def calibrated(self) -> bool:
        """Whether the constants derive from a population; otherwise they derive from the model of the method."""
        return bool(self.population)


def contact_kind(dimensions: int, components: Sequence[str]) -> str:
    """Return "line", "area" (one component estimated) or "area with shear"."""
    if dimensions == 1:
        return "line"
    return "area with shear" if len(components) > 1 else "area"


@cache
def _table() -> Mapping[tuple[str, Case], Constants]:
    text = resources.files("palpate.uncertainty").joinpath("constants.json").read_text(encoding="utf-8")
    found = {}
    for entry in json.loads(text)["entries"]:
        case = Case(entry["contact"], entry["sensing"], entry["body"])
        quantities = {name: Calibration(*numbers) for name, numbers in entry["quantities"].items()}
        found[entry["method"], case] = Constants(
            entry["method"], case, MappingProxyType(quantities), entry["outside"], MappingProxyType(entry["population"])
        )
    return MappingProxyType(found)


def calibrated_methods() -> tuple[str, ...]:
    """Return the methods whose error bars can be calibrated by a population: all except the one whose prior is given."""
    return tuple(m for m in dict.fromkeys((*(m for m, _ in _table()), *GAUSSIAN)) if m != "wiener")


def constants(method: str, case: Case) -> Constants:
    """Return the constants of a method for a case, or for the nearest case that has any (compare ``.case`` to find
    out).

    The nearest case has the same contact, then the same kind of sensing, then the same body. A linear method without
    constants uses the Gaussian model unchanged.

    Raises
    ------
    Unsupported
        A method without error bars.
    """
    table = _table()
    candidates = [c for m, c in table if m == method and c.contact == case.contact]
    if not candidates and case != case.whatever_size:
        return constants(method, case.whatever_size)
    if not candidates and case.contact == AMBIGUOUS:
        candidates = [c for m, c in table if m == method and c.contact == "area with shear"]
    if not candidates and method in GAUSSIAN:
        plain = MappingProxyType(dict.fromkeys(QUANTITIES, Calibration()))
        return Constants(method, case, plain, 0.0, MappingProxyType({}))
    if not candidates:
        raise Unsupported(
            f'method="{method}" gives no error bars for {case.contact} contact; methods that do: '
            f"{', '.join(calibrated_methods())}."
        )
    nearest = max(candidates, key=lambda c: (c.sensing == case.sensing, c.body == case.body))
    return table[method, nearest]


def calibrated(method: str, case: Case, quantity: str) -> Calibration:
    """Return the distribution of the errors of a quantity that a method estimates."""
    return constants(method, case).quantities[quantity]
