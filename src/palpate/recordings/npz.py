"""Recordings and results as NumPy archives (.npz)."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.errors import InvalidInput
from palpate.recordings.checked import CHECKSUM, affordable, confirm_recording, json_object, recording_checksum
from palpate.recordings.formats import Format
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.meta import plain_meta
from palpate.recordings.recording import Recording

if TYPE_CHECKING:
    from palpate.touch import Touch

__all__ = ["Npz"]

#: What a damaged archive raises in zipfile, zlib and NumPy.
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    OSError,
    KeyError,
    ValueError,
    TypeError,
    SyntaxError,
    OverflowError,
    NotImplementedError,
    RuntimeError,
    MemoryError,
)


class Npz(Format):
    """NumPy archives: the zip's own CRC-32 guards each array, one of ours guards the whole."""

    name = "npz"
    extensions = (".npz",)

    def recognises(self, path: Path) -> bool:
        with path.open("rb") as file:
            return file.read(4) == b"PK\x03\x04"

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        try:
            held = _arrays(path)
        except InvalidInput:
            raise
        except _DAMAGE as error:
            raise InvalidInput(
                f"{path}: cannot be read as NPZ; the file is truncated, damaged or of another format."
            ) from error
        missing = [n for n in ("readings", "channel", "time") if n not in held]
        if missing:
            raise InvalidInput(
                f"{path}: not a palpate recording: it lacks {', '.join(missing)} (it holds {', '.join(held) or 'nothing'})."
            )
        meta = json_object(str(held["meta"]), f"{path}: meta") if "meta" in held else {}
        found = Recording(
            readings=held["readings"],
            channels=tuple(str(c) for c in np.atleast_1d(held["channel"])),
            time=held["time"],
            positions=held.get("positions"),
            meta=meta,
        )
        return confirm_recording(found, held.get(CHECKSUM), path)

    def write(self, recording: Recording, path: Path) -> None:
        arrays: dict[str, Any] = {
            "readings": recording.readings,
            "time": recording.time,
            "channel": np.array(recording.channels),
            "unit": np.array(recording.units),
            "meta": np.array(json.dumps(recording.meta)),
            CHECKSUM: np.array(recording_checksum(recording)),
        }
        if recording.positions is not None:
            arrays["positions"] = recording.positions
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)

    def write_touch(self, touch: Touch, path: Path, record: Mapping[str, str]) -> None:
        arrays: dict[str, Any] = {
            "traction": to_numpy(touch.values),
            "component": np.array(touch.surface.components),
            "force": to_numpy(touch.force),
            "record": np.array(json.dumps({**plain_meta(record, "provenance"), "sought": ",".join(touch.components)})),
        }
        if touch.errors is not None:
            arrays["std"] = to_numpy(touch.std.values)
        arrays.update(zip(("x",) if touch.surface.dimensions == 1 else ("y", "x"), touch.surface.axes))
        if touch.time is not None:
            arrays["time"] = touch.time
        if touch.view is not None:
            arrays["view"] = np.array(json.dumps(touch.view.described()))
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)


def _arrays(path: Path) -> dict[str, Any]:
    """The arrays of an archive; each header is read before its numbers, so that nothing is allocated that is not there."""
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            affordable(info.file_size, info.compress_size, path)
            with archive.open(info) as member:
                version = np.lib.format.read_magic(member)
                header = (
                    np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                )
                shape, _, dtype = header(member)
                count = 1
                for size in shape:
                    count *= int(size)
                if min(shape, default=0) < 0 or member.tell() + count * dtype.itemsize != info.file_size:
                    raise InvalidInput(
                        f"{path}: the header of {info.filename} claims {count:.3g} numbers, but {info.file_size} bytes are there; it is damaged."
                    )
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
