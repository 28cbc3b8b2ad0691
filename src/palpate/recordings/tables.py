"""Tables of other programs with positions of taxels, or with positions and vectors of one frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate._files import ordinary
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.columns import per_count
from palpate.recordings.damage import DAMAGE
from palpate.recordings.formats import endings, existing
from palpate.recordings.mapped import check_distinct, check_one_frame, is_frame, plain_name
from palpate.recordings.netcdf import NetCDF, data_sets, guard, opened
from palpate.recordings.recording import Recording
from palpate.recordings.tabletext import Titles, read_table_text
from palpate.units import UNITS

__all__ = ["read_positions", "read_table"]


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
        For a CSV table: the columns that hold x, y and then each channel. For HDF5: the data sets of positions and vectors, shaped (2, n) or (n, 2).
    channels : sequence of str
        Channels of the reading columns.
    position_factor, reading_factor : float
        Multiply positions to metres and readings to SI units, e.g. 1e-6/1.3 for pixels of 1.3 per micrometre.
    follow : bool
        Move each position by its own displacement (the vectors then belong to the moved markers).

    Raises
    ------
    InvalidInput
        No such file, an empty one, columns that are not there or are there twice, lines of another length, cells that are no numbers, two lines at one
        place, a column of frames or times (a table of several frames is read by `read_recording` with a `TableMapping`).

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings import read_table
    >>> table = '''x,y,dx
    ... 0,0,1
    ... 100,0,2
    ... 0,100,1
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/beads.csv").write_text(table)
    ...     beads = read_table(
    ...         f"{folder}/beads.csv",
    ...         columns=["x", "y", "dx"],
    ...         channels=["displacement_x"],
    ...         position_factor=1e-6,  # from micrometres
    ...         reading_factor=1e-6,
    ...     )
    >>> beads.positions[1].round(9).tolist(), beads.readings.round(9).tolist()
    ([0.0001, 0.0], [[[1e-06, 2e-06, 1e-06]]])
    """
    found = ordinary(path)
    if found.stat().st_size == 0:
        raise InvalidInput(f"{found} is empty.")
    if found.suffix.lower() in NetCDF.extensions:
        existing(found)
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
        shift = dict(zip(channels, readings))
        still = np.zeros_like(readings[0])
        positions = positions + np.stack([shift.get(f"displacement_{i}", still) for i in "xy"], axis=1)
    return Recording(
        readings=readings[None], channels=tuple(channels), positions=positions, meta={"source": found.name}
    )


#: Accepted titles in a table of positions.
_PLACES = {
    "number": (
        "taxel",
        "sensor",
        "channel",
        "marker",
        "id",
        "number",
        "no",
        "n",
        "i",
        "index",
        "taxel_id",
        "sensor_id",
    ),
    "x": ("x", "px", "pos_x", "position_x", "x0", "cx"),
    "y": ("y", "py", "pos_y", "position_y", "y0", "cy"),
    "z": ("z", "pz", "pos_z", "position_z", "z0", "cz"),
}


