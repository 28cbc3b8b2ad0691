"""Initial sizes of offsets and ramps, estimated from taxels without load, and their upper limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats
from palpate.inverse.contact.drift import reach_of_kind
from palpate.inverse.contact.prepared import PreparedContact
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.nuisance import AT_EDGE, Nuisance

__all__ = [
    "edge_levels",
    "in_range",
    "largest_part",
    "lowest_levels",
    "outermost_of",
    "reach",
    "sizes_at_edge",
    "touched",
]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]


def edge_levels(estimator: PreparedContact, data: Floats, observed: Flags) -> list[Floats]:
    """Candidate initial sizes of offsets, from the outermost taxels; 0 for other nuisances."""
    terms = estimator.terms
    starts = [np.zeros(len(terms)) for _ in range(3 if estimator.operator.surface.dimensions == 1 else 1)]
    for i, term in enumerate(terms):
        if term.kind != "offset":
            continue
        array, place = touched(estimator, term)
        here = observed[place]
        if here.any():
            points = array.points[array.valid.ravel()][here]
            levels = _levels_of(data[place][here], points, _margin(estimator, array))
            for start, level in zip(starts, levels):
                start[i] = level
    return [s for k, s in enumerate(starts) if not any(np.array_equal(s, before) for before in starts[:k])]


def lowest_levels(estimator: PreparedContact, data: Floats, observed: Flags, sign: int) -> list[Floats]:
    """Candidate initial sizes of offsets on a line whose contacts reach its ends (at most one): the lowest reading of
    neighbours between them. Valid if contact of this sign makes no reading negative and the ends read more.
    """
    if estimator.far or estimator.operator.surface.dimensions > 1:
        return []
    start = np.zeros(len(estimator.terms))
    for i, term in enumerate(estimator.terms):
        if term.kind != "offset":
            continue
        array, place = touched(estimator, term)
        here = observed[place]
        points = array.points[array.valid.ravel()][here]
        values = sign * data[place][here][np.argsort(points[:, 0])]
        width = 2 * max(1, min(2, len(values) // 6))
        if len(values) > 2 * width:
            least = float(np.convolve(values, np.full(width, 1.0 / width), mode="valid").min())
            ends = min(float(values[: width // 2].mean()), float(values[-(width // 2) :].mean()), 0.0)
            start[i] = sign * least if least < ends else 0.0
    return [start] if start.any() else []


def sizes_at_edge(estimator: PreparedContact, data: Floats, observed: Flags) -> Floats:
    """Initial sizes of nuisances of the kinds `AT_EDGE` together, fitted to the outermost taxels by least squares; 0
    for others.
    """
    terms = estimator.terms
    sizes = np.zeros(len(terms))
    for array, place in _channels(estimator):
        points = array.points[array.valid.ravel()]
        if points.shape[1] == 1:
            k = max(1, min(2, len(points) // 6))
            order = np.argsort(points[:, 0])
            edge = np.isin(np.arange(len(points)), [*order[:k], *order[-k:]])
        else:
            edge = outermost_of(points, _margin(estimator, array))
        edge &= observed[place]
        of = [j for j, t in enumerate(terms) if t.kind in AT_EDGE and t.rows[place].any()]
        if not of or edge.sum() < len(of):
            continue
        rows = np.stack([terms[j].rows[place][edge] for j in of], axis=1)
        scale = np.abs(rows).max(axis=0)
        sizes[of] = np.linalg.lstsq(rows / scale, data[place][edge], rcond=1e-9)[0] / scale
    return sizes


def in_range(estimator: PreparedContact, columns: Floats, sizes: Floats, data: Floats) -> bool:
    """Whether nuisances are small enough for a sensor that was zeroed: one as large as the readings is not an offset."""
    return not largest_part(estimator, columns, sizes, data) > estimator.policy.explanations.largest_nuisance


def largest_part(estimator: PreparedContact, columns: Floats, sizes: Floats, data: Floats) -> float:
    """Size of the largest nuisance as a part of the largest reading of its kind without them; 0 of those that have no
    datum (`_without_datum`).
    """
    largest = np.maximum(reach_of_kind(estimator, columns, data - columns @ sizes), 1e-300)
    return float((np.abs(sizes) / largest)[~_without_datum(estimator, columns)].max(initial=0.0))


def _without_datum(estimator: PreparedContact, columns: Floats) -> Flags:
    """Which nuisances are displacements of a line on a pad without a base: in two dimensions they grow as log r, so
    that only differences between taxels mean something, and a shift of any size is no fault of the sensor.
    """
    operator = estimator.operator
    if operator.pad.thickness is not None:
        return np.zeros(columns.shape[1], dtype=bool)
    free = np.concatenate(
        [
            np.full(int(a.valid.sum()), a.points.shape[1] == 1 and find_channel(c).kind.absolute)
            for a in operator.planes_of
            for c in a.channels
        ]
    )
    return np.array([bool(free[c != 0].all()) for c in columns.T])


def reach(columns: Floats, data: Floats) -> Floats:
    """Size at which each nuisance makes readings as large as the largest reading that it affects."""
    return np.array(
        [np.abs(data[c != 0]).max(initial=0.0) / max(float(np.abs(c).max(initial=0.0)), 1e-300) for c in columns.T]
    )


def touched(estimator: PreparedContact, term: Nuisance) -> tuple[Array, Index]:
    """The array of an offset, and the indices of the readings of its channel."""
    return next((array, place) for array, place in _channels(estimator) if term.rows[place].any())


def _channels(estimator: PreparedContact) -> Iterator[tuple[Array, Index]]:
    """The array of each channel of each plane, and the indices of the channel's readings."""
    start = 0
    for array in estimator.operator.planes_of:
        n = int(array.valid.sum())
        for _ in array.channels:
            yield array, np.arange(start, start + n)
            start += n


def _levels_of(values: Floats, points: Floats, margin: float) -> list[float]:
    """Candidate offsets of one channel, from its outermost taxels. On a line: the end that reads less, then each end.
    Shear acts far along a line and in opposite directions at its ends, so that the end that reads less is farther from
    the contact.
    """
    if points.shape[1] == 1:
        order = np.argsort(points[:, 0])
        k = max(1, min(2, len(values) // 6))
        ends = [float(values[order[:k]].mean()), float(values[order[-k:]].mean())]
        return [min(ends, key=abs), *ends]
    return [float(np.median(values[outermost_of(points, margin)]))]


def _margin(estimator: PreparedContact, array: Array) -> float:
    """Fraction of an array's extent within which taxels are outermost."""
    return estimator.policy.explanations.outermost if isinstance(array, ScatteredArray) else 1e-6


def outermost_of(points: Floats, margin: float) -> Flags:
    """Mask of the taxels of an area within the fraction ``margin`` of its extent from an edge."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.asarray(np.any((points - low < margin * (high - low)) | (high - points < margin * (high - low)), axis=1))
