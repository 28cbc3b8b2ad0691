"""State shared by the proposals of a frame: readings, settings, and the explanations tried so far."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.inverse.contact import trace
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.prepared import PreparedContact, TooLarge
from palpate.inverse.contact.proposals.levels import edge_levels, reach
from palpate.inverse.contact.rough import rough, steps_of
from palpate.inverse.contact.score import absorbs, hopeless_signs, same
from palpate.sensing.nuisance import Nuisance

__all__ = ["Search"]

Flags = npt.NDArray[np.bool_]


@dataclass
class Search:
    """A frame and the explanations tried so far. ``total`` is the root mean square of the whitened readings; ``noise``
    as in `Explanation`.
    """

    estimator: PreparedContact
    data: Floats
    observed: Flags
    total: float
    noise: float | None
    tried: list[Explanation] = field(default_factory=list)

    def add(self, found: Iterable[Explanation]) -> None:
        """Record explanations. If two have the same sign and nuisances, keep the one with the larger gain: different
        noise estimates give different solutions. An alternative to earlier ones is skipped if it is too large.
        """
        try:
            for h in found:
                alike = [o for o in self.tried if same(h, o, self.estimator.policy)]
                if all(h.rough.gain > o.rough.gain for o in alike):
                    self.tried = [o for o in self.tried if not any(o is s for s in alike)] + [h]
        except TooLarge as error:
            if not self.tried:
                raise
            trace.step(f"skipped: {error}")

    @property
    def terms(self) -> Sequence[Nuisance]:
        """The nuisances that may be in the readings."""
        return self.estimator.terms

    @cached_property
    def lengths(self) -> Floats:
        """Length of the whitened pattern of each nuisance (nuisance,): the inverse of its standard deviation beside a
        contact that is known, for noise of one.
        """
        return np.sqrt((self.estimator.readings.whitened(self.estimator.shifts, self.observed) ** 2).sum(axis=0))

    @cached_property
    def first_noise(self) -> float | None:
        """Noise from which rough solutions start; None: the given noise, or a part of the readings."""
        if self.noise is None and self.estimator.noise_known and self.estimator.large:
            return self.estimator.start.noise(self.data, self.total, np.ones_like(self.observed), given=False)[1]
        return self.noise

    def plain(self, sign: int) -> Explanation:
        """Contact of one sign without nuisances."""
        data = sign * self.data
        found = rough(
            self.estimator,
            data,
            self.observed,
            self.total,
            None,
            self.first_noise,
            shifts=self.estimator.shifts if self.terms else None,
        )
        return Explanation(sign, found, self.none)

    def alone(self, sign: int) -> Explanation | None:
        """Contact of one sign without nuisances, if it was tried."""
        return next((h for h in self.tried if h.sign == sign and not h.present.any()), None)

    def promises(self, sign: int, sought: Flags) -> bool:
        """Whether contact of this sign may win by the nuisances ``sought``: in one Newton step of them, together with
        contact on its face, one is above the model's accuracy, and they gain more than one costs and than `best_of`
        requires. Always, if contact alone leaves a large residual or may have taken them up. If it covers much of the
        array, it may hide an offset, so that the step counts for ramps alone, and only if no offset was found.
        """
        if not sought.any():
            return False
        rules = self.estimator.policy.explanations
        plain = self.alone(sign)
        if plain is None or self.worth_more(plain) or absorbs(plain.rough, self.estimator.policy):
            return True
        if np.count_nonzero(plain.rough.traction[-1]) > rules.edge * self.estimator.taxels:
            offsets_found = any(h.sign == sign and h.present.any() for h in self.tried)
            if offsets_found or not (sought & ~self.usual).any():
                return True
        ((sizes, gain),) = steps_of(self.estimator, plain, self.data, self.observed, [np.flatnonzero(sought)])
        part = np.abs(sizes) / np.maximum(reach(self.estimator.shifts[:, sought], self.data), 1e-300)
        largest = float(part.max(initial=0.0))
        least = rules.per_nuisance + self.estimator.policy.detection.evidence
        trace.decided("gain of nuisances beside contact, in one step", gain, least)
        trace.decided("the largest of them, as a part of the largest reading", largest, rules.smallest_nuisance)
        return bool(gain > least and largest > rules.smallest_nuisance)

    @property
    def none(self) -> Floats:
        """Zero for every nuisance."""
        return np.zeros(len(self.terms))

    @property
    def usual(self) -> Flags:
        """Mask of the nuisances to try first. Ramps are tried later, and only if the outermost taxels show one."""
        return np.arange(len(self.terms)) < self.estimator.usual

    @cached_property
    def levels(self) -> list[Floats]:
        """Initial sizes of offsets, from the outermost taxels."""
        return edge_levels(self.estimator, self.data, self.observed)

    def worth_more(self, h: Explanation) -> bool:
        """Whether to try further explanations: this one leaves a large residual, of more than the given noise. On a
        large array, which is mostly untouched, it must also exceed the noise of the linear model, which may pull.
        """
        estimator, policy = self.estimator, self.estimator.policy
        if not h.rough.left > policy.explanations.doubt * self.total:
            return False
        if estimator.noise_known:
            return h.rough.left > policy.noise.again
        if not estimator.at_size:
            return True
        linear = estimator.start.evidence(estimator.orders[1], estimator.readings.planes(self.data), None)
        return h.rough.left > policy.noise.again * linear.scale

    @cached_property
    def hopeless(self) -> Sequence[int]:
        """Signs of contact that no offset can make the best; valid once push and pull were tried."""
        return hopeless_signs(self.tried, self.estimator.policy)
