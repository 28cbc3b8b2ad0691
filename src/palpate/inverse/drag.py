"""Distribution of shear over a contact that is dragged and partly sticks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.elastic.pad import Floats

__all__ = ["STICK", "sheared"]

#: Candidate radii of the sticking part, as fractions of the contact's radius: about evenly spaced in Q/(mu P) = 1 -
#: s^3.
STICK = np.array([0.0, 0.3, 0.45, 0.55, 0.65, 0.72, 0.79, 0.85, 0.9, 0.94, 0.97, 0.99])


def sheared(pressure: Floats, sticks: Sequence[float] | Floats) -> Floats:
    """Shear over friction (candidate, *surface) of a contact with this pressure, whose part within ``s`` of the radius
    sticks:

    q / mu = p(x) - s p(x / s)

    about the centre of pressure (M. Ciavarella, J. Appl. Mech. 65, 1998, 998-1003; `palpate.grasp`).
    """
    import scipy.ndimage

    total = float(pressure.sum())
    centers = [
        float((np.arange(n) * pressure.sum(axis=tuple(a for a in range(pressure.ndim) if a != axis))).sum()) / total
        for axis, n in enumerate(pressure.shape)
    ]
    places = np.indices(pressure.shape).astype(np.float64)
    out = np.repeat(pressure[None].astype(np.float64), len(sticks), axis=0)
    for q, s in zip(out, sticks):
        if s > 0:
            scaled = [c + (x - c) / s for c, x in zip(centers, places)]
            q -= s * scipy.ndimage.map_coordinates(pressure, scaled, order=1, mode="constant")
    return out
