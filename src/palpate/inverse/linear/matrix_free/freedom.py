"""Effective degrees of freedom at any size: tr M (M + lambda)^{-1}, by a few random rows.

M. F. Hutchinson, Commun. Stat. Simul. Comput. 19, 1990, 433-450: for rows z of independent signs, E z^T (M +
lambda)^{-1} z is the trace. The closed-form approximation is a control variate: its estimate on the same rows is
replaced by its exact trace, so that only the difference is random. The log determinant is the integral of the trace: d
log det(1 + M/lambda) = -tr M (M + lambda)^{-1} d log lambda.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.linear.lumps import lumps
from palpate.inverse.linear.matrix_free.interpolation import between
from palpate.inverse.linear.matrix_free.normal import Normal
from palpate.inverse.linear.matrix_free.spaces import Space

__all__ = ["Freedom"]

#: Rows are added until the degrees of freedom have the relative error KNOWN, at least ROWS and at most MOST_ROWS; small
#: systems use more, up to READINGS numbers in total.
KNOWN, ROWS, MOST_ROWS, READINGS = 5e-3, 2, 32, 100_000
#: Parameters per decade at which it is computed; other values are interpolated.
PER_DECADE = 4
#: Tolerance and largest number of steps of the solutions; a quadratic form is accurate to the square of the residual.
TOLERANCE, MOST = 3e-3, 400
#: Ratio of parameters for a finite-difference slope.
SLOPE = 1.05
#: Smallest fraction of the readings assigned to the model and to the residual.
MIN_FRACTION = 1e-12
#: Largest fraction of the readings that an approximation with more waves than readings may use as degrees of freedom.
MAX_USED_FRACTION = 0.999


class Freedom:
    """Degrees of freedom and log determinant of a system, for any parameter, with a cache."""

    def __init__(self, normal: Normal, space: Space) -> None:
        self.normal, self.space = normal, space
        #: Grouped eigenvalues of the approximation, and the weights that assign coefficients to groups.
        self.nodes, self.weights = lumps(space.eigenvalues)
        self.counts = self.weights @ space.counts
        #: Largest eigenvalue of M, from the longest waves.
        self.top = float(space.largest)
        self._rows: list[Floats] = []
        self._powers: list[Floats] = []
        self._found: dict[int, tuple[float, float]] = {}

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
        rows = sum(r.nbytes + p.nbytes for r, p in zip(self._rows, self._powers))
        return int(rows + self.weights.data.nbytes + self.weights.indices.nbytes)

    def table(self) -> Floats:
        """The values computed so far, one row (place, value, slope) each."""
        return np.array([[float(place), *known] for place, known in sorted(self._found.items())]).reshape(-1, 3)

    def take(self, known: tuple[Floats, ...] | None) -> None:
        """Load a `table` from an earlier run."""
        if known is not None and len(known) == 1 and known[0].ndim == 2 and known[0].shape[1] == 3:
            self._found.update({int(row[0]): (float(row[1]), float(row[2])) for row in known[0]})

    def approximate(self, parameter: Floats) -> Floats:
        """Degrees of freedom of the approximation."""
        used = (self.nodes / (self.nodes + parameter[..., None])) @ self.counts
        return used if self.space.of_readings else np.minimum(used, MAX_USED_FRACTION * self.normal.count)

    def of(self, parameter: Floats) -> Floats:
        """Degrees of freedom at parameters (frame,)."""
        for place in np.unique(
            np.concatenate([np.floor(self._place(parameter)), np.floor(self._place(parameter)) + 1])
        ):
            self._at(int(place))
        return self.curve(parameter)

    def curve(self, parameter: Floats) -> Floats:
        """The same, interpolated between computed values: exact near the parameters of earlier calls of `of`."""
        n = float(self.normal.count)
        part = np.clip(self.approximate(parameter) / n, MIN_FRACTION, 1.0 - MIN_FRACTION)
        if not self._found:
            return n * part
        places = np.array(sorted(self._found))
        known = np.array([self._found[p] for p in places])
        shift = between(self._place(parameter), places, known[:, 0], known[:, 1])
        odds = part / (1.0 - part) * np.exp(shift)
        return np.asarray(n * odds / (1.0 + odds))

    def _place(self, parameter: Floats) -> Floats:
        return PER_DECADE * np.log10(self.top / parameter)

    def _at(self, place: int) -> None:
        """Compute, at a place, the difference of the log odds to the approximation, and its slope."""
        if place in self._found:
            return
        n, lam = float(self.normal.count), self.top * 10.0 ** (-place / PER_DECADE)
        ratio = lam / (self.nodes + lam)
        found: Floats = np.zeros((0, 2))
        # Components of readings outside the eigenspace are unchanged.
        rest = n - float(self.counts.sum())
        expected = np.array([ratio @ self.counts + rest, ratio**2 @ self.counts + rest])
        step = max(ROWS, min(MOST_ROWS // 2, READINGS // self.normal.count))
        while len(found) < MOST_ROWS:
            rows, powers = self._probes(len(found), len(found) + step)
            parameter = np.full(len(rows), lam)
            solved = self.space.solve(rows, parameter, tolerance=TOLERANCE, most=MOST, start=None, checked=False)
            # lambda tr (M + lambda)^-1 and lambda^2 tr (M + lambda)^-2.
            form, square_form = self.space.forms(rows, parameter, solved)
            sums = np.stack([lam * form, lam**2 * square_form], axis=1)
            guessed = np.stack([powers @ ratio, powers @ ratio**2], axis=1)
            found = np.concatenate([found, sums - guessed + expected if self.space.of_readings else sums])
            error = float(np.std(found[:, 0], ddof=1)) / math.sqrt(len(found))
            if error < KNOWN * (n - found[:, 0].mean()):
                break
        free, square = found.mean(axis=0)
        free = min(max(float(free), MIN_FRACTION * n), (1 - MIN_FRACTION) * n)
        if not self.space.of_readings:
            expected = np.array([n - float(self.approximate(np.array([lam]))[0]), math.nan])
        first, second = _odds(n, free, float(square)), _odds(n, float(expected[0]), float(expected[1]))
        if not self.space.of_readings:  # the slope of the approximation as it is, cut off or not
            near = lam * np.array([SLOPE, 1.0 / SLOPE])
            used = self.approximate(near) / n
            odds = np.log(used / (1.0 - used))
            second = (second[0], float(odds[1] - odds[0]) / (2.0 * math.log(SLOPE)) * math.log(10.0) / PER_DECADE)
        self._found[place] = (first[0] - second[0], first[1] - second[1])

    def _probes(self, start: int, stop: int) -> tuple[Floats, Floats]:
        while len(self._rows) < stop:
            rng = np.random.default_rng(len(self._rows))
            row = np.where(rng.random((1, self.normal.total)) < 0.5, -1.0, 1.0)
            if self.normal.valid is not None:
                row *= self.normal.valid
            self._rows.append(row[0])
            self._powers.append(self.weights @ self.space.powers(row)[0])
        return np.stack(self._rows[start:stop]), np.stack(self._powers[start:stop])


def _odds(n: float, free: float, square: float) -> tuple[float, float]:
    """log(used/free) for n readings, and its slope per place (each place decreases lambda by a factor of
    10^(1/PER_DECADE)).
    """
    used = min(max(n - free, MIN_FRACTION * n), (1 - MIN_FRACTION) * n)
    slope = -n * (free - square) / (used * (n - used))  # by log lambda
    return math.log(used / (n - used)), -slope * math.log(10.0) / PER_DECADE
