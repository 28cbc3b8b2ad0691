"""The text of a table of another program: its separator, decimals, titles and numbers."""

from __future__ import annotations

import csv
import math
import operator
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.dates import TimeCells, is_date
from palpate.recordings.textlines import lines_of, number, warn_of_a_cut
from palpate.units import plain_unit

__all__ = ["Table", "Titles", "first_titles", "read_table_text"]

#: Separators in the order in which they are tried; None: blanks.
SEPARATORS = ("\t", ";", ",", None)
_UNIT = re.compile(r"^(?P<name>.*?)\s*[(\[](?P<unit>[^()\[\]]*)[)\]]$")
_MISSING = ("", "nan", "na", "n/a", "null")
_PLAIN = re.compile(r"[-+0-9.eE ]*")
_GROUPED = re.compile(r"\s*[+-]?[1-9]\d{0,2},\d{3}\s*")


@dataclass(frozen=True)
class Titles:
    """The columns of a table by name; where it has no titles they are "1", "2", ...

    Examples
    --------
    >>> from palpate.recordings.tabletext import Titles
    >>> titles = Titles("dots.csv", ("frame", "dx (mm)"), True)
    >>> titles.find("dx"), titles.unit(1)
    (1, 'mm')
    """

    source: str
    names: tuple[str, ...]
    titled: bool

    def find(self, name: str) -> int:
        """The place of a column, by its title with or without its unit."""
        places = [i for i, n in enumerate(self.names) if n == name]
        places = places or [i for i, n in enumerate(self.names) if _bare(n) == name]
        if not places:
            raise InvalidInput(f"{self.source}: no column {name}; it has {self.listed()}.")
        if len(places) > 1:
            raise InvalidInput(
                f"{self.source}: the column {name} is there {len(places)} times; name each column once in its first line."
            )
        return places[0]

    def matching(self, pattern: str) -> dict[str, int]:
        """What stands for ``{}`` -> the place of the column, numbers in their order."""
        before, _, after = pattern.partition("{}")
        expression = re.compile(f"{re.escape(before)}(.+?){re.escape(after)}")
        found: dict[str, int] = {}
        for i, title in enumerate(self.names):
            match = expression.fullmatch(title) or expression.fullmatch(_bare(title))
            if match is not None:
                if match[1] in found:
                    raise InvalidInput(
                        f"{self.source}: the column {title} is there twice; name each column once in its first line."
                    )
                found[match[1]] = i
        numbered = {k: v for k, v in found.items() if re.fullmatch(r"\d{1,9}", k)}
        if numbered:
            found = dict(sorted(numbered.items(), key=lambda item: int(item[0])))
        if not found:
            raise InvalidInput(f"{self.source}: no column is like {pattern}; it has {self.listed()}.")
        return found

    def unit(self, place: int) -> str | None:
        """The unit in the title of a column."""
        match = _UNIT.match(self.names[place])
        return plain_unit(match["unit"]) if match is not None and self.titled else None

    def listed(self) -> str:
        """The titles in words."""
        some = ", ".join(self.names[:12])[:300] + (f" and {len(self.names) - 12} more" if len(self.names) > 12 else "")
        return some if self.titled else f"{len(self.names)} columns without titles: name them by their numbers {some}"


def _bare(title: str) -> str:
    match = _UNIT.match(title)
    return title if match is None else match["name"].strip()


@dataclass(frozen=True, eq=False)
class Table:
    """Numbers (row, column) of those columns that were asked for, the line in which each row stands, and which columns hold dates."""

    titles: Titles
    values: Floats
    lines: Any
    dated: frozenset[int] = frozenset()


