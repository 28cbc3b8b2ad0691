"""Where the cell is: a picture that is zero outside, or an outline."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._files import ordinary, small_text
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.microscopy.fields import Field
from palpate.microscopy.pivtext import read_matrix

__all__ = ["on_grid", "read_mask"]

Bools = npt.NDArray[np.bool_]

#: A picture of more grey levels than this is no mask.
LEVELS = 16
OUTLINES = (".csv", ".txt", ".json", ".geojson", ".roi")


def read_mask(source: str | Path | npt.ArrayLike) -> npt.NDArray[Any]:
    """A mask from a file: a picture as booleans (row, column), or an outline as corners (n, 2) of x, y [px].

    Parameters
    ----------
    source : path or array
        A picture (``.png``, ``.tif``, ``.npy`` and so on) that is zero outside the cell, or an outline: ``.csv`` of x, y in pixels, ``.json`` or ``.geojson``
        (a list of [x, y], or a Polygon). ImageJ writes a selection so with File > Save As > XY Coordinates.

    Raises
    ------
    InvalidInput
        A file that is not there or damaged, a picture of many grey levels, an empty mask, an outline of fewer than three corners.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from palpate.microscopy import read_mask
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/cell.csv").write_text("10,10\\n60,12\\n40,50\\n")
    ...     read_mask(f"{folder}/cell.csv").tolist()
    [[10.0, 10.0], [60.0, 12.0], [40.0, 50.0]]
    """
    if not isinstance(source, str | Path):
        values = np.asarray(source)
        corners = values.ndim == 2 and values.shape[1] == 2 and values.dtype != np.bool_
        return _outline(values, "the outline") if corners else _picture(values, "the mask")
    path = ordinary(source)
    ending = path.suffix.lower()
    if ending in OUTLINES:
        return _outline(_corners(path, ending), str(path))
    if ending == ".npy":
        try:
            return read_mask(np.load(path, allow_pickle=False))
        except (ValueError, OSError, EOFError) as error:
            raise InvalidInput(f"{path}: cannot be read as a mask ({str(error)[:120]}).") from error
    from palpate.microscopy.pictures import read_picture

    return _picture(read_picture(path), str(path))


def _picture(values: npt.NDArray[Any], name: str) -> Bools:
    if values.ndim == 3 and values.shape[-1] in (3, 4) and values.dtype == np.uint8:
        values = values[..., :3].max(axis=-1)
    if values.ndim != 2 or values.dtype.kind not in "biuf":
        raise InvalidInput(
            f"{name}: a mask is a picture of one channel, or corners (n, 2); got {values.dtype} of shape {values.shape}."
        )
    if values.dtype != np.bool_:
        levels = np.unique(values)
        if len(levels) > LEVELS:
            raise InvalidInput(
                f"{name}: holds {len(levels)} grey levels: it looks like a photograph. A mask is zero outside the cell and one other value inside."
            )
        if len(levels) > 2:
            raise InvalidInput(
                f"{name}: holds {len(levels)} values ({', '.join(f'{v:g}' for v in levels[:6])}), several cells perhaps: give a mask of one cell, zero outside."
            )
    inside = values != 0
    if not inside.any():
        raise InvalidInput(f"{name}: the mask is empty: every pixel is zero. Inside the cell it must be another value.")
    return np.asarray(inside)


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


def _corners(path: Path, ending: str) -> Any:
    if ending == ".roi":
        raise InvalidInput(
            f"{path}: .roi files are not read: in ImageJ, File > Save As > XY Coordinates writes the outline as text."
        )
    if ending in (".csv", ".txt"):
        return read_matrix(path)
    try:
        held = json.loads(small_text(path, "an outline"))
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"{path}: cannot be read as JSON ({str(error)[:80]}).") from error
    for _ in range(4):
        if not isinstance(held, dict):
            break
        features = held.get("features")
        if isinstance(features, list):
            if len(features) != 1:
                raise InvalidInput(f"{path}: holds {len(features)} outlines: give one cell.")
            held = features[0]
        else:
            held = held.get("geometry", held.get("coordinates"))
    while isinstance(held, list) and len(held) == 1:
        held = held[0]
    if isinstance(held, list) and held and isinstance(held[0], list) and held[0] and isinstance(held[0][0], list):
        raise InvalidInput(f"{path}: holds {len(held)} rings: give one outline without holes.")
    return held


def on_grid(
    mask: npt.NDArray[Any], field: Field, *, size: tuple[int, int] | None = None, name: str = "the mask"
) -> Bools:
    """Where the vectors of a field lie in a mask (row, column); ``size``: columns and rows of the picture.

    A picture's mask has the picture's size (or that of the grid of vectors); a vector is inside where the most of its square of one step is.

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
        inside = _within(mask, x, y)
    inside = np.asarray(inside)
    if not (inside & field.valid).any():
        raise InvalidInput(
            f"{name} holds no vector: they lie from pixel ({x[0]:.4g}, {y[0]:.4g}) to ({x[-1]:.4g}, {y[-1]:.4g}), one every {field.step:.3g}. Is it in "
            "pixels of this picture (x, y), and larger than the step?"
        )
    return inside


def _shares(mask: Bools, x: Floats, y: Floats, step: float) -> Floats:
    """The part of each vector's square that is inside, by sums from the corner."""
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


def _within(corners: Floats, x: Floats, y: Floats) -> Bools:
    """Points of a grid inside an outline, by the even-odd rule."""
    xx, yy = np.meshgrid(x, y)
    inside = np.zeros(xx.shape, dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0)):
        crosses = (y0 > yy) != (y1 > yy)
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= crosses & (xx < (x1 - x0) * (yy - y0) / (y1 - y0) + x0)
    return inside


def outline_pixels(mask: npt.NDArray[Any]) -> Sequence[Floats] | None:
    """Corners of an outline, for drawing; None of a picture."""
    return None if mask.dtype == np.bool_ else [np.concatenate([mask, mask[:1]])]
