"""Common part of the founding paper's methods: one regular, complete grid for both traction and readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from palpate.errors import NotObservable, Unsupported
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid

__all__ = ["common_grid", "embed"]


def common_grid(planes: Sequence[Array], columns: Sequence[int], method: str) -> Grid:
    """The grid that all planes share; raise an error with the reason if the components ``columns`` have none."""
    first = planes[0]
    if isinstance(first, ScatteredArray):
        raise Unsupported(
            f'method="{method}" needs a regular array (LineArray or AreaArray); use method="tikhonov" for scattered '
            "positions, or grid the recording first (Recording.gridded)."
        )
    grid: Grid = first.grid
    for other in planes[1:]:
        if isinstance(other, ScatteredArray) or other.grid != grid:
            raise Unsupported(f'method="{method}" needs all planes on one grid; use method="tikhonov".')
    if any(p.mask is not None for p in planes):
        raise Unsupported(f'method="{method}" needs every taxel; use method="tikhonov" when some are missing.')
    rows = sum(len(p.channels) for p in planes)
    if rows < len(columns):
        raise NotObservable(
            f'method="{method}" cannot find {len(columns)} components from {rows} channel{"s" if rows > 1 else ""}: '
            "ask for fewer with components=[...], or measure more."
        )
    return grid


def embed(xp: Any, images: Any, columns: Sequence[int], grid: Grid) -> Any:
    """Put the components sought among all components, with zeros elsewhere."""
    tail = (slice(None),) * grid.dimensions
    zero = xp.zeros_like(images[(..., 0, *tail)])
    parts = [
        images[(..., list(columns).index(i), *tail)] if i in columns else zero for i in range(len(grid.components))
    ]
    return xp.stack(parts, axis=-1 - grid.dimensions)
