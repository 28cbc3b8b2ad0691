"""Propose contact with offsets, from several initial sizes."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.levels import lowest_levels
from palpate.inverse.contact.proposals.nuisances import with_nuisances
from palpate.inverse.contact.proposals.state import Search
from palpate.inverse.contact.score import likelier_signs

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield contact of either sign with offsets, the likelier sign first; signs that cannot win or gain are skipped."""
    estimator = search.estimator
    for sign in likelier_signs(search.tried, search.hopeless):
        if not search.promises(sign, search.usual):
            continue
        lowest = lowest_levels(estimator, search.data, search.observed, sign)
        for k, start in enumerate([*search.levels, *lowest]):
            found = with_nuisances(search, sign, start, search.usual)
            # A start from the wrong end leaves the other end loaded, and so does a ramp: reject these.
            if found is not None and (k == 0 or not found.rough.edge > estimator.policy.explanations.edge):
                yield found
