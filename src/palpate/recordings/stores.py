"""Recorders for HDF5/NetCDF and Zarr, which write while the stream runs, in blocks of frames.

Both store the arrays of a whole recording (``readings``, ``time``, ``channel``, ``unit``, ``positions``), a group
``touch`` (``traction``, ``std``, ``force`` with its interval, ``touching``) and a group ``events``; xarray opens each
of the three. A killed process loses the current block.
"""

from __future__ import annotations

import abc
import contextlib
import json
import shutil
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._extras import missing
from palpate.elastic.channels import channel_unit
from palpate.errors import InvalidInput
from palpate.recordings.frame import frame_values
from palpate.recordings.heldfile import Apart, HeldFile
from palpate.recordings.labelled import CONVENTIONS, STATUS_FLAGS
from palpate.recordings.locks import claim
from palpate.recordings.meta import plain_meta
from palpate.sensing.times import as_second
from palpate.status import Status
from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event

__all__ = ["HdfRecorder", "ZarrRecorder", "zarr_library"]

#: Frames in a block: the largest loss if the process is killed.
BLOCK = 32
EVENT_KINDS = ("contact", "incipient slip", "slip", "excess pressure", "excess force", "pull", "unexplained")
_EVENTS = {
    "time": ("s", "when"),
    "kind": ("1", "what began or ended"),
    "began": ("1", "1 it began, 0 it ended"),
    "probability": ("1", "how sure it is"),
    "value": ("1", "of what is watched: part of the friction limit, Pa, N"),
    "limit": ("1", "at which it is announced"),
}


class _Variable:
    """One array of a group: its dimensions (time first, if it grows) and its type."""

    def __init__(self, dims: tuple[str, ...], dtype: Any, attrs: Mapping[str, Any], data: Any = None) -> None:
        self.dims, self.dtype, self.attrs, self.data = dims, np.dtype(dtype), dict(attrs), data
        #: Fill value of unwritten places. Readers treat it as missing, so no flag may equal it.
        self.empty = {"f": np.nan, "i": np.iinfo(np.int8).min}.get(self.dtype.kind, 0)


