"""A frame that is to be explained, and what a hypothesis leaves of it."""

from __future__ import annotations

from typing import NamedTuple

from palpate.elastic.pad import Floats
from palpate.tracking.health import Flags

__all__ = ["Found", "Frame"]


class Frame(NamedTuple):
    """A frame to be explained: readings without zero and offsets (NaN where missing), noise, when it must be done, and how much noisier it is
    for the noise of the zero.
    """

    actual: Floats
    noise: float
    deadline: float
    noisier: float = 1.0


class Found(NamedTuple):
    """What a hypothesis leaves of each reading, its root mean square, and which readings it does not use."""

    rest: Floats
    left: float
    unused: Flags
    fits: bool
