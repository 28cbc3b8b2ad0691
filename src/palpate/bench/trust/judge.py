"""The verdict on one frame: its error, the coverage of its intervals, and whether it carries a note.

**Load**: the integral of the traction's magnitude; of a plain push the net force. Where nothing touches, it is that of the contact that fits the noise.

**Wrong**: the net force is off by more than 30 % of the load (length of the vector of its errors in the components that are sought, and in the
normal one always).

**Far outside**: the true net force lies outside its 95 % interval by more than half the interval's half-width, in any of these components. Of
intervals that hold 95 % of normal errors, 0.3 % do. A normal force that is not sought, where there is one, lies far outside.

**A note** is, in this count:

- its readings are refused,
- its status is not "solved" or "no contact" ("no contact" is an answer, right or wrong),
- ``Touch.fit``, where there is one, is below 0.01,
- its force or the interval of it is not a number, where a clean frame of the same sensor has one,
- the 95 % interval of the worst component of the force is wider than the load,
- a note, figures apart, that a clean frame of the same sensor does not have. A note on every frame does not count.

A frame that says "the net force is uncertain", as every frame of some sensors rightly does, has said that it may be off by more than 30 %: it is
not wrong without a warning unless the truth lies far outside its interval.

The last frame of a **recording** (`palpate.bench.trust.recorded`) is answered as a user would have it: from its frames at rest and those before it, by itself,
tracked, or out of a table. Warnings of the reader of the table count as notes.
"""

from __future__ import annotations

import inspect
import math
import re
import signal
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.bench.trust.presses import cell_means
from palpate.bench.trust.recorded import RATE, Recorded
from palpate.bench.trust.rows import Frame
from palpate.elastic.pad import Floats
from palpate.errors import PalpateError, Unsupported
from palpate.recordings import TableMapping, read_recording
from palpate.skin import Skin
from palpate.status import Status
from palpate.touch import Touch
from palpate.touch.outcome import ROUGHLY

__all__ = ["FAR_OUTSIDE", "MISFIT", "WRONG", "Verdict", "judge", "verdict"]

#: A frame is wrong if the error of the net force exceeds this fraction of the load.
WRONG = 0.3
#: A true value outside its interval by more than this many half-widths is far outside.
FAR_OUTSIDE = 0.5
#: If the probability of the misfit is below this, the frame states that it does not fit.
MISFIT = 0.01
#: Errors smaller than this fraction of the load are rounding errors.
_EXACT = 1e-6


@dataclass(frozen=True)
class Verdict:
    """The verdict on one frame.

    Attributes
    ----------
    row, index
        The frame.
    force_error : float
        Error of the net force over the load.
    field_error : float
        Error of the traction over its norm (of the typical load's for empty frames).
    far, peak_far : bool
        True net force, true peak pressure: far outside the 95 % interval.
    inside : dict
        Part of the true values inside the 95 % interval, of "force" (components), "peak" and "cells"; NaN without an interval.
    words : tuple of str
        The notes of the frame.
    seconds : float
        Processor time to solve it, without preparation; a lower bound if it was not done in time.
    status : str
        Status, or the reason for refusal.
    broken : bool
        The library failed with an exception that it does not raise on purpose.
    late : bool
        No answer within the time allowed: neither right nor wrong.
    found, low, high, true : arrays (component,)
        Net force, its 95 % interval, and the truth.
    fit : float
        Misfit probability, or NaN.
    sensor : str
        Kind and channels of its sensor.
    frame : str
        The frame in words.
    rough : bool
        Whether it notes that its force is uncertain, even if every frame of this sensor does.
    """

    row: str
    index: int
    force_error: float
    field_error: float
    far: bool
    peak_far: bool
    inside: dict[str, float]
    words: tuple[str, ...]
    seconds: float
    status: str
    broken: bool
    late: bool
    found: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    true: tuple[float, ...]
    fit: float
    sensor: str
    frame: str
    rough: bool = False

    @property
    def wrong(self) -> bool:
        """Whether the net force is wrong by more than `WRONG` of the load, or the library failed."""
        return self.broken or self.force_error > WRONG

    @property
    def answered(self) -> bool:
        """Whether there is a result with a force."""
        return bool(np.isfinite(self.force_error))

    @property
    def silent(self) -> bool:
        """Whether the result carries no note."""
        return not self.words

    @property
    def betrays(self) -> bool:
        """Whether the result is wrong without a note: the force is wrong, or the truth far outside the interval. If a
        note states a possible error, only the latter counts.
        """
        return self.silent and (self.far or (self.wrong and not self.rough))


