"""Group nearby eigenvalues, to speed up sums over them for many parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse

from palpate.elastic.pad import Floats

__all__ = ["lumps"]

#: Up to this many eigenvalues are not grouped.
MAX_SINGLE_EIGENVALUES = 400
#: Nodes per decade for larger spectra: cubic interpolation of 1/(1 + s^2/lambda) is then accurate to 2e-6 of its value.
PER_DECADE = 24


def lumps(eigenvalues: Floats) -> tuple[Floats, Any]:
    """Nodes (m,) and weights (m, n), sparse, with sum_i f(s_i^2) x_i = sum_j f(node_j) (weights x)_j for functions smooth in log s^2.

    Cubic interpolation between nodes evenly spaced in log s^2. Eigenvalues of 0 have no weight: no reading depends on them.
    """
    n = len(eigenvalues)
    places = np.flatnonzero(eigenvalues > 0)
    if n <= MAX_SINGLE_EIGENVALUES or len(places) < 4:
        return eigenvalues, scipy.sparse.eye_array(n, format="csr")
    x = np.log(eigenvalues[places])
    step = np.log(10.0) / PER_DECADE
    low = x.min() - step
    count = int(np.ceil((x.max() - low) / step)) + 3
    nodes = np.exp(low + step * np.arange(count))
    u = (x - low) / step
    first = np.clip(np.floor(u).astype(int), 1, count - 3)
    t = u - first
    parts = np.stack(
        [
            -t * (t - 1) * (t - 2) / 6,
            (t + 1) * (t - 1) * (t - 2) / 2,
            -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6,
        ]
    )
    rows = first[None, :] + np.array([-1, 0, 1, 2])[:, None]
    columns = np.broadcast_to(places, rows.shape)
    weights = scipy.sparse.csr_array((parts.ravel(), (rows.ravel(), columns.ravel())), shape=(count, n))
    return nodes, weights
