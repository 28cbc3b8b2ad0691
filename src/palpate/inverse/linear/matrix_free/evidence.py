"""Marginal likelihood of one frame at any size, as in `palpate.inverse.linear.evidence`, on a matrix-free system.

The approximation gives misfit and penalty for all parameters at once, and solutions correct it (`rules.Corrected`). A
given noise only scales these curves. The contact methods request the same readings repeatedly while they alternate
between contact and noise, so the last curves are cached.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.linear.evidence import LinearEvidence, evidence_gain, of_unit_size
from palpate.inverse.linear.matrix_free.rules import Corrected
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.parameter import pick

__all__ = ["LinearAtSize"]

#: Stop the search when the best parameter is this close to a solution (in log lambda): the contact method starts there
#: and refines it.
START_TOLERANCE = 0.5
#: Largest step of log lambda from a solution, and largest number of solutions in a search.
STEP, ROUNDS = 3.5, 6
#: Tolerance and largest number of steps of these solutions; quadratic forms are accurate to the square of the
#: tolerance.
TOLERANCE, MOST = 1e-3, 300
#: Readings whose curves are cached.
CACHE_SIZE = 6


class LinearAtSize:
    """The linear model of a matrix-free system, with the interface of
    `palpate.inverse.linear.regularised.Decomposition`.

    The coefficients of readings are the whitened readings themselves.
    """

    def __init__(self, system: System) -> None:
        self.system, self.operator, self.columns = system, system.operator, system.columns
        self.scales, self.noise_known = system.scales, system.noise_known

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        return self.system.nbytes

    def project(self, rows: Sequence[Any]) -> Floats:
        """Whitened readings (n,) of one frame, (channel, *array) per plane."""
        return self.system.normal.rows([np.asarray(r)[None] for r in rows])[0]

    def freedom(self, parameter: float) -> float:
        """Degrees of freedom of the traction that the data determine."""
        return float(self.system.freedom.curve(np.array([parameter]))[0])

    def frame(self) -> FrameAtSize:
        """A `FrameAtSize`, for use while one frame is solved."""
        return FrameAtSize(self)


class _Solved:
    """Curves and solutions of one row of readings."""

    def __init__(self, system: System, row: Floats) -> None:
        self.system, self.row = system, row
        self.curves = Corrected.of(system, row[None])
        self.solutions: list[tuple[float, Floats]] = []
        self._traction: tuple[float, Floats] | None = None

    def solve(self, parameter: float, start: Floats | None) -> None:
        lam = np.array([parameter])
        u = self.system.space.solve(
            self.row[None],
            lam,
            tolerance=TOLERANCE,
            most=MOST,
            start=None if start is None else start[None],
            checked=False,
        )
        self.curves.add(np.array([0]), lam, self.row[None], u, None)
        self.solutions.append((parameter, u.rows[0]))

    def nearest(self, parameter: float) -> tuple[float, Floats] | None:
        return min(self.solutions, key=lambda s: abs(math.log(s[0] / parameter)), default=None)

    def traction(self, parameter: float) -> Floats:
        """Approximate traction of the linear model, a starting point for the search for contact."""
        found = self.nearest(parameter)
        if found is None:
            grid = self.system.operator.surface
            return np.zeros((len(self.system.columns), *grid.shape))
        if self._traction is None or self._traction[0] != found[0]:
            self._traction = found[0], self.system.normal.traction(found[1][None])[0]
        return self._traction[1]


class FrameAtSize:
    """Evidence of one frame's readings while they change during the search for contact."""

    def __init__(self, linear: LinearAtSize) -> None:
        self.linear = linear
        self._kept: OrderedDict[bytes, _Solved] = OrderedDict()

    def _of(self, row: Floats) -> _Solved:
        key = row.tobytes()
        found = self._kept.get(key)
        if found is None:
            found = self._kept[key] = _Solved(self.linear.system, row)
            while len(self._kept) > CACHE_SIZE:
                self._kept.popitem(last=False)
        else:
            self._kept.move_to_end(key)
        return found

    def _start(self, parameter: float) -> Floats | None:
        """A solution for similar readings, as a starting point."""
        near = [s for kept in self._kept.values() if (s := kept.nearest(parameter)) is not None]
        best = min(near, key=lambda s: abs(math.log(s[0] / parameter)), default=None)
        return None if best is None or abs(math.log(best[0] / parameter)) > STEP else best[1]

    def evidence(
        self, rows: Sequence[Floats], parameter: float | None, known: float | None, patterns: Floats | None = None
    ) -> LinearEvidence:
        """See `palpate.inverse.linear.evidence.linear_evidence`; patterns are first subtracted by least squares."""
        return self._found(self.linear.project(rows), parameter, known, patterns)[0]

    def _found(
        self, row: Floats, parameter: float | None, known: float | None, patterns: Floats | None
    ) -> tuple[LinearEvidence, float, float]:
        """The evidence, the misfit in units of the whitening, and the degrees of freedom of the residual."""
        system = self.linear.system
        certain = self.linear.noise_known or known is not None
        unit = known or 1.0
        sizes: Floats = np.zeros(0)
        base, fewer = 0.0, 0
        if patterns is not None and len(patterns):
            norms, patterns = of_unit_size(patterns)
            gram = patterns @ patterns.T
            sizes = np.linalg.lstsq(gram, patterns @ row, rcond=1e-10)[0]
            row, sizes = row - sizes @ patterns, sizes / norms
            base = float(np.linalg.slogdet(gram)[1] + 2.0 * np.log(norms).sum())
            fewer = len(patterns)
        size = float(row @ row)
        if size <= 0.0:
            flat = np.zeros((len(system.columns), *system.operator.surface.shape))
            top = system.freedom.top
            return LinearEvidence(0.0, top, 0.0, flat, base, 0.0, float(system.normal.count - fewer), sizes), 0.0, 1.0
        solved = self._of(row)
        floor: Floats | None = None if certain else np.zeros(1)
        best = parameter or system.freedom.top
        for turn in range(ROUNDS):
            if parameter is None:
                picked = pick("evidence", solved.curves, floor, noise=unit).parameter
                best = float(solved.curves.within(picked, STEP)[0])
                if turn == 0 and not solved.solutions and system.space.first is not None:
                    best = max(best, system.space.first)
            near = solved.nearest(best)
            if near is not None and abs(math.log(near[0] / best)) < START_TOLERANCE:
                break
            solved.solve(best, near[1] if near is not None else self._start(best))
            system.freedom.of(np.array([best]))
        left, residual, logdet, free = (float(np.ravel(each)[0]) for each in solved.curves.at(np.array([best])))
        count = solved.curves.count - fewer
        found = LinearEvidence(
            evidence_gain(size / unit**2, left / unit**2, logdet, count, certain),
            best,
            unit if certain else math.sqrt(left / count),
            solved.traction(best),
            logdet + base,
            left,
            count,
            sizes,
        )
        return found, residual, max(free - fewer, 1.0)

    def noise(
        self, rows: Sequence[Floats], parameter: float | None, known: float
    ) -> tuple[LinearEvidence, float, float]:
        """Evidence for a noise level, the misfit in units of the whitening, and the remaining degrees of freedom."""
        return self._found(self.linear.project(rows), parameter, known, None)
