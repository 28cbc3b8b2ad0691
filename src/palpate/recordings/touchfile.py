"""Results as NetCDF (labelled), NPZ or CSV, with what is needed to make them again."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.errors import InvalidInput
from palpate.recordings import stores
from palpate.recordings.formats import atomically, file_format
from palpate.touch import Touch

__all__ = ["read_touch", "write_touch"]


def write_touch(touch: Touch, path: str | Path, *, provenance: Mapping[str, str] | None = None) -> None:
    """Write traction with coordinates and units, net force, and ``provenance`` (skin, command, version).

    NetCDF (.nc, .h5) opens in xarray; .npz holds the same arrays; .csv one line per frame, cell and component; .mcap a
    foxglove.Grid and a WrenchStamped per frame, in single precision; .zarr is a store for xarray.
    """
    kind = file_format(path)
    record = {"method": touch.method, "notes": "\n".join(touch.notes), **touch.meta, **(provenance or {})}
    if kind == "zarr":
        stores.into_place(path, lambda name: _store(touch, name, record))
        return
    writer = {"netcdf": _netcdf, "npz": _npz, "csv": _csv, "mcap": _mcap}[kind]
    atomically(path, lambda name: writer(touch, name, record))


def _netcdf(touch: Touch, name: str, record: Mapping[str, str]) -> None:
    _dataset(touch, record).to_netcdf(name, engine="h5netcdf")


def _store(touch: Touch, name: Path, record: Mapping[str, str]) -> None:
    dataset = _dataset(touch, record)
    # text has no settled form in Zarr 3
    dataset.attrs["component"] = [str(c) for c in dataset["component"].values]
    dataset.drop_vars("component").to_zarr(name, zarr_format=3, consolidated=False)


def _dataset(touch: Touch, record: Mapping[str, str]) -> Any:
    import xarray

    traction = touch.traction
    batch = [d for d in traction.dims if d not in ("component", "x", "y")]
    unit = "N/m" if touch.surface.dimensions == 1 else "N"
    dataset = xarray.Dataset(
        {
            "traction": traction,
            "force": ((*batch, "component"), to_numpy(touch.force), {"units": unit, "long_name": "net force"}),
        }
    )
    for key, value in (("parameter", touch.parameter), ("residual", touch.residual)):
        if value is not None:
            dataset[key] = (tuple(batch), np.asarray(value))
    if touch.errors is not None:
        dataset["std"] = touch.std
        low, high = touch.interval(0.95, "force")
        dataset["force_low"] = ((*batch, "component"), low, {"units": unit, "long_name": "net force, 95 % interval"})
        dataset["force_high"] = ((*batch, "component"), high, {"units": unit, "long_name": "net force, 95 % interval"})
    for key, flag in (("touching", touch.touching), ("converged", touch.converged)):
        if flag is not None:
            dataset[key] = (tuple(batch), np.asarray(flag))
    dataset.attrs.update({k: str(v) for k, v in record.items()})
    dataset.attrs["sought"] = ",".join(touch.components)
    return dataset


def _npz(touch: Touch, name: str, record: Mapping[str, str]) -> None:
    arrays: dict[str, Any] = {
        "traction": to_numpy(touch.values),
        "component": np.array(touch.surface.components),
        "force": to_numpy(touch.force),
        "record": np.array(json.dumps({**record, "sought": ",".join(touch.components)})),
    }
    if touch.errors is not None:
        arrays["std"] = to_numpy(touch.std.values)
    arrays.update(zip(("x",) if touch.surface.dimensions == 1 else ("y", "x"), touch.surface.axes))
    if touch.time is not None:
        arrays["time"] = touch.time
    with open(name, "wb") as file:
        np.savez_compressed(file, **arrays)


def _mcap(touch: Touch, name: str, record: Mapping[str, str]) -> None:
    from palpate.recordings.mcapfile import McapRecorder

    os.unlink(name)  # a recorder makes its own file
    with McapRecorder(name, (), meta=dict(record)) as out:
        count = 1 if touch.values.ndim == 1 + touch.surface.dimensions else len(touch.values)
        for i in range(count):
            one = touch.frame(i)
            out.touch(one, float(i) if touch.time is None else float(np.atleast_1d(touch.time)[i]))


def _csv(touch: Touch, name: str, record: Mapping[str, str]) -> None:
    traction = touch.traction
    if "time" not in traction.dims:
        traction = traction.expand_dims("time")
    names = [d for d in ("y", "x") if d in traction.dims]
    with open(name, "w", newline="", encoding="utf-8") as file:
        file.write(f"# {json.dumps(dict(record))}\n")
        writer = csv.writer(file)
        writer.writerow(
            ["time (s)", *(f"{n} (m)" for n in names), *(f"traction_{c} (Pa)" for c in touch.surface.components)]
        )
        time = traction["time"].values
        values = np.moveaxis(traction.values, 1, -1)
        axes = [traction[n].values for n in names]
        for t, frame in zip(time, values):
            for place in np.ndindex(*frame.shape[:-1]):
                where = [repr(float(a[i])) for a, i in zip(axes, place)]
                writer.writerow([repr(float(t)), *where, *(repr(float(v)) for v in frame[place])])


def read_touch(path: str | Path) -> Any:
    """The xarray.Dataset of a result written as NetCDF or Zarr, or of the touches in a stream's recording."""
    import xarray

    kind = file_format(path)
    if kind not in ("netcdf", "zarr"):
        raise InvalidInput(
            f"{path}: only NetCDF and Zarr results (.nc, .h5, .zarr) are read back; NPZ and CSV open in any tool."
        )
    if not Path(path).exists():
        raise InvalidInput(f"{path}: no such file.")
    if kind == "zarr":
        stores.zarr_library()

    def group(name: str | None) -> Any:
        if kind == "zarr":
            found = xarray.open_zarr(path, group=name, consolidated=False).load()
            return found.assign_coords(component=found.attrs["component"]) if "component" in found.attrs else found
        return xarray.load_dataset(path, engine="h5netcdf", group=name)

    try:
        found = group(None)
        return found if "traction" in found else group("touch")
    except (OSError, ValueError, KeyError) as error:
        raise InvalidInput(
            f"{path}: holds no touches that can be read; it is truncated, still being written, or of another format."
        ) from error
