"""Read displacement fields of other programs: NumPy, MATLAB, text, TIFF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate._extras import missing
from palpate._files import ordinary
from palpate._memory import require
from palpate._numbers import plain_number
from palpate.camera.stacks import check_page, check_size
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, PalpateError
from palpate.microscopy.fields import EVEN, Field
from palpate.microscopy.found import Found, beside, check_unnamed, chosen, normal_beside, stacked_pair
from palpate.microscopy.matfile import read_mat
from palpate.microscopy.names import UNIT_NAMES, VECTORS, units_of, which
from palpate.microscopy.pivtext import read_matrix, read_piv_text
from palpate.microscopy.pixelsize import PixelSize, differing
from palpate.recordings import Recording
from palpate.recordings.damage import DAMAGE_OF_PACKED
from palpate.units import UNITS, plain_unit

__all__ = ["READERS", "is_field", "read_field"]

#: Note for fields with y upwards, if the size of the picture is unknown.
TURNED = "y is flipped about the middle of the vectors, because no picture shows where its top is: a mask is misplaced if they do not lie in its middle (size=, --image)"
#: Which direction of a displacement out of the plane is positive.
NORMALS = ("up", "down", "ignore")
#: Note for vectors at irregular positions, which are interpolated to a grid with about as many points.
_SCATTERED = "the {count} vectors lie at no regular positions: they are interpolated to a grid of {step:.3g} px (cubic, Clough-Tocher)"


def read_field(
    source: str | Path | Sequence[str | Path],
    *,
    pixel: float,
    unit: str | None = None,
    step: float | None = None,
    start: tuple[float, float] | None = None,
    size: tuple[int, int] | None = None,
    up: bool = False,
    v_up: bool = False,
    name: str | None = None,
    follow: bool = False,
    window: float | None = None,
    position_unit: str | None = None,
    normal: str = "up",
) -> Field:
    """Read a displacement field that another program made.

    Parameters
    ----------
    source : path, or two of them
        ``.npy`` (a pair, or one array of both components), ``.npz``, ``.mat`` (v5 and v7.3, structs and cells inside each other), ``.h5``, text tables with columns
        x, y, u, v (``.txt``, ``.dat``, ``.csv``, ``.tsv``: OpenPIV, JPIV, PIVlab, Tecplot), a pair of text matrices, ``.tif`` (two pages or channels, or
        a pair). Of a pair the first is along x (columns).
    pixel : float
        Metres in a pixel of the picture.
    unit : "px", "m", "mm", "um" or "nm", optional
        Of the displacements. Tables of PIV programs are in pixels unless they state a unit; matrices state none. Columns of standard deviations and of w have
        the unit in their header, or else that of the displacements.
    step : float, optional
        Pixels between vectors, for matrices without positions.
    start : (float, float), optional
        Pixel (column, row) of the first vector of a matrix; default: half a step from the corner, or the middle of a picture of ``size``.
    size : (int, int), optional
        Columns and rows of the picture. With it the step of a matrix that covers the picture need not be given.
    up : bool
        v (and the table's y) grow upwards. By default both grow downwards, as rows do.
    v_up : bool
        v alone grows upwards: the table's y, or the rows, grow downwards.
    name : str, optional
        Which field of a file that holds several, or the number of the frame in a table of several.
    follow : bool
        The vectors of a table belong to the moved markers: each position is moved by its own vector.
    window : float, optional
        Side [px] of the program's windows: each vector is then the mean over its window. None: values at points.
    position_unit : str, optional
        Of the positions of a table; default: that of the file, or that of the displacements.
    normal : "up", "down" or "ignore"
        Where a displacement out of the plane (w, uz, dz) of the file points that is positive: out of the gel, or into it. "ignore" leaves it out.

    Returns
    -------
    Field
        Its ``notes`` say what was assumed.

    Raises
    ------
    InvalidInput
        A file that is not there, damaged, or holds no field or several; an unknown unit or step; displacements that are impossible in that unit.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from palpate.microscopy import read_field
    >>> u = np.zeros((30, 40))
    >>> u[10:20, 10:20] = 1.5  # pixels
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.save(f"{folder}/u.npy", u)
    ...     np.save(f"{folder}/v.npy", 0 * u)
    ...     field = read_field([f"{folder}/u.npy", f"{folder}/v.npy"], pixel=0.1e-6, unit="px", step=8)
    >>> field.shape, round(float(field.displacement.max()), 9)
    ((30, 40), 1.5e-07)
    """
    paths = [Path(p) for p in ([source] if isinstance(source, str | Path) else source)]
    if not (np.isfinite(pixel) and pixel > 0):
        raise InvalidInput(f"pixel must be a positive number of metres; got {pixel!r}.")
    units = ("px", *UNITS["length"])
    unit = None if unit is None else plain_unit(unit)
    if unit is not None and unit not in units:
        raise InvalidInput(f"unit must be one of {', '.join(units)}; got {unit!r}.")
    if normal not in NORMALS:
        raise InvalidInput(f"normal must be {', '.join(map(repr, NORMALS))} (--normal); got {normal!r}.")
    for option, value in (("unit", unit), ("position_unit", position_unit)):
        if value is not None and value not in units:
            raise InvalidInput(f"{option} must be one of {', '.join(units)}; got {value!r}.")
    for path in paths:
        size_of_file = ordinary(path).stat().st_size
        if size_of_file == 0:
            raise InvalidInput(f"{path} is empty.")
        if path.suffix.lower() not in READERS:
            raise InvalidInput(f"{path}: the ending {path.suffix!r} is not known; accepted: {', '.join(READERS)}.")
        require(3.0 * size_of_file, f"{path}: fields of this size", "Cut it to the fields that are wanted.")
    if not 1 <= len(paths) <= 2:
        raise InvalidInput(f"a field is one file, or two with one component each; got {len(paths)}.")
    contents = _pair(paths, name) if len(paths) == 2 else READERS[paths[0].suffix.lower()](paths[0], name)
    return _field(contents, paths[0], pixel, unit, step, start, size, up, v_up, follow, window, position_unit, normal)


def is_field(paths: Sequence[str | Path]) -> bool:
    """Return whether file names are those of displacement fields rather than of pictures. TIFF files are opened: pages
    of floats with values below zero are fields.

    Examples
    --------
    >>> from palpate.microscopy import is_field
    >>> is_field(["u.npy", "v.npy"]), is_field(["before.png", "after.png"])
    (True, False)
    """
    endings = {Path(p).suffix.lower() for p in paths}
    if endings <= {".tif", ".tiff"} and all(Path(p).is_file() for p in paths):
        if not all(_floats(Path(p)) for p in paths):
            return False
        pages = [page for p in paths for page in _pages(Path(p))]
        return len(pages) == 2 and any((page < 0).any() for page in pages)
    return endings <= set(READERS) - {".tif", ".tiff"}


# -- readers ---------------------------------------------------------------------------------------------------------------


def _npy(path: Path, name: str | None) -> Found:
    values = _array(path)
    if values.ndim == 4 and 2 in (values.shape[1], values.shape[-1]):  # frame by frame
        return stacked_pair(path, chosen(path, {str(k): each for k, each in enumerate(values)}, name, "frames"))
    check_unnamed(path, name)
    return stacked_pair(path, values)


def _array(path: Path) -> Any:
    try:
        return np.load(path, allow_pickle=False)
    except (ValueError, OSError, EOFError, SyntaxError, TypeError, MemoryError) as error:
        raise InvalidInput(
            f"{path}: cannot be read as .npy ({str(error)[:80]}); it is truncated, damaged, or holds Python objects: save plain numbers with np.save."
        ) from error


def _npz(path: Path, name: str | None) -> Found:
    import zipfile

    try:
        # open the file here: the library leaves a file open if it cannot read it
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                check_size(info.file_size, f"{path}: {info.filename}")
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = {key: np.asarray(file[key]) for key in file.files}
    except InvalidInput:
        raise
    except DAMAGE_OF_PACKED as error:
        raise InvalidInput(
            f"{path}: cannot be read as .npz ({str(error)[:80]}); it is truncated, damaged or of another format."
        ) from error
    lower = {key.lower(): key for key in arrays}
    candidates: dict[str, Found] = {}
    for pair in which(lower, VECTORS):
        u, v = (arrays[lower[n]] for n in pair)
        if u.shape != v.shape or u.ndim not in (1, 2):
            continue
        contents = Found(u=u, v=v)
        extra = {n: arrays[key] for n, key in lower.items()}
        places, contents.std, notes = beside(extra, u.shape)
        contents.w = normal_beside(extra, u.shape)
        contents.notes += notes
        if places is not None:
            contents.x, contents.y = places
        for key in UNIT_NAMES:
            if key in lower and arrays[lower[key]].dtype.kind == "U" and arrays[lower[key]].size == 1:
                contents.place, contents.unit = units_of(str(arrays[lower[key]].ravel()[0]))
        candidates[f"{lower[pair[0]]}, {lower[pair[1]]}"] = contents
    if not candidates:
        single = [
            key for key, v in arrays.items() if v.ndim == 3 and 2 in (v.shape[0], v.shape[-1]) and v.dtype.kind == "f"
        ]
        candidates = {key: stacked_pair(path, arrays[key]) for key in single}
    if not candidates:
        raise InvalidInput(
            f"{path}: no displacement field: sought are two arrays of one shape called u and v, ux and uy or dx and dy; it holds "
            f"{', '.join(f'{k} {v.shape}' for k, v in list(arrays.items())[:8]) or 'nothing'}. Save it as np.savez(file, u=..., v=...)."
        )
    return chosen(path, candidates, name)


def _pages(path: Path) -> list[Any]:
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF fields", error) from error
    try:
        with tifffile.TiffFile(path) as file, path.open("rb") as raw:
            for number, page in enumerate(file.pages):
                check_page(raw, page, f"{path}: page {number}")
            require(
                2.0 * sum(page.nbytes for page in file.pages),
                f"the pages of {path}",
                "Give one field.",
            )
            pages = [np.asarray(page.asarray()) for page in file.pages]
    except PalpateError:
        raise
    except (tifffile.TiffFileError, OSError, ValueError, IndexError, TypeError, KeyError, MemoryError) as error:
        raise InvalidInput(
            f"{path}: cannot be read as TIFF ({str(error)[:80]}); it is truncated or damaged."
        ) from error
    if len(pages) == 1 and pages[0].ndim == 3:
        axis = [a for a in (0, 2) if pages[0].shape[a] == 2]
        if len(axis) == 1:
            pages = list(np.moveaxis(pages[0], axis[0], 0))
    return pages


def _floats(path: Path) -> bool:
    """Return whether the pages of a TIFF file hold floats, without decompressing them."""
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF fields", error) from error
    try:
        with tifffile.TiffFile(path) as file:
            return all(page.dtype is not None and page.dtype.kind == "f" for page in file.pages)
    except (tifffile.TiffFileError, OSError, ValueError, IndexError, TypeError, KeyError, AttributeError) as error:
        raise InvalidInput(
            f"{path}: cannot be read as TIFF ({str(error)[:80]}); it is truncated or damaged."
        ) from error


def _tiff(path: Path, name: str | None) -> Found:
    check_unnamed(path, name)
    pages = _pages(path)
    if any(p.dtype.kind != "f" for p in pages):
        raise InvalidInput(
            f"{path}: holds pictures ({pages[0].dtype}), not displacements, which are floating-point. As pictures of beads it needs two: the gel at "
            "rest and the gel that is pulled."
        )
    if len(pages) != 2 or pages[0].shape != pages[1].shape or pages[0].ndim != 2:
        raise InvalidInput(
            f"{path}: a field has two pages or channels of one size, along x and along y; got {len(pages)} of {' and '.join(str(p.shape) for p in pages[:3])}."
        )
    return Found(u=pages[0], v=pages[1])


def _text(path: Path, name: str | None) -> Found:
    return read_piv_text(path, name)


#: Reader of each ending.
READERS: dict[str, Callable[[Path, str | None], Found]] = {
    ".npy": _npy,
    ".npz": _npz,
    ".mat": read_mat,
    ".h5": read_mat,
    ".hdf5": read_mat,
    ".txt": _text,
    ".dat": _text,
    ".csv": _text,
    ".tsv": _text,
    ".tif": _tiff,
    ".tiff": _tiff,
}


def _pair(paths: list[Path], name: str | None) -> Found:
    """Read two files with one component each."""
    if name is not None:
        raise InvalidInput("name= picks a field of one file that holds several; two files hold one component each.")
    parts = []
    for path in paths:
        ending = path.suffix.lower()
        if ending == ".npy":
            values = _array(path)
        elif ending in (".tif", ".tiff"):
            pages = _pages(path)
            if len(pages) != 1 or pages[0].dtype.kind != "f":
                raise InvalidInput(
                    f"{path}: one component is one page of floating-point numbers; got {len(pages)} of {pages[0].dtype}."
                )
            values = pages[0]
        elif ending in (".npz", ".mat", ".h5", ".hdf5"):
            raise InvalidInput(f"{path}: a {ending} file holds both components; give it alone.")
        else:
            values = read_matrix(path)
        if values.ndim != 2 or values.dtype.kind not in "fiu":
            raise InvalidInput(
                f"{path}: one component is a matrix (row, column) of real numbers; got {values.dtype} of shape {values.shape}."
            )
        parts.append(np.asarray(values, dtype=np.float64))
    if parts[0].shape != parts[1].shape:
        hint = " One looks transposed." if parts[0].shape == parts[1].shape[::-1] else ""
        raise InvalidInput(
            f"{paths[0]} has {parts[0].shape} vectors and {paths[1]} {parts[1].shape}: both components must have one shape.{hint}"
        )
    if np.array_equal(parts[0], parts[1], equal_nan=True) and np.nanstd(parts[0]) > 0:
        raise InvalidInput(
            f"{paths[0]} and {paths[1]} hold the same numbers: give the component along x, then that along y."
        )
    return Found(
        u=parts[0], v=parts[1], notes=[f"{paths[0].name} is taken along x (columns), {paths[1].name} along y (rows)"]
    )


# -- from numbers to a field -------------------------------------------------------------------------------------------------


def _field(
    contents: Found,
    path: Path,
    pixel: float,
    unit: str | None,
    step: float | None,
    start: tuple[float, float] | None,
    size: tuple[int, int] | None,
    up: bool,
    v_up: bool,
    follow: bool,
    window: float | None,
    position_unit: str | None,
    normal: str,
) -> Field:
    notes = list(contents.notes)
    if up and v_up:
        raise InvalidInput("up (--up) turns y and v, v_up (--v-up) v alone: give one of them.")
    if window is not None and not (np.isfinite(window) and window > 0):
        raise InvalidInput(f"window must be a positive number of pixels; got {window!r}.")
    used = _unit(path, "displacements", contents.unit, unit, "unit") or ("px" if contents.pixels else None)
    if used is None:
        raise InvalidInput(
            f'{path}: nothing says in what unit the displacements are: give unit="px", or "m", "um" and so on (--unit px).'
        )
    factor = pixel if used == "px" else UNITS["length"][used]
    if contents.x is None and position_unit is not None:
        raise InvalidInput(f"{path}: has no positions: leave out position_unit (--position-unit).")
    place = _unit(path, "positions", contents.place, position_unit, "position_unit")
    if contents.x is not None and place is None and contents.unit not in (None, "px"):
        raise InvalidInput(
            f'{path}: displacements in {contents.unit}, and nothing says in what unit the positions are: give position_unit="px", or "um" and so on (--position-unit px).'
        )
    if unit is None and contents.unit is None and place is None:
        notes.append("displacements and positions are taken as pixels")
    elif contents.x is not None and place is None and used != "px":
        notes.append(
            f"positions are taken in {used}, as displacements are (position_unit=, --position-unit, where they are not)"
        )
    place = place or used
    reach = 1.0 if place == "px" else UNITS["length"][place] / pixel
    if contents.pixel is not None:
        notes += filter(None, [differing(path, pixel, PixelSize(contents.pixel, contents.pixel, path.name))])
    u, v = (np.array(p, dtype=np.float64) for p in (contents.u, contents.v))
    w = None if contents.w is None or normal == "ignore" else np.array(contents.w, dtype=np.float64)
    if np.isinf(u).any() or np.isinf(v).any() or (w is not None and np.isinf(w).any()):
        raise InvalidInput(f"{path}: holds infinite displacements; mark vectors that are missing as NaN.")
    left_out = 0
    if contents.bad is not None:
        left_out = int((contents.bad & np.isfinite(u) & np.isfinite(v)).sum())
        u[contents.bad] = v[contents.bad] = np.nan
    out = []
    if w is not None:
        w = w * _ratio(path, "displacements out of the plane", contents.w_unit, factor, pixel)
        out = [np.where(np.isnan(u), np.nan, -w if normal == "down" else w)]
        notes.append(
            f"the displacement out of the plane is taken to point {'out of' if normal == 'up' else 'into'} the gel where it is positive (normal=, --normal)"
        )
    std: Any = None if contents.std is None else np.stack([np.asarray(s, dtype=np.float64) for s in contents.std])
    if std is not None:
        std = std * _ratio(path, "standard deviations", contents.std_unit, factor, pixel)
    if follow and contents.x is None:
        raise InvalidInput(f"{path}: follow moves positions, and this file has none: leave it out.")
    if contents.x is not None:
        if step is not None or start is not None:
            raise InvalidInput(f"{path}: has positions of its own: leave out step and start.")
        x, y = (np.array(p, dtype=np.float64) * reach for p in (contents.x, contents.y))
        if follow:
            # y grows against v where v alone grows upwards
            along_y = -v if v_up else v
            x, y = x + np.nan_to_num(u) * (factor / pixel), y + np.nan_to_num(along_y) * (factor / pixel)
        if up:
            if size is None:
                notes.append(TURNED)
            y = (size[1] - 1 if size is not None else np.nanmax(y) + np.nanmin(y)) - y
        v = -v if up or v_up else v
        values, std, start, step = _placed(np.stack([u, v, *out]), std, x, y, notes)
    else:
        values = np.stack([u, -v if up or v_up else v, *out])
        if values.ndim != 3:
            raise InvalidInput(
                f"{path}: its vectors have the shape {u.shape}, and no positions: a field without positions is a matrix (row, column) of each component. Save positions x and y too, or two matrices."
            )
        step, start = _grid(values.shape[1:], path, step, start, size, notes)
    if not (up or v_up):
        notes.append(
            "y and v are taken to grow downwards, as rows do (up=True, --up, where they do not; v_up=True, --v-up, where v alone does not)"
        )
    if size is not None:
        ends = [s + (n - 1) * step for s, n in zip(start, values.shape[:0:-1])]
        if min(start) < -step or any(e > n - 1 + step for e, n in zip(ends, size)):
            raise InvalidInput(
                f"{path}: the vectors reach from pixel ({plain_number(start[0], 4)}, {plain_number(start[1], 4)}) to ({plain_number(ends[0], 4)}, {plain_number(ends[1], 4)}), and the picture has "
                f"{size[0]} x {size[1]} pixels: check the unit of the positions, the step, and which picture it is."
            )
    return Field(
        displacement=values[:2] * factor, normal=values[2] * factor if out else None, start=(float(start[0]), float(start[1])), step=float(step), pixel=float(pixel),
        std=None if std is None else std * factor, aperture=(window or 0.0) * pixel, notes=tuple(notes), left_out=left_out,
    )  # fmt: skip


def _unit(path: Path, quantity: str, unit_in_file: str | None, unit: str | None, option: str) -> str | None:
    """Unit of displacements or positions, from the file or from the caller; they must not contradict each other."""
    if unit_in_file is not None and unit_in_file != "px" and unit_in_file not in UNITS["length"]:
        if "/" in unit_in_file:
            raise InvalidInput(
                f"{path}: {quantity} in {unit_in_file} are velocities, a field has displacements: export it in pixels a frame."
            )
        raise InvalidInput(f"{path}: {quantity} in {unit_in_file!r}; accepted: px, {', '.join(UNITS['length'])}.")
    if unit_in_file is not None and unit is not None and unit_in_file != unit and {unit_in_file, unit} != {"um", "µm"}:
        raise InvalidInput(
            f"{path} says that {quantity} are in {unit_in_file}, and {option}={unit!r} was given: leave out {option} (--{option.replace('_', '-')})."
        )
    return unit or unit_in_file


def _ratio(path: Path, quantity: str, unit_in_file: str | None, factor: float, pixel: float) -> float:
    """Return the unit of a quantity that the file states, relative to the unit of the displacements (``factor`` [m])."""
    unit = _unit(path, quantity, unit_in_file, None, "unit")
    return 1.0 if unit is None else (pixel if unit == "px" else UNITS["length"][unit]) / factor


def _grid(
    shape: tuple[int, ...],
    path: Path,
    step: float | None,
    start: tuple[float, float] | None,
    size: tuple[int, int] | None,
    notes: list[str],
) -> tuple[float, tuple[float, float]]:
    """Return the step and the first pixel of a matrix that has no positions."""
    rows, columns = shape
    if step is None:
        if size is None:
            raise InvalidInput(
                f"{path}: a matrix of {rows} x {columns} vectors does not say how far apart they are: give step= (pixels between vectors, --step; "
                "of PIV windows, their size less their overlap), or the picture."
            )
        steps = size[0] / columns, size[1] / rows
        if abs(steps[0] / steps[1] - 1.0) > 0.1:
            hint = " The field looks transposed." if abs(size[0] / rows / (size[1] / columns) - 1.0) < 0.1 else ""
            raise InvalidInput(
                f"{path}: {columns} x {rows} vectors do not cover a picture of {size[0]} x {size[1]} pixels evenly: give step= (--step), the pixels between vectors.{hint}"
            )
        step = float(np.mean(steps))
        notes.append(
            f"the vectors are taken to cover the picture: one every {step:.3g} px (give the step where they do not)"
        )
    if not (np.isfinite(step) and step > 0):
        raise InvalidInput(f"step must be a positive number of pixels; got {step!r}.")
    if start is None:
        if size is not None:
            start = ((size[0] - 1 - (columns - 1) * step) / 2, (size[1] - 1 - (rows - 1) * step) / 2)
            notes.append("the vectors are taken to lie in the middle of the picture (give start where they do not)")
        else:
            start = ((step - 1) / 2, (step - 1) / 2)
    return step, start


def _placed(
    values: Floats, std: Floats | None, x: Floats, y: Floats, notes: list[str]
) -> tuple[Floats, Floats | None, tuple[float, float], float]:
    """Put vectors at given positions [px] on a grid with row 0 at the top."""
    flat = [np.ravel(p) for p in (x, y)]
    if not all(np.isfinite(p).all() for p in flat):
        raise InvalidInput("the positions hold values that are not finite.")
    values = values.reshape(len(values), -1)
    stds = None if std is None else std.reshape(2, -1)
    axes = [_levels(p) for p in flat]
    steps = [a[1] for a in axes]
    if len(flat[0]) < 16:
        raise InvalidInput(f"{len(flat[0])} vectors: at least 16 are needed.")
    regular = all(s > 0 for s in steps) and abs(steps[0] - steps[1]) <= EVEN * max(steps)
    if regular:
        step = 0.5 * (steps[0] + steps[1])
        start = (float(axes[0][0]), float(axes[1][0]))
        places = [np.rint((p - s) / step).astype(int) for p, s in zip(flat, start)]
        regular = all(np.abs((p - s) / step - k).max() <= 0.25 for p, s, k in zip(flat, start, places))
        columns, rows = (int(k.max()) + 1 for k in places)
        regular = regular and columns * rows <= 4 * len(flat[0])
        if regular:
            index = places[1] * columns + places[0]
            if len(np.unique(index)) != len(index):
                raise InvalidInput(
                    "positions are there twice: the file may hold several fields, one after another. Give one."
                )
            out = np.full((len(values), rows * columns), np.nan)
            out[:, index] = values
            deviations: Any = None
            if stds is not None:
                deviations = np.full((2, rows * columns), np.nan)
                deviations[:, index] = stds
                deviations = deviations.reshape(2, rows, columns)
            return out.reshape(-1, rows, columns), deviations, start, step
    good = np.isfinite(values).all(axis=0)
    at = np.stack(flat, axis=1)[good]
    area = float(np.prod(np.ptp(at, axis=0)))
    if good.sum() < 16 or area <= 0:
        raise InvalidInput(f"{int(good.sum())} vectors that lie in a line or at one place are no field.")
    step = float(np.sqrt(area / good.sum()))
    gridded = Recording(
        readings=values[None, :, good],
        channels=("displacement_x", "displacement_y", "displacement_z")[: len(values)],
        positions=at,
    ).gridded(step)
    notes.append(_SCATTERED.format(count=int(good.sum()), step=step))
    if stds is not None:
        notes.append("the standard deviations of the file are left out")
    return gridded.readings[0], None, (float(gridded.meta["x0"]), float(gridded.meta["y0"])), step


def _levels(values: Floats) -> tuple[float, float]:
    """Return the least coordinate and the distance between neighbouring ones; 0 if the distances differ."""
    levels = np.unique(np.round(values, 6))
    gaps = np.diff(levels)
    if not len(gaps):
        return float(levels[0]), 0.0
    step = float(np.median(gaps))
    multiples = np.rint(gaps / step)
    if (multiples < 1).any() or np.abs(gaps - multiples * step).max() > EVEN * step + 1e-6 * np.abs(levels).max():
        return float(levels[0]), 0.0
    # use the mean step, because coordinates may be rounded
    return float(levels[0]), float((levels[-1] - levels[0]) / multiples.sum())
