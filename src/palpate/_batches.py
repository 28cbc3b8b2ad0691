"""Fields with batch axes: they are declared once, and every function that selects, joins or copies frames uses the
declaration.

A field declared with ``field(metadata=per_frame())`` has the batch axes first. Selecting a frame, joining results,
indexing, saving and loading all use the functions below, so that a new field only needs its declaration.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any, TypeVar, cast

import numpy as np

from palpate._arrays import is_numpy, namespace, to_numpy
from palpate.errors import InvalidInput

__all__ = ["Deferred", "freeze", "per_frame", "per_frame_fields", "rebuilt", "stacked"]

Record = TypeVar("Record")


class Deferred(abc.ABC):
    """A record whose arrays are computed when they are first requested, from other arrays with the batch axes first."""

    @property
    @abc.abstractmethod
    def deferred(self) -> bool:
        """Whether an array is still to be computed."""

    @abc.abstractmethod
    def inputs(self) -> Iterator[tuple[str, Any]]:
        """Yield (name, value) of the existing arrays with batch axes."""

    @abc.abstractmethod
    def changed(self, change: Callable[[Any], Any]) -> Any:
        """Return the record with ``change`` applied to the existing fields, so that lazy fields need less work later."""


def per_frame(*dims: str, missing: Any = math.nan) -> dict[str, Any]:
    """Return metadata for a dataclass field with batch axes.

    ``dims`` name the axes after those of the batch ("*": those of the surface); ``missing`` is the value for frames
    without the field.
    """
    return {"per_frame": True, "dims": dims, "missing": missing}


def per_frame_fields(record: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted name, value) of every existing per-frame field, including those of nested records."""
    for f in fields(record):
        if not f.metadata.get("per_frame"):
            continue
        value = getattr(record, f.name)
        if isinstance(value, Deferred) and value.deferred:
            yield from ((f"{prefix}{f.name}.{name}", part) for name, part in value.inputs())
        elif is_dataclass(value):
            yield from per_frame_fields(value, f"{prefix}{f.name}.")
        elif value is not None:
            yield prefix + f.name, value


def rebuilt(record: Record, change: Callable[[Any], Any]) -> Record:
    """Return the record with ``change`` applied to every per-frame array, including those of nested records."""
    if isinstance(record, Deferred) and record.deferred:
        return cast(Record, record.changed(change))
    changes = {}
    for f in fields(record):  # type: ignore[arg-type]
        value = getattr(record, f.name)
        if f.metadata.get("per_frame") and value is not None:
            changes[f.name] = rebuilt(value, change) if is_dataclass(value) else change(value)
    return replace(record, **changes)  # type: ignore[type-var]


def stacked(records: Sequence[Any], *, new_axis: bool, counts: Sequence[int]) -> dict[str, Any]:
    """Join the per-frame fields of many records: along a new first axis, or end to end along the first.

    ``counts`` are the numbers of frames of the records. Frames of records without a field get its missing value.
    """
    out: dict[str, Any] = {}
    for f in fields(records[0]):
        if not f.metadata.get("per_frame"):
            continue
        parts = [getattr(r, f.name) for r in records]
        known = next((p for p in parts if p is not None), None)
        if known is None:
            out[f.name] = None
        elif is_dataclass(known):
            inner = [_absent(known, n, new_axis) if p is None else p for p, n in zip(parts, counts)]
            out[f.name] = replace(known, **stacked(inner, new_axis=new_axis, counts=counts))  # type: ignore[type-var]
        else:
            filled = [
                _filled(known, f.metadata["missing"], n, new_axis) if p is None else p for p, n in zip(parts, counts)
            ]
            out[f.name] = _join(f.name, filled, new_axis)
    return out


def _absent(known: Any, count: int, new_axis: bool) -> Any:
    """Return a record shaped like ``known`` that has only missing values."""
    held = {f: getattr(known, f.name) for f in fields(known) if f.metadata.get("per_frame")}
    return replace(
        known,
        **{
            f.name: _absent(value, count, new_axis)
            if is_dataclass(value)
            else _filled(value, f.metadata["missing"], count, new_axis)
            for f, value in held.items()
            if value is not None
        },
    )


def _filled(known: Any, missing: Any, count: int, new_axis: bool) -> Any:
    """Return missing values for the frames of one record, shaped like those of ``known``."""
    array = to_numpy(known)
    shape = array.shape if new_axis else (count, *array.shape[1:])
    dtype = array.dtype if not isinstance(missing, float) or array.dtype.kind == "f" else np.float64
    return np.full(shape, missing, dtype=dtype)


def _join(name: str, parts: list[Any], new_axis: bool) -> Any:
    if all(is_numpy(p) for p in parts) or not all(hasattr(p, "dtype") for p in parts):
        arrays = [to_numpy(p) for p in parts]
        shapes = {a.shape if new_axis else a.shape[1:] for a in arrays}
        if len(shapes) > 1:
            raise InvalidInput(
                f"results of different kinds cannot be joined: {name} has the shapes {', '.join(map(str, sorted(shapes)))}. "
                "Join results of one skin and one number of draws."
            )
        return np.stack(arrays) if new_axis else np.concatenate(arrays)
    xp = namespace(*parts)
    return xp.stack(parts, axis=0) if new_axis else xp.concat(parts, axis=0)


def freeze(record: Any) -> None:
    """Make the NumPy arrays in a frozen record's per-frame fields read-only. They become views, so that the caller's
    own arrays stay writable.
    """
    kind: Any = type(record)
    for name in _per_frame_names(kind):
        value = getattr(record, name)
        if is_numpy(value) and value.flags.writeable:
            view = value.view()
            view.flags.writeable = False
            object.__setattr__(record, name, view)


@cache
def _per_frame_names(kind: Any) -> tuple[str, ...]:
    """The names of the per-frame fields of a dataclass."""
    return tuple(f.name for f in fields(kind) if f.metadata.get("per_frame"))
