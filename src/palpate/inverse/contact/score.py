"""Scores that compare explanations of a frame. What cannot win is dropped before it is scored, by the limits in `proposals`.

| score | what it is | compares |
|---|---|---|
| `gain_of` | free log(total/left): log likelihood of Gaussian noise of unknown level, for the remaining degrees of freedom | rough explanations, readings left out, contact in a few cells |
| `worth_of` | `gain_of` minus a penalty for each nuisance, for a sign other than push, and `Explanation.choice` | explanations of one frame: `best_of`, `rivals_of`, `least_to_beat` |
| `more_than_noise` | log evidence of the linear model over noise alone, minus that of uneven noise | contact and no contact |
| `odds_by_evidence`, `shares_by_evidence` | exp(log evidence), relative to the best; normalised | penalties of one explanation; ways of sliding |
| `share_of` | 1/(1 + exp(-log odds)) | discs and fields, by their log evidence; an explanation and its rival |
| `rival_odds` | difference of worth, plus log of the ratio of misfit probabilities | a doubtful explanation and its rival |
| `gain_without_cone` | minus the log probability of as large an F by noise of unknown level | a push and the same contact with traction of either sign |

All scores are natural logarithms of odds, with two exceptions: `gain_of` penalises a degree of freedom by a full log
of the residual, where a Gaussian prior would on average use half of that, and `gain_without_cone` is a test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.explanation import Explanation, Rough
from palpate.inverse.contact.policy import Policy
from palpate.inverse.fit import MIN_DEGREES

__all__ = [
    "absorbs",
    "best_of",
    "gain_of",
    "gain_without_cone",
    "hopeless_signs",
    "is_compact",
    "least_to_beat",
    "likelier_signs",
    "louder",
    "more_than_noise",
    "noise_beyond",
    "odds_by_evidence",
    "rival_odds",
    "rivals_of",
    "same",
    "share_of",
    "shares_by_evidence",
    "simplest_of",
    "worth_of",
]

K = TypeVar("K")


def gain_of(free: float, total: float, left: float, floor: float = 0.0) -> float:
    """free log(total/left). ``total`` is the root mean square of the readings, ``left`` the root of the residual's
    sum of squares over ``free``, the remaining degrees of freedom; ``floor`` is the smallest noise.

    An explanation that fits every reading leaves no degree of freedom and gains nothing. Contact leaves most of the
    surface empty, which separates it from an offset.
    """
    return free * math.log(total / max(left, floor, 1e-300))


def worth_of(h: Explanation, policy: Policy) -> float:
    """Gain of an explanation minus the penalty for its nuisances, its sign, and `Explanation.choice`."""
    return h.rough.gain - policy.explanations.per_nuisance * (int(h.present.sum()) + (h.sign < 1)) - h.choice


def is_compact(h: Explanation, policy: Policy) -> bool:
    """Whether an explanation is a compact contact.

    An explanation that fits every reading could fit anything. So could a load along the whole edge with an opposite
    offset, because it leaves the interior free to push and pull.
    """
    return h.rough.free >= MIN_DEGREES and h.rough.edge < policy.explanations.whole_edge


def simplest_of(tried: Sequence[Explanation], policy: Policy) -> Explanation:
    """Contact alone, without nuisances: of a push and a pull the one that is worth more."""
    return max((h for h in tried if h.sign != 0 and not h.present.any()), key=lambda h: worth_of(h, policy))


def absorbs(rough: Rough, policy: Policy) -> bool:
    """Whether a contact alone may have taken up nuisances: it loads the edge, or fits most readings freely."""
    return rough.edge > policy.explanations.edge or _fits_freely(rough, policy)


def _fits_freely(rough: Rough, policy: Policy) -> bool:
    return rough.free < policy.explanations.bends * len(rough.explained)


def best_of(tried: Sequence[Explanation], policy: Policy) -> Explanation:
    """The best explanation. One with nuisances must beat those without, and one with another sign the simplest one, by the evidence required for contact itself."""
    simple, least = simplest_of(tried, policy), policy.detection.evidence
    best = max(tried, key=lambda h: worth_of(h, policy))
    if best.present.any():
        plain = max((h for h in tried if not h.present.any()), key=lambda h: worth_of(h, policy))
        best = best if worth_of(best, policy) - worth_of(plain, policy) > least else plain
    return best if worth_of(best, policy) - worth_of(simple, policy) > least else simple


def rivals_of(best: Explanation, tried: Sequence[Explanation], policy: Policy) -> list[Explanation]:
    """The other compact explanations with nuisances that are worth more than noise alone, best first."""
    others = [
        h for h in tried if h.present.any() and h is not best and is_compact(h, policy) and worth_of(h, policy) > 0.0
    ]
    return sorted(others, key=lambda h: -worth_of(h, policy))


def least_to_beat(tried: Sequence[Explanation], policy: Policy) -> float:
    """Worth that another explanation must reach. Explanations that could fit every reading are ignored here: an
    overfitting explanation must not set the score to beat.
    """
    return max((worth_of(h, policy) for h in tried if is_compact(h, policy)), default=-math.inf)


def likelier_signs(tried: Sequence[Explanation], without: Sequence[int]) -> list[int]:
    """Signs of the explanations tried, best first, except those in ``without``."""
    ordered = dict.fromkeys(h.sign for h in sorted(tried, key=lambda h: -h.rough.gain))
    return [sign for sign in ordered if sign not in without]


def hopeless_signs(tried: Sequence[Explanation], policy: Policy) -> list[int]:
    """Signs that no offset can make the best: they gain less than half of the best explanation, although they fit few
    readings freely, and that does not load the edge, where it could be an offset.
    """
    rules, best = policy.explanations, max(tried, key=lambda h: h.rough.gain)
    if not best.rough.gain > 0.0 or best.rough.edge > rules.edge:
        return []
    least = rules.hopeless * best.rough.gain
    return [h.sign for h in tried if h.rough.gain < least and not _fits_freely(h.rough, policy)]


def same(a: Explanation, b: Explanation, policy: Policy) -> bool:
    """Whether two explanations have the same sign and nuisances; solving a copy would waste time."""
    alike = a.sign == b.sign and np.array_equal(a.present, b.present)
    return bool(alike and np.allclose(a.sizes, b.sizes, rtol=policy.explanations.same, atol=0.0))


def more_than_noise(gain: float, uneven: float, policy: Policy) -> bool:
    """Whether the log evidence ``gain`` of contact is significant beyond ``uneven``, the log likelihood gained by one
    noise level per channel.
    """
    return gain > policy.detection.evidence + uneven


def odds_by_evidence(gains: Mapping[K, float]) -> dict[K, float]:
    """Odds relative to the best, exp(gain - best)."""
    best = max(gains.values())
    return {key: math.exp(max(gain - best, -50.0)) for key, gain in gains.items()}


def shares_by_evidence(logs: Sequence[float]) -> Floats:
    """Probabilities from log evidences."""
    import scipy.special

    return np.asarray(scipy.special.softmax(logs))


def share_of(log_odds: float) -> float:
    """The probability for given log odds."""
    return 1.0 / (1.0 + math.exp(min(-log_odds, 700.0)))


def rival_odds(h: Explanation, fit: float, rival: Explanation, rival_fit: float, policy: Policy) -> float:
    """Log odds of a rival against an explanation, from their worth and from the misfit probabilities of their
    solutions; a half, the mean of what noise leaves, for a rival that leaves too little for the test (NaN).
    """
    rival_fit = 0.5 if math.isnan(rival_fit) else max(rival_fit, 1e-300)
    return worth_of(rival, policy) - worth_of(h, policy) + math.log(rival_fit / fit)


def louder(before: float, after: float, readings: int, policy: Policy) -> float:
    """Log likelihood that an explanation gains by leaving ``after`` of the given noise in place of ``before``.

    The given noise may be wrong. So this is Student's likelihood, (m + n)/2 log((m + n a^2)/(m + n b^2)) for n readings, whose prior counts as m
    readings. If the given noise were certain, a factor of two in it would outweigh any evidence of an offset.
    """
    prior = policy.fit.prior_weight
    return 0.5 * (prior + readings) * math.log((prior + readings * before**2) / (prior + readings * after**2))


def noise_beyond(given: float, left: float, free: float, policy: Policy) -> float:
    """The noise, at least ``given``, if it is known up to a factor: ``left`` is the root mean square of the residual, with ``free`` degrees of freedom.

    sqrt((m given^2 + free left^2)/(m + free)): the mean of the scaled inverse chi-squared posterior whose prior counts as m readings, as in `louder`.
    """
    prior = policy.fit.prior_weight
    return max(given, math.sqrt((prior * given**2 + free * left**2) / (prior + free)))


def gain_without_cone(readings: float, push: tuple[float, float], free: tuple[float, float]) -> float:
    """Gain of traction of either sign, ``free``, over a ``push``: of each the mean squared residual and the degrees of freedom used.

    Minus the log probability of F = (S1 - S2) / (k2 - k1) / (S2 / (n - k2)). Akaike's gain holds where n is far more than k, and traction of either
    sign follows most of few readings. F does not depend on the noise that was given, which may be wrong.
    """
    import scipy.special

    (before, few), (after, many) = push, free
    taken, rest = max(many - few, 1.0), max(readings - many, 1e-3)
    f = (before - after) / taken / max(after / rest, 1e-300)
    return -math.log(max(float(scipy.special.fdtrc(taken, rest, max(f, 0.0))), 1e-300))
