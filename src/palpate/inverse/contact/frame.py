"""One frame while it is solved, and when it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.hypotheses import Hypothesis
from palpate.inverse.contact.model import ContactModel
from palpate.inverse.estimate import Errors

__all__ = ["Frame", "Run"]

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Frame:
    """One frame's result."""

    traction: Floats
    errors: Errors
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


@dataclass
class Run:
    """One hypothesis of a frame, solved: its models, and what they were solved with. Without models nothing touches."""

    hypothesis: Hypothesis
    members: list[ContactModel]
    data: Floats
    noise: Floats
    observed: Flags
    parameter: float
    scale: float
    levels: Floats | None
    pushed: bool
    limit: float
    doubtful: tuple[Floats, Floats]
