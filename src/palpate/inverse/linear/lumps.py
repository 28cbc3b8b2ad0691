"""Group nearby eigenvalues, to speed up sums over them for many parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate.elastic.pad import Floats

__all__ = ["cubic_weights", "lumps"]

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
    return np.exp(low + step * np.arange(count)), cubic_weights((x - low) / step, places, count, n)


def cubic_weights(x: Floats, places: npt.NDArray[np.intp], nodes: int, n: int) -> Any:
    """Sparse weights (node, n) of cubic interpolation between the nodes 0, 1, ...: entry ``places[i]`` lies at ``x[i]``."""
    first = np.clip(np.floor(x).astype(int) - 1, 0, nodes - 4)
    t = x - first
    parts = np.stack(
        [
            -(t - 1) * (t - 2) * (t - 3) / 6,
            t * (t - 2) * (t - 3) / 2,
            -t * (t - 1) * (t - 3) / 2,
            t * (t - 1) * (t - 2) / 6,
        ]
    )
    rows = first + np.arange(4)[:, None]
    columns = np.broadcast_to(places, rows.shape)
    return scipy.sparse.csr_array((parts.ravel(), (rows.ravel(), columns.ravel())), shape=(nodes, n))
