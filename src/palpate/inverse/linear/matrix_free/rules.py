"""Parameter of each frame at any size: the rules of `palpate.inverse.linear.parameter` on approximate curves,
corrected by solutions.

A rule needs three functions of lambda: y^T u (misfit plus penalty), |u|^2 (the residual is lambda u), and the degrees
of freedom. An approximation of M gives them in closed form for all lambda. A solution gives the first two exactly at
one lambda, and the slope of the first. The curves are corrected to pass through the solutions, and the rule picks a
parameter. If that is far from every solution, another solution is computed there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.linear.matrix_free.interpolation import between
from palpate.inverse.linear.matrix_free.iteration import Solved
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.parameter import TINY, SpectrumCurves, Tried, candidates, pick, tikhonov

__all__ = ["Corrected", "Search"]

#: Stop when the chosen parameter is this close to a solution (in log lambda): the curves are exact there to second
#: order, so that its error is a per cent or two.
TOLERANCE_LOG = 0.1
#: Tolerance of the solutions, of the second solution for slopes, and largest number of steps; quadratic forms are
#: accurate to the square of the residual.
TOLERANCE, AGAIN, MOST = 1e-4, 1e-3, 400
#: For evidence, the tolerance is PART of the estimate's present misfit, between LEAST and LOOSEST relative to the
#: readings; ANEW applies to a start other than zero, where the errors of the steps are not orthogonal to the solution.
PART, ANEW, LEAST, LOOSEST = 0.02, 1.2e-3, 1e-5, 3e-3
#: Largest number of solutions for one parameter.
ROUNDS = 8
#: Largest step from a solution (in log lambda; a decade), and the distance below which the degrees of freedom are
#: computed.
STEP, CLOSE = 2.3, 1.2
#: Rules that need the slope of the residual, and so a second solution.
SECOND = ("gcv", "lcurve")


@dataclass
class Corrected:
    """Curves (`palpate.inverse.linear.parameter.Curves`) of some frames, corrected by solutions.

    For each frame, ``places`` are log lambda of its solutions, and ``shifts`` the differences of log e and log r^2 to
    the approximation there, with their slopes.
    """

    guess: SpectrumCurves
    system: System
    places: list[list[float]]
    shifts: list[list[tuple[float, float, float, float]]]

    @classmethod
    def of(cls, system: System, rows: Floats) -> Corrected:
        """Curves before any solution."""
        freedom = system.freedom
        power = (freedom.weights @ freedom.space.powers(rows).T).T
        grid = candidates(np.array([freedom.top]))
        guess = SpectrumCurves(Tried(tikhonov, grid, freedom.nodes, freedom.counts), np.maximum(power, 0.0))
        return cls(guess, system, [[] for _ in rows], [[] for _ in rows])

    def add(
        self, frames: npt.NDArray[np.intp], parameter: Floats, rows: Floats, solved: Solved, again: Solved | None
    ) -> None:
        """Add solutions u (frame, n) for ``rows`` at the ``parameter`` of each, and ``again`` = (M + lambda)^{-1} u,
        if known.
        """
        from scipy.interpolate import CubicSpline

        form, square = self.system.space.forms(rows, parameter, solved)
        e, left = parameter * form, parameter**2 * square
        cube = None if again is None else parameter**3 * self.system.space.forms(solved.rows, parameter, again)[0]
        log = np.log(self.grid)[::-1]
        guess = [np.log(np.maximum(c, TINY))[:, ::-1] for c in (self.guess.explained, self.guess.residual)]
        for i, frame in enumerate(frames):
            if not 0 < left[i] <= e[i] * (1 + 1e-6):
                continue
            at = float(np.log(parameter[i]))
            splines = [CubicSpline(log, g[frame]) for g in guess]
            levels = [float(s(at)) for s in splines]
            slopes = [float(s(at, 1)) for s in splines]
            # e' = e - r^2, (r^2)' = 2 r^2 - 2 lambda^3 u (M + lambda)^-1 u
            first = 1.0 - left[i] / e[i]
            second = slopes[1] if cube is None else 2.0 - 2.0 * cube[i] / left[i]
            self.places[frame].append(at)
            self.shifts[frame].append(
                (
                    float(np.log(e[i])) - levels[0],
                    float(np.log(left[i])) - levels[1],
                    float(first) - slopes[0],
                    float(second) - slopes[1],
                )
            )

    def at(self, parameter: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """explained and residual (frame, parameter), log determinant and free (parameter,) at each ``parameter``."""
        log, at = np.log(self.grid)[::-1], np.log(parameter)
        explained, residual = (
            np.stack([np.exp(np.interp(at, log, np.log(np.maximum(each, TINY))[::-1])) for each in curve])
            for curve in (self.explained, self.residual)
        )
        return explained, residual, np.interp(at, log, self.logdet[::-1]), np.interp(at, log, self.free[::-1])

    def nearest(self, parameter: Floats) -> Floats:
        """Distance (in log lambda) of each parameter from the nearest solution of its frame."""
        return np.array(
            [min((abs(np.log(p) - at) for at in places), default=np.inf) for p, places in zip(parameter, self.places)]
        )

    def among(self, reach: float) -> npt.NDArray[np.bool_]:
        """Mask of candidates (frame, candidate) allowed for generalised cross-validation: at most ``reach`` (in log
        lambda) beyond the outermost solutions, and not beyond one that scores worse than its neighbour.

        A surface has more waves than readings, so that its approximation wrongly predicts a residual and a score of
        zero at small lambda.
        """
        log = np.log(self.grid)
        residual = np.log(np.maximum(self.residual, TINY))
        score = (residual - 2.0 * np.log(np.maximum(self.free, TINY)))[:, ::-1]
        out = np.ones(score.shape, dtype=bool)
        for i, places in enumerate(self.places):
            if not places:
                continue
            low, high = min(places) - reach, max(places) + reach
            if len(places) > 1:
                there = np.sort(places)
                said = np.interp(there, log[::-1], score[i])
                low = there[0] if said[0] > said[1] else low
                high = there[-1] if said[-1] > said[-2] else high
            out[i] = (log >= low) & (log <= high)
        return out

    def within(self, parameter: Floats, reach: float) -> Floats:
        """Limit parameters to at most ``reach`` (in log lambda) from the solutions of their frames."""
        out = np.array(parameter)
        for i, places in enumerate(self.places):
            if places:
                out[i] = np.exp(np.clip(np.log(parameter[i]), min(places) - reach, max(places) + reach))
        return out

    @property
    def grid(self) -> Floats:
        return self.guess.grid

    @property
    def count(self) -> float:
        return float(self.system.normal.count)

    @property
    def inside(self) -> npt.NDArray[np.bool_]:
        return self.guess.inside

    @property
    def explained(self) -> Floats:
        return self._moved(0, self.guess.explained)

    @property
    def residual(self) -> Floats:
        return np.minimum(self._moved(1, self.guess.residual), self.explained)

    @property
    def penalty(self) -> Floats:
        return np.maximum(self.explained - self.residual, 0.0) / self.grid

    @property
    def free(self) -> Floats:
        return self.count - self.system.freedom.curve(self.grid)

    @property
    def logdet(self) -> Floats:
        extra = self.system.freedom.curve(self.grid) - self.system.freedom.approximate(self.grid)
        step = np.log(self.grid[0] / self.grid[1])
        return self.guess.logdet + np.concatenate([[0.0], np.cumsum(0.5 * (extra[1:] + extra[:-1]))]) * step

    def _moved(self, which: int, curve: Floats) -> Floats:
        log = np.log(self.grid)
        out = np.array(curve)
        for frame, (places, shifts) in enumerate(zip(self.places, self.shifts)):
            if places:
                known = np.array(shifts)
                out[frame] *= np.exp(between(log, np.array(places), known[:, which], known[:, 2 + which]))
        return out


class Found(NamedTuple):
    """Parameter (frame,), frames for which the rule had no information or did not converge, the curves, and nearby
    solutions (frame, n).
    """

    parameter: Floats
    without: npt.NDArray[np.bool_]
    unsettled: npt.NDArray[np.bool_]
    curves: Corrected
    solutions: Floats


class Search:
    """Search for the parameter of frames by a rule; see the module. ``floor`` (frame,) as in
    `palpate.inverse.linear.parameter.amplitude`.
    """

    def __init__(self, system: System, rule: str, floor: Floats | None) -> None:
        self.system, self.rule, self.floor = system, rule, floor

    def find(self, rows: Floats, parameter: Floats | None = None, start: Floats | None = None) -> Found:
        """The parameter of each row, starting from a ``parameter`` and solutions near it, if known."""
        curves = Corrected.of(self.system, rows)
        solutions = np.zeros_like(rows) if start is None else np.array(start)
        found = pick(self.rule, curves, self.floor)
        if parameter is None:
            first = self.system.space.first
            parameter = found.parameter if first is None else np.full(len(rows), first)
        else:
            parameter = np.array(parameter)
        open_ = np.flatnonzero((rows**2).sum(axis=1) > 0)
        doubted = self.rule == "gcv" and not self.system.space.of_readings
        for _ in range(ROUNDS):
            if not open_.size:
                break
            solutions[open_] = self.solve(curves, rows, parameter, open_, solutions[open_])
            if doubted:  # compare solutions by computed values, not by the guess
                self.system.freedom.of(parameter[open_])
            for _ in range(2):
                found = pick(self.rule, curves, self.floor, curves.among(STEP) if doubted else None)
                parameter[open_] = curves.within(found.parameter, STEP)[open_]
                close = curves.nearest(parameter)[open_] < CLOSE
                if not close.any():
                    break
                # Compute the degrees of freedom where they decide.
                self.system.freedom.of(parameter[open_][close])
            open_ = open_[curves.nearest(parameter)[open_] > TOLERANCE_LOG]
        unsettled = np.zeros(len(rows), dtype=bool)
        unsettled[open_] = True
        return Found(parameter, found.without, unsettled, curves, solutions)

    def solve(
        self,
        curves: Corrected,
        rows: Floats,
        parameter: Floats,
        some: npt.NDArray[np.intp] | None = None,
        start: Floats | None = None,
    ) -> Floats:
        """Solve ``some`` frames (default: all) at ``parameter`` (frame,), and correct their curves."""
        frames = np.arange(len(rows)) if some is None else some
        there = parameter[frames]
        goal: float | Floats = TOLERANCE
        corrected = self.system.space.of_readings
        if self.rule == "evidence" and corrected:
            log = np.log(curves.grid)[::-1]
            kept = curves.residual[frames][:, ::-1]
            noise = [np.sqrt(np.interp(np.log(lam), log, each)) for lam, each in zip(there, kept)]
            size = np.linalg.norm(rows[frames], axis=1)
            part = PART if start is None or not start.any() else ANEW
            goal = np.clip(part * np.array(noise) / np.where(size > 0, size, 1.0), LEAST, LOOSEST)
        solved = self.system.space.solve(rows[frames], there, tolerance=goal, most=MOST, start=start, checked=False)
        again = None
        if self.rule in SECOND:
            again = self.system.space.solve(
                solved.rows, there, tolerance=AGAIN if corrected else TOLERANCE, most=MOST, checked=False
            )
        curves.add(frames, there, rows[frames], solved, again)
        return solved.rows
