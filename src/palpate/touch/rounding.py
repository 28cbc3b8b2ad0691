"""Format numbers with intervals, rounded to the digits that the interval supports."""

from __future__ import annotations

import math

from palpate._numbers import plain_number
from palpate._plot import scaled

__all__ = ["decimals", "force_unit", "format_interval", "open_interval"]

#: Digits of a number without an interval.
DIGITS = 4


def decimals(half_width: float) -> int:
    """Number of decimals that show two digits of half an interval's width; 0 if that is 10 or more.

    Examples
    --------
    >>> from palpate.touch.rounding import decimals
    >>> decimals(0.013), decimals(0.5), decimals(70.0)
    (3, 2, 0)
    """
    if not (math.isfinite(half_width) and half_width > 0):
        return 0
    return min(max(1 - math.floor(math.log10(half_width)), 0), 12)


def format_interval(
    value: float, low: float = math.nan, high: float = math.nan, *, factor: float = 1.0, unit: str = ""
) -> str:
    """A number with its unit and its interval, all with the same decimals; ``factor`` converts it to the unit.

    Examples
    --------
    >>> from palpate.touch.rounding import format_interval
    >>> format_interval(1.00234, 0.98911, 1.01432, unit="N")
    '1.002 N (0.989 to 1.014)'

    >>> format_interval(18550.0, 17800.0, 19100.0, factor=1e-3, unit="kPa"), format_interval(0.30756, unit="N"), format_interval(float("nan"))
    ('18.55 kPa (17.80 to 19.10)', '0.3076 N', 'not known')
    """
    after = f" {unit}" if unit else ""
    if not math.isfinite(value):
        return "not known"
    value, low, high = (v * factor for v in (value, low, high))
    if not (math.isfinite(low) and math.isfinite(high)):
        return f"{plain_number(value, DIGITS)}{after}{open_interval(low, high)}"
    n = decimals(0.5 * (high - low)) if high > low else DIGITS
    return f"{_fixed(value, n)}{after} ({_fixed(low, n)} to {_fixed(high, n)})"


def open_interval(low: float, high: float) -> str:
    """Text for an interval with one or both ends open; "" if a bound is unknown.

    Examples
    --------
    >>> from palpate.touch.rounding import open_interval
    >>> open_interval(0.076, float("inf")), open_interval(float("-inf"), 2.0), open_interval(float("nan"), 1.0)
    (' (0.076 or more)', ' (2 or less)', '')
    """
    if math.isnan(low) or math.isnan(high):
        return ""
    if math.isinf(low) and math.isinf(high):
        return " (of any size)"
    return f" ({plain_number(low, 3)} or more)" if math.isinf(high) else f" ({plain_number(high, 3)} or less)"


def _fixed(value: float, n: int) -> str:
    """A number with ``n`` decimals, and no minus before a zero."""
    return f"{round(value, n) + 0.0:.{n}f}"


def force_unit(size: float, unit: str) -> tuple[float, str]:
    """Factor and unit for forces of the size ``size``: newtons from 0.05 N on, as usual for robots, and prefixes for
    smaller or very large ones.

    Examples
    --------
    >>> from palpate.touch.rounding import force_unit
    >>> force_unit(0.3, "N"), force_unit(3e-8, "N")
    ((1.0, 'N'), (999999999.9999999, 'nN'))
    """
    return (1.0, unit) if 0.05 <= size < 1e4 or size <= 0 else scaled(size, unit)
