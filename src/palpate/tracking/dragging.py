"""Ratio of tangential to normal force, and the part of the contact that sticks, from the readings of a stream.

The penalty shrinks shear, and friction cuts off noise on one side: with 3 % noise, 0.7 of the force of a slip at a
friction of 0.25 remained. The residual corrects this: r = y - A t is fitted with shear proportional to pressure, which
is its distribution at slip, and with offsets of the channels,

    c = argmin |r - A_q p c - B o|^2,    Q/P = (Q(t) + c P)/P.

The distribution of shear is compared in the readings too: y - A_z p is fitted with mu (p(x) - s p(x/s)) for several
sizes s of the sticking part.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import dilated
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.drag import STICK, sheared
from palpate.tracking.health import Flags, Index
from palpate.tracking.iteration import Iteration
from palpate.tracking.offsets import MODEL, Offsets
from palpate.tracking.region import SMALLEST, NormalEquations, Region

__all__ = ["Drag", "Dragging"]

#: Templates are rebuilt after this many frames.
AGAIN = 8
#: Smallest number of cells that have a shape; cells are dropped if the contact has become LARGER times smaller.
FEWEST, LARGER = 3, 4
#: Templates use the estimated pressure: relative error of the shear they predict, and the number of patterns over which
#: it spreads.
TEMPLATE, PATTERNS = 0.05, 4.0
#: The same for channels that cannot separate pressure from shear, where errors of the pressure look like shear. With
#: the smaller error, five of ten sticking balls were reported to slip; with this one none of twenty, and one of ten
#: that slide (a given friction helps more).
AMBIGUOUS = 0.2


class Drag(NamedTuple):
    """Q/P (tangential component,), the standard deviation of its size, and the log likelihood of each size of the
    sticking part in `STICK`.
    """

    ratio: Floats
    std: float
    sticking: Floats


class _Kept(NamedTuple):
    """For the cells of the contact: A'A (unknown, unknown) and B'A (channel, unknown) of the readings in use."""

    cells: Index
    unused: Flags
    gram: Floats
    shared: Floats


class _Templates(NamedTuple):
    """Templates of shear over friction (template, cell) for a pressure with sum 1, and the inverses of their normal
    equations without offsets (template, tangential, tangential). ``firm`` (channel, channel) and ``cross`` (template,
    channel, tangential) remove the offsets.
    """

    shear: Floats
    inverse: Floats
    cross: Floats
    firm: Floats

    def fitted(self, left: Floats, sums: Floats, which: slice) -> tuple[Floats, Floats]:
        """Size of each template (template, tangential) from A'r = ``left`` and B'r = ``sums``; decrease of |r|^2."""
        right = self.shear[which] @ left[:-1].T - (self.firm @ sums) @ self.cross[which]
        size = np.einsum("sij,sj->si", self.inverse[which], right)
        return size, np.asarray((size * right).sum(axis=1))


class Dragging:
    """Ratio of tangential to normal force of the present contact."""

    def __init__(self, estimator: ConstrainedEstimator, equations: NormalEquations) -> None:
        self._estimator, self._equations = estimator, equations
        names = estimator.problem.components
        self._possible = tuple(names) == tuple(estimator.operator.surface.components) and not estimator.cone.free
        self.clear()

    def clear(self) -> None:
        """Forget the contact."""
        self._kept: _Kept | None = None
        self._templates: _Templates | None = None
        self._age = 0

    def found(
        self,
        solution: Iteration,
        slope: Floats,
        sums: Floats,
        unused: Flags,
        offsets: Offsets,
        noise: float,
        largest: float,
    ) -> Drag | None:
        """The ratio from A'y (component, cell) and B'y of readings minus their offsets; None if shear is not sought."""
        region, contact = solution.region, solution.contact
        if not self._possible or region is None or contact is None or not noise > 0:
            return None
        strong, traction = contact
        if len(strong) < FEWEST:
            return None
        kept = self._known(strong, region, unused)
        t = np.zeros((len(traction), len(kept.cells)))
        t[:, np.searchsorted(kept.cells, strong)] = traction
        self._age += 1
        if self._templates is None or self._age > AGAIN:
            counts = offsets.counts(unused) + (noise / max(MODEL * largest, noise)) ** 2 * np.eye(len(sums))
            self._templates, self._age = self._made(kept, t[-1] / t[-1].sum(), counts), 0
        templates = self._templates
        here = slope[:, kept.cells].astype(np.float64)

        def left(traction: Floats) -> tuple[Floats, Floats]:
            return here - (kept.gram @ traction.ravel()).reshape(here.shape), sums - kept.shared @ traction.ravel()

        total = float(t[-1].sum())
        more = templates.fitted(*left(t), slice(0, 1))[0][0]
        ratio = (t[:-1].sum(axis=1) + more) / total
        size = float(np.linalg.norm(ratio))
        along = ratio / size if size > 0 else np.eye(len(ratio))[0]
        std = noise * math.sqrt(float(along @ templates.inverse[0] @ along)) / total
        pressed = np.zeros_like(t)
        pressed[-1] = t[-1]
        gain = templates.fitted(*left(pressed), slice(None))[1] / noise**2
        template = TEMPLATE
        if self._estimator.ambiguous:
            template = AMBIGUOUS
            std = math.hypot(std, size * self._estimator.posterior.ambiguity[1])
        doubt = 1.0 + template**2 * float(gain.max()) / PATTERNS
        return Drag(ratio, std, 0.5 * (gain - gain.max()) / doubt)

    def _made(self, kept: _Kept, pressure: Floats, counts: Floats) -> _Templates:
        """Templates of the shear for a pressure with sum 1, with the normal equations ``counts`` of the offsets."""
        grid = self._estimator.operator.surface
        places = np.unravel_index(kept.cells, grid.shape)
        places = tuple(p - p.min() for p in places)
        box = np.zeros([int(p.max()) + 1 for p in places])
        box[places] = pressure
        shear = sheared(box, STICK).reshape(len(STICK), -1)[:, np.ravel_multi_index(places, box.shape)]
        n, c = len(kept.cells), grid.dimensions
        pull = (shear @ kept.gram[: c * n, : c * n].reshape(c, n, c * n)).reshape(
            c, len(STICK), c, n
        )  # (i, template, j, cell)
        own = np.einsum("isjn,sn->sij", pull, shear)
        cross = np.moveaxis(kept.shared.reshape(len(counts), -1, n)[:, :c] @ shear.T, -1, 0)
        firm = np.linalg.inv(counts)
        normal = own - np.swapaxes(cross, 1, 2) @ firm @ cross
        normal = normal + SMALLEST * np.trace(own, axis1=1, axis2=2)[:, None, None] * np.eye(c)
        return _Templates(shear, np.linalg.inv(normal), cross, firm)

    def _known(self, strong: Index, region: Region, unused: Flags) -> _Kept:
        """Products for the cells of the contact and some around them, cached; only cells of the region are available."""
        kept = self._kept
        if (
            kept is not None
            and np.array_equal(kept.unused, unused)
            and np.isin(strong, kept.cells).all()
            and LARGER * len(strong) > len(kept.cells)
        ):
            return kept
        grid, equations = self._estimator.operator.surface, self._equations
        flags = np.zeros(math.prod(grid.shape), dtype=bool)
        flags[strong] = True
        cells = np.intersect1d(np.flatnonzero(dilated(flags.reshape(grid.shape), 1)), region.cells, assume_unique=True)
        shared = equations.shared(unused)[:, :, cells]
        self._kept = _Kept(cells, unused.copy(), equations.gram(cells, unused), shared.reshape(len(shared), -1))
        self._templates = None
        return self._kept
