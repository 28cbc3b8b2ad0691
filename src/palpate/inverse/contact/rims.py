"""Solve frames with contact that pushes and pulls at once, such as a push with an adhesive rim.

If pushing contact leaves more than noise, solve the same models without the cone, over the contact and a margin around
it. The rim of adhesion is a fraction of the contact's size (K. L. Johnson, K. Kendall, A. D. Roberts, Proc. R. Soc. A
324, 1971, 301-313), and farther out nothing pulls. Accept the result if its residual is noise.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.constrained.model import ContactModel, dilated
from palpate.inverse.constrained.variances import taken_by
from palpate.inverse.contact.answer import framed
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.observed import Observed
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.score import gain_without_cone
from palpate.inverse.contact.summary import Summary
from palpate.inverse.fit import POOR_FIT
from palpate.inverse.linear.evidence import LinearEvidence

__all__ = ["with_rims"]

Flags = npt.NDArray[np.bool_]


def with_rims(
    estimator: PreparedContact,
    run: Solved,
    frame: Frame,
    observed: Observed,
    rng: np.random.Generator | None,
) -> Frame | None:
    """The frame with traction of either sign around its contact; None if that does not fit better, or if it is not
    worth trying. A contact too large for that is a push if it fits and the linear model gains little over it.

    ``observed`` are the readings before outliers of the pushing contact were removed.
    """
    policy, h = estimator.policy, run.explanation
    if not _worth_trying(estimator, run, frame):
        return None
    size = np.abs(frame.traction[-1])
    region = _around(size, policy)
    if not region.any():
        return None
    # Traction of either sign was chosen on coarse cells. A push that fits on finer ones is one.
    push = replace(frame, sign=1, pushed=True) if h.sign == 0 and frame.fit > policy.fit.accepted else None
    at_size = any(m.data.at_size for m in run.members)
    if at_size or region.sum() * len(estimator.columns) > policy.rims.unknowns:
        return push if push and _gain_of_linear(estimator, run) < policy.detection.evidence else None
    free = _without_cone(estimator)
    # An offset found together with a push may really be a rim, so try without it first.
    without = replace(h, sizes=np.zeros_like(h.sizes))
    for each in [without, h] if h.present.any() else [h]:
        data = (h.sign or 1) * (observed.filled - estimator.shifts @ each.sizes)
        whole = replace(run, explanation=each, data=data, observed=run.observed | (observed.usable & ~observed.limited))
        other, rest = _run(free, whole, size, region)
        if not _gains(free, run, other):
            if push:
                return push
            if h.sign:
                continue
        other.members.extend(rest)
        # Pull loads more of the array's edge than the push does, and may hide an offset there.
        edge = free.edge_load(np.abs(Summary(other.members, free.posterior).mean[-1]))
        other.explanation = replace(each, rough=replace(each.rough, edge=edge))
        found = framed(free, other, observed, rng)
        least = min(frame.fit, POOR_FIT) if h.sign and each is h else POOR_FIT
        if found.fit > least and _is_contact(found, frame, h.sign or 1, policy):
            return replace(found, sign=2, pushed=False)
    return None


def _worth_trying(estimator: PreparedContact, run: Solved, frame: Frame) -> bool:
    """Whether contact may pull too: the solved contact fits poorly, or traction of either sign was chosen."""
    policy = estimator.policy
    if not policy.parts.rims or 0 not in estimator.signs or not run.members:
        return False
    enough = policy.fit.accepted if estimator.noise_known else policy.rims.sought
    return frame.fit < enough or run.explanation.sign == 0


def _around(size: Floats, policy: Policy) -> Flags:
    """The contact and a margin around it; ``size`` (*grid) is the magnitude of its traction."""
    core = size > policy.extent.faint * size.max()
    radius = 0.5 * core.sum() ** (1.0 / core.ndim)
    return dilated(core, 1 + math.ceil(policy.rims.margin * radius))


def _gains(free: PreparedContact, push: Solved, other: Solved) -> bool:
    """Whether traction of either sign gains over a push (`score.gain_without_cone`)."""
    count = float(other.observed.sum())
    gain = gain_without_cone(count, _unexplained(free, push), _unexplained(free, other))
    return gain > free.policy.detection.evidence


def _is_contact(found: Frame, push: Frame, sign: int, policy: Policy) -> bool:
    """Whether traction of either sign pushes more than it pulls, and its parts do not cancel in the readings."""
    pressure = sign * found.traction[-1]
    cancels = np.abs(found.traction).sum() > policy.rims.cancel * np.abs(push.traction).sum()
    return bool(not cancels and -pressure.min() <= pressure.max())


def _without_cone(estimator: PreparedContact) -> PreparedContact:
    """A copy of the estimator whose traction may have either sign."""
    policy = estimator.policy
    free = copy.copy(estimator)
    free.cone = Cone(estimator.cone.components, tension=True)
    free.policy = replace(
        policy,
        parts=replace(policy.parts, trim=False),
        grid=replace(policy.grid, unknowns=policy.rims.unknowns),
    )
    free.posterior = copy.copy(estimator.posterior)
    free.posterior.cone = free.cone
    return free


def _run(free: PreparedContact, run: Solved, size: Floats, region: Flags) -> tuple[Solved, Iterator[ContactModel]]:
    """The first model over a region, with noise estimated from its residual; and an iterator over the other models."""
    policy = free.policy
    readings, data, observed = free.readings, run.data, run.observed
    first = np.zeros((len(free.columns), size.size))
    first[-1] = size.ravel()
    floor = free.least_noise(data)
    rows = readings.planes(data)
    # Start from the residual of the push and go down: a linear model could fit any readings.
    known = None if free.noise_known else float(np.median(run.noise / readings.std))
    levels: Floats | None = None
    for turn in range(policy.noise.turns):
        evidence: Mapping[int, LinearEvidence] = {
            o: free.start.evidence(each, rows, known) for o, each in free.orders.items()
        }
        scale = max(evidence[1].scale, floor)
        noise = readings.std * (scale if levels is None else np.maximum(levels[free.noise.index], floor))
        models = free.models_over(region, first, data / noise, noise, observed, evidence)
        leading = next(models)
        if free.noise_known or turn == policy.noise.turns - 1:
            break
        if levels is None:
            levels = free.noise.levels(leading, data / noise, noise, observed, unequal=True)
            if levels is not None:
                continue
        spent = taken_by(leading) / max(float(observed.sum()), 1.0)
        left = scale * free.noise.left(leading, run.data / noise, run.observed, 0.0) / math.sqrt(max(1.0 - spent, 1e-3))
        if max(left / scale, scale / max(left, 1e-300)) < policy.noise.again:
            break
        known = left
    solved = replace(
        run,
        members=[leading],
        noise=noise,
        parameter=evidence[1].parameter,
        scale=scale,
        levels=levels,
    )
    return solved, models


def _gain_of_linear(estimator: PreparedContact, run: Solved) -> float:
    """Gain of the linear model of an explanation of either sign over the push that was solved instead."""
    count, rough, start = float(run.observed.sum()), run.explanation.rough, estimator.start
    found = start.evidence(start.orders[1], estimator.readings.planes(run.data), rough.left)
    left = rough.left**2 * rough.free / count
    lacks = start.residual_lacks(found.parameter) * count / len(run.observed)  # of the readings in use
    return gain_without_cone(count, _unexplained(estimator, run), (left, lacks))


def _unexplained(estimator: PreparedContact, run: Solved) -> tuple[float, float]:
    """Mean squared residual of the first model, in units of the whitening, and the degrees of freedom that it uses."""
    first = run.members[0]
    left = estimator.noise.left(first, run.data / run.noise, run.observed, 0.0)
    return (float(np.median(run.noise / estimator.readings.std)) * left) ** 2, taken_by(first)
