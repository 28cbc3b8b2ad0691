"""Propose contact with offsets of groups of taxels that share a cable or a converter: a row, column, half or quarter."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from palpate.inverse.contact import trace
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.nuisances import with_nuisances
from palpate.inverse.contact.proposals.state import Search
from palpate.inverse.contact.rough import steps_of
from palpate.inverse.contact.score import worth_of

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield contact with the group that reduces its residual most, then with another; first beside the best
    explanation so far, then beside contact alone, because offsets may have taken the place of a group.
    """
    policy = search.estimator.policy
    signed = [h for h in search.tried if h.sign]
    if not any(term.kind == "group" for term in search.terms) or not signed:
        return
    best = max(signed, key=lambda h: worth_of(h, policy))
    yield from _beside(search, best)
    if best.present.any():
        yield from _beside(search, next(h for h in signed if h.sign == best.sign and not h.present.any()))


def _beside(search: Search, h: Explanation) -> Iterator[Explanation]:
    """Yield an explanation with one more group at a time, of one channel or of all, as long as it is worth
    more. All are candidates, so that each must also gain the log of their number.
    """
    policy = search.estimator.policy
    named: dict[str, list[int]] = {}
    for i, term in enumerate(search.terms):
        if term.kind == "group":
            named.setdefault(term.group, []).append(i)
    each = [[i] for i in sorted(i for group in named.values() for i in group)]
    groups = each + [group for group in named.values() if len(group) > 1]
    choice = math.log(len(groups))
    for _ in range(policy.explanations.groups):
        steps, present = steps_of(search.estimator, h, search.data, search.observed, groups), h.present
        worth = [
            -math.inf if present[g].any() else gain - policy.explanations.per_nuisance * len(g)
            for g, (_, gain) in zip(groups, steps)
        ]
        best = int(np.argmax(worth))
        if not worth[best] > choice:
            trace.decided("gain of the best group of taxels, less its price", worth[best], choice)
            return
        sought, start = present.copy(), h.sizes.copy()
        sought[groups[best]], start[groups[best]] = True, steps[best][0]
        found = with_nuisances(search, h.sign, start, sought)
        if found is None or not found.present[groups[best]].any():
            return
        before, h = h, replace(found, choice=h.choice + choice)
        yield h
        if not worth_of(h, policy) > worth_of(before, policy):
            return
