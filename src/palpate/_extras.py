"""Libraries that only some tasks need: imported when they are needed, or refused with the extra that brings them."""

from __future__ import annotations

import importlib
from typing import Any

from palpate.errors import Unsupported

__all__ = ["library"]

#: Extra of pyproject.toml that brings each library.
EXTRAS = {
    "h5netcdf": "files",
    "h5py": "files",
    "pydantic": "files",
    "matplotlib": "plots",
    "rich": "cli",
    "typer": "cli",
    "foxglove": "bags",
    "mcap": "bags",
    "mcap_protobuf": "bags",
    "rosbags": "bags",
    "starlette": "live",
    "uvicorn": "live",
    "websockets": "live",
    "zarr": "zarr",
    "rerun": "rerun",
}


def library(name: str, purpose: str) -> Any:
    """The module ``name``, or `Unsupported` that says which extra ``purpose`` needs.

    Examples
    --------
    >>> from palpate._extras import library
    >>> library("h5py", "NetCDF and HDF5 files").__name__
    'h5py'
    """
    top = name.split(".")[0]
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] != top:
            raise
        extra = EXTRAS[top]
        raise Unsupported(f'{purpose} need the package {top}: pip install "palpate[{extra}]".') from error
