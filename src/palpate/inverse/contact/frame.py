"""One frame while it is solved, and when it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.summary import Summary
from palpate.inverse.estimate import Errors, Stated

__all__ = ["Frame"]


Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Frame:
    """One frame's result. Errors of a contact too large for matrices are worked out when they are asked for. ``small``: it may be a disc of about a
    pitch or less (`palpate.inverse.contact.compact`); 2 where one taxel alone tells it. ``adrift``: drift may be part of its force. ``stated``: what it owes to a pad that is not known exactly.
    ``alone``: the largest part of the load that one taxel alone tells; ``beyond``: `Posterior.beyond`; ``unproven``: as `no_contact.detection_limit` has it;
    ``hangs``: the part of the normal force that one reading alone tells, where no ends of its range are given. ``discrepancy``: share of the readings that the pad's model leaves
    unexplained; ``unexplained``: nothing explains the readings; ``undecided``: noise or an offset explains them, and so may
    contact; ``one_penalty``: found by one even penalty
    (`palpate.inverse.contact.discrepancy`); ``overload``: so many readings lie at the end of their range that the load has no upper end; ``bounds`` (component, 2): net forces that the readings do not rule out besides, NaN where there are none; ``free``: degrees of freedom that contact left to noise.
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

    @property
    def known(self) -> Errors:
        """The errors, worked out."""
        return self.errors.errors() if isinstance(self.errors, Summary) else self.errors
