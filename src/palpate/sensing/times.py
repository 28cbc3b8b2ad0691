"""Convert times of any kind to seconds: numbers, datetime64 and timedelta64 of any unit, those of Python and pandas."""

from __future__ import annotations

import datetime
import math
from typing import Any

import numpy as np

from palpate._arrays import as_real
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.units import convert_factor

__all__ = ["EPOCH", "LATEST", "as_second", "as_seconds", "epoch_unit", "interpolated"]

#: Larger times [s] do not resolve microseconds in double precision; milliseconds since 1970, mistaken for seconds, are larger.
LATEST = 2.0**33
#: Range of a clock that shows the date, in seconds since 1970: from 2001 to 2100.
EPOCH = 9.8e8, 4.1e9
#: Missing values are interpolated over this many usual steps: over one lost sample (two steps), not over two (three).
LONGEST_STEP = 2.5


def as_seconds(time: Any, what: str = "time") -> Floats:
    """Times in seconds; what is missing (NaN, NaT, a masked entry) is NaN.

    Dates become seconds since 1970 (UTC; a date without a time zone counts as UTC), differences of times become seconds.

    Parameters
    ----------
    time : array-like
        Numbers (seconds), ``datetime64`` or ``timedelta64`` of any unit, `datetime.datetime`, `datetime.timedelta`, or what pandas makes of them.
    what : str
        Name of the times in messages.

    Raises
    ------
    InvalidInput
        Truth values, text, complex numbers, a kind without a unit, or seconds beyond 2**33, which were counted in another unit.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.times import as_seconds
    >>> as_seconds(np.array([0, 250], dtype="timedelta64[ms]")).tolist()
    [0.0, 0.25]

    >>> as_seconds(np.array(["1970-01-01T00:00:01.5"], dtype="datetime64[us]")).tolist()
    [1.5]
    """
    if hasattr(time, "dims") and hasattr(time, "attrs"):  # xarray
        numbers = time.dtype.kind in "iuf"
        factor = convert_factor(str(time.attrs.get("units", "s")), "s", what) if numbers else 1.0
        time = time.values
    else:
        factor = 1.0
    if (
        hasattr(time, "iloc") or type(time).__module__.split(".")[0] == "pandas"
    ):  # a column, an index or one entry of either
        time = time.to_numpy() if hasattr(time, "to_numpy") else time
    values = _dated(time, what)
    if values is None:
        values = np.asarray(as_real(time, what), dtype=np.float64) * factor
    far = np.ravel(values)[np.abs(np.ravel(values)) > LATEST]
    if len(far):
        unit = epoch_unit(float(far[0]))
        hint = f"These look like {unit[0]} since 1970: divide by {1 / unit[1]:g}." if unit else "Which unit is it in?"
        raise InvalidInput(f"{what} must be seconds within 2**33 of 0; got {float(far[0]):g}. {hint}")
    return values


def as_second(time: Any, what: str = "time") -> float:
    """One time in seconds, finite; kinds and errors are those of `as_seconds`.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.times import as_second
    >>> as_second(np.timedelta64(1500, "ms"))
    1.5
    """
    if type(time) is float and abs(time) <= LATEST:
        return time
    counted = hasattr(time, "dtype") or isinstance(time, int | float | datetime.datetime | datetime.timedelta)
    found = as_seconds(time, what) if counted and not isinstance(time, bool) else np.zeros(1)
    if found.ndim or not math.isfinite(found):
        raise InvalidInput(f"{what} must be a finite number of seconds; got {time!r}.")
    return float(found)


def epoch_unit(value: float) -> tuple[str, float] | None:
    """The unit (name, seconds) in which a number is a date since 1970; None for other numbers, and for dates in
    seconds.

    Examples
    --------
    >>> from palpate.sensing.times import epoch_unit
    >>> epoch_unit(1.7e12), epoch_unit(1.7e9)
    (('milliseconds', 0.001), None)
    """
    units = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}
    return next(((n, u) for n, u in units.items() if EPOCH[0] <= value * u <= EPOCH[1]), None)


