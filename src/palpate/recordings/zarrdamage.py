"""Exceptions that indicate a damaged Zarr store."""

from __future__ import annotations

__all__ = ["DAMAGE"]

#: Exceptions of zarr and its codecs on a damaged store.
DAMAGE = (
    OSError,
    RuntimeError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    IndexError,
    OverflowError,
    RecursionError,
    NotImplementedError,
    MemoryError,
)