class _Late(Exception):
    """Raised when a frame takes longer than allowed."""


@contextmanager
def _limited(seconds: float | None) -> Iterator[None]:
    """Raise `_Late` after ``seconds`` of processor time, if the system supports it."""
    able = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    if seconds is None or not able:
        yield
        return

    def stop(*_: object) -> None:
        raise _Late

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def judge(frame: Frame, *, limit: float | None = None) -> Verdict:
    """Reconstruct a frame as a user would, without tuning, and compare it with the truth.

    ``limit`` [s] is the processor time allowed for the frame, and for the clean frame of the same sensor.
    """
    options: dict[str, Any] = {} if frame.friction is None else {"friction": frame.friction}
    warned: tuple[str, ...] = ()
    try:
        with _limited(limit):
            reference, options = _clean(frame, options)
        start = time.process_time()
        with _limited(limit):
            if frame.recorded is None:
                touch = frame.skin.reconstruct(frame.readings, **options)
            else:
                touch, warned = _answered(frame, frame.recorded, options)
        seconds = time.process_time() - start
    except _Late:
        return _unanswered(frame, f"no answer within {limit:g} s", seconds=float(limit or np.nan), late=True)
    except PalpateError as error:
        return _unanswered(frame, f"refused: {error}", words=(f"refused: {error}",))
    except (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError) as error:  # LinAlgError is a ValueError
        return _unanswered(frame, f"broke down: {type(error).__name__}: {error}", broken=True)
    result = verdict(frame, touch, reference, seconds)
    return replace(result, words=(*result.words, *warned)) if warned else result


def _clean(frame: Frame, options: dict[str, Any]) -> tuple[Touch, dict[str, Any]]:
    """Return the touch of the clean frame, and the options for this sensor, without friction if the method refuses it."""
    if frame.recorded is not None:
        return _clean_recording(frame, frame.recorded, options)
    try:
        return frame.skin.reconstruct(frame.reference, **options), options
    except Unsupported:
        return frame.skin.reconstruct(frame.reference), {}


def _clean_recording(frame: Frame, recorded: Recorded, options: dict[str, Any]) -> tuple[Touch, dict[str, Any]]:
    road = "reconstruct" if recorded.road == "reconstruct" else "track"
    times = np.arange(len(recorded.rest) + len(recorded.clean)) / RATE
    pressed = replace(recorded, steps=recorded.clean, times=times, road=road)
    try:
        return _answered(frame, pressed, options)[0], options
    except Unsupported:
        return _answered(frame, pressed, {})[0], {}


def _answered(frame: Frame, recorded: Recorded, options: dict[str, Any]) -> tuple[Touch, tuple[str, ...]]:
    """Return the touch of a recording's last frame, and the warnings from reading its table."""
    skin = frame.skin
    if recorded.road == "reconstruct":
        last = recorded.steps[-1]
        if "zero" in inspect.signature(Skin.reconstruct).parameters:
            return skin.reconstruct(last, zero=recorded.rest, **options), ()
        # only without limits: limits refer to raw readings, and subtracting the zero would shift them
        return skin.reconstruct(last if frame.limits else last - recorded.rest.mean(axis=0), **options), ()
    readings, times = np.concatenate([recorded.rest, recorded.steps]), recorded.times
    warned: tuple[str, ...] = ()
    if recorded.road == "table":
        readings, times, warned = _through_a_table(readings, times, frame.described.channels)
    with skin.track(baseline=len(recorded.rest), rate=RATE, **options) as tracker:
        for reading, at in zip(readings, times):
            touch = tracker.step(reading, float(at))
    return touch, warned


