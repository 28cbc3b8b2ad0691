"""Propose contact with offsets of single rows and columns of a channel, which share a cable or a converter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.nuisances import with_nuisances
from palpate.inverse.contact.proposals.search import Search
from palpate.inverse.contact.rough import steps_of
from palpate.inverse.contact.score import worth_of

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield the best contact of one sign with the row or column that reduces its residual most, then with another.

    Every row and column is a candidate, so that each one found must also gain the log of their number.
    """
    estimator, policy = search.estimator, search.estimator.policy
    rows = np.array([term.kind == "row" for term in search.terms], dtype=bool)
    if not rows.any():
        return
    choice = math.log(rows.sum())
    for _ in range(policy.explanations.rows):
        best = max((h for h in search.tried if h.sign), key=lambda h: worth_of(h, policy))
        steps, gains = steps_of(estimator, best, search.data, search.observed)
        gains = np.where(rows & ~best.present, gains, -math.inf)
        likeliest = int(np.argmax(gains))
        if not gains[likeliest] > policy.explanations.per_nuisance + choice:
            return
        sought = best.present.copy()
        sought[likeliest] = True
        start = best.sizes.copy()
        start[likeliest] = steps[likeliest]
        found = with_nuisances(search, best.sign, start, sought)
        if found is None or not (found.present & rows).any():
            return
        found = replace(found, choice=choice * float((found.present & rows).sum()))
        yield found
        if not worth_of(found, policy) > worth_of(best, policy):
            return