def interpolated(times: Floats, clock: Floats, values: Floats) -> Floats:
    """Values (sample,) at other times by linear interpolation; NaN outside the clock, and where the values are missing.

    Between two values without any other between them NaN counts as missing, if they are more than 2.5 times the usual
    (median) step apart. Values that are known at every tenth time are thus interpolated, and those of a sensor that
    failed for a while are not.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.times import interpolated
    >>> force = np.array([0.0, 1.0, 2.0, np.nan, np.nan, np.nan, 6.0, 5.0, np.nan, 3.0])
    >>> interpolated(np.array([0.5, 4.0, 8.0, 12.0]), np.arange(10.0), force).tolist()
    [0.5, nan, 4.0, nan]
    """
    seen = np.flatnonzero(np.isfinite(values))
    if len(seen) < 2:
        return np.where(np.isin(times, clock[seen]), values[seen[0]] if len(seen) else math.nan, math.nan)
    known = clock[seen]
    steps = np.diff(known)
    gap = (np.diff(seen) > 1) & (steps > LONGEST_STEP * np.median(steps))
    after = np.clip(np.searchsorted(known, times), 1, len(steps))
    inside = (times > known[after - 1]) & (times < known[after])
    found = np.interp(times, known, values[seen], left=math.nan, right=math.nan)
    return np.where(inside & gap[after - 1], math.nan, found)


def _dated(time: Any, what: str) -> Floats | None:
    """Seconds of dates and time differences, or None for numbers."""
    found = time if isinstance(time, np.ndarray | np.generic) else None
    if found is None:
        first = time
        while isinstance(first, list | tuple) and first:
            first = first[0]
        if not isinstance(first, datetime.date | datetime.timedelta | datetime.time | np.datetime64 | np.timedelta64):
            return None
        found = np.asarray(time) if isinstance(first, np.generic) else np.asarray(time, dtype=object)
    if isinstance(found, np.ma.MaskedArray) and found.dtype.kind in "mMO":
        masked, found = np.ma.getmaskarray(found), np.array(found.data)
        found[masked] = None if found.dtype.kind == "O" else "NaT"
    if found.dtype.kind in "mM":
        return _counted(np.asarray(found), what)
    if found.dtype.kind != "O":
        return None
    flat = [_seconds_of(value, what) for value in np.ravel(found)]
    return np.array(flat, dtype=np.float64).reshape(np.shape(found))


def _counted(time: Any, what: str) -> Floats:
    """Seconds of ``datetime64`` and ``timedelta64``: exact as far as double precision goes."""
    unit = np.datetime_data(time.dtype)[0]
    if unit == "generic" or (time.dtype.kind == "m" and unit in "YM"):
        raise InvalidInput(
            f'{what} is {time.dtype}, which has no length: give it a unit, such as time.astype("timedelta64[ms]").'
        )
    missing = np.isnat(time)
    if time.dtype.kind == "M":
        whole = time.astype("datetime64[s]")
        seconds = whole.astype(np.int64) + (time - whole) / np.timedelta64(1, "s")
    else:
        seconds = time / np.timedelta64(1, "s")
    return np.asarray(np.where(missing, np.nan, seconds), dtype=np.float64)


def _seconds_of(value: Any, what: str) -> float:
    if value is None or (isinstance(value, datetime.datetime | datetime.timedelta) and value != value):  # NaT of pandas
        return math.nan
    if isinstance(value, datetime.datetime):
        aware = value if value.tzinfo is not None else value.replace(tzinfo=datetime.UTC)
        return float(aware.timestamp())
    if isinstance(value, datetime.timedelta):
        return float(value.total_seconds())
    if isinstance(value, np.datetime64 | np.timedelta64):
        return float(_counted(np.asarray(value), what))
    if isinstance(value, int | float | np.number) and not isinstance(value, bool | complex | np.complexfloating):
        return float(value)
    raise InvalidInput(f"{what} must be numbers of seconds, dates or differences of times; got {value!r}.")
