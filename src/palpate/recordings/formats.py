"""Recordings as NetCDF/HDF5, NPZ and CSV. A file is written beside its name and moved into place when complete."""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.elastic.half_space import Floats
from palpate.elastic.quantities import channel_unit
from palpate.errors import InvalidInput
from palpate.recordings import mcapfile
from palpate.recordings.files import atomically
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.recording import Recording
from palpate.units import convert_factor

__all__ = ["FORMATS", "atomically", "file_format", "read_recording", "read_table", "write_recording"]

#: file name ending -> format
FORMATS = {
    ".nc": "netcdf",
    ".h5": "netcdf",
    ".hdf5": "netcdf",
    ".npz": "npz",
    ".csv": "csv",
    ".mcap": "mcap",
    ".zarr": "zarr",
}


def file_format(path: str | Path) -> str:
    """The format of a file name, or `InvalidInput`."""
    suffix = Path(path).suffix.lower()
    if suffix not in FORMATS:
        raise InvalidInput(f"{path}: the ending {suffix!r} is not known; accepted: {', '.join(FORMATS)}.")
    return FORMATS[suffix]


def _existing(path: str | Path) -> Path:
    found = Path(path)
    if not found.exists():
        raise InvalidInput(f"{found}: no such file.")
    if found.is_dir():
        raise InvalidInput(f"{found} is a folder; give a file.")
    if found.stat().st_size == 0:
        raise InvalidInput(f"{found} is empty.")
    return found


# -- reading -----------------------------------------------------------------------------------------------------------


