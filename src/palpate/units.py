"""Units with conversion to SI. Only the units of this field are known; any other is an error."""

from __future__ import annotations

import math
import numbers
import re
import unicodedata
from collections.abc import Iterator, Mapping
from typing import Any

from palpate.errors import InvalidInput

__all__ = ["UNITS", "Factors", "convert_factor", "parse_quantity", "plain_unit"]

#: A file's placeholder for a quantity that must be measured first.
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


class Factors(Mapping[str, float]):
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
UNITS: dict[str, Factors] = {
    "length": Factors({"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9, "in": 0.0254}),
    "pressure": Factors(
        {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "N/mm^2": 1e6, "psi": 6894.757293168}
    ),
    "strain": Factors({"1": 1.0, "%": 1e-2, "ustrain": 1e-6}),
    "angle": Factors({"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180}),
    "time": Factors({"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}),
    "force": Factors({"N": 1.0, "mN": 1e-3, "kN": 1e3}),
    "force per length": Factors({"N/m": 1.0, "N/mm": 1e3, "mN/mm": 1.0}),
}

#: Lengths below this [m] are errors of the input; their squares would vanish in double precision.
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


def is_number(value: Any) -> bool:
    """Whether ``value`` is one finite real number, of Python or NumPy; True and False are none.

    Examples
    --------
    >>> from palpate.units import is_number
    >>> is_number(1), is_number(True), is_number("1"), is_number(float("nan"))
    (True, False, False, False)
    """
    try:
        return not isinstance(value, bool) and isinstance(value, numbers.Real) and math.isfinite(float(value))
    except OverflowError:
        return False


def parse_quantity(text: object, kind: str, what: str) -> float:
    """Convert "2 mm" to 0.002. A number without a unit is an error."""
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


def convert_factor(unit: str, si: str, what: str) -> float:
    """Factor from ``unit`` to the SI unit ``si``."""
    kind = KIND_OF_SI[si]
    if unit not in UNITS[kind]:
        raise InvalidInput(f"{what} has the unit {unit!r}; accepted: {', '.join(UNITS[kind])}.")
    return UNITS[kind][unit]
