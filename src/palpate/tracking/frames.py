"""A frame to solve, and the residual of a solution."""

from __future__ import annotations

from typing import NamedTuple

from palpate.elastic.pad import Floats
from palpate.tracking.health import Flags

__all__ = ["Frame", "Residual"]


class Frame(NamedTuple):
    """A frame to solve: readings without zero and offsets (NaN if missing), noise, deadline, and the factor by which
    the noise of the zero increases the noise.
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
