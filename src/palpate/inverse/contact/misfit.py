"""Test whether contact explains the readings: size of the residual, whiteness, and drift of the sensor."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.variances import carried, face_of, taken_by
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.systematic import shear_like_pressure
from palpate.inverse.fit import MIN_DEGREES, MODEL_DETAIL, misfit_probability, rms, unfitted

__all__ = ["drift_probability", "fit_of", "misfit_of", "proportional_part"]


def fit_of(estimator: PreparedContact, run: Solved) -> tuple[float, float, float]:
    """Misfit probability (`misfit_of`) of the weighted models of a frame; root mean square of the residual, in units
    of the noise; degrees of freedom of the residual.
    """
    observed, total = run.observed, sum(m.weight for m in run.members)
    misfit = estimator.readings.whitened(run.data, observed, run.noise) - _predicted(run)
    taken = sum(m.weight / total * taken_by(m) for m in run.members)
    residual = np.zeros(len(observed))
    residual[observed] = misfit
    fit = misfit_of(estimator, run, residual, taken)
    return fit, rms(misfit), float(observed.sum()) - taken


def _predicted(run: Solved) -> Floats:
    """Weighted mean of the whitened readings (observed reading,) that the models predict."""
    total = sum(m.weight for m in run.members)
    return np.sum([m.weight / total * m.explained for m in run.members], axis=0)


def proportional_part(estimator: PreparedContact, run: Solved) -> float:
    """The discrepancy: fraction of the readings by which the residual is proportional to them; 0 if it is not
    significant or if the noise is given.

    Maximum likelihood for residuals r ~ N(0, a^2 + share^2 m^2), where m are the predicted readings, compared with
    share = 0 by a likelihood ratio.
    """
    if estimator.noise_known or not estimator.readings.independent:
        return 0.0
    found = _predicted(run)
    residual = estimator.readings.whitened(run.data, run.observed, run.noise) - found
    sizes = np.abs(found)
    level = max(rms(residual), 1e-300)
    # Evaluate the likelihood on a grid of a (as a fraction of the residual) and share.
    even, shares = level * np.geomspace(0.1, 1.5, 12), np.r_[0.0, np.geomspace(0.02, 0.6, 12)]
    variance = even[:, None, None] ** 2 + (shares[None, :, None] * sizes) ** 2
    minus = 0.5 * (residual**2 / variance + np.log(variance)).sum(axis=-1)
    best = minus.min(axis=0)
    chosen = int(np.argmin(best))
    return float(shares[chosen]) if best[0] - best[chosen] > estimator.policy.fit.shows else 0.0


def misfit_of(estimator: PreparedContact, run: Solved, residual: Floats, taken: float) -> float:
    """Misfit probability of a frame: from size and whiteness (`palpate.inverse.fit.misfit_probability`) and from drift
    (`drift_probability`).

    ``residual`` (reading,) is in units of the noise; ``taken`` is the number of degrees of freedom used by the contact.
    """
    known, columns, observed = estimator.noise_known, run.doubtful[0], run.observed
    stretch = float(np.median(run.noise / estimator.readings.std)) if known else 1.0
    largest = float(np.abs(run.data / np.where(run.noise > 0, run.noise, 1.0))[observed].max(initial=0.0))
    detail = math.hypot(MODEL_DETAIL, estimator.problem.doubts.stated_gain) * largest
    taken += columns.shape[1]
    if columns.shape[1]:
        # A residual that an inexactly known pad would cause is no misfit.
        residual = residual.copy()
        residual[observed] = unfitted(residual[observed], estimator.readings.white(columns[observed], observed))
    return misfit_probability(
        residual * stretch,
        observed,
        estimator.pairs,
        taken=taken,
        known=known,
        detail=detail * stretch,
        others=() if math.isnan(run.drift) else (run.drift,),
        channels=None if known else estimator.noise.index,
    )


def drift_probability(estimator: PreparedContact, run: Solved) -> float:
    """Probability that noise alone would leave as much offset and ramp (columns B) in the residual as was found; NaN
    if this cannot be computed.

    Let r = y - A t, where t is the contact under the penalty P. The drift g = B'r has the covariance S = B'B - B'A
    (A'A + P)^-1 A'B on the face of the contact. g' S^-1 g follows chi^2 with as many degrees of freedom as there are
    patterns (the score test; C. R. Rao, Proc. Cambridge Phil. Soc. 44, 1948, 50-57), or F if the noise was learned.
    The contact absorbs most of a drift, and the rest is too small and too smooth for the tests of size and of
    neighbours. The largest probability over the models counts: in a model that smooths more, the residual may be due
    to smoothing.

    Two causes are removed first (by the Schur complement): deviations that an inexactly known pad would cause, and
    shear in a fixed proportion to pressure, which the penalty shrinks. With more than `Fit.loud` readings the
    covariance is S + S D^2 S: a drift of size D is below the accuracy of the model.
    """
    policy = estimator.policy
    import scipy.special

    if not run.members:
        return math.nan
    many = int(run.observed.sum()) > policy.work.many_readings
    members = sorted(run.members, key=lambda m: -m.weight) if many else run.members
    observed, known = run.observed, estimator.noise_known
    drifts = np.stack([t.rows for t in estimator.drifts], axis=1)
    columns = np.concatenate([run.doubtful[0], drifts / run.noise[:, None]], axis=1)
    columns = estimator.readings.white(columns[observed], observed)
    y = estimator.readings.whitened(run.data, observed, run.noise)
    detail = math.hypot(MODEL_DETAIL, estimator.problem.doubts.stated_gain) * float(np.abs(y).max(initial=0.0))
    chances: list[float] = []
    for m in members:
        if many and max(chances, default=0.0) > policy.fit.accepted:
            break
        t, matrix = m.solution.traction, m.data.matrix
        drag = [matrix @ way.ravel() for way in shear_like_pressure(t)]
        first = len(drag) + run.doubtful[0].shape[1]
        each = np.concatenate([*(d[:, None] for d in drag), columns], axis=1)
        size = np.sqrt((each**2).sum(axis=0))
        each = each / np.where(size > 0, size, 1.0)
        rows, misfit = each.T @ matrix, y - m.explained
        along, face = each.T @ misfit, face_of(m.solution)[0]
        local, moved = face.columns(rows), carried(m.solution, rows)
        if m.data.at_size:
            # The solution is known only to a tolerance: correct the residual for it.
            slope = (misfit @ matrix).reshape(t.shape)
            if m.ray is None:
                slope = slope - m.penalty.product(t)
            else:  # a sliding contact is penalised by its pressure only
                slope[-1:] -= m.penalty.product(t[-1:])
            along = along - moved.T @ face.columns(slope.reshape(1, -1))[0]
        covariance = each.T @ each - local @ moved
        least = policy.fit.told
        fewer, without = _squares(covariance[:first, :first], along[:first], least)
        if len(y) > policy.fit.loud:
            highest = np.abs(each[:, first:]).max(axis=0)
            unseen = MODEL_DETAIL * float(np.abs(y).max(initial=0.0)) / np.where(highest > 0, highest, np.inf)
            tied = covariance[first:, :first] @ np.linalg.pinv(covariance[:first, :first], rcond=least, hermitian=True)
            left = covariance[first:, first:] - tied @ covariance[:first, first:]
            count, squares = _squares(left + (left * unseen**2) @ left, along[first:] - tied @ along[:first], least)
            count, squares = count + fewer, squares + without
        else:
            count, squares = _squares(covariance, along, least)
        count, squares = count - fewer, max(squares - without, 0.0) / (1.0 + detail**2)
        free = len(y) - taken_by(m) - fewer
        if count < 1 or free - count < MIN_DEGREES:
            return math.nan
        if known:
            chances.append(float(scipy.special.gammaincc(0.5 * count, 0.5 * squares)))
        else:
            chances.append(float(scipy.special.fdtrc(count, free - count, squares / count)))
    return max(chances)


def _squares(covariance: Floats, along: Floats, least: float) -> tuple[int, float]:
    """Degrees of freedom and g' S^-1 g, without directions that the data do not determine."""
    if not len(along):
        return 0, 0.0
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    told = values > least
    return int(told.sum()), float(((vectors[:, told].T @ along) ** 2 / values[told]).sum())