def _through_a_table(
    readings: Floats, times: Floats, channels: tuple[str, ...]
) -> tuple[Floats, Floats, tuple[str, ...]]:
    """Write readings and times to a table and read it; return both as read, with the warnings."""
    count, shape = len(readings), readings.shape[2:]
    titles = [f"{c}_{i}" for c in channels for i in range(int(np.prod(shape)))]
    lines = [",".join(["t", *titles])]
    lines += [f"{t:.6f}," + ",".join(f"{v:.9g}" for v in r) for t, r in zip(times, readings.reshape(count, -1))]
    mapping = TableMapping(
        time="t", channels={c: f"{c}_{{}}" for c in channels}, scale=1.0, time_scale=1.0, shape=(shape[0], shape[1])
    )
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        path = Path(folder) / "recording.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        recording = read_recording(path, mapping=mapping)
    warned = tuple(f"warning: {w.message}" for w in caught)
    return np.asarray(recording.readings, dtype=np.float64), np.asarray(recording.time, dtype=np.float64), warned


def _unanswered(
    frame: Frame,
    status: str,
    *,
    words: tuple[str, ...] = (),
    seconds: float = np.nan,
    broken: bool = False,
    late: bool = False,
) -> Verdict:
    true = tuple(float(v) for v in frame.load.force)
    none = (float("nan"),) * len(true)
    return Verdict(
        row=frame.row,
        index=frame.index,
        force_error=np.nan,
        field_error=np.nan,
        far=False,
        peak_far=False,
        inside={"force": np.nan, "peak": np.nan, "cells": np.nan},
        words=words,
        seconds=seconds,
        status=status,
        broken=broken,
        late=late,
        found=none,
        low=none,
        high=none,
        true=true,
        fit=np.nan,
        sensor=_kind(frame),
        frame=str(frame),
    )


def verdict(frame: Frame, touch: Touch, reference: Touch, seconds: float) -> Verdict:
    """Return the verdict on a touch, using the touch of a clean frame of the same sensor for comparison."""
    grid = touch.surface
    truth, typical = cell_means(frame.load, grid), cell_means(frame.typical, grid)
    values = to_numpy(touch.values)
    load = frame.typical.size
    names = grid.components
    judged = [i for i, c in enumerate(names) if c in touch.components or c == "z"]
    estimated = [i for i, c in enumerate(names) if c in touch.components]
    force, true = to_numpy(touch.force).astype(np.float64), frame.load.force
    lower_force = true if frame.least is None else frame.least.force
    smallest, largest = np.minimum(lower_force, true), np.maximum(lower_force, true)
    error = force - np.clip(force, smallest, largest)
    low, high = _interval(touch, "force", len(names))
    peak_low, peak_high = _interval(touch, "peak_pressure", 0) if "z" in touch.components else (np.nan, np.nan)
    # a component that is not estimated is assumed zero
    left_out = [i for i in judged if i not in estimated]
    low[left_out] = high[left_out] = 0.0 if np.isfinite(low[estimated]).any() else np.nan
    slack = _EXACT * load
    miss = [float(np.maximum(low[i] - largest[i], smallest[i] - high[i])) for i in range(len(names))]
    if frame.open_above and np.isfinite(high[-1]):
        miss[-1] = math.inf
    outside = [miss[i] > FAR_OUTSIDE * 0.5 * (high[i] - low[i]) + slack for i in judged]
    inside_force = [miss[i] <= slack for i in judged if np.isfinite(low[i])]
    # of a net pull use the strongest pull
    peak = float(truth[-1].max() if (truth[-1] > 0).any() else truth[-1].min())
    strongest = float(np.abs(typical).max())
    peak_miss = _distance_outside(peak, peak_low, peak_high)
    inside = {
        "force": float(np.mean(inside_force)) if inside_force else np.nan,
        "peak": np.nan if not np.isfinite(peak_low) else float(peak_miss <= _EXACT * strongest),
        "cells": _cells(touch, truth, estimated),
    }
    norm = float(np.linalg.norm(typical[judged]))
    fit = getattr(touch, "fit", None)
    fit = float("nan") if fit is None else float(np.min(np.asarray(fit, dtype=np.float64)))
    worst = judged[int(np.nanargmax(np.abs(error[judged])))] if np.isfinite(error[judged]).any() else judged[-1]
    status = Status.SOLVED if touch.status is None else Status.coded(int(np.asarray(touch.status)))
    words = []
    if status not in (Status.SOLVED, Status.NO_CONTACT):
        words.append(f"status {status}")
    if fit < MISFIT:
        words.append(f"fit {fit:.2g}")
    knowledge = _known(reference)
    if knowledge > _known(touch):
        words.append("force or interval not known")
    if high[worst] - low[worst] > load:
        words.append("interval wider than the load")
    usual = {_without_figures(n) for n in reference.notes}
    for note in touch.notes:
        if _without_figures(note) not in usual and not note.startswith(Status.NO_CONTACT.label):
            words.append(f"note: {note}")
    finite = error[judged][np.isfinite(error[judged])]
    return Verdict(
        row=frame.row,
        index=frame.index,
        force_error=float(np.linalg.norm(finite)) / load,
        field_error=float(np.linalg.norm((values - truth)[judged])) / norm,
        far=any(outside),
        peak_far=bool(peak_miss > FAR_OUTSIDE * 0.5 * (peak_high - peak_low) + _EXACT * strongest),
        inside=inside,
        words=tuple(words),
        seconds=seconds,
        status=status.label,
        broken=False,
        late=False,
        found=tuple(float(v) for v in force),
        low=tuple(float(v) for v in low),
        high=tuple(float(v) for v in high),
        true=tuple(float(v) for v in true),
        fit=fit,
        sensor=_kind(frame),
        frame=str(frame),
        rough=any(n.startswith(ROUGHLY) for n in touch.notes),
    )


