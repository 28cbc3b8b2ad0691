"""What a frame may be taken to be: an explanation, its rough solution, and the explanation solved."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import ContactModel

__all__ = ["Explanation", "Rough", "Solved"]

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Rough:
    """A rough solution: its gain, the noise that it leaves, degrees of freedom left, traction (component, cell), loaded part of the ring, and how the sizes of
    its nuisances change when contact and they are solved together, with
    their standard deviations.
    """

    gain: float
    left: float
    free: float
    traction: Floats
    explained: Floats
    ring: float
    change: Floats = field(default_factory=lambda: np.zeros(0))
    deviation: Floats = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Explanation:
    """What a frame is taken to be.

    ``sign`` is 1 where contact pushes, -1 where it pulls, 0 where it does both; ``sizes`` are those of the nuisances (0: absent), ``present``
    says which are. ``rivals`` are the others with nuisances, the best first. ``noise`` is what contact in a few cells leaves, where the linear model takes the readings for noise (`palpate.inverse.contact.few_cells`).
    """

    sign: int
    rough: Rough
    sizes: Floats
    present: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool))
    noise: float | None = None
    rivals: tuple[Explanation, ...] = ()


@dataclass
class Solved:
    """One explanation of a frame, solved: its models, and what they were solved with. Without models nothing touches.

    ``drift``: `misfit.drift_probability`; ``adrift``: the weight of models whose normal force may be drift (`systematic.add_hidden_drift`).
    """

    explanation: Explanation
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
    drift: float = math.nan
    adrift: float = 0.0