class _Recorder(abc.ABC):
    """Collects frames into blocks; subclasses create groups and append blocks in their format."""

    def __init__(
        self,
        path: str | Path,
        channels: Sequence[str],
        *,
        positions: Any = None,
        meta: Mapping[str, Any] | None = None,
        block: int = BLOCK,
    ) -> None:
        self.path, self.channels = Path(path), tuple(channels)
        self._positions = None if positions is None else np.asarray(positions, dtype=np.float64)
        self._meta, self._block = plain_meta(meta), block
        self._rows: dict[str, list[dict[str, Any]]] = {}
        self._begun: set[str] = set()
        self._kept: dict[str, int] = {}
        self._shape: tuple[int, ...] | None = None
        self._open = True
        if self.path.exists():
            raise InvalidInput(f"{path} exists; a recording is not overwritten. Give another name.")
        if not self.path.parent.is_dir():
            raise InvalidInput(f"{path}: the folder {self.path.parent} does not exist; make it first.")
        # until the recording is closed or forgotten, at the latest until the process ends
        self._release = weakref.finalize(self, claim(self.path))
        self._made = False
        self._apart = Apart()
        try:
            self._guarded(self._create)
            self._guarded(lambda: self._start("events", self._event_layout()))
        except InvalidInput:
            if self._made:
                _removed(self.path)
            self._release()
            raise

    def readings(self, time: float, values: Any) -> None:
        """Write one frame (channel, *array) at ``time`` [s]; reading repairs a clock that jumps back."""
        data = frame_values(values, self.channels).copy()  # kept until the block is full; a driver may reuse its array
        if self._shape not in (None, data.shape):
            raise InvalidInput(f"a frame of shape {data.shape} follows frames of {self._shape}.")
        self._shape = data.shape
        self._put("", {"time": as_second(time), "readings": data}, lambda: self._reading_layout(data))

    def touch(self, touch: Touch, time: float | None = None) -> None:
        """Write the result of one frame."""
        row: dict[str, Any] = {
            "time": as_second(touch.time if time is None else time),
            "traction": to_numpy(touch.values),
            "force": to_numpy(touch.force),
            "touching": int(bool(True if touch.touching is None else touch.touching)),
            "status": int(Status.SOLVED if touch.status is None else touch.status),
        }
        known = touch.has_intervals
        row["std"] = to_numpy(touch.std()) if known else np.full(row["traction"].shape, np.nan)
        row["force_low"], row["force_high"] = (
            touch.interval(0.95, "force") if known else np.full((2, *row["force"].shape), np.nan)
        )
        self._put("touch", row, lambda: self._touch_layout(touch, row))

    def event(self, event: Event) -> None:
        """Write an event of a `GraspMonitor`."""
        row = {k: getattr(event, k) for k in _EVENTS if k != "kind"}
        self._put(
            "events", {**row, "began": int(event.began), "kind": EVENT_KINDS.index(event.kind)}, self._event_layout
        )

    def close(self) -> None:
        """Write the rest and finish the file."""
        if self._open:
            for group in list(self._rows):
                self._guarded(lambda group=group: self._flush(group))  # type: ignore[misc]
            self._guarded(self._finish)
            self._open = False
            self._apart.end()
            self._release()

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- the interface of the formats ------------------------------------------------------------------------------------

    @abc.abstractmethod
    def _create(self) -> None:
        """Create an empty file or store under a new name, or raise `FileExistsError`; sets `_made`."""

    @abc.abstractmethod
    def _start(self, group: str, layout: dict[str, _Variable]) -> None:
        """Create a group and its variables."""

    @abc.abstractmethod
    def _append(self, group: str, block: dict[str, Any]) -> None:
        """Append a block to a group."""

    @abc.abstractmethod
    def _finish(self) -> None:
        """Finish the file."""

    @abc.abstractmethod
    def _abandon(self) -> None:
        """Release everything without writing."""

    # -- layouts --------------------------------------------------------------------------------------------------------

    def _reading_layout(self, data: Any) -> dict[str, _Variable]:
        dims: tuple[str, ...] = ("channel", "taxel") if data.ndim == 2 else ("channel", "y", "x")
        dtype = data.dtype if data.dtype in (np.float32, np.float64) else np.float64
        layout = {
            "time": _Variable(("time",), np.float64, {"units": "s"}),
            "readings": _Variable(("time", *dims), dtype, {"long_name": "sensor readings in SI units"}),
            "channel": _Variable(("channel",), "U32", {}, np.array(self.channels)),
            "unit": _Variable(("channel",), "U8", {}, np.array([channel_unit(c) for c in self.channels])),
        }
        layout["readings"].attrs["shape"] = data.shape
        if self._positions is not None:
            dims = ("taxel",) if self._positions.ndim == 1 else ("taxel", "axis")
            layout["positions"] = _Variable(dims, np.float64, {"units": "m"}, self._positions)
        return layout

    @staticmethod
    def _touch_layout(touch: Touch, row: Mapping[str, Any]) -> dict[str, _Variable]:
        traction = touch.traction
        dims = tuple(str(d) for d in traction.dims if d != "time")
        unit = "N/m" if touch.surface.dimensions == 1 else "N"
        layout = {"time": _Variable(("time",), np.float64, {"units": "s"})}
        for name in dims:
            data = traction[name].values
            layout[name] = _Variable((name,), data.dtype, {} if name == "component" else {"units": "m"}, data)
        for name, value in row.items():
            if name in ("traction", "std"):
                lies = {k: v for k, v in traction.attrs.items() if k == "view"}
                layout[name] = _Variable(("time", *dims), np.float32, {"units": "Pa", "shape": value.shape, **lies})
            elif name.startswith("force"):
                layout[name] = _Variable(("time", "component"), np.float64, {"units": unit, "shape": value.shape})
            elif name == "touching":
                layout[name] = _Variable(("time",), np.int8, {})
            elif name == "status":
                layout[name] = _Variable(("time",), np.int8, dict(STATUS_FLAGS))
        return layout

    @staticmethod
    def _event_layout() -> dict[str, _Variable]:
        layout = {
            name: _Variable(
                ("time",), np.int8 if name in ("kind", "began") else np.float64, {"units": unit, "long_name": text}
            )
            for name, (unit, text) in _EVENTS.items()
        }
        # flags as the CF conventions require
        layout["kind"].attrs["flag_values"] = list(range(len(EVENT_KINDS)))
        layout["kind"].attrs["flag_meanings"] = " ".join(k.replace(" ", "_") for k in EVENT_KINDS)
        return layout

    # -- blocks ---------------------------------------------------------------------------------------------------------

    def _put(self, group: str, row: dict[str, Any], layout: Callable[[], dict[str, _Variable]]) -> None:
        if not self._open:
            raise InvalidInput(f"{self.path}: this recording is closed.")
        self._guarded(lambda: self._take(group, row, layout))

    def _take(self, group: str, row: dict[str, Any], layout: Callable[[], dict[str, _Variable]]) -> None:
        if group not in self._begun and group != "events":
            self._start(group, layout())
            self._begun.add(group)
        rows = self._rows.setdefault(group, [])
        rows.append(row)
        if len(rows) >= self._block:
            self._flush(group)

    def _flush(self, group: str) -> None:
        rows = self._rows.pop(group, [])
        if rows:
            self._append(group, {k: np.stack([np.asarray(row[k]) for row in rows]) for k in rows[0]})
            self._kept[group] = self._kept.get(group, 0) + len(rows)

    def _guarded(self, act: Callable[[], Any]) -> None:
        try:
            self._apart(act)
        except OSError as error:
            # Stop here: another attempt would fail as well, at the latest in close().
            self._open, self._rows = False, {}
            self._apart(self._abandon)
            self._apart.end()
            self._release()
            if isinstance(error, FileExistsError) and not self._made:
                raise InvalidInput(f"{self.path} exists; a recording is not overwritten. Give another name.") from error
            kept = self._kept.get("", self._kept.get("touch", 0))
            what = f"the {kept} frames before are kept and can be read" if kept else "no frame was kept"
            raise InvalidInput(f"{self.path}: writing failed ({error.strerror or error}); {what}.") from error


