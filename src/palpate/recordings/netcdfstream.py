"""Write the touches of a long recording as NetCDF (HDF5), piece by piece."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.recordings.checked import CHECKSUM, checksum
from palpate.recordings.heldfile import MAX_HELD_BYTES, HeldFile
from palpate.recordings.touchstream import Arrays, Piece

if TYPE_CHECKING:
    import xarray

__all__ = ["NetCDFStream"]

#: Largest number of bytes of a block: HDF5 keeps one of each variable in memory until it is full.
BLOCK = 1 << 20


class NetCDFStream(Arrays):
    """Writes through a `HeldFile`, so that a full disk is an error and not a crash."""

    def __init__(self, path: Path, count: int, record: Mapping[str, str]) -> None:
        super().__init__(path, count, record)
        self._held: Any = None
        self._file: Any = None

    def _begin(self, fixed: Mapping[str, xarray.Variable], frames: int) -> None:
        import h5netcdf
        import h5py

        self._frames = frames
        self._held = HeldFile(self.path, exclusive=False, hold=MAX_HELD_BYTES)
        self._file = h5netcdf.File(self._held, "w")
        self._file.dimensions["time"] = self.count
        for name, variable in fixed.items():
            for dim, size in zip(variable.dims, variable.shape):
                self._dimension(dim, size)
            if variable.dtype.kind in "OUT":
                data = np.array([str(v) for v in variable.values], dtype=object)
                made = self._file.create_variable(name, variable.dims, data=data, dtype=h5py.string_dtype())
            else:
                made = self._file.create_variable(name, variable.dims, data=variable.values, fletcher32=True)
            made.attrs.update(variable.attrs)

    def _add(self, start: int, piece: Piece) -> None:
        super()._add(start, piece)
        self._held.commit()  # report a full disk now, not after hours

    def _dimension(self, name: Any, size: int) -> None:
        if name not in self._file.dimensions:
            self._file.dimensions[name] = size

    def _create(self, name: str, like: xarray.Variable) -> None:
        for dim, size in zip(like.dims[1:], like.shape[1:]):
            self._dimension(dim, size)
        flags = like.dtype == np.bool_
        dtype = np.dtype(np.int8) if flags else like.dtype
        options: dict[str, Any] = {"fillvalue": np.nan} if dtype.kind == "f" else {}
        # Blocks equal to pieces: a block filled in several parts would be compressed each time.
        nbytes = dtype.itemsize * int(np.prod(like.shape[1:], dtype=np.int64))
        parts = -(-self._frames * nbytes // BLOCK)
        rows = -(-self._frames // parts) if like.ndim > 1 else BLOCK // nbytes
        options["chunks"] = (min(rows, self.count), *like.shape[1:])
        if like.ndim > 1:
            # Maps of linear methods hardly compress, and higher levels cost half as much again for 1 %.
            options |= {"compression": "gzip", "compression_opts": 1, "shuffle": True}
        made = self._file.create_variable(name, like.dims, dtype=dtype, fletcher32=True, **options)
        made.attrs.update({**like.attrs, **({"dtype": "bool"} if flags else {})})

    def _put(self, name: str, start: int, values: Any) -> None:
        self._file[name][start : start + len(values)] = values.astype(np.int8) if values.dtype == np.bool_ else values

    def _finish(self) -> None:
        import h5netcdf
        import xarray

        self._file.attrs.update(self.whole.attributes(self.record))
        for variable in self._file.variables.values():
            if "notes" in variable.attrs:
                variable.attrs["notes"] = self.whole.notes
        self._file.close()
        self._held.seek(0)
        store = xarray.backends.H5NetCDFStore(h5netcdf.File(self._held, "r"))
        with xarray.open_dataset(store, decode_times=False, cache=False) as found:
            crc = checksum(found)
        with h5netcdf.File(self._held, "a") as file:
            file.attrs[CHECKSUM] = crc
        self._held.commit()
        self._held.close()

    def _abandon(self) -> None:
        if self._file is not None:
            self._file.close()  # into memory
            self._held.close()
