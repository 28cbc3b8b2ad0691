"""Least squares with p >= 0 and nothing else (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.comparison.whole_map import Comparison, Found, Frame, WholeMap
from palpate.inverse.problem import Problem

__all__ = ["NonNegative"]

#: Initial cells are those above TRIED times the first guess's peak; the iteration ends when no other cell's gradient
#: exceeds OPTIMAL times the largest, or after ROUNDS_OF_CELLS rounds.
TRIED, OPTIMAL, ROUNDS_OF_CELLS = 0.02, 1e-10, 60


@dataclass(frozen=True, kw_only=True)
class NonNegative(Comparison):
    """Least squares with p >= 0 and nothing else: no parameter (C. L. Lawson, R. J. Hanson, Solving Least Squares Problems, 1974).

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
    >>> touch = skin.reconstruct(readings, method=pp.comparison.NonNegative())
    >>> round(float(touch.force[1])), float(touch.pressure.min())  # [N/m], [Pa]
    (10, 0.0)
    """

    name: ClassVar[str] = "nnls"
    summary: ClassVar[str] = "for comparison: least squares with p >= 0 alone"

    def prepare(self, problem: Problem) -> _NonNegative:
        """Matrix and linear model of the whole map."""
        self.check(problem)
        return _NonNegative(problem, self.name)


class _NonNegative(WholeMap):
    has_parameter = False

    def frame(self, p: Frame, start: Floats, noise: float) -> Found:
        """Solve one frame; the noise is not used."""
        x, converged = self.minimised(p, 0.0, start)
        return Found(x, converged=converged)

    def minimised(self, p: Frame, parameter: float, start: Floats) -> tuple[Floats, bool]:
        """Least squares with p >= 0: the library's active-set solver on some columns, repeated until no other column
        would lower the misfit.

        The solver requires x >= 0; shear of either sign is the difference of two such unknowns.
        """
        import scipy.optimize

        column = np.concatenate([np.arange(p.linear.size), np.arange(p.linear[:-1].size)])
        sign = np.where(np.arange(len(column)) < p.linear.size, 1.0, -1.0)
        guess = sign * start.ravel()[column]
        if not guess.max() > 0:
            guess = sign * p.linear.ravel()[column]
        tried = np.flatnonzero(guess > TRIED * max(float(guess.max()), 0.0))
        x: Floats = np.zeros(p.linear.size)
        least = OPTIMAL * float(np.abs(p.linear).max())
        for _ in range(ROUNDS_OF_CELLS):
            if not len(tried):  # nothing pushes (and the library's solver does not survive an empty problem)
                return x.reshape(p.shape), True
            c, s = column[tried], sign[tried]
            # as many rows as columns are enough
            whole = np.concatenate([p.matrix[:, c] * s, p.data[:, None]], axis=1)
            triangle = np.asarray(np.linalg.qr(whole, mode="r"))
            try:
                found = scipy.optimize.nnls(triangle[:, :-1], triangle[:, -1], maxiter=30 * len(column))[0]
            except RuntimeError:  # it has run out of steps
                return x.reshape(p.shape), False
            x = np.zeros(p.linear.size)
            np.add.at(x, c, s * found)
            pull = sign * (p.matrix.T @ (p.data - p.matrix @ x))[column]
            pull[tried] = 0.0
            missing = np.flatnonzero(pull > least)
            if not len(missing):
                return x.reshape(p.shape), True
            most = missing[np.argsort(-pull[missing])][: max(200, len(tried) // 2)]
            tried = np.union1d(tried[found > 0], most)
        return x.reshape(p.shape), False