def _removed(path: Path) -> None:
    """Remove a file or a folder."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


class HdfRecorder(_Recorder):
    """Writes a stream into an HDF5 file (.nc, .h5) that is valid NetCDF, and can be opened at any time.

    The file on the disk is complete after every block, even if the process is killed or the disk is full (`HeldFile`).

    Arguments of `palpate.recordings.recorder`, and ``block``, the number of frames in a block.
    """

    def _create(self) -> None:
        import h5netcdf

        self._opened: list[Any] = []
        self._held = HeldFile(self.path)
        self._made = True
        # an object still open at the end of the process would call back too late
        self._left = weakref.finalize(self, _let_go, self._held, self._opened)
        with h5netcdf.File(self._held, "w") as file:
            file.attrs["meta"] = json.dumps(self._meta)
            file.attrs["Conventions"] = CONVENTIONS
        self._held.commit()

    def _start(self, group: str, layout: dict[str, _Variable]) -> None:
        import h5netcdf
        import h5py

        _shut(self._opened)  # it is NetCDF's for a while
        with h5netcdf.File(self._held, "a") as file:
            place = file.create_group(group) if group else file
            sizes: dict[str, int | None] = {}
            for variable in layout.values():
                shape = variable.attrs.get("shape", np.shape(variable.data))
                grows = variable.data is None
                sizes.update(zip(variable.dims[grows:], shape))
            place.dimensions["time"] = None
            for name, size in sizes.items():
                place.dimensions[name] = size
            for name, variable in layout.items():
                if variable.dtype.kind == "U":
                    data = np.array([str(v) for v in variable.data], dtype=object)
                    place.create_variable(name, variable.dims, data=data, dtype=h5py.string_dtype())
                    continue
                grows = variable.data is None
                options: dict[str, Any] = {}
                if grows:
                    # a missing file raises its own error, and a checksum finds damage
                    chunks = (self._block, *variable.attrs.get("shape", ()))
                    options = {"chunks": chunks, "fillvalue": variable.empty, "fletcher32": True}
                # uncompressed: compression would delay the stream
                made = place.create_variable(name, variable.dims, dtype=variable.dtype, data=variable.data, **options)
                for key, value in variable.attrs.items():
                    if key != "shape":
                        made.attrs[key] = value
        self._held.commit()
        self._opened.append(h5py.File(self._held, "r+"))

    def _append(self, group: str, block: dict[str, Any]) -> None:
        file = self._opened[0]
        place = file[group] if group else file
        before = len(place["time"])
        for name, data in block.items():
            if name in place:
                place[name].resize(before + len(data), axis=0)
                place[name][before:] = data
        file.flush()
        self._held.commit()

    def _finish(self) -> None:
        _shut(self._opened)
        self._held.commit()
        self._held.close()

    def _abandon(self) -> None:
        if hasattr(self, "_left"):
            self._left()


def _shut(opened: list[Any]) -> None:
    while opened:
        opened.pop().close()


def _let_go(held: HeldFile, opened: list[Any]) -> None:
    """Close HDF5's file object. Writes that this still causes go to memory, so that the file on disk stays unchanged."""
    _shut(opened)
    held.close()


