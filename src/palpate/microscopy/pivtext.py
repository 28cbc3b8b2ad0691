"""Read PIV results as text: tables with columns x y u v and more, as OpenPIV, JPIV, PIVlab, Tecplot and ImageJ's PIV
write them; and plain matrices.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.microscopy.found import Found, beside, check_unnamed, chosen, normal_beside
from palpate.microscopy.names import (
    BOTH_STDS,
    FLAGS,
    FRAMES,
    OUT_OF_PLANE,
    POSITIONS,
    STDS,
    VECTORS,
    plain,
    unit_in,
    which,
)
from palpate.recordings.textlines import text_of, warn_of_a_cut

__all__ = ["frames_of_text", "is_number", "read_matrix", "read_piv_text", "split"]

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?|nan|NaN|NAN", re.ASCII)
_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d{1,4})?", re.ASCII)


def split(line: str) -> list[str]:
    """Split a line into cells: at semicolons, tabs or commas if it has any, otherwise at spaces.

    A comma is a decimal comma if semicolons or tabs separate cells, or if spaces do and each number has one.
    """
    for mark in (";", "\t", ","):
        if mark in line:
            parts = [p.strip() for p in line.split(mark)]
            if mark != ",":
                parts = [p.replace(",", ".") if _COMMA.fullmatch(p) else p for p in parts]
            if mark == "," and len(spaced := line.split()) > 1 and all(_COMMA.fullmatch(p) for p in spaced):
                return [p.replace(",", ".") for p in spaced]  # spaces separate numbers that have decimal commas
            return parts[:-1] if parts and not parts[-1] else parts
    return line.split()


def is_number(cell: str) -> bool:
    return not cell or _NUMBER.fullmatch(cell) is not None


def _rows(path: Path) -> tuple[list[str], Floats]:
    """Return the lines before the numbers, and the numbers."""
    lines, ended = text_of(path)
    head: list[str] = []
    rows: list[list[float]] = []
    for count, line in enumerate(lines, 1):
        text = line.strip()
        if not text:
            continue
        parts = split(text)
        if not all(map(is_number, parts)) or text.startswith(("#", "%")):
            if rows and not text.startswith(("#", "%")):
                raise InvalidInput(
                    f"{path}, line {count}: {text[:60]!r} among the numbers; the file may hold several fields or be damaged: give one."
                )
            head.append(text)
            continue
        if rows and len(parts) != len(rows[0]):
            raise InvalidInput(
                f"{path}, line {count}: {len(parts)} numbers, the lines before have {len(rows[0])}; the file may be truncated."
            )
        rows.append([float(p) if p else np.nan for p in parts])
    if not rows:
        raise InvalidInput(f"{path}: holds no numbers, as a table of vectors or a matrix does.")
    if not ended:
        warn_of_a_cut(path, lines[-1])
    return head, np.array(rows, dtype=np.float64)


def _names(head: list[str], count: int) -> list[str] | None:
    """Return the names of ``count`` columns from the lines before the numbers; None if no line has as many."""
    for line in reversed(head):
        text = re.sub(r"^\s*[#%]+\s*", "", line)
        text = re.sub(r"^VARIABLES\s*=\s*", "", text, flags=re.IGNORECASE)
        quoted = re.findall(r'"([^"]*)"', text)
        names = quoted if len(quoted) == count else split(text)
        if len(names) != count and re.search(r"\s[\[(]", text):
            names = re.findall(r"[^\s\[\](),;]+(?:\s*[\[(][^\])]*[\])])?", text)
        if len(names) == count and any(re.search("[a-zA-Z]", n) for n in names):
            return names
    return None


def read_matrix(path: Path) -> Floats:
    """Read one component as a matrix of text."""
    head, values = _rows(path)
    names = _names(head, values.shape[1])
    if names is not None and which([plain(n) for n in names], VECTORS):
        raise InvalidInput(
            f"{path}: is a table with the columns {', '.join(names)}, not a matrix of one component: give this file alone."
        )
    return values


def _frame(path: Path, names: list[str], values: Floats, name: str | None) -> Floats:
    """Return the rows of one frame, if a column states the frame."""
    column = next((k for k, n in enumerate(names) if plain(n) in FRAMES), None)
    if column is None:
        check_unnamed(path, name)
        return values
    each = {f"{number:g}": values[values[:, column] == number] for number in np.unique(values[:, column])}
    return np.asarray(chosen(path, each, name, "frames"))


def frames_of_text(path: Path) -> list[str]:
    """Return the numbers of the frames of a table that has a column of them; an empty list for a table of one field."""
    head, values = _rows(path)
    column = next((k for k, n in enumerate(_names(head, values.shape[1]) or []) if plain(n) in FRAMES), None)
    return [] if column is None else [f"{number:g}" for number in np.unique(values[:, column])]


def read_piv_text(path: Path, name: str | None = None) -> Found:
    """Read a table of vectors: x, y, u, v by name, or the first four columns; ``name``: number of the frame."""
    head, values = _rows(path)
    columns = values.shape[1]
    names = _names(head, columns)
    values = _frame(path, names or [], values, name)
    if names is None:
        if columns < 4:
            raise InvalidInput(f"{path}: {columns} columns; a table of vectors has x, y, u, v.")
        if columns > 16:
            raise InvalidInput(
                f"{path}: looks like one component as a matrix of {values.shape[0]} x {columns}. Give both files, that along x first."
            )
        found = Found(x=values[:, 0], y=values[:, 1], u=values[:, 2], v=values[:, 3], pixels=True)
        found.notes.append(
            "a table without names: the columns are taken as x, y, u, v"
            + (f", the other {columns - 4} left out" if columns > 4 else "")
        )
        return found
    short = [plain(n) for n in names]
    vectors, places = which(short, VECTORS), which(short, POSITIONS)
    if len(vectors) != 1 or not places:
        raise InvalidInput(
            f"{path}: the columns {', '.join(names)[:160]} do not say which are x, y and the displacements u, v; name them so in the header."
        )
    at = {n: short.index(n) for n in short}
    (u, v), (x, y) = vectors[0], places[0]
    found = Found(u=values[:, at[u]], v=values[:, at[v]], x=values[:, at[x]], y=values[:, at[y]])
    pairs = [(x, y), (u, v), *which(short, STDS)[:1]]
    said = [(unit_in(names[at[a]]), unit_in(names[at[b]])) for a, b in pairs]
    for (first, second), both in zip(said, pairs):
        if first != second:
            raise InvalidInput(
                f"{path}: {both[0]} in {first or 'no unit'} and {both[1]} in {second or 'no unit'}: export both in one unit."
            )
    found.place, found.unit = said[0][0], said[1][0]
    found.pixels = found.unit in (None, "px")
    _, found.std, said_of = beside({n: values[:, k] for n, k in at.items()}, (len(values),))
    found.notes += said_of
    found.w = normal_beside({n: values[:, k] for n, k in at.items()}, (len(values),))
    alone = [unit_in(names[at[n]]) for n in BOTH_STDS if n in at]
    found.std_unit = said[2][0] if len(said) > 2 else next(iter(alone), None)
    found.w_unit = next((unit_in(names[at[n]]) for n in OUT_OF_PLANE if n in at), None)
    bad = np.zeros(len(values), dtype=bool)
    for flag in FLAGS:
        if flag not in at:
            continue
        # PIVlab: 1 is a vector, 0 masked, 2 interpolated; ImageJ and OpenPIV: 0 is a vector
        regular = 1.0 if flag in ("vector type", "typevector", "chc") else 0.0
        marked = values[:, at[flag]] != regular
        bad |= marked
        if marked.any():
            found.notes.append(
                f"{int(marked.sum())} of {len(marked)} vectors are left out: {names[at[flag]]} marks them"
            )
    if (
        "n" in at and found.std is not None
    ):  # a count of particles: without any there is no error bar, and where all is zero no vector
        unknown = (values[:, at["n"]] == 0) & (found.std[0] == 0)
        along_x, along_y = (np.where(unknown, np.nan, one) for one in found.std)
        found.std = (along_x, along_y)
        empty = unknown & (found.u == 0) & (found.v == 0)
        bad |= empty
        if empty.any():
            found.notes.append(
                f"{int(empty.sum())} of {len(empty)} vectors are left out: they are zero, with no particle to measure"
            )
    found.bad = bad
    return found
