"""Propose contact with offsets, ramps and other nuisances whose sizes the outermost taxels tell."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.inverse.contact import trace
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.levels import sizes_at_edge
from palpate.inverse.contact.proposals.nuisances import with_nuisances
from palpate.inverse.contact.proposals.state import Search
from palpate.inverse.contact.score import likelier_signs
from palpate.sensing.nuisance import AT_EDGE

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield contact with all nuisances but groups, if the outermost taxels show a significant one that is no offset."""
    estimator, observed = search.estimator, search.observed
    ramps = np.array([term.kind in AT_EDGE and term.kind != "offset" for term in search.terms], dtype=bool)
    if not ramps.any():
        return
    level = max(max(search.tried, key=lambda h: h.rough.gain).rough.left, estimator.least_noise(search.data))
    tilted = sizes_at_edge(estimator, search.data, observed)
    least, most = estimator.policy.explanations.nuisance, float((np.abs(tilted) * search.lengths / level)[ramps].max())
    if not most > least:
        trace.decided("ramp of the outermost taxels, in standard deviations", most, least)
        return
    sought = np.array([term.kind != "group" for term in search.terms]) & (search.usual | ~estimator.since_zero)
    for sign in likelier_signs(search.tried, search.hopeless):
        found = with_nuisances(search, sign, tilted, sought) if search.promises(sign, sought) else None
        if found is not None:
            yield found