def read_table_text(path: Path, wanted: Callable[[Titles], Sequence[int]]) -> Table:
    """Read the columns that ``wanted`` picks, by their places; dates and times of day become seconds.

    Separators are commas, semicolons, tabs or blanks; decimals have a point, or a comma where that does not separate. Lines that begin with # or %
    are comments; the last of them may hold the titles.

    Raises
    ------
    InvalidInput
        Not text, empty, lines of another length, cells that are no numbers, numbers that may be meant in two ways.
    """
    tail = _Tail()
    lines = _content(tail.watched(lines_of(path)))
    head: list[tuple[int, str]] = []
    comment = ""
    for count, line in lines:
        if line[0] in "#%":
            comment = line.lstrip("#% \t")
        else:
            head.append((count, line))
        if len(head) == 2:
            break
    if not head:
        raise InvalidInput(f"{path}: no lines of numbers; a table has a line of titles and one line per reading.")
    separator, titles, above = _layout(path, head, comment)
    body = chain(head[1:] if above else head, lines)
    places = list(wanted(titles))
    clocks = [TimeCells(str(path)) for _ in places]
    values, at = _numbers(path, body, separator, len(titles.names), places, clocks)
    if not at:
        raise InvalidInput(f"{path}: no lines of numbers follow the titles {titles.listed()}.")
    if not tail.ended:
        warn_of_a_cut(path, tail.last)
    for i, clock in enumerate(clocks):
        if clock.kind:
            values[:, i] = clock.settled(values[:, i])
    dated = frozenset(place for place, clock in zip(places, clocks) if clock.kind)
    return Table(titles, values, np.array(at), dated)


class _Tail:
    """The last line with something in it, and whether it is ended."""

    last = ""

    def watched(self, lines: Iterator[str]) -> Iterator[str]:
        for line in lines:
            if line.strip():
                self.last = line
            yield line

    @property
    def ended(self) -> bool:
        return self.last.endswith("\n")


def _content(lines: Iterator[str]) -> Iterator[tuple[int, str]]:
    for count, line in enumerate(lines, 1):
        text = line.strip("\r\n")
        # a first line "sep=;" is what a spreadsheet tells itself
        if text.strip() and not (count == 1 and re.fullmatch(r"sep=.", text.strip())):
            yield count, text


