"""A touch in words."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate._arrays import to_numpy
from palpate._numbers import plain_number
from palpate._plot import scaled
from palpate.elastic.pad import Floats
from palpate.status import Status
from palpate.touch.intervals import calibration_note, interval
from palpate.touch.numbers import Numbers
from palpate.touch.outcome import Outcome, assumed, notes_with
from palpate.touch.rounding import force_unit, format_interval

__all__ = ["assumptions", "notes", "outcome", "summary"]

#: Smallest fraction of the normal force outside the outermost taxels that a summary notes.
OUTSIDE = 0.05


def outcome(touch: Numbers) -> list[str]:
    """Notes on the frames of a touch, one sentence for each kind of outcome."""
    return Outcome.of(touch).words()


def notes(touch: Numbers) -> tuple[str, ...]:
    """See `Touch.notes`."""
    format_interval = calibration_note(touch)
    return (*notes_with(touch.assumptions, Outcome.of(touch)), *((format_interval,) if format_interval else ()))


def assumptions(touch: Numbers) -> tuple[str, ...]:
    """See `Touch.assumed`."""
    return assumed(touch.assumptions, Outcome.of(touch))


def summary(one: Numbers, friction: float | None) -> str:
    """Force, peak pressure, centre of pressure, contact and slip margin of one frame, one to a line, what was assumed, then the notes.

    A number and its 95 % interval are rounded alike.
    """
    line = one.surface.dimensions == 1
    force = np.asarray(to_numpy(one.force), dtype=np.float64)
    components = one.surface.components
    # A tracker continues with numbers that its model does not explain, but nobody should use them.
    unexplained = one.status is not None and int(np.asarray(one.status)) == int(Status.UNEXPLAINED)
    if unexplained or not np.isfinite(force).any():
        return "\n".join([f"{'net force':<16}not known{_at_most(one, line=line)}", *_below(one)])
    # Some frames have no intervals: solved by a method without error bars, or before a stream has computed them.
    calibrated = one.calibrated is not None and one.calibrated.known
    known = one._errors is not None and (calibrated or bool(np.isfinite(one._errors.posterior.force).any()))

    def bounds(of: str, **given: float) -> tuple[Floats, Floats]:
        if not known:
            return np.full(9, np.nan), np.full(9, np.nan)
        low, high = (np.ravel(to_numpy(v)) for v in interval(one, 0.95, of, given.get("friction")))
        return low, high

    lines = []

    def say(name: str, value: float, low: float, high: float, factor: float, unit: str) -> None:
        lines.append(f"{name:<16}{format_interval(value, low, high, factor=factor, unit=unit)}")

    low, high = bounds("force")
    sizes = np.abs(force if force.any() else np.array([*low, *high]))
    factor, unit = force_unit(float(np.max(sizes[np.isfinite(sizes)], initial=0.0)), "N/m" if line else "N")
    force_factor, force_name = factor, unit
    for i, c in enumerate(components):
        if c in one.components or one.surface.bends:
            say(f"net force {c}", float(force[i]), float(low[i]), float(high[i]), factor, unit)
        else:
            lines.append(f"{f'net force {c}':<16}taken as 0, not measured")
    if one.has_intervals and not known:
        lines.append(f"{'95 % interval':<16}not known for this frame (method {one.methods.item()})")
    if "z" in one.components:
        peak = float(one.peak_pressure)
        low, high = bounds("peak_pressure")
        factor, unit = _unit([peak or float(high[0])], "Pa")
        say("peak pressure", peak, float(low[0]), float(high[0]), factor, unit)
        factor, unit = _unit([max(float(np.ptp(a)) for a in one.surface.axes)], "m")
        factor, unit = (1e3, "mm") if unit == "m" else (factor, unit)
        centre = np.ravel(to_numpy(one.center_of_pressure))
        low, high = bounds("center_of_pressure")
        for i, value in enumerate(centre):
            if np.isfinite(value):
                say(f"centre {'xy'[i]}", float(value), float(low[i]), float(high[i]), factor, unit)
        outside = 0.0 if one._errors is None else float(one._errors.posterior.outside_force[-1])
        if outside > OUTSIDE * abs(float(force[-1])):
            lines.append(
                f"{'outside array':<16}{format_interval(outside, factor=force_factor, unit=force_name)} of the normal force, where nothing is measured"
            )
        size = float(one.contact_area()) * (factor if line else factor**2)
        if np.isfinite(size):
            lines.append(
                f"{'contact width' if line else 'contact area':<16}{plain_number(size, 4)} {unit}{'' if line else '^2'}"
            )
    if friction is not None and set(one.components) == set(components):
        margin = float(one.slip_margin(friction))
        low, high = bounds("slip_margin", friction=friction)
        factor, unit = _unit([margin, float(low[0]), float(high[0])], "Pa")
        if np.isfinite(margin):  # in frames with contact
            say("slip margin", margin, float(low[0]), float(high[0]), factor, unit)
            lines[-1] += f", at friction {friction:g}"
    if one.sliding is not None and float(one.sliding) > 0.5:
        sure = 100 * float(one.sliding)
        lines.append(f"{'shear':<16}in one proportion to pressure, as where all of it slides: sure to {sure:.0f} %")
    if known:
        # The first interval states the probability for all.
        first = next((i for i, text in enumerate(lines) if " (" in text), None)
        if first is not None:
            lines[first] = lines[first].replace(" (", " (95 %: ", 1)
    return "\n".join([*lines, *_below(one)])


def _at_most(one: Numbers, *, line: bool) -> str:
    """The upper bound of the normal force, the only number of an unexplained frame."""
    if not one.has_intervals or "z" not in one.components:
        return ""
    end = float(np.ravel(to_numpy(interval(one, 0.95, "force", None)[1]))[-1])
    if not (math.isfinite(end) and end > 0.0):
        return ""
    factor, unit = force_unit(end, "N/m" if line else "N")
    return f" (at most {format_interval(end, factor=factor, unit=unit)})"


def _below(one: Numbers) -> list[str]:
    """The assumptions in one line, and a line for each note."""
    found = assumptions(one)
    return [*([f"{'assumed':<16}{'; '.join(found)}"] if found else []), *(f"note: {n}" for n in notes(one))]


def _unit(values: Sequence[float], unit: str) -> tuple[float, str]:
    """Factor and unit for the largest of some numbers."""
    size = max((abs(float(v)) for v in values if np.isfinite(v)), default=0.0)
    return scaled(size, unit) if size > 0 else (1.0, unit)
