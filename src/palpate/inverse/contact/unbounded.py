"""Loads that the readings do not bound: an offset that may be an even press, and contact that extends beyond all edges."""

from __future__ import annotations

import math

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.prepared import PreparedContact

__all__ = ["even_press", "goes_on_all_round", "offset_as_load"]


def offset_as_load(estimator: PreparedContact, h: Explanation, traction: Floats) -> Floats | None:
    """Bounds on the net force (component, 2) if the offsets of an explanation are really a load; None if they cannot
    be, or if a zero was taken.

    An even press has no known extent, so its force has no bound. Offsets of stress and strain that are larger than the
    contact beside them may be an even press over the whole array. A smaller even press counts as an offset, because a
    contact on top of an even press is rare.
    """
    policy = estimator.policy
    offsets = h.present & np.array([t.kind == "offset" and t.unit != "m" for t in estimator.terms], dtype=bool)
    if estimator.problem.zeroed or not offsets.any():
        return None
    even = even_press(estimator, np.where(offsets, h.sizes, 0.0))
    if even is None:
        return None
    found = np.abs(traction).reshape(len(traction), -1).max(axis=1)
    if not np.abs(even).max() > found.max():
        return None
    force = estimator.operator.surface.cell * traction.reshape(len(traction), -1).sum(axis=1)
    bounds = np.stack([force, force], axis=1)
    for column, value in zip(estimator.columns, even):
        if abs(value) > policy.errors.even_press * np.abs(even).max():
            bounds[column, int(value > 0)] = math.copysign(math.inf, value)
    return bounds


def even_press(estimator: PreparedContact, sizes: Floats) -> Floats | None:
    """The even traction (component sought,) that reads like nuisances of these sizes (nuisance,), None if none does."""
    policy = estimator.policy
    rows = estimator.shifts @ sizes / estimator.readings.std
    columns = estimator.even_press / estimator.readings.std[:, None]
    even = np.linalg.lstsq(columns, rows, rcond=1e-3)[0]
    even[-1] = (
        max(even[-1], 0.0) if estimator.columns[-1] == len(estimator.operator.surface.components) - 1 else even[-1]
    )
    left = rows - columns @ even
    return None if float(left @ left) > policy.errors.even_press**2 * float(rows @ rows) else np.asarray(even)


def goes_on_all_round(estimator: PreparedContact, traction: Floats, sign: int) -> Floats | None:
    """Bounds on the net force (component, 2) of a contact that loads the whole edge of the array, so that its extent
    is unknown; None if it ends inside.
    """
    pressure = np.abs(traction[-1]).ravel()
    top = float(pressure.max(initial=0.0))
    if (
        not top > 0.0
        or not len(estimator.ring)
        or float(pressure[estimator.ring].min()) < estimator.policy.extent.goes_on * top
    ):
        return None
    bounds = np.full((len(traction), 2), math.nan)
    bounds[-1, int(sign >= 0)] = math.copysign(math.inf, sign)
    return bounds
