"""Build the result of a frame from its solved models: traction, errors, fit and bounds; also results for frames
without contact.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.inverse.contact.again import Models
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.gaps import load_in_gaps
from palpate.inverse.contact.misfit import drift_probability, fit_of, misfit_of, proportional_part
from palpate.inverse.contact.no_contact import WIDE, detection_limit
from palpate.inverse.contact.notes import single_taxel_share, smallness
from palpate.inverse.contact.observed import Observed
from palpate.inverse.contact.policy import STATED
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.screening import shallow
from palpate.inverse.contact.summary import Summary
from palpate.inverse.contact.systematic import add_common_errors, doubtful, nuisance_errors
from palpate.inverse.contact.unbounded import goes_on_all_round, offset_as_load
from palpate.inverse.estimate import Errors
from palpate.inverse.fit import rms

__all__ = ["combined", "framed", "hidden", "nothing_fits", "nothing_known", "unexplained"]

Flags = npt.NDArray[np.bool_]


def framed(prepared: PreparedContact, run: Solved, observed: Observed, rng: np.random.Generator | None) -> Frame:
    """The result of one frame under the explanation that was solved."""
    h = run.explanation
    deviation = nuisance_errors(prepared, run)
    at_limit = observed.limited
    left_out = ~run.observed & ~at_limit
    each = np.full(prepared.noise.count, run.scale) if run.levels is None else run.levels
    if not run.members:
        rest = np.where(run.observed, run.data / np.where(run.noise > 0, run.noise, 1.0), 0.0)
        # A single reading that stands out may be a small contact directly above a shallow taxel.
        alone = np.where(shallow(prepared.operator.planes_of, prepared.policy), observed.data, 0.0)
        nothing = _nothing(prepared, run.parameter, run.scale, run.data, left_out, alone)
        fit = misfit_of(prepared, run, rest, 0.0)
        errors, unknown = detection_limit(prepared, run, fit, nothing.known)
        result = replace(nothing, errors=errors, pushed=run.explains and h.sign == 1, fit=fit, unproven=unknown)
    else:
        run.doubtful = doubtful(prepared, run)
        run.drift = drift_probability(prepared, run)
        for m in run.members:
            add_common_errors(prepared, m, run, deviation, at_limit)
        fit, left, free = fit_of(prepared, run)
        result = combined(prepared, run, each, fit, left, free, rng)
        result = replace(
            result,
            outliers=left_out,
            # The models use a finer grid and may fit readings that surface cells cannot.
            pushed=(run.explains or left <= prepared.policy.detection.unexplained) and h.sign == 1,
            adrift=run.adrift > 0.5,
            discrepancy=proportional_part(prepared, run),
        )
    bounds = offset_as_load(prepared, h, result.traction)
    undecided = bounds is not None
    if bounds is None:
        bounds = goes_on_all_round(prepared, result.traction, h.sign)
    return replace(
        result,
        sign=h.sign,
        nuisance=h.sizes,
        nuisance_std=deviation,
        at_limit=at_limit,
        undecided=undecided,
        bounds=result.bounds if bounds is None else bounds,
    )


def combined(
    prepared: PreparedContact,
    run: Solved,
    noise: Floats,
    fit: float,
    left: float,
    free: float,
    rng: np.random.Generator | None,
    also: Solved | None = None,
) -> Frame:
    """The weighted mean of the models of a run (and of a second run ``also``), with errors that include the spread
    between models. ``noise``, ``fit``, ``left`` and ``free`` are its noise, misfit probability, residual and degrees
    of freedom.
    """
    policy, sign = prepared.policy, -1 if run.explanation.sign < 0 else 1
    runs = [run] if also is None else [run, also]
    members = [m for r in runs for m in r.members]
    large = any(m.data.at_size for m in members)
    summary = Summary(members, prepared.posterior)
    summary.gain = prepared.problem.uncertainty.assumed_gain
    summary.whites = [prepared.readings.whitened(r.data, r.observed, r.noise) for r in runs for _ in r.members]
    sampled = None
    if prepared.draws:
        sampled = sign * prepared.posterior.draws(members, prepared.draws, rng or np.random.default_rng(0))
    alone = single_taxel_share(
        prepared.operator.planes_of, run, np.abs(summary.mean[-1]), prepared.operator.surface, policy
    )
    summary.doubted = 0.5 / STATED * alone if policy.errors.much < alone < 1.0 - policy.errors.much else 0.0
    summary.in_gaps = load_in_gaps(prepared, run, summary.mean)
    models = Models.of(prepared, *runs)
    return Frame(
        sign * summary.mean,
        summary if large else summary.errors(),
        run.parameter,
        noise,
        left,
        all(m.solution.converged for m in members),
        True,
        ~run.observed,
        sampled,
        sliding=sum(m.weight for m in members if m.ray is not None),
        fit=fit,
        small=smallness(members, prepared.operator.planes_of, run, policy),
        stated=summary.stated(),
        alone=alone,
        beyond=prepared.posterior.beyond(summary.mean),
        hangs=0.0 if prepared.given_ends or not prepared.readings.independent else summary.largest_part(),
        free=free,
        models=None if models is None else replace(models, free=free),
    )


def _nothing(
    prepared: PreparedContact, parameter: float, scale: float, data: Floats, outliers: Flags, alone: Any = 0.0
) -> Frame:
    """Result of a frame without contact; its errors are those of the largest contact that would not be detected.

    ``data`` (reading,) are the readings, ``scale`` is the noise in units of their standard deviations, and ``outliers``
    marks the readings that are left out. Of these, ``alone`` has the values that may still come from a contact (a small
    one directly above a shallow taxel), and 0 elsewhere; the errors take them into account.
    """
    grid, names = prepared.operator.surface, prepared.operator.surface.components
    shape = (len(names), *grid.shape)
    # Use the readings as the residual: without contact all of it is noise.
    size = rms(data / prepared.readings.std)
    errors = prepared.undetected(scale if prepared.noise_known else size, np.where(outliers, alone, data))
    empty = np.zeros((prepared.draws, *shape)) if prepared.draws else None
    noise = np.full(prepared.noise.count, scale)
    left = size if prepared.noise_known or not scale > 0.0 else size / scale
    return Frame(np.zeros(shape), errors, parameter, noise, left, True, False, outliers, empty)


def unexplained(prepared: PreparedContact, data: Floats, outliers: Flags, chance: float) -> Frame:
    """Result of a frame that no explanation fits: traction, draws and errors are NaN."""
    nothing = _nothing(prepared, math.nan, math.nan, data, outliers).blanked()
    terms = np.full(len(prepared.terms), math.nan)
    return replace(
        nothing,
        errors=nothing_known(nothing.known),
        contact=True,
        pushed=False,
        fit=chance,
        nuisance=terms,
        nuisance_std=terms,
        at_limit=np.zeros(len(data), dtype=bool),
    )


def nothing_fits(prepared: PreparedContact, data: Floats, refused: str = "") -> Frame:
    """Result of a frame that no contact fits at any model error, or that was ``refused``: only bounds on its force."""
    nothing = unexplained(prepared, data, np.zeros(len(data), dtype=bool), math.nan if refused else 0.0)
    return replace(nothing, unexplained=True, bounds=hidden(prepared, data), refused=refused)


def nothing_known(errors: Errors) -> Errors:
    """Errors of the same shapes, all NaN."""
    return Errors(**{f.name: np.full_like(getattr(errors, f.name), math.nan) for f in fields(Errors)})


def hidden(prepared: PreparedContact, data: Floats) -> Floats:
    """Bounds on the net force (component, 2) if no explanation fits: the larger of two loads that cause the largest reading, a patch as wide as the depth and an even load over the array."""
    largest = float(np.abs(data / prepared.readings.std).max(initial=0.0))
    force = WIDE * prepared.undetected(largest, data).force
    inside = prepared.inside.ravel()
    area = float(prepared.operator.surface.areas.ravel()[inside].sum())
    for i, c in enumerate(prepared.columns):
        even = np.zeros((len(prepared.columns), inside.size))
        even[i, inside] = 1.0
        response = float(np.abs(prepared.explained_by(even) / prepared.readings.std).max())
        force[c] = max(force[c], largest * area / response) if response > 0.0 else math.inf
    return np.stack([-force, force], axis=-1)
