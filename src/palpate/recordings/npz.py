"""Recordings and results as NumPy archives (.npz)."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.arraytables import array_table
from palpate.recordings.checked import CHECKSUM, affordable, confirm_recording, json_object, recording_checksum
from palpate.recordings.clock import Clock, stored_clock
from palpate.recordings.columns import TableMapping
from palpate.recordings.damage import DAMAGE_OF_PACKED
from palpate.recordings.formats import Format
from palpate.recordings.labelled import touch_dataset
from palpate.recordings.mapped import read_mapped
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.meta import plain_meta
from palpate.recordings.recording import Recording
from palpate.recordings.tabletext import Table, Titles
from palpate.status import Status

if TYPE_CHECKING:
    from palpate.touch import Touch

__all__ = ["Npz"]

#: Keys of a recording of this library.
REQUIRED_KEYS = ("readings", "channel", "time")


class Npz(Format):
    """NumPy archives: the zip's own CRC-32 protects each array, another one the whole.

    A recording has the keys ``readings`` (frame, channel, taxel) or (frame, channel, y, x) in SI units, ``channel``
    (names) and ``time`` (frame) in seconds; optionally ``positions`` (taxel, 2) in metres, ``meta`` (JSON) and
    ``palpate_crc32``. Archives with other keys are tables of another program: each array with one line per frame is a
    column, or as many as a line has numbers.
    """

    name = "npz"
    extensions = (".npz",)

    def recognises(self, path: Path) -> bool:
        with path.open("rb") as file:
            return file.read(4) == b"PK\x03\x04"

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        held = _whole(path)
        missing = [n for n in REQUIRED_KEYS if n not in held]
        if missing:
            shapes = ", ".join(f"{n} {a.shape}" for n, a in held.items())
            raise InvalidInput(
                f"{path}: not a palpate recording: it lacks {', '.join(missing)} (it holds {shapes or 'nothing'}). Save readings (frame, channel, taxel or y, x) in SI units, channel and time, "
                "or say what its arrays are with --map (a TableMapping)."
            )
        meta = json_object(str(held["meta"]), f"{path}: meta") if "meta" in held else {}
        clock = Clock(held["time"]) if CHECKSUM in held else stored_clock(held["time"], None, str(path))
        clock.tell()
        found = Recording(
            readings=held["readings"],
            channels=tuple(str(c) for c in np.atleast_1d(held["channel"])),
            time=clock.time,
            positions=held.get("positions"),
            meta={**meta, **clock.meta()},
        )
        return confirm_recording(found, held.get(CHECKSUM), path)

    def own(self, path: Path) -> bool:
        try:
            with zipfile.ZipFile(path) as archive:
                return {f"{n}.npy" for n in REQUIRED_KEYS} <= set(archive.namelist())
        except DAMAGE_OF_PACKED:
            return False  # the reader reports it

    def columns(self, path: Path, wanted: Callable[[Titles], Sequence[int]]) -> Table:
        held = _whole(path)
        frames = max((len(a) for a in held.values() if a.ndim), default=0)
        columns = {n: a for n, a in held.items() if a.ndim and len(a) == frames and a.size}
        if not columns:
            raise InvalidInput(f"{path}: no array has a line per frame; it holds {', '.join(held) or 'nothing'}.")
        return array_table(path, columns, wanted)

    def read_mapped(self, path: Path, mapping: TableMapping) -> Recording:
        return self.read(path) if self.own(path) else read_mapped(path, mapping, read=self.columns)

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
        dataset = touch_dataset(touch)
        arrays: dict[str, Any] = {str(name): variable.values for name, variable in dataset.variables.items()}
        arrays["record"] = np.array(
            json.dumps({**plain_meta(record, "provenance"), "sought": ",".join(touch.components)})
        )
        if touch.status is not None:
            labels = [Status.coded(int(code)).label for code in np.ravel(touch.status)]
            arrays["status_label"] = np.reshape(labels, np.shape(touch.status))
        if touch.found_by is not None:
            arrays["methods"] = np.array(json.loads(dataset.attrs["methods"]))
        if touch.view is not None:
            arrays["view"] = np.array(json.dumps(touch.view.described()))
        with path.open("wb") as file:
            np.savez_compressed(file, **arrays)


def _whole(path: Path) -> dict[str, Any]:
    """The arrays of an archive, or `InvalidInput`."""
    try:
        return _arrays(path)
    except InvalidInput:
        raise
    except DAMAGE_OF_PACKED as error:
        raise InvalidInput(
            f"{path}: cannot be read as NPZ; the file is truncated, damaged or of another format."
        ) from error


def _arrays(path: Path) -> dict[str, Any]:
    """The arrays of an archive; each header is read before its numbers, to avoid allocating memory for missing data."""
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            affordable(info.file_size, info.compress_size, path)
            with archive.open(info) as member:
                version = np.lib.format.read_magic(member)
                header = (
                    np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                )
                shape, _, dtype = header(member)
                if dtype.hasobject:
                    raise InvalidInput(
                        f"{path}: {info.filename.removesuffix('.npy')} holds Python objects, which can run any program when they are read, and is not read. "
                        "Save arrays of numbers, numpy.asarray(values, dtype=float)."
                    )
                count = 1
                for size in shape:
                    count *= int(size)
                if min(shape, default=0) < 0 or member.tell() + count * dtype.itemsize != info.file_size:
                    raise InvalidInput(
                        f"{path}: the header of {info.filename} claims {count:.3g} numbers, but {info.file_size} bytes are there; it is damaged."
                    )
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
