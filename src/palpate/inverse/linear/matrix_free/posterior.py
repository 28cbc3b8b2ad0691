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
from collections.abc import Callable

import numpy as np

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.interpolation import between
from palpate.inverse.linear.matrix_free.rules import Search
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.parameter import Filter, mean_sizes
from palpate.inverse.linear.posterior import UNEXPLAINED, Frames, Variances, finest
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


class SampledVariances(Variances):
    """The part of a system's error bars that does not depend on the frame, computed at first use."""

    def __init__(self, system: System) -> None:
        super().__init__(system.operator, system.columns)
        self.system = system
        self._maps: OrderedDict[int, tuple[Floats, Floats]] = OrderedDict()
        self._sums: dict[tuple[str, int], Floats] = {}
        self._few: OrderedDict[tuple[str, float], Floats] = OrderedDict()

    @property
    def nbytes(self) -> int:
        return sum(a.nbytes + b.nbytes for a, b in self._maps.values())

    def sizes(
        self, data: Floats, floor: Floats | None, parameter: Floats, filter_factors: Filter
    ) -> tuple[Floats, Floats]:
        system, each = self.system, []
        for i, row in enumerate(data):
            least = None if floor is None else floor[i : i + 1]
            each.append(mean_sizes(Search(system, "evidence", least).find(row[None]).curves, least))
        size, noise = (np.concatenate(values) for values in zip(*each))
        if floor is not None:
            left = 1.0 - system.freedom.of(parameter) / system.normal.count
            space = system.space
            for blind in np.flatnonzero(left < UNEXPLAINED):
                least = finest(space.eigenvalues, space.counts, space.powers(data[[blind]]))
                noise[blind] = max(noise[blind], float(least[0]))
            nothing = ~data.any(axis=1)
            size, noise = np.where(nothing, np.nan, size), np.where(nothing, np.nan, noise)
        return size, noise

    def response(self, frames: Frames, rows: Floats) -> Floats:
        each = np.repeat(frames.parameter, rows.shape[1])
        space = self.system.space
        solved = space.solve(rows.reshape(len(each), -1), each, tolerance=TIGHT, most=LONG)
        found = space.traction(solved)
        return found.reshape(*rows.shape[:2], *found.shape[1:])

    # -- maps

    def of_cells(self, frames: Frames) -> Floats:
        maps = [self.maps(float(lam)) for lam in frames.parameter]
        return np.stack([a * first + s * second for a, s, (first, second) in zip(*frames[:2], maps)])

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
            found = self._estimates(np.concatenate([normal.readings(traction), noise]), lam)
            first += ((found[:TOGETHER] - traction) ** 2).sum(axis=0)
            second += (found[TOGETHER:] ** 2).sum(axis=0)
        return self._even(first / DRAWS), self._even(second / DRAWS)

    def errors(self, frames: Frames, i: int, count: int, rng: np.random.Generator) -> Floats:
        size, noise, lam = (float(each[i]) for each in frames[:3])
        normal, out = self.system.normal, []
        for first in range(0, count, TOGETHER):
            some = min(TOGETHER, count - first)
            traction = math.sqrt(size) * np.stack([p.sample(rng, some) for p in normal.priors], axis=1)
            rows = math.sqrt(noise) * rng.standard_normal((some, normal.total))
            if normal.valid is not None:
                rows *= normal.valid
            rows += normal.readings(traction)
            out.append(self._estimates(rows, lam) - traction)
        return np.concatenate(out)

    def _estimates(self, rows: Floats, lam: float) -> Floats:
        """Traction of simulated readings (row, n)."""
        space = self.system.space
        solved = space.solve(rows, np.full(len(rows), lam), tolerance=LOOSE, most=MOST, checked=False)
        return space.traction(solved)

    def _even(self, variance: Floats) -> Floats:
        """Average over mirror images, if the layout is symmetric."""
        if mirrored(self.operator.pad, self.operator.planes_of, self.grid):
            for axis in range(1, variance.ndim):
                variance = 0.5 * (variance + np.flip(variance, axis))
        return variance

    @cached_property
    def prior(self) -> Floats:
        return np.stack([p.variance() for p in self.system.normal.priors])

    # -- sums

    def of_sums(self, frames: Frames, name: str, rows: Floats) -> Floats:
        size, noise = (each[:, None] for each in frames[:2])
        first, second = self.sums(name, rows, frames.parameter)
        return size * first + noise * second

    def of_own_sums(self, frames: Frames, rows: Callable[[slice], Floats]) -> Floats:
        parts = []
        for i, (size, noise, lam) in enumerate(zip(*frames[:3])):
            here = rows(slice(i, i + 1))[0]
            first, second = self.own(here, np.full(len(here), lam))
            parts.append(size * first + noise * second)
        return np.stack(parts)

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
