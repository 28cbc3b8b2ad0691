"""Find the frames in files that hold displacement fields of several frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate._files import ordinary
from palpate.errors import InvalidInput
from palpate.microscopy.found import list_names
from palpate.microscopy.matfile import fields_of
from palpate.microscopy.names import VECTORS
from palpate.microscopy.pivtext import frames_of_text

__all__ = ["frames_of_field"]

TEXT = (".txt", ".dat", ".csv", ".tsv")
MATLAB = (".mat", ".h5", ".hdf5")


def frames_of_field(path: str | Path, name: str | None = None) -> list[str | None]:
    """Return, for each frame of a file in order, the ``name`` to pass to `read_field`; [None] for a file of one field.

    Files with several frames are tables with a column ``frame``, .mat files of PIVlab and others that store u and v as
    cells, and arrays (frame, 2, row, column). Of PIVlab's fields the filtered ones are used, unless ``name`` selects
    others (``u_original, v_original``).

    Raises
    ------
    InvalidInput
        A file that is not there or damaged, or that holds several fields that are no frames of one film.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from palpate.microscopy import frames_of_field
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.save(f"{folder}/film.npy", np.zeros((3, 2, 20, 30)))
    ...     frames_of_field(f"{folder}/film.npy")
    ['0', '1', '2']
    """
    found = ordinary(path)
    ending = found.suffix.lower()
    if ending == ".npy":
        try:
            shape = np.load(found, mmap_mode="r", allow_pickle=False).shape
        except (ValueError, OSError, EOFError):
            return [None]  # the reader reports the error
        return [str(k) for k in range(shape[0])] if len(shape) == 4 else [None]
    if ending in TEXT:
        return list(frames_of_text(found)) or [None]
    if ending not in MATLAB:
        return [None]
    names = list(fields_of(found))
    if len(names) == 1:
        return [name]
    groups: dict[str, list[str]] = {}
    for key in names:
        groups.setdefault(key.rpartition("(")[0] if key.endswith(")") else key, []).append(key)
    if name is not None and name not in groups:
        raise InvalidInput(f"{found}: no field {name!r}; it holds {list_names(groups)}.")
    if name is None and len(groups) > 1:
        known = [group for group in groups for pair in VECTORS if group == f"{pair[0]}, {pair[1]}"]
        order = [f"{a}, {b}" for a, b in VECTORS]
        if len(known) < len(groups):
            raise InvalidInput(
                f"{found}: holds several films: {list_names(groups)}. Say which with name={next(iter(groups))!r} (--name)."
            )
        name = min(known, key=order.index)
    return list(groups[name if name is not None else next(iter(groups))])
