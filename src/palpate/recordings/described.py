"""Compare the sensor's description in the ``meta`` of a recording with that of the skin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.recording import Recording
from palpate.sensing.arrays import Array
from palpate.units import parse_quantity

__all__ = ["check_described", "metres_of"]


def metres_of(text: str) -> Any:
    """Parse a length in ``meta`` in metres, or a pair (y, x) if these differ: "0.002", "2 mm", "0.002, 0.001"; None
    for anything else.

    Examples
    --------
    >>> from palpate.recordings.described import metres_of
    >>> metres_of("2 mm"), metres_of("0.002, 0.001"), metres_of("narrow")
    (0.002, (0.002, 0.001), None)
    """
    found = []
    for part in text.strip("()[] ").split(","):
        try:
            found.append(float(part))
        except ValueError:
            try:
                found.append(parse_quantity(part.strip().strip("'"), "length", "length"))
            except InvalidInput:
                return None
    return found[0] if len(found) == 1 else tuple(found) if len(found) == 2 else None


def check_described(recording: Recording, planes: Sequence[Array]) -> None:
    """Raise an error if the pitch or depth of a plane contradicts the recording. Several planes are not checked.

    Raises
    ------
    InvalidInput
        They differ by more than 1 %.
    """
    if len(planes) != 1:
        return
    for key in ("pitch", "depth"):
        said = metres_of(recording.meta[key]) if key in recording.meta else None
        mine = getattr(planes[0], key, None)
        if said is None or mine is None or mine == "base":
            continue
        if not np.allclose(np.broadcast_to(said, 2), np.broadcast_to(mine, 2), rtol=0.01, atol=0.0):
            raise InvalidInput(
                f"{key} is {_in_words(mine)} in the skin, and the recording says that its own is {_in_words(said)} (meta). Correct {key} in the skin, or take it out of the recording's meta."
            )


def _in_words(lengths: Any) -> str:
    return " x ".join(f"{1e3 * v:.4g} mm" for v in np.atleast_1d(lengths))
