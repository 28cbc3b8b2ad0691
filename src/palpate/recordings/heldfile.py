"""A file object for HDF5 that buffers all writes, so that a full disk neither crashes HDF5 nor damages the file.

HDF5 does not survive a failed write: it tries again when each of its objects is closed, at the latest at the end of
the process, and then reads freed memory (h5py issues 914, 1775, 2160). So its writes go to memory and never fail.
`HeldFile.commit` writes to the disk in an order that keeps the file valid: first the part beyond its end, which is the
only one that needs space, then the few changed pages. On a full disk the file stays as it was at the last commit.
"""

from __future__ import annotations

import contextlib
import os
import threading
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import xarray

__all__ = ["Apart", "HeldFile", "write_netcdf"]

PAGE = 4096
#: Write a file to the disk after this many bytes if nobody has read it.
MAX_HELD_BYTES = 16 * 2**20
T = TypeVar("T")


class HeldFile:
    """A file object for h5py; only `commit` writes to the disk, and only it can fail.

    Parameters
    ----------
    path : str or Path
    exclusive : bool
        Refuse an existing file; else it is emptied.
    hold : int, optional
        Commit automatically after so many bytes; by default only `commit` writes. It also raises earlier failures.
    """

    def __init__(self, path: str | Path, *, exclusive: bool = True, hold: int | None = None) -> None:
        flags = os.O_RDWR | os.O_CREAT | (os.O_EXCL if exclusive else os.O_TRUNC) | getattr(os, "O_BINARY", 0)
        self._disk = open(os.open(path, flags, 0o666), "r+b", buffering=0)  # noqa: SIM115
        self._committed = self._size = self._at = 0
        self._pages: dict[int, tuple[bytes, bytearray]] = {}
        self._tail = bytearray()
        self._hold = hold
        self._failure: OSError | None = None

    # -- the interface of HDF5 ------------------------------------------------------------------------------------------

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Set the position of the next read or write."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """The position of the next read or write."""
        return self._at

    def read(self, size: int = -1) -> bytes:
        """Bytes from the current position, including held ones."""
        count = max(0, self._size - self._at) if size < 0 else size
        data = bytearray(count)
        del data[self.readinto(data) :]
        return bytes(data)

    def readinto(self, buffer: Any) -> int:
        """Fill ``buffer`` from the current position; return the number of bytes read."""
        view = memoryview(buffer).cast("B")
        count = max(0, min(len(view), self._size - self._at))
        done = 0
        while done < count:
            at = self._at + done
            if at >= self._committed:
                piece: bytes | bytearray = self._tail[at - self._committed : at - self._committed + count - done]
            elif at // PAGE in self._pages:
                piece = self._pages[at // PAGE][1][at % PAGE : at % PAGE + count - done]
            else:
                piece = self._from_disk(at, min(PAGE - at % PAGE, self._committed - at, count - done))
            view[done : done + len(piece)] = piece
            done += len(piece)
        self._at += count
        return count

    def write(self, data: Any) -> int:
        """Buffer ``data`` at the current position."""
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view):
            at = self._at + done
            if at >= self._committed:
                start = at - self._committed
                if start > len(self._tail):
                    self._tail.extend(bytes(start - len(self._tail)))
                self._tail[start : start + len(view) - done] = view[done:]
                break
            number, start = divmod(at, PAGE)
            if number not in self._pages:
                before = self._from_disk(number * PAGE, min(PAGE, self._committed - number * PAGE))
                self._pages[number] = (before, bytearray(before))
            page = self._pages[number][1]
            count = min(len(page) - start, len(view) - done)
            page[start : start + count] = view[done : done + count]
            done += count
        self._at += len(view)
        self._size = max(self._size, self._at)
        if self._hold is not None and len(self._tail) > self._hold and self._failure is None:
            with contextlib.suppress(OSError):  # `commit` raises it
                self._to_disk()
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the length."""
        self._size = self._at if size is None else size
        wanted = max(0, self._size - self._committed)
        del self._tail[wanted:]
        self._tail.extend(bytes(wanted - len(self._tail)))
        return self._size

    def flush(self) -> None:
        """Do nothing: `commit` writes the held bytes to the disk."""

    # -- our interface --------------------------------------------------------------------------------------------------

    def commit(self) -> bool:
        """Write the held bytes to the disk; return whether there were any. `OSError` if that fails; the disk then stays unchanged."""
        if self._failure is not None:
            raise self._failure
        if not (self._tail or self._pages or self._size < self._committed):
            return False
        self._to_disk()
        return True

    def close(self) -> None:
        """Close and discard what was not committed. `OSError` if the system could not store what it had accepted."""
        if not self._disk.closed:
            try:
                if self._failure is None:
                    os.fsync(self._disk.fileno())
            finally:
                self._disk.close()

    def _from_disk(self, at: int, count: int) -> bytes:
        self._disk.seek(at)
        return (self._disk.read(count) or b"").ljust(count, b"\0")

    def _put(self, at: int, data: bytes | bytearray) -> None:
        self._disk.seek(at)
        view = memoryview(data)
        while view:
            view = view[self._disk.write(view) :]

    def _to_disk(self) -> None:
        done: list[int] = []
        try:
            self._put(self._committed, self._tail)
            # Write the end of the file first and the beginning last, so that data are on the disk before their
            # addresses.
            for number in sorted(self._pages, key=lambda n: (n > 0, -n)):
                done.append(number)
                self._put(number * PAGE, self._pages[number][1])
            if self._size < self._committed:
                self._disk.truncate(self._size)
        except OSError as error:
            self._failure = error
            with contextlib.suppress(OSError):
                self._disk.truncate(self._committed)
                for number in done:
                    self._put(number * PAGE, self._pages[number][0])
            raise
        self._committed = self._size
        self._pages, self._tail = {}, bytearray()


class Apart:
    """Run functions one after another in a separate thread.

    Ctrl-C only interrupts the main thread. There it could interrupt a callback of HDF5, or the writing of two arrays
    of a block, and leave a damaged file. In this thread every write is complete or has not started.
    """

    def __init__(self) -> None:
        self._jobs: SimpleQueue[Any] = SimpleQueue()
        threading.Thread(target=_work, args=(self._jobs,), name="palpate-writer", daemon=True).start()
        self.end: Callable[[], None] = weakref.finalize(self, self._jobs.put, None)

    def __call__(self, act: Callable[[], T]) -> T:
        """Run a function in the thread and wait for its result."""
        answer: SimpleQueue[tuple[Any, BaseException | None]] = SimpleQueue()
        self._jobs.put((act, answer))
        value, error = answer.get()
        if error is not None:
            raise error
        return value


def _work(jobs: SimpleQueue[Any]) -> None:
    while (job := jobs.get()) is not None:
        act, answer = job
        try:
            answer.put((act(), None))
        except BaseException as error:  # raised by commit
            answer.put((None, error))
        del job, act, answer


def write_netcdf(dataset: xarray.Dataset, path: str | Path, encoding: Mapping[str, Any]) -> None:
    """Write a complete data set as NetCDF (HDF5) over ``path``; `OSError` if the disk is full."""

    def write() -> None:
        import h5netcdf
        from xarray.backends import H5NetCDFStore

        held = HeldFile(path, exclusive=False, hold=MAX_HELD_BYTES)
        try:
            with h5netcdf.File(held, "w") as file:
                dataset.dump_to_store(H5NetCDFStore(file), encoding=encoding)
            held.commit()
        finally:
            held.close()

    apart = Apart()
    try:
        apart(write)
    finally:
        apart.end()
