"""Solve one frame: test for noise, propose explanations and solve them roughly, then solve the best one fully.

1. Screen the readings (`observed`). 2. If noise explains them, with or without offsets, look for contact in a few
cells (`no_contact`, `few_cells`). 3. Otherwise take the best proposal (`proposals`, `score`) and remove its outliers
(`outliers`). 4. Solve it (`solving`) and build the result (`answer`). 5. If its residual is more than noise, try pull
around the contact (`rims`) and the rivals (`rivals`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact import trace
from palpate.inverse.contact.answer import framed, unexplained
from palpate.inverse.contact.explanation import Explanation, Solved
from palpate.inverse.contact.few_cells import contact_in_few_cells
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.no_contact import explained_by_noise
from palpate.inverse.contact.observed import Observed, observe
from palpate.inverse.contact.outliers import without_outliers
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.proposals import explanation_of
from palpate.inverse.contact.rims import with_rims
from palpate.inverse.contact.rivals import with_rivals
from palpate.inverse.contact.rough import rough_fit
from palpate.inverse.contact.solving import solve

__all__ = ["search"]


def search(prepared: PreparedContact, readings: Sequence[Floats], rng: np.random.Generator | None = None) -> Frame:
    """Result of one frame of readings, (channel, *array) per plane."""
    policy, observed = prepared.policy, observe(prepared, readings)
    filled, usable = observed.filled, observed.usable
    noise_alone = explained_by_noise(prepared, filled, usable)
    small = None if noise_alone is None else contact_in_few_cells(prepared, filled, usable)
    noise_alone = noise_alone if small is None else None
    if small is not None:
        trace.decided(
            "noise would explain it, but contact in a few cells gains", small.gain, policy.detection.in_few_cells
        )
    h = noise_alone or explanation_of(prepared, filled, usable, None if small is None else small.left)
    counted = observed
    if policy.parts.outliers and noise_alone is None:
        h, fewer = without_outliers(prepared, h, filled, usable)
        if (usable & ~fewer).any():
            trace.decided("readings left out, of so many", float((usable & ~fewer).sum()), float(usable.sum()))
            counted = replace(observed, filled=np.where(fewer, filled, h.predicted(prepared.shifts)), usable=fewer)
    if prepared.ambiguous and noise_alone is None:
        chance = rough_fit(prepared, h, counted.filled, counted.usable)
        everywhere = chance < 1.0 and np.mean(h.rough.traction[-1] > 0) > policy.explanations.everywhere
        if chance < policy.explanations.structured_chance or everywhere:
            return unexplained(prepared, observed.data, ~counted.usable, chance)
    run, frame = _solved(prepared, h, observed, counted, rng)
    return with_rivals(prepared, run, frame, observed, counted.usable, rng)


def _solved(
    prepared: PreparedContact,
    h: Explanation,
    observed: Observed,
    counted: Observed,
    rng: np.random.Generator | None,
) -> tuple[Solved, Frame]:
    """Solve an explanation; with pull around its contact, or around the contact that it refuted, if that fits better.
    ``counted`` are the readings ``observed`` without outliers.
    """

    def solved(each: Explanation) -> tuple[Solved, Frame, Frame | None]:
        """The explanation solved, its frame, and the frame that takes its place, if any."""
        run = solve(prepared, each, counted)
        frame = framed(prepared, run, observed, rng)
        trace.chosen("solved", run.explanation, prepared.terms, contact=bool(run.members))
        trace.decided("misfit probability", frame.fit, prepared.policy.fit.doubted)
        rimmed = with_rims(prepared, run, frame, observed, rng)
        if rimmed is not None:
            which = "contact with pull around it" if rimmed.sign == 2 else "a push on finer cells"
            trace.step(f"{which} takes its place: misfit probability {rimmed.fit:.3g}")
        return run, frame, rimmed

    if h.refuted is not None:
        run, _, rimmed = solved(h.refuted)
        if rimmed is not None:
            return run, rimmed
    run, frame, rimmed = solved(h)
    return run, frame if rimmed is None else rimmed
