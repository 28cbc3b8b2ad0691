"""Taxels of turned sign and swapped taxels, as labelled presses show them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.elastic.pad import Floats

if TYPE_CHECKING:
    from palpate.calibrate.labels import Labelled

__all__ = ["reading_names", "wrong_wiring"]

#: Frames with more than these fractions of the largest force, or of the largest readings, are used.
STRONG_FORCE, STRONG_READINGS = 0.3, 0.1
#: Few taxels: a reading has a sign if a fraction AGREED of its TOP strongest responses has this sign; at most a fraction TURNED of the taxels is
#: turned.
TOP, AGREED, TURNED = 0.25, 0.95, 0.25
#: Many taxels, from TAXELS[0] to TAXELS[1] (more take long), are compared with their neighbours, with this many presses
#: or more.
PRESSES, TAXELS = 15, (9, 100)
#: A change of the order or of a sign is named if it raises the rank correlation by GAIN to BEST or more, and by MARGIN more
#: than any other. On 10 half-spaces with 20 to 100 presses the largest gain without a fault was 0.04, that of a swap
#: inside the array 0.09 to 0.4.
GAIN, BEST, MARGIN = 0.08, 0.65, 0.03


def reading_names(skin: Any) -> list[str]:
    """Return the name of each reading of a frame, in the order of `flat_readings`."""
    return [
        f"{c} of taxel {i}"
        for plane in skin.planes
        for c in plane.channels
        for i in np.flatnonzero(plane.valid.ravel())
    ]


def normal_channels(skin: Any) -> Iterator[tuple[Floats, slice]]:
    """Yield the places of the taxels of each channel of normal stress, strain or displacement, and its readings."""
    start = 0
    for plane in skin.planes:
        count = int(plane.valid.sum())
        for channel in plane.channels:
            if channel.rpartition("_")[2] in ("z", "zz"):
                yield plane.points[plane.valid.ravel()], slice(start, start + count)
            start += count


def wrong_wiring(skin: Any, data: Labelled) -> list[str]:
    """Return sentences on taxels with a reversed sign, and on pairs of taxels that are swapped.

    Many taxels are compared with their neighbours (`neighbours`); of few, the signs of the strongest responses to a force are
    compared. Signs that look reversed are corrected before the search for swaps.
    """
    names, found = reading_names(skin), []
    for places, readings in normal_channels(skin):
        own, values = names[readings], data.flat[:, readings].copy()
        turned = turned_taxels(data, places, values)
        if turned:
            found.append(
                f"{', '.join(own[i] for i in turned)}: the sign looks opposite to that of the other taxels. Reverse the sign of the column, or check the wiring"
            )
            values[:, turned] *= -1.0
        pair = swapped_taxels(data, places, values)
        if pair:
            found.append(
                f"{' and '.join(own[i] for i in pair)} look swapped: each responds like the neighbours of the other. Check the order of the columns"
            )
    return found


def turned_taxels(data: Labelled, places: Floats, values: Floats) -> list[int]:
    """Return the taxels whose readings ``values`` (label, taxel) have the opposite sign of the others: under a press all
    normal readings have one sign.
    """
    if len(places) < TAXELS[0]:
        return few_turned(data, values)
    many = neighbours(data, places, values)
    if many is None:
        return []
    alike, apart = many
    scores = []
    for i in range(len(places)):
        sign = np.ones(len(places))
        sign[i] = -1.0
        scores.append((float((ranks(alike * np.outer(sign, sign)) * apart).sum()), [i]))
    return best_change(float((ranks(alike) * apart).sum()), scores)


def few_turned(data: Labelled, values: Floats) -> list[int]:
    """Return the taxels that respond to a force with the opposite sign; none if not all have a sign."""
    force = data.known.get("fz", np.zeros(0))
    at = np.flatnonzero(np.isfinite(force) & (np.abs(force) > STRONG_FORCE * np.nanmax(np.abs(force), initial=0.0)))
    top = max(3, round(TOP * len(at)))
    if len(at) < top:
        return []
    response = values[at] / force[at, None]
    order = np.argsort(-np.abs(response), axis=0)[:top]
    sign = np.sign(np.take_along_axis(response, order, axis=0)).mean(axis=0)
    if len(sign) < 3 or not (np.abs(sign) >= AGREED).all():
        return []
    turned = np.flatnonzero(sign < 0.0 if (sign > 0.0).sum() >= (sign < 0.0).sum() else sign > 0.0)
    return [int(i) for i in turned] if len(turned) <= TURNED * len(sign) else []


def swapped_taxels(data: Labelled, places: Floats, values: Floats) -> list[int]:
    """Return two taxels whose readings ``values`` (label, taxel) resemble those of their neighbours only if they are swapped."""
    many = neighbours(data, places, values)
    if many is None:
        return []
    alike, apart = ranks(many[0]), many[1]
    usual, scores = float((alike * apart).sum()), []
    for i, j in itertools.combinations(range(len(places)), 2):
        # a swap changes two rows and columns
        others = np.delete(np.arange(len(places)), [i, j])
        change = (alike[i, others] - alike[j, others]) @ (apart[j, others] - apart[i, others])
        scores.append((usual + 2.0 * float(change), [i, j]))
    return best_change(usual, scores)


def best_change(usual: float, scores: list[tuple[float, list[int]]]) -> list[int]:
    """Return the taxels of the change with the highest rank correlation, or none if it is not far above the usual one
    and the others.
    """
    (best, taxels), second = sorted(scores, reverse=True)[:2]
    clear = best - usual >= GAIN and best >= BEST and best - second[0] >= MARGIN
    return taxels if clear else []


def neighbours(data: Labelled, places: Floats, values: Floats) -> tuple[Floats, Floats] | None:
    """Return the correlation of the readings of two taxels over presses, of frames scaled to one size, and the ranks of how
    close they are. None if taxels or presses are too few.

    Neighbouring taxels respond to the same presses, so they have a high rank correlation on any pad.
    """
    size = np.sqrt((values**2).sum(axis=1))
    strong = size > STRONG_READINGS * size.max()
    if not TAXELS[0] <= len(places) <= TAXELS[1] or len(np.unique(data.press[strong])) < PRESSES:
        return None
    values = values[strong] / size[strong, None]
    power = np.sqrt((values**2).mean(axis=0))
    if not power.all():
        return None
    alike = values.T @ values / np.outer(power, power)
    return alike, ranks(-np.linalg.norm(places[:, None] - places[None], axis=2))


def ranks(matrix: Floats) -> Floats:
    """Return the ranks of the pairs of a symmetric matrix, with mean 0 over the pairs and 1 as the sum of squares of the matrix;
    0 on the diagonal.
    """
    from scipy.stats import rankdata

    upper = np.triu_indices(len(matrix), 1)
    rank = rankdata(np.round(matrix[upper], 12))
    rank = rank - rank.mean()
    out = np.zeros_like(matrix)
    out[upper] = rank / max(float(np.sqrt(2.0 * (rank**2).sum())), 1e-30)
    return np.asarray(out + out.T)
