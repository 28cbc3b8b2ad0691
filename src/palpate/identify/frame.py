"""The fit of one frame, from which findings are computed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.elastic.pad import Pad
from palpate.identify.findings import Patch
from palpate.identify.fitting import Fit
from palpate.identify.texture import Texture
from palpate.sensing.arrays import Array
from palpate.sensing.uncertainty import Uncertainty

__all__ = ["Body", "Frame"]


@dataclass(frozen=True)
class Body:
    """The pad, its arrays, and their uncertainty."""

    pad: Pad
    planes: tuple[Array, ...]
    uncertainty: Uncertainty


@dataclass(frozen=True)
class Frame:
    """One frame, before it is put into words.

    ``reason`` says why nothing was fitted; ``best`` are the contacts that explain it, ``other`` the one of the other shape; ``rise`` in squares is an end of
    an interval; ``profiles`` of each contact its ends and fits on the way; ``shifts`` fits with a pad that is described otherwise and the standard deviation of that over
    the change; ``depth`` the indentation; ``guesses`` patches of the map.
    """

    body: Body
    reason: str = ""
    best: Fit | None = None
    other: Fit | None = None
    shape: str = ""
    shape_reason: str = ""
    rise: float = math.nan
    profiles: tuple[tuple[float, float, list[Fit]], ...] = ()
    shifts: tuple[tuple[Fit, float], ...] = ()
    texture: Texture | None = None
    depth: float = math.nan
    guesses: tuple[Patch, ...] = ()
    misfit: float = math.nan
    components: tuple[str, ...] = ()

    @property
    def quantile(self) -> float:
        """Standard deviations to an end of an interval, scaled by what the residuals exceed the noise."""
        return math.sqrt(self.rise)
