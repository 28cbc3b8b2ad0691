"""Parse dates and times of day: ISO 8601, and the forms of spreadsheets, pandas and data loggers."""

from __future__ import annotations

import datetime
import math
import re
from array import array
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["TimeCells", "is_date"]

_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]
_DAY = (
    r"(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})"
    r"|(?P<day_dot>\d{1,2})\.(?P<month_dot>\d{1,2})\.(?P<year_dot>\d{4}|\d\d)"
    r"|(?P<one>\d{1,2})[/-](?P<two>\d{1,2})[/-](?P<year_last>\d{4})"
    r"|(?P<day_name>\d{1,2})[- ](?P<name>[A-Za-z]{3})[a-z]*[- ](?P<year_name>\d{4})"
    r"|(?P<packed>\d{8})(?=[T_ -]?\d{6})"
)
_TIME = (
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,:](?P<part>\d{1,12}))?)?(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
    r"|(?P<minutes>\d{1,2}):(?P<seconds>\d\d)[.,](?P<parts>\d{1,12})"
    r"|(?P<clock>\d{6})(?:[.,](?P<clock_part>\d{1,12}))?"
)
_ZONE = r"\s*(?P<zone>Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)?(?:\[[^\]]*\])?"
_DATE = re.compile(rf"\s*(?:{_DAY})(?:(?:[T_ ]\s*|-|,\s*)(?:{_TIME}){_ZONE})?\s*", re.ASCII)
_OF_DAY = re.compile(rf"\s*(?:(?P<days>\d+)\s*days?,?\s*)?(?:{_TIME.rsplit('|', 1)[0]})\s*", re.ASCII)


#: Characters, besides colons, that occur in dates but not in numbers.
_SIGNS = re.compile(r"[-/.].*[-/.]|[T_ ]")


def is_date(cell: str) -> bool:
    """Whether a cell is a date or a time of day.

    Examples
    --------
    >>> from palpate.recordings.dates import is_date
    >>> is_date("2017-07-30T12:06:34+02:00"), is_date("12:06:34.5"), is_date("17.5")
    (True, True, False)
    """
    return _DATE.fullmatch(cell) is not None or _OF_DAY.fullmatch(cell) is not None


