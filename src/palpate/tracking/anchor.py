"""Correct the tracker's traction by the last single solve of the same contact.

In: the tracker's own traction of a frame, and the single solve of an earlier frame y0. Out: the traction of the
result,

    t(y) = P(t_own(y) + s w a (t_single(y0) - t_own(y0))),    a = min(L / L0, 1),    w = <p_own(y), p_own(y0)> / (|p_own(y)| |p_own(y0)|)

with loads L and the projection P on the friction cone. The tracker uses one even penalty, because more does not fit
into the time of a frame. Its error depends on the contact, grows with the load, and stays while the contact stays. A
single solve also tries discs, local weights and discrepancies, and does not have this error. Its net force is
uncertain by its discrepancy e, so that only the fraction s = d^2 / (d^2 + e^2) of a force difference d is applied. The
correction fades as the pressure moves elsewhere (w falls from 1 to 0). The interval still includes the tracker's own
result (`single.Comparison.reaching`), because the single solve is worse if the readings have drifted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.contact.policy import Policy
from palpate.touch import Touch
from palpate.tracking.frames import Frame

__all__ = ["Anchor", "beyond", "certain"]

#: Largest load, relative to the load of the single solve, to which the difference is scaled: beyond it, noise in the
#: difference would grow.
FARTHEST = 1.0
#: Pressure is noise below this many times the noise over the largest reading, and at most below this fraction of the
#: peak: twice the numbers of the default method, because one even penalty keeps more noise. On clean streams
#: (benchmarks/streams.py) the median error of the force was 11 % without it, 9 % with half of it, and 6 % with it.
FAINT_NOISE, FAINTEST = 2.0 * Policy().extent.trim, 2.0 * Policy().extent.faint


def beyond(difference: Floats, std: float) -> float:
    """Fraction d^2 / (d^2 + e^2) of a difference d (component,) that its standard deviation e does not explain.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.tracking.anchor import beyond
    >>> [round(beyond(np.array(d), 1.0), 3) for d in ([0.5, 1.0], [0.0, 2.0], [6.0, 8.0])]
    [0.556, 0.8, 0.99]
    """
    square = float(difference @ difference)
    return square / (square + std**2) if square > 0 else 0.0


def certain(own: Floats, frame: Frame | None, noise: float | None) -> Floats:
    """The tracker's traction (component, cell) without pressure as faint as noise, if the frame has many readings.

    Pressure is never negative, so that noise presses many cells faintly; their sum was a tenth of the force. With few
    readings, errors of the pad's model are larger than noise, and real sensors had a larger error without these cells.
    Where channels cannot tell pressure from shear, the tracker keeps them too: cells of no pressure drag.
    """
    if frame is None or noise is None or len(frame.actual) <= Policy().detection.few_readings:
        return own
    largest = max(float(np.nanmax(np.abs(frame.actual), initial=0.0)), 1e-300)
    faint = min(FAINT_NOISE * noise / largest, FAINTEST)
    return np.asarray(own * (own[-1] > faint * own[-1].max(initial=0.0)))


class Anchor:
    """Keeps the last single solve of this contact and corrects the tracker's traction of later frames (`carried`).

    Tractions are (component, cell of the surface) [Pa]; ``columns`` are the indices of the components that are sought.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.inverse.constrained.cone import Cone
    >>> from palpate.tracking.anchor import Anchor
    >>> anchor = Anchor(Cone(("z",)), (0,))
    >>> anchor.take(np.array([[1.0, 2.0, 0.0]]), np.array([[0.5, 1.0, 0.0]]))
    >>> anchor.carried(np.array([[0.5, 1.0, 0.0]])).tolist()  # half the load
    [[0.25, 0.5, 0.0]]
    >>> anchor.carried(np.array([[0.0, 0.0, 3.0]])).tolist()  # another contact
    [[0.0, 0.0, 3.0]]
    """

    def __init__(self, cone: Cone, columns: Sequence[int]) -> None:
        self._cone, self._columns = cone, list(columns)
        self.clear()

    def clear(self) -> None:
        """Forget the single solve: the contact has ended."""
        self._own: Floats | None = None
        self._difference: Floats | None = None

    def hold(self, own: Floats, single: Touch | None, part: float) -> None:
        """Keep a single solve if its contact pushes; otherwise forget the last one.

        ``part`` is the fraction of the difference to apply.
        """
        if single is None or not (single.pushing is None or bool(single.pushing)):
            self.clear()
            return
        values = to_numpy(single.values).astype(np.float64)
        self.take(own, values.reshape(len(values), -1), part)

    def take(self, own: Floats, single: Floats, part: float = 1.0) -> None:
        """Store the tracker's and the single solve's traction of a frame; apply ``part`` of their difference."""
        if own.shape == single.shape and own[-1].sum() > 0 and np.isfinite(single).all():
            self._own, self._difference = own.copy(), part * (single - own)

    def _likeness(self, own: Floats) -> float:
        """Cosine w between the pressures of this frame and of the single solve's frame; 0 without a single solve."""
        if self._own is None:
            return 0.0
        there, here = self._own[-1], own[-1]
        size = math.sqrt(float(there @ there) * float(here @ here))
        return max(float(there @ here) / size, 0.0) if size > 0 else 0.0

    def carried(self, own: Floats) -> Floats:
        """The corrected traction for the tracker's ``own`` traction."""
        if self._own is None or self._difference is None:
            return own
        part = self._likeness(own) * min(float(own[-1].sum()) / float(self._own[-1].sum()), FARTHEST)
        out = own.copy()
        moved = own + part * self._difference
        out[self._columns] = self._cone.nearest(moved[self._columns])
        return out
