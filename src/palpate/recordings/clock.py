"""One increasing time for the frames of a recording, from whatever time stamps it has. All sources use this policy.

Frames keep the order in which they were received, and none is dropped. Increasing stamps are used as they are. Otherwise
- if a clock jumps back and continues, the sender restarted; if it jumps back by a whole period of its counter, the counter wrapped: time continues;
- outliers, missing stamps and repeated ones (whole seconds, drivers that never fill them) are replaced by the time at which
the frame was recorded if the source has it, otherwise by the frame rate;
- numbers without a unit are dates if they look like it, or have the unit in which they advance like the recorder's clock; otherwise they are seconds.

One note with counts lists the repairs. `COSTS` decides which stamps are right: the explanation with the least cost.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, UncheckedInput
from palpate.recordings.dates import TimeCells
from palpate.sensing.times import EPOCH, LATEST, as_seconds

__all__ = ["Clock", "LiveClock", "read_clock", "stored_clock", "unit_of_name"]

Ints = npt.NDArray[np.int64]

#: A step of fewer usual steps than this is not a jump.
LEAP = 10.0
#: Largest amount [s] by which one step of the stamps may exceed that of the recorder's clock: frames that waited in a
#: network are recorded all at once. There is no limit the other way: a waiting frame is recorded late.
LATE = 1.0
#: If stamps are closer than this [s], the sender's (simulated) clock is stopped, and the receiver's clock replaces it.
STOPPED_CLOCK = 1e-6
#: A step forward by more than this [s] and `FAR_STEPS` usual steps means that the clock was set, not that there was a
#: pause.
FAR, FAR_STEPS = 30 * 86400.0, 1000.0
#: Costs of an explanation: a wrong stamp, a jump within a clock, a wrap, a restart.
COSTS = {"wrong": 1.0, "jump": 1.0, "wrap": 1.0, "restart": 2.5}
#: Largest number of runs of wrong stamps between two right ones.
RUNS = 12
#: Number of stamps on each side of a step back that may be wrong although they fit their neighbours.
EDGE = 2
#: If at least this fraction of the steps go back, the frames are not in the order of time; lines in random order have
#: half.
DISORDER = 0.4
#: Units of counters, in seconds, and their usual numbers of counts before they wrap; clocks of the day, hour, minute
#: and second wrap too.
_COUNTS = (1.0, 1e-3, 1e-6, 1e-9)
_PERIODS = tuple(2.0**k for k in (8, 10, 12, 16, 24, 32))
_CLOCKS = (1.0, 60.0, 3600.0, 86400.0, 604800.0)
_ALL = tuple(sorted((*_CLOCKS, *(c * p for c in _COUNTS for p in _PERIODS))))
#: Smallest period, and largest step across its end, in usual steps.
_LONG, _SHORT = 30.0, 3.0
#: Date formats of programs: name, unit in seconds, and the value of 1970.
_CALENDARS = (
    ("milliseconds since 1970", 1e-3, 0.0),
    ("microseconds since 1970", 1e-6, 0.0),
    ("nanoseconds since 1970", 1e-9, 0.0),
    ("steps of 100 ns since the year 1, as .NET counts them", 1e-7, 621355968000000000.0),
    ("steps of 100 ns since 1601, as Windows counts them", 1e-7, 116444736000000000.0),
    ("days since 1900, as spreadsheets count them", 86400.0, 25569.0),
    ("days since the year 0, as MATLAB counts them", 86400.0, 719529.0),
)
#: Names of units, at the end of a name or in brackets.
_NAMES = {
    1.0: ("s", "sec", "secs", "second", "seconds"),
    1e-3: ("ms", "msec", "msecs", "millis", "millisec", "millisecond", "milliseconds"),
    1e-6: ("us", "µs", "μs", "usec", "usecs", "micros", "microsec", "microsecond", "microseconds"),
    1e-9: ("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecond", "nanoseconds"),
    60.0: ("min", "mins", "minutes"),
    3600.0: ("h", "hours"),
    86400.0: ("days",),
}


@dataclass(frozen=True, eq=False)
class Clock:
    """One time for the frames of a recording (`read_clock`).

    Attributes
    ----------
    time : array (frame,)
        Seconds, increasing.
    order : array (frame,) or None
        The order of the frames; None: as received.
    note : str
        The repairs in words, or "".
    source : str
        Name of the recording in messages.

    Examples
    --------
    >>> from palpate.recordings import read_clock
    >>> clock = read_clock([0.0, 0.5, 1.0])
    >>> clock.note, clock.meta(), clock.tell()
    ('', {}, None)
    """

    time: Floats
    order: Ints | None = None
    note: str = ""
    source: str = ""

    def tell(self) -> None:
        """Emit the note as a warning."""
        if self.note:
            warnings.warn(f"{self.source}: {self.note}", UncheckedInput, stacklevel=3)

    def meta(self) -> dict[str, str]:
        """The note as an entry of a recording's ``meta``."""
        return {"clock": self.note} if self.note else {}


