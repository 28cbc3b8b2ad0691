"""Contact that pulls as a whole: a push of negated readings."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.search import Search
from palpate.inverse.contact.rough import rough

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """A pull where a push leaves much, or displacement is felt far away: what pulls in the middle looks much like what pushes all round."""
    if -1 not in search.signs or not (search.estimator.far or search.worth_more(search.tried[0])):
        return
    found = rough(search.estimator, -search.data, search.observed, search.total, None, search.noise)
    yield Explanation(-1, found, search.none, search.none > 0)
