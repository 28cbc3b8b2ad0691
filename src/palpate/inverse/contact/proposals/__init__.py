"""Propose explanations of a frame: contact that pushes, pulls, or both; with or without offsets (of channels
and groups of taxels) and ramps in the readings.

Each file in `PROPOSALS` proposes one kind of explanation. ``propose(search)`` yields rough explanations; each is recorded before the
next is requested, so that later proposals know the earlier ones. To add a kind, add a file and a line in `PROPOSALS`.
They share `state.py` (what was tried, and what is worth trying), `levels.py` (first sizes of nuisances) and `nuisances.py` (contact
solved together with them). `palpate.inverse.contact.score` compares what they yield.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact import trace
from palpate.inverse.contact.explanation import Explanation, Rough
from palpate.inverse.contact.prepared import PreparedContact, TooLarge
from palpate.inverse.contact.proposals import both, groups, offsets, pull, push, ramps
from palpate.inverse.contact.proposals.state import Search
from palpate.inverse.contact.rough import largest_gain, rough_fit
from palpate.inverse.contact.score import best_of, rivals_of, simplest_of, worth_of

__all__ = ["PROPOSALS", "explanation_of"]

Flags = npt.NDArray[np.bool_]

#: Kinds of explanation, in the order in which they are tried.
PROPOSALS: tuple[Callable[[Search], Iterator[Explanation]], ...] = (
    push.propose,
    pull.propose,
    offsets.propose,
    groups.propose,
    ramps.propose,
    both.propose,
)


def explanation_of(
    estimator: PreparedContact, data: Floats, observed: Flags, noise: float | None = None
) -> Explanation:
    """Find the best explanation of a frame. The best alternative is stored in it as `Explanation.rival`.

    ``data`` (reading,) are the readings, and ``observed`` (reading,) marks those in use; ``noise`` is stored as
    `Explanation.noise`.
    """
    readings, terms, policy = estimator.readings, estimator.terms, estimator.policy
    white = readings.white((data / readings.std)[observed], observed)
    total = math.sqrt(float(np.mean(white**2))) if len(white) else 0.0
    if not total > 0.0:
        flat = np.zeros((len(estimator.columns), math.prod(estimator.operator.surface.shape)))
        return Explanation(1, Rough(0.0, 0.0, 1.0, flat, np.zeros_like(data), 0.0), np.zeros(len(terms)))
    search = Search(estimator, data, observed, total, noise)
    for propose in PROPOSALS:
        before = list(search.tried)
        search.add(propose(search))
        proposal = propose.__module__.rpartition(".")[2]
        trace.explanations(proposal, (h for h in search.tried if not any(h is o for o in before)), terms, total, policy)
    best = _of_either_sign(search, best_of(search.tried, policy))
    trace.best(best, search.tried, terms, policy)
    best, refuted = _regular(search, best)
    if estimator.noise_known and best.present.any():
        rival: Explanation | None = search.alone(best.sign)
    else:
        rival = next(iter(rivals_of(best, search.tried, policy)), None)
    if rival is None and best.present.any():
        rival = simplest_of(search.tried, policy)
    best = replace(best, rival=rival, refuted=refuted)
    return best if noise is None else replace(best, noise=noise)


def _of_either_sign(search: Search, best: Explanation) -> Explanation:
    """The best explanation; the best one of the other sign, if contact alone of that sign leaves less, and is worth more
    when both are as smooth as they gain most: it may have followed every reading, which the first one cannot.
    """
    other = search.alone(-best.sign)
    if best.sign == 0 or other is None or not other.rough.left < best.rough.left:
        return best
    try:
        first, second = (worth_of(_smooth(search, h), search.estimator.policy) for h in (best, other))
    except TooLarge as error:
        trace.step(f"skipped: {error}")
        return best
    if second > first:
        search.tried = [h for h in search.tried if h.sign != best.sign]
    return best_of(search.tried, search.estimator.policy)


def _smooth(search: Search, h: Explanation) -> Explanation:
    """The contact with the gain that it has at the noise at which it gains most."""
    gain = largest_gain(search.estimator, h, search.data, search.observed, search.total)
    trace.decided(f"gain of {trace.named(h, search.terms)} if it is smoother", gain, h.rough.gain)
    return replace(h, rough=replace(h.rough, gain=gain))


def _regular(search: Search, best: Explanation) -> tuple[Explanation, Explanation | None]:
    """The best explanation whose residual is as irregular as noise, and `Explanation.refuted` if the best is none.

    A contact of one sign may leave a residual too regular for noise: then another one, or traction of either sign.
    Traction of either sign is not tried where channels do not separate pressure from shear.
    """
    estimator, policy = search.estimator, search.estimator.policy
    free = next((h for h in search.tried if h.sign == 0), None)
    if best.sign == 0 or (free is None and not estimator.ambiguous):
        return best, None
    least = -math.inf if free is None else worth_of(free, policy)
    others = (h for h in rivals_of(best, search.tried, policy) if worth_of(h, policy) > least)
    first = next((h for h in (best, *others) if _in_order(search, h)), free or best)
    if first is best:
        return best, None
    plain = simplest_of(search.tried, policy)
    # A larger contact has too many unknowns for pull around it (`rims.with_rims`).
    small = np.count_nonzero(plain.rough.traction[-1]) * len(estimator.columns) <= policy.rims.unknowns
    return first, plain if small else None


def _in_order(search: Search, h: Explanation) -> bool:
    """Whether the residual of contact of one sign is as irregular as noise."""
    least = search.estimator.policy.explanations.structured_chance
    chance = rough_fit(search.estimator, h, search.data, search.observed)
    trace.decided("probability that noise has the order which one sign leaves", chance, least)
    return not chance < least  # NaN: there are too few readings for the test
