"""Parse the text of a table of another program: separator, decimals, titles and numbers."""

from __future__ import annotations

import csv
import math
import operator
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.dates import TimeCells, is_date
from palpate.recordings.textlines import lines_of, number, warn_of_a_cut
from palpate.units import UNITS, plain_unit

__all__ = ["SLICE", "Table", "Titles", "first_titles", "read_table_text"]

#: Separators in the order in which they are tried; None: blanks.
SEPARATORS = ("\t", ";", ",", None)
#: A slice of consecutive columns, in Python's notation.
SLICE = re.compile(r"(?P<name>.*)\[(?P<slice>\d*:\d*(?::\d+)?)\]")
#: The title of one number of a list in a cell.
_ENTRY = re.compile(r"(.+)\[(\d+)\]")
#: Number of lines to search for titles.
HEAD = 32
_UNIT = re.compile(r"^(?P<name>.*?)\s*[(\[](?P<unit>[^()\[\]]*)[)\]]$")
_MISSING = ("", "nan", "na", "n/a", "null")
_NUMERIC = re.compile(r"[-+0-9.eE ]*")
_GROUPED = re.compile(r"\s*[+-]?[1-9]\d{0,2},\d{3}\s*")


@dataclass(frozen=True)
class Titles:
    """The titles of the columns of a table; without titles they are "1", "2", ...

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
        """The index of a column, by its title with or without its unit."""
        places = [i for i, n in enumerate(self.names) if n == name]
        places = places or [i for i, n in enumerate(self.names) if _bare(n) == name]
        if not places:
            raise InvalidInput(f"{self.source}: no column {name}; it has {self.listed()}.")
        if len(places) > 1 and all(_ENTRY.fullmatch(self.names[i]) for i in places):
            raise InvalidInput(
                f"{self.source}: {name} holds {len(places)} numbers a line: name all of them as {name}[:], or some of them as in {name}[0::3]."
            )
        if len(places) > 1:
            raise InvalidInput(
                f"{self.source}: the column {name} is there {len(places)} times; name each column once in its first line."
            )
        return places[0]

    def matching(self, pattern: str) -> dict[str, int]:
        """The number in place of ``{}`` -> the index of the column, in numerical order."""
        before, _, after = pattern.partition("{}")
        expression = re.compile(f"{re.escape(before)}(.+?){re.escape(after)}")
        columns: dict[str, int] = {}
        for i, title in enumerate(self.names):
            match = expression.fullmatch(title) or expression.fullmatch(_bare(title))
            if match is not None:
                if match[1] in columns:
                    raise InvalidInput(
                        f"{self.source}: the column {title} is there twice; name each column once in its first line."
                    )
                columns[match[1]] = i
        numbered = {k: v for k, v in columns.items() if re.fullmatch(r"\d{1,9}", k)}
        if numbered:
            columns = dict(sorted(numbered.items(), key=lambda item: int(item[0])))
        if not columns:
            raise InvalidInput(f"{self.source}: no column is like {pattern}; it has {self.listed()}.")
        return columns

    def sliced(self, pattern: str) -> list[int] | None:
        """Indices of "name[first:after:step]" among name[0], name[1] ..., as in Python; "[::3]" of all columns."""
        match = SLICE.fullmatch(pattern)
        if match is None:
            return None
        steps = [int(v) if v else None for v in match["slice"].split(":")]
        if 0 in steps[2:]:
            raise InvalidInput(f"{pattern}: the step of a slice must be 1 or more.")
        numbered = re.compile(rf"{re.escape(match['name'])}\[?(\d{{1,9}})\]?")
        matches = [numbered.fullmatch(_bare(n)) or numbered.fullmatch(n) for n in self.names]
        order = {int(m[1]): i for i, m in enumerate(matches) if m is not None}
        places = [order[n] for n in sorted(order)] if match["name"] else list(range(len(self.names)))
        if not places[slice(*steps)]:
            raise InvalidInput(f"{self.source}: no column is among {pattern}; it has {self.listed()}.")
        return places[slice(*steps)]

    def unit(self, place: int) -> str | None:
        """The unit in the title of a column."""
        match = _UNIT.match(self.names[place])
        return (
            plain_unit(match["unit"])
            if match is not None and self.titled and not _ENTRY.fullmatch(self.names[place])
            else None
        )

    def listed(self) -> str:
        """The titles in words."""
        names: list[str] = []
        for name in self.names:  # a list of numbers is one name
            entry = _ENTRY.fullmatch(name)
            if entry is not None and names and names[-1].startswith(f"{entry[1]}[0"):
                names[-1] = f"{entry[1]}[0] to [{entry[2]}]"
            else:
                names.append(name)
        some = ", ".join(names[:12])[:300] + (f" and {len(names) - 12} more" if len(names) > 12 else "")
        return some if self.titled else f"{len(self.names)} columns without titles: name them by their numbers {some}"


def _bare(title: str) -> str:
    """A title without its unit."""
    match = _UNIT.match(title)
    return title if match is None else match["name"].strip()


@dataclass(frozen=True, eq=False)
class Table:
    """Numbers (row, column) of the requested columns, the line of each row, and which columns contain dates."""

    titles: Titles
    values: Floats
    lines: Any
    dated: frozenset[int] = frozenset()


def read_table_text(path: Path, wanted: Callable[[Titles], Sequence[int]]) -> Table:
    """Read the columns that ``wanted`` picks, by their indices; dates and times of day become seconds.

    Separators are commas, semicolons, tabs or blanks; decimals have a point, or a comma if it is not the separator.
    Lines that begin with # or % are comments; the last of them may contain the titles. Titles may take several lines
    (names, then units), below lines of text with other numbers of cells. The first column without a title is named
    index, as in pandas, and others column 2, column 3, ...

    Raises
    ------
    InvalidInput
        Not text, empty, lines of another length, cells that are no numbers, numbers that may be meant in two ways.
    """
    tail = _Tail()
    lines = _content(tail.watched(lines_of(path)))
    head, comment = _head(lines)
    if not head:
        raise InvalidInput(f"{path}: no lines of numbers; a table has a line of titles and one line per reading.")
    separator, titles, above = _layout(path, head, comment)
    body = chain(head[above:], lines)
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


def _head(lines: Iterator[tuple[int, str]]) -> tuple[list[tuple[int, str]], str]:
    """The first lines that are not comments, and the last comment above the second of them."""
    head: list[tuple[int, str]] = []
    comment = ""
    for count, line in lines:
        if line[0] not in "#%":
            head.append((count, line))
        elif len(head) < 2:
            comment = line.lstrip("#% \t")
        if len(head) == HEAD:
            break
    return head, comment


class _Tail:
    """The last non-empty line, and whether it ends with a line break."""

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
        # A first line "sep=;" is a hint for spreadsheets.
        if text.strip() and not (count == 1 and re.fullmatch(r"sep=.", text.strip())):
            yield count, text


def _split(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    try:
        return [c.strip() for c in next(csv.reader([line], delimiter=separator, strict=True), [])]
    except csv.Error:  # a quote within a cell: the reader of the line reports it
        return [c.strip() for c in line.split(separator)]


def _layout(path: Path, head: list[tuple[int, str]], comment: str) -> tuple[str | None, Titles, int]:
    """Separator, titles, and number of title lines, from the first lines and the comment above them."""
    lines = [line for _, line in head]
    separator = _separator(lines[0], lines[min(1, len(lines) - 1)])
    start, index = 0, False
    if separator == _NONE:
        separator, index = _with_index(lines), True
    if separator == _NONE:
        (separator, start), index = _after_preamble(lines), False
    if separator == _NONE:
        separator = _refused(path, head)
    rows = [_split(line, separator) for line in lines[start:]]
    if index:
        return separator, Titles(str(path), (_INDEX, *rows[0]), True), 1
    counts = _counts(rows[0]) & _counts(rows[min(1, len(rows) - 1)])
    count = min(counts, default=1)
    rows = [(row + [""] * count)[:count] for row in rows]
    unnamed = rows[0] == ["", *map(str, range(count - 1))]  # of a data frame whose columns have no names
    if unnamed or not all(_numeric(cell, separator) for cell in rows[0]):
        names, count = _names(rows)
        return separator, Titles(str(path), names, True), start + count
    commented = _trimmed(_split(comment, separator))
    if len(commented) == len(rows[0]) and not all(_numeric(n, separator) for n in commented):
        return separator, Titles(str(path), tuple(commented), True), start
    return separator, Titles(str(path), tuple(str(i) for i in range(1, len(rows[0]) + 1)), False), start


def _separator(first: str, second: str) -> str | None:
    """The first separator that splits both lines into the same number of cells, more than one; or ``_NONE``."""
    for separator in SEPARATORS:
        if max(_counts(_split(first, separator)) & _counts(_split(second, separator)), default=0) > 1:
            return separator
    return _NONE


def _counts(row: Sequence[str]) -> set[int]:
    """Number of cells of a line, with and without an empty one at its end."""
    return {len(row), len(_trimmed(list(row)))} - {1}


def _with_index(lines: Sequence[str]) -> str | None:
    """The separator of a printed data frame: it has one title less than columns, and the first column counts the rows."""
    for separator in ("\t", None):
        titles, *rows = (_split(line, separator) for line in lines)
        if not rows or any(len(row) != len(titles) + 1 for row in rows) or any(_number(t) for t in titles):
            continue
        counts = [row[0].strip('"') for row in rows]
        if counts[0] in ("0", "1") and counts == [str(i + int(counts[0])) for i in range(len(counts))]:
            return separator
    return _NONE


def _after_preamble(lines: Sequence[str]) -> tuple[str | None, int]:
    """The separator of a table below some lines of text, and the number of these lines."""
    for separator in SEPARATORS:
        rows = [_trimmed(_split(line, separator)) for line in lines]
        count = len(rows[-1])
        start = next((i + 1 for i in range(len(rows) - 1, -1, -1) if len(rows[i]) != count), 0)
        above = rows[:start]
        if (
            count > 1
            and 0 < start < len(rows) - 1
            # A line with too few titles is not text.
            and (not all(_numeric(c, separator) for c in rows[start]) or all(len(row) == 1 for row in above))
            and all(len(row) != count and not all(_numeric(c, separator) for c in row) for row in above)
        ):
            return separator, start
    return _NONE, 0


def _names(rows: Sequence[Sequence[str]]) -> tuple[tuple[str, ...], int]:
    """The titles of the columns, and the lines that they take: names, more names, units in a line of their own."""
    count = 1
    while count < len(rows) - 1 and _only_words(rows[count]):
        count += 1
    titles = [list(row) for row in rows[:count]]
    units = [""] * len(titles[0])
    if len(titles) > 1 and all(_is_unit(cell) for cell in titles[-1] if cell):
        units = [cell.strip("()[] ") for cell in titles.pop()]
    if len(titles) > 1 and len(set(titles[0])) < len(titles[0]):  # a name above several columns goes on to the right
        for row in titles[:-1]:
            for i in range(1, len(row)):
                row[i] = row[i] or row[i - 1]
        names = ["_".join(dict.fromkeys(c for c in column if c)) for column in zip(*titles)]
    else:
        names = titles[0]
    names = [name or (f"column {i}" if i > 1 else _INDEX) for i, name in enumerate(names, 1)]
    return tuple(f"{n} ({u})" if u and _UNIT.match(n) is None else n for n, u in zip(names, units)), count


def _only_words(row: Sequence[str]) -> bool:
    return any(cell.lower() not in _MISSING for cell in row) and not any(_number(cell) for cell in row)


def _is_unit(cell: str) -> bool:
    return (cell[0] + cell[-1]) in ("()", "[]") or any(cell in units for units in UNITS.values())


def _number(cell: str) -> bool:
    """Whether a cell is, or begins like, a number (or a date)."""
    return re.match(r"[\"']?[-+.]?\d", cell) is not None


def _refused(path: Path, head: list[tuple[int, str]]) -> str:
    """The separator of a table with one column; `InvalidInput` if lines have different numbers of cells."""
    first, second = head[0][1], head[min(1, len(head) - 1)][1]
    line = head[min(1, len(head) - 1)][0]
    counts = {s: (len(_split(first, s)), len(_split(second, s))) for s in SEPARATORS}
    if counts[","][0] > 1 and counts[","][1] == 2 * counts[","][0]:
        raise InvalidInput(f"{path}, line {line}: {counts[','][1]} cells for {counts[','][0]} columns.{_BOTH}")
    if counts[None][1] > 1 or any(c != (1, 1) for s, c in counts.items() if s is not None):
        likely = max(counts, key=lambda s: min(counts[s]))
        raise InvalidInput(
            f"{path}, line {line}: {counts[likely][1]} values for {counts[likely][0]} columns, where {_NAMES[likely]} separate them; the file may be truncated. A table has a "
            "line of titles and lines of as many numbers, separated by commas, semicolons, tabs or blanks."
        )
    return ","


#: Placeholder for "no separator".
_NONE = ""
#: Title of the first column without one: the index of a data frame.
_INDEX = "index"
_BOTH = " If commas stand for the decimal point too, save the table with a decimal point, or with semicolons or tabs between cells."
_NAMES = {"\t": "tabs", ";": "semicolons", ",": "commas", None: "blanks"}


def _trimmed(row: list[str], count: int | None = None) -> list[str]:
    """Drop an empty cell behind a separator at the end of the line, if ``count`` cells remain."""
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
    """The cells at ``places`` of every line, and the line numbers; ``clocks`` parse the dates of each column."""
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
    """Parses numbers with decimal points or commas; raises an error for ambiguous ones."""

    def __init__(self, path: Path, commas: bool) -> None:
        self._path, self._commas = path, commas
        self._point: tuple[int, str] | None = None
        self._comma: tuple[int, str] | None = None
        self._sure = False

    def plain(self, cells: Sequence[str], line: int) -> list[float] | None:
        """All numbers of a line at once, if it has no special cells: same result as `value`, in a tenth of the time."""
        line_text = " ".join(cells)
        if _NUMERIC.fullmatch(line_text) is None:
            return None
        try:
            numbers = [float(c) for c in cells]
        except ValueError:
            return None
        if self._commas and self._point is None and "." in line_text:
            self._point = (line, next(c for c in cells if "." in c).strip())
        return numbers if math.isfinite(sum(numbers)) else None

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
            # 1,234 may be more than a thousand; 0,234 and 1,23 may not
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
        cell = f"{self._path}, line {self._comma[0]}: {self._comma[1]!r}"
        if self._point is not None:
            raise InvalidInput(
                f"{cell} has a comma and {self._point[1]!r} in line {self._point[0]} a point: the decimal separator is not clear. Save the table with decimal points and "
                "without separators of thousands."
            )
        if not self._sure:
            raise InvalidInput(
                f"{cell} may be a decimal or a thousand and more, as all numbers with commas in this table. Save it with decimal points."
            )


def first_titles(path: Path) -> Titles:
    """The titles alone; `InvalidInput` as for `read_table_text`."""
    head, comment = _head(_content(lines_of(path)))
    if not head:
        raise InvalidInput(f"{path}: no lines of numbers; a table has a line of titles and one line per reading.")
    return _layout(path, head, comment)[1]
