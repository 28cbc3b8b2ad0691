"""Read where the cell is: a picture that is zero outside the cell, or an outline."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._files import ordinary, small_text
from palpate._numbers import plain_number
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.microscopy.fields import Field
from palpate.microscopy.names import plain, unit_in
from palpate.microscopy.pickled import read_objects
from palpate.microscopy.pivtext import is_number, split
from palpate.recordings.textlines import text_of
from palpate.units import UNITS

__all__ = ["inside_outline", "on_grid", "read_mask"]

Bools = npt.NDArray[np.bool_]

#: A picture with more grey levels than LEVELS is not a mask, unless at least EQUAL of the adjacent pixels have equal
#: values: then it holds labels.
LEVELS, EQUAL = 16, 0.9
#: Column names of the coordinates of an outline: x, and y below.
X_NAMES = ("x", "px", "pos_x", "xpos", "col", "column", "columns", "axis-1", "axis_1")
Y_NAMES = ("y", "py", "pos_y", "ypos", "row", "rows", "axis-0", "axis_0")
OUTLINES = (".csv", ".txt", ".json", ".geojson", ".roi")


def read_mask(
    source: str | Path | npt.ArrayLike, *, cell: int | None = None, pixel: float | None = None
) -> npt.NDArray[Any]:
    """A mask from a file: a picture as booleans (row, column), or an outline as corners (n, 2) of x, y [px].

    Parameters
    ----------
    source : path or array
        A picture (``.png``, ``.tif``, ``.npy`` and so on) that is zero outside the cell, or whose values are the numbers of several cells; a ``_seg.npy`` of
        Cellpose; or an outline: ``.csv`` or ``.txt`` with one corner in a line, x, y in pixels or columns that a header names (``row,col``, ``x (um)``), the
        outlines of Cellpose (one cell in a line), ``.json`` or ``.geojson`` (a list of [x, y], or a Polygon). ImageJ writes a selection so with
        File > Save As > XY Coordinates.
    cell : int, optional
        Which of several cells: its value in the picture, or its place in a file of outlines, from 1.
    pixel : float, optional
        Metres in a pixel, for outlines in units of length.

    Raises
    ------
    InvalidInput
        A file that is not there or damaged, a picture of many grey levels, an empty mask, several cells without ``cell``, an outline of fewer than three corners.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.microscopy import read_mask
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/cell.csv").write_text("row,col\\n10,10\\n12,60\\n50,40\\n")
    ...     read_mask(f"{folder}/cell.csv").tolist()
    [[10.0, 10.0], [60.0, 12.0], [40.0, 50.0]]
    """
    if not isinstance(source, str | Path):
        values = np.asarray(source)
        corners = values.ndim == 2 and values.shape[1] == 2 and values.dtype != np.bool_
        return (
            _outline(_select_outline([values], cell, "the outline"), "the outline")
            if corners
            else _picture(values, "the mask", cell)
        )
    path = ordinary(source)
    ending = path.suffix.lower()
    if ending in OUTLINES:
        return _outline(_select_outline(_corners(path, ending, pixel), cell, str(path)), str(path))
    if ending == ".npy":
        return read_mask_array(path, cell)
    from palpate.microscopy.pictures import read_picture

    return _picture(read_picture(path), str(path), cell)


def read_outlines(path: Path, *, pixel: float | None) -> list[Floats]:
    """Corners (n, 2) [px] of each outline of a file."""
    return [_outline(one, str(path)) for one in _corners(path, path.suffix.lower(), pixel)]


def array_or_masks(path: Path) -> tuple[npt.NDArray[Any], bool]:
    """Return the array in a .npy file, or the ``masks`` of a Cellpose file, and whether it was a Cellpose file."""
    try:
        return np.load(path, allow_pickle=False), False
    except (ValueError, OSError, EOFError):
        held = read_objects(path)
        values = held.get("masks") if isinstance(held, dict) else None
        if not isinstance(values, np.ndarray):
            keys = ", ".join(map(str, list(held)[:8])) if isinstance(held, dict) else type(held).__name__
            raise InvalidInput(
                f'{path}: holds no "masks", as a _seg.npy of Cellpose does; it holds {keys}. Save the masks alone with np.save.'
            ) from None
        return values, True


def read_mask_array(path: Path, cell: int | None) -> npt.NDArray[Any]:
    """The mask in a .npy file: an array, or the ``masks`` of Cellpose."""
    values, cellpose = array_or_masks(path)
    if cellpose and values.ndim != 2:
        raise InvalidInput(f"{path}: its masks have the shape {values.shape}, a stack: save one plane with np.save.")
    if values.ndim == 2 and values.shape[1] == 2 and values.dtype != np.bool_:
        return _outline(_select_outline([values], cell, str(path)), str(path))
    return _picture(values, str(path), cell)


def _select_outline(outlines: Sequence[Any], cell: int | None, name: str) -> Any:
    """Return the outline of one cell, by its number from 1."""
    if cell is None and len(outlines) > 1:
        raise InvalidInput(
            f"{name}: holds the outlines of {len(outlines)} cells: say which with cell=1 to cell={len(outlines)} (--cell 1)."
        )
    if cell is not None and not 1 <= cell <= len(outlines):
        raise InvalidInput(
            f"{name}: holds {len(outlines)} outline{'s' if len(outlines) > 1 else ''}: cell (--cell) is from 1 to {len(outlines)}; got {cell}."
        )
    return outlines[(cell or 1) - 1]


def _picture(values: npt.NDArray[Any], name: str, cell: int | None = None) -> Bools:
    if values.ndim == 3 and values.shape[-1] in (3, 4) and values.dtype == np.uint8:
        values = values[..., :3].max(axis=-1)
    if values.ndim != 2 or values.dtype.kind not in "biuf":
        raise InvalidInput(
            f"{name}: a mask is a picture of one channel, or corners (n, 2); got {values.dtype} of shape {values.shape}."
        )
    if values.dtype == np.bool_:
        values = values.astype(np.uint8)
    elif (values == values.flat[0]).all() and values.flat[0] != 0:
        raise InvalidInput(f"{name}: every pixel is {values.flat[0]:g}. Outside the cell it must be zero.")
    levels = np.unique(values)
    levels = levels[levels != 0]
    if not len(levels):
        raise InvalidInput(f"{name}: the mask is empty: every pixel is zero. Inside the cell it must be another value.")
    if cell is not None:
        if cell not in levels:
            raise InvalidInput(
                f"{name}: no pixel has the value {cell} of cell (--cell); there are {_list_levels(levels)}."
            )
        return np.asarray(values == cell)
    if len(levels) > LEVELS and (np.diff(values, axis=1) == 0).mean() < EQUAL:
        raise InvalidInput(
            f"{name}: holds {len(levels)} grey levels: it looks like a photograph. A mask is zero outside the cell and one other value inside."
        )
    if len(levels) > 1:
        raise InvalidInput(
            f"{name}: holds {len(levels)} values beside zero ({_list_levels(levels)}), several cells perhaps: say which with cell={levels[0]:g} (--cell {levels[0]:g})."
        )
    return np.asarray(values != 0)


def _list_levels(levels: Any) -> str:
    return ", ".join(f"{v:g}" for v in levels[:6]) + (f" and {len(levels) - 6} more" if len(levels) > 6 else "")


def _outline(values: Any, name: str) -> Floats:
    try:
        corners = np.asarray(values, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise InvalidInput(f"{name}: an outline is a list of corners x, y in pixels.") from error
    if corners.ndim == 2 and len(corners) > 1 and np.array_equal(corners[0], corners[-1]):
        corners = corners[:-1]
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise InvalidInput(f"{name}: an outline has at least three corners x, y in pixels; got shape {corners.shape}.")
    if not abs(_area(corners)) > 0:
        raise InvalidInput(f"{name}: the outline has no area: its corners lie in a line.")
    return corners


def _area(corners: Floats) -> float:
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _corners(path: Path, ending: str, pixel: float | None) -> list[Any]:
    """Return the outlines in a file, each a list of corners."""
    if ending == ".roi":
        raise InvalidInput(
            f"{path}: .roi files are not read: in ImageJ, File > Save As > XY Coordinates writes the outline as text."
        )
    if ending in (".csv", ".txt"):
        return _text_corners(path, pixel)
    try:
        held = json.loads(small_text(path, "an outline"))
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{path}: cannot be read as JSON ({str(error)[:80]}).") from error
    features = held.get("features") if isinstance(held, dict) else None
    return [_ring(path, each) for each in (features if isinstance(features, list) and features else [held])]


def _ring(path: Path, held: Any) -> Any:
    """Return the corners of a GeoJSON feature or geometry, or of a list."""
    for _ in range(4):
        if not isinstance(held, dict):
            break
        held = held.get("geometry", held.get("coordinates"))
    while isinstance(held, list) and len(held) == 1:
        held = held[0]
    if isinstance(held, list) and held and isinstance(held[0], list) and held[0] and isinstance(held[0][0], list):
        raise InvalidInput(f"{path}: holds {len(held)} rings: give one outline without holes.")
    return held


def _text_corners(path: Path, pixel: float | None) -> list[Any]:
    """Return the outlines in a text file that has either one corner or one cell (Cellpose) to a line."""
    rows = [split(line.strip()) for line in text_of(path)[0] if line.strip()]
    at = next((k for k, row in enumerate(rows) if all(map(is_number, row))), None)
    named = next((row for row in rows[:at] if any(_side(cell) for cell in row)), None)
    if named is not None:
        return _named_corners(path, named, rows[rows.index(named) + 1 :], pixel)
    if at is None:
        raise InvalidInput(f"{path}: holds no numbers: an outline has one corner x,y in a line.")
    if at > 0 and not all(row[0].startswith(("#", "%")) for row in rows[:at]):
        raise InvalidInput(
            f"{path}: the header {', '.join(rows[at - 1])[:80]} does not say which column is x and which y: name them x,y or row,col."
        )
    rows = rows[at:]
    for row in rows:
        if not all(map(is_number, row)) or "" in row:
            raise InvalidInput(
                f"{path}: {', '.join(row)[:60]!r} among the corners; an outline has one corner x,y in a line."
            )
    values = [[float(cell) for cell in row] for row in rows]
    if all(len(row) == 2 for row in values):
        return [np.array(values)]
    if all(len(row) >= 6 and len(row) % 2 == 0 and all(v == int(v) for v in row) for row in values):
        return [np.reshape(row, (-1, 2)) for row in values]
    raise InvalidInput(
        f"{path}: lines of {min(map(len, values))} to {max(map(len, values))} numbers; an outline has one corner x,y in a line, or names its columns in a header."
    )


def _side(name: str) -> str:
    """Return "x" or "y" if a column of this name holds that coordinate of an outline, else ""."""
    short = re.sub(r"[_ ](px|pixels?|[uµμnm]?m)$", "", plain(name.lstrip("#% ")))
    return "x" if short in X_NAMES else "y" if short in Y_NAMES else ""


def _named_corners(path: Path, names: list[str], rows: list[list[str]], pixel: float | None) -> list[Any]:
    """Return the corners in columns that a header names, using the order and unit that it states."""
    sides = [_side(name) for name in names]
    if sides.count("x") != 1 or sides.count("y") != 1:
        raise InvalidInput(
            f"{path}: the columns {', '.join(names)[:120]} do not say which is x and which y: name them x,y or row,col."
        )
    columns, factors = [sides.index("x"), sides.index("y")], []
    for name in (names[k] for k in columns):
        tail = re.search(r"[_ ](px|pixels?|[uµμnm]?m)\s*$", name)
        unit = (unit_in(name) or (tail[1] if tail else "px")).replace("μ", "µ").lower()
        if unit in ("px", "pixel", "pixels", "pix"):
            factors.append(1.0)
            continue
        size = {"micron": 1e-6, "microns": 1e-6, **UNITS["length"]}.get(unit)
        if size is None:
            raise InvalidInput(f"{path}: {name}: accepted units are px, {', '.join(UNITS['length'])}.")
        if pixel is None:
            raise InvalidInput(f"{path}: the outline is in {unit}: give pixel=, the metres in a pixel.")
        factors.append(size / pixel)
    corners: dict[str, list[list[float]]] = {}
    index = next((k for k, name in enumerate(names) if plain(name) == "index" and "vertex-index" in names), None)
    for row in rows:
        if len(row) != len(names) or not all(row[k] and is_number(row[k]) for k in columns):
            raise InvalidInput(
                f"{path}: {', '.join(row)[:60]!r} is no corner with the columns {', '.join(names)[:60]}."
            )
        which = "" if index is None else row[index]
        corners.setdefault(which, []).append([float(row[k]) * factor for k, factor in zip(columns, factors)])
    if not corners:
        raise InvalidInput(f"{path}: holds no corners.")
    return [np.array(each) for each in corners.values()]


def on_grid(
    mask: npt.NDArray[Any], field: Field, *, size: tuple[int, int] | None = None, name: str = "the mask"
) -> Bools:
    """Return which vectors of a field lie in a mask (row, column); ``size``: columns and rows of the picture.

    A mask that is a picture must have the size of the microscope's picture or, without ``size``, that of the grid of
    vectors. A vector is inside if at least half of its square (side: one step) is in the picture's mask, or if its
    place lies in the outline.

    Raises
    ------
    InvalidInput
        A mask of another size, or one that holds no vector.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.microscopy import Field, on_grid
    >>> field = Field(displacement=np.zeros((2, 30, 40)), start=(3.5, 3.5), step=8.0, pixel=0.1e-6)
    >>> mask = np.zeros((240, 320), dtype=bool)
    >>> mask[80:160, 80:240] = True
    >>> int(on_grid(mask, field).sum())
    200
    """
    rows, columns = field.shape
    x = field.start[0] + field.step * np.arange(columns)
    y = field.start[1] + field.step * np.arange(rows)
    if mask.dtype == np.bool_:
        if mask.shape == field.shape and size is None:
            inside = mask
        else:
            expected = size if size is not None else field.size
            off = [abs(m - e) for m, e in zip(mask.shape[::-1], expected)]
            near = 0 if size is not None else 2 * field.step + 0.05 * max(expected)
            if max(off) > near:
                whose = "the picture has" if size is not None else "the vectors cover"
                turned = " It looks transposed." if mask.shape == tuple(expected) and expected[0] != expected[1] else ""
                raise InvalidInput(
                    f"{name} has {mask.shape[1]} x {mask.shape[0]} pixels, and {whose} {expected[0]} x {expected[1]}: give the mask of this picture.{turned}"
                )
            inside = _shares(mask, x, y, field.step) >= 0.5
    else:
        inside = inside_outline(mask, x, y)
    inside = np.asarray(inside)
    if not (inside & field.valid).any():
        raise InvalidInput(
            f"{name} holds no vector: they lie from pixel ({plain_number(x[0], 4)}, {plain_number(y[0], 4)}) to ({plain_number(x[-1], 4)}, {plain_number(y[-1], 4)}), one every {plain_number(field.step, 3)}. Is it in "
            "pixels of this picture (x, y), and larger than the step?"
        )
    return inside


def _shares(mask: Bools, x: Floats, y: Floats, step: float) -> Floats:
    """Fraction of each vector's square that is inside, from sums over rectangles from the corner of the mask."""
    table = np.zeros((mask.shape[0] + 1, mask.shape[1] + 1))
    table[1:, 1:] = np.cumsum(np.cumsum(mask, axis=0, dtype=np.float64), axis=1)

    def ends(at: Floats, count: int) -> tuple[Any, Any]:
        low = np.clip(np.rint(at - 0.5 * step + 0.5).astype(int), 0, count - 1)
        return low, np.clip(np.rint(at + 0.5 * step + 0.5).astype(int), low + 1, count)

    (left, right), (top, bottom) = ends(x, mask.shape[1]), ends(y, mask.shape[0])
    total = (
        table[np.ix_(bottom, right)]
        - table[np.ix_(top, right)]
        - table[np.ix_(bottom, left)]
        + table[np.ix_(top, left)]
    )
    return np.asarray(total / np.outer(bottom - top, right - left))


def inside_outline(corners: Floats, x: Floats, y: Floats) -> Bools:
    """Return which points of a grid lie inside an outline, by the even-odd rule."""
    xx, yy = np.meshgrid(x, y)
    inside = np.zeros(xx.shape, dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0)):
        crosses = (y0 > yy) != (y1 > yy)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= crosses & (xx < (x1 - x0) * (yy - y0) / (y1 - y0) + x0)
    return inside
