"""Layers of napari from the .nc file of a cell: traction, displacement and mask, in micrometres."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InvalidInput, PalpateError

__all__ = ["cell_layers", "layer_reader"]

#: Largest length of an arrow, in steps between vectors.
LONGEST = 3.0

Layer = tuple[Any, dict[str, Any], str]


def layer_reader(path: Any) -> Callable[[Any], list[Layer]] | None:
    """Reader for napari: a function of the path, or None if the file is not that of a cell.

    Examples
    --------
    >>> from palpate.microscopy.layers import layer_reader
    >>> layer_reader("beads.tif") is None
    True
    """
    if not isinstance(path, str | Path) or Path(path).suffix.lower() != ".nc":
        return None
    try:
        cell_layers(path)
    except (PalpateError, OSError):
        return None
    return cell_layers


def cell_layers(path: Any) -> list[Layer]:
    """Return layers (data, options, kind) of the .nc file that `palpate tfm` and `CellForces.write_netcdf` write.

    Magnitudes of the traction and of its standard deviation [Pa] become images, traction and displacement become
    arrows, and the cell becomes labels. Positions are in micrometres from the middle of the picture's first pixel.

    Raises
    ------
    InvalidInput
        No such file, a damaged one, or one without vectors of a cell.

    Examples
    --------
    >>> from palpate.microscopy.layers import cell_layers
    >>> [kind for _, _, kind in cell_layers("after-tfm.nc")]  # doctest: +SKIP
    ['image', 'image', 'labels', 'vectors', 'vectors']
    """
    from palpate.recordings import read_touch

    held = read_touch(path)
    if "field_traction" not in held:
        raise InvalidInput(f"{path}: holds no vectors of a cell: give the .nc file that palpate tfm writes.")
    y, x = 1e6 * held["row_y"].values, 1e6 * held["column_x"].values
    step = float(x[1] - x[0])
    place: dict[str, Any] = {"scale": (step, step), "translate": (float(y[0]), float(x[0]))}
    traction, std, moved = (held[name].values for name in ("field_traction", "field_std", "displacement"))
    layers: list[Layer] = [
        (np.hypot(*traction), {**place, "name": "traction [Pa]", "colormap": "inferno"}, "image"),
        (np.hypot(*std), {**place, "name": "standard deviation [Pa]", "colormap": "gray", "visible": False}, "image"),
        (held["inside"].values.astype(np.uint8), {**place, "name": "cell", "opacity": 0.2}, "labels"),
    ]
    for name, values, color in (("traction", traction, "cyan"), ("displacement", moved, "yellow")):
        size = np.nan_to_num(np.hypot(*values))
        rows, columns = np.nonzero(size > 0.05 * size.max()) if size.max() > 0 else (np.zeros(0, int),) * 2
        length = LONGEST * step / max(float(size.max()), 1e-300)
        at = np.stack([y[rows], x[columns]], axis=1)
        along = length * values[::-1, rows, columns].T
        options = {"name": f"{name}, arrows", "edge_color": color, "edge_width": 0.2 * step, "vector_style": "arrow"}
        layers.append((np.stack([at, along], axis=1), options, "vectors"))
    return layers
