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
    """Yield contact with the row or column that reduces its residual most, then with another; first beside the best
    explanation so far, then beside contact alone, because offsets may have taken the place of a row.
    """
    policy = search.estimator.policy
    signed = [h for h in search.tried if h.sign]
    if not any(term.kind == "row" for term in search.terms) or not signed:
        return
    best = max(signed, key=lambda h: worth_of(h, policy))
    yield from _beside(search, best)
    if best.present.any():
        yield from _beside(search, next(h for h in signed if h.sign == best.sign and not h.present.any()))


def _beside(search: Search, h: Explanation) -> Iterator[Explanation]:
    """Yield an explanation with one more row or column at a time, as long as it is worth more. All are candidates, so
    that each must also gain the log of their number.
    """
    policy = search.estimator.policy
    rows = np.array([term.kind == "row" for term in search.terms], dtype=bool)
    choice = math.log(rows.sum())
    for _ in range(policy.explanations.rows):
        steps, gains = steps_of(search.estimator, h, search.data, search.observed)
        likeliest = int(np.argmax(np.where(rows & ~h.present, gains, -math.inf)))
        if h.present[likeliest] or not gains[likeliest] > policy.explanations.per_nuisance + choice:
            return
        sought, start = h.present.copy(), h.sizes.copy()
        sought[likeliest], start[likeliest] = True, steps[likeliest]
        found = with_nuisances(search, h.sign, start, sought)
        if found is None or not found.present[likeliest]:
            return
        before, h = h, replace(found, choice=choice * float((found.present & rows).sum()))
        yield h
        if not worth_of(h, policy) > worth_of(before, policy):
            return
