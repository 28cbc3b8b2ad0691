"""Gaussian process from readings to one quantity: physics dominates with few labels, regression with many.

With z the readings over their scale, r = |z| and u = z/r, the covariance of the quantity at two frames is

    a1 z' P z (1 + c log r log r')
                        maps that the pad's physics makes likely (`palpate.calibrate.prior`)
    a2 z . z' (1 + c log r log r')
                        any linear map
    a3 (r r')^q exp(-|u - u'|^2 / 2 m^2)
                        any map that grows as a power q of the readings: q = 1 where pad and contact are linear,
                        and where the contact grows with the load force and readings have different powers
    a4 exp(-|z - z'| / l)
                        the rest, which no term above describes; it need not be smooth (Matern 1/2)
    a5 (z . z')^2       quadratic maps
    a6                  a zero that is not exact

and that of its errors is b1 (noise) + b2 r r' (model error that is new in every frame) + b3 r r' exp(-|t - t'|/s) (lag and drift, equal in frames of
one press). At rest r = 0 and the force is zero. The bend c lets each map grow as a power of the readings that differs from one: z r^p is
about z (1 + p log r). The hyperparameters have log-normal priors and maximise the posterior; the prediction averages over members with fewer
terms (`MEMBERS`), weighted by cross-validation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["MEMBERS", "Fitted", "Process"]

#: Hyperparameters: log of the prior median, and prior standard deviation of the log. Amplitudes are fractions of the
#: mean square of the quantity. Values are conventions; only the lengths, the time, the share, the power and the bend were
#: adjusted, towards what labels of published sensors show (barometers, a Hall-effect skin, magnetometers).
PRIORS = {
    "physics": (np.log(0.5), 1.5),
    "linear": (np.log(0.2), 1.5),
    "growing": (np.log(0.15), 1.5),
    "power": (np.log(0.8), 0.4),
    "angle": (np.log(0.6), 0.7),
    "free": (np.log(0.05), 1.5),
    "length": (np.log(0.6), 0.7),
    "quadratic": (np.log(0.05), 1.5),
    "zero": (np.log(1e-4), 2.0),
    "noise": (2 * np.log(0.02), 2.0),
    "share": (2 * np.log(0.04), 1.5),
    "lag": (2 * np.log(0.05), 1.5),
    "time": (np.log(5.0), 1.5),
    "bend": (2 * np.log(0.3), 1.0),
}
#: Prior of the amplitude of the zero if no frame at rest is known: taxels under a glued cap have a reading at rest.
UNKNOWN_ZERO = (np.log(0.02), 1.5)
NAMES = tuple(PRIORS)
MEDIAN = np.array([p[0] for p in PRIORS.values()])
SPREAD = np.array([p[1] for p in PRIORS.values()])
AT = {name: i for i, name in enumerate(NAMES)}
#: Terms of the covariance that a model may lack.
TERMS = ("physics", "linear", "growing", "free", "quadratic", "zero")
#: Models of the average, each given by the terms that it lacks; "lag" means errors that are correlated in time. Nonlinear growth is described either by the bend of the maps or by the growing term, not by both. Files keep this order: add new models at the
#: end.
MEMBERS: tuple[tuple[str, ...], ...] = (
    ("growing", "free", "quadratic"),
    ("growing", "quadratic"),
    ("free", "quadratic", "bend"),
    ("quadratic", "bend"),
    ("growing", "free"),
    ("bend",),
    ("growing", "quadratic", "lag"),
    ("quadratic", "lag", "bend"),
    ("lag", "bend"),
)
#: Bounds of the hyperparameters in standard deviations of their prior; value added to the diagonal as a fraction of the
#: mean square; smallest reading as a fraction of the typical one.
REACH, JITTER, LEAST = 5.0, 1e-9, 1e-3
#: Each reading is divided by its own magnitude, of whose square at least this fraction is that of the typical reading, so
#: that channels with only noise stay small.
FLOOR = 0.1
#: Labels whose readings and values are below this fraction of the largest are at rest.
AT_REST = 0.05


@dataclass(frozen=True, eq=False)
class Scaled:
    """Readings divided by their scale (frame, reading), their magnitude and direction."""

    z: Floats
    size: Floats
    direction: Floats

    @classmethod
    def of(cls, readings: Floats, scale: Floats) -> Scaled:
        z = readings / scale
        size = np.sqrt((z * z).sum(axis=1) + LEAST**2)
        return cls(z, size, z / size[:, None])

    def __getitem__(self, frames: Any) -> Scaled:
        return Scaled(self.z[frames], self.size[frames], self.direction[frames])


@dataclass(frozen=True, eq=False)
class Terms:
    """Terms of the covariance of two sets of frames, with the quantities that their derivatives need."""

    parts: dict[str, Floats]
    log_size: Floats
    #: Part of the covariance that is proportional to the bend.
    bent: Floats
    angle: Floats
    distance: Floats

    @property
    def total(self) -> Floats:
        return np.asarray(sum(self.parts.values()))


def terms(a: Scaled, b: Scaled, log: Floats, physics: Floats | None, without: tuple[str, ...]) -> Terms:
    """Return the covariance between frames ``a`` and ``b`` for hyperparameters whose logarithms are ``log``."""
    value = np.exp(log)
    dot = a.z @ b.z.T
    log_size = np.log(a.size)[:, None] + np.log(b.size)[None]
    bend = 0.0 if "bend" in without else value[AT["bend"]] * np.outer(np.log(a.size), np.log(b.size))
    straight = {"linear": value[AT["linear"]] * dot}
    if physics is not None:
        straight["physics"] = value[AT["physics"]] * (a.z @ physics) @ b.z.T
    straight = {k: v for k, v in straight.items() if k not in without}
    angle = np.maximum(2.0 - 2.0 * a.direction @ b.direction.T, 0.0) / value[AT["angle"]] ** 2
    squares = (a.z**2).sum(axis=1)[:, None] + (b.z**2).sum(axis=1)[None]
    distance = np.sqrt(np.maximum(squares - 2.0 * dot, 0.0)) / value[AT["length"]]
    parts = {
        **{k: v * (1.0 + bend) for k, v in straight.items()},
        "growing": value[AT["growing"]] * np.exp(value[AT["power"]] * log_size - 0.5 * angle),
        "free": value[AT["free"]] * np.exp(-distance),
        "quadratic": value[AT["quadratic"]] * dot**2,
        "zero": np.full(dot.shape, value[AT["zero"]]),
    }
    bent = np.asarray(bend * sum(straight.values(), start=np.zeros(())))
    return Terms({k: v for k, v in parts.items() if k not in without}, log_size, bent, angle, distance)


def variance(a: Scaled, log: Floats, physics: Floats | None, without: tuple[str, ...]) -> Floats:
    """Return the prior variance of each frame."""
    value, square = np.exp(log), (a.z**2).sum(axis=1)
    bent = 1.0 if "bend" in without else 1.0 + value[AT["bend"]] * np.log(a.size) ** 2
    parts = {
        "linear": value[AT["linear"]] * square * bent,
        "growing": value[AT["growing"]] * a.size ** (2.0 * value[AT["power"]]),
        "free": np.full(len(square), value[AT["free"]]),
        "quadratic": value[AT["quadratic"]] * square**2,
        "zero": np.full(len(square), value[AT["zero"]]),
    }
    if physics is not None:
        parts["physics"] = value[AT["physics"]] * np.einsum("ij,jk,ik->i", a.z, physics, a.z) * bent
    return np.asarray(sum(v for k, v in parts.items() if k not in without))


@dataclass(frozen=True, eq=False)
class Fitted:
    """One fitted model.

    Attributes
    ----------
    log : array
        Logarithms of the hyperparameters.
    without : tuple of str
        Terms that it lacks.
    factor : array (label, label)
        Cholesky factor of the covariance of the labels.
    weights : array (label,)
        Weight of each label in a prediction.
    left_out, left_out_std : array (label,)
        Error of each label when its press is left out, and its standard deviation.
    run_gains, run_zeros : array (run,)
        Relative error of the values of each run when it is left out, and its mean error at rest in units of
        `Process.unit` (NaN without a label at rest); empty for a single run.
    """

    log: Floats
    without: tuple[str, ...]
    factor: Floats
    weights: Floats
    left_out: Floats
    left_out_std: Floats
    run_gains: Floats
    run_zeros: Floats


@dataclass(frozen=True, eq=False)
class Process:
    """Labelled frames of one quantity, and their covariance function.

    Parameters
    ----------
    readings : array (label, reading)
        Without their zero.
    values : array (label,)
        The quantity; 0 at rest.
    std : array (label,)
        Independent standard deviation of each value (of the scale or the sensor); 0 if exact.
    scale : array (reading,)
        Divisors of the readings.
    physics : array (reading, reading) or None
        Second moment of the maps under the physical prior, in units of the readings.
    press : array (label,) of int
        Labels of one press have one number.
    time : array (label,) or None
        Time of each label [s].
    run : array (label,) of int or None
        Which recording each label comes from; None: all from one.
    zero_known : bool
        Whether the readings' zero was taken from frames at rest; else the quantity at readings of 0 is open (`UNKNOWN_ZERO`).
    expected : float
        Root mean square of the quantity that other labels suggest, such as the normal force for shear; it counts as one label. 0: nothing is known.
    """

    readings: Floats
    values: Floats
    std: Floats
    scale: Floats
    physics: Floats | None
    press: np.ndarray[tuple[int, ...], np.dtype[np.int64]]
    time: Floats | None = None
    run: np.ndarray[tuple[int, ...], np.dtype[np.int64]] | None = None
    zero_known: bool = True
    expected: float = 0.0

    @property
    def unit(self) -> float:
        """Root mean square of the values and the expected one, which is the unit of the amplitudes."""
        squares = self.values**2
        return float(np.sqrt(np.mean(np.append(squares, self.expected**2) if self.expected else squares))) or 1.0

    @property
    def scaled_physics(self) -> Floats | None:
        """Return the physical second moment for scaled readings, normalised to 1 for the typical label."""
        if self.physics is None:
            return None
        moved = self.physics * np.outer(self.scale, self.scale)
        z = self.readings / self.scale
        usual = float(np.einsum("ij,jk,ik->", z, moved, z)) / max(len(z), 1)
        return moved / usual if usual > 0.0 else None

    def error_parts(self, a: Scaled, log: Floats, without: tuple[str, ...]) -> tuple[Floats, Floats]:
        """Return the variance of the labels' independent errors, and the covariance of the errors that labels of a
        press share.
        """
        value = np.exp(log)
        new = value[AT["noise"]] + value[AT["share"]] * a.size**2 + (self.std / self.unit) ** 2 + JITTER
        if self.time is None or "lag" in without:
            return new, np.zeros((len(a.size), len(a.size)))
        apart = np.abs(self.time[:, None] - self.time[None])
        return new, value[AT["lag"]] * np.outer(a.size, a.size) * np.exp(-apart / value[AT["time"]])

    def fit(self, without: tuple[str, ...]) -> Fitted:
        """Fit the model that lacks the terms ``without``, at its most probable hyperparameters."""
        from scipy.optimize import minimize

        physics, a = self.scaled_physics, Scaled.of(self.readings, self.scale)
        if physics is None:
            without = (*without, "physics")
        z = self.values / self.unit
        apart = None if self.time is None else np.abs(self.time[:, None] - self.time[None])
        median, spread = MEDIAN.copy(), SPREAD.copy()
        if not self.zero_known:
            median[AT["zero"]], spread[AT["zero"]] = UNKNOWN_ZERO

        def objective(log: Floats) -> tuple[float, Floats]:
            value, made = np.exp(log), terms(a, a, log, physics, without)
            new, lag = self.error_parts(a, log, without)
            try:
                inverse, logdet = inverted(made.total + lag + np.diag(new))
            except np.linalg.LinAlgError:
                return 1e10, np.zeros(len(log))
            alpha = inverse @ z
            w = inverse - np.outer(alpha, alpha)
            gradient = np.zeros(len(log))
            for name in TERMS:
                if name in made.parts:
                    gradient[AT[name]] = 0.5 * np.vdot(w, made.parts[name])
            gradient[AT["bend"]] = 0.5 * np.vdot(w, made.bent)
            if "growing" in made.parts:
                part = w * made.parts["growing"]
                gradient[AT["power"]] = 0.5 * value[AT["power"]] * np.vdot(part, made.log_size)
                gradient[AT["angle"]] = 0.5 * np.vdot(part, made.angle)
            if "free" in made.parts:
                gradient[AT["length"]] = 0.5 * np.vdot(w * made.parts["free"], made.distance)
            diagonal = np.diag(w)
            gradient[AT["noise"]] = 0.5 * value[AT["noise"]] * diagonal.sum()
            gradient[AT["share"]] = 0.5 * value[AT["share"]] * float(diagonal @ a.size**2)
            if apart is not None and "lag" not in without:
                gradient[AT["lag"]] = 0.5 * np.vdot(w, lag)
                gradient[AT["time"]] = 0.5 * np.vdot(w * lag, apart) / value[AT["time"]]
            off = (log - median) / spread
            return float(0.5 * z @ alpha + 0.5 * logdet + 0.5 * off @ off), gradient + off / spread

        bounds = list(zip(median - REACH * spread, median + REACH * spread))
        found = minimize(objective, median, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 100})
        if not np.isfinite(found.fun) or found.fun >= 1e10:
            raise InvalidInput("labels and readings hold numbers that no map can be fitted to: check their units.")
        return self.made(np.asarray(found.x), without)

    def made(self, log: Floats, without: tuple[str, ...]) -> Fitted:
        """Return the model for given hyperparameters, and its predictions of presses that are left out.

        With K the covariance of the labels, leaving out the labels B of a press gives the errors (K^-1)_BB^-1 (K^-1
        z)_B with covariance (K^-1)_BB^-1 (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006,
        section 5.4.2, for blocks).
        """
        a, z = Scaled.of(self.readings, self.scale), self.values / self.unit
        made = terms(a, a, log, self.scaled_physics, without)
        new, lag = self.error_parts(a, log, without)
        covariance = made.total + lag + np.diag(new)
        factor = np.linalg.cholesky(covariance)
        inverse, _ = inverted(covariance)
        alpha = inverse @ z
        error, std = np.empty(len(z)), np.empty(len(z))
        for press in np.unique(self.press):
            at = np.flatnonzero(self.press == press)
            block = np.linalg.inv(inverse[np.ix_(at, at)])
            error[at], std[at] = block @ alpha[at], np.sqrt(np.maximum(np.diag(block), JITTER))
        gains, zeros = [], []
        runs = np.zeros(0, dtype=np.int64) if self.run is None else np.unique(self.run)
        for run in runs if len(runs) > 1 else ():
            at = np.flatnonzero(self.run == run)
            off = np.linalg.solve(inverse[np.ix_(at, at)], alpha[at])
            gains.append(float(off @ z[at]) / max(float(z[at] @ z[at]), JITTER))
            rest = (a.size[at] < AT_REST * a.size.max()) & (np.abs(z[at]) < AT_REST * np.abs(z).max())
            zeros.append(float(off[rest].mean()) if rest.any() else np.nan)
        return Fitted(log, without, factor, alpha, error * self.unit, std * self.unit, np.array(gains), np.array(zeros))

    def noise(self, member: Fitted, readings: Scaled) -> tuple[Floats, Floats]:
        """Return the variances of the error of each frame that is new in every frame, and that frames of one press
        share, in units of the squared quantity.
        """
        value, square = np.exp(member.log), readings.size**2
        lag = 0.0 if self.time is None or "lag" in member.without else value[AT["lag"]]
        return self.unit**2 * (value[AT["noise"]] + value[AT["share"]] * square), self.unit**2 * lag * square

    def predict(self, member: Fitted, readings: Floats) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of the quantity in frames (frame, reading) that belong to a new press."""
        from scipy.linalg import solve_triangular

        a, b = Scaled.of(readings, self.scale), Scaled.of(self.readings, self.scale)
        physics = self.scaled_physics
        across = terms(a, b, member.log, physics, member.without).total
        mean = across @ member.weights
        reduced = solve_triangular(member.factor, across.T, lower=True)
        left = variance(a, member.log, physics, member.without) - (reduced**2).sum(axis=0)
        return self.unit * mean, np.sqrt(self.unit**2 * np.maximum(left, 0.0) + sum(self.noise(member, a)))


def inverted(matrix: Floats) -> tuple[Floats, float]:
    """Return the inverse of a positive definite matrix, and the logarithm of its determinant."""
    from scipy.linalg import lapack

    factor, wrong = lapack.dpotrf(matrix, lower=1)
    if wrong:
        raise np.linalg.LinAlgError("not positive definite")
    logdet = 2.0 * float(np.log(np.diag(factor)).sum())
    inverse, _ = lapack.dpotri(factor, lower=1)
    return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T), logdet
