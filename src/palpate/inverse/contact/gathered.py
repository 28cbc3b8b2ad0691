"""Combine the frames of a batch into one estimate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
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

    def numbers(name: str, kind: type = np.float64) -> npt.NDArray[Any]:
        return np.array([getattr(f, name) for f in frames], dtype=kind).reshape(batch)

    interpolated = estimator.problem.surface.shape != estimator.surface.shape
    if len(frames) == 1 and isinstance(frames[0].errors, Summary) and not interpolated:
        errors: Errors = ContactErrors.of(frames[0].errors, estimator.cut, np.zeros(batch, dtype=np.intp))
    else:
        errors = Errors.gathered([f.known for f in frames], stacked)
    if interpolated:
        within = [unresolved(f.traction, estimator.surface.shape) for f in frames]
        errors = replace(errors, traction=np.hypot(errors.traction, stacked(within)))
    keep(frames[-1].models if frames[-1].contact else None, notes_of_contact(frames[-1:], (), estimator.policy))
    values = np.stack([estimator.cut(f.traction) for f in frames])
    sampled = None
    if estimator.draws:
        sampled = np.stack([estimator.cut(f.draws) for f in frames if f.draws is not None])
        sampled = sampled.reshape((*batch, *sampled.shape[1:]))
    outliers = np.stack([f.outliers for f in frames])
    noise = np.stack([f.noise for f in frames]).reshape((*batch, -1))
    return Estimate(
        from_numpy(values.reshape((*batch, *values.shape[1:])), like),
        numbers("parameter"),
        noise,
        numbers("residual"),
        errors,
        numbers("converged", bool),
        numbers("contact", bool),
        outliers.reshape((*batch, -1)),
        sampled,
        pushed=numbers("pushed", bool),
        resolution=np.array(
            [estimator.resolution(f.parameter) if math.isnan(f.resolution) else f.resolution for f in frames]
        ).reshape(batch),
        sliding=numbers("sliding") if estimator.finds_sliding else None,
        said=notes_of(frames, batch, estimator.policy),
        noise_std=noise * np.concatenate(estimator.scales),
        fit=numbers("fit"),
        sign=numbers("sign", int),
        nuisance=np.stack([f.nuisance for f in frames]).reshape((*batch, -1)) if estimator.terms else None,
        nuisance_std=np.stack([f.nuisance_std for f in frames]).reshape((*batch, -1)) if estimator.terms else None,
        nuisance_names=tuple((t.label, t.unit) for t in estimator.terms),
        at_limit=np.stack([f.at_limit for f in frames]).reshape((*batch, -1))
        if estimator.policy.parts.screening
        else None,
        stated=_stated(frames, stacked),
        discrepancy=numbers("discrepancy"),
        unexplained=numbers("unexplained", bool),
        undecided=numbers("undecided", bool),
        overload=numbers("overload", bool),
        one_penalty=numbers("one_penalty", bool),
        force_bounds=np.stack(
            [np.broadcast_to(f.bounds, (len(estimator.operator.surface.components), 2)) for f in frames]
        ).reshape((*batch, -1, 2)),
    )


def _stated(frames: Sequence[Frame], stacked: Callable[[Sequence[Floats]], Floats]) -> Stated | None:
    """Errors of the frames due to pad properties that are not known exactly; zero for frames without contact."""
    known = next((f.stated for f in frames if f.stated is not None), None)
    if known is None:
        return None
    none = Stated(**{f.name: np.zeros_like(getattr(known, f.name)) for f in fields(Stated)})
    each = [f.stated or none for f in frames]
    return Stated(**{f.name: stacked([getattr(s, f.name) for s in each]) for f in fields(Stated)})