def _kind(frame: Frame) -> str:
    return f"{frame.sensor.kind} of {'+'.join(frame.sensor.channels)}"


def _distance_outside(value: float, low: float, high: float) -> float:
    """Return how far a value is outside an interval; NaN without an interval."""
    return float(np.maximum(low - value, value - high))


def _known(touch: Touch) -> int:
    """Return 0 if the force is unknown, 1 if it is known, 2 if its interval is known too."""
    if not np.isfinite(to_numpy(touch.force)).all():
        return 0
    low, high = _interval(touch, "force", len(touch.surface.components))
    estimated = [touch.surface.components.index(c) for c in touch.components]
    return 1 + int(np.isfinite(low[estimated]).all() and np.isfinite(high[estimated]).all())


def _interval(touch: Touch, of: str, length: int) -> tuple[Any, Any]:
    """Return the 95 % interval, or NaN without one."""
    if not touch.has_intervals:
        nothing = np.full(length, np.nan) if length else np.nan
        return nothing, np.copy(nothing)
    low, high = touch.interval(0.95, of)
    return np.array(to_numpy(low), dtype=np.float64), np.array(to_numpy(high), dtype=np.float64)


def _cells(touch: Touch, truth: Floats, estimated: list[int]) -> float:
    """Fraction of cells in contact (truly or as estimated) with traction in its interval, of estimated components."""
    if not touch.has_intervals:
        return np.nan
    low, high = (np.asarray(side)[estimated] for side in touch.interval(0.95))
    values = to_numpy(touch.values)
    in_contact = (np.abs(truth).sum(axis=0) > 0) | (np.abs(values).sum(axis=0) > 0)
    if not in_contact.any() or not np.isfinite(low[:, in_contact]).any():
        return np.nan
    slack = _EXACT * float(np.abs(truth).max())
    inside = (truth[estimated] >= low - slack) & (truth[estimated] <= high + slack)
    return float(np.mean(inside[:, in_contact]))


def _without_figures(note: str) -> str:
    """Return a note without its numbers and lists of taxels, so that notes that differ only in these count as one."""
    return re.sub(r"[-+]?\d[\d.,e+-]*", "#", note.partition(": ")[0] if ": " in note else note)
