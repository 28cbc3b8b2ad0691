"""Result of one frame, before the frames of a batch are gathered."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.again import Models
from palpate.inverse.contact.summary import Summary
from palpate.inverse.estimate import Errors, Stated
from palpate.inverse.fit import rms

__all__ = ["Frame"]


Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Frame:
    """Result of one frame. Errors of a contact too large for dense matrices are computed on demand.

    ``sign``: 1 if contact pushes (also without contact), -1 if it pulls, 0 if it does both anywhere, 2 if it pushes with
    pull around it. ``pushed``: a contact that only pushes leaves little more than noise.
    ``small``: 1 if the contact may be a disc of about a pitch or less (`palpate.inverse.contact.compact`), 2 if only
    one taxel shows it. ``adrift``: drift may be part of its force. ``stated``: errors due to pad properties that are
    not known exactly. ``alone``: largest fraction of the load that rests on one taxel. ``beyond``: see
    `Posterior.beyond`. ``unproven``: see `no_contact.detection_limit`. ``hangs``: fraction of the normal force that
    rests on one reading, if the limits of its range are not given. ``discrepancy``: model error as a fraction of the
    readings. ``unexplained``: no explanation fits the readings. ``undecided``: noise or an offset explains the
    readings, but so may contact. ``one_penalty``: solved with a single even penalty
    (`palpate.inverse.contact.discrepancy`). ``overload``: so many readings are saturated that the load has no upper
    bound. ``bounds`` (component, 2): net forces that the readings do not exclude beyond the interval, NaN if there are
    none. ``free``: degrees of freedom of the residual. ``resolution`` [m]: NaN if it follows from ``parameter``.
    ``refused``: why the frame was not solved, if it was not. ``models``: those that later frames of this contact can be solved with, if there are any.
    """

    traction: Floats
    errors: Errors | Summary
    parameter: float
    noise: Floats
    residual: float
    converged: bool
    contact: bool
    outliers: Flags
    draws: Floats | None
    pushed: bool = True
    sliding: float = math.nan
    sign: int = 1
    fit: float = math.nan
    nuisance: Floats = field(default_factory=lambda: np.zeros(0))
    nuisance_std: Floats = field(default_factory=lambda: np.zeros(0))
    at_limit: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool))
    small: int = 0
    adrift: bool = False
    stated: Stated | None = None
    alone: float = 0.0
    beyond: tuple[float, float, float] = (0.0, 0.0, 0.0)
    unproven: int = 0
    hangs: float = 0.0
    discrepancy: float = 0.0
    unexplained: bool = False
    undecided: bool = False
    overload: bool = False
    one_penalty: bool = False
    bounds: Floats = field(default_factory=lambda: np.full((1, 2), math.nan))
    free: float = math.nan
    resolution: float = math.nan
    refused: str = ""
    models: Models | None = None

    @property
    def left(self) -> float:
        """Root mean square of the residual in units of the given noise."""
        return self.residual * rms(self.noise)

    @property
    def known(self) -> Errors:
        """All errors, computed if necessary."""
        return self.errors.errors() if isinstance(self.errors, Summary) else self.errors

    def blanked(self) -> Frame:
        """The frame with unknown traction, and unknown draws if there are any."""
        draws = None if self.draws is None else np.full_like(self.draws, math.nan)
        return replace(self, traction=np.full_like(self.traction, math.nan), draws=draws)
