"""Propose traction of either sign, from the linear model."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.inverse.contact.explanation import Explanation, Rough
from palpate.inverse.contact.proposals.state import Search
from palpate.inverse.contact.score import gain_of

__all__ = ["propose"]


def propose(search: Search) -> Iterator[Explanation]:
    """Yield the linear model's solution. The linear model has some traction everywhere, so take the loaded fraction of the edge from the push."""
    data, observed = search.data, search.observed
    if 0 not in search.estimator.signs or (~observed).sum() > len(data) // 2:
        return
    found, left, free = search.estimator.start.noise(data, search.total, observed)
    gain = gain_of(free, search.total, left, search.estimator.least_noise(data))
    flat = found.traction.reshape(len(found.traction), -1)
    edge = search.tried[0].rough.edge
    yield Explanation(0, Rough(gain, left, free, flat, np.zeros_like(data), edge), search.none)
