"""Propose contact that pulls as a whole: a push of the negated readings."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.search import Search

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield a pull if a push leaves a large residual."""
    if -1 in search.signs and search.worth_more(search.tried[0]):
        yield search.plain(-1)
