"""Write pieces of a growing Zarr store from the process that computed them."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.recordings.checked import block_crc
from palpate.recordings.damage import DAMAGE
from palpate.recordings.labelled import missing_value
from palpate.recordings.stores import zarr_library
from palpate.recordings.touchstream import Piece, Written, along_time

__all__ = ["MARKER", "Place"]

#: File beside a growing store; a process that can read it is on the same disk.
MARKER = "here"


@dataclass(frozen=True)
class Place:
    """A growing store, for use in another process.

    Attributes
    ----------
    path : str
        The store.
    word : str
        The content of the file ``here`` beside it.
    long : mapping
        Variables along time: shape of a frame, kind of numbers.
    methods : tuple of str
        Methods of the run so far.
    """

    path: str
    word: str
    long: Mapping[str, tuple[tuple[int, ...], str]]
    methods: tuple[str, ...]

    def write(self, start: int, piece: Piece) -> Written | None:
        """Write the frames from index ``start`` on, each block whole or not at all.

        None if this process cannot write: another disk, no space, or a variable that the store does not have yet.
        """
        try:
            if (Path(self.path).parent / MARKER).read_text(encoding="utf-8") != self.word:
                return None
            names = piece.attrs.get("methods")
            if names is not None or piece.attrs["method"] not in self.methods:
                return None  # rare: the first process learns the others' findings
            found = along_time(piece, self.methods, coded="found_by" in self.long)
            for name, variable in found.items():
                if name not in self.long or self.long[name][0] != variable.shape[1:]:
                    return None
            arrays = _opened(self.path, self.word, tuple(sorted(self.long)))
            crcs = {}
            for name, (shape, kind) in self.long.items():
                if name in found:
                    values = np.asarray(found[name].values, dtype=kind)
                else:
                    values = np.full((piece.frames, *shape), missing_value(name), dtype=kind)
                arrays[name][start : start + piece.frames] = values
                crcs[name] = block_crc(values)
        except (OSError, *DAMAGE):
            return None
        fixed = tuple(str(n) for n, v in piece.dataset.variables.items() if "time" not in v.dims)
        return Written(piece.frames, piece.attrs, piece.outcome, piece.calibration, crcs, fixed)


@functools.lru_cache(maxsize=2)
def _opened(path: str, word: str, names: tuple[str, ...]) -> Any:
    """The arrays of a store; ``word`` identifies the run."""
    zarr = zarr_library()
    with zarr.config.set({"array.write_empty_chunks": True}):  # the store does not state it
        root = zarr.open_group(path, mode="r+", zarr_format=3)
        return {name: root[name] for name in names}
