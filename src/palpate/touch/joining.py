"""Join touches of single frames or batches."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from palpate._batches import stacked
from palpate.errors import InvalidInput
from palpate.touch.counted import counted
from palpate.touch.result import Touch

__all__ = ["joined"]

Value = TypeVar("Value")


def joined(touches: Sequence[Touch]) -> Touch:
    """One touch of many frames: from batches, end to end, or from single frames of one skin, along a new axis.

    Every field is kept; `Touch.view` and `Touch.friction` if they are the same for all. Notes are the union; fields that only some have (error bars
    before a stream computes them) are NaN in the rest.

    Raises
    ------
    InvalidInput
        Nothing to join, single frames mixed with batches, or results of different skins: other surfaces, components, nuisances, or another scale of the error bars.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.touch import joined
    >>> frame = pp.Touch(np.zeros((2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov")
    >>> joined([frame, frame, frame]).batch
    (3,)
    """
    if not touches:
        raise InvalidInput("there is nothing to join: give at least one touch.")
    first = touches[0]
    single = not first.batch
    for t in touches:
        if (
            t.surface != first.surface
            or t.components != first.components
            or t.unobservable_force != first.unobservable_force
        ):
            raise InvalidInput("results of different surfaces or components cannot be joined; join those of one skin.")
        if (not t.batch) != single or len(t.batch) > 1:
            raise InvalidInput("single frames join with single frames, and batches (frame, ...) with batches.")
    case = _common({t.case for t in touches if t.case is not None})
    names_of_nuisances = _common({t.nuisance_names for t in touches if t.nuisance is not None})
    _common({t._scale_std for t in touches if t.has_intervals})
    counts = [1 if single else t.batch[0] for t in touches]
    arrays = stacked(touches, new_axis=single, counts=counts)
    if any(not np.array_equal(t.methods, np.full(t.batch, first.method)) for t in touches):
        found = [np.atleast_1d(t.methods) for t in touches]
        arrays["found_by"] = np.concatenate(found)
    meta: dict[str, Any] = {}
    for t in touches:
        meta.update(t.meta)
    names: dict[int, str] = {}
    for t in touches:
        names.update(t.reading_names)
    assumptions = counted([(t.assumptions, n) for t, n in zip(touches, counts)])
    views = {None if t.view is None else json.dumps(t.view.described()) for t in touches if t.view is not first.view}
    alike = not views or (first.view is not None and views == {json.dumps(first.view.described())})
    view = first.view if alike else None  # a moved camera: no common view
    frictions = {t.friction for t in touches if t.friction is not None}
    return replace(
        first,
        **arrays,
        assumptions=assumptions,
        meta=meta,
        reading_names=names,
        view=view,
        case=case,
        friction=frictions.pop() if len(frictions) == 1 else None,
        nuisance_names=names_of_nuisances or (),
    )


def _common(values: set[Value]) -> Value | None:
    """The one value that all results of a skin have; None if none has it."""
    if len(values) > 1:
        raise InvalidInput("results of different skins cannot be joined; join those of one skin.")
    return next(iter(values), None)
