"""Explanations with nuisances that a frame was not taken for, where what it leaves speaks against the one that it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.inverse.contact.answer import framed
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.observed import Observed
from palpate.inverse.contact.prepared import Prepared
from palpate.inverse.contact.solving import solve
from palpate.inverse.fit import POOR_FIT

__all__ = ["with_rivals"]


def with_rivals(
    estimator: Prepared,
    run: Solved,
    frame: Frame,
    observed: Observed,
    rng: np.random.Generator | None,
) -> Frame:
    """The frame, or that of a rival which explains what it leaves: what is refuted gives way to what is not."""
    policy = estimator.policy
    plain = replace(observed, filled=observed.data)
    if frame.fit < POOR_FIT:
        for rival in run.explanation.rivals[: policy.explanations.followed]:
            other = framed(estimator, solve(estimator, rival, plain), observed, rng)
            if other.fit > policy.fit.accepted and other.contact:
                return other
    return frame
