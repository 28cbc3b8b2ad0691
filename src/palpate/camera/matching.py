"""Which dot is which: those of one picture matched to those of the reference, across moves that are longer than the pitch.

Neighbours have similar displacements, because the print does not tear: the displacement changes from dot to dot by less than half their distance. So
the match starts with the largest set of dots that move continuously (far from the contact, where little moves), and adds the others one by one, each
at the place that a plane through its neighbours' displacements predicts.
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

#: A dot matches within this part of the distance to its neighbours round its expected place.
REACH = 0.4
#: Change of displacement between neighbours, over their distance, that an unbroken print can have.
TORN = 0.5
#: Variants of the start set: how often to erode its edges, how many of the six nearest must move with a dot, the strain that tears the print, and
#: which set, the largest (0) or the next: if most of a print moves by a pitch, the dots that stay are fewer.
TRIED = (
    (1, 0.8, TORN, 0),
    (2, 0.8, TORN, 0),
    (1, 0.5, TORN, 0),
    (1, 0.8, 0.75, 0),
    (0, 0.0, TORN, 1),
    (1, 0.5, TORN, 1),
)
#: Radius (in dot distances) round faults within which a match restarts, and how often.
ABOUT, MENDED = (1.1, 2.1, 3.1, 4.1), 4
#: Penalty of a dot without a match, in units of strain: as much as six half-torn neighbours.
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
        """Dots (n,) that have neighbours on all sides."""
        middle = self.positions[self.index].mean(axis=1) - self.positions
        return np.asarray(np.hypot(*middle.T) < 0.3 * self.pitch)


def predicted(near: Neighbours, displacement: Floats, dots: npt.ArrayLike) -> Floats:
    """Displacement (k, 2) of some dots from that of their neighbours: a plane through the known ones (others NaN), weighted by distance."""
    return _plane(near, displacement, np.atleast_1d(np.asarray(dots, dtype=np.intp)), 0.3)[:, 0]


def gradients(near: Neighbours, displacement: Floats) -> Floats:
    """Change of displacement (dot, along, per) over a distance, in the picture's axes, by the same plane; 0 where fewer than three neighbours are known."""
    out = _plane(near, displacement, np.arange(len(displacement)), 0.01)[:, 1:] / near.pitch
    few = np.isfinite(displacement[near.index]).all(axis=2).sum(axis=1) < 3
    return np.where(few[:, None, None] | ~np.isfinite(out), 0.0, out).transpose(0, 2, 1)


def _plane(near: Neighbours, displacement: Floats, which: Index, stiff: float) -> Floats:
    """Displacement and its slopes over a pitch (k, 1 and column and row, 2) of planes through neighbours."""
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
    # a small stiffness of the slopes: a mean if neighbours are few or on one side
    scale = weight.sum(axis=1)
    normal[:, [1, 2], [1, 2]] += (stiff * scale)[:, None] / np.maximum(enough, 1)[:, None] + 1e-12
    right = np.einsum("dni,dn,dnk->dik", design, weight, values)
    out[some] = np.linalg.solve(normal[some], right[some])
    return out


def _torn(near: Neighbours, displacement: Floats, most: float = TORN) -> npt.NDArray[np.bool_]:
    """Pairs (dot, neighbour) between which displacement changes more than in a print; False if one is unknown."""
    change = displacement[near.index] - displacement[:, None, :]
    return np.asarray(np.hypot(change[..., 0], change[..., 1]) > most * near.distance)


def _largest(near: Neighbours, displacement: Floats, torn: float = TORN, rank: int = 0) -> npt.NDArray[np.bool_]:
    """The largest set of dots that move continuously, or the next."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    n = len(displacement)
    good = np.asarray(np.isfinite(displacement).all(axis=1))
    tied = good[:, None] & good[near.index] & ~_torn(near, displacement, torn)
    # of the nearest six only: those beyond may lie across a tear
    tied[:, 6:] = False
    rows, columns = np.nonzero(tied)
    graph = coo_array((np.ones(len(rows)), (rows, near.index[rows, columns])), shape=(n, n))
    count, label = connected_components(graph, directed=False)
    size = np.bincount(label[good], minlength=count)
    return good & (label == int(np.argsort(-size, kind="stable")[min(rank, count - 1)]))


def matched(near: Neighbours, expected: Floats, found: Floats, *, usual: float = 0.0) -> Index:
    """The dot of ``found`` (m, 2) that each dot of the reference is now; -1 for none.

    ``expected``: likely displacement (n, 2) of each, such as that in the previous picture; NaN if unknown. ``usual``: the `strained` of the previous
    match: up to this value the first match is accepted.

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
    # a dot that moves by a pitch reaches another's place and agrees with the static dots round it: start with fewer
    for worn, beside, torn, rank in TRIED:
        other = _matched(near, expected, found, tree, worn, beside, torn, rank)
        cost = strained(near, _moves(near, other, found))
        if cost < lowest:
            best, lowest = other, cost
    return _loosened(near, _mended(near, best, found, tree), found)


def _mended(near: Neighbours, match: Index, found: Floats, tree: cKDTree) -> Index:
    """A match begun anew about its faults (dots without one, and tears), ever further about them, for as long as it strains the print less."""
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
    """One-to-one match near the expected places: the largest set of dots that move continuously, and its growth.

    ``worn`` times the set loses those at its edges, with which less than the part ``least`` of their neighbours move.
    """
    n = len(near.positions)
    out = np.full(n, -1, dtype=np.intp)
    start = np.where(np.isfinite(expected), expected, 0.0)
    at = near.positions + start
    distance, nearest = tree.query(at)
    # mutual: no two dots are one
    order = np.argsort(distance)
    taken = np.zeros(len(found), dtype=bool)
    first = np.zeros(n, dtype=bool)
    for i in order:
        if distance[i] < REACH * near.pitch and not taken[nearest[i]]:
            taken[nearest[i]] = first[i] = True
    displacement = np.full((n, 2), np.nan)
    displacement[first] = found[nearest[first]] - near.positions[first]
    kept = _largest(near, displacement, torn, 0 if worn else rank)
    # where neighbours agree on something else, a dot is out of step
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
    """Square of the change of displacement over distance, from each dot to its six nearest (n, 6), at most 1; 0 if one is unknown."""
    change = displacement[near.index[:, :6]] - displacement[:, None, :]
    part = np.hypot(change[..., 0], change[..., 1]) / near.distance[:, :6]
    return np.nan_to_num(np.minimum(part, 1.0) ** 2)


def strained(near: Neighbours, displacement: Floats) -> float:
    """Strain energy of displacements (n, 2), with a penalty for each lost dot (NaN)."""
    lost = np.count_nonzero(np.isnan(displacement[:, 0]))
    return float(0.5 * _strain(near, displacement).sum() + UNMATCHED * lost)


def _loosened(near: Neighbours, match: Index, found: Floats) -> Index:
    """Without those that strain the print more than a dot without a match does."""
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
    """Match the rest, those with most matched neighbours first."""
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
    """Whether this move would tear the print from most of the neighbours that are known."""
    others = displacement[near.index[dot]]
    known = np.isfinite(others).all(axis=1)
    change = np.hypot(*(others[known] - move).T)
    return bool(np.mean(change > torn * near.distance[dot][known]) > 0.5)