def read_recording(path: str | Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
    """Read a recording; the format follows the file name (`FORMATS`), a folder is a ROS 2 bag or a Zarr store.

    ``mapping`` says where the readings are in a robot's MCAP file or bag (palpate's own need none). ``salvage`` reads a torn file as far
    as it goes (MCAP, and HDF5 that a `Recorder` did not close).
    """
    from palpate.recordings import robots

    found = Path(path)
    if robots.is_bag(found):
        return robots.read_robot(found, mapping)
    kind = file_format(path)
    if kind == "zarr":
        from palpate.recordings.stores import read_zarr

        return read_zarr(found)
    found = _existing(path)
    if kind == "mcap":
        if mapping is not None and mcapfile.own(found) is not None and mapping.topic not in robots.topics(found):
            mapping = None  # the mapping of a robot's messages does not concern palpate's own
        return robots.read_robot(found, mapping, salvage=salvage)
    if kind == "netcdf":
        return _read_netcdf(found, salvage)
    return {"npz": _read_npz, "csv": _read_csv}[kind](found)


def _json(text: bytes | str, what: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InvalidInput(f"{what} cannot be read; the file may be truncated.") from error


def _decode(text: bytes | str, path: Path) -> dict[str, str]:
    loaded = _json(text, f"{path}: meta")
    if not isinstance(loaded, dict):
        raise InvalidInput(f"{path}: meta must be a JSON object.")
    return {str(k): str(v) for k, v in loaded.items()}


def _read_netcdf(path: Path, salvage: bool) -> Recording:
    import h5py

    try:
        # what a killed recorder left is open for writing still, and can only be read beside it
        with h5py.File(path, "r", swmr=salvage) as file:
            missing = [n for n in ("readings", "channel", "time") if n not in file]
            if missing:
                raise InvalidInput(
                    f"{path}: not a palpate recording: it lacks {', '.join(missing)} (it holds {', '.join(file) or 'nothing'})."
                )
            channels = [c.decode() if isinstance(c, bytes) else str(c) for c in file["channel"][()]]
            count = min(len(file["readings"]), len(file["time"]))
            return Recording(
                readings=file["readings"][:count],
                channels=tuple(channels),
                time=file["time"][:count],
                positions=file["positions"][()] if "positions" in file else None,
                meta=_decode(file.attrs["meta"], path) if "meta" in file.attrs else {},
            )
    except OSError as error:
        raise InvalidInput(
            f"{path}: cannot be read as NetCDF/HDF5; it is still being written, truncated, or of another format. palpate convert "
            "--salvage takes what a recording that was broken off holds."
        ) from error


def _read_npz(path: Path) -> Recording:
    import zipfile

    try:
        with path.open("rb") as handle, np.load(handle, allow_pickle=False) as file:
            missing = [n for n in ("readings", "channel", "time") if n not in file]
            if missing:
                raise InvalidInput(
                    f"{path}: not a palpate recording: it lacks {', '.join(missing)} (it holds {', '.join(file) or 'nothing'})."
                )
            return Recording(
                readings=file["readings"],
                channels=tuple(str(c) for c in file["channel"]),
                time=file["time"],
                positions=file.get("positions"),
                meta=_decode(str(file["meta"]), path) if "meta" in file else {},
            )
    except (zipfile.BadZipFile, EOFError, OSError, KeyError) as error:
        raise InvalidInput(f"{path}: cannot be read as NPZ; the file is truncated or of another format.") from error
    except ValueError as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"{path}: cannot be read as NPZ; the file is truncated or of another format.") from error


_COLUMN = re.compile(r"^(?P<name>\w+?)(?:\[(?P<index>[\d;]+)\])?(?:\s*\((?P<unit>[^)]*)\))?$")


def _read_csv(path: Path) -> Recording:
    """Columns "time (s)", then "channel[taxel] (unit)" or "channel[row;column] (unit)"; scattered positions in comments."""
    meta: dict[str, str] = {}
    positions: Any = None
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = file.read().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path}: cannot be read as text.") from error
    body = []
    for number, line in enumerate(lines, 1):
        if line.startswith("# positions (m): "):
            positions = np.array(_json(line.removeprefix("# positions (m): "), f"{path}, line {number}: positions"))
        elif line.startswith("# meta: "):
            meta = _decode(line.removeprefix("# meta: "), path)
        elif line.strip() and not line.startswith("#"):
            body.append((number, line))
    if len(body) < 2:
        raise InvalidInput(f"{path}: no frames; a CSV recording has a header line and one line per frame.")
    header = next(csv.reader([body[0][1]]))
    columns = []
    for title in header:
        match = _COLUMN.match(title.strip())
        if match is None:
            raise InvalidInput(f'{path}, line {body[0][0]}: column {title!r} is not like "stress_zz[0;1] (Pa)".')
        columns.append(match)
    if columns[0]["name"] != "time":
        raise InvalidInput(f'{path}, line {body[0][0]}: the first column must be "time (s)"; got {header[0]!r}.')
    channels: list[str] = []
    places: list[tuple[int, ...]] = []
    factors = [convert_factor(columns[0]["unit"] or "", "s", f"{path}: time")]
    for match, title in zip(columns[1:], header[1:]):
        name = match["name"]
        if match["index"] is None or name.split("_")[0] not in ("displacement", "stress", "strain"):
            raise InvalidInput(f'{path}, line {body[0][0]}: column {title!r} is not like "stress_zz[0;1] (Pa)".')
        if match["unit"] is None:
            raise InvalidInput(
                f'{path}, line {body[0][0]}: column {title!r} has no unit: write "{title} (Pa)" or the like.'
            )
        if name not in channels:
            channels.append(name)
        place = tuple(int(i) for i in match["index"].split(";"))
        places.append((channels.index(name), *place))
        factors.append(convert_factor(match["unit"], channel_unit(name), f"{path}: {title}"))
    if len({len(p) for p in places}) != 1:
        raise InvalidInput(f"{path}: columns mix one and two indices.")
    shape = tuple(int(m) + 1 for m in np.max(places, axis=0))
    if len(set(places)) != len(places) or len(places) != int(np.prod(shape)):
        raise InvalidInput(
            f"{path}: {len(places)} columns do not fill {len(channels)} channels of {shape[1:]} taxels once each."
        )
    data = np.full((len(body) - 1, *shape), np.nan)
    time = np.empty(len(body) - 1)
    index = tuple(np.array(places).T)
    for row, (number, line) in enumerate(body[1:]):
        cells = next(csv.reader([line]))
        if len(cells) != len(header):
            raise InvalidInput(
                f"{path}, line {number}: {len(cells)} values for {len(header)} columns; the file may be truncated."
            )
        try:
            numbers = [float(c) if c.strip() else np.nan for c in cells]
        except ValueError as error:
            raise InvalidInput(f"{path}, line {number}: {str(error).split(': ')[-1]} is not a number.") from error
        time[row] = numbers[0] * factors[0]
        data[(row, *index)] = np.array(numbers[1:]) * factors[1:]
    return Recording(readings=data, channels=tuple(channels), time=time, positions=positions, meta=meta)


