"""Notes of a tracker."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from palpate._numbers import plain_time
from palpate.elastic.channels import CHANNELS, channel_unit
from palpate.elastic.pad import Floats
from palpate.tracking.times import FrameTime

__all__ = ["at_their_end", "drifted", "one_taxel", "restarted", "unfinished"]


def unfinished(budget: float | None, tolerance: float, *, exhausted: bool) -> str:
    """Return advice for an iteration that did not converge; ``exhausted``: it ran out of steps, not of time."""
    if budget is not None and not exhausted:
        return f"the iteration ran out of time: pass a budget larger than {budget:.3g} s"
    return (
        f"the iteration ran out of steps: the next frame continues from here; a tolerance= looser than {tolerance:.3g} ends "
        "it earlier"
    )


def at_their_end(count: int, *, overload: bool) -> list[str]:
    """Note that ``count`` readings are saturated; ``overload``: too many to determine the load."""
    if not count:
        return []
    used = "the load has no upper bound" if overload else "left out; the load is at least what they show"
    return [f"{count} readings are at the end of their range: {used}"]


def drifted(drift: Floats, index: npt.NDArray[np.intp], std: Floats, label: Callable[[int], str]) -> list[str]:
    """Notes on channels (``index`` of each reading) whose zero drifted by ``drift`` (channel,); 0: not notable."""
    said = []
    for c in np.flatnonzero(drift):
        first = int(np.argmax(index == c))
        channel = label(first).split(" at ")[0]
        unit = f" {channel_unit(channel)}" if channel in CHANNELS else ""
        said.append(f"the zero of {channel} has drifted by {drift[c] * std[first]:.3g}{unit}: removed")
    return said


def one_taxel(label: str) -> str:
    """Note that one reading (``label``) alone responds while nothing else shows a contact."""
    return (
        f"small contact or a broken taxel: {label} alone responds, so the force is not known. If nothing touches it, take a new "
        "zero (Z on the page, Tracker.rezero), or leave it out (Skin.masked)"
    )


def restarted(frame: FrameTime, *, creeps: bool) -> str:
    """Note that the clock restarted; ``creeps``: the pad's creep is removed from the readings."""
    creep = "; the pad's creep continues as if without a pause" if creeps else ""
    return f"the clock went back from {plain_time(frame.before or 0.0)} s to {plain_time(frame.now)} s: contact is estimated anew, the zero is kept{creep}"
