"""Screen the readings of one frame: which are used, which are saturated, and which values replace the unused ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.screening import Ceilings, ceilings, silent, stuck
from palpate.sensing.limits import at_ends

__all__ = ["Observed", "constant", "ends_of_range", "observe"]

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Observed:
    """Readings (reading,) of one frame.

    ``data`` are the readings; in ``filled`` the linear model's prediction replaces outliers. ``alive``: not missing, dead
    or in a constant channel; ``usable``: alive and no outlier. ``ends``: saturated readings, None if screening is
    switched off.
    """

    data: Floats
    filled: Floats
    alive: Flags
    usable: Flags
    ends: Ceilings | None

    @property
    def limited(self) -> Flags:
        """Mask of saturated readings."""
        return np.zeros(len(self.data), dtype=bool) if self.ends is None else self.ends.upper | self.ends.lower


def observe(estimator: PreparedContact, readings: Sequence[Floats]) -> Observed:
    """Screen the readings of a frame, (channel, *array) per plane."""
    noise, policy = estimator.noise, estimator.policy
    data, missing = estimator.data_of(readings)
    data = noise.unlike(data)
    alive, ends = noise.alive(data) & ~missing, ends_of_range(estimator, readings, data)
    if not policy.parts.screening:
        return Observed(data, data, alive, alive.copy(), ends)
    alive &= ~silent(data, noise.index, estimator.pairs, policy)
    if ends is not None:
        alive &= ~stuck(as_read(estimator, data), noise.index, estimator.pairs, ends, policy)
    plain = Observed(data, data, alive, alive, ends)
    found = estimator.start.screened(data, alive & ~plain.limited, estimator.shifts[:, : estimator.usual])
    usable = alive & ~found.broken
    return Observed(data, np.where(usable, data, found.explained), alive, usable, ends)


def ends_of_range(estimator: PreparedContact, readings: Sequence[Floats], data: Floats) -> Ceilings | None:
    """Saturated readings, from the given limits or detected in the frame; None if screening is switched off."""
    if not estimator.policy.parts.screening:
        return None
    given = None
    if estimator.given_ends is not None:
        given = at_ends(estimator.readings.flat(readings), estimator.given_ends)
    read = as_read(estimator, data)
    found = ceilings(read, estimator.noise.index, estimator.pairs, estimator.policy, given)
    if estimator.zero is None or not estimator.noise_known:
        return found
    far = np.abs(data) > estimator.policy.screening.moved * estimator.readings.std
    end = constant(estimator, data) & far
    return replace(found, upper=found.upper | (end & (data > 0)), lower=found.lower | (end & (data < 0)))


def constant(estimator: PreparedContact, data: Floats) -> Flags:
    """Mask of the channels whose readings, with their zero, are all the same and not 0: at the end of their range, if
    they are not at rest.
    """
    read, index = as_read(estimator, data), estimator.noise.index
    out = np.zeros(len(data), dtype=bool)
    for channel in range(int(index[-1]) + 1):
        mine = index == channel
        size = float(np.abs(read[mine]).max())
        out[mine] = mine.sum() > 1 and size > 0.0 and np.ptp(read[mine]) <= 1e-12 * size
    return out


def as_read(estimator: PreparedContact, data: Floats) -> Floats:
    """Readings with their zero."""
    return data if estimator.zero is None else data + estimator.zero
