"""Load between shallow taxels that no reading would show.

A taxel much shallower than the pitch feels only what is above it. The pressure between such taxels is a guess of the
prior, and the edge of a contact may be anywhere between a loaded taxel and the next.
"""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.screening import shallow

__all__ = ["load_in_gaps"]


def load_in_gaps(prepared: PreparedContact, run: Solved, traction: Floats) -> Floats:
    """Force (component,) that a contact may have in addition to a traction (component, *grid), hidden between taxels.

    It is the largest force of any pressure that is no larger than the peak found, ends at the middle between a loaded
    taxel and the next, and changes no reading by more than ``policy.errors.felt`` times the noise (a linear program).
    Shear may grow by the same factor. Zero for arrays that are not shallow; for displacements, which reach far; and for
    large contacts, whose edge is a small part of them.
    """
    import scipy.optimize
    import scipy.spatial

    policy, operator = prepared.policy, prepared.operator
    grid, pressure = operator.surface, traction[-1].ravel()
    peak, none = float(pressure.max(initial=0.0)), np.zeros(len(traction))
    if not peak > 0.0 or prepared.far or not shallow(operator.planes_of, policy).all():
        return none
    taxels = np.concatenate([a.points[a.valid.ravel()] for a in operator.planes_of])
    places = np.stack([x.ravel() for x in np.meshgrid(*grid.axes, indexing="ij")[::-1]], axis=1)
    load = pressure > policy.extent.faint * peak
    nearest = scipy.spatial.cKDTree(taxels).query(places)[1]
    loaded = np.zeros(len(taxels), dtype=bool)
    loaded[nearest[load]] = True
    cells = np.flatnonzero((load | loaded[nearest]) & ~prepared.outside.ravel())
    if not 0 < len(cells) <= policy.errors.gap_cells:
        return none
    felt = operator.columns([prepared.columns[-1]], cells)[run.observed, 0] / run.noise[run.observed, None]
    rows = (np.abs(felt).max(axis=1) * peak * len(cells)) > policy.errors.felt
    areas = grid.areas.ravel()[cells]
    allowed = np.full(int(rows.sum()), policy.errors.felt) + felt[rows] @ pressure[cells]
    changed = allowed - 2.0 * policy.errors.felt
    found = scipy.optimize.linprog(
        -areas,
        A_ub=np.concatenate([felt[rows], -felt[rows]]),
        b_ub=np.concatenate([allowed, -changed]),
        bounds=(0.0, peak),
        method="highs",
    )
    now = float(areas @ pressure[cells])
    if found.x is None or not now > 0.0:
        return none
    return np.abs(grid.total_force(traction)) * max(float(areas @ found.x) / now - 1.0, 0.0)
