"""Propose contact that only pushes."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.search import Search
from palpate.inverse.contact.rough import rough

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield a push without nuisances."""
    found = rough(search.estimator, search.data, search.observed, search.total, None, search.first_noise)
    yield Explanation(1, found, search.none, search.none > 0)
