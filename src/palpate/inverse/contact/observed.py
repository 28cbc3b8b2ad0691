"""The readings of one frame: which of them count, which lie at an end of their range, and what stands in for those that do not count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.prepared import Prepared
from palpate.inverse.contact.screening import Ceilings, ceilings, silent
from palpate.sensing.limits import at_ends

__all__ = ["Observed", "ends_of_range", "observe"]

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Observed:
    """Readings (reading,) of one frame.

    ``filled`` are those that contact is sought in: ``data`` with broken readings replaced by what the others tell. ``alive``: neither dead nor of a channel
    that reads one value; ``usable``: alive and not found to be broken. ``ends``: those at an end of their range, None where nothing is screened.
    """

    data: Floats
    filled: Floats
    alive: Flags
    usable: Flags
    ends: Ceilings | None

    @property
    def limited(self) -> Flags:
        """Readings at an end of their range."""
        return np.zeros(len(self.data), dtype=bool) if self.ends is None else self.ends.upper | self.ends.lower


def observe(estimator: Prepared, readings: Sequence[Floats]) -> Observed:
    """The readings of a frame, (channel, *array) per plane, screened."""
    noise, policy = estimator.noise, estimator.policy
    data = noise.unlike(estimator.readings.flat(estimator.operator.observed(readings)))
    alive, ends = noise.alive(data), ends_of_range(estimator, readings, data)
    if not policy.parts.screening:
        return Observed(data, data, alive, alive.copy(), ends)
    alive &= ~silent(data, noise.index, estimator.pairs, policy)
    plain = Observed(data, data, alive, alive, ends)
    found = estimator.start.screened(data, alive & ~plain.limited, estimator.shifts[:, : estimator.usual])
    usable = alive & ~found.broken
    return Observed(data, np.where(usable, data, found.explained), alive, usable, ends)


def ends_of_range(estimator: Prepared, readings: Sequence[Floats], data: Floats) -> Ceilings | None:
    """Readings at the end of their range, as stated or as the frame shows it; None where nothing is screened."""
    if not estimator.policy.parts.screening:
        return None
    given = None
    if estimator.given_ends is not None:
        given = at_ends(estimator.readings.flat(readings), estimator.given_ends)
    raw = data if estimator.zero is None else data + estimator.zero
    return ceilings(raw, estimator.noise.index, estimator.pairs, estimator.policy, given)
