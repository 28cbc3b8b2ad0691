"""Combine the frames of a batch into one estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.contact.again import keep
from palpate.inverse.contact.deferred_errors import ContactErrors
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.notes import notes_of, notes_of_contact
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.summary import Summary
from palpate.inverse.estimate import Errors, Estimate, Stated
from palpate.sensing.grids import unresolved

__all__ = ["gathered"]


def gathered(estimator: PreparedContact, frames: Sequence[Frame], batch: tuple[int, ...], like: Any) -> Estimate:
    """One estimate of all frames, with the batch axes first; traction in the kind of array that ``like`` is."""

    def stacked(parts: Sequence[Floats]) -> Floats:
        fields = parts[0].ndim > estimator.operator.surface.dimensions
        whole = np.stack([estimator.cut(part) for part in parts] if fields else parts)
        return np.asarray(whole.reshape((*batch, *whole.shape[1:])))

    def of_each(name: str, kind: type = np.float64) -> npt.NDArray[Any]:
        values: npt.NDArray[Any] = np.array([getattr(f, name) for f in frames], dtype=kind)
        return values.reshape((*batch, *values.shape[1:]))

    interpolated = estimator.problem.surface.shape != estimator.surface.shape
    if len(frames) == 1 and isinstance(frames[0].errors, Summary) and not interpolated:
        errors: Errors = ContactErrors.of(frames[0].errors, estimator.cut, np.zeros(batch, dtype=np.intp))
    else:
        errors = Errors.gathered([f.known for f in frames], stacked)
    if interpolated:
        within = [unresolved(f.traction, estimator.surface.shape) for f in frames]
        errors = replace(errors, traction=np.hypot(errors.traction, stacked(within)))
    keep(frames[-1].models if frames[-1].contact else None, notes_of_contact(frames[-1:], (), estimator.policy))
    noise = of_each("noise")
    return Estimate(
        from_numpy(stacked([f.traction for f in frames]), like),
        of_each("parameter"),
        noise,
        of_each("residual"),
        errors,
        of_each("converged", bool),
        of_each("contact", bool),
        of_each("outliers", bool),
        stacked([f.draws for f in frames if f.draws is not None]) if estimator.draws else None,
        pushed=of_each("pushed", bool),
        resolution=np.array(
            [estimator.resolution(f.parameter) if math.isnan(f.resolution) else f.resolution for f in frames]
        ).reshape(batch),
        sliding=of_each("sliding") if estimator.finds_sliding else None,
        said=notes_of(frames, batch, estimator.policy),
        noise_std=noise * np.concatenate(estimator.scales),
        fit=of_each("fit"),
        sign=of_each("sign", int),
        nuisance=of_each("nuisance") if estimator.terms else None,
        nuisance_std=of_each("nuisance_std") if estimator.terms else None,
        nuisance_names=tuple((t.label, t.unit) for t in estimator.terms),
        at_limit=of_each("at_limit", bool) if estimator.policy.parts.screening else None,
        stated=Stated.gathered([f.stated for f in frames], stacked),
        discrepancy=of_each("discrepancy"),
        unexplained=of_each("unexplained", bool),
        undecided=of_each("undecided", bool),
        overload=of_each("overload", bool),
        force_bounds=np.stack(
            [np.broadcast_to(f.bounds, (len(estimator.operator.surface.components), 2)) for f in frames]
        ).reshape((*batch, -1, 2)),
    )