def _split(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    try:
        return [c.strip() for c in next(csv.reader([line], delimiter=separator, strict=True), [])]
    except csv.Error:  # a quote within a cell: said where the line is read
        return [c.strip() for c in line.split(separator)]


def _layout(path: Path, head: list[tuple[int, str]], comment: str) -> tuple[str | None, Titles, bool]:
    """Separator, titles, and whether these stand in the first line, from the first two lines and the comment above."""
    first, second = head[0][1], head[-1][1]
    separator: str | None
    for separator in SEPARATORS:
        columns, cells = len(_trimmed(_split(first, separator))), _split(second, separator)
        if columns > 1 and columns in (len(cells), len(_trimmed(cells))):
            break
    else:
        counts = {s: (len(_split(first, s)), len(_split(second, s))) for s in SEPARATORS}
        if counts[","][0] > 1 and counts[","][1] == 2 * counts[","][0]:
            raise InvalidInput(
                f"{path}, line {head[-1][0]}: {counts[','][1]} cells for {counts[','][0]} columns.{_BOTH}"
            )
        if any(c != (1, 1) for c in counts.values()):
            likely = max(counts, key=lambda s: min(counts[s]))
            raise InvalidInput(
                f"{path}, line {head[-1][0]}: {counts[likely][1]} values for {counts[likely][0]} columns, where {_NAMES[likely]} separate them; the file may be truncated. A table has a "
                "line of titles and lines of as many numbers, separated by commas, semicolons, tabs or blanks."
            )
        separator = ","
    names = _trimmed(_split(first, separator))
    if not all(_numeric(n, separator) for n in names):
        return separator, Titles(str(path), tuple(names), True), True
    said = _trimmed(_split(comment, separator))
    if len(said) == len(names) and not all(_numeric(n, separator) for n in said):
        return separator, Titles(str(path), tuple(said), True), False
    return separator, Titles(str(path), tuple(str(i) for i in range(1, len(names) + 1)), False), False


_BOTH = " If commas stand for the decimal point too, save the table with a decimal point, or with semicolons or tabs between cells."
_NAMES = {"\t": "tabs", ";": "semicolons", ",": "commas", None: "blanks"}


def _trimmed(row: list[str], count: int | None = None) -> list[str]:
    """Without an empty cell behind a separator at the end of the line; ``count``: only where that many are left."""
    if len(row) > 1 and not row[-1] and (count is None or len(row) - 1 == count):
        return row[:-1]
    return row


def _numeric(cell: str, separator: str | None) -> bool:
    text = cell.replace(",", ".") if separator != "," else cell
    if text.strip().lower() in _MISSING or is_date(cell):
        return True
    try:
        number(text, "")
    except InvalidInput:
        return False
    return True


def _numbers(
    path: Path, body: Any, separator: str | None, count: int, places: Sequence[int], clocks: Sequence[TimeCells]
) -> tuple[Floats, Sequence[int]]:
    """The cells at ``places`` of every line, and the numbers of the lines; ``clocks`` read the dates of each column."""
    values, at = array("d"), array("q")
    decimals = _Decimals(path, separator != ",")
    pick = operator.itemgetter(*places) if len(places) > 1 else lambda row: (row[places[0]],)
    for line_number, line in body:
        if line[0] in "#%":
            continue
        row = _split(line, separator) if '"' in line or separator is None else line.split(separator)
        if len(row) != count:
            row = _trimmed([c.strip() for c in row], count)
        if len(row) != count:
            raise InvalidInput(
                f"{path}, line {line_number}: {len(row)} values for {count} columns; the file may be truncated. Take the line out if it is no reading."
                + (_BOTH if separator == "," and len(row) > count else "")
            )
        at.append(line_number)
        cells = pick(row)
        values.extend(
            decimals.plain(cells, line_number)
            or [decimals.value(c, line_number, clocks[i]) for i, c in enumerate(cells)]
        )
    decimals.check()
    return np.frombuffer(values).reshape(-1, len(places)) if at else np.zeros((0, len(places))), at


class _Decimals:
    """Numbers with points or commas; what may be meant in two ways is refused."""

    def __init__(self, path: Path, commas: bool) -> None:
        self._path, self._commas = path, commas
        self._point: tuple[int, str] | None = None
        self._comma: tuple[int, str] | None = None
        self._sure = False

    def plain(self, cells: Sequence[str], line: int) -> list[float] | None:
        """The numbers of a line all at once, where nothing in it needs a second look: much the same as `value`, in a tenth of its time."""
        whole = " ".join(cells)
        if _PLAIN.fullmatch(whole) is None:
            return None
        try:
            found = [float(c) for c in cells]
        except ValueError:
            return None
        if self._commas and self._point is None and "." in whole:
            self._point = (line, next(c for c in cells if "." in c).strip())
        return found if math.isfinite(sum(found)) else None

    def value(self, cell: str, line: int, clock: TimeCells) -> float:
        seconds = clock.value(cell, f"{self._path}, line {line}")
        if seconds is not None:
            return seconds
        if self._commas and "," in cell:
            if self._comma is None:
                self._comma = (line, cell.strip())
            if "." in cell:
                raise InvalidInput(
                    f"{self._path}, line {line}: {cell.strip()!r} has a comma and a point. Save the table with decimal points and without separators of thousands."
                )
            # 1,234 may be a thousand and more; 0,234 and 1,23 may not
            self._sure = self._sure or _GROUPED.fullmatch(cell) is None
            text = cell.replace(",", ".")
        else:
            text = cell
            if self._commas and self._point is None and "." in cell:
                self._point = (line, cell.strip())
        if cell.strip().lower() in _MISSING:
            return float("nan")
        return number(text, f"{self._path}, line {line}")

    def check(self) -> None:
        if self._comma is None:
            return
        where = f"{self._path}, line {self._comma[0]}: {self._comma[1]!r}"
        if self._point is not None:
            raise InvalidInput(
                f"{where} has a comma and {self._point[1]!r} in line {self._point[0]} a point: which is the decimal one is not clear. Save the table with decimal points and "
                "without separators of thousands."
            )
        if not self._sure:
            raise InvalidInput(
                f"{where} may be a decimal or a thousand and more, as all numbers with commas in this table. Save it with decimal points."
            )


def first_titles(path: Path) -> Titles:
    """The titles alone; `InvalidInput` as for `read_table_text`."""
    lines = [(n, t) for n, t in islice(_content(lines_of(path)), 200)]
    head = [(n, t) for n, t in lines if t[0] not in "#%"][:2]
    comments = [t.lstrip("#% \t") for n, t in lines if t[0] in "#%" and (not head or n < head[-1][0])]
    if not head:
        raise InvalidInput(f"{path}: no lines of numbers; a table has a line of titles and one line per reading.")
    return _layout(path, head, comments[-1] if comments else "")[1]
