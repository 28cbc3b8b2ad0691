"""Metadata of a recording: stored as JSON, so that every format keeps their types."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from palpate.errors import InvalidInput

__all__ = ["plain_meta"]


def plain_meta(meta: Mapping[str, Any] | None, what: str = "meta") -> dict[str, Any]:
    """``meta`` in types that JSON preserves, so that a file returns an equal value; None becomes empty.

    Text, numbers, truth values and None are unchanged; NumPy numbers become Python's, tuples and arrays become lists.

    Raises
    ------
    InvalidInput
        A name that is not text, or a value of another kind.

    Examples
    --------
    >>> import numpy as np
    >>> plain_meta({"trial": np.int64(3), "weights (g)": (100.0, 200.0), "glued": True})
    {'trial': 3, 'weights (g)': [100.0, 200.0], 'glued': True}
    """
    if meta is not None and not isinstance(meta, Mapping):
        raise InvalidInput(f"{what} must be a mapping of names to values; got {type(meta).__name__}.")
    try:
        return {name: _plain(value, what) for name, value in _named(meta or {}, what)}
    except InvalidInput:
        raise
    except (RecursionError, ValueError) as error:  # a container of itself; a number of thousands of digits
        raise InvalidInput(f"{what} cannot be written ({str(error)[:100]}). Give text in its place.") from error


def _named(mapping: Mapping[Any, Any], what: str) -> list[tuple[str, Any]]:
    for name in mapping:
        if not isinstance(name, str):
            raise InvalidInput(
                f"names in {what} must be text; got {str(name)[:60]!r} ({type(name).__name__}). Give str(...) of it."
            )
    return list(mapping.items())


def _plain(value: Any, what: str) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | float | str):
        return json.loads(json.dumps(value))  # members of an enumeration become their values
    if isinstance(value, list | tuple):
        return [_plain(v, what) for v in value]
    if isinstance(value, Mapping):
        return {k: _plain(v, what) for k, v in _named(value, what)}
    raise InvalidInput(
        f"{what} takes text, numbers, truth values, and lists and mappings of them; got {str(value)[:60]!r} ({type(value).__name__}). "
        "Give str(...) of it."
    )