class ZarrRecorder(_Recorder):
    """Writes a stream into a Zarr store (a folder, .zarr), which can be opened at any time.

    Arguments of `palpate.recordings.recorder`, and ``block``, the frames in a block.
    """

    def _create(self) -> None:
        zarr = zarr_library()
        self.path.mkdir()
        self._made = True
        self._root = zarr.create_group(store=str(self.path), zarr_format=3)
        self._root.attrs.update({"meta": json.dumps(self._meta), "Conventions": CONVENTIONS})
        self._arrays: dict[tuple[str, str], Any] = {}

    def _start(self, group: str, layout: dict[str, _Variable]) -> None:
        place = self._root.create_group(group) if group else self._root
        for name, variable in layout.items():
            if variable.dtype.kind == "U":
                # Zarr 3 has no stable form of text: store names as attributes of the arrays that they name.
                place.attrs[name] = [str(v) for v in variable.data]
                continue
            shape = variable.attrs.get("shape", ())
            grows = variable.data is None
            array = place.create_array(
                name,
                shape=(0, *shape) if grows else variable.data.shape,
                chunks=(self._block, *shape) if grows else variable.data.shape,
                dtype=variable.dtype,
                fill_value=variable.empty,
                # A missing block means damage, so blocks of frames without a result are written too.
                config={"write_empty_chunks": True},
                dimension_names=variable.dims,
                attributes={k: v for k, v in variable.attrs.items() if k != "shape"},
            )
            if grows:
                self._arrays[group, name] = array
            else:
                array[...] = variable.data

    def _append(self, group: str, block: dict[str, Any]) -> None:
        before = self._kept.get(group, 0)
        # Write time last: a frame counts only when all of it is stored.
        names = sorted((n for n in block if (group, n) in self._arrays), key=lambda n: n == "time")
        try:
            for name in names:
                self._arrays[group, name].append(block[name].astype(self._arrays[group, name].dtype))
        except OSError:
            for name in names:
                array = self._arrays[group, name]
                with contextlib.suppress(
                    OSError
                ):  # where not even that can be written, readers stop at the time that is missing
                    array.resize((before, *array.shape[1:]))
            raise

    def _finish(self) -> None:
        pass

    def _abandon(self) -> None:
        pass


def zarr_library() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise missing("Zarr stores", error) from error
    return zarr