def read_positions(path: str | Path, *, unit: str | None = None) -> Floats:
    """Positions (taxel, 2) or (taxel, 1) [m] from a table with the columns x and y, or x alone on a line.

    Parameters
    ----------
    unit : str, optional
        What a 1 means, "mm"; without it the titles must name units, "x (mm)".

    Where a column numbers the taxels ("taxel"), they come in the order of these numbers, else in that of the lines. A table without titles has two
    columns, x and y.

    Raises
    ------
    InvalidInput
        No columns x and y, no unit or two of them, cells without a number, taxels that are there twice or at several heights.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.recordings.tables import read_positions
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/taxels.csv").write_text("taxel,x (mm),y (mm)\\n1,2,0\\n0,0,0\\n")
    ...     read_positions(f"{folder}/taxels.csv").tolist()
    [[0.0, 0.0], [0.002, 0.0]]
    """
    found, known = existing(path)
    roles: dict[str, int] = {}

    def wanted(titles: Titles) -> list[int]:
        if titles.titled:
            plain = [plain_name(n) for n in titles.names]
            for role, names in _PLACES.items():
                name = next((n for n in names if n in plain), None)
                if name is not None:
                    roles[role] = plain.index(name)
        elif len(titles.names) == 2:
            roles.update(x=0, y=1)
        if "x" not in roles:
            raise InvalidInput(
                f"{found}: no columns of positions; it has {titles.listed()}. Write titles into its first line, such as taxel,x (mm),y (mm)."
            )
        return list(roles.values())

    table = known.columns(found, wanted)
    values = dict(zip(roles, table.values.T))
    for role, numbers in values.items():
        if not np.isfinite(numbers).all():
            line = int(table.lines[int(np.argmin(np.isfinite(numbers)))])
            raise InvalidInput(f"{found}, line {line}: no number in the column {table.titles.names[roles[role]]}.")
    scale = {role: _metres(found, table.titles, roles[role], unit) for role in "xyz" if role in roles}
    places = np.stack([values[role] * scale[role] for role in "xy" if role in roles], axis=1)
    if "z" in values and np.ptp(values["z"]) * scale["z"] > 0.05 * np.ptp(places, axis=0).max():
        raise InvalidInput(
            f"{found}: the taxels lie at heights z from {values['z'].min():g} to {values['z'].max():g}, and a plane of a skin is flat. Describe each height as a plane of its own, or lay "
            "the surface out flat and leave z out."
        )
    apart, counts = np.unique(places, axis=0, return_counts=True)
    if (counts > 1).any():
        where = ", ".join(f"{v:g}" for v in apart[int(np.argmax(counts))])
        raise InvalidInput(
            f"{found}: {counts.max()} taxels are at the same place ({where}) m. Take out the lines of taxels that measure nothing, and mend those that are mistaken."
        )
    if "number" in values:
        order = np.argsort(values["number"], kind="stable")
        double = np.flatnonzero(np.diff(values["number"][order]) == 0)
        if len(double):
            raise InvalidInput(f"{found}: two lines are of taxel {values['number'][order[double[0]]]:g}.")
        places = places[order]
    return places


def _metres(path: Path, titles: Titles, place: int, unit: str | None) -> float:
    said = titles.unit(place)
    if said is not None and said in UNITS["length"]:
        if unit is not None and per_count(unit, "length") != UNITS["length"][said]:
            raise InvalidInput(
                f"{path}: the title {titles.names[place]!r} says {said}, but positions_unit {unit}: leave out the wrong one."
            )
        return UNITS["length"][said]
    if unit is None:
        raise InvalidInput(
            f'{path}: no unit of the column {titles.names[place]!r}: write positions_unit = "mm" below positions_file, or the title {titles.names[place]} (mm).'
        )
    return per_count(unit, "length")


def _read_h5_vectors(path: Path, names: Sequence[str]) -> Floats:
    try:
        with opened(path) as file:
            held = data_sets(file)
            missing = [n for n in names if n not in held]
            if missing or len(names) != 2:
                raise InvalidInput(
                    f"{path}: name two data sets, positions and vectors, among {', '.join(held)}; got {', '.join(names)}."
                )
            guard(file, path)
            parts = [np.asarray(held[n][()], dtype=np.float64) for n in names]
    except InvalidInput:
        raise
    except DAMAGE as error:
        raise InvalidInput(
            f"{path}: cannot be read as HDF5; the file is truncated, damaged or of another format."
        ) from error
    if any(p.ndim != 2 or 2 not in p.shape for p in parts):
        raise InvalidInput(f"{path}: {' and '.join(names)} must have shape (2, n) or (n, 2) each.")
    parts = [p if p.shape[0] == 2 else p.T for p in parts]
    if parts[0].shape != parts[1].shape:
        raise InvalidInput(f"{path}: {' and '.join(names)} must have shape (2, n) or (n, 2) each.")
    return np.concatenate(parts)


def _read_columns(path: Path, columns: Sequence[str]) -> Floats:
    unnamed: list[str] = []

    def wanted(titles: Titles) -> list[int]:
        for name in columns:
            if list(columns).count(name) > 1:
                raise InvalidInput(f"the column {name} is named twice; name one for each of x, y and the channels.")
        unnamed.extend([n for n in titles.names if is_frame(n) and n not in columns][:1])
        return [titles.find(n) for n in (*columns, *unnamed)]

    other = path.suffix.lower() in endings("columns")
    values = (existing(path)[1].columns if other else read_table_text)(path, wanted).values.T
    if unnamed:
        check_one_frame(path, unnamed[0], values[-1])
    check_distinct(path, values[:2].T, unit="")
    return values[: len(columns)]
