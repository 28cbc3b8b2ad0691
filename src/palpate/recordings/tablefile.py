"""Tables of other programs: read only, with a `TableMapping` of their columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from palpate.errors import InvalidInput
from palpate.recordings.columns import TableMapping
from palpate.recordings.formats import Format
from palpate.recordings.mapped import explained, read_mapped
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.recording import Recording
from palpate.recordings.tabletext import Table as TextTable
from palpate.recordings.tabletext import Titles, read_table_text
from palpate.recordings.textlines import is_text

__all__ = ["Table"]


class Table(Format):
    """Text in columns, separated by tabs, blanks, semicolons or commas. A .csv may be such a table too."""

    name = "table"
    extensions = (".txt", ".tsv", ".dat")
    text = True

    def recognises(self, path: Path) -> bool:
        return is_text(path)

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        raise InvalidInput(f"{path} is a table of another program. {explained(path)}")

    def columns(self, path: Path, wanted: Callable[[Titles], Sequence[int]]) -> TextTable:
        return read_table_text(path, wanted)

    def read_mapped(self, path: Path, mapping: TableMapping) -> Recording:
        return read_mapped(path, mapping)
