"""Misfit probability from the size and the whiteness of the residual."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.sensing.arrays import Array, ScatteredArray

__all__ = [
    "DISCREPANCY",
    "MIN_DEGREES",
    "MODEL_DETAIL",
    "POOR_FIT",
    "PROVEN",
    "Pairs",
    "misfit_probability",
    "neighbours",
    "rms",
    "unfitted",
]

Pairs = tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]

#: Residual that cells of finite size and the penalty cause, as a fraction of the largest reading, correlated between
#: taxels, even if the contact model is exact (the largest seen on lines and areas without noise;
#: tests/inverse/test_fit.py). A smaller residual is no misfit.
MODEL_DETAIL = 2e-3
#: A frame is reported as a poor fit below this misfit probability: one good frame in a hundred.
POOR_FIT = 0.01
#: Misfit probability above which noise alone counts as proven. One frame of noise in ten is below it and gets wider
#: intervals. Also below it were three of four wide contacts on thin layers that were taken for noise (0.05 to 0.09),
#: and a ball that changed two of 252 readings, with given noise (0.012).
PROVEN = 0.1
#: Default root mean square of the model error of a pad, as a fraction of the readings. Published recordings of six real
#: skins with a force sensor have 2 to 30 % (`benchmarks/real.py`).
DISCREPANCY = 0.15
#: With fewer pairs of neighbours, or degrees of freedom, a test is not meaningful.
MIN_DEGREES = 6


def rms(values: Floats) -> float:
    """Root mean square; 0 of no values."""
    return math.sqrt(float(np.mean(np.square(values)))) if np.size(values) else 0.0


def unfitted(residual: Floats, columns: Floats) -> Floats:
    """The residual (reading,) without the part that the ``columns`` (reading, unknown) can explain."""
    return np.asarray(residual - columns @ np.linalg.lstsq(columns, residual, rcond=1e-8)[0])


def neighbours(planes: Sequence[Array]) -> Pairs:
    """Pairs of readings of one channel at neighbouring taxels, as rows of the operator."""
    import scipy.spatial

    first: list[npt.NDArray[np.intp]] = []
    second: list[npt.NDArray[np.intp]] = []
    start = 0
    for array in planes:
        points = array.points[array.valid.ravel()]
        n = len(points)
        if n > 1:
            tree = scipy.spatial.cKDTree(points)
            near = float(np.median(tree.query(points, k=2)[0][:, 1]))
            # Neighbours along the axes and diagonals; for scattered taxels, those about as near.
            reach = (1.6 if isinstance(array, ScatteredArray) else 1.5) * near
            pairs = tree.query_pairs(reach, output_type="ndarray")
            for channel in range(len(array.channels)):
                first.append(pairs[:, 0] + start + channel * n)
                second.append(pairs[:, 1] + start + channel * n)
        start += n * len(array.channels)
    if not first:
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    return np.concatenate(first), np.concatenate(second)


def misfit_probability(
    residual: Floats,
    observed: npt.NDArray[np.bool_],
    pairs: Pairs,
    *,
    taken: float,
    known: bool,
    detail: float = 0.0,
    others: Sequence[float] = (),
    channels: npt.NDArray[np.intp] | None = None,
) -> float:
    """Probability of at least this misfit if the model is right; NaN with too few degrees of freedom.

    Parameters
    ----------
    residual : array (reading,)
        Residuals in units of the noise (0 if nothing was observed).
    observed : array (reading,) of bool
    pairs : two arrays (pair,)
        Readings that are neighbours (`neighbours`).
    taken : float
        Degrees of freedom that the contact took.
    known : bool
        Whether the noise was given: its size is then tested too, by chi^2.
    detail : float
        Error of the model itself, in units of the noise.
    others : sequence of float
        Probabilities of other tests: the least of all counts, times their number (Bonferroni).
    channels : array (reading,) of int, optional
        Channel of each reading. Whiteness is then also tested with every channel divided by the size of its residual,
        and the larger z counts, so that the noise of a loud channel does not hide the order of a quiet one.

    Notes
    -----
    Whiteness is tested by the products of neighbours: if the residual is noise, their signs are random, and z = sum r_i r_j / sqrt(sum r_i^2 r_j^2)
    is standard normal for any size and tails of the noise (a sign-flip form of Moran's I; P.
    A. P. Moran, Biometrika 37, 1950, 17-23). The degrees of freedom of the contact make z smaller, never larger.
    """
    import scipy.special

    tests = list(others)
    free = float(observed.sum()) - taken
    i, j = pairs
    both = observed[i] & observed[j]
    i, j = i[both], j[both]
    if len(i) >= MIN_DEGREES and free >= MIN_DEGREES:
        size = residual**2 + detail**2
        products, sizes = residual[i] * residual[j], size[i] * size[j]
        z = float(products.sum()) / max(math.sqrt(float(sizes.sum())), 1e-300)
        if channels is not None:
            count = np.maximum(np.bincount(channels, observed), 1.0)
            level = np.maximum(np.bincount(channels, size * observed) / count, 1e-150)[channels[i]]
            z = max(z, float((products / level).sum()) / max(math.sqrt(float((sizes / level**2).sum())), 1e-300))
        tests.append(0.5 * math.erfc(z / math.sqrt(2.0)))
    if known and free >= 1.0:
        left = float((residual[observed] ** 2).sum()) / (1.0 + detail**2)
        tests.append(float(scipy.special.gammaincc(0.5 * free, 0.5 * left)))
    return min(1.0, len(tests) * min(tests)) if tests else math.nan
