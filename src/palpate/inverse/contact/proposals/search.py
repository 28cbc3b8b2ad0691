"""What the proposals of a frame are made from, and what they have come to so far."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.prepared import Prepared
from palpate.inverse.contact.proposals.levels import edge_levels, reach
from palpate.inverse.contact.score import hopeless_signs, same
from palpate.sensing.nuisance import Nuisance

__all__ = ["Doubt", "Search"]

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Doubt:
    """Whether nuisances are worth seeking after push and pull alone.

    ``sought``: what contact leaves asks for them, or the array's edge is loaded all round. ``wide``: nothing does, but an offset of displacement on a half-space
    is explained by wide pressure, and nothing is left over. ``unit`` (term,): size of each nuisance in the whitened readings; ``level``: the noise that the best
    leaves; ``hopeless``: signs that no offset saves.
    """

    sought: bool
    wide: bool
    best: Explanation
    unit: Floats
    level: float
    hopeless: Sequence[int]


@dataclass
class Search:
    """A frame and the explanations tried so far. ``total`` is the root mean square of the whitened readings, ``noise`` as in `Explanation`."""

    estimator: Prepared
    data: Floats
    observed: Flags
    terms: Sequence[Nuisance]
    signs: Sequence[int]
    total: float
    noise: float | None
    tried: list[Explanation] = field(default_factory=list)

    def add(self, found: Iterable[Explanation]) -> None:
        """Take up explanations as they come. Of two that came to the same the better counts: noise that is learned otherwise makes another solution."""
        for h in found:
            alike = [o for o in self.tried if same(h, o, self.estimator.policy)]
            if all(h.rough.gain > o.rough.gain for o in alike):
                self.tried = [o for o in self.tried if not any(o is s for s in alike)] + [h]

    @property
    def none(self) -> Floats:
        """Sizes of no nuisance."""
        return np.zeros(len(self.terms))

    @property
    def usual(self) -> Flags:
        """Nuisances that are sought first; ramps only where these leave doubt."""
        return np.arange(len(self.terms)) < self.estimator.usual

    @cached_property
    def levels(self) -> list[Floats]:
        """First sizes of offsets, from the outermost taxels."""
        return edge_levels(self.estimator, self.data, self.observed, self.terms)

    def worth_more(self, h: Explanation) -> bool:
        """Whether others are worth trying: this one leaves much of the readings, and of a large array, most of which nothing touches, more than the linear
        model, which may pull, calls noise.
        """
        estimator, policy = self.estimator, self.estimator.policy
        if not h.rough.left > policy.explanations.doubt * self.total:
            return False
        if not estimator.at_size or estimator.noise_known:
            return True
        linear = estimator.evidence(estimator.orders[1], estimator.readings.planes(self.data), None)
        return h.rough.left > policy.noise.again * linear.scale

    @cached_property
    def doubt(self) -> Doubt:
        """What push and pull alone leave; asked for once these were tried."""
        estimator, rules = self.estimator, self.estimator.policy.explanations
        readings, observed, usual = estimator.readings, self.observed, self.usual
        columns = np.stack([term.rows for term in self.terms], axis=1)
        best = max(self.tried, key=lambda h: h.rough.gain)
        left = (self.data - best.sign * best.rough.explained) / readings.std
        rest = np.zeros(len(self.terms))
        rest[usual] = readings.allowing(columns[:, usual]).sizes_of(left, observed)
        unit = np.sqrt((readings.white((columns / readings.std[:, None])[observed], observed) ** 2).sum(axis=0))
        level = max(best.rough.left, estimator.least_noise(self.data))
        seen = (np.abs(rest) * unit > rules.nuisance * level) & usual
        large = estimator.taxels >= rules.many_taxels
        if estimator.at_size or large:
            # so many readings tell an offset that is far too small to be looked for
            seen &= np.abs(rest) > rules.half * rules.smallest_nuisance * reach(columns, self.data)
        sought = bool(seen.any() or best.rough.ring > rules.edge)
        sought = sought or self.worth_more(best)
        wide = (
            estimator.far
            and estimator.problem.pad.thickness is None
            and best.rough.free < rules.compact * observed.sum()
        )
        hopeless = hopeless_signs(self.tried, estimator.policy) if large and not estimator.far else []
        return Doubt(sought, bool(wide), best, unit, level, hopeless)
