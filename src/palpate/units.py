"""Units, so that nobody is off by 1000. Only the units of this field; anything else is refused."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Mapping

from palpate.errors import InvalidInput

__all__ = ["UNITS", "Units", "convert_factor", "parse_quantity", "plain_number", "plain_time", "plain_unit", "relative"]

#: What a file says in place of a quantity that must be measured first.
UNKNOWN = "unknown"


def plain_unit(text: str) -> str:
    """A unit in plain letters: the micro sign, the Greek letter mu and signs such as the square mm become "um" and "mm".

    Examples
    --------
    >>> plain_unit("\N{MICRO SIGN}m"), plain_unit("\N{GREEK SMALL LETTER MU}m"), plain_unit("N/mm\N{SUPERSCRIPT TWO}")
    ('um', 'um', 'N/mm^2')
    """
    written_out = unicodedata.normalize("NFKC", text.replace("\N{SUPERSCRIPT TWO}", "^2"))
    return written_out.replace("\N{GREEK SMALL LETTER MU}", "u").strip()


class Units(Mapping[str, float]):
    """Factors to SI by unit, found under every spelling that `plain_unit` reads.

    Examples
    --------
    >>> from palpate.units import UNITS
    >>> UNITS["length"]["\N{MICRO SIGN}m"] == UNITS["length"]["um"], "cubit" in UNITS["length"]
    (True, False)
    """

    def __init__(self, factors: Mapping[str, float]) -> None:
        self._factors = dict(factors)

    def __getitem__(self, unit: object) -> float:
        return self._factors[plain_unit(unit) if isinstance(unit, str) else unit]  # type: ignore[index]

    def __iter__(self) -> Iterator[str]:
        return iter(self._factors)

    def __len__(self) -> int:
        return len(self._factors)


#: kind -> unit -> factor to SI
UNITS: dict[str, Units] = {
    "length": Units({"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254}),
    "pressure": Units(
        {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "N/mm^2": 1e6, "psi": 6894.757293168}
    ),
    "strain": Units({"1": 1.0, "%": 1e-2, "ustrain": 1e-6}),
    "angle": Units({"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180}),
    "time": Units({"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}),
    "force": Units({"N": 1.0, "mN": 1e-3, "kN": 1e3}),
    "force per length": Units({"N/m": 1.0, "N/mm": 1e3, "mN/mm": 1.0}),
}

#: Lengths below this [m] cannot be meant, and their squares are lost in double precision.
SMALLEST_LENGTH = 1e-18

#: kind of each SI unit of a channel
KIND_OF_SI = {"m": "length", "Pa": "pressure", "1": "strain", "rad": "angle", "s": "time"}

_EXAMPLES = {
    "length": "1.5 mm",
    "pressure": "200 kPa",
    "strain": "0.001 1",
    "angle": "2 mrad",
    "time": "10 ms",
    "force": "2 N",
    "force per length": "200 N/m",
}

_QUANTITY = re.compile(r"^\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\s\d].*?|1)?\s*$")


def parse_quantity(text: object, kind: str, what: str) -> float:
    """ "2 mm" -> 0.002. A bare number is refused: it has no unit."""
    units = UNITS[kind]
    example = _EXAMPLES[kind]
    if isinstance(text, bool | int | float):
        raise InvalidInput(f'{what} = {text!r} has no unit: write "{text} {example.split()[1]}" if that is meant.')
    if isinstance(text, str) and text.strip().lower() == UNKNOWN:
        raise InvalidInput(f'{what} is unknown: measure it and write it here, such as "{example}".')
    if not isinstance(text, str):
        raise InvalidInput(f'{what} must be a quantity such as "{example}"; got {text!r}.')
    match = _QUANTITY.match(text)
    if match is None or match[2] is None:
        raise InvalidInput(f'{what} must be a number and a unit such as "{example}"; got {text!r}.')
    if match[2] not in units:
        raise InvalidInput(f"{what} has the unit {match[2]!r}; accepted for a {kind}: {', '.join(units)}.")
    value = float(match[1]) * units[match[2]]
    if not math.isfinite(value):
        raise InvalidInput(f"{what} = {text!r} is not finite.")
    if kind == "length" and 0 < abs(value) < SMALLEST_LENGTH:
        raise InvalidInput(f"{what} = {text!r} is far below the size of an atom; check its unit.")
    return value


def plain_number(value: float, digits: int = 6) -> str:
    """A number rounded to so many digits and written without an exponent, as people read it; below 1e-4 and from 1e15 on it keeps one.

    Examples
    --------
    >>> plain_number(423.7, 2), plain_number(29740.0, 3), plain_number(0.012345, 2), plain_number(3e-9, 2)
    ('420', '29700', '0.012', '3e-09')
    """
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e15 else text


def plain_time(seconds: float) -> str:
    """A time to the microsecond, without an exponent also where it counts from 1970.

    Examples
    --------
    >>> plain_time(1764091629.25), plain_time(0.1 + 0.2), plain_time(4.0)
    ('1764091629.25', '0.3', '4')
    """
    return f"{seconds:.6f}".rstrip("0").rstrip(".") if abs(seconds) < 1e15 else f"{seconds:g}"


def relative(share: float) -> str:
    """A relative deviation in words: per cent up to as much as the number itself, then a factor.

    Examples
    --------
    >>> relative(0.076), relative(4.24), relative(float("nan"))
    ('+- 7.6 %', '+- 4.2 times as much', '(uncertainty not known)')
    """
    if not math.isfinite(share):
        return "(uncertainty not known)"
    if share > 1.0:
        return f"+- {plain_number(share, 2)} times as much"
    return f"+- {plain_number(100.0 * share, 2)} %"


def convert_factor(unit: str, si: str, what: str) -> float:
    """Factor from ``unit`` to the SI unit ``si``."""
    kind = KIND_OF_SI[si]
    if unit not in UNITS[kind]:
        raise InvalidInput(f"{what} has the unit {unit!r}; accepted: {', '.join(UNITS[kind])}.")
    return UNITS[kind][unit]
