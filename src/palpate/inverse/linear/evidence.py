"""Marginal likelihood of one frame under a linear Gaussian model: the start of the contact methods.

readings = A t + B c + noise. The sizes c of the patterns B (`palpate.sensing.nuisance`, single broken readings) have a
flat prior and are marginalised, as in restricted maximum likelihood (H. D. Patterson, R. Thompson, Biometrika 58,
1971, 545-554). In the basis of the spectrum, C = 1 + s^2/lambda is diagonal, and B adds a few columns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.linear.parameter import (
    TINY,
    Tried,
    candidates,
    choose_parameter,
    filtered_inverse,
    refined,
    tikhonov,
)
from palpate.inverse.linear.regularised import Decomposition

__all__ = ["LinearEvidence", "Marginal", "evidence_gain", "linear_evidence", "log_evidence", "of_unit_size"]

#: Combinations of patterns below this fraction of the largest eigenvalue are rounding errors of the normal matrix.
MIN_EIGENVALUE = 1e-10
#: With more patterns than this, use Cholesky factors, which take a twentieth of the time of eigenvalues.
MAX_EIGEN_PATTERNS = 16


class LinearEvidence:
    """Result of the linear model: log marginal likelihood over that of noise alone (``gain``), parameter, noise scale,
    traction (component, *surface).

    ``logdet`` is the log determinant of the readings' covariance relative to that of the noise, patterns included;
    ``objective`` is misfit plus penalty, in units of the whitening; ``freedom`` is the number of readings minus that
    of patterns; ``sizes`` (pattern,) are the patterns' sizes. The traction may be passed as a function that computes
    it, because often only the numbers are needed.
    """

    def __init__(
        self,
        gain: float,
        parameter: float,
        scale: float,
        traction: Floats | Callable[[], Floats],
        logdet: float,
        objective: float,
        freedom: float,
        sizes: Floats,
    ) -> None:
        self.gain, self.parameter, self.scale, self._traction = gain, parameter, scale, traction
        self.logdet, self.objective, self.freedom, self.sizes = logdet, objective, freedom, sizes

    @property
    def weight(self) -> float:
        """Weight of the penalty, for readings in units of the noise."""
        return self.parameter / self.scale**2

    @cached_property
    def traction(self) -> Floats:
        return self._traction() if callable(self._traction) else self._traction


def linear_evidence(
    linear: Decomposition,
    rows: Sequence[Floats],
    parameter: float | None = None,
    known: float | None = None,
    patterns: Floats | Marginal | None = None,
    *,
    projected: Floats | None = None,
) -> LinearEvidence:
    """Evidence of one frame of readings, with the parameter given or chosen by evidence.

    ``known`` fixes the noise scale (in units of the whitening; default: that of the arrays). ``patterns`` (pattern,
    coefficient) are nuisances of the readings, projected in the same way, or the `Marginal` of the frame beside them;
    ``projected`` are the readings in the basis of the spectrum, if available.
    """
    spectrum = linear.spectrum
    values, counts = spectrum.eigenvalues, spectrum.multiplicity
    unit = known or 1.0
    coefficients = np.asarray(spectrum.project(rows) if projected is None else projected)
    certain = linear.noise_known or known is not None
    if patterns is not None and not isinstance(patterns, Marginal):
        patterns = Marginal(values, coefficients, patterns, spectrum.tried) if len(patterns) else None
    if patterns is not None:
        best = patterns.best(certain, unit) if parameter is None else parameter
        (everything, base), (left, logdet), count = patterns.alone, patterns.at(best), patterns.count
        free, sizes = _without(values, coefficients, patterns.patterns, best)
        own = 2.0 * float(np.log(patterns.size).sum())
        logdet, base, sizes = logdet + own, base + own, sizes / patterns.size
    else:
        power = np.abs(coefficients) ** 2
        if parameter is None:
            scaled, tried = power[None] / unit**2, spectrum.tried
            found = choose_parameter("evidence", tikhonov, values, counts, scaled, noise_known=certain, tried=tried)
            parameter = float(found[0][0])
        best = parameter
        ratio = values / best
        left, everything = float((counts * power / (1.0 + ratio)).sum()), float((counts * power).sum())
        logdet, base, count = float(counts @ np.log1p(ratio)), 0.0, float(counts.sum())
        free, sizes = coefficients, np.zeros(0)
    scale = unit if certain else math.sqrt(max(left, 0.0) / count)
    gain = evidence_gain(everything / unit**2, left / unit**2, logdet - base, count, certain)

    def traction() -> Floats:
        filtered = free * filtered_inverse(tikhonov, values, np.array([best]))[0]
        return np.asarray(spectrum.solve(filtered))[list(linear.columns)]

    return LinearEvidence(gain, best, scale, traction, logdet, left, count, sizes)


def evidence_gain(everything: float, left: float, logdet: float, count: float, certain: bool) -> float:
    """Log marginal likelihood over that of noise alone, from the objectives of noise alone and of the model, the log
    determinant over that of noise, and the number of readings; ``certain``: the noise is known.
    """
    if everything <= 0.0:
        return 0.0
    if certain:
        return 0.5 * (everything - left - logdet)
    return 0.5 * (count * math.log(everything / max(left, TINY)) - logdet)


def of_unit_size(patterns: Floats) -> tuple[Floats, Floats]:
    """Norms of the patterns (pattern, coefficient), and patterns of norm 1; those without effect stay."""
    size = np.sqrt((patterns**2).sum(axis=1))
    size = np.where(size > 0.0, size, 1.0)
    return size, patterns / size[:, None]


def log_evidence(objective: float, logdet: float, count: float, noise: float | None) -> float:
    """Log marginal likelihood of the readings up to a constant, with the noise scale known or marginalised (prior
    1/noise).

    ``objective`` is misfit plus penalty in units of the whitening, as in `LinearEvidence`.
    """
    if noise is not None:
        return -0.5 * objective / noise**2 - count * math.log(noise) - 0.5 * logdet
    return math.lgamma(0.5 * count) - 0.5 * count * math.log(max(0.5 * objective, TINY)) - 0.5 * logdet


class Marginal:
    """One frame ``c`` beside ``patterns`` of unknown size, in the basis of a spectrum of eigenvalues ``values``.

    Objectives are those of noise of size 1: noise of another size divides them by its square, so that they are computed
    once for all of them. Log determinants are those of ``patterns`` of norm 1, whose norms are ``size``.
    """

    def __init__(self, values: Floats, c: Floats, patterns: Floats, tried: Tried | None = None) -> None:
        self.values, self.c, self._tried = values, c, tried
        # An offset in Pa and a ramp in Pa/m are compared as patterns of one size.
        self.size, self.patterns = of_unit_size(patterns)
        self.count, self._own = float(len(c) - len(patterns)), 0.0
        self._rows = self.patterns
        if len(patterns) > MAX_EIGEN_PATTERNS:
            self._rows, self._own = _independent(self.patterns)

    @cached_property
    def curve(self) -> tuple[Floats, Floats, Floats]:
        """Parameters to try, and objective and log determinant of each."""
        if self._tried is not None:
            grid, (weights, logs) = self._tried.grid, self._tried.weights(self.values)
            return grid, *_restricted(weights, self.c, self._rows, logs)
        grid = candidates(self.values)
        return grid, *_restricted(grid[:, None] / (grid[:, None] + self.values), self.c, self._rows)

    @cached_property
    def alone(self) -> tuple[float, float]:
        """Objective and log determinant of noise alone."""
        (objective,), (logdet,) = _restricted(np.ones((1, len(self.c))), self.c, self._rows)
        return float(objective), float(logdet) + self._own

    def at(self, parameter: float) -> tuple[float, float]:
        """Objective and log determinant of a parameter."""
        (objective,), (logdet,) = _restricted(parameter / (parameter + self.values)[None], self.c, self._rows)
        return float(objective), float(logdet) + self._own

    def best(self, certain: bool, noise: float = 1.0) -> float:
        """The parameter of largest evidence; ``certain``: the noise is known, and of this size."""
        grid, objective, logdet = self.curve
        score = objective / noise**2 + logdet
        if not certain:
            score = self.count * np.log(np.maximum(objective, TINY) / self.count) + logdet
        score = np.where(np.isfinite(score), score, np.inf)[None]
        return float(refined(grid, score, np.argmin(score, axis=1))[0])


def _independent(patterns: Floats) -> tuple[Floats, float]:
    """Orthonormal rows that span the patterns, and their term in the log determinant of their normal matrix."""
    _, sizes, rows = np.linalg.svd(patterns, full_matrices=False)
    seen = sizes**2 > MIN_EIGENVALUE * sizes[0] ** 2
    return rows[seen], 2.0 * float(np.log(sizes[seen]).sum())


def _restricted(weights: Floats, c: Floats, patterns: Floats, logs: Floats | None = None) -> tuple[Floats, Floats]:
    """(objective, log determinant) for rows of ``weights`` = 1/C, with the patterns marginalised; ``logs``: sums of their logarithms, if known."""
    k = len(patterns)
    gram, right = np.empty((len(weights), k, k)), weights @ (patterns * c).T
    for i in range(k):
        gram[:, i, i:] = weights @ (patterns[i] * patterns[i:]).T
        gram[:, i:, i] = gram[:, i, i:]
    if k > MAX_EIGEN_PATTERNS:
        taken, more = np.array([_by_factor(g, r) for g, r in zip(gram, right)]).T
    else:
        taken, more = _by_eigenvalues(gram, right)
    if logs is None:
        with np.errstate(divide="ignore"):
            logs = np.log(weights).sum(axis=1)
    return weights @ c**2 - taken, more - logs


def _by_eigenvalues(gram: Floats, right: Floats) -> tuple[Floats, Floats]:
    """right' gram^-1 right and log det gram for (*batch, pattern, pattern). Patterns that the weighted data cannot
    separate count as one; patterns without effect do not count.
    """
    values, vectors = np.linalg.eigh(gram)
    seen = values > MIN_EIGENVALUE * np.maximum(values.max(axis=-1, keepdims=True), TINY)
    along = (right[..., None, :] @ vectors)[..., 0, :]
    safe = np.where(seen, values, 1.0)
    return np.where(seen, along**2 / safe, 0.0).sum(axis=-1), np.log(safe).sum(axis=-1)


def _by_factor(gram: Floats, right: Floats) -> tuple[float, float]:
    """Return right' gram^-1 right and log det gram, by a Cholesky factor if all patterns are independent."""
    from scipy.linalg import lapack

    factor, wrong = lapack.dpotrf(gram, lower=1)
    # The estimate of the condition number may be ten times too small.
    if not wrong and lapack.dpocon(factor, float(np.abs(gram).sum(axis=0).max()), uplo="L")[0] > 10.0 * MIN_EIGENVALUE:
        half = lapack.dtrtrs(factor, right, lower=1)[0]
        return float(half @ half), 2.0 * float(np.log(np.diagonal(factor)).sum())
    taken, more = _by_eigenvalues(gram, right)
    return float(taken), float(more)


def _without(values: Floats, c: Floats, patterns: Floats, parameter: float) -> tuple[Floats, Floats]:
    """The coefficients without the patterns, and their sizes, by generalised least squares."""
    weighted = patterns * (parameter / (parameter + values))
    sizes = np.linalg.lstsq(weighted @ patterns.T, weighted @ c, rcond=MIN_EIGENVALUE)[0]
    return c - sizes @ patterns, sizes
