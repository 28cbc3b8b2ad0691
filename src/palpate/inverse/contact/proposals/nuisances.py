"""Contact of one sign with the nuisances that are there: sizes and contact found in turn."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.explanation import Explanation, Rough
from palpate.inverse.contact.proposals.levels import reach, reach_of_kind
from palpate.inverse.contact.proposals.search import Search
from palpate.inverse.contact.rough import rough
from palpate.inverse.contact.score import least_to_beat
from palpate.sensing.nuisance import Nuisance

__all__ = ["with_nuisances"]

Flags = npt.NDArray[np.bool_]


def with_nuisances(search: Search, sign: int, start: Floats, sought: Flags) -> Explanation | None:
    """Contact of one sign with those of the nuisances ``sought`` that are there; None where there are none, or it cannot be better than what was tried."""
    estimator, rules = search.estimator, search.estimator.policy.explanations
    terms = [term for term, here in zip(search.terms, sought) if here]
    solved = _in_turn(search, terms, sign, start[sought], least_to_beat(search.tried, estimator.policy))
    if solved is None:
        return None
    found, sizes = solved
    # one as large as the readings themselves is no offset, and a very small one is what the model cannot follow
    columns = np.stack([term.rows for term in terms], axis=1)
    part = np.abs(sizes) / np.maximum(reach(columns, search.data), 1e-300)
    largest = rules.largest_nuisance * reach_of_kind(estimator, columns, search.data - columns @ sizes)
    if not ((part > rules.smallest_nuisance).any() and (np.abs(sizes) <= largest).all()):
        return None
    every = search.none
    every[sought] = sizes
    return Explanation(sign, found, every, every != 0)


def _in_turn(
    search: Search, terms: Sequence[Nuisance], sign: int, start: Floats, beat: float
) -> tuple[Rough, Floats] | None:
    """The rough solution with the nuisances that are there, and their sizes; None where it is as good as certain that its gain stays below ``beat``: rounds
    that go on as the best of them so far do not bring it there.

    Sizes and contact are found in turn, the sizes with the contact on its face free to move.
    """
    estimator, data, observed = search.estimator, search.data, search.observed
    rules = estimator.policy.explanations
    columns = np.stack([term.rows for term in terms], axis=1)
    readings = estimator.readings
    unit = np.sqrt((readings.white((columns / readings.std[:, None])[observed], observed) ** 2).sum(axis=0))
    few = observed.sum() <= estimator.policy.detection.few_readings
    sizes, present = start.copy(), np.ones(len(terms), dtype=bool)
    best: Rough | None = None
    near: Floats | None = None
    step = 0.0
    for turn in range(rules.nuisance_rounds):
        clean = sign * (data - columns @ sizes)
        found = rough(estimator, clean, observed, search.total, columns[:, present], search.noise, near, beat)
        near = found.traction
        if best is not None:
            # sizes from the outermost taxels are no fit yet: better ones may gain as much as makes no difference less
            if found.gain < best.gain - (0.0 if few or turn > 1 else estimator.policy.detection.evidence):
                break
            step = max(step, found.gain - best.gain)
            if found.gain + (rules.nuisance_rounds - 1 - turn) * step < beat:
                return None
        best, kept = found, sizes.copy()
        deviation = max(found.left, estimator.least_noise(data)) / np.maximum(unit, 1e-300)
        change = np.zeros(len(terms))
        change[present] = sign * found.change
        sizes = sizes + change
        # the first step of both together, from far, tells whether there are any, and not yet which
        first = turn == 0 and not few
        there = np.abs(sizes) > rules.nuisance * (found.deviation if first else deviation)
        if not there.any():
            return None
        if not first:
            present, sizes = there, np.where(there, sizes, 0.0)
        if (np.abs(change) < 0.3 * deviation).all():
            break
    if best is None:
        raise RuntimeError("no round of nuisances was made")
    present = np.abs(kept) > rules.nuisance * deviation
    return best, np.where(present, kept, 0.0)
