"""Errors by which a Zarr store shows that it is damaged."""

from __future__ import annotations

__all__ = ["DAMAGE"]

#: What zarr and its codecs raise where a store is damaged.
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