def unit_of_name(name: str) -> float | None:
    """The unit in seconds at the end of a name, such as ``time_ms``, ``stampNanosec`` or ``t (us)``, or None.

    Examples
    --------
    >>> from palpate.recordings.clock import unit_of_name
    >>> unit_of_name("timestamp_us"), unit_of_name("Time [msec]"), unit_of_name("elapsed.nanosec"), unit_of_name("items")
    (1e-06, 0.001, 1e-09, None)
    """
    words = "".join(f"_{c.lower()}" if c.isupper() else c for c in name)
    last = [w for w in "".join(c if c.isalpha() else " " for c in words).split() if w][-1:]
    lower = [w for w in "".join(c.lower() if c.isalpha() else " " for c in name).split() if w][-1:]
    return next((unit for unit, names in _NAMES.items() if {*last, *lower} & set(names)), None)


def read_clock(
    stamps: Any,
    *,
    source: str = "the recording",
    recorded: Any = None,
    unit: float | None = 1.0,
    count: float | None = None,
    sort: bool = False,
    remedy: str = "sort its frames by time",
    untimed: str = "give each frame its time in seconds",
) -> Clock:
    """The time of each frame from its stamp.

    Parameters
    ----------
    stamps : array (frame,)
        As received; NaN for frames without. Numbers times ``unit`` are seconds; dates need no unit.
    source : str
        Name of the recording in messages.
    recorded : array (frame,), optional
        Seconds at which the frames were recorded, by another clock.
    unit : float, optional
        The unit of stamps in seconds; None: unknown.
    count : float, optional
        Seconds per count of the counter that made the stamps, if known.
    sort : bool
        Put the frames in the order of their stamps.
    remedy, untimed : str
        What the user should do with frames in no order of time, and without any times.

    Raises
    ------
    InvalidInput
        No frame has a time, or half of the steps go back.

    Examples
    --------
    >>> from palpate.recordings import read_clock
    >>> clock = read_clock([7.0, 7.5, 8.0, 0.0, 0.5, 1.0])  # the sensor was started again
    >>> clock.time.tolist()
    [7.0, 7.5, 8.0, 8.5, 9.0, 9.5]

    >>> clock.note
    'the clock restarted 1 time (first: frame 3 is at 0 s after 8 s). All 6 frames are kept in their order, and time goes on.'
    """
    dated = np.asarray(stamps).dtype.kind in "mMO"
    values = as_seconds(stamps) if dated else np.array(stamps, dtype=np.float64)
    words: list[str] = []
    log = None if recorded is None else _recorder(recorded)
    if not dated:
        values = _in_seconds(values, unit, log, words)
    values[~(np.abs(values) <= LATEST)] = np.nan
    order = None
    if sort:
        order = np.argsort(values, kind="stable").astype(np.int64)
        order = None if np.array_equal(order, np.arange(len(order))) else order
        values = values if order is None else values[order]
        log = log if log is None or order is None else None
    time = values if _plain(values, log) else _mended(values, log, count, source, (remedy, untimed), words)
    note = f"{'; '.join(words)}." if words else ""
    if words and time is not values and len(time) > 1:
        note += f" All {len(time)} frames are kept{'' if sort else ' in their order'}, and time goes on."
    return Clock(time, order, note, source)


