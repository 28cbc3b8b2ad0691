"""Recordings and results as NetCDF 4, which is HDF5 (.nc, .h5, .hdf5)."""

from __future__ import annotations

import io
import mmap
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.checked import CHECKSUM, affordable, checksum
from palpate.recordings.damage import DAMAGE
from palpate.recordings.formats import Format
from palpate.recordings.heldfile import write_netcdf
from palpate.recordings.labelled import recording_dataset, text, touch_dataset
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.opened import OpenRecording
from palpate.recordings.recording import Recording
from palpate.recordings.stored import confirmed_touch, opened_recording, stored_recording, touch_group

if TYPE_CHECKING:
    import xarray

    from palpate.recordings.sinks import Recorder
    from palpate.recordings.touchstream import TouchStream
    from palpate.touch import Touch

__all__ = ["NetCDF", "damage", "guard", "opened"]

_SIGNATURE = b"\x89HDF\r\n\x1a\n"
#: Beginning of a global heap: its signature, version 1 and three zeros.
_HEAP = b"GCOL\x01\0\0\0"


def damage(path: Path, error: Exception) -> InvalidInput:
    """The message for a file that the library cannot read."""
    reason = str(error).strip("'\". ")[:120]
    return InvalidInput(
        f"{path}: cannot be read as NetCDF/HDF5; it is still being written, truncated, damaged or of another format ({reason}). "
        "palpate convert --salvage takes what a recording that was broken off holds."
    )


class NetCDF(Format):
    """NetCDF 4. Checksums reveal damage: that of HDF5 (Fletcher-32) in each block of numbers, and a CRC-32 over all names, dimensions, values and attributes."""

    name = "netcdf"
    libraries = ("h5py", "h5netcdf")
    extensions = (".nc", ".h5", ".hdf5")

    def recognises(self, path: Path) -> bool:
        with path.open("rb") as file:
            size, at = path.stat().st_size, 0
            while at < size:  # HDF5 may begin with a block of the user's
                file.seek(at)
                if file.read(8) == _SIGNATURE:
                    return True
                at = 2 * at or 512
        return False

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        with _readable(path), opened(path, salvage=salvage) as file:
            _check_held(file, path)
            return stored_recording(file, file["channel"][()], path, salvage=salvage)

    @contextmanager
    def opened(self, path: Path, *, mapping: TopicMapping | None = None) -> Iterator[OpenRecording]:
        with ExitStack() as stack:
            with _readable(path):
                file = stack.enter_context(opened(path))
                _check_held(file, path)
                recording = opened_recording(file, file["channel"][()], path, _readable)
            yield recording

    def write(self, recording: Recording, path: Path) -> None:
        write_dataset(recording_dataset(recording), path)

    def read_touch(self, path: Path) -> Any:
        import xarray

        try:
            with opened(path) as file:
                name = touch_group(file)
                guard(file[name] if name else file, path)
            found = xarray.load_dataset(path, engine="h5netcdf", group=name, decode_times=False)
            return confirmed_touch(found, path)
        except InvalidInput:
            raise
        except DAMAGE as error:
            raise InvalidInput(
                f"{path}: holds no touches that can be read; it is truncated, damaged, still being written, or of another format."
            ) from error

    def write_touch(self, touch: Touch, path: Path, record: Mapping[str, str]) -> None:
        write_dataset(touch_dataset(touch, record), path)

    def _touches(self, path: Path, count: int, record: Mapping[str, str]) -> TouchStream:
        from palpate.recordings.netcdfstream import NetCDFStream

        return NetCDFStream(path, count, record)

    def recorder(
        self, path: Path, channels: Sequence[str], *, positions: Any, meta: Mapping[str, Any] | None
    ) -> Recorder:
        from palpate.recordings.stores import HdfRecorder

        return HdfRecorder(path, channels, positions=positions, meta=meta)


