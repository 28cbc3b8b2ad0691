"""Propose contact that pulls as a whole: a push of the negated readings."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.search import Search
from palpate.inverse.contact.rough import rough

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield a pull if a push leaves a large residual, or if the sensor measures displacement: a pull in the middle
    then looks like a push all round.
    """
    if -1 not in search.signs or not (search.estimator.far or search.worth_more(search.tried[0])):
        return
    found = rough(search.estimator, -search.data, search.observed, search.total, None, search.first_noise)
    yield Explanation(-1, found, search.none, search.none > 0)
