"""What a pad's model leaves unexplained: a part of the readings, learned over the recording.

    readings = A t + noise + discrepancy,    discrepancy ~ N(0, share^2 * mean square of the readings)

The share of a frame is what contact leaves beyond the noise, per degree of freedom that the contact did not take. It counts as noise when the contact
is found, and widens every interval as an error that all readings share.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.contact.answer import hidden, nothing_known
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.discrepancy import posterior
from palpate.inverse.contact.policy import Fit
from palpate.inverse.estimate import Stated
from palpate.sensing.grids import Grid
from palpate.touch import Touch

__all__ = ["LARGEST", "Discrepancy", "share_of", "widened", "without_numbers"]

_POLICY = Fit()
#: Of readings whose noise a zero tells, a pad's model leaves at least the first share; beyond the second it does not explain them.
LEAST, LARGEST = _POLICY.shares[0], _POLICY.shares[-1]
#: Looks that the share is the mean of, and standard deviations of its own by which what is left is beyond noise.
LOOKS, BEYOND = 32, 3.0


class Discrepancy:
    """The share of the readings that the model leaves unexplained; ``zeroed``: whether frames at rest tell the noise.

    Examples
    --------
    >>> from palpate.tracking.discrepancy import Discrepancy
    >>> found = Discrepancy(zeroed=True)
    >>> found.look(0.1, free=40.0)
    >>> found.noise(1.0, 300.0), round(found.posterior, 3)  # of readings with a root mean square of 300
    (30.01666203960727, 0.106)
    """

    def __init__(self, *, zeroed: bool = False) -> None:
        self.zeroed = zeroed
        self._square = self._free = 0.0
        self._looks = 0

    @property
    def share(self) -> float:
        """Root mean square of the shares that were seen."""
        return math.sqrt(self._square)

    @property
    def least(self) -> float:
        """The share that is left at least; 0 where nothing tells it from noise."""
        return LEAST if self.zeroed else 0.0

    @property
    def posterior(self) -> float:
        """The share with what is known before a frame says more; 0 where nothing tells noise from what the model leaves."""
        if not self.zeroed or not self._looks:
            return 0.0
        return posterior(self.share, self._free, _POLICY)

    def look(self, share: float, *, free: float) -> None:
        """A frame of which contact leaves this share, with so many degrees of freedom left to noise."""
        self._looks = min(self._looks + 1, LOOKS)
        self._square += (min(share, LARGEST) ** 2 - self._square) / self._looks
        self._free += (max(free, 0.0) - self._free) / self._looks

    def raised(self, share: float) -> None:
        """The share is at least this: a frame shows it."""
        self._square = max(self._square, min(share, LARGEST) ** 2)

    def noise(self, noise: float, size: float) -> float:
        """Noise and discrepancy together, of readings with the root mean square ``size``."""
        return math.hypot(noise, max(self.share, self.least) * size)


def share_of(left: float, noise: float, size: float, *, used: float, free: float) -> float:
    """The share of readings with the root mean square ``size`` of which a contact leaves ``left`` (root mean square) over ``used`` readings."""
    free = max(free, 1.0)
    beyond = left**2 * used / free - noise**2 * (1.0 + BEYOND * math.sqrt(2.0 / free))
    return math.sqrt(max(beyond, 0.0)) / size if size > 0 else 0.0


def widened(stated: Stated | None, traction: Floats, grid: Grid, share: float) -> Stated:
    """``stated`` with an error of this ``share`` (standard deviation): of the load in every force, of the contact's radius (root mean square) in its
    centre, of itself in what else is read off the ``traction`` (component, *surface).
    """
    size = np.sqrt((traction**2).sum(axis=0))
    size = size * (grid.areas / grid.cell)
    load, axes = float(size.sum()), list(enumerate(grid.axes))
    others = [tuple(i for i, _ in axes if i != j) for j, _ in axes]
    place = [float(x @ size.sum(axis=o)) / load for (_, x), o in zip(axes, others)]
    far = [float((x - at) ** 2 @ size.sum(axis=o)) / load for (_, x), o, at in zip(axes, others, place)]
    arm = math.sqrt(sum(f + at**2 for f, at in zip(far, place)))
    more = {
        "traction": share * np.abs(traction),
        "force": np.full(len(traction), share * load * grid.cell),
        "moment": np.full(1 if len(axes) == 1 else 3, share * load * grid.cell * arm),
        "center": share * np.sqrt(far[::-1]),  # x, then y
        "peak": np.asarray(share * float(np.abs(traction[-1]).max())),
    }
    return Stated.added(stated, more)


def without_numbers(touch: Touch, estimator: ConstrainedEstimator, readings: Floats) -> Touch:
    """A touch whose ``readings`` (in units of their deviations, NaN where none came) nothing explains, as a frame by itself tells it: no number, and a
    bound, as wide as the interval that the numbers had at least. The stream goes on with them.
    """
    parts = touch._errors
    if parts is None:
        bound, errors = None, None
    else:
        hides, known = (
            hidden(estimator, np.nan_to_num(readings) * estimator.readings.std),
            touch.interval(0.95, "force"),
        )
        low, high = (np.asarray(to_numpy(end), dtype=np.float64) for end in known)
        bound = np.stack([np.fmin(hides[:, 0], low), np.fmax(hides[:, 1], high)], axis=-1)
        errors = replace(parts, posterior=nothing_known(parts.posterior), pad=None)
    return replace(
        touch,
        values=math.nan * touch.values,
        _errors=errors,
        force_bounds=bound,
        drag=None,
        drag_std=None,
        sticking=None,
        strain=None,
    )
