"""Format numbers for messages: without exponents, and without percentages above a hundred."""

from __future__ import annotations

import math

__all__ = ["plain_number", "plain_time", "relative"]


def plain_number(value: float, digits: int = 6) -> str:
    """Round a number to ``digits`` digits and write it without an exponent; below 1e-4 and from 1e15 on with one.

    Examples
    --------
    >>> plain_number(423.7, 2), plain_number(29740.0, 3), plain_number(0.012345, 2), plain_number(3e-9, 2)
    ('420', '29700', '0.012', '3e-09')
    """
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e15 else text


def plain_time(seconds: float) -> str:
    """Write a time to the microsecond, without an exponent even if it counts from 1970.

    Examples
    --------
    >>> plain_time(1764091629.25), plain_time(0.1 + 0.2), plain_time(4.0)
    ('1764091629.25', '0.3', '4')
    """
    return f"{round(seconds, 6) + 0.0:.6f}".rstrip("0").rstrip(".") if abs(seconds) < 1e15 else f"{seconds:g}"


def relative(share: float) -> str:
    """Write a relative deviation: in per cent up to 100 %, above as a factor.

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
