"""Regressions on the labels of a calibration, without a pad model, for comparison with it: linear and quadratic ridge, Gaussian process without physics."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from palpate.calibrate.process import Process
from palpate.elastic.pad import Floats

__all__ = ["REGRESSIONS", "cross_validation_errors", "ridge"]

#: Candidate weights of the ridge, for readings of variance 1.
RIDGES = np.logspace(-6.0, 4.0, 41)
#: Number of groups of presses for cross-validation.
FOLDS = 5


def ridge(readings: Floats, values: Floats, wanted: Floats, *, quadratic: bool = False) -> Floats:
    """Predict the values of the frames ``wanted`` by ridge regression with a constant; the weight of the ridge
    minimises the leave-one-out error (Golub, Heath and Wahba, Technometrics 21, 1979).
    """
    mean, spread = readings.mean(axis=0), readings.std(axis=0)
    spread = np.where(spread > 0.0, spread, 1.0)
    x, at = (readings - mean) / spread, (wanted - mean) / spread
    if quadratic:
        i, j = np.triu_indices(x.shape[1])
        x, at = np.hstack([x, x[:, i] * x[:, j]]), np.hstack([at, at[:, i] * at[:, j]])
        mean, spread = x.mean(axis=0), x.std(axis=0)
        spread = np.where(spread > 1e-12, spread, 1.0)
        x, at = (x - mean) / spread, (at - mean) / spread
    level, count = values.mean(), len(values)
    left, size, right = np.linalg.svd(x, full_matrices=False)
    along = left.T @ (values - level)
    best: tuple[float, Floats] = (np.inf, along)
    for weight in RIDGES:
        kept = size**2 / (size**2 + weight)
        leverage = (left**2 * kept).sum(axis=1) + 1.0 / count
        error = (values - level - left @ (kept * along)) / np.maximum(1.0 - leverage, 1e-6)
        if float((error**2).mean()) < best[0]:
            best = (float((error**2).mean()), right.T @ (size / (size**2 + weight) * along))
    return np.asarray(level + at @ best[1])


def gaussian_process(readings: Floats, values: Floats, wanted: Floats) -> Floats:
    """Predict values by a Gaussian process about the mean, with a linear plus squared-exponential covariance and
    hyperparameters of the largest marginal likelihood.
    """
    mean, spread = readings.mean(axis=0), readings.std(axis=0)
    spread = np.where(spread > 0.0, spread, 1.0)
    x, at, level = (readings - mean) / spread, (wanted - mean) / spread, float(values.mean())
    process = Process(
        x, values - level, np.zeros(len(values)), np.full(x.shape[1], np.sqrt(x.shape[1])), None, np.arange(len(values))
    )
    member = process.fit(("growing", "quadratic", "bend"))
    return level + process.predict(member, at)[0]


Regression = Callable[[Floats, Floats, Floats], Floats]
REGRESSIONS: dict[str, Regression] = {
    "linear": ridge,
    "quadratic": lambda x, y, at: ridge(x, y, at, quadratic=True),
    "Gaussian process": gaussian_process,
}


def cross_validation_errors(
    regression: Regression, readings: Floats, values: Floats, press: npt.NDArray[np.int64]
) -> Floats:
    """Return the error of each label when its press is left out, in `FOLDS` groups of presses; NaN if too few labels
    remain to learn from.
    """
    numbers = np.unique(press)
    out = np.full(len(values), np.nan)
    for group in np.array_split(np.random.default_rng(0).permutation(numbers), min(FOLDS, len(numbers))):
        test = np.isin(press, group)
        if (~test).sum() >= 2:
            out[test] = values[test] - regression(readings[~test], values[~test], readings[test])
    return out