class LiveClock:
    """Times of a live stream, whose future is unknown: a stamp that is empty (0) or repeated is replaced by this
    machine's clock.

    It does not repair a clock that jumps back; that is done where senders and their sessions are separated
    (`palpate.network.Admission`).

    Examples
    --------
    >>> from palpate.recordings.clock import LiveClock
    >>> clock = LiveClock()
    >>> [clock.next(stamp, now) for stamp, now in ((7.0, 0.0), (7.0, 0.25), (7.0, 0.5), (8.0, 1.0))]  # whole seconds
    [7.0, 7.25, 7.5, 8.0]
    """

    def __init__(self) -> None:
        self._stamp = self._time = self._now = -np.inf
        self._replaced = False

    def next(self, stamp: float, now: float) -> float:
        """The time of the next frame [s]."""
        repeated = stamp == self._stamp
        time = now if stamp == 0.0 else self._time + (now - self._now) if repeated else stamp
        replaced = repeated or stamp == 0.0
        if (replaced or self._replaced) and 0.0 <= self._time - time < LATE:
            time = self._time + STOPPED_CLOCK
        self._stamp, self._time, self._now, self._replaced = stamp, time, now, replaced
        return time


def stored_clock(values: Any, units: Any, source: str) -> Clock:
    """As `read_clock`, for times in an array with an attribute ``units``: a unit, or one "since" a date; without it
    they are seconds.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.recordings.clock import stored_clock
    >>> stored_clock(np.array([0, 20]), "milliseconds since 1970-01-01 00:00:01", "run.nc").time.tolist()
    [1.0, 1.02]
    """
    text = units.decode() if isinstance(units, bytes) else str(units or "s")
    name, since, date = text.partition(" since ")
    unit, begin = unit_of_name(name), TimeCells(source).value(date, source) if since else 0.0
    if unit is None or begin is None:
        raise InvalidInput(
            f"{source}: its times have the unit {text!r}; write s, ms, us or ns, or one of them since a date such as 2017-07-30."
        )
    if begin:
        values, unit = np.asarray(values, dtype=np.float64) * unit + begin, 1.0
    return read_clock(values, source=source, unit=unit)


# -- units -------------------------------------------------------------------------------------------------------------


def _recorder(recorded: Any) -> Floats | None:
    """The recorder's clock, made increasing; None if it is constant."""
    values = np.array(recorded, dtype=np.float64)
    if len(values) > 1 and not (np.diff(values) > 0).any():
        return None
    return values if _plain(values, None) else _mended(values, None, None, "", ("", ""), [])


