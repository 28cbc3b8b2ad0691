"""Recordings and touches as named arrays with attributes, for HDF5 files and Zarr stores."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.checked import CHECKSUM, confirm, confirm_recording, json_object, with_losses
from palpate.recordings.clock import stored_clock
from palpate.recordings.labelled import text
from palpate.recordings.opened import OpenRecording
from palpate.recordings.recording import Recording, checked_time

__all__ = ["confirmed_touch", "opened_recording", "stored_recording", "touch_group"]


def stored_recording(held: Any, channels: Iterable[Any], path: Path, *, salvage: bool) -> Recording:
    """The recording in a file or group with arrays "readings", "time" and optionally "positions", and attributes.

    Incomplete blocks are dropped: readings without times, and with ``salvage`` those with fill values.
    """
    counts = held["readings"].shape[0], held["time"].shape[0]
    count = min(counts)
    if salvage:
        whole = np.isfinite(held["time"][:count])
        count = int(np.argmin(whole)) if not whole.all() else count
    time, told = _times(held, count, path)
    meta = json_object(text(held.attrs.get("meta", "{}")), f"{path}: meta")
    recording = Recording(
        readings=held["readings"][:count],
        channels=tuple(text(c) for c in channels),
        time=time,
        positions=held["positions"][...] if "positions" in held else None,
        meta={**meta, **told},
    )
    expected = held.attrs.get(CHECKSUM)
    if not salvage:
        return confirm_recording(recording, expected, path)
    lost = max(counts) - count
    known = (
        f"{lost} of {max(counts)} frames that it has room for were not written whole"
        if lost
        else "every frame is whole"
    )
    return with_losses(recording, expected, path, known)


def _times(held: Any, count: int, path: Path) -> tuple[Any, dict[str, str]]:
    """Times of the first ``count`` frames, and a note on repairs. If the file has a checksum, they need no repair."""
    values = np.asarray(held["time"][:count])
    if held.attrs.get(CHECKSUM) is not None or not np.isfinite(values).all():
        return values, {}
    clock = stored_clock(values, held["time"].attrs.get("units"), str(path))
    clock.tell()
    return clock.time, clock.meta()


class _Guarded:
    """Readings in a file; exceptions while reading name the file."""

    def __init__(self, readings: Any, path: Path, readable: Callable[[Path], AbstractContextManager[None]]) -> None:
        self._readings, self._path, self._readable = readings, path, readable

    def __getitem__(self, frames: slice) -> Any:
        with self._readable(self._path):
            return self._readings[frames]


def opened_recording(
    held: Any, channels: Iterable[Any], path: Path, readable: Callable[[Path], AbstractContextManager[None]]
) -> OpenRecording:
    """The same, read piece by piece while the file stays open; ``readable`` converts exceptions of the library."""
    count = min(held["readings"].shape[0], held["time"].shape[0])
    meta = json_object(text(held.attrs.get("meta", "{}")), f"{path}: meta")
    found, told = _times(held, count, path)
    time = checked_time(found, count)
    head = Recording(
        readings=held["readings"][: min(1, count)],
        channels=tuple(text(c) for c in channels),
        time=time[:1],
        positions=held["positions"][...] if "positions" in held else None,
        meta={**meta, **told},
    )
    return OpenRecording(head, time, _Guarded(held["readings"], path, readable), held.attrs.get(CHECKSUM), str(path))


def touch_group(held: Any) -> str | None:
    """The file group that stores touches: None for the root of the file, or a group beside the readings."""
    return "touch" if "traction" not in held and "touch" in held else None


def confirmed_touch(found: Any, path: Path) -> Any:
    """A dataset of touches, after its checksum was verified; an error if there are none."""
    if "traction" not in found:
        raise InvalidInput(f"{path}: holds no touches (it holds {', '.join(map(str, found.variables)) or 'nothing'}).")
    confirm(found, found.attrs.pop(CHECKSUM, None), path)
    return found
