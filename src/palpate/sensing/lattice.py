"""Find the regular grid of printed dots, if they form one."""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["lattice", "typical_distance"]


def typical_distance(points: Floats) -> float:
    """Median distance to the nearest neighbour, of points (n, 2)."""
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return float("inf")
    return float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))


def lattice(points: Floats) -> tuple[Floats, Floats]:
    """The two steps (column, row) of a grid of points (n, 2), averaged over the whole grid; the first is along the
    picture's columns.

    Raises
    ------
    InvalidInput
        Fewer than nine points, or most of them on no grid.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.lattice import lattice
    >>> points = np.stack(np.meshgrid(np.arange(5) * 30.0, np.arange(4) * 20.0), -1).reshape(-1, 2)
    >>> [step.round(6).tolist() for step in lattice(points)]
    [[30.0, 0.0], [0.0, 20.0]]
    """
    from scipy.spatial import cKDTree

    if len(points) < 9:
        raise InvalidInput(f"a grid needs nine dots or more; got {len(points)}. Give a scale or four points instead.")
    tree = cKDTree(points)
    _, near = tree.query(points, k=min(9, len(points)))
    moves = (points[near[:, 1:]] - points[:, None, :]).reshape(-1, 2)
    steps = []
    for axis in (0, 1):
        along = moves[np.abs(moves[:, axis]) > 1.7 * np.abs(moves[:, 1 - axis])]
        along = along * np.sign(along[:, axis : axis + 1])
        if len(along) < 4:
            raise InvalidInput(
                "the dots form no grid with rows along the picture: give a scale or four points instead."
            )
        size = np.hypot(*along.T)
        first = np.quantile(size, 0.1)
        steps.append(np.median(along[size < 1.4 * first], axis=0))
    basis = np.column_stack(steps)
    start = points[np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1))]
    for _ in range(5):
        index = np.round(np.linalg.solve(basis, (points - start).T).T)
        design = np.column_stack([index, np.ones(len(points))])
        found, *_ = np.linalg.lstsq(design, points, rcond=None)
        basis, start = found[:2].T, found[2]
        left = np.hypot(*(points - design @ found).T)
    if np.mean(left < 0.25 * np.hypot(*basis).min()) < 0.8:
        raise InvalidInput("the dots form no regular grid: give a scale or four points instead.")
    return np.asarray(basis[:, 0]), np.asarray(basis[:, 1])
