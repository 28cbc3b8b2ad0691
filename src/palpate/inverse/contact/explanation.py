"""Data classes: an explanation of a frame, its rough solution, and its full solution."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import ContactModel

__all__ = ["Beside", "Explanation", "Rough", "Solved"]

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Beside:
    """What the readings tell of nuisances beside a contact on its face (`variances.told_of`): the ``information``
    (nuisance, nuisance), the gradient ``pull`` (nuisance,), and the sum of squares ``left`` of the whitened residual.
    ``unit`` (nuisance,): length of the whitened pattern of each; the others are for patterns of length one.
    """

    information: Floats
    pull: Floats
    left: float
    unit: Floats


@dataclass(frozen=True)
class Rough:
    """A rough solution: gain (see `score.gain_of`), residual noise and degrees of freedom, traction (component, cell),
    predicted readings, the loaded fraction of the cells above the outermost taxels, and the change of the sizes of its
    nuisances (nuisance,) if contact and they are solved together, with its standard deviations. ``beside``: what the
    readings tell of all nuisances, where it was asked for.
    """

    gain: float
    left: float
    free: float
    traction: Floats
    explained: Floats
    edge: float
    change: Floats = field(default_factory=lambda: np.zeros(0))
    deviation: Floats = field(default_factory=lambda: np.zeros(0))
    beside: Beside | None = None


@dataclass(frozen=True)
class Explanation:
    """One hypothesis about a frame: the sign of the contact, and which nuisances (offsets, ramps) are in the readings.

    ``sign`` is 1 if contact pushes, -1 if it pulls, 0 if it does both. ``sizes`` are the sizes of the nuisances (0 if
    absent). ``rival`` is the best alternative: with nuisances, or without them if this one has some and the noise is given or no other has any.
    ``refuted`` is contact of one sign that coarse cells refute, but that may be right with pull around it. ``noise`` is the residual of a contact in a few
    cells, if the linear model would take the readings for noise (`palpate.inverse.contact.few_cells`). ``choice`` is the
    log of the number of candidates from which its nuisances were chosen, and what drift of their size costs;
    `score.worth_of` subtracts it.
    """

    sign: int
    rough: Rough
    sizes: Floats
    noise: float | None = None
    choice: float = 0.0
    rival: Explanation | None = None
    refuted: Explanation | None = None

    @property
    def present(self) -> Flags:
        """Mask of the nuisances in the readings."""
        return self.sizes != 0.0

    def predicted(self, shifts: Floats) -> Floats:
        """The readings (reading,) of the rough contact and the nuisances, of which ``shifts`` are the patterns."""
        return np.asarray(self.sign * self.rough.explained + shifts @ self.sizes)


@dataclass
class Solved:
    """A solved explanation: its models, and the data, noise and settings used. No models means no contact.

    ``explains``: little more than noise is left. ``doubtful``: see `systematic.doubtful`; ``drift``: see `misfit.drift_probability`; ``adrift``: total weight of the models whose normal force may be drift
    (`systematic.add_hidden_drift`).
    """

    explanation: Explanation
    members: list[ContactModel]
    data: Floats
    noise: Floats
    observed: Flags
    parameter: float
    scale: float
    levels: Floats | None
    explains: bool
    doubtful: tuple[Floats, Floats] = field(default_factory=lambda: (np.zeros((0, 0)), np.zeros(0)))
    drift: float = math.nan
    adrift: float = 0.0
