"""Solve the constrained problem on the surface grid, over the cells in contact."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import TOLERANCE
from palpate.inverse.constrained.model import ContactModel, dilated
from palpate.inverse.constrained.products import FIRST_AT_SIZE
from palpate.inverse.contact.prepared import PreparedContact

__all__ = ["even_contact"]


def even_contact(
    estimator: PreparedContact,
    linear: Floats,
    y: Floats,
    noise: Floats,
    observed: npt.NDArray[np.bool_],
    weight: float,
    near: Floats | None = None,
    *,
    keep_face: bool = False,
) -> tuple[Floats, Floats, ContactModel]:
    """Constrained solution on the surface grid (component, cell), the readings that it predicts (reading,), and its model.

    Start with the cells where pressure is likely and add cells until none is missing. ``near`` is the solution of a
    similar problem, used as a starting point: it saves iterations and does not change the result. ``keep_face`` is passed
    to `minimise`.
    """
    policy = estimator.policy
    level, components = estimator.level(1), len(estimator.columns)
    grid = level.grid
    precisions = estimator.precisions(level, 1, weight)
    pressure = linear[-1]
    region = dilated(pressure >= max(policy.work.likely * float(pressure.max()), 1e-300), 1).ravel()
    region[int(np.argmax(pressure))] = True
    start = linear.reshape(len(linear), -1)
    if near is not None and near[-1].any():
        start = near
    slope = estimator.misfit_gradient(y, noise, observed)
    reference = estimator.quiet(y) * float(np.abs(slope).max())
    alone = not estimator.cone.coupled  # whether the pressure of a cell does not depend on its shear
    for _ in range(policy.work.cell_rounds):
        cells = np.flatnonzero(region)
        data = estimator.normal(level, cells, y, noise, observed, once=True)
        tolerance = TOLERANCE
        if data.at_size:
            tolerance = FIRST_AT_SIZE
        else:
            estimator.check_size(len(cells) * components)
        member = estimator.model(data, precisions, start[:, cells], keep_face=keep_face, tolerance=tolerance)
        traction = np.zeros((components, math.prod(grid.shape)))
        traction[:, cells] = member.solution.traction
        explained = estimator.explained_by(traction)
        # A cell outside the region is missing if pressure there would lower the objective.
        slope = estimator.misfit_gradient(y - explained / noise, noise, observed, last=alone)
        slope -= [q @ t for q, t in zip(precisions[-len(slope) :], traction[-len(slope) :])]
        pull = np.abs(estimator.cone.project(slope * estimator.cone.scales[-len(slope) :, None])[-1])
        pull[region] = 0.0
        # The edge of a weakly sensed contact would grow by a few cells for many rounds. Stop: the models add a margin
        # of their own.
        beside = dilated(region.reshape(grid.shape), 1).ravel()
        missing = pull > reference
        if not (missing & ~beside).any() and missing.sum() <= policy.work.missing_cells * region.sum():
            break
        # If Newton's method cycles, most of the surface is in contact. For a large surface, solve one problem over a
        # larger region instead of one per round.
        region |= missing | (data.at_size and member.solution.hard)
        start = traction
    return traction, explained, member
