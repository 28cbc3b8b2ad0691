"""Error bars of a linear estimate, at any size.

With K = W H^T (M + lambda)^{-1}, the estimate K y has the error (K H - 1) t + K n. Its covariance is alpha D_1 +
sigma^2 D_2 for traction of covariance alpha W and noise of variance sigma^2. A sum w^T t of the traction needs one
solution u = (M + lambda)^{-1} H W w; its variance is exactly

    alpha (w^T W w - u^T H W w - lambda u^T u) + sigma^2 u^T u.

Force and moment are tabulated over lambda, for all frames. Maps are sampled: draw traction and noise, simulate
readings, solve, compare (G. Papandreou, A. Yuille, NIPS 2010), with the same draws for every parameter, averaged over
mirror images if the layout is symmetric.
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

#: Number of draws for a map: standard deviations are then accurate to 1/sqrt(2 DRAWS), 13 %; with mirror images (four
#: in area contact) to 6 %.
DRAWS = 32
#: Draws per batch, tolerance of their solutions, and largest number of steps. For scattered beads the tolerance makes
#: deviations 2 % too large; five times the tolerance, 6 %.
TOGETHER, LOOSE, MOST = 4, 1e-4, 200
#: Maps per decade of the parameter; a frame uses the nearest, within 10 % of its own.
MAPS_PER_DECADE = 12
#: Maps that are cached.
CACHE_SIZE = 16
#: Parameters per decade in the tables of sums.
SUMS_PER_DECADE = 4
#: Up to this many parameters are computed one by one, so that a single frame is exact; the table used for more is
#: accurate to 1e-4.
MAX_EXACT_PARAMETERS = 4
#: Tolerance and largest number of steps for sums, whose variance is a small difference of large numbers.
TIGHT, LONG = 1e-6, 400


class Solving(Protocol):
    """Interface of a linear model that is solved by products; `palpate.inverse.linear.matrix_free.system.System`
    implements it.
    """

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
    """The part of a system's error bars that does not depend on the frame, computed at first use."""

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
        """True for every component: on a free surface the readings determine the mean."""
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
        """Random errors (draw, component sought, *surface) of estimates, for traction of covariance ``size`` W and
        noise of variance ``noise``.
        """
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
        """Average over mirror images, if the layout is symmetric."""
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
        """w^T D_1 w and w^T D_2 w (frame, row) for ``rows`` w (row, component sought, *surface); ``name`` identifies
        the rows in the cache.
        """
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
        """Compute the two sums for a few parameters one by one, with a cache."""
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
        """log(w^T W w - u^T b), log(u^T u) and their slopes in log lambda: (4, row)."""
        parameter = np.full(len(rows), lam)
        found = self.system.space.sums(rows, parameter, tolerance=TIGHT, most=LONG, slopes=True)
        if found.cross is None:
            raise RuntimeError("slopes were asked for")
        size = np.maximum(found.size, 1e-300)
        left = np.maximum(found.left, lam * size)
        return np.stack([np.log(left), lam * size / left, np.log(size), -2.0 * lam * found.cross / size])

    def own(self, rows: Floats, parameter: Floats) -> tuple[Floats, Floats]:
        """w^T D_1 w and w^T D_2 w (row,) for rows that each have their own parameter."""
        found = self.system.space.sums(rows, parameter, tolerance=TIGHT, most=LONG, slopes=False)
        return np.maximum(found.left - parameter * found.size, 0.0), found.size
