"""Match the dots of a picture to those of the reference, even if they moved farther than their pitch.

The print does not tear, so that the displacement changes from dot to dot by less than half their distance. The match
starts with the largest set of dots that move continuously (far from the contact, where little moves), and adds the
others one by one, each at the place predicted by a plane through its neighbours' displacements.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

__all__ = ["Neighbours", "gradients", "matched", "predicted", "strained"]

Index = npt.NDArray[np.intp]

#: A dot matches within this fraction of the distance to its neighbours around its expected place.
REACH = 0.4
#: Largest change of displacement between neighbours, relative to their distance, in an intact print.
TORN = 0.5
#: Variants of the start set: how often to erode its edges, how many of the six nearest dots must move with a dot, the
#: strain that counts as a tear, and which set to use, the largest (0) or the next. (If most of a print moves by a
#: pitch, the dots at rest are the smaller set.)
TRIED = (
    (1, 0.8, TORN, 0),
    (2, 0.8, TORN, 0),
    (1, 0.5, TORN, 0),
    (1, 0.8, 0.75, 0),
    (0, 0.0, TORN, 1),
    (1, 0.5, TORN, 1),
)
#: Radii (in dot distances) around faults within which a match is repeated, and how many times.
ABOUT, MENDED = (1.1, 2.1, 3.1, 4.1), 4
#: Penalty for a dot without a match, in units of strain energy: as for six half-torn neighbours.
UNMATCHED = 6.0 * TORN**2


#: Number of nearest dots of each dot.
NEIGHBOURS = 8


class Neighbours:
    """The nearest dots of each dot at rest."""

    def __init__(self, positions: Floats) -> None:
        from scipy.spatial import cKDTree

        self.positions = positions
        distance, index = cKDTree(positions).query(positions, k=min(NEIGHBOURS + 1, len(positions)))
        self.distance, self.index = np.asarray(distance)[:, 1:], np.asarray(index)[:, 1:].astype(np.intp)
        self.pitch = float(np.median(self.distance[:, 0]))

    def around(self) -> npt.NDArray[np.bool_]:
        """Mask (n,) of dots with neighbours on all sides."""
        middle = self.positions[self.index].mean(axis=1) - self.positions
        return np.asarray(np.hypot(*middle.T) < 0.3 * self.pitch)


def predicted(near: Neighbours, displacement: Floats, dots: npt.ArrayLike) -> Floats:
    """Displacement (k, 2) of some dots from a plane through the known displacements of their neighbours (others NaN),
    weighted by distance.
    """
    return _plane(near, displacement, np.atleast_1d(np.asarray(dots, dtype=np.intp)), 0.3)[:, 0]


def gradients(near: Neighbours, displacement: Floats) -> Floats:
    """Gradient of displacement (dot, along, per), in the picture's axes, from the same plane; 0 with fewer than three
    known neighbours.
    """
    out = _plane(near, displacement, np.arange(len(displacement)), 0.01)[:, 1:] / near.pitch
    few = np.isfinite(displacement[near.index]).all(axis=2).sum(axis=1) < 3
    return np.where(few[:, None, None] | ~np.isfinite(out), 0.0, out).transpose(0, 2, 1)


def _plane(near: Neighbours, displacement: Floats, which: Index, stiff: float) -> Floats:
    """Displacement and its slopes per pitch (k, 1 and column and row, 2), from planes through the neighbours."""
    out = np.full((len(which), 3, 2), np.nan)
    index = near.index[which]
    known = np.asarray(np.isfinite(displacement[index]).all(axis=2))
    weight = known / (near.distance[which] + 0.1 * near.pitch) ** 2
    enough = known.sum(axis=1)
    some = enough > 0
    if not some.any():
        return out
    arms = (near.positions[index] - near.positions[which][:, None, :]) / near.pitch
    values = np.where(known[..., None], displacement[index], 0.0)
    design = np.concatenate([np.ones((*arms.shape[:2], 1)), arms], axis=2)
    normal = np.einsum("dni,dn,dnj->dij", design, weight, design)
    # A small stiffness of the slopes gives a mean if there are few neighbours or all on one side.
    scale = weight.sum(axis=1)
    normal[:, [1, 2], [1, 2]] += (stiff * scale)[:, None] / np.maximum(enough, 1)[:, None] + 1e-12
    right = np.einsum("dni,dn,dnk->dik", design, weight, values)
    out[some] = np.linalg.solve(normal[some], right[some])
    return out


def _torn(near: Neighbours, displacement: Floats, most: float = TORN) -> npt.NDArray[np.bool_]:
    """Mask of pairs (dot, neighbour) whose displacements differ by more than an intact print allows; False if one is
    unknown.
    """
    change = displacement[near.index] - displacement[:, None, :]
    return np.asarray(np.hypot(change[..., 0], change[..., 1]) > most * near.distance)


def _largest(near: Neighbours, displacement: Floats, torn: float = TORN, rank: int = 0) -> npt.NDArray[np.bool_]:
    """Mask of the largest set of dots that move continuously, or of the next (``rank``)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(displacement)
    good = np.asarray(np.isfinite(displacement).all(axis=1))
    tied = good[:, None] & good[near.index] & ~_torn(near, displacement, torn)
    # Use the nearest six only: others may lie across a tear.
    tied[:, 6:] = False
    rows, columns = np.nonzero(tied)
    graph = coo_array((np.ones(len(rows)), (rows, near.index[rows, columns])), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    size = np.bincount(label[good], minlength=count)
    return good & (label == int(np.argsort(-size, kind="stable")[min(rank, count - 1)]))


def matched(near: Neighbours, expected: Floats, found: Floats, *, usual: float = 0.0) -> Index:
    """For each dot of the reference, the index of its match in ``found`` (m, 2); -1 for none.

    ``expected``: likely displacement (n, 2) of each, such as that in the previous picture; NaN if unknown. ``usual``:
    the strain (`strained`) of the previous match: a first match with at most this strain is accepted.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.camera.matching import Neighbours, matched
    >>> rest = np.stack(np.meshgrid(np.arange(6) * 10.0, np.arange(5) * 10.0), -1).reshape(-1, 2)
    >>> now = rest * 1.15  # stretched: the last dot has moved by 8 and 6 pixels, nearer to where another was
    >>> bool((matched(Neighbours(rest), np.zeros_like(rest), now) == np.arange(30)).all())
    True
    """
    from scipy.spatial import cKDTree

    n = len(near.positions)
    if not len(found):
        return np.full(n, -1, dtype=np.intp)
    tree = cKDTree(found)
    best = _matched(near, expected, found, tree)
    lowest = strained(near, _moves(near, best, found))
    if lowest <= usual or ((best >= 0).all() and not _torn(near, _moves(near, best, found))[:, :6].any()):
        return best
    # A dot that moves by a pitch reaches another dot's place and agrees with the static dots around it: start with
    # fewer.
    for worn, beside, torn, rank in TRIED:
        other = _matched(near, expected, found, tree, worn, beside, torn, rank)
        cost = strained(near, _moves(near, other, found))
        if cost < lowest:
            best, lowest = other, cost
    return _loosened(near, _mended(near, best, found, tree), found)


def _mended(near: Neighbours, match: Index, found: Floats, tree: cKDTree) -> Index:
    """Repeat a match around its faults (dots without a match, and tears), with increasing radius, while this reduces
    the strain.
    """
    from scipy.spatial import cKDTree as Tree

    best, lowest = match, strained(near, _moves(near, match, found))
    for _ in range(MENDED):
        displacement = _moves(near, best, found)
        faults = (best < 0) | (_strain(near, displacement).max(axis=1) > (0.8 * TORN) ** 2)
        if not faults.any() or faults.all():
            break
        far, _ = Tree(near.positions[faults]).query(near.positions)
        before = lowest
        for reach in ABOUT:
            trial = np.where((far > reach * near.pitch)[:, None], displacement, np.nan)
            kept = _largest(near, trial)
            if kept.sum() < 3:
                break
            trial[~kept] = np.nan
            out = np.where(kept, best, -1)
            owner = np.full(len(found), -1, dtype=np.intp)
            owner[out[kept]] = np.flatnonzero(kept)
            _grow(near, trial, out, owner, tree, found, TORN)
            cost = strained(near, _moves(near, out, found))
            if cost < lowest:
                best, lowest = out, cost
        if lowest >= before:
            break
    return best


def _matched(
    near: Neighbours,
    expected: Floats,
    found: Floats,
    tree: cKDTree,
    worn: int = 0,
    least: float = 0.0,
    torn: float = TORN,
    rank: int = 0,
) -> Index:
    """One-to-one match near the expected places: the largest set of dots that move continuously, then extended.

    ``worn`` times the dots at the set's edges are removed, with which less than the fraction ``least`` of their
    neighbours move.
    """
    n = len(near.positions)
    out = np.full(n, -1, dtype=np.intp)
    start = np.where(np.isfinite(expected), expected, 0.0)
    at = near.positions + start
    distance, nearest = tree.query(at)
    # Mutual matches only: two dots cannot be one.
    order = np.argsort(distance)
    taken = np.zeros(len(found), dtype=bool)
    first = np.zeros(n, dtype=bool)
    for i in order:
        if distance[i] < REACH * near.pitch and not taken[nearest[i]]:
            taken[nearest[i]] = first[i] = True
    displacement = np.full((n, 2), np.nan)
    displacement[first] = found[nearest[first]] - near.positions[first]
    kept = _largest(near, displacement, torn, 0 if worn else rank)
    # A dot is wrong if its neighbours agree on another displacement.
    for _ in range(2):
        trial = np.where(kept[:, None], displacement, np.nan)
        off = trial - predicted(near, trial, np.arange(n))
        kept &= ~(np.hypot(off[:, 0], off[:, 1]) > REACH * near.pitch)
    for _ in range(worn):
        trial = np.where(kept[:, None], displacement, np.nan)
        beside = kept[near.index[:, :6]] & ~_torn(near, trial, torn)[:, :6]
        core = kept & (beside.mean(axis=1) > least)
        if core.sum() < 3:
            break
        kept = _largest(near, np.where(core[:, None], displacement, np.nan), torn, rank)
    out[kept] = nearest[kept]
    displacement[~kept] = np.nan
    owner = np.full(len(found), -1, dtype=np.intp)
    owner[out[kept]] = np.flatnonzero(kept)
    _grow(near, displacement, out, owner, tree, found, torn)
    return out


def _moves(near: Neighbours, match: Index, found: Floats) -> Floats:
    """Displacement (n, 2) of each dot by its match; NaN without a match."""
    return np.where((match >= 0)[:, None], found[match] - near.positions, np.nan)


def _strain(near: Neighbours, displacement: Floats) -> Floats:
    """Squared change of displacement over distance, from each dot to its six nearest (n, 6), at most 1; 0 if one is
    unknown.
    """
    change = displacement[near.index[:, :6]] - displacement[:, None, :]
    part = np.hypot(change[..., 0], change[..., 1]) / near.distance[:, :6]
    return np.nan_to_num(np.minimum(part, 1.0) ** 2)


def strained(near: Neighbours, displacement: Floats) -> float:
    """Strain energy of displacements (n, 2), with a penalty for each lost dot (NaN)."""
    lost = np.count_nonzero(np.isnan(displacement[:, 0]))
    return float(0.5 * _strain(near, displacement).sum() + UNMATCHED * lost)


def _loosened(near: Neighbours, match: Index, found: Floats) -> Index:
    """Remove matches that strain the print more than a missing match costs."""
    out = match.copy()
    for _ in range(len(out)):
        pull = _strain(near, _moves(near, out, found)).sum(axis=1)
        worst = int(np.argmax(pull))
        if pull[worst] <= UNMATCHED:
            break
        out[worst] = -1
    return out


def _grow(
    near: Neighbours, displacement: Floats, out: Index, owner: Index, tree: cKDTree, found: Floats, torn: float
) -> None:
    """Match the remaining dots, starting with those that have the most matched neighbours."""
    tried = np.zeros(len(out), dtype=np.int64)
    while True:
        known = (out[near.index[:, :6]] >= 0).sum(axis=1)
        ready = (out < 0) & (known >= 2) & (known > tried)
        if not ready.any():
            return
        best = known[ready].max()
        now = np.flatnonzero(ready & (known == best))
        tried[now] = best
        guess = near.positions[now] + predicted(near, displacement, now)
        distance, nearest = tree.query(guess)
        for i, d, j in zip(now, distance, nearest):
            move = found[j] - near.positions[i] if d < REACH * near.pitch else None
            if move is None or owner[j] >= 0 or _tears(near, displacement, int(i), move, torn):
                continue
            out[i], owner[j] = j, i
            displacement[i] = move


def _tears(near: Neighbours, displacement: Floats, dot: int, move: Floats, torn: float) -> bool:
    """Whether this displacement would tear the print from most of the known neighbours."""
    others = displacement[near.index[dot]]
    known = np.isfinite(others).all(axis=1)
    change = np.hypot(*(others[known] - move).T)
    return bool(np.mean(change > torn * near.distance[dot][known]) > 0.5)
