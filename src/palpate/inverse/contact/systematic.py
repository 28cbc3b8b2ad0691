"""Errors that act on many readings at once: nuisances, saturation, a pad not known exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.iterative import Iterative
from palpate.inverse.constrained.model import ContactModel, scattered
from palpate.inverse.constrained.products import Applied
from palpate.inverse.constrained.variances import (
    UNTOLD,
    carried,
    deviations_of,
    face_of,
    seen_of,
    shared_errors,
    told_of,
    unit_of,
    variance_of_sums,
)
from palpate.inverse.contact import drift
from palpate.inverse.contact.explanation import Explanation, Solved
from palpate.inverse.contact.policy import STATED
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.proposals.levels import reach
from palpate.inverse.contact.score import is_compact
from palpate.sensing.grids import block_means

__all__ = [
    "add_common_errors",
    "add_shared",
    "add_stated",
    "change_of_nuisances",
    "doubtful",
    "nuisance_errors",
    "shear_like_pressure",
]

Flags = npt.NDArray[np.bool_]


def nuisance_errors(estimator: PreparedContact, run: Solved) -> Floats:
    """Standard deviations (nuisance,) of the sizes of the nuisances `PreparedContact.terms`; 0 for those not present, but for
    offsets that the contact may hide (`_hidden_offsets`).
    """
    h = run.explanation
    if not estimator.terms or not (run.noise > 0).all():  # all readings are zero
        return np.zeros(len(estimator.terms))
    columns = estimator.readings.whitened(estimator.shifts, run.observed, run.noise)
    deviation = np.where(h.present, 1.0 / unit_of(columns), 0.0)
    if run.members and h.present.any():
        rows = columns.compress(h.present, axis=1)
        unit = unit_of(rows)
        prior = drift.precision(estimator, run.data)[h.present] / unit**2
        deviation[h.present] = deviations_of(told_of(run.members[0], rows / unit) + np.diag(prior)) / unit
    if run.members and not is_compact(h, estimator.policy):
        deviation = np.maximum(deviation, _hidden_offsets(estimator, run))
    return np.asarray(deviation)


def _hidden_offsets(estimator: PreparedContact, run: Solved) -> Floats:
    """Standard deviations (nuisance,) of the offsets that a contact may hide if it could fit any readings.

    If more than ``policy.explanations.whole_edge`` of the cells above the outermost taxels are loaded (`Rough.edge`), no
    reading shows an offset without contact: it may be ``policy.errors.hidden_drift`` of the largest reading (after a zero
    ``policy.explanations.drift``). Otherwise the contact can only have added an offset to its load, and no offset is
    larger than the lowest reading (of displacements, `add_hidden_drift` takes care).
    """
    policy, shifts = estimator.policy, estimator.shifts
    sizes = [(run.data * c)[run.observed & (c != 0)] / np.abs(c).max() ** 2 for c in shifts.T]
    part = np.where(estimator.since_zero, policy.explanations.drift, policy.errors.hidden_drift)
    hidden = part * np.array([np.abs(s).max(initial=0.0) for s in sizes])
    if not run.explanation.rough.edge > policy.explanations.whole_edge:
        lowest = np.array([0.0 if estimator.far else max(s.min(initial=math.inf), 0.0) for s in sizes])
        hidden = np.minimum(hidden, policy.errors.hidden_lowest * lowest)
    return np.where([t.kind == "offset" for t in estimator.terms], hidden, 0.0)


def change_of_nuisances(
    estimator: PreparedContact,
    h: Explanation,
    model: ContactModel,
    data: Floats,
    noise: Floats,
    observed: Flags,
    *,
    sure: bool,
) -> Floats:
    """Change of the nuisances when they are solved together with the contact, on its face.

    ``sure``: only change a nuisance that is far off (`Policy`). The cells of the contact change with it, so small
    steps might never end.
    """
    policy = estimator.policy
    out = np.zeros(len(estimator.terms))
    rows = estimator.readings.whitened(estimator.shifts[:, h.present], observed, noise)
    misfit = estimator.readings.whitened(data, observed, noise) - model.explained
    unit = unit_of(rows)
    rows = rows / unit
    prior = drift.precision(estimator, data)[h.present] / unit**2
    precision = told_of(model, rows) + np.diag(prior)
    pull = rows.T @ misfit - prior * unit * (h.sign or 1) * h.sizes[h.present]
    step = np.linalg.lstsq(precision, pull, rcond=UNTOLD)[0]
    least = policy.explanations.nuisance * deviations_of(precision) if sure else policy.explanations.first_change
    out[h.present] = np.where(np.abs(step) > least, step / unit, 0.0)
    return out


def doubtful(estimator: PreparedContact, run: Solved) -> tuple[Floats, Floats]:
    """Columns (reading, unknown) by which an inexactly known pad changes the readings, in units of the noise, and the
    standard deviations of the unknowns.
    """
    if not estimator.problem.doubts.any or not run.members:
        return np.zeros((len(run.data), 0)), np.zeros(0)
    grid = estimator.operator.surface
    full = np.zeros((len(grid.components), *grid.shape))
    for m in run.members:
        for row, column in enumerate(estimator.columns):
            fine = scattered(m.solution.traction[row], m.cells, m.level.grid.shape)
            full[column] += m.weight * block_means(fine, m.level.ratio, grid.dimensions)
    columns, size = estimator.problem.doubtful(estimator.problem.doubts, full, wide=estimator.wide)
    return columns / run.noise[:, None], size


def add_common_errors(
    estimator: PreparedContact, model: ContactModel, run: Solved, deviation: Floats, at_limit: Flags
) -> None:
    """Add to a model's errors the effects that act on many readings at once: nuisances, saturation, a pad not known
    exactly.
    """
    policy = estimator.policy
    there = deviation > 0
    noise, observed = run.noise, run.observed
    columns, prior = estimator.shifts[:, there], np.where(run.explanation.present, math.inf, deviation)[there]
    if (at_limit & observed).any():
        # Saturated readings that are used may be larger: all by one common fraction.
        excess = np.where(at_limit, run.data, 0.0)[:, None]
        columns, prior = np.concatenate([columns, excess], axis=1), np.append(prior, policy.screening.excess)
    white = estimator.readings.whitened(columns, observed, noise)
    doubted = estimator.readings.white(run.doubtful[0][observed], observed)
    each = estimator.problem.doubts.stated_gain * np.abs(run.data / noise)[observed]
    for one in (model, model.contact):
        if one is not None:
            add_shared(one, white, prior)
    add_stated(model.contact or model, doubted, run.doubtful[1], each)
    add_hidden_drift(estimator, model, run, deviation)
    free = not (estimator.cone.coupled or estimator.ambiguous or model.contact)
    if policy.parts.common_shear and len(estimator.columns) > 1 and free:
        y = estimator.readings.whitened(run.data, observed, noise)
        drag = add_common_shear(model, y, estimator.variances[:-1], pulls=estimator.cone.free)
        model.shared = drag if model.shared is None else np.concatenate([model.shared, drag], axis=1)


def add_hidden_drift(estimator: PreparedContact, model: ContactModel, run: Solved, deviation: Floats) -> None:
    """Widen a model's errors by a drift of displacements that may be hidden by wide pressure, if no offset or ramp was found.

    A displacement sensor responds to distant loads: pressure all round changes the readings almost like a shift of the
    picture. For drifts with a prior of a fraction of the largest reading (`Policy`), the posterior (S + 1/prior^2)^-1,
    with S as in `variances.shared_errors`, is added to the errors. Stress and strain respond to nearby loads, so
    contact cannot hide a drift there. If the user names ``nuisance``, nothing else drifts. ``deviation`` marks offsets
    that are already accounted for.

    ``run.adrift`` grows by the model's weight if drift dominates the error of its normal force and is a large fraction
    of it.
    """
    policy = estimator.policy
    part = policy.errors.hidden_drift
    if not policy.parts.nuisances or estimator.problem.nuisance is not None or not estimator.far or not part > 0.0:
        return
    accounted = {t.label for t, d in zip(estimator.terms, deviation) if d > 0}
    terms = [t for t in estimator.drifts if t.label not in accounted]
    if not terms:
        return
    rows = np.stack([t.rows for t in terms], axis=1)
    columns = estimator.readings.whitened(rows * (part * reach(rows, run.data)), run.observed, run.noise)
    for one in (model, model.contact):
        if one is None:
            continue
        face, rows = face_of(one.solution)[0], columns.T @ one.data.matrix
        x = carried(one.solution, rows)
        more = x @ _untold(columns.T @ columns - face.columns(rows) @ x, np.ones(columns.shape[1])) / STATED
        if one is (model.contact or model):
            total = np.zeros(one.solution.traction.shape)
            total[-1] = one.level.grid.cell
            rest = float(variance_of_sums(one, total.reshape(1, -1))[0])
            drifts = float(((face.columns(total.reshape(1, -1)) @ more) ** 2).sum())
            force = float((total * one.solution.traction).sum())
            run.adrift += model.weight * (drifts > max(rest, (policy.errors.much * force) ** 2))
        one.shared = more if one.shared is None else np.concatenate([one.shared, more], axis=1)


def add_common_shear(model: ContactModel, y: Floats, variances: Sequence[float], *, pulls: bool) -> Floats:
    """Add shear b p proportional to the pressure p to the model, because gradient penalties shrink it as they do
    noise. Return its contribution to the errors, as in `variances.shared_errors`.

    The model falls short by (1 - H^-1 A'A) b p = H^-1 P b p, where P is the penalty. With whitened readings ``y``, b
    is estimated from the residual: precision S = B'B - B'A H^-1 A'B = B'A H^-1 P p, where B = A p, and a prior with
    the ``variances`` of shear over pressure.
    """
    t, matrix = model.solution.traction, model.data.matrix
    ways = shear_like_pressure(t)
    seen = np.stack([matrix @ way.ravel() for way in ways], axis=1)
    short = carried(model.solution, np.stack([model.penalty.product(way).ravel() for way in ways]))
    told = seen.T @ seen_of(model, short)
    root = _untold(0.5 * (told + told.T), np.sqrt(np.asarray(variances)))
    size = root @ root.T @ (seen.T @ (y - model.explained))
    change = np.zeros(t.size)
    change[face_of(model.solution)[0].index] = short @ size
    found = t + change.reshape(t.shape)
    if not pulls:
        found[-1] = np.maximum(found[-1], 0.0)
    model.solution = replace(model.solution, traction=found)
    return np.asarray(short @ root)


def shear_like_pressure(traction: Floats) -> Floats:
    """Tractions (shear component, component, cell) of shear along each axis that equals the pressure of a ``traction``."""
    out = np.zeros((len(traction) - 1, *traction.shape))
    for i, way in enumerate(out):
        way[i] = traction[-1]
    return out


def _untold(told: Floats, prior: Floats) -> Floats:
    """K with K K' = (S + D^-2)^-1, the posterior covariance of unknowns beside the contact. S is the information
    ``told``, D the ``prior`` deviations. For readings far beyond the noise (a saturated converter), rounding may make
    S negative in some directions: these count as undetermined.
    """
    values, vectors = np.linalg.eigh(told * prior * prior[:, None])
    return np.asarray(prior[:, None] * vectors / np.sqrt(1.0 + np.maximum(values, 0.0)))


def add_shared(model: ContactModel, columns: Floats, prior: Floats) -> None:
    """Add to a model's errors unknowns that act on many readings: whitened ``columns`` (reading, unknown), with
    standard deviations ``prior``.
    """
    if columns.shape[1]:
        # Divide by STATED: the calibration constants, which scale the errors of the method, must not shrink named or
        # assumed errors.
        model.shared = shared_errors(model, columns, prior / STATED)


def add_stated(model: ContactModel, columns: Floats, prior: Floats, gains: Floats) -> None:
    """Add to a model's stated errors the inexactly known pad (``columns``, ``prior``) and an independent gain error
    ``gains`` (reading,) of each reading. Errors that the user stated are kept apart from the method's errors, so that
    no calibration constant changes them.
    """
    matrix = model.data.matrix
    rows = [(columns * prior).T @ matrix] if columns.shape[1] else []
    if gains.any():
        rows.append(matrix.sketched(gains) if isinstance(matrix, Applied) else gains[:, None] * matrix)
    if rows:
        face, factor = face_of(model.solution)
        right = face.columns(np.concatenate(rows)).T
        model.stated = factor.roughly(right) if isinstance(factor, Iterative) else factor.inverse(right)
