"""Read displacement fields from .mat files and plain HDF5: v5 by SciPy, v7.3 (which is HDF5) by h5py, including nested
structs and cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from palpate._extras import require
from palpate.camera.stacks import check_size
from palpate.errors import InvalidInput
from palpate.microscopy.found import Found, beside, chosen, normal_beside
from palpate.microscopy.names import (
    BOTH_STDS,
    OUT_OF_PLANE,
    POSITIONS,
    STDS,
    UNIT_NAMES,
    VECTORS,
    unit_of,
    units_of,
    which,
)
from palpate.recordings.damage import DAMAGE, DAMAGE_OF_PACKED
from palpate.units import UNITS

__all__ = ["fields_of", "read_mat"]

_DAMAGED = "{path}: cannot be read as .mat or HDF5 ({error}); it is truncated, damaged or of another format. Save it again from the program that made it."
#: Depth of nested structs that is searched.
DEEPEST = 12


def read_mat(path: Path, name: str | None) -> Found:
    """Read the field in a .mat file, or an HDF5 file. Matrices that MATLAB did not write are not transposed."""
    return chosen(path, fields_of(path), name)


def fields_of(path: Path) -> dict[str, Found]:
    """Return every field of a .mat or HDF5 file by name."""
    if path.suffix.lower() != ".mat":
        return _all(path, _version_73(path, turned=False))
    with path.open("rb") as file:
        head = file.read(520)
    return _all(
        path, _version_73(path) if head[:10] == b"MATLAB 7.3" or b"\x89HDF\r\n\x1a\n" in head else _version_5(path)
    )


def _all(path: Path, tree: dict[str, Any]) -> dict[str, Found]:
    candidates = dict(_fields(tree, ""))
    for found in candidates.values():
        # use units of the whole file if the struct of the field states none
        place, unit, pixel = _stated(tree)
        found.place, found.unit, found.pixel = found.place or place, found.unit or unit, found.pixel or pixel
        for key in ("place", "unit", "std_unit", "w_unit"):
            said = getattr(found, key)
            if said is not None and said != "px" and said not in UNITS["length"] and "/" not in said:
                found.notes.append(f"{path.name} says {said!r} of its units, which is no length: it is not used")
                setattr(found, key, None)
    if not candidates:
        held = ", ".join(list(tree)[:12]) or "nothing"
        raise InvalidInput(
            f"{path}: no displacement field: sought are two matrices of one shape called u and v, ux and uy or dx and dy, or pos and vec of "
            f"(n, 2); it holds {held}. Rename them, or save them as two .csv files."
        )
    return candidates


def _version_5(path: Path) -> dict[str, Any]:

    import scipy.io
    from scipy.io.matlab import MatReadError

    _check_sizes(path)
    try:
        held = scipy.io.loadmat(path, struct_as_record=True, squeeze_me=False)
    except (MatReadError, *DAMAGE_OF_PACKED) as error:
        raise InvalidInput(_DAMAGED.format(path=path, error=str(error)[:80] or type(error).__name__)) from error
    return {key: _unpacked(value, 0) for key, value in held.items() if not key.startswith("__")}


def _check_sizes(path: Path) -> None:
    """Raise an error for compressed variables whose stated size is larger than a field can be."""
    import struct
    import zlib

    with path.open("rb") as file:
        head = file.read(128)
        order = "<" if head[126:128] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, count = struct.unpack(order + "II", tag)
            start = file.tell()
            if kind == 15:  # 15 means compressed
                try:
                    inner = zlib.decompressobj().decompress(file.read(min(count, 256)), 8)
                except zlib.error:
                    return  # the reader reports the error
                if len(inner) == 8:
                    check_size(struct.unpack(order + "II", inner)[1], f"{path}: a variable")
            file.seek(start + count)


def _unpacked(value: Any, depth: int) -> Any:
    """Convert structs to dictionaries, and arrays of structs and cells to lists."""
    if depth > DEEPEST or not isinstance(value, np.ndarray):
        return value
    if value.dtype.names:
        each = [{n: _unpacked(one[n], depth + 1) for n in value.dtype.names} for one in value.ravel()]
        return each[0] if len(each) == 1 else each
    if value.dtype == object:
        cells = [_unpacked(one, depth + 1) for one in value.ravel()]
        return cells[0] if len(cells) == 1 else cells
    return value


def _version_73(path: Path, *, turned: bool = True) -> dict[str, Any]:
    require("MATLAB 7.3 and HDF5 files", "h5py")
    import h5py

    from palpate.recordings.netcdf import guard, opened

    try:
        with opened(path) as file:
            guard(file, path)
            return _attributes(
                file, {key: _followed(file, file[key], h5py, 0, turned) for key in file if not key.startswith("#")}
            )
    except InvalidInput:
        raise
    except DAMAGE as error:
        raise InvalidInput(_DAMAGED.format(path=path, error=str(error).strip("'\"")[:80])) from error


def _attributes(group: Any, parts: dict[str, Any]) -> dict[str, Any]:
    """Return the parts of a group, with units that HDF5 and netCDF store as attributes of a matrix."""
    for key in list(parts):
        for name in UNIT_NAMES:
            unit = group[key].attrs.get(name) if isinstance(parts[key], np.ndarray) else None
            if isinstance(unit, bytes | str):
                parts[f"{key} {UNIT_NAMES[0]}"] = unit.decode("utf-8", "replace") if isinstance(unit, bytes) else unit
    return parts


def _followed(file: Any, held: Any, h5py: Any, depth: int, turned: bool) -> Any:
    """Follow references in a MATLAB v7.3 file. MATLAB stores matrices by columns, so that HDF5 sees them transposed;
    structs are groups; cells and arrays of structs are references.
    """
    if depth > DEEPEST:
        return None
    if isinstance(held, h5py.Group):
        parts = _attributes(held, {key: _followed(file, held[key], h5py, depth + 1, turned) for key in held})
        if list(held) == ["0"]:  # a single frame of a series
            return parts["0"]
        lists = {key: part for key, part in parts.items() if isinstance(part, list)}
        if (
            parts and len(lists) == len(parts) and len({len(part) for part in lists.values()}) == 1
        ):  # this is an array of structs
            return [dict(zip(lists, each)) for each in zip(*lists.values())]
        return parts
    if held.dtype == h5py.ref_dtype:
        cells = [_followed(file, file[one], h5py, depth + 1, turned) for one in np.asarray(held[()]).T.ravel() if one]
        return cells[0] if len(cells) == 1 and depth > 1 else cells
    if held.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, np.asarray(held[()]).ravel()))
    if h5py.check_string_dtype(held.dtype) is not None and held.size == 1:
        return str(np.asarray(held.asstr()[()]).ravel()[0])
    if held.dtype.kind not in "fiu":
        return None
    return np.asarray(held[()]).T if turned else np.asarray(held[()])


def _words(value: Any) -> str:
    """Return a text of MATLAB or HDF5; "" if the value is anything else."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "U" and value.size:
        return " ".join(map(str, value.ravel()))
    return value if isinstance(value, str) else ""