def write_dataset(dataset: xarray.Dataset, path: Path) -> None:
    """Write a dataset, compressed and with checksums."""
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        if variable.ndim and variable.dtype.kind in "fiub" and variable.size:
            chunks = variable.shape
            if variable.ndim > 1:  # blocks of whole frames, about a megabyte each
                frames = max(1, (1 << 20) // max(1, variable[:1].nbytes))
                chunks = (min(frames, variable.shape[0]), *variable.shape[1:])
            encoding[str(name)] = {"fletcher32": True, "chunksizes": chunks}
            if variable.ndim > 1:
                encoding[str(name)] |= {"compression": "gzip"}
    dataset = dataset.assign_attrs({CHECKSUM: checksum(dataset)})
    write_netcdf(dataset, path, encoding)


def data_sets(group: Any) -> dict[str, Any]:
    """Every data set of a file or group by its name, those in groups as "group/name"."""
    import h5py

    found: dict[str, Any] = {}

    def visit(name: Any, held: Any) -> None:
        if isinstance(held, h5py.Dataset):
            found[text(name)] = held

    group.visititems(visit)
    return found


def guard(group: Any, path: Path) -> None:
    """Raise an error for data sets that claim more than the file can contain, before anything is allocated."""
    stored = os.path.getsize(path)
    for name, held in data_sets(group).items():
        if held.shape is not None:
            claimed = held.dtype.itemsize
            for size in held.shape:
                claimed *= int(size)
            affordable(claimed, stored, f"{path}, {name}")
            affordable(
                int(np.prod(held.chunks or (0,), dtype=np.float64)) * held.dtype.itemsize,
                stored,
                f"{path}, {name}",
            )


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Context that converts exceptions of the library to messages about the file."""
    try:
        yield
    except InvalidInput:
        raise
    except DAMAGE as error:
        raise damage(path, error) from error


def _check_held(file: Any, path: Path) -> None:
    """Raise an error for a file without a recording, or with an impossible size."""
    missing = [n for n in ("readings", "channel", "time") if n not in file]
    if missing:
        held = ", ".join(map(text, file)) or "nothing"
        raise InvalidInput(f"{path}: not a palpate recording: it lacks {', '.join(missing)} (it holds {held}).")
    guard(file, path)


@contextmanager
def opened(path: Path, *, salvage: bool = False) -> Iterator[Any]:
    """Open an HDF5 file; ``salvage``: also one that was open when its recorder was killed."""
    import h5py

    _guard_heaps(path)
    if not salvage:
        with h5py.File(path, "r") as file:
            yield file
        return
    with path.open("rb") as raw, h5py.File(_Closed(raw), "r") as file:
        yield file


def _guard_heaps(path: Path) -> None:
    """Raise an error for text heaps with inconsistent parts, in which the library would loop forever."""
    with path.open("rb") as raw, mmap.mmap(raw.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start = data.find(_HEAP)
        while start >= 0:
            size = int.from_bytes(data[start + 8 : start + 16], "little")
            at, end = start + 16, start + size
            if not 16 <= size <= len(data) - start:
                raise OSError("a heap of text is longer than the file")
            while at + 16 <= end:
                index, length = (
                    int.from_bytes(data[at : at + 2], "little"),
                    int.from_bytes(data[at + 8 : at + 16], "little"),
                )
                # The last part, number 0, is the free space, including its own header.
                step = length if index == 0 else 16 + -(-length // 8) * 8
                if step < 16 or step > end - at:
                    raise OSError("a heap of text is damaged")
                at += step
            start = data.find(_HEAP, start + 8)


class _Closed(io.RawIOBase):
    """A file that its writer left open, presented as closed: the first bytes (the superblock) are corrected while they
    are read.

    The library's own way to read such a file (SWMR) waits for the dead writer: one damaged byte took minutes.
    """

    def __init__(self, raw: Any) -> None:
        self._raw = raw
        size = raw.seek(0, os.SEEK_END)
        raw.seek(0)
        head = bytearray(raw.read(48))
        # superblock version 3: flags at 11, end of file at 28 to 36, its checksum at 44 to 48
        if len(head) == 48 and head[:9] == _SIGNATURE + b"\x03" and head[9:11] == b"\x08\x08":
            if _lookup3(bytes(head[:44])) != int.from_bytes(head[44:], "little"):
                raise OSError("the superblock is damaged")
            head[11] = 0
            head[28:36] = size.to_bytes(8, "little")
            head[44:] = _lookup3(bytes(head[:44])).to_bytes(4, "little")
        self._head, self._at = bytes(head), 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._at = self._raw.seek(offset, whence)
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any) -> int:
        self._raw.seek(self._at)
        data = self._raw.read(len(buffer))
        if self._at < len(self._head):
            patch = self._head[self._at : self._at + len(data)]
            data = patch + data[len(patch) :]
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)


def _lookup3(data: bytes) -> int:
    """Bob Jenkins' hash at the end of HDF5's headers (hashlittle of lookup3.c, public domain)."""
    mask = 0xFFFFFFFF

    def rotated(x: int, k: int) -> int:
        return ((x << k) | (x >> (32 - k))) & mask

    a = b = c = (0xDEADBEEF + len(data)) & mask
    parts = [int.from_bytes(data[i : i + 4], "little") for i in range(0, len(data), 4)]
    while len(parts) > 3:
        a, b, c = (a + parts[0]) & mask, (b + parts[1]) & mask, (c + parts[2]) & mask
        del parts[:3]
        a = (a - c) & mask ^ rotated(c, 4)
        c = (c + b) & mask
        b = (b - a) & mask ^ rotated(a, 6)
        a = (a + c) & mask
        c = (c - b) & mask ^ rotated(b, 8)
        b = (b + a) & mask
        a = (a - c) & mask ^ rotated(c, 16)
        c = (c + b) & mask
        b = (b - a) & mask ^ rotated(a, 19)
        a = (a + c) & mask
        c = (c - b) & mask ^ rotated(b, 4)
        b = (b + a) & mask
    parts += [0] * (3 - len(parts))
    a, b, c = (a + parts[0]) & mask, (b + parts[1]) & mask, (c + parts[2]) & mask
    for x, y, k in (
        ("c", "b", 14),
        ("a", "c", 11),
        ("b", "a", 25),
        ("c", "b", 16),
        ("a", "c", 4),
        ("b", "a", 14),
        ("c", "b", 24),
    ):
        held = {"a": a, "b": b, "c": c}
        held[x] = ((held[x] ^ held[y]) - rotated(held[y], k)) & mask
        a, b, c = held["a"], held["b"], held["c"]
    return c
