"""Model error of the pad as a fraction of the readings, learned over a recording.

    readings = A t + noise + discrepancy,    discrepancy ~ N(0, share^2 * mean square of the readings)

The share of a frame is the residual of the contact beyond the noise, per degree of freedom that the contact did not
use. It counts as noise while the contact is solved, and widens every interval as an error common to all readings.
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
from palpate.status import Status
from palpate.touch import Touch
from palpate.touch.fields import ErrorParts

__all__ = ["LARGEST", "Discrepancy", "bounds_of", "share_of", "widened", "without_numbers"]

_POLICY = Fit()
#: Smallest and largest share, if a zero gives the noise. Beyond the largest, the model does not fit the readings.
LEAST, LARGEST = _POLICY.shares[0], _POLICY.shares[-1]
#: Number of frames averaged, and standard deviations by which a residual must exceed the noise to count.
LOOKS, BEYOND = 32, 3.0


class Discrepancy:
    """Discrepancy of the model as a fraction of the readings. ``zeroed``: whether frames at rest give the noise.

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
        """Root mean square of the shares of past frames."""
        return math.sqrt(self._square)

    @property
    def least(self) -> float:
        """Smallest share to assume; 0 if the noise is unknown, because it cannot be separated from the discrepancy."""
        return LEAST if self.zeroed else 0.0

    @property
    def posterior(self) -> float:
        """The share combined with its prior; 0 if the noise is unknown."""
        if not self.zeroed or not self._looks:
            return 0.0
        return posterior(self.share, self._free, _POLICY)

    def look(self, share: float, *, free: float) -> None:
        """Add the share of one frame, which has ``free`` degrees of freedom in its residual."""
        self._looks = min(self._looks + 1, LOOKS)
        self._square += (min(share, LARGEST) ** 2 - self._square) / self._looks
        self._free += (max(free, 0.0) - self._free) / self._looks

    def raised(self, share: float) -> None:
        """Raise the share to at least this value, because a frame requires it."""
        self._square = max(self._square, min(share, LARGEST) ** 2)

    def noise(self, noise: float, size: float) -> float:
        """Noise and discrepancy combined, for readings of root mean square ``size``."""
        return math.hypot(noise, max(self.share, self.least) * size)


def share_of(left: float, noise: float, size: float, *, used: float, free: float) -> float:
    """Share of a frame: ``size`` is the root mean square of the readings, ``left`` that of the residual over ``used``
    readings with ``free`` degrees of freedom.
    """
    free = max(free, 1.0)
    beyond = left**2 * used / free - noise**2 * (1.0 + BEYOND * math.sqrt(2.0 / free))
    return math.sqrt(max(beyond, 0.0)) / size if size > 0 else 0.0


def widened(stated: Stated | None, traction: Floats, grid: Grid, share: float) -> Stated:
    """``stated`` plus an error of this ``share`` (standard deviation): as a fraction of the load in every force; of
    the contact's radius (root mean square) in its centre; of itself in every other number from the ``traction``
    (component, *surface).
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


def bounds_of(status: Status, estimator: ConstrainedEstimator, y: Floats | None, *, pushing: bool) -> Floats | None:
    """Bounds of the net force (component, 2) besides its interval; None: the interval is enough.

    ``y`` (reading,) are the readings of a frame without contact if the noise is not known: contact may explain them all.
    """
    if status is Status.OVERLOAD and not pushing:
        return np.tile([-math.inf, math.inf], (len(estimator.surface.components), 1))
    return hidden(estimator, y * estimator.readings.std) if status is Status.UNDECIDED and y is not None else None


def without_numbers(touch: Touch, estimator: ConstrainedEstimator, readings: Floats) -> Touch:
    """A touch whose readings no explanation fits, with the same result as for a single frame: values NaN, and bounds
    at least as wide as the interval before. ``readings`` are in units of their standard deviations, NaN if missing.
    The stream continues with the numbers found.
    """
    parts = touch._errors
    bound = hidden(estimator, np.nan_to_num(readings) * estimator.readings.std)
    if parts is not None:
        low, high = (np.asarray(to_numpy(end), dtype=np.float64) for end in touch.interval(0.95, "force"))
        bound = np.stack([np.fmin(bound[:, 0], low), np.fmax(bound[:, 1], high)], axis=-1)
    posterior = nothing_known(estimator.undetected(1.0) if parts is None else parts.posterior)
    errors = ErrorParts(posterior, scale=estimator.problem.common_std if parts is None else parts.scale)
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
