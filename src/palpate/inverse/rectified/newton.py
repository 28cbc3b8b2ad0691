"""The most likely latent fields of one explanation, by Gauss-Newton steps in the space of the readings.

    y = s A t(f, h) + B b + e,   f ~ N(m, K),   h_j ~ N(0, c^2 1 1' + a^2 K),   b ~ N(0, T),   e ~ N(0, N)

With J the derivative of s A t by the fields, a step goes to the mean of the linearised model, f = m + K J' S^-1 (y - s A t + J (f - m)), with
S = J K J' + B T B' + N of the size of the readings (A. Tarantola, Inverse Problem Theory, 2005, eq. 3.51). The amplitude s and the noise N are learned
along the way by the evidence of the linearised model (D. J. C. MacKay, Neural Computation 4, 1992, 415-447).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg

from palpate.elastic.pad import Floats
from palpate.inverse.rectified.link import traction
from palpate.inverse.rectified.prepared import Kernel, Prepared

__all__ = ["Explanation", "Mode", "Noise", "Start", "most_likely"]


@dataclass(frozen=True)
class Noise:
    """What is known of the noise: given per channel, or learned; with given noise a discrepancy may be learned beside it."""

    given: Floats | None
    discrepancy: bool = False

    @property
    def learned(self) -> bool:
        """Whether anything is learned."""
        return self.given is None or self.discrepancy


@dataclass(frozen=True)
class Explanation:
    """One explanation of a frame: push or pull, correlation length, whether patterns are in it, broken readings, noise."""

    sign: int
    length: int
    patterns: bool
    broken: tuple[int, ...]
    noise: Noise


@dataclass(frozen=True)
class Start:
    """Where the iteration starts: latent fields, amplitude and noise."""

    f: Floats
    h: Floats
    amplitude: float
    sigma: Floats

    def louder(self, factor: float) -> Start:
        """The same traction of an amplitude that is larger by ``factor``."""
        return Start(self.f / factor, self.h, self.amplitude * factor, self.sigma)


@dataclass
class Mode:
    """An explanation, solved. ``inverse`` is S^-1, ``weights`` S^-1 times the readings less what is expected, ``line`` the linear model at the mode."""

    explanation: Explanation
    f: Floats
    h: Floats
    amplitude: float
    sigma: Floats
    evidence: float
    odds: float
    steps: int
    converged: bool
    weights: Floats
    inverse: Floats
    columns: Floats
    residual: Floats
    line: Linearised
    taken: float

    @property
    def start(self) -> Start:
        """For a similar explanation."""
        return Start(self.f, self.h, self.amplitude, self.sigma)


def _inverse(matrix: Floats) -> tuple[Floats, float]:
    """Inverse of a positive definite matrix, and the logarithm of its determinant."""
    factor = scipy.linalg.cholesky(matrix, lower=True, check_finite=False)
    inverse = scipy.linalg.lapack.dpotri(factor, lower=1)[0]
    low = np.tril(inverse, -1)
    return np.asarray(low + low.T + np.diag(np.diag(inverse))), 2.0 * float(np.log(np.diag(factor)).sum())


@dataclass
class Level:
    """Noise of each channel and how it is learned: the logarithm of a standard deviation per channel, or of one discrepancy for all."""

    noise: Noise
    channel: npt.NDArray[np.intp]
    count: int
    median: float
    spread: float
    among: float
    value: Floats  # (channel,) learned part
    detail: float  # what cells of a finite size add to every reading

    @property
    def variance(self) -> Floats:
        """Of each reading."""
        given = self.noise.given
        if given is None:
            square = self.value**2
        elif self.noise.discrepancy:
            square = given**2 + self.value**2
        else:
            square = given**2
        return np.asarray(square[self.channel] + self.detail**2)

    def step(self, u: Floats, diagonal: Floats, damped: float = 0.7) -> Floats:
        """Newton step of the logarithms, by Fisher information; u = S^-1 d, ``diagonal`` that of S^-1."""
        if not self.noise.learned:
            return np.zeros(self.count)
        part = self.value[self.channel] ** 2
        gradient = np.bincount(self.channel, part * (u * u - diagonal), self.count)
        information = 2.0 * np.bincount(self.channel, (part * diagonal) ** 2, self.count) + 1e-3
        if self.noise.given is not None:  # one discrepancy for all
            gradient, information = np.full(self.count, gradient.sum()), np.full(self.count, information.sum())
        x = np.log(self.value)
        gradient = gradient - (x - self.median) / self.spread**2 - (x - x.mean()) / self.among**2
        information = information + 1.0 / self.spread**2 + 1.0 / self.among**2
        return np.asarray(np.clip(gradient / information, -damped, damped))

    def log_prior(self) -> float:
        """Of the logarithms that are learned."""
        if not self.noise.learned:
            return 0.0
        x = np.log(self.value)
        return float(
            -0.5 * ((x - self.median) ** 2).mean() / self.spread**2 - 0.5 * ((x - x.mean()) ** 2).sum() / self.among**2
        )


def level_of(p: Prepared, noise: Noise, start: Floats) -> Level:
    """How the noise of a frame is learned, from where it starts."""
    q = p.policy
    if noise.discrepancy:
        return Level(
            noise, p.channel, p.count, np.log(q.discrepancy), q.discrepancy_spread, q.channel_spread, start, p.detail
        )
    return Level(noise, p.channel, p.count, np.log(q.noise), q.noise_spread, q.channel_spread, start, p.detail)


def columns_of(p: Prepared, e: Explanation) -> Floats:
    """Columns (reading, term) of patterns and broken readings, times their prior standard deviations."""
    out = [p.policy.offset * p.columns] if e.patterns else []
    if e.broken:
        alone = np.zeros((p.n, len(e.broken)))
        alone[list(e.broken), range(len(e.broken))] = p.policy.broken
        out.append(alone)
    return np.concatenate(out, axis=1) if out else np.zeros((p.n, 0))


class Fields:
    """Latent fields with what the prior says of them: f = mean + K v."""

    def __init__(self, p: Prepared, kernel: Kernel) -> None:
        self.p, self.kernel = p, kernel
        q = p.policy
        count = p.components
        self.prior = np.zeros((count, p.cells))
        self.prior[-1] = p.mean
        self.local = np.array([q.shear_local**2] * (count - 1) + [1.0])
        self.common = np.array([q.shear_common**2] * (count - 1) + [0.0])

    def from_weights(self, v: Floats) -> Floats:
        """mean + K v (field, cell)."""
        spread = self.kernel.times(v)
        return np.asarray(self.prior + self.local[:, None] * spread + (self.common * v.sum(axis=1))[:, None])


@dataclass(frozen=True)
class Linearised:
    """Readings about one point of the latent fields: predicted + sum of blocks (field - prior) - shift, on the cells that are active."""

    active: npt.NDArray[np.intp]
    kernel: Floats
    blocks: list[Floats]
    predicted: Floats
    shift: Floats
    signal: Floats


def linearised(
    p: Prepared, fields: Fields, x: Floats, s: float, t: Floats, by_f: Floats, by_h: Floats
) -> Linearised | None:
    """The derivatives of readings of s t, and the covariance that the prior gives them; None where no cell is in contact."""
    active = np.flatnonzero(by_f[-1] > 0)
    if not len(active):
        return None
    rows = p.responses[:, :, active]
    c = p.components
    blocks = [s * sum(rows[i] * by_h[j, i, active] for i in range(c)) for j in range(c - 1)]
    blocks.append(s * sum(rows[i] * by_f[i, active] for i in range(c)))
    kernel = fields.kernel.block(active)
    signal, shift = np.zeros((p.n, p.n)), np.zeros(p.n)
    for j, block in enumerate(blocks):
        signal += fields.local[j] * ((block @ kernel) @ block.T)
        if fields.common[j]:
            total = block.sum(axis=1)
            signal += fields.common[j] * np.outer(total, total)
        shift += block @ (x[j] - fields.prior[j])[active]
    predicted = np.asarray(s * sum(rows[i] @ t[i, active] for i in range(c)))
    return Linearised(active, kernel, blocks, predicted, shift, signal)


def most_likely(
    p: Prepared,
    y: Floats,
    e: Explanation,
    start: Start,
) -> Mode | None:
    """The mode of one explanation of scaled readings ``y``; None where no cell is in contact."""
    q = p.policy
    kernel = p.kernels[e.length]
    fields = Fields(p, kernel)
    b = columns_of(p, e)
    y = e.sign * y
    x = np.concatenate([start.h, start.f[None]])
    s = start.amplitude
    level = level_of(p, e.noise, np.array(start.sigma))
    v = np.zeros_like(x)
    converged, damping, last = False, 1.0, 0.0
    bb = b @ b.T
    for steps in range(1, q.steps + 1):
        t, by_f, by_h = traction(x[-1], x[:-1], q.rounding, p.friction)
        line = linearised(p, fields, x, s, t, by_f, by_h)
        if line is None:
            return None
        active, blocks, predicted, shift, signal = line.active, line.blocks, line.predicted, line.shift, line.signal
        variance = level.variance
        total_cov = signal + bb
        total_cov[np.diag_indices(p.n)] += variance
        try:
            inverse, logdet = _inverse(total_cov)
        except scipy.linalg.LinAlgError:
            return None
        gap = y - predicted + shift
        u = inverse @ gap
        # amplitude and noise by evidence
        diagonal = np.diag(inverse)
        gamma = float((inverse * signal).sum())
        along = float(u @ (predicted - shift))
        gradient = float(u @ (signal @ u)) - gamma + along
        information = 2.0 * max(gamma, 1e-3) + abs(along)
        change = float(np.clip(gradient / information, -0.7, 0.7))
        noisy = level.step(u, diagonal)
        # the new point
        new_v = np.zeros_like(x)
        for j, block in enumerate(blocks):
            new_v[j, active] = block.T @ u
        new_x = fields.from_weights(new_v)
        white = _Woodbury(variance, b)

        def energy(z: Floats, w: Floats, s: float = s, white: _Woodbury = white) -> float:
            t, _, _ = traction(z[-1], z[:-1], q.rounding, p.friction)
            on = np.flatnonzero(t[-1])
            left = y - s * sum(p.responses[i][:, on] @ t[i, on] for i in range(p.components))
            return 0.5 * float(left @ white.solve(left)) + 0.5 * float(((z - fields.prior) * w).sum())

        before = np.inf if steps == 1 else energy(x, v)
        part = 1.0
        if steps == 1:
            x, v = new_x, new_v
            now = energy(x, v)
        else:
            while True:
                trial, trial_v = x + part * (new_x - x), v + part * (new_v - v)
                now = energy(trial, trial_v)
                if now <= before + 1e-6 * abs(before) or part < 0.02:
                    break
                part *= 0.5
            x, v = trial, trial_v
        if steps > 1:
            # amplitude and fields follow each other, and may go round in a cycle of two: a step that turns back is halved
            damping = 0.5 * damping if change * last < 0 else min(1.0, 1.5 * damping)
            last = change
            s *= float(np.exp(damping * change))
            level.value = np.clip(level.value * np.exp(damping * noisy), 1e-5, 3.0)
            if before - now < q.tolerance and abs(change) < 0.05 and np.abs(noisy).max() < 0.05:
                converged = True
                break
    # the linear model at the mode itself, for the evidence and the error bars
    t, by_f, by_h = traction(x[-1], x[:-1], q.rounding, p.friction)
    line = linearised(p, fields, x, s, t, by_f, by_h)
    if line is None:
        return None
    variance = level.variance
    total_cov = line.signal + bb
    total_cov[np.diag_indices(p.n)] += variance
    inverse, logdet = _inverse(total_cov)
    diagonal = np.diag(inverse)
    left = y - line.predicted
    u = inverse @ (left + line.shift)
    white = _Woodbury(variance, b)
    now = 0.5 * float(left @ white.solve(left)) + 0.5 * float(((x - fields.prior) * v).sum())
    evidence = -now - 0.5 * logdet - 0.5 * p.n * np.log(2.0 * np.pi) + level.log_prior()
    evidence -= 0.5 * np.log1p(q.amplitude_spread**2 * information)  # Occam's factor of the amplitude
    free = np.asarray(white.solve(left)) * variance  # the residual without patterns
    return Mode(
        e,
        x[-1],
        x[:-1],
        s,
        level.value,
        float(evidence),
        float(evidence) + prior_odds(p, e),
        steps,
        converged,
        u,
        inverse,
        b,
        free,
        line,
        float(p.n - (variance * diagonal).sum()),
    )


def prior_odds(p: Prepared, e: Explanation) -> float:
    """Log odds of an explanation before anything is measured."""
    q = p.policy
    out = q.odds_broken * len(e.broken)
    if e.patterns and not p.patterns_certain:
        out += q.odds_offset
    if e.sign < 0:
        out += q.odds_pull
    if e.noise.discrepancy:
        out += q.odds_discrepancy
    return out


class _Woodbury:
    """(N + B B')^-1 of diagonal N and few columns B."""

    def __init__(self, variance: Floats, columns: Floats) -> None:
        self.variance, self.columns = variance, columns
        self.few = columns.shape[1] > 0
        if self.few:
            inner = np.eye(columns.shape[1]) + columns.T @ (columns / variance[:, None])
            self.factor = scipy.linalg.cho_factor(inner, lower=True)

    def solve(self, right: Floats) -> Floats:
        """The inverse times readings (reading,)."""
        x = right / self.variance
        if self.few:
            x = x - (self.columns @ scipy.linalg.cho_solve(self.factor, self.columns.T @ x)) / self.variance
        return np.asarray(x)


def linear(
    p: Prepared, y: Floats, length: int, columns: Floats, noise: Noise, covariance: Floats
) -> tuple[Floats, Floats, float, Floats, float]:
    """(S^-1 y, diagonal of S^-1, amplitude, sigma, evidence) of the plain Gaussian process, in which every cell may push or pull."""
    s = p.start
    level = level_of(p, noise, np.full(p.count, 0.1))
    bb = columns @ columns.T
    for _ in range(12):
        total = s * s * covariance + bb
        total[np.diag_indices(p.n)] += level.variance
        inverse, logdet = _inverse(total)
        u = inverse @ y
        diagonal = np.diag(inverse)
        quad = s * s * float(u @ (covariance @ u))
        gamma = s * s * float((inverse * covariance).sum())
        change = float(np.clip((quad - gamma) / (2.0 * max(gamma, 1e-3)), -1.0, 1.0))
        noisy = level.step(u, diagonal, 1.0)
        s *= float(np.exp(change))
        level.value = np.clip(level.value * np.exp(noisy), 1e-5, 3.0)
        if abs(change) < 0.02 and np.abs(noisy).max() < 0.05:
            break
    evidence = -0.5 * float(y @ u) - 0.5 * logdet - 0.5 * p.n * np.log(2.0 * np.pi) + level.log_prior()
    return u, diagonal, s, level.value, evidence


def silence(p: Prepared, y: Floats, e: Explanation) -> tuple[float, Floats, Floats, Floats]:
    """Evidence of no contact with prior odds; sigma; the residual; variance of each reading."""
    q = p.policy
    b = columns_of(p, e)
    power = np.sqrt(np.bincount(p.channel, y * y, p.count) / np.bincount(p.channel, minlength=p.count))
    level = level_of(p, e.noise, np.maximum(power, 1e-5))
    for _ in range(30):
        total = b @ b.T
        total[np.diag_indices(p.n)] += level.variance
        inverse, logdet = _inverse(total)
        u = inverse @ y
        noisy = level.step(u, np.diag(inverse), 1.0)
        if not e.noise.learned:
            break
        level.value = np.clip(level.value * np.exp(noisy), 1e-5, 3.0)
        if np.abs(noisy).max() < 0.02:
            break
    evidence = -0.5 * float(y @ u) - 0.5 * logdet - 0.5 * p.n * np.log(2.0 * np.pi) + level.log_prior()
    variance = level.variance
    left = _Woodbury(variance, b).solve(y) * variance
    return evidence + prior_odds(p, e) + q.odds_none, level.value, left, variance


def broken_gain(u: Floats, diagonal: Floats, taken: Sequence[int], size: float) -> tuple[float, int]:
    """Largest gain in log evidence of letting one reading be broken, its error N(0, ``size``^2), and that reading.

    A column e_i adds size^2 to one diagonal entry of S: by the matrix determinant lemma and Sherman and Morrison's formula the log evidence changes by
    1/2 u_i^2 z / (1 + z D_i) - 1/2 log(1 + z D_i), z = size^2, u = S^-1 y, D = diag S^-1.
    """
    z = size**2
    gain = 0.5 * u * u * z / (1.0 + z * diagonal) - 0.5 * np.log1p(z * diagonal)
    gain[list(taken)] = -np.inf
    i = int(np.argmax(gain))
    return float(gain[i]), i
