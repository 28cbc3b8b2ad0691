"""Try an alternative if the chosen explanation fits poorly, or could fit anything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from palpate.inverse.contact import trace
from palpate.inverse.contact.answer import combined, framed
from palpate.inverse.contact.explanation import Explanation, Solved
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.observed import Observed
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.score import louder, rival_odds, share_of, worth_of
from palpate.inverse.contact.solving import solve
from palpate.inverse.fit import POOR_FIT

__all__ = ["with_rivals"]

Flags = npt.NDArray[np.bool_]
#: Solves the rival; its frame comes second.
Rival = Callable[[], tuple[Solved, Frame]]


def with_rivals(
    estimator: PreparedContact,
    run: Solved,
    frame: Frame,
    observed: Observed,
    usable: Flags,
    rng: np.random.Generator | None,
) -> Frame:
    """The frame, or that of an alternative that fits if the chosen one does not. If both are plausible, their weighted
    mean with the errors of both.

    The odds of two explanations are exp(gain difference) times the ratio of their misfit probabilities. ``usable``
    (reading,) marks those of the readings ``observed`` that are no outliers.
    """
    h, rival = run.explanation, run.explanation.rival
    if rival is None:
        return frame
    solved = partial(_solved, estimator, rival, observed, usable, rng)
    # A load all round the edge with an opposite offset leaves the interior free and can fit anything.
    anything = h.present.any() and h.rough.edge > estimator.policy.explanations.whole_edge
    if frame.fit < POOR_FIT or anything:
        return _one_that_fits(estimator, run, frame, rival, solved)
    if frame.sign == h.sign and run.members:
        return _averaged(estimator, run, frame, rival, solved, rng)
    return frame


def _solved(
    estimator: PreparedContact, rival: Explanation, observed: Observed, usable: Flags, rng: np.random.Generator | None
) -> tuple[Solved, Frame]:
    """The alternative, solved with its own predictions in place of unusable readings, and its frame."""
    counted = replace(
        observed, filled=np.where(usable, observed.data, rival.predicted(estimator.shifts)), usable=usable
    )
    run = solve(estimator, rival, counted)
    return run, framed(estimator, run, observed, rng)


def _one_that_fits(estimator: PreparedContact, run: Solved, frame: Frame, rival: Explanation, solved: Rival) -> Frame:
    """The frame of the alternative if it passes the fit test, where the chosen explanation fails it or could fit
    anything.
    """
    policy, h = estimator.policy, run.explanation
    _, other = solved()
    trace.chosen(f"rival, misfit probability {other.fit:.3g}", rival, estimator.terms)
    # With a noise that is learned, one that could fit anything has no odds against contact alone that fits.
    anything = not estimator.noise_known and h.rough.edge > policy.explanations.whole_edge
    simpler = h.present.any() and not rival.present.any() and not anything
    odds = worth_of(rival, policy) - worth_of(h, policy) + louder(frame.left, other.left, len(run.data), policy)
    better = other.fit > policy.fit.accepted and other.contact and not (simpler and odds < 0.0)
    return other if better else frame


def _averaged(
    estimator: PreparedContact,
    run: Solved,
    frame: Frame,
    rival: Explanation,
    solved: Rival,
    rng: np.random.Generator | None,
) -> Frame:
    """The mean of the frame and the rival, if that is of the same sign and may carry weight."""
    policy, h = estimator.policy, run.explanation
    least = policy.explanations.least_weight
    if rival.sign != h.sign:
        return frame
    # `score.best_of` requires more than a higher worth, so a rival that it did not choose may still be likely.
    doubted = frame.fit < policy.fit.doubted or worth_of(rival, policy) > worth_of(h, policy)
    # Upper bound: assume that the rival fits perfectly.
    if not doubted or share_of(rival_odds(h, frame.fit, rival, 1.0, policy)) < least:
        return frame
    second, other = solved()
    weight = share_of(rival_odds(h, frame.fit, rival, other.fit, policy))
    trace.chosen(f"rival with the weight {weight:.2g}", rival, estimator.terms)
    if not (other.contact and weight > least):
        return frame
    return other if weight > 1.0 - least else _mean(estimator, run, second, frame, other, weight, rng)


def _mean(
    estimator: PreparedContact,
    run: Solved,
    second: Solved,
    frame: Frame,
    other: Frame,
    weight: float,
    rng: np.random.Generator | None,
) -> Frame:
    """Weighted mean of two solved explanations; the second has this ``weight``."""
    fit = (1.0 - weight) * frame.fit + weight * other.fit
    part, more = _weighed(run, 1.0 - weight), _weighed(second, weight)
    found = combined(estimator, part, frame.noise, fit, frame.residual, frame.free, rng, more)
    sizes = (1.0 - weight) * frame.nuisance + weight * other.nuisance
    between = weight * (1.0 - weight) * (frame.nuisance - other.nuisance) ** 2
    within = (1.0 - weight) * frame.nuisance_std**2 + weight * other.nuisance_std**2
    return replace(
        frame,
        traction=found.traction,
        errors=found.errors,
        draws=found.draws,
        fit=fit,
        nuisance=sizes,
        nuisance_std=np.sqrt(within + between),
        stated=found.stated,
        alone=found.alone,
        beyond=found.beyond,
        hangs=found.hangs,
        models=found.models,
        converged=frame.converged and other.converged,
    )


def _weighed(run: Solved, part: float) -> Solved:
    return replace(run, members=[replace(m, weight=part * m.weight) for m in run.members])
