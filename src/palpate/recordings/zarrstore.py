"""Recordings and results as Zarr stores (folders)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings import stores
from palpate.recordings.checked import CHECKSUM, affordable, checksum, recording_checksum
from palpate.recordings.damage import DAMAGE
from palpate.recordings.formats import Format
from palpate.recordings.labelled import touch_dataset
from palpate.recordings.mapping import TopicMapping
from palpate.recordings.opened import OpenRecording
from palpate.recordings.recording import Recording
from palpate.recordings.stored import confirmed_touch, opened_recording, stored_recording, touch_group

if TYPE_CHECKING:
    from palpate.recordings.sinks import Recorder
    from palpate.recordings.touchstream import TouchStream
    from palpate.touch import Touch

__all__ = ["Zarr"]


class Zarr(Format):
    """Zarr 3 stores. A CRC-32 protects each block of a stream, and another one a finished store."""

    name = "zarr"
    libraries = ("zarr",)
    extensions = (".zarr",)
    folder = True

    def recognises(self, path: Path) -> bool:
        return (path / "zarr.json").is_file()

    def read(self, path: Path, *, mapping: TopicMapping | None = None, salvage: bool = False) -> Recording:
        zarr = stores.zarr_library()
        with _readable(path):
            root = zarr.open_group(str(path), mode="r", zarr_format=3)
            _check_held(root, path)
            return stored_recording(root, root.attrs["channel"], path, salvage=salvage)

    @contextmanager
    def opened(self, path: Path, *, mapping: TopicMapping | None = None) -> Iterator[OpenRecording]:
        zarr = stores.zarr_library()
        with _readable(path):
            root = zarr.open_group(str(path), mode="r", zarr_format=3)
            _check_held(root, path)
            recording = opened_recording(root, root.attrs["channel"], path, _readable)
        yield recording

    def write(self, recording: Recording, path: Path) -> None:
        with stores.ZarrRecorder(path, recording.channels, positions=recording.positions, meta=recording.meta) as out:
            for time, values in zip(recording.time, recording.readings):
                out.readings(float(time), values)
        stores.zarr_library().open_group(str(path), mode="r+").attrs[CHECKSUM] = recording_checksum(recording)

    def read_touch(self, path: Path) -> Any:
        import xarray

        zarr = stores.zarr_library()
        try:
            root = zarr.open_group(str(path), mode="r", zarr_format=3)
            name = touch_group(root)
            _guard(root[name] if name else root, path)
            found = xarray.open_zarr(path, group=name, chunks=None, consolidated=False, decode_times=False).load()
            if "component" in found.attrs:
                found = found.assign_coords(component=list(map(str, found.attrs.pop("component"))))
            return confirmed_touch(found, path)
        except InvalidInput:
            raise
        except DAMAGE as error:
            raise InvalidInput(
                f"{path}: holds no touches that can be read; it is damaged, still being written, or of another format."
            ) from error

    def write_touch(self, touch: Touch, path: Path, record: Mapping[str, str]) -> None:
        stores.zarr_library()
        dataset = touch_dataset(touch, record)
        dataset.attrs[CHECKSUM] = checksum(dataset)
        # Zarr 3 has no stable form of text.
        dataset.attrs["component"] = [str(c) for c in dataset["component"].values]
        # A missing block means damage, so blocks of zeros are written too.
        dataset.drop_vars("component").to_zarr(path, zarr_format=3, consolidated=False, write_empty_chunks=True)

    @contextmanager
    def touch_stream(
        self,
        path: Path,
        count: int,
        record: Mapping[str, str],
        *,
        run: Mapping[str, Any] | None = None,
        resume: bool = False,
        replace: bool = False,
    ) -> Iterator[TouchStream]:
        from palpate.recordings.zarrstream import growing

        stores.zarr_library()
        with growing(path, count, record, run or {}, resume=resume, replace=replace) as stream:
            yield stream

    def recorder(
        self, path: Path, channels: Sequence[str], *, positions: Any, meta: Mapping[str, Any] | None
    ) -> Recorder:
        return stores.ZarrRecorder(path, channels, positions=positions, meta=meta)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Context that converts exceptions of the library to messages about the store."""
    try:
        yield
    except InvalidInput:
        raise
    except DAMAGE as error:
        raise InvalidInput(f"{path}: cannot be read as a Zarr store; it is damaged or something else.") from error


def _check_held(root: Any, path: Path) -> None:
    """Raise an error for a store without a recording, or with an impossible size."""
    missing = [n for n in ("readings", "time") if n not in root] + [n for n in ("channel",) if n not in root.attrs]
    if missing:
        raise InvalidInput(f"{path}: not a palpate recording: it lacks {', '.join(missing)}.")
    _guard(root, path)


def _guard(group: Any, path: Path) -> None:
    """Refuse arrays that claim more than is stored: more blocks than files, or blocks that no codec compresses so."""
    for name, array in group.arrays():
        place = f"{path}, {name}"
        held = [
            p.stat().st_size for p in (path / group.path / name).rglob("*") if p.is_file() and p.name != "zarr.json"
        ]
        block = array.dtype.itemsize * float(np.prod(array.chunks, dtype=np.float64))
        # Zstandard compresses a constant block to a dozen bytes, so only check that each block exists.
        blocks = float(np.prod([-(-s // max(1, c)) for s, c in zip(array.shape, array.chunks)], dtype=np.float64))
        affordable(int(min(block, 2.0**62)), sum(held), place, shrink=20_000)
        if blocks > len(held):
            raise InvalidInput(
                f"{place}: {blocks:.6g} blocks are claimed, but {len(held)} are there; the store is damaged."
            )