# -- writing -----------------------------------------------------------------------------------------------------------


def write_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording; the format follows the file name.

    NetCDF, NPZ and Zarr keep every bit, CSV writes 17 digits, MCAP single precision and nanoseconds.
    """
    kind = file_format(path)
    if kind == "csv" and len(set(recording.channels)) != len(recording.channels):
        raise InvalidInput(
            f"{path}: a CSV names each column once, but the recording has one channel on several planes; write .nc or .npz."
        )
    if kind == "zarr":
        from palpate.recordings.stores import write_zarr

        write_zarr(recording, path)
        return
    writer = {"netcdf": _write_netcdf, "npz": _write_npz, "csv": _write_csv, "mcap": _write_mcap}[kind]
    atomically(path, lambda name: writer(recording, name))


def _dimensions(recording: Recording) -> tuple[str, ...]:
    return ("time", "channel", "taxel") if recording.readings.ndim == 3 else ("time", "channel", "y", "x")


def _write_netcdf(recording: Recording, name: str) -> None:
    import h5netcdf
    import h5py

    readings = recording.readings
    with h5netcdf.File(name, "w") as file:
        for dimension, size in zip(_dimensions(recording), readings.shape):
            file.dimensions[dimension] = size
        variable = file.create_variable("readings", _dimensions(recording), data=readings, compression="gzip")
        variable.attrs["long_name"] = "sensor readings in SI units, compression positive"
        time = file.create_variable("time", ("time",), data=recording.time)
        time.attrs["units"] = "s"
        text = h5py.string_dtype()
        file.create_variable("channel", ("channel",), data=np.array(recording.channels, dtype=object), dtype=text)
        file.create_variable("unit", ("channel",), data=np.array(recording.units, dtype=object), dtype=text)
        if recording.positions is not None:
            dims: tuple[str, ...] = ("taxel",)
            if recording.positions.ndim == 2:
                file.dimensions["axis"] = 2
                dims = ("taxel", "axis")
            positions = file.create_variable("positions", dims, data=recording.positions)
            positions.attrs["units"] = "m"
        file.attrs["meta"] = json.dumps(recording.meta)
        file.attrs["Conventions"] = "palpate recording 1"


def _write_mcap(recording: Recording, name: str) -> None:
    os.unlink(name)  # a recorder makes its own file
    mcapfile.write_mcap(recording, name)


def _write_npz(recording: Recording, name: str) -> None:
    arrays: dict[str, Any] = {
        "readings": recording.readings,
        "time": recording.time,
        "channel": np.array(recording.channels),
        "unit": np.array(recording.units),
        "meta": np.array(json.dumps(recording.meta)),
    }
    if recording.positions is not None:
        arrays["positions"] = recording.positions
    with open(name, "wb") as file:
        np.savez_compressed(file, **arrays)


def _write_csv(recording: Recording, name: str) -> None:
    readings = recording.readings
    shape = readings.shape[2:]
    with open(name, "w", newline="", encoding="utf-8") as file:
        file.write("# palpate recording 1\n")
        file.write(f"# meta: {json.dumps(recording.meta)}\n")
        if recording.positions is not None:
            file.write(f"# positions (m): {json.dumps(recording.positions.tolist())}\n")
        writer = csv.writer(file)
        titles = [
            f"{c}[{';'.join(map(str, place))}] ({u})"
            for c, u in zip(recording.channels, recording.units)
            for place in np.ndindex(*shape)
        ]
        writer.writerow(["time (s)", *titles])
        for t, frame in zip(recording.time, readings.reshape(len(readings), -1)):
            writer.writerow([repr(float(t)), *("" if np.isnan(v) else repr(float(v)) for v in frame)])


# -- tables of others --------------------------------------------------------------------------------------------------


def read_table(
    path: str | Path,
    *,
    columns: Sequence[str],
    channels: Sequence[str],
    position_factor: float = 1.0,
    reading_factor: float = 1.0,
    follow: bool = False,
) -> Recording:
    """One frame of scattered readings from a CSV table with a header, or from ``pos`` and ``vec`` of an HDF5 file.

    Parameters
    ----------
    columns : sequence of str
        For a CSV table: the columns that hold x, y and then each channel. For HDF5: the data sets that hold positions and
        vectors, shaped (2, n) or (n, 2).
    channels : sequence of str
        What the reading columns are.
    position_factor, reading_factor : float
        Multiply positions to metres and readings to SI units, e.g. 1e-6/1.3 for pixels of 1.3 per micrometre.
    follow : bool
        Move each position by its own displacement (the vectors then belong to where the markers went).
    """
    found = _existing(path)
    if found.suffix.lower() in (".h5", ".hdf5"):
        values = _read_h5_vectors(found, columns)
    else:
        values = _read_columns(found, columns)
    if len(values) != 2 + len(channels):
        raise InvalidInput(
            f"{found}: {len(values)} columns for x, y and {len(channels)} channels ({', '.join(channels)})."
        )
    positions = values[:2].T * position_factor
    readings = values[2:] * reading_factor
    if follow:
        shift = {c.split("_")[1]: r for c, r in zip(channels, readings) if c.startswith("displacement")}
        positions = positions + np.stack([shift.get("x", 0 * readings[0]), shift.get("y", 0 * readings[0])], axis=1)
    return Recording(
        readings=readings[None], channels=tuple(channels), positions=positions, meta={"source": found.name}
    )


def _read_h5_vectors(path: Path, names: Sequence[str]) -> Floats:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            missing = [n for n in names if n not in file]
            if missing or len(names) != 2:
                raise InvalidInput(
                    f"{path}: name two data sets, positions and vectors, among {', '.join(file)}; got {', '.join(names)}."
                )
            parts = [np.asarray(file[n][()], dtype=np.float64) for n in names]
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read as HDF5; the file is truncated or of another format.") from error
    parts = [p if p.shape[0] == 2 else p.T for p in parts]
    if any(p.ndim != 2 or p.shape[0] != 2 for p in parts) or parts[0].shape != parts[1].shape:
        raise InvalidInput(f"{path}: {' and '.join(names)} must have shape (2, n) or (n, 2) each.")
    return np.concatenate(parts)


def _read_columns(path: Path, columns: Sequence[str]) -> Floats:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidInput(f"{path}: cannot be read as a CSV table.") from error
    header = [c.strip() for c in rows[0]]
    missing = [c for c in columns if c not in header]
    if missing:
        raise InvalidInput(f"{path}: no column {', '.join(missing)}; it has {', '.join(header)}.")
    index = [header.index(c) for c in columns]
    values = np.empty((len(columns), len(rows) - 1))
    for number, row in enumerate(rows[1:], 2):
        try:
            values[:, number - 2] = [float(row[i]) for i in index]
        except (ValueError, IndexError) as error:
            raise InvalidInput(
                f"{path}, line {number}: not {len(columns)} numbers; the file may be truncated."
            ) from error
    return values
