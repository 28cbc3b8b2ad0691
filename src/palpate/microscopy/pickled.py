"""Read Python objects in .npy files, such as Cellpose writes, safely: only arrays, numbers and text are built, and no
function named in the file is run.
"""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.damage import DAMAGE_OF_PACKED

__all__ = ["read_objects"]


class _Array:
    """Stands for the class of arrays in a pickle, which must not be called there."""


def _rebuilt(kind: Any, shape: Any, code: Any) -> Any:
    """Return an empty array; the unpickler then sets its contents."""
    return np.ndarray((0,), dtype=np.int8)


def _from_buffer(buffer: Any, kind: Any, shape: Any, order: Any, *rest: Any) -> Any:
    return np.frombuffer(buffer, dtype=kind).reshape(shape, order=order)


def _scalar(kind: Any, data: Any = b"") -> Any:
    return np.frombuffer(data, dtype=kind)[0] if isinstance(data, bytes) else data


def _joined(*parts: Any) -> str:
    return "/".join(str(part) for part in parts)


def _encoded(text: Any, code: Any = "latin1") -> bytes:
    return str(text).encode("latin1")


#: Names that a pickle may refer to, and the objects that replace them.
BUILT: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): _Array, ("numpy", "dtype"): np.dtype, ("_codecs", "encode"): _encoded, ("collections", "OrderedDict"): dict,
    **{(f"numpy.{core}.{module}", name): made for core in ("core", "_core") for module, name, made in (
        ("multiarray", "_reconstruct", _rebuilt), ("multiarray", "scalar", _scalar), ("numeric", "_frombuffer", _from_buffer))},
    **{(module, name): _joined for module in ("pathlib", "pathlib._local") for name in ("Path", "PosixPath", "WindowsPath", "PurePosixPath", "PureWindowsPath")},
}  # fmt: skip


class _Builder(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in BUILT:
            raise pickle.UnpicklingError(f"it names {module}.{name}")
        return BUILT[module, name]


def read_objects(path: Path) -> Any:
    """Return the contents of a .npy file of Python objects: dictionaries and lists of arrays, numbers and text.

    Raises
    ------
    InvalidInput
        A damaged file, or objects of another kind, which could run anything.
    """
    try:
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            head = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            head(file)
            held = _Builder(file).load()
    except (pickle.UnpicklingError, ImportError, *DAMAGE_OF_PACKED) as error:
        raise InvalidInput(
            f"{path}: cannot be read ({str(error)[:80]}): it is damaged, or holds Python objects other than arrays, numbers and words, which are never "
            "run. Save what it holds as plain numbers with np.save."
        ) from error
    return held.item() if isinstance(held, np.ndarray) and held.size == 1 else held
