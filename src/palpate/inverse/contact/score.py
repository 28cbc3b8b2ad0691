"""The scores by which explanations of a frame are compared; nothing outside this file compares two of them.

| score | what it is | compares |
|---|---|---|
| `gain_of` | free log(total/left): log likelihood of Gaussian noise of an unknown size, over what remains of its degrees of freedom | rough explanations, readings left out, contact in a few cells |
| `worth_of` | `gain_of`, less what each nuisance and another sign must bring | explanations of one frame: `best_of`, `rivals_of`, `least_to_beat` |
| `more_than_noise` | log evidence of the linear model over noise alone, that of uneven noise taken off | contact and no contact |
| `weights_by_evidence`, `shares_by_evidence` | exp(log evidence), normalised | penalties of one explanation; ways of sliding |
| `share_of` | 1/(1 + exp(-log odds)) | discs and fields; an explanation and its rival |
| `rival_odds` | difference of worth, plus log of the ratio of misfit probabilities | an explanation that is doubted and its rival |
| `gain_without_cone` | minus the log probability that noise of an unknown size gives as large an F | a push and the same contact with traction of either sign |

All are natural logarithms of odds but for two: `gain_of` counts a degree of freedom as a whole logarithm of what is left, where a Gaussian prior would count
half of one on average, and `gain_without_cone` is a test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.explanation import Explanation
from palpate.inverse.contact.policy import Policy
from palpate.inverse.fit import MIN_DEGREES

__all__ = [
    "best_of",
    "gain_of",
    "gain_without_cone",
    "hopeless_signs",
    "is_compact",
    "least_to_beat",
    "likelier_signs",
    "more_than_noise",
    "rival_odds",
    "rivals_of",
    "same",
    "share_of",
    "shares_by_evidence",
    "weights_by_evidence",
    "worth_of",
]

K = TypeVar("K")


def gain_of(free: float, total: float, left: float, floor: float = 0.0) -> float:
    """free log(total/left): ``total`` and ``left`` are root mean squares before and after, ``free`` the degrees of freedom left, ``floor`` the least noise.

    An account that bends to every reading leaves no freedom and is worth nothing. Contact leaves most of a surface empty, which is what tells an offset, which
    nothing on the surface is empty under, from contact.
    """
    return free * math.log(total / max(left, floor, 1e-300))


def worth_of(h: Explanation, policy: Policy) -> float:
    """The gain of an explanation, less what it needs."""
    return h.rough.gain - policy.explanations.per_nuisance * (int(h.present.sum()) + (h.sign < 1))


def is_compact(h: Explanation, policy: Policy) -> bool:
    """Whether an explanation is one of compact contact.

    One that bends to every reading explains any; so does load all round with an offset against it, which leaves the rest free to push and to pull.
    """
    return h.rough.free >= MIN_DEGREES and h.rough.ring < policy.explanations.ring


def _simplest(tried: Sequence[Explanation], policy: Policy) -> Explanation:
    return max((h for h in tried if h.sign != 0 and not h.present.any()), key=lambda h: worth_of(h, policy))


def _credible(tried: Sequence[Explanation], policy: Policy) -> list[Explanation]:
    """Those without nuisances, and those whose nuisances leave no more to noise than contact alone: others gain only by making the contact smoother.

    Contact that is loaded at the edge, or bends to most readings, leaves little in any case, and rules none out.
    """
    rules, rough = policy.explanations, _simplest(tried, policy).rough
    if rough.ring > rules.edge or rough.free < rules.bends * len(rough.explained):
        return list(tried)
    return [h for h in tried if not h.present.any() or h.rough.left <= rough.left]


def best_of(tried: Sequence[Explanation], policy: Policy) -> Explanation:
    """The best; one that needs more must gain more, and be surer than whether anything touches at all."""
    simple = _simplest(tried, policy)
    best = max(_credible(tried, policy), key=lambda h: worth_of(h, policy))
    return best if worth_of(best, policy) - worth_of(simple, policy) > policy.detection.evidence else simple


def rivals_of(best: Explanation, tried: Sequence[Explanation], policy: Policy) -> tuple[Explanation, ...]:
    """The other credible, compact explanations with nuisances that are worth more than noise alone, the best first."""
    others = [
        h
        for h in _credible(tried, policy)
        if h.present.any() and h is not best and is_compact(h, policy) and worth_of(h, policy) > 0.0
    ]
    return tuple(sorted(others, key=lambda h: -worth_of(h, policy)))


def least_to_beat(tried: Sequence[Explanation], policy: Policy) -> float:
    """What another explanation must reach. Those that bend to every reading set no such mark: they are refuted too often to leave others for them."""
    return max((worth_of(h, policy) for h in tried if is_compact(h, policy)), default=-math.inf)


def likelier_signs(tried: Sequence[Explanation], without: Sequence[int]) -> list[int]:
    """The signs of what was tried, the best first, but for those ``without``."""
    ordered = dict.fromkeys(h.sign for h in sorted(tried, key=lambda h: -h.rough.gain))
    return [sign for sign in ordered if sign not in without]


def hopeless_signs(tried: Sequence[Explanation], policy: Policy) -> list[int]:
    """Signs that no offset saves: they gain less than half of what the best does, and that is no load all round, which an offset would be taken for."""
    best = max(tried, key=lambda h: h.rough.gain)
    if not best.rough.gain > 0.0 or best.rough.ring > policy.explanations.edge:
        return []
    return [h.sign for h in tried if h.rough.gain < policy.explanations.half * best.rough.gain]


def same(a: Explanation, b: Explanation, policy: Policy) -> bool:
    """Whether two explanations came to the same: a rival that is a copy would be solved for nothing."""
    alike = a.sign == b.sign and np.array_equal(a.present, b.present)
    return bool(alike and np.allclose(a.sizes, b.sizes, rtol=policy.explanations.same, atol=0.0))


def more_than_noise(gain: float, uneven: float, policy: Policy) -> bool:
    """Whether log evidence of contact exceeds that of noise, ``uneven`` of which a level for each channel explains."""
    return gain > policy.detection.evidence + uneven


def weights_by_evidence(gains: Mapping[K, float]) -> dict[K, float]:
    """Odds against the best, exp(gain - best)."""
    best = max(gains.values())
    return {key: math.exp(max(gain - best, -50.0)) for key, gain in gains.items()}


def shares_by_evidence(logs: Sequence[float]) -> Floats:
    """Probabilities, of log evidences."""
    import scipy.special

    return np.asarray(scipy.special.softmax(logs))


def share_of(log_odds: float) -> float:
    """The probability that goes with log odds."""
    return 1.0 / (1.0 + math.exp(min(-log_odds, 700.0)))


def rival_odds(h: Explanation, fit: float, rival: Explanation, rival_fit: float, policy: Policy) -> float:
    """Log odds of a rival against an explanation, with the misfit probability of each once they are solved."""
    return worth_of(rival, policy) - worth_of(h, policy) + math.log(max(rival_fit, 1e-300) / fit)


def gain_without_cone(readings: float, push: tuple[float, float], free: tuple[float, float]) -> float:
    """What traction of either sign, ``free``, gains on a ``push``: of each the mean square that it leaves and the degrees of freedom that it took.

    F = (S1 - S2) / (k2 - k1) / (S2 / (n - k2)). Akaike's gain holds where n is far more than k, and traction of either sign follows most of few readings;
    noise that was given may be given wrong.
    """
    import scipy.stats

    (before, few), (after, many) = push, free
    taken, rest = max(many - few, 1.0), max(readings - many, 1e-3)
    f = (before - after) / taken / max(after / rest, 1e-300)
    return -float(scipy.stats.f.logsf(f, taken, rest)) if f > 0.0 else 0.0
