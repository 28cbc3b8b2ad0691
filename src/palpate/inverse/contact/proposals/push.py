"""Propose contact that only pushes."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.proposals.state import Search

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield a push without nuisances."""
    yield search.plain(1)
