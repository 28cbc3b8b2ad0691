"""How sure a linear estimate is, at any size.

With K = W H^T (M + lambda)^{-1} the estimate K y errs by (K H - 1) t + K n, whose covariance is alpha D_1 + sigma^2 D_2 for traction of covariance
alpha W and noise of variance sigma^2. A sum w^T t of the traction needs one solution u = (M + lambda)^{-1} H W w:

    alpha (w^T W w - u^T H W w - lambda u^T u) + sigma^2 u^T u,

exactly; force and moment are tables over lambda, for all frames. Maps are sampled: draw traction and noise, read, solve, compare
(G. Papandreou, A. Yuille, NIPS 2010), with the same draws for every parameter, and averaged over mirror images where the layout has them.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.interpolation import between
from palpate.inverse.linear.posterior import Variances
from palpate.inverse.linear.spectrum import mirrored

__all__ = ["SampledVariances"]

#: Draws of a map: standard deviations are then known to 1/sqrt(2 DRAWS), 13 %; with mirror images (four in area contact) to 6 %.
DRAWS = 32
#: Draws solved at a time, and to which residual: over scattered beads it makes deviations 2 % too large, 6 % where it is five times as much.
TOGETHER, LOOSE, MOST = 4, 1e-4, 200
#: Maps are made for so many parameters per decade, and a frame uses the nearest: within 10 % of its own.
MAPS_PER_DECADE = 12
#: Maps that are cached.
CACHE_SIZE = 16
#: Tables of sums hold so many parameters per decade.
SUMS_PER_DECADE = 4
#: Up to this many parameters are computed one by one: a single frame is then exact; the table for more is accurate to 1e-4.
MAX_EXACT_PARAMETERS = 4
#: Sums are solved to this residual: the variance that is left is a difference of large numbers.
TIGHT, LONG = 1e-6, 400


class Solving(Protocol):
    """A linear model that is solved by products; `palpate.inverse.linear.matrix_free.system.System` is one."""

    @property
    def operator(self) -> Any: ...
    @property
    def columns(self) -> tuple[int, ...]: ...
    @property
    def freedom(self) -> Any: ...
    @property
    def normal(self) -> Any: ...
    @property
    def space(self) -> Any: ...
    def solve(self, rows: Any, parameter: Any, *, tolerance: float, most: int, checked: bool) -> Any: ...
    def traction(self, solved: Any) -> Any: ...


class SampledVariances(Variances):
    """Error bars of a system, the part that does not depend on the frame, computed at first use."""

    def __init__(self, system: Solving) -> None:
        self.operator, self.grid, self.columns = system.operator, system.operator.surface, system.columns
        self.system: Any = system
        self._maps: OrderedDict[int, tuple[Floats, Floats]] = OrderedDict()
        self._sums: dict[tuple[str, int], Floats] = {}
        self._few: OrderedDict[tuple[str, float], Floats] = OrderedDict()

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        return sum(a.nbytes + b.nbytes for a, b in self._maps.values())

    @property
    def mean_seen(self) -> npt.NDArray[np.bool_]:
        """A free surface has no mean of its own that leaves no trace."""
        return np.ones(len(self.columns), dtype=bool)

    # -- maps

    def maps(self, parameter: float) -> tuple[Floats, Floats]:
        """Diagonals of D_1 and D_2 (component sought, *surface) near a parameter."""
        place = round(MAPS_PER_DECADE * math.log10(self.system.freedom.top / parameter))
        if place not in self._maps:
            self._maps[place] = self._sampled(self.system.freedom.top * 10.0 ** (-place / MAPS_PER_DECADE))
            while len(self._maps) > CACHE_SIZE:
                self._maps.popitem(last=False)
        self._maps.move_to_end(place)
        return self._maps[place]

    def _sampled(self, lam: float) -> tuple[Floats, Floats]:
        normal = self.system.normal
        first: Floats = np.zeros((len(self.columns), *self.grid.shape))
        second = np.zeros_like(first)
        rng = np.random.default_rng(0)
        for _ in range(0, DRAWS, TOGETHER):
            traction = np.stack([p.sample(rng, TOGETHER) for p in normal.priors], axis=1)
            noise = rng.standard_normal((TOGETHER, normal.total))
            if normal.valid is not None:
                noise *= normal.valid
            rows = np.concatenate([normal.readings(traction), noise])
            parameter = np.full(len(rows), lam)
            solved = self.system.solve(rows, parameter, tolerance=LOOSE, most=MOST, checked=False)
            found = self.system.traction(solved)
            first += ((found[:TOGETHER] - traction) ** 2).sum(axis=0)
            second += (found[TOGETHER:] ** 2).sum(axis=0)
        return self._even(first / DRAWS), self._even(second / DRAWS)

    def errors(self, lam: float, size: float, noise: float, count: int, rng: np.random.Generator) -> Floats:
        """Errors of an estimate (draw, component sought, *surface) on traction of covariance ``size`` W and noise of variance ``noise``."""
        normal, out = self.system.normal, []
        for first in range(0, count, TOGETHER):
            some = min(TOGETHER, count - first)
            traction = math.sqrt(size) * np.stack([p.sample(rng, some) for p in normal.priors], axis=1)
            rows = math.sqrt(noise) * rng.standard_normal((some, normal.total))
            if normal.valid is not None:
                rows *= normal.valid
            rows += normal.readings(traction)
            solved = self.system.solve(rows, np.full(some, lam), tolerance=LOOSE, most=MOST, checked=False)
            out.append(self.system.traction(solved) - traction)
        return np.concatenate(out)

    def _even(self, variance: Floats) -> Floats:
        """The mean over mirror images, if the layout is symmetric."""
        operator = self.system.operator
        if mirrored(operator.pad, operator.planes_of, self.grid):
            for axis in range(1, variance.ndim):
                variance = 0.5 * (variance + np.flip(variance, axis))
        return variance

    @cached_property
    def prior(self) -> Floats:
        """The diagonal of W (component sought, *surface)."""
        return np.stack([p.variance() for p in self.system.normal.priors])

    # -- sums

    def sums(self, name: str, rows: Floats, parameter: Floats) -> tuple[Floats, Floats]:
        """(frame, row) of w^T D_1 w and w^T D_2 w for ``rows`` w (row, component sought, *surface) that go by a name."""
        there = np.any(rows.reshape(len(rows), -1) != 0, axis=1)
        if not there.all():  # such as the moment of pressure if only shear is sought
            out = np.zeros((2, len(parameter), len(rows)))
            if there.any():
                out[:, :, there] = self.sums(name, rows[there], parameter)
            return out[0], out[1]
        if len(np.unique(parameter)) <= MAX_EXACT_PARAMETERS:
            return self._each(name, rows, parameter)
        top = self.system.freedom.top
        at = SUMS_PER_DECADE * np.log10(top / parameter)
        places = np.unique(np.concatenate([np.floor(at), np.floor(at) + 1])).astype(int)
        for place in places:
            if (name, int(place)) not in self._sums:
                self._sums[name, int(place)] = self._table(rows, top * 10.0 ** (-place / SUMS_PER_DECADE))
        known = np.stack([self._sums[name, int(place)] for place in places])  # (place, 4, row)
        log, ends = np.log(parameter), np.log(top * 10.0 ** (-places / SUMS_PER_DECADE))
        left, size = (
            np.stack(
                [np.exp(between(log, ends, known[:, i, row], known[:, i + 1, row])) for row in range(len(rows))], 1
            )
            for i in (0, 2)
        )
        return np.maximum(left - parameter[:, None] * size, 0.0), size

    def _each(self, name: str, rows: Floats, parameter: Floats) -> tuple[Floats, Floats]:
        """The same for a few parameters one by one; the last ones are cached."""
        found = []
        for lam in parameter:
            key = (name, float(lam))
            if key not in self._few:
                self._few[key] = np.stack(self.own(rows, np.full(len(rows), lam)))
                while len(self._few) > CACHE_SIZE:
                    self._few.popitem(last=False)
            found.append(self._few[key])
        each = np.stack(found, axis=1)
        return each[0], each[1]

    def _table(self, rows: Floats, lam: float) -> Floats:
        """log(w^T W w - u^T b), log(u^T u) and their slopes by log lambda: (4, row)."""
        parameter = np.full(len(rows), lam)
        found = self.system.space.sums(rows, parameter, tolerance=TIGHT, most=LONG, slopes=True)
        if found.cross is None:
            raise RuntimeError("slopes were asked for")
        size = np.maximum(found.size, 1e-300)
        left = np.maximum(found.left, lam * size)
        return np.stack([np.log(left), lam * size / left, np.log(size), -2.0 * lam * found.cross / size])

    def own(self, rows: Floats, parameter: Floats) -> tuple[Floats, Floats]:
        """(row,) of w^T D_1 w and w^T D_2 w for rows with a parameter each."""
        found = self.system.space.sums(rows, parameter, tolerance=TIGHT, most=LONG, slopes=False)
        return np.maximum(found.left - parameter * found.size, 0.0), found.size
