"""Libraries that only some tasks need, and the extras that install them."""

from __future__ import annotations

import importlib.util

from palpate.errors import Unsupported

__all__ = ["missing", "require"]

#: Extra of pyproject.toml that installs each library.
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
    "pyarrow": "parquet",
    "rerun": "rerun",
    "av": "camera",
    "cv2": "camera",
    "tifffile": "camera",
    "imagecodecs": "camera",
    "roifile": "cells",
    "contourpy": "cells",
    "dask": "dask",
    "skfem": "solid",
    "meshio": "solid",
    "distributed": "dask",
    "mujoco": "mujoco",
    "torch": "torch",
    "jax": "jax",
    "zenoh": "zenoh",
    "rclpy": "ros2",
    "geometry_msgs": "ros2",
    "sensor_msgs": "ros2",
    "diagnostic_msgs": "ros2",
    "std_msgs": "ros2",
    "std_srvs": "ros2",
}


def missing(purpose: str, error: ImportError) -> Unsupported:
    """Return the error to raise if ``purpose`` (in the plural: "skin files") needs a library that is not installed."""
    top = (error.name or "").split(".")[0]
    if top not in EXTRAS:
        return Unsupported(f"{purpose} cannot be served: {error}.")
    return Unsupported(f'{purpose} need the package {top}: pip install "palpate[{EXTRAS[top]}]".')


def require(purpose: str, *libraries: str) -> None:
    """Raise `Unsupported`, which names the extra to install, unless the libraries are installed."""
    for name in libraries:
        if importlib.util.find_spec(name) is None:
            raise missing(purpose, ModuleNotFoundError(name=name))
