"""Saturated readings: each is a lower bound. If there are many, the load has no upper bound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact import trace
from palpate.inverse.contact.discrepancy import solve_with_model_error
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.no_contact import WIDE
from palpate.inverse.contact.observed import constant, ends_of_range
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.screening import Ceilings
from palpate.sensing.limits import at_ends

__all__ = ["solve_within_range"]


def solve_within_range(
    estimator: PreparedContact, readings: Sequence[Floats], rng: np.random.Generator | None
) -> Frame:
    """The result of one frame that may have saturated readings.

    A saturated reading is censored: it constrains the contact only if the contact predicts less. If many readings are
    saturated, the frame is also solved with the saturated values taken as true: every true reading is at least as large.
    But equal readings also look like a wide contact, which on a bonded layer takes more force. So the result without them
    counts if it leaves enough degrees of freedom to be proven; if neither does, the smaller load counts.
    """
    policy = estimator.policy
    data, _ = estimator.data_of(readings)
    ends = ends_of_range(estimator, readings, data)
    if ends is None or not ends.any:
        return _unless_constant(estimator, solve_with_model_error(estimator, readings, rng), data)
    at_end = _saturated(estimator, readings, data, ends)
    count = np.bincount(estimator.noise.index)
    part = float((np.bincount(estimator.noise.index, at_end, len(count)) / count).max())
    if part < policy.screening.open_end:
        return _unless_constant(estimator, solve_with_model_error(estimator, readings, rng), data)
    trace.step(
        f"{part:.0%} of a channel at its end of range: solved as they are, for a lower bound, and again without them"
    )
    least = solve_with_model_error(estimator.as_they_are(), readings, rng)
    # The others determine a contact if they are at least half.
    found = least if at_end.mean() > 0.5 else solve_with_model_error(estimator, readings, rng)
    push, force = float(np.nansum(least.traction[-1])), estimator.operator.surface.cell
    sign = -1.0 if push < 0 else 1.0
    without = sign * float(np.nansum(found.traction[-1])) if found.contact else 0.0
    least_proven, proven = (f.free > policy.fit.proves for f in (least, found))
    apart = WIDE * math.hypot(least.known.force[-1], found.known.force[-1]) / force if proven else 0.0
    if 0.0 < without < abs(push) - apart and (proven or not least_proven):
        push = sign * without  # the smaller load counts, unless only the larger one is proven
    elif without < abs(push) or not proven:
        found = least
    bounds = np.full((len(found.traction), 2), math.nan)
    bounds[-1] = (force * push, math.inf) if sign > 0 else (-math.inf, force * push)
    both = all(np.bincount(estimator.noise.index, at_end & flags).all() for flags in (ends.upper, ends.lower))
    mixed = abs(push) < 0.5 * float(np.nansum(np.abs(least.traction[-1])))
    if both or mixed or without < 0.0:  # nothing shows whether it is pushed
        bounds[-1] = -math.inf, math.inf
    return replace(
        found,
        bounds=bounds,
        overload=bool(least.contact or at_end.all()),
        unexplained=False,
        undecided=False,
        at_limit=at_end,
        nuisance=np.zeros(len(estimator.terms)) if found is least else found.nuisance,
        nuisance_std=np.zeros(len(estimator.terms)) if found is least else found.nuisance_std,
        outliers=np.zeros(len(data), dtype=bool) if found is least else found.outliers,
    )


def _saturated(
    estimator: PreparedContact, readings: Sequence[Floats], data: Floats, ends: Ceilings
) -> npt.NDArray[np.bool_]:
    """Mask of the readings that count as saturated: at rest, coarsely rounded readings are often equal, so those at an
    end that was not given must be far from zero, or all of a channel.
    """
    far = np.ones(len(data), dtype=bool)
    if estimator.noise_known:
        far = np.abs(data) > estimator.policy.screening.deviations * estimator.readings.std
    at_end = (ends.upper | ends.lower) & (far | constant(estimator, data))
    if estimator.given_ends is not None:
        at_end |= np.logical_or(*at_ends(estimator.readings.flat(readings), estimator.given_ends))
    return np.asarray(at_end)


def _unless_constant(estimator: PreparedContact, frame: Frame, data: Floats) -> Frame:
    """The frame; undecided and without bounds if it shows no contact while all readings of a channel are the same, as
    an offset makes them and the end of the range. Displacements are the same if the image moved; after a zero, readings
    are the same at rest.
    """
    if frame.contact or estimator.zero is not None:
        return frame
    moves = [c.startswith("displacement") for a in estimator.operator.planes_of for c in a.channels]
    if not (constant(estimator, data) & ~np.array(moves)[estimator.noise.index]).any():
        return frame
    bounds = np.tile([-math.inf, math.inf], (len(frame.traction), 1))
    return replace(frame.blanked(), undecided=True, unexplained=False, bounds=bounds)
