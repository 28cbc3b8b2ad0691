"""Prior of offsets that arose after a zero: Gaussian, in proportion to the largest reading of their kind.

A zero removes the offsets of stress and strain; what is left of them is drift. A wide press and an opposite drift
may explain the same readings, so the size of drift needs a prior: in the score of an explanation (`cost`), and in the
solution of contact and nuisances together and its errors (`precision`).
"""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.prepared import PreparedContact

__all__ = ["cost", "precision", "reach_of_kind"]


def precision(estimator: PreparedContact, data: Floats) -> Floats:
    """1 / variance (nuisance,) of the sizes, for readings ``data`` without the nuisances; 0 for those that no zero removed."""
    size = estimator.policy.explanations.drift * reach_of_kind(estimator, estimator.shifts, data)
    return np.where(estimator.since_zero, np.maximum(size, 1e-150) ** -2.0, 0.0)


def cost(estimator: PreparedContact, sizes: Floats, data: Floats) -> float:
    """What nuisances of these sizes (nuisance,) in the readings ``data`` cost, in nats."""
    return float(0.5 * (sizes**2 * precision(estimator, data - estimator.shifts @ sizes)).sum())


def reach_of_kind(estimator: PreparedContact, columns: Floats, data: Floats) -> Floats:
    """Size at which each nuisance makes readings as large as the largest of any channel of its kind. A sensor's zero
    error depends on its range, not on how strongly a contact happens to act on one channel.
    """
    largest = np.where(estimator.of_unit, np.abs(data), 0.0).max(axis=1, initial=0.0)
    touched = (estimator.of_unit.astype(float) @ (columns != 0)) > 0
    return np.asarray(
        np.where(touched, largest[:, None], 0.0).max(axis=0, initial=0.0)
        / np.maximum(np.abs(columns).max(axis=0, initial=0.0), 1e-300)
    )
