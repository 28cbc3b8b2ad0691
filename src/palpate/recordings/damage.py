"""Exceptions that indicate a damaged file or store."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib

__all__ = ["DAMAGE", "DAMAGE_OF_PACKED"]

#: Those of h5py, h5netcdf, zarr and its codecs: each layer translates the library's errors in its own way.
DAMAGE = (
    *(AttributeError, IndexError, KeyError, MemoryError, OSError, OverflowError, RuntimeError, TypeError, ValueError),
)
#: Those of parsers and of what unpacks: zipfile, zlib, NumPy, SciPy, MCAP, TIFF.
DAMAGE_OF_PACKED = (
    *(*DAMAGE, EOFError, NotImplementedError, SyntaxError),
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
)
