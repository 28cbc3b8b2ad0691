"""The fit of one frame, from which the findings are computed."""

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
    """The fit of one frame.

    ``reason`` says why nothing was fitted. ``best`` are the contacts that explain the frame, ``other`` is the fit of
    the other shape. ``rise`` is the increase of squares that ends an interval; ``profiles`` are, for each contact, its
    ends and the fits on the way. ``shifts`` are fits with a varied description of the pad, each with the standard
    deviation of that variation divided by the change made. ``depth`` is the indentation; ``guesses`` are patches of
    the map.
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
        """Half-width of an interval in standard deviations, scaled up if residuals exceed the noise."""
        return math.sqrt(self.rise)
