"""Tables in binary formats: Parquet (such as LeRobot's data sets), and NumPy's .npy and .npz. No content of a file is
ever executed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate._memory import require
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.columns import TableMapping
from palpate.recordings.formats import Format, shell_line
from palpate.recordings.mapped import explained, read_mapped
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.recording import Recording
from palpate.recordings.tabletext import Table, Titles

__all__ = ["Npy", "Parquet", "array_table", "array_titles"]

#: A function that picks columns: from the titles to their indices.
Wanted = Callable[[Titles], Sequence[int]]
_NO_TEXT = "{path}: the column {name} holds {kind}, and readings are numbers; name another column."


class _ArrayTable(Format):
    """A table of another program in a binary format."""

    def titles(self, path: Path) -> Titles:
        """The names of its columns; those of a column that holds several numbers a line are name[0], name[1], ..."""
        raise NotImplementedError

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        raise InvalidInput(f"{path} is a table. {explained(path, self.titles)}")

    def read_mapped(self, path: Path, mapping: TableMapping) -> Recording:
        return read_mapped(path, mapping, read=self.columns)


# -- arrays by name ----------------------------------------------------------------------------------------------------


def _named(arrays: Iterable[tuple[str, tuple[int, ...]]]) -> tuple[list[str], list[tuple[str, int]]]:
    """Titles of arrays (frame, ...), and for each title the array and the index of the number in a line."""
    titles, places = [], []
    for name, shape in arrays:
        for i in range(math.prod(shape)):
            titles.append(f"{name}[{i}]" if shape else name)
            places.append((name, i))
    return titles, places


def array_titles(path: Path, arrays: dict[str, Any]) -> tuple[Titles, list[tuple[str, int]]]:
    """Titles of the columns of named arrays with a common first length."""
    names, places = _named((name, a.shape[1:]) for name, a in arrays.items())
    return Titles(str(path), tuple(names), True), places


def array_table(path: Path, arrays: dict[str, Any], wanted: Wanted) -> Table:
    """The columns of named arrays (frame, ...) that ``wanted`` picks."""
    titles, places = array_titles(path, arrays)
    return _picked(titles, [places[i] for i in wanted(titles)], lambda name: _floats(path, name, arrays[name]))


def _picked(titles: Titles, places: Sequence[tuple[str, int]], column: Callable[[str], Floats]) -> Table:
    columns = {name: column(name) for name in dict.fromkeys(name for name, _ in places)}
    values = np.stack([columns[name][:, i] for name, i in places], axis=1)
    return Table(titles, values, np.arange(1, len(values) + 1))


def _floats(path: Path, name: str, values: Any) -> Floats:
    """An array as (row, number); times in seconds."""
    values = np.asarray(values)
    flat = values.reshape(len(values), -1)
    if flat.dtype.kind in "mM":
        unit = "datetime64[ns]" if flat.dtype.kind == "M" else "timedelta64[ns]"
        missing = np.isnat(flat)
        return np.where(missing, np.nan, flat.astype(unit).astype(np.int64) / 1e9)
    if flat.dtype.kind not in "fiub":
        kind = {"c": "complex numbers", "S": "text", "U": "text"}.get(flat.dtype.kind, f"{flat.dtype}")
        raise InvalidInput(_NO_TEXT.format(path=path, name=name, kind=kind))
    found = flat.astype(np.float64)
    if np.isinf(found).any():
        raise InvalidInput(f"{path}: the column {name} holds infinite values. Save readings that are missing as NaN.")
    return found


# -- NumPy -------------------------------------------------------------------------------------------------------------


class Npy(_ArrayTable):
    """One NumPy array with one line per frame; a structured array has its fields as columns."""

    name = "npy"
    extensions = (".npy",)

    def recognises(self, path: Path) -> bool:
        with path.open("rb") as file:
            return file.read(6) == b"\x93NUMPY"

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        try:
            return super().read(path, mapping=mapping, salvage=salvage)
        except InvalidInput as error:
            raise InvalidInput(f"{error} A displacement field is for palpate tfm.") from error

    def titles(self, path: Path) -> Titles:
        return self._titles(path, _held(path))[0]

    def columns(self, path: Path, wanted: Wanted) -> Table:
        held = _held(path)
        titles, places = self._titles(path, held)
        return _picked(
            titles,
            [places[i] for i in wanted(titles)],
            lambda name: _floats(path, name, held[name] if held.dtype.names else held),
        )

    @staticmethod
    def _titles(path: Path, held: Any) -> tuple[Titles, list[tuple[str, int]]]:
        if held.dtype.names:
            return array_titles(path, {name: held[name] for name in held.dtype.names})
        count = math.prod(held.shape[1:])
        return Titles(str(path), tuple(map(str, range(1, count + 1))), False), [("", i) for i in range(count)]


def _held(path: Path) -> Any:
    """The array in a .npy file, memory-mapped; anything but a plain array of numbers is refused unread."""
    try:
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            _, _, dtype = read(file)
        if dtype.hasobject:
            target = str(path.with_name(path.stem + "-numbers.npy"))
            code = f"numpy.save({target!r}, numpy.load({str(path)!r}, allow_pickle=True).astype(float))"
            raise InvalidInput(
                f"{path} holds Python objects, which can run any program when they are read, and is not read. If you trust who made it, save its numbers: {shell_line('numpy', code)}"
            )
        held = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError, SyntaxError, TypeError, OverflowError) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(
            f"{path}: cannot be read as NPY; the file is truncated, damaged or of another format."
        ) from error
    if held.ndim == 0 or 0 in held.shape:
        raise InvalidInput(f"{path}: the array has shape {held.shape}; a table has a line per frame.")
    return held


# -- Parquet -----------------------------------------------------------------------------------------------------------


class Parquet(_ArrayTable):
    """Columns of numbers, of times, and of lists with a constant length (LeRobot's observations)."""

    name = "parquet"
    extensions = (".parquet", ".pq")
    libraries = ("pyarrow",)

    def recognises(self, path: Path) -> bool:
        with path.open("rb") as file:
            return file.read(4) == b"PAR1"

    def titles(self, path: Path) -> Titles:
        with _Parquet(path) as file:
            return file.titles

    def columns(self, path: Path, wanted: Wanted) -> Table:
        with _Parquet(path) as file:
            places = [file.places[i] for i in wanted(file.titles)]
            require(
                24.0 * file.rows * len(places),
                f"{file.rows} lines of {len(places)} numbers",
                "Name fewer columns, or save part of the table.",
            )
            return _picked(file.titles, places, file.column)


class _Parquet:
    """An open Parquet file: the titles of its columns, and each column as numbers."""

    def __init__(self, path: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._path, self._pa = path, pa
        self._damage = (pa.ArrowException, OSError, ValueError, TypeError)
        try:
            self._file = pq.ParquetFile(path)
            self.rows = int(self._file.metadata.num_rows)
            schema = self._file.schema_arrow
            first = next(iter(self._file.iter_batches(batch_size=1)), None) if self.rows else None
        except self._damage as error:
            raise self._damaged() from error
        if first is None or not schema.names:
            raise InvalidInput(f"{path}: no lines; a table of Parquet has columns with a line per frame.")
        if len(set(schema.names)) != len(schema.names):
            raise InvalidInput(f"{path}: two columns have one name; save the table again with a name for each.")
        shapes = []
        for i, field in enumerate(schema):
            try:
                count, _ = self._flat(first.column(i), field.name)
            except InvalidInput:  # an empty list: the reader of the column reports it
                count = None
            shapes.append((field.name, () if count is None else (count,)))
        names, self.places = _named(shapes)
        self.titles = Titles(str(path), tuple(names), True)

    def __enter__(self) -> _Parquet:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def column(self, name: str) -> Floats:
        """A column as (row, number)."""
        try:
            whole = self._file.read(columns=[name]).column(name).combine_chunks()
        except self._damage as error:
            raise self._damaged() from error
        count, flat = self._flat(whole, name)
        if self._pa.types.is_timestamp(flat.type) or self._pa.types.is_duration(flat.type):
            values = flat.to_numpy(zero_copy_only=False)
        elif self._pa.types.is_boolean(flat.type) or self._pa.types.is_decimal(flat.type):
            values = np.array([np.nan if v is None else float(v) for v in flat.to_pylist()])
        elif self._pa.types.is_floating(flat.type) or self._pa.types.is_integer(flat.type):
            values = flat.to_numpy(zero_copy_only=False)
        else:
            raise InvalidInput(_NO_TEXT.format(path=self._path, name=name, kind=str(flat.type)))
        if len(values) != self.rows * (count or 1):
            raise InvalidInput(
                f"{self._path}: the lines of {name} hold {count} numbers, the first another count; save a table with as many in each."
            )
        return _floats(self._path, name, values.reshape(self.rows, count or 1))

    def _flat(self, column: Any, name: str) -> tuple[int | None, Any]:
        """Length of the lists in a column (None: no lists), and all its numbers in sequence."""
        import pyarrow.compute as pc

        types, count = self._pa.types, None
        while True:
            column = column.storage if isinstance(column, self._pa.ExtensionArray) else column
            if not (
                types.is_list(column.type) or types.is_large_list(column.type) or types.is_fixed_size_list(column.type)
            ):
                return count, column
            sizes = pc.min_max(pc.list_value_length(column).fill_null(0)).as_py()
            if sizes["min"] != sizes["max"] or not sizes["max"]:
                raise InvalidInput(
                    f"{self._path}: the lines of {name} hold {sizes['min']} to {sizes['max']} numbers; save a table with as many in each."
                )
            column, count = column.flatten(), sizes["max"] * (count or 1)

    def _damaged(self) -> InvalidInput:
        return InvalidInput(
            f"{self._path}: cannot be read as Parquet; the file is truncated, damaged or of another format."
        )
