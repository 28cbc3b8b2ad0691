"""What a reader finds in a file, before anybody knows what a pixel is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.errors import InvalidInput

__all__ = ["Found", "chosen", "one_of_many", "stacked_pair"]


@dataclass(kw_only=True, eq=False)
class Found:
    """Vectors of one field: ``u``, ``v`` (row, column), or (n,) at positions ``x``, ``y``; ``unit`` of the vectors and ``place`` of the
    positions where the file says it, and the metres in a ``pixel``."""

    u: Any
    v: Any
    x: Any = None
    y: Any = None
    std: tuple[Any, Any] | None = None
    bad: Any = None
    unit: str | None = None
    place: str | None = None
    pixel: float | None = None
    #: a file of a program that always writes pixels
    pixels: bool = False
    notes: list[str] = field(default_factory=list)


def stacked_pair(path: Any, values: Any) -> Found:
    """Both components in one array: (2, row, column) or (row, column, 2)."""
    values = np.asarray(values)
    if values.dtype.kind not in "fiu":
        raise InvalidInput(f"{path}: holds {values.dtype}, no real numbers.")
    if values.ndim == 2:
        raise InvalidInput(
            f"{path}: holds one matrix of {values.shape[0]} x {values.shape[1]}, a field has two components. Give both files, that along x "
            f"first: {getattr(path, 'name', path)} and its partner."
        )
    ends = [axis for axis in (0, values.ndim - 1) if values.ndim == 3 and values.shape[axis] == 2]
    if len(ends) != 1:
        raise InvalidInput(
            f"{path}: both components in one array have the shape (2, rows, columns) or (rows, columns, 2); got {values.shape}. Save "
            "them as two files."
        )
    u, v = np.moveaxis(values, ends[0], 0)
    return Found(u=u, v=v, notes=[f"the components lie along axis {ends[0]} of {values.shape}: x first"])


def chosen(path: Any, candidates: dict[str, Any], name: str | None, what: str = "fields") -> Any:
    """The one field, or that of a name; `InvalidInput` lists those that are there."""
    if name is not None:
        matching = [key for key in candidates if key == name] or [key for key in candidates if name in key.split(", ")]
        if len(matching) == 1:
            return candidates[matching[0]]
        raise InvalidInput(f"{path}: no field {name!r}; it holds {one_of_many(candidates)}.")
    if len(candidates) > 1:
        raise InvalidInput(
            f"{path} holds {len(candidates)} {what}: {one_of_many(candidates)}. Say which with name=, such as name={next(iter(candidates))!r} "
            f'(--name "{next(iter(candidates))}").'
        )
    return next(iter(candidates.values()))


def one_of_many(names: Any) -> str:
    """The names for a message."""
    listed = list(names)
    return ", ".join(map(repr, listed[:8])) + (f" and {len(listed) - 8} more" if len(listed) > 8 else "")
