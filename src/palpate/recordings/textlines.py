"""Lines of text and the numbers in them."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from palpate._files import ordinary
from palpate._memory import require
from palpate.errors import InvalidInput, UncheckedInput

__all__ = ["cells", "is_text", "lines_of", "number", "text_of", "warn_of_a_cut"]

#: Largest number of characters in a line (ten million numbers).
LONGEST = 1 << 28
_NUMBER = re.compile(r"\s*[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?\s*", re.ASCII)


def is_text(path: Path) -> bool:
    """Whether the first bytes of a file are text. UTF-16 passes: the reader refuses it with a remedy."""
    with path.open("rb") as file:
        begin = file.read(4096)
    return b"\0" not in begin or begin[:2] in (b"\xff\xfe", b"\xfe\xff")


def text_of(path: Path) -> tuple[list[str], bool]:
    """Lines of a text file, and whether the last one has a line break; raises an error for a file that is not text."""
    next(lines_of(path), "")  # a binary file is refused at its first line
    # the bytes, the text, and its lines
    require(
        6.0 * ordinary(path).stat().st_size,
        f"{path}: lines of text of this size",
        "Write it as .nc or .h5, which are read piece by piece.",
    )
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path}: cannot be read as text in UTF-8; save it as CSV in UTF-8.") from error
    if "\0" in text:
        raise InvalidInput(f"{path}: holds NUL characters; it is damaged or not text.")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text.rstrip("\n").split("\n"), text.endswith("\n")


def warn_of_a_cut(path: Path, last: str) -> None:
    """Warn that the last number of a file may be cut."""
    warnings.warn(
        f"{path}: the last line has no line break; if the file was cut, its last number {last.split(',')[-1][:40]!r} is wrong. "
        "Compare it with the source, then end the line with a line break.",
        UncheckedInput,
        stacklevel=5,
    )


def cells(line: str, where: str) -> list[str]:
    """The cells of one line."""
    try:
        return next(csv.reader(io.StringIO(line), strict=True), [])
    except csv.Error as error:
        # without quotes a line needs no parser, and may be as long as it is
        if '"' not in line:
            return line.split(",")
        raise InvalidInput(f"{where}: cannot be read as CSV ({error}).") from error


def number(text: str, where: str) -> float:
    """Parse a number in a file, or raise `InvalidInput`; empty text (or "nan") is missing."""
    if not text.strip() or text.strip().lower() == "nan":
        return float("nan")
    if _NUMBER.fullmatch(text) is None:
        raise InvalidInput(f"{where}: {text[:40]!r} is not a number.")
    value = float(text)
    if not np.isfinite(value):
        raise InvalidInput(f"{where}: {text[:40]!r} is larger than numbers can be.")
    return value


def lines_of(path: Path) -> Iterator[str]:
    """Iterate over the lines of a text file, with their line breaks; raises an error for a file that is not text."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            while line := file.readline(LONGEST):
                if len(line) == LONGEST:
                    raise InvalidInput(f"{path}: a line of more than {LONGEST} characters; it is damaged or no table.")
                if "\0" in line:
                    raise InvalidInput(f"{path}: holds NUL characters; it is damaged or not text.")
                yield line
    except (OSError, UnicodeDecodeError) as error:
        raise InvalidInput(f"{path}: cannot be read as text in UTF-8; save it as CSV in UTF-8.") from error