def _stated(tree: dict[str, Any]) -> tuple[str | None, str | None, float | None]:
    """Units of positions and displacements, and size of a pixel [m], as far as PIVlab's calibration states them."""
    lower = {key.lower(): value for key, value in tree.items()}
    place = unit = None
    for key in UNIT_NAMES:
        if _words(lower.get(key)):
            place, unit = units_of(_words(lower[key]))
    scale = np.asarray(lower.get("calxy", 1.0))
    pixel = float(scale.ravel()[0]) if scale.size == 1 and scale.dtype.kind in "fiu" else 1.0
    return place, unit, pixel if 0 < pixel < 1 else None


def _left_out(parts: dict[str, Any], pair: tuple[str, str], shape: tuple[int, ...], notes: list[str]) -> Any:
    """Vectors that PIVlab's typevector marks as masked (0) or interpolated (2), as in its tables; None without one."""
    name = f"typevector{pair[0].removeprefix('u')}"
    types = parts.get(name)
    if types is None or not _numbers(types) or types.shape != shape:
        return None
    marked = np.asarray(types != 1)
    if marked.any():
        notes.append(f"{int(marked.sum())} of {marked.size} vectors are left out: {name} marks them")
    return marked


def _numbers(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.size > 1


def _fields(tree: Any, where: str) -> Iterator[tuple[str, Found]]:
    """Iterate over every field of a tree, with its path."""
    if isinstance(tree, list):
        for i, each in enumerate(tree):
            yield from _fields(each, f"{where}({i + 1})")
        return
    if not isinstance(tree, dict):
        return
    lower = {key.lower(): key for key in tree}
    prefix = f"{where}." if where else ""
    for pair in which(lower, VECTORS):
        u, v = (tree[lower[n]] for n in pair)
        together = list(zip(u, v)) if isinstance(u, list) and isinstance(v, list) else [(u, v)]
        for i, (a, b) in enumerate(together):
            if not (_numbers(a) and _numbers(b) and a.shape == b.shape):
                continue
            extra: dict[str, Any] = {}
            parts = {n: tree[key] for n, key in lower.items()}
            parts = {n: p[min(i, len(p) - 1)] if isinstance(p, list) and p else p for n, p in parts.items()}
            places, std, said = beside({n: p for n, p in parts.items() if _numbers(p)}, a.shape)
            if places is not None:
                extra |= dict(zip("xy", places))
            extra |= {"std": std, "notes": said}
            extra["bad"] = _left_out(parts, pair, a.shape, said)
            extra["w"] = normal_beside({n: p for n, p in parts.items() if _numbers(p)}, a.shape)
            extra["place"], extra["unit"], extra["pixel"] = _stated(tree)
            stds = [n for n, _ in which(lower, STDS)] or [n for n in BOTH_STDS if n in lower]
            for key, by in (
                ("unit", lower[pair[0]]),
                *(("place", lower[n]) for n, _ in which(lower, POSITIONS)),
                *(("std_unit", lower[n]) for n in stds[:1]),
                *(("w_unit", lower[n]) for n in [n for n in OUT_OF_PLANE if n in lower][:1]),
            ):
                if _words(tree.get(f"{by} {UNIT_NAMES[0]}")):
                    extra[key] = unit_of(tree[f"{by} {UNIT_NAMES[0]}"])
            name = prefix + f"{lower[pair[0]]}, {prefix}{lower[pair[1]]}" + (f"({i + 1})" if len(together) > 1 else "")
            flat = (
                {k: v.ravel() if k in ("x", "y", "w", "bad") and v is not None else v for k, v in extra.items()}
                | {"std": None if std is None else (std[0].ravel(), std[1].ravel())}
                if min(a.shape) == 1
                else extra
            )
            yield name, Found(u=a.ravel() if min(a.shape) == 1 else a, v=b.ravel() if min(a.shape) == 1 else b, **flat)
    if "pos" in lower and "vec" in lower:
        pos, vec = tree[lower["pos"]], tree[lower["vec"]]
        if _numbers(pos) and _numbers(vec) and pos.shape == vec.shape and pos.ndim == 2 and 2 in pos.shape:
            pos, vec = (p if p.shape[1] == 2 else p.T for p in (pos, vec))
            yield (
                f"{prefix}pos, {prefix}vec",
                Found(
                    u=vec[:, 0],
                    v=vec[:, 1],
                    x=pos[:, 0],
                    y=pos[:, 1],
                    pixels=True,
                    notes=[] if _stated(tree)[1] else ["pos and vec are taken as pixels of the picture"],
                ),
            )
    for key, each in tree.items():
        if isinstance(each, dict | list):
            yield from _fields(each, prefix + key)