class TimeCells:
    """The times in one column: numbers, dates or times of day, all of one kind.

    Dates are seconds since 1970 (UTC; without a zone they count as UTC), times of day seconds since midnight.

    Examples
    --------
    >>> from palpate.recordings.dates import TimeCells
    >>> cells = TimeCells("run.csv")
    >>> [cells.value(c, "line 2") for c in ("30.07.2017 12:06:34", "30.07.2017 12:06:35,250")]
    [1501416394.0, 1501416395.25]
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self.kind = ""
        self._day_first = array("d")  # parts of dates such as 3/4/2017, day first
        self._orders = {"month", "day"}  # possible first parts in all of them
        self._count = 0

    def value(self, cell: str, where: str) -> float | None:
        """Seconds of a date or time of day; None for a cell that is neither."""
        text = cell.strip()
        if not (text[:1].isdigit() and (":" in text or _SIGNS.search(text))):
            return None
        match = _DATE.fullmatch(text)
        kind = "dates" if match is not None else "times of day"
        match = match or _OF_DAY.fullmatch(text)
        if match is None:
            return None
        if self.kind not in ("", kind):
            raise InvalidInput(
                f"{where}: {text!r} stands among {self.kind}; write all times of the column in one way, such as 2017-07-30T12:06:34.5."
            )
        self.kind = kind
        found = match.groupdict()
        if found["hour"] is not None and found["second"] is None and found["half"] is None and kind == "times of day":
            raise InvalidInput(
                f"{where}: {text!r} may be hours and minutes or minutes and seconds; save the column with hours, minutes and seconds."
            )
        try:
            seconds = _of_day(found)
            self._count += 1
            if kind == "dates":
                both = _days(found)
                seconds -= _zone(found["zone"])
                self._orders -= {name for name, day in zip(("month", "day"), both) if math.isnan(day)}
                if not self._orders:
                    raise ValueError("here the day comes first, and elsewhere the month")
                self._day_first.append(86400.0 * both[1] + seconds)
                return 86400.0 * (both[1] if math.isnan(both[0]) else both[0]) + seconds
        except ValueError as error:
            raise InvalidInput(f"{where}: {text!r} is no date or time ({error}).") from error
        return seconds

    def settled(self, values: Floats) -> Floats:
        """The values of the whole column, after the order of month and day is decided from all lines."""
        there = np.isfinite(values)
        if self.kind and self._count < np.count_nonzero(there):
            raise InvalidInput(
                f"{self._source}: some times of its column are {self.kind} and some are numbers; write all in one way, such as 2017-07-30T12:06:34.5."
            )
        if not self._day_first or self._orders == {"month"}:
            return values
        found = values.copy()
        found[there] = np.frombuffer(self._day_first)
        if self._orders == {"day"}:
            return found
        if not np.allclose(np.diff(values[there]), np.diff(found[there]), rtol=0.0, atol=0.5):
            days = [f"{np.ptp(v[there]) / 86400:.0f}" for v in (values, found)]
            raise InvalidInput(
                f"{self._source}: its dates may have the month or the day first (over {days[0]} or {days[1]} days); save them as 2017-07-30."
            )
        return values


def _part(digits: str | None) -> float:
    return float(f"0.{digits}") if digits else 0.0


def _of_day(found: dict[str, Any]) -> float:
    """Seconds since midnight."""
    days = 86400.0 * int(found.get("days") or 0)
    if found["minutes"] is not None:
        return days + 60 * int(found["minutes"]) + _below(found["seconds"], 60, "seconds") + _part(found["parts"])
    if found.get("clock") is not None:
        text = found["clock"]
        return (
            days
            + 3600 * _below(text[:2], 24, "hours")
            + 60 * _below(text[2:4], 60, "minutes")
            + _below(text[4:], 61, "seconds")
            + _part(found["clock_part"])
        )
    if found["hour"] is None:
        return days
    hour = _below(found["hour"], 25, "hours")
    if found["half"] is not None:
        hour = hour % 12 + 12 * (found["half"] in "pP")
    seconds = _below(found["second"] or 0, 61, "seconds") + _part(found["part"])
    return days + 3600 * hour + 60 * _below(found["minute"], 60, "minutes") + seconds


def _below(text: Any, limit: int, what: str) -> int:
    if int(text) >= limit:
        raise ValueError(f"{text} {what}")
    return int(text)


def _days(found: dict[str, Any]) -> tuple[float, float]:
    """Days since 1970, month first and day first; equal if the date is unambiguous, NaN if it is invalid."""
    if found["one"] is not None:
        year, one, two = int(found["year_last"]), int(found["one"]), int(found["two"])
        both = _day(year, one, two), _day(year, two, one)
        if all(math.isnan(day) for day in both):
            raise ValueError("no such day")
        return both
    if found["packed"] is not None:
        text = found["packed"]
        parts = int(text[:4]), int(text[4:6]), int(text[6:])
    elif found["name"] is not None:
        if found["name"].lower() not in _MONTHS:
            raise ValueError(f"{found['name']} is no month in English")
        parts = int(found["year_name"]), _MONTHS.index(found["name"].lower()) + 1, int(found["day_name"])
    elif found["year_dot"] is not None:
        year = int(found["year_dot"])
        parts = year + 2000 * (year < 100), int(found["month_dot"]), int(found["day_dot"])
    else:
        parts = int(found["year"]), int(found["month"]), int(found["day"])
    day = _day(*parts)
    if math.isnan(day):
        raise ValueError("no such day")
    return day, day


def _day(year: int, month: int, day: int) -> float:
    try:
        return float(datetime.date(year, month, day).toordinal() - 719163)
    except ValueError:
        return math.nan


def _zone(text: str | None) -> float:
    """Offset of a time zone from UTC, in seconds."""
    if text is None or text in ("Z", "UTC", "GMT"):
        return 0.0
    digits = text[1:].replace(":", "")
    return (-1 if text[0] == "-" else 1) * (3600.0 * int(digits[:2]) + 60.0 * int(digits[2:] or 0))
