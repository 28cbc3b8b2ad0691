"""Mean and covariance of traction on the cells of the surface, of the weighed modes of a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from palpate.elastic.pad import Floats
from palpate.inverse.rectified.link import traction
from palpate.inverse.rectified.newton import Mode
from palpate.inverse.rectified.prepared import Prepared

__all__ = ["CellPosterior", "mixture"]


@dataclass(frozen=True)
class CellPosterior:
    """Of one frame, in units of the scaled readings.

    ``mean`` (component, cell of the surface); ``covariance`` among all of them (component and cell, component and cell); ``gain``
    (component and cell, reading): change of the mean with the readings; ``reduction`` like ``mean``: 1 - posterior over prior variance, NaN
    out of contact.
    """

    mean: Floats
    covariance: Floats
    gain: Floats
    reduction: Floats

    def std_of(self, rows: Floats) -> Floats:
        """Standard deviation of sums (sum, component and cell)."""
        return np.asarray(np.sqrt(np.maximum(((rows @ self.covariance) * rows).sum(axis=1), 0.0)))


def one_mode(p: Prepared, mode: Mode) -> CellPosterior:
    """Of one mode, by its linear model: cov = D (P - P J' S^-1 J P) D', D the derivative of the cells' traction by the latent fields on active cells."""
    q = p.policy
    c = p.components
    t, by_f, by_h = traction(mode.f, mode.h, q.rounding, p.friction)
    sign = mode.explanation.sign
    mean = sign * mode.amplitude * p.means(t).reshape(c, -1)
    count = mean.shape[1]
    line = mode.line
    active = line.active
    within = np.flatnonzero(p.inside.ravel()[active])
    d = p.fine.dimensions
    places = [(x // p.ratio) - p.margin for x in np.unravel_index(active[within], p.fine.shape)]
    owner = np.ravel_multi_index(tuple(places), p.problem.surface.shape)
    some, local = np.unique(owner, return_inverse=True)
    part = mode.amplitude / p.ratio**d
    fields = [(by_h[j][:, active], q.shear_local**2, q.shear_common**2) for j in range(c - 1)]
    fields.append((by_f[:, active], 1.0, 0.0))
    size = c * len(some)
    prior = np.zeros((size, size))
    cross = np.zeros((size, p.n))
    for (derivative, own, common), block in zip(fields, line.blocks):
        # D of this field: every component's cells
        row = np.concatenate([i * len(some) + local for i in range(c)])
        column = np.tile(within, c)
        average = scipy.sparse.csr_array(
            (part * derivative[:, within].ravel(), (row, column)), shape=(size, len(active))
        )
        spread = own * (average @ line.kernel) + common * np.asarray(average.sum(axis=1)).reshape(-1, 1)
        prior += (average @ spread.T).T
        cross += spread @ block.T
    gained = cross @ mode.inverse
    posterior = prior - gained @ cross.T
    index = np.concatenate([i * count + some for i in range(c)])
    covariance = np.zeros((c * count, c * count))
    covariance[np.ix_(index, index)] = posterior
    gain = np.zeros((c * count, p.n))
    gain[index] = gained
    reduction = np.full(c * count, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        reduction[index] = 1.0 - np.diag(posterior) / np.diag(prior)
    return CellPosterior(mean, covariance, gain, reduction.reshape(c, count))


def mixture(p: Prepared, modes: list[Mode], weights: Floats) -> CellPosterior:
    """Mean and covariance of the modes, weights that add up to one: covariance within plus that of the means."""
    weights = weights / weights.sum()
    parts = [one_mode(p, m) for m in modes]
    mean = np.sum([w * q.mean for w, q in zip(weights, parts)], axis=0)
    covariance = np.zeros_like(parts[0].covariance)
    for w, q in zip(weights, parts):
        away = (q.mean - mean).ravel()
        covariance += w * (q.covariance + np.outer(away, away))
    gain = np.sum([w * q.gain for w, q in zip(weights, parts)], axis=0)
    best = parts[int(np.argmax(weights))]
    return CellPosterior(mean, covariance, gain, best.reduction)
