"""What a frame shows at once, a frame to solve, the residual of a solution, an alternative that was tried, and the numbers of an answer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.estimate import Errors, Stated
from palpate.tracking.health import Flags
from palpate.tracking.offsets import Marginal

__all__ = ["Alternative", "Frame", "Look", "Numbers", "Residual"]


class Look(NamedTuple):
    """What a frame shows before contact is sought. ``scaled``: readings in units of their standard deviations, NaN if
    missing; ``actual``: without zero and offsets; ``y``: the same, 0 where unused; ``slope`` (component, cell): A'y;
    ``score`` (cell,): the pressure of each cell alone, and its ``level`` at rest; ``rounding`` of the readings.
    """

    scaled: Floats
    actual: Floats
    y: Floats
    noise: float
    slope: npt.NDArray[np.float32]
    score: Floats
    level: Floats
    rounding: float

    @property
    def highest(self) -> float:
        """Largest score, in units of its level."""
        return float((np.abs(self.score) / self.level).max())


class Frame(NamedTuple):
    """A frame to solve: readings without the zero (NaN if missing), noise, deadline, and the factor by which the noise of
    the zero increases the noise. `Contact.solve` gets the readings without offsets too; `Held.follow` and a single solve
    seek the offsets themselves.
    """

    actual: Floats
    noise: float
    deadline: float
    noisier: float = 1.0


class Residual(NamedTuple):
    """Residual of each reading, its root mean square, the readings that were not used, and whether the solution fits."""

    values: Floats
    rms: float
    unused: Flags
    fits: bool


class Alternative(NamedTuple):
    """Contact of one kind, solved: its residual, the readings that it takes for wrong, the offsets that go with it,
    whether its iteration converged, and whether its readings ask for pull.
    """

    residual: Residual
    suspects: Flags
    marginal: Marginal | None
    converged: bool = True
    pulls: bool = False


class Numbers(NamedTuple):
    """Traction (component, *surface), its errors, those due to the pad, and the discrepancy; without errors, nothing is
    known of them.
    """

    traction: Floats
    errors: Errors | None = None
    stated: Stated | None = None
    discrepancy: float = 0.0
