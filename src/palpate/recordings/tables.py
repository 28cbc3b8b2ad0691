"""Tables that other programs made: positions and vectors of one frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate._files import ordinary
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.formats import existing
from palpate.recordings.mapped import check_apart, check_one_frame, is_frame
from palpate.recordings.netcdf import DAMAGE, NetCDF, data_sets, guard, opened
from palpate.recordings.recording import Recording
from palpate.recordings.tabletext import Titles, read_table_text

__all__ = ["read_table"]


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

    values = read_table_text(path, wanted).values.T
    if unnamed:
        check_one_frame(path, unnamed[0], values[-1])
    check_apart(path, values[:2].T, unit="")
    return values[: len(columns)]
