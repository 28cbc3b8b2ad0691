"""One frame of readings in the form that recorders and messages take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate._arrays import as_real, to_numpy
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput

__all__ = ["frame_values"]


def frame_values(values: Any, channels: Sequence[str]) -> Floats:
    """Return a frame as an array (channel, taxel) or (channel, y, x); masked and infinite values are missing, NaN.

    Raises
    ------
    InvalidInput
        Not numbers, another shape, or planes that differ in shape: these do not fit into one array.
    """
    if isinstance(values, list | tuple) and len({np.shape(v)[1:] for v in values if hasattr(v, "shape")}) > 1:
        shapes = " and ".join(str(tuple(np.shape(v))) for v in values)
        raise InvalidInput(
            f"the planes of a frame differ in shape ({shapes}), and a recording or a message holds one array. Give each plane a recorder of its own."
        )
    data = to_numpy(as_real(values, "a frame"))
    if data.ndim not in (2, 3) or len(data) != len(channels):
        raise InvalidInput(
            f"a frame must have shape (channel, taxel) or (channel, y, x) with {len(channels)} channels; got {data.shape}."
        )
    infinite = np.isinf(data)
    return np.where(infinite, np.asarray(np.nan, dtype=data.dtype), data) if infinite.any() else data
