"""Contact with offsets and ramps, where offsets leave doubt."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.levels import edge_drift
from palpate.inverse.contact.proposals.nuisances import with_nuisances
from palpate.inverse.contact.proposals.search import Search
from palpate.inverse.contact.score import likelier_signs

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """A ramp that the outermost taxels show."""
    usual = search.usual
    if usual.all() or not search.doubt.sought:
        return
    doubt, least = search.doubt, search.estimator.policy.explanations.nuisance
    tilted = edge_drift(search.estimator, search.data, search.observed, search.terms)
    if not (np.abs(tilted) * doubt.unit > least * doubt.level)[~usual].any():
        return
    for sign in likelier_signs(search.tried, doubt.hopeless):
        found = with_nuisances(search, sign, tilted, np.ones_like(usual))
        if found is not None:
            yield found
