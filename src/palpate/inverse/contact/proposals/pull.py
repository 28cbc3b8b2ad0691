"""Propose contact that pulls as a whole: a push of the negated readings."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.inverse.contact import trace
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.state import Search
from palpate.inverse.contact.score import absorbs

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield a pull if a push leaves a large residual, or may have taken it up: displacements of a pull in the middle
    look like those of a push all round.
    """
    push = search.tried[0]
    doubted = search.worth_more(push) or (search.estimator.far and absorbs(push.rough, search.estimator.policy))
    if -1 not in search.estimator.signs:
        return
    if not doubted:
        limit = search.estimator.policy.explanations.doubt
        trace.decided("what a push leaves, as a part of the readings", push.rough.left / search.total, limit)
        return
    yield search.plain(-1)
