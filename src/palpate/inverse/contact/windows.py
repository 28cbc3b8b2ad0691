"""Broken readings of large arrays: screen a window around each suspicious reading as if it were a small array.

A broken taxel deviates from the cubic interpolation of its neighbours along each axis, while these neighbours agree with their own. A
sharp contact can look the same. So `palpate.inverse.contact.screening` judges the window alone, with contact allowed anywhere in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.noise import MEDIAN
from palpate.inverse.contact.policy import Policy, Screening
from palpate.inverse.contact.screening import Screened, screened
from palpate.inverse.linear.priors import DifferencePrior
from palpate.inverse.linear.regularised import Decomposition
from palpate.inverse.linear.whitening import Readings
from palpate.inverse.problem import Problem
from palpate.sensing.arrays import AreaArray, Array, LineArray
from palpate.sensing.nuisance import nuisances
from palpate.sensing.operator import Operator
from palpate.sensing.surface import WIDE, default_surface

__all__ = ["Windows"]

Flags = npt.NDArray[np.bool_]


class Windows:
    """The windows of a problem; their decompositions are cached with it."""

    def __init__(
        self, problem: Problem, columns: tuple[int, ...], variances: Sequence[float], kinds: Sequence[str]
    ) -> None:
        self.problem, self.columns, self.variances, self.kinds = problem, columns, tuple(variances), tuple(kinds)
        first = problem.planes[0]
        #: Windows require planes that share one grid.
        self.serves = all(isinstance(a, AreaArray | LineArray) and a.grid == first.grid for a in problem.planes)  # type: ignore[union-attr]

    def screened(self, readings: Readings, data: Floats, observed: Flags, policy: Policy) -> Screened:
        """Find the broken readings of a frame, and predict values for them (0 for the others).

        ``data`` (reading,) are the readings; ``observed`` (reading,) marks those in use. A window around each
        suspicious taxel is screened; then again with predictions in place of the broken readings, until no more are
        found, at most ``policy.screening.window_rounds`` times.
        """
        broken, explained = np.zeros(len(data), dtype=bool), np.zeros(len(data))
        if not self.serves:
            return Screened(broken, explained)
        filled = data
        for _ in range(policy.screening.window_rounds):
            found = False
            planes = readings.planes(filled)
            working = readings.planes(np.where(observed, 1.0, 0.0))
            told = readings.planes(np.where(observed & ~broken, 1.0, 0.0))
            for place in _suspicious([p / s for p, s in zip(planes, self._scales(readings))], told, policy.screening):
                rows, values = self._window(place, planes, working, policy)
                new = (readings.flat(rows) > 0) & ~broken
                if new.any():
                    found = True
                    broken |= new
                    explained = np.where(new, readings.flat(values), explained)
            if not found:
                break
            filled = np.where(broken, explained, data)
        return Screened(broken, explained)

    def _scales(self, readings: Readings) -> list[Floats]:
        return [np.where(s > 0, s, 1.0) for s in readings.planes(readings.std)]

    def _window(
        self, place: tuple[int, ...], planes: Sequence[Floats], working: Sequence[Floats], policy: Policy
    ) -> tuple[list[Floats], list[Floats]]:
        """1 for each broken reading in the window around a taxel, and the window's predictions, over all planes; 0
        elsewhere.
        """
        shape = planes[0].shape[1:]
        half = policy.screening.window[len(shape) - 1]
        start = [max(0, min(p - half, n - 2 * half - 1)) for p, n in zip(place, shape)]
        stop = [min(n, s + 2 * half + 1) for s, n in zip(start, shape)]
        here = (slice(None), *(slice(a, b) for a, b in zip(start, stop)))
        counts = tuple(b - a for a, b in zip(start, stop))
        linear, shifts = self._prepared(counts)
        own = Readings(linear.operator, linear.scales)
        data = own.flat([p[here] for p in planes])
        there = own.flat([w[here] for w in working]) > 0
        found = screened(linear, own, data, there, shifts, policy)
        inner, margin = np.ones(counts, dtype=bool), policy.screening.window_edge
        for axis, (a, b, n) in enumerate(zip(start, stop, shape)):
            index = np.arange(a, b)
            kept = (index >= (a + margin if a > 0 else 0)) & (index < (b - margin if b < n else n))
            inner &= kept.reshape([-1 if i == axis else 1 for i in range(len(shape))])
        sure = own.planes(np.where(found.broken, 1.0, 0.0))
        rows: list[Floats] = [np.zeros_like(plane) for plane in planes]
        values: list[Floats] = [np.zeros_like(plane) for plane in planes]
        for row, filled, s, value in zip(rows, values, sure, own.planes(found.explained)):
            row[here], filled[here] = s * inner, value
        return rows, values

    def _prepared(self, counts: tuple[int, ...]) -> tuple[Decomposition, Floats]:
        """The linear model of a window with these counts of taxels, and its offsets."""
        return self.problem.kept.get(("window", counts, self.columns, self.variances), lambda: self._made(counts))

    def _made(self, counts: tuple[int, ...]) -> tuple[Decomposition, Floats]:
        from palpate.inverse.linear.regularised import decompose

        planes = [_cut(a, counts) for a in self.problem.planes]
        pad = self.problem.pad
        surface = default_surface(planes, depths=WIDE, thickness=pad.thickness)
        operator = Operator(pad, planes, surface, self.problem.boundary)
        priors = [DifferencePrior(operator.surface, 1, v) for v in self.variances]
        linear = decompose(operator, priors, self.columns)
        terms = nuisances(planes, [k for k in self.kinds if k == "offset"])
        n = sum(math.prod(a.shape) * len(a.channels) for a in planes)
        shifts = np.stack([t.rows for t in terms], axis=1) if terms else np.zeros((n, 0))
        return linear, shifts


def _cut(array: Array, counts: tuple[int, ...]) -> Array:
    """An array with fewer taxels, otherwise the same."""
    if isinstance(array, LineArray):
        return replace(array, count=counts[0], mask=None, limits=None, center=0.0)
    if isinstance(array, AreaArray):
        return replace(array, shape=(counts[0], counts[1]), mask=None, limits=None, center=(0.0, 0.0))
    raise TypeError("only regular arrays have windows")


def _suspicious(planes: Sequence[Floats], working: Sequence[Floats], rules: Screening) -> list[tuple[int, ...]]:
    """Taxels whose readings deviate most from their neighbours', worst first, one for each neighbourhood."""
    import scipy.ndimage

    worst: Floats | None = None
    for plane, works in zip(planes, working):
        for values, there in zip(plane, works > 0):
            total, count = np.zeros(values.shape), np.zeros(values.shape)
            for axis in range(values.ndim):
                told, known = _interpolated(values, there, axis)
                total += np.where(known, told, 0.0)
                count += known
            known = there & (count > 0)
            if known.sum() < 25:
                continue
            off = np.where(known, np.abs(values - total / np.maximum(count, 1.0)), 0.0)
            size = off / max(float(np.median(off[known])) / MEDIAN, 1e-300)
            # Deviations a little farther away: their largest, excluding the effect of this reading on its neighbours.
            ring = np.ones((9,) * values.ndim, dtype=bool)
            ring[(slice(2, 7),) * values.ndim] = False
            around = scipy.ndimage.maximum_filter(size, footprint=ring, mode="constant")
            # The largest is always one: two broken taxels three or four pitches apart hide each other.
            far = size >= np.minimum(rules.suspicious_alone * around, size.max())
            out = np.where((size > rules.suspicious) & far, size, 0.0)
            worst = out if worst is None else np.maximum(worst, out)
    if worst is None or not worst.any():
        return []
    heads = (worst > 0) & (worst == scipy.ndimage.maximum_filter(worst, size=5))
    places = np.argwhere(heads)
    order = np.argsort(-worst[heads], kind="stable")[: rules.windows]
    return [tuple(int(i) for i in places[k]) for k in order]


def _interpolated(values: Floats, there: Flags, axis: int) -> tuple[Floats, Flags]:
    """Cubic interpolation of each reading from two neighbours on each side along an axis, and a mask of where all four
    exist.
    """
    moved, works = np.moveaxis(values, axis, 0), np.moveaxis(there, axis, 0)
    out, known = np.zeros(moved.shape), np.zeros(works.shape, dtype=bool)
    if len(moved) > 4:
        out[2:-2] = (4.0 * (moved[1:-3] + moved[3:-1]) - moved[:-4] - moved[4:]) / 6.0
        known[2:-2] = works[:-4] & works[1:-3] & works[3:-1] & works[4:]
    return np.moveaxis(out, 0, axis), np.moveaxis(known, 0, axis)
