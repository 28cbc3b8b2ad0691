"""The last single solve of a contact, carried along from frame to frame.

In: the tracker's own traction of a frame, and what a single solve found in the frame that it was asked for. Out: the traction that is answered,

    t(y) = P(t_own(y) + s w a (t_single(y0) - t_own(y0))),    a = min(L / L0, 1),    w = <p_own(y), p_own(y0)> / (|p_own(y)| |p_own(y0)|)

with loads L and P the projection on the friction cone. A single solve knows its net force no better than the share of the readings that the pad's model leaves
unexplained: s = max(0, 1 - K e^2 / d^2) is the part of the difference d between two net forces (K components, e that share of the load) that is
beyond it, the positive-part estimator of James and Stein. One even penalty, which is what a frame can afford, is wrong in a way that depends on the contact:
it grows with the load, and stays while the contact stays. A single solve of y0 has discs, local weights and shares of discrepancy to choose from, and is
not. So the tracker tells what has changed since, and where pressure lies elsewhere (w falls from 1 to 0) it is by itself again. The interval still reaches
the tracker's own answer (`single.Comparison.reaching`): of readings that have drifted the single solve is the worse one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone
from palpate.touch import Touch

__all__ = ["Anchor", "beyond"]

#: A difference is carried to no larger load than so many times that of its frame: noise in it would grow with it.
FARTHEST = 1.0


def beyond(difference: Floats, std: float) -> float:
    """The part of a difference (component,) that is beyond its standard deviation.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.tracking.anchor import beyond
    >>> beyond(np.array([0.5, 1.0]), 1.0), beyond(np.array([0.0, 2.0]), 1.0), beyond(np.array([6.0, 8.0]), 1.0)
    (0.0, 0.5, 0.98)
    """
    square = float(difference @ difference)
    return max(1.0 - len(difference) * std**2 / square, 0.0) if square > 0 else 0.0


class Anchor:
    """What a single solve found of this contact; tractions are (component, cell) of the surface, of which ``columns`` are sought.

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
        """The contact has ended."""
        self._own: Floats | None = None
        self._difference: Floats | None = None

    def hold(self, own: Floats, single: Touch | None, part: float) -> None:
        """Carry a single solve on whose contact pushes; let go of the last one where there is none.

        ``part`` of the difference is carried.
        """
        if single is None or not (single.pushing is None or bool(single.pushing)):
            self.clear()
            return
        values = to_numpy(single.values).astype(np.float64)
        self.take(own, values.reshape(len(values), -1), part)

    def take(self, own: Floats, single: Floats, part: float = 1.0) -> None:
        """What the tracker and a single solve found in one frame, and the ``part`` of their difference that is carried."""
        if own.shape == single.shape and own[-1].sum() > 0 and np.isfinite(single).all():
            self._own, self._difference = own.copy(), part * (single - own)

    def _likeness(self, own: Floats) -> float:
        """The cosine w between the pressure of a frame and that of the single solve's frame; 0 without one."""
        if self._own is None:
            return 0.0
        there, here = self._own[-1], own[-1]
        size = math.sqrt(float(there @ there) * float(here @ here))
        return max(float(there @ here) / size, 0.0) if size > 0 else 0.0

    def carried(self, own: Floats) -> Floats:
        """The traction that is answered, for the tracker's own."""
        if self._own is None or self._difference is None:
            return own
        part = self._likeness(own) * min(float(own[-1].sum()) / float(self._own[-1].sum()), FARTHEST)
        out = own.copy()
        moved = own + part * self._difference
        out[self._columns] = self._cone.nearest(moved[self._columns])
        return out
