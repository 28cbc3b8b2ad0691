"""Exceptions that indicate a damaged file or store."""

from __future__ import annotations

__all__ = ["DAMAGE"]

#: Those of h5py, h5netcdf, zarr and its codecs: each layer translates the library's errors in its own way.
DAMAGE = (
    OSError,
    RuntimeError,
    KeyError,
    ValueError,
    TypeError,
    AttributeError,
    IndexError,
    OverflowError,
    MemoryError,
)