def _in_seconds(values: Floats, unit: float | None, log: Floats | None, words: list[str]) -> Floats:
    """Convert numbers to seconds; note a unit that was guessed."""
    finite = values[np.isfinite(values)]
    typical = float(np.median(np.abs(finite))) if len(finite) else 0.0
    steps = np.diff(finite)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    too_late = typical * (unit or 1.0) > LATEST
    for name, length, begin in _CALENDARS:
        plausible = EPOCH[0] <= (typical - begin) * length <= EPOCH[1]
        # Read as seconds, days with such steps would mean more than 20000 frames a second.
        if plausible and (too_late if length < 1.0 else unit is None and 0.0 < step < 5e-5):
            remark = "" if unit is None else ", because in the unit that is said they lie beyond the year 2242"
            words.append(f"its times ({typical:.12g}) are taken as {name}{remark}")
            return (values - begin) * length
    if too_late:
        words.append(f"its times ({typical:.12g}) are beyond 2**33 s, and no date in a unit that is known")
    if unit is not None or too_late:
        return values * (unit or 1.0)
    if log is not None and len(values) > 1:
        usual = _usual(values)
        if usual is None:
            return values
        ratio = usual / float(np.median(np.diff(log)))
        for name, factor in (("seconds", 1.0), ("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)):
            if 0.6 < ratio * factor < 1.6:
                if factor != 1.0:
                    words.append(f"its stamps have no unit and are taken as {name}, as the recorder's clock has them")
                return values * factor
        words.append(
            f"its stamps have no unit, and advance by {ratio:.3g} a second of the recorder's clock, as no unit does"
        )
        return np.full_like(values, np.nan)
    if step >= 2.0 and (finite == np.round(finite)).all():
        words.append(
            f"its times have no unit and are taken as seconds, {step:g} s from frame to frame; if they are milliseconds, say time_unit=ms"
        )
    return values


# -- order -------------------------------------------------------------------------------------------------------------


def _plain(values: Floats, log: Floats | None) -> bool:
    """Whether stamps need no repair."""
    if not (np.isfinite(values).all() and (np.abs(values) <= LATEST).all()):
        return False
    steps = np.diff(values)
    if len(steps) == 0:
        return True
    if not (steps > 0).all():
        return False
    usual = float(np.median(steps))
    return not _jumps(steps, np.ones(len(steps)), usual, None if log is None else np.diff(log)).any()


def _trusted(usual: float, log: Floats | None) -> Floats | None:
    """The recorder's clock, if it runs as fast as the stamps: bags may be replayed at another speed."""
    return log if log is not None and 0.5 < float(np.median(np.diff(log))) / usual < 2.0 else None


def _jumps(steps: Any, frames: Any, usual: float, recorded: Any) -> Any:
    """Whether steps over these numbers of frames are too large or small for one clock without a pause; ``recorded``:
    the same steps by the recorder's clock.
    """
    steps = np.asarray(steps, dtype=np.float64)
    if recorded is not None:
        return (steps <= 0) | (steps - recorded > np.maximum(0.5 * recorded, max(LEAP * usual, LATE)))
    return (steps <= 0) | (steps > np.maximum(FAR, FAR_STEPS * usual * np.asarray(frames)))


def _usual(values: Floats) -> float | None:
    """The usual time between two frames, including frames that repeat the stamp before."""
    finite = np.flatnonzero(np.isfinite(values))
    first = finite[np.flatnonzero(np.diff(values[finite], prepend=np.nan) != 0)]
    steps, frames = np.diff(values[first]), np.diff(first)
    ahead = steps > 0
    rates = np.sort(steps[ahead] / frames[ahead])
    return float(rates[(len(rates) - 1) // 2]) if len(rates) else None


def _mended(
    values: Floats, log: Floats | None, count: float | None, source: str, remedies: tuple[str, str], words: list[str]
) -> Floats:
    """Increasing times from stamps that do not increase; the repairs are appended to ``words``."""
    number = len(values)
    by = "the time at which each was recorded" if log is not None else "the rate"
    finite = np.isfinite(values)
    usual = _usual(values)
    index = np.flatnonzero(finite)
    first = index[np.flatnonzero(np.diff(values[index], prepend=np.nan) != 0)]  # those that repeat no stamp
    back = np.diff(values[first]) < 0
    if len(back) and back.mean() >= DISORDER and (usual is None or np.count_nonzero(back) > 2):
        if log is None:
            raise InvalidInput(
                f"{source}: the time goes back in {np.count_nonzero(back)} of {number - 1} steps, so that its frames are not in the order of time. To sort them, {remedies[0]}."
            )
        words.append(
            f"{np.count_nonzero(back)} of {number} stamps go back: replaced by the time at which each frame was recorded"
        )
        return log
    if usual is None:
        fault = (
            f"all {number} stamps are {values[finite][0]:g} s"
            if finite.any()
            else f"none of {number} frames has a time"
        )
        if log is not None:
            words.append(f"{fault}: replaced by the time at which each frame was recorded")
            return log
        if number == 1 and finite.any() and abs(values[0]) <= LATEST:
            return values
        fault = "; ".join([*words, fault])
        raise InvalidInput(f"{source}: {fault}, so that the times of its frames are unknown: {remedies[1]}.")
    repeated = len(index) - len(first)
    if repeated > number / 2 and log is not None:
        words.append(f"{repeated} of {number} stamps repeat the one before: replaced by {by}")
        return log + float(np.median(values[first] - log[first]))
    trusted = _trusted(usual, log)
    at = np.arange(number, dtype=np.float64) if log is None else log
    right, times = _explained(values[first], first, usual, trusted, count, words)
    wrong = len(first) - int(right.sum())
    anchors, at_anchors = first[right], times[right]
    replaced = [
        (number - len(index), "missing"),
        (wrong, "outlier" if wrong == 1 else "outliers"),
        (repeated, "repeated"),
    ]
    if any(n for n, _ in replaced):
        some = ", ".join(f"{n} {kind}" for n, kind in replaced if n)
        words.append(f"of {number} stamps {some}: replaced by {by}")
    if log is None and len(anchors) > 1 and first[1:2] == anchors[1] > anchors[0] + 1:
        # The first of several stamps in whole seconds begins within one second.
        begin = at_anchors[1] - usual * (anchors[1] - anchors[0])
        at_anchors = at_anchors.copy()
        at_anchors[0] = max(at_anchors[0], begin)
    slope = 1.0 if trusted is not None else usual if log is None else usual / float(np.median(np.diff(log)))
    time = np.interp(at, at[anchors], at_anchors)
    before, after = at < at[anchors[0]], at > at[anchors[-1]]
    time[before] = at_anchors[0] - slope * (at[anchors[0]] - at[before])
    time[after] = at_anchors[-1] + slope * (at[after] - at[anchors[-1]])
    if not (np.diff(time) > 0).all():  # closer than double precision resolves
        for i in range(1, number):
            time[i] = max(time[i], np.nextafter(time[i - 1], np.inf))
    return time


def _explained(
    values: Floats, frames: Ints, usual: float, log: Floats | None, count: float | None, words: list[str]
) -> tuple[npt.NDArray[np.bool_], Floats]:
    """Mask of right stamps, and their times on a clock that runs on through restarts, by least cost."""
    gaps = np.diff(frames)
    steps = np.diff(values)
    recorded = None if log is None else np.diff(log[frames])
    usually = (steps > 0) & (steps <= LEAP * usual * gaps)
    agree = usually if recorded is None else ~_jumps(steps, gaps, usual, recorded)
    # Runs without a jump. Near a step back, stamps before or after it may be wrong.
    edges = np.flatnonzero(steps < 0)[:, None] + 1 + np.arange(-EDGE, EDGE + 1)
    starts = np.unique(np.concatenate([[0], np.flatnonzero(~agree) + 1, edges[(edges > 0) & (edges < len(values))]]))
    ends = np.concatenate([starts[1:], [len(values)]])
    best: list[tuple[float, int, str, float]] = []
    dropped = np.concatenate([[0], np.cumsum(ends - starts)])
    for b in range(len(starts)):
        choice = (COSTS["wrong"] * float(dropped[b]), -1, "", 0.0)
        for a in range(max(0, b - RUNS - 1), b):
            between = COSTS["wrong"] * float(dropped[b] - dropped[a + 1])
            i, j = int(ends[a]) - 1, int(starts[b])
            how, extra, price = _joined(values, frames, i, j, usual, log, count)
            choice = min(choice, (best[a][0] + between + price, a, how, extra))
        best.append(choice)
    closing = [best[b][0] + COSTS["wrong"] * float(dropped[-1] - dropped[b + 1]) for b in range(len(starts))]
    run = int(np.argmin(closing))
    chain = []
    while run >= 0:
        chain.append(run)
        run = best[run][1]
    right = np.zeros(len(values), dtype=bool)
    times, shift = values.copy(), 0.0
    jumps: dict[str, tuple[int, str]] = {}
    for run in reversed(chain):
        _, _, how, extra = best[run]
        shift += extra
        run_slice = slice(int(starts[run]), int(ends[run]))
        right[run_slice] = True
        times[run_slice] += shift
        if how:
            before = f"frame {int(frames[run_slice.start])} is at {values[run_slice.start]:.9g} s after {values[int(ends[best[run][1]]) - 1]:.9g} s"
            number, example = jumps.get(how, (0, before))
            jumps[how] = (number + 1, example)
    words.extend(f"{how} {n} time{'s' if n > 1 else ''} (first: {example})" for how, (n, example) in jumps.items())
    return right, times


def _joined(
    values: Floats, frames: Ints, i: int, j: int, usual: float, log: Floats | None, count: float | None
) -> tuple[str, float, float]:
    """Relation of stamp ``j`` to ``i``: its name ("": same clock), the clock's offset from there, and the cost."""
    step, gap = float(values[j] - values[i]), int(frames[j] - frames[i])
    recorded = None if log is None else float(log[frames[j]] - log[frames[i]])
    jumps = bool(_jumps(step, gap, usual, recorded))
    if not jumps and (recorded is not None or 0.4 * usual * gap <= step <= LEAP * usual * gap):
        return "", 0.0, 0.0
    usually = usual * gap
    if step < 0:
        periods = _ALL if count is None else [p * count for p in _PERIODS]
        fits = [p for p in periods if 0 < step + p <= _SHORT * usually and p >= _LONG * usually]
        period = min(fits, key=lambda p: abs(step + p - usually), default=None)
        if period is not None and not _jumps(step + period, gap, usual, recorded):
            return f"the clock wrapped (period {period:g} s)", period, COSTS["wrap"]
    go_on = recorded if recorded is not None else usually
    anew = ("the clock restarted" if step <= 0 else "the clock was set ahead"), go_on - step, COSTS["restart"]
    return anew if jumps else ("", 0.0, COSTS["jump"])
