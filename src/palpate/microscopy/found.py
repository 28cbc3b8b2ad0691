"""The contents of a file of displacements, before the size of a pixel is known."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.microscopy.names import BOTH_STDS, OUT_OF_PLANE, POSITIONS, STDS, VECTORS, which

__all__ = ["Found", "beside", "check_unnamed", "chosen", "list_names", "normal_beside", "stacked_pair"]


@dataclass(kw_only=True, eq=False)
class Found:
    """Vectors of one field: ``u``, ``v`` (row, column), or (n,) at positions ``x``, ``y``. If the file states them,
    ``unit`` is the unit of the vectors, ``place`` that of the positions, and ``pixel`` the size of a pixel [m].
    """

    u: Any
    v: Any
    x: Any = None
    y: Any = None
    std: tuple[Any, Any] | None = None
    #: displacement out of the plane, with the shape of u
    w: Any = None
    bad: Any = None
    unit: str | None = None
    place: str | None = None
    pixel: float | None = None
    #: units of ``std`` and ``w``, if they are not that of u
    std_unit: str | None = None
    w_unit: str | None = None
    #: whether the file comes from a program that always writes pixels
    pixels: bool = False
    notes: list[str] = field(default_factory=list)


def stacked_pair(path: Any, values: Any) -> Found:
    """Split one array that holds both components, (2, row, column) or (row, column, 2)."""
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


def beside(
    held: dict[str, Any], shape: tuple[int, ...]
) -> tuple[tuple[Any, Any] | None, tuple[Any, Any] | None, list[str]]:
    """Find positions and standard deviations of the vectors among the other arrays of the file, whose names are keys
    in lower case. Also return the notes to give.

    Positions may be given for columns and rows only, like ``xvec`` and ``yvec`` of MATLAB.
    """
    places: tuple[Any, Any] | None = None
    notes: list[str] = []
    for names in which(held, POSITIONS):
        x, y = (np.asarray(held[n]) for n in names)
        if x.shape == y.shape == shape:
            places = x, y
            break
        if len(shape) != 2 or min(shape) < 2 or max(x.shape, default=0) != x.size or max(y.shape, default=0) != y.size:
            continue
        if (y.size, x.size) == shape:
            grid = np.meshgrid(x.ravel(), y.ravel())
        elif (x.size, y.size) == shape:
            grid = np.meshgrid(x.ravel(), y.ravel(), indexing="ij")
            notes.append(f"x goes along the rows of the matrices, by the lengths of {names[0]} and {names[1]}")
        else:
            continue
        places = grid[0], grid[1]
        break
    std: tuple[Any, Any] | None = None
    for names in which(held, STDS):
        parts = tuple(np.asarray(held[n]) for n in names)
        if all(p.shape == shape for p in parts):
            std = parts[0], parts[1]
            break
    for name in BOTH_STDS if std is None else ():
        both = np.asarray(held.get(name))
        axes = [a for a in (0, both.ndim - 1) if both.ndim == len(shape) + 1 and both.shape[a] == 2]
        if both.dtype.kind == "f" and both.shape == shape:
            std = both, both
            notes.append(f"{name} is taken as the standard deviation of both components")
        elif both.dtype.kind == "f" and len(axes) == 1 and np.moveaxis(both, axes[0], 0).shape[1:] == shape:
            std = tuple(np.moveaxis(both, axes[0], 0))
    return places, std, notes


def normal_beside(held: dict[str, Any], shape: tuple[int, ...]) -> Any:
    """Find the displacement out of the plane among the other arrays of the file, whose names are keys in lower case;
    None if there is none, or if it is zero everywhere.
    """
    for name in OUT_OF_PLANE:
        w = np.asarray(held.get(name))
        if w.dtype.kind in "fiu" and w.shape == shape and np.nanmax(np.abs(w), initial=0.0) > 0:
            return w
    return None


def chosen(path: Any, candidates: dict[str, Any], name: str | None, what: str = "fields") -> Any:
    """Candidate with the given name or frame number, or the only one; otherwise `InvalidInput` lists the candidates."""
    if name is not None:
        matching = [key for key in candidates if key == name] or [key for key in candidates if name in key.split(", ")]
        if len(matching) == 1:
            return candidates[matching[0]]
        numbered = [key for key in candidates if key.endswith(f"({name})")]
        if name.isdigit() and numbered:
            # prefer the filtered output of a program to its input, by the order of the names
            best = min(numbered, key=lambda key: _rank(key))
            if len([key for key in numbered if _rank(key) == _rank(best)]) == 1:
                return _noted(candidates[best], f"frame {name} is {best}")
        several = [key for key in candidates if key.rpartition("(")[0] == name]
        if several:
            raise InvalidInput(
                f'{path}: {name!r} has {len(several)} frames: {list_names(several)}. Say which with name={several[0]!r} (--name "{several[0]}"), or take them all with palpate film.'
            )
        raise InvalidInput(f"{path}: no field {name!r}; it holds {list_names(candidates)}.")
    if len(candidates) > 1:
        raise InvalidInput(
            f"{path} holds {len(candidates)} {what}: {list_names(candidates)}. Say which with name=, such as name={next(iter(candidates))!r} "
            f'(--name "{next(iter(candidates))}").'
        )
    return next(iter(candidates.values()))


def check_unnamed(path: Any, name: str | None) -> None:
    """Raise an error for a name of a field in a file that holds a single one without a name."""
    if name is not None:
        raise InvalidInput(f"{path}: holds one field: leave out name={name!r} (--name).")


def _rank(key: str) -> int:
    """Return the position of a field's names in `VECTORS`."""
    first = key.rpartition("(")[0].split(", ")[0].rpartition(".")[2].lower()
    return next((k for k, pair in enumerate(VECTORS) if pair[0] == first), len(VECTORS))


def _noted(found: Any, note: str) -> Any:
    if isinstance(found, Found):
        found.notes.append(note)
    return found


def list_names(names: Any) -> str:
    """Join names for a message."""
    listed = list(names)
    return ", ".join(map(repr, listed[:8])) + (f" and {len(listed) - 8} more" if len(listed) > 8 else "")
