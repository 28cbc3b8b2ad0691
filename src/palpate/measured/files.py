"""Read and write tables of presses: NetCDF with one variable for each column, or CSV with one line for each press and
taxel.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np

from palpate.elastic.channels import channel_unit, is_channel
from palpate.errors import InvalidInput
from palpate.measured.table import Table
from palpate.units import KIND_OF_SI, UNITS

__all__ = ["read_table", "write_table"]

#: Columns besides the channels, and the kind of their unit.
COLUMNS = {
    "press_x": "length", "press_y": "length", "force_x": "force", "force_y": "force", "force_z": "force", "contact_radius": "length",
    "taxel_x": "length", "taxel_y": "length", "press": "", "taxel": "",
}  # fmt: skip
#: Columns that every table must have.
NEEDED = ("press_x", "press_y", "force_z", "taxel_x", "taxel_y")
#: Largest number of lines of a CSV file: 3000 presses of 1000 taxels.
LINES = 3_000_000


def read_table(path: Path, radius: float | None, indenter: str | None) -> Table:
    """Read the table in a file. ``radius`` [m] and ``indenter`` are needed if the file does not state them, and
    override it if it does.

    Raises
    ------
    InvalidInput
        There is no such file, it is of another kind or lacks a column, or a unit is missing.
    """
    if not path.is_file():
        raise InvalidInput(
            f"{path}: there is no such file. Give a table of presses (.nc or .csv), such as Measured.save writes."
        )
    if path.suffix.lower() == ".csv":
        found = _csv(path)
    elif path.suffix.lower() in (".nc", ".nc3", ".netcdf"):
        found = _netcdf(path)
    else:
        raise InvalidInput(
            f"{path}: a table of presses is a .nc or a .csv. Write the table as CSV with the columns {', '.join(NEEDED)} and one per channel."
        )
    if radius is not None:
        found["radius"] = radius
    if indenter is not None:
        found["indenter"] = indenter
    if found.get("radius") is None:
        raise InvalidInput(
            f"{path} has no contact_radius. Give the radius of the disc that the indenter touched (radius= in Python, contact_radius in skin.toml; 0 for a "
            "point)."
        )
    try:
        return Table(**found)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from error


def _unit(path: Path, name: str, unit: str | None) -> float:
    """Return the factor that converts a column to SI units."""
    kind = COLUMNS[name] if name in COLUMNS else KIND_OF_SI[channel_unit(name)]
    if not kind:
        return 1.0
    if unit is None or not unit.strip():
        if name in COLUMNS:
            example = "mm" if kind == "length" else "N"
            raise InvalidInput(
                f"{path}: {name} has no unit. Name it {name} [{example}], or give the variable the attribute units."
            )
        return 1.0  # readings in SI units, or in counts like those of every later frame
    if unit.strip() not in UNITS[kind]:
        raise InvalidInput(f"{path}: {name} has the unit {unit!r}; accepted for a {kind}: {', '.join(UNITS[kind])}.")
    return UNITS[kind][unit.strip()]


def _check_columns(path: Path, names: list[str]) -> list[str]:
    """Return the columns that are channels; raise an error if none is, or a needed column is missing."""
    missing = [n for n in NEEDED if n not in names]
    channels = [n for n in names if is_channel(n)]
    if missing or not channels:
        what = ", ".join(missing) if missing else "a channel, such as stress_zz"
        raise InvalidInput(
            f"{path} has no column {what}; it has {', '.join(names[:12]) or 'none'}. A table of presses has {', '.join(NEEDED)} and one column per channel."
        )
    return channels


def _csv(path: Path) -> dict[str, Any]:
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.reader(line for line in file if line.strip() and not line.lstrip().startswith("#"))
        titles = next(reader, [])
        parts = [re.fullmatch(r"\s*([^\[\(]*?)\s*(?:[\[\(](.*)[\]\)])?\s*", t) for t in titles]
        names = [str(p[1]) if p else t for p, t in zip(parts, titles)]
        channels = _check_columns(path, names)
        factors = {
            n: _unit(path, n, p[2] if p else None) for n, p in zip(names, parts) if n in COLUMNS or n in channels
        }
        rows = []
        for number, row in enumerate(reader, 2):
            if number > LINES:
                raise InvalidInput(f"{path} has more than {LINES} lines. Take fewer presses.")
            try:
                rows.append([float(row[names.index(n)].strip() or "nan") for n in factors])
            except (ValueError, IndexError) as error:
                raise InvalidInput(f"{path}: line {number} after the title is no row of numbers ({error}).") from error
    if not rows:
        raise InvalidInput(f"{path} has no lines below its title.")
    table = {n: factor * column for (n, factor), column in zip(factors.items(), np.array(rows).T)}
    places = ["press", "press_x", "press_y", "force_x", "force_y", "force_z", "contact_radius"]
    pressed = np.stack([table[n] for n in places if n in table], axis=1)
    sat = np.stack([table["taxel_x"], table["taxel_y"]], axis=1)
    if not (np.isfinite(pressed).all() and np.isfinite(sat).all()):
        raise InvalidInput(f"{path}: places and forces must be numbers in every line.")
    taxels, taxel = np.unique(sat, axis=0, return_inverse=True)
    taxels, taxel = _in_order(taxels, taxel.ravel())
    # a repeated press counts as another press: the n-th line of a taxel belongs to its n-th repetition
    _, same = np.unique(pressed, axis=0, return_inverse=True)
    seen: dict[tuple[int, int], int] = {}
    times = np.empty(len(rows), dtype=np.intp)
    for i, key in enumerate(zip(same.ravel().tolist(), taxel.tolist())):
        times[i] = seen[key] = seen.get(key, -1) + 1
    keys, press = np.unique(np.stack([same.ravel(), times], axis=1), axis=0, return_inverse=True)
    press = press.ravel()
    count = np.bincount(press, minlength=len(keys))
    if (count != len(taxels)).any():
        short = int(np.argmin(count))
        line = rows[int(np.argmax(press == short))]
        raise InvalidInput(
            f"{path}: {int((count != len(taxels)).sum())} of {len(keys)} presses do not have one line for each of {len(taxels)} taxels (the press of the line "
            f"{', '.join(f'{v:g}' for v in line[:5])}... has {int(count[short])}). Write NaN for a taxel that is dead, in all presses."
        )
    first = np.array([int(np.argmax(press == i)) for i in range(len(keys))])
    readings = np.empty((len(keys), len(channels), len(taxels)))
    for i, name in enumerate(channels):
        readings[press, i, taxel] = table[name]
    zero = np.zeros(len(rows))
    return {
        "places": np.stack([table["press_x"], table["press_y"]], axis=1)[first],
        "force": np.stack([table.get(f"force_{c}", zero) for c in "xyz"], axis=1)[first],
        "readings": readings,
        "positions": taxels,
        "channels": channels,
        "radius": table["contact_radius"][first] if "contact_radius" in table else None,
    }


def _in_order(taxels: Any, taxel: Any) -> tuple[Any, Any]:
    """Return the taxels in the order in which the file first names them."""
    first = np.full(len(taxels), len(taxel))
    np.minimum.at(first, taxel, np.arange(len(taxel)))
    order = np.argsort(first)
    place = np.empty(len(order), dtype=np.intp)
    place[order] = np.arange(len(order))
    return taxels[order], place[taxel]


def _netcdf(path: Path) -> dict[str, Any]:
    import xarray

    try:
        with xarray.open_dataset(path, decode_times=False) as opened:
            data = opened.load()
    except Exception as error:  # each engine raises exceptions of its own
        raise InvalidInput(
            f"{path} cannot be read as NetCDF ({str(error)[:120]}). NetCDF 4 needs palpate[files]."
        ) from error
    names = [str(n) for n in data.variables]
    channels = _check_columns(path, names)

    def column(name: str, *dims: str) -> Any:
        found = data[name]
        if set(found.dims) != set(dims) and found.ndim:
            raise InvalidInput(f"{path}: {name} has the dimensions {found.dims}, and needs {dims}. Give it those.")
        unit = found.attrs.get("units")
        return _unit(path, name, None if unit is None else str(unit)) * np.asarray(
            found.transpose(*[d for d in dims if found.ndim]), dtype=np.float64
        )

    zero = np.zeros(data.sizes.get("press", 0))
    return {
        "places": np.stack([column("press_x", "press"), column("press_y", "press")], axis=1),
        "force": np.stack([column(f"force_{c}", "press") if f"force_{c}" in names else zero for c in "xyz"], axis=1),
        "readings": np.stack([column(c, "press", "taxel") for c in channels], axis=1),
        "positions": np.stack([column("taxel_x", "taxel"), column("taxel_y", "taxel")], axis=1),
        "channels": channels,
        "radius": column("contact_radius", "press") if "contact_radius" in names else None,
        "indenter": str(data.attrs.get("indenter", "hertz")),
    }


def write_table(table: Table, path: Path) -> None:
    """Write NetCDF that `read_table` reads (version 3, which needs no other library)."""
    import xarray

    def column(dims: tuple[str, ...], value: Any, unit: str) -> Any:
        return (dims, np.asarray(value), {"units": unit})

    readings = np.where(table.working, table.readings, np.nan)
    found = {
        "press_x": column(("press",), table.places[:, 0], "m"),
        "press_y": column(("press",), table.places[:, 1], "m"),
        **{f"force_{c}": column(("press",), table.force[:, i], "N") for i, c in enumerate("xyz")},
        "contact_radius": column(("press",), table.radius, "m"),
        "taxel_x": column(("taxel",), table.positions[:, 0], "m"),
        "taxel_y": column(("taxel",), table.positions[:, 1], "m"),
        **{c: column(("press", "taxel"), readings[:, i], channel_unit(c)) for i, c in enumerate(table.channels)},
    }
    xarray.Dataset(found, attrs={"indenter": table.indenter}).to_netcdf(path, engine="scipy")
