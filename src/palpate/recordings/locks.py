"""Allow only one writer per file, by a lock that the operating system releases when its process ends."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from palpate.errors import InvalidInput

__all__ = ["claim", "sole_writer"]

#: Errors of a disk without locks; there the last writer wins.
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)

#: Files that this process writes: name -> [handle of the lock file, number of claims].
_held: dict[str, list[int]] = {}
_guard = threading.Lock()


def claim(path: str | Path, *, alone: bool = False) -> Callable[[], None]:
    """Take the lock of ``path`` and return a function that releases it; repeated claims within one process are
    counted.

    The lock is held on a hidden file beside ``path`` (".palpate-....lock"), so that the system releases it with the
    process: after kill -9 the empty file may stay, without effect.

    Parameters
    ----------
    path : str or Path
        The file to write; a link is followed.
    alone : bool
        Refuse also where this process holds the lock.

    Raises
    ------
    InvalidInput
        Another process writes it, or the folder does not take a file.
    """
    target = os.path.realpath(path)
    with _guard:
        held = _held.get(target)
        if held is not None and alone:
            raise InvalidInput(
                f"{path} is being written in this process already. Wait until that has ended, or give another name."
            )
        if held is None:
            held = _held[target] = [_locked(target, path), 0]
        held[1] += 1
    given_back = False

    def release() -> None:
        nonlocal given_back
        with _guard:
            if given_back or _held.get(target) is not held:  # the latter in a process that was forked meanwhile
                return
            given_back = True
            held[1] -= 1
            if not held[1]:
                del _held[target]
                _unlocked(target, held[0])

    return release


@contextlib.contextmanager
def sole_writer(path: str | Path, *, alone: bool = False) -> Iterator[None]:
    """Context that holds the lock of ``path`` (`claim`)."""
    release = claim(path, alone=alone)
    try:
        yield
    finally:
        release()


def _lock_file(target: str) -> str:
    """The lock file beside the target, with a short name for any target."""
    folder, name = os.path.split(target)
    return os.path.join(
        folder, f".palpate-{hashlib.sha1(os.fsencode(name), usedforsecurity=False).hexdigest()[:16]}.lock"
    )


def _locked(target: str, path: str | Path) -> int:
    name = _lock_file(target)
    while True:
        try:
            handle = os.open(name, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError as error:
            raise InvalidInput(
                f"{path}: the folder {os.path.dirname(target)} does not exist; make it first."
            ) from error
        except OSError as error:
            raise InvalidInput(f"{path}: cannot write there ({error.strerror}).") from error
        try:
            if not _try_lock(handle):
                raise InvalidInput(
                    f"{path} is being written by another process{_writer(handle)}. Wait until that has ended, or give another name."
                )
            if _same(handle, name):
                with contextlib.suppress(OSError):  # who writes is a courtesy
                    os.ftruncate(handle, 0)
                    os.write(handle, str(os.getpid()).encode())
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # it was given back, and its file removed, between the two


def _unlocked(target: str, handle: int) -> None:
    name = _lock_file(target)
    if sys.platform != "win32":
        with contextlib.suppress(OSError):  # while it is locked, so that nobody's new one is removed
            os.unlink(name)
        import fcntl

        # a forked process holds the same open file
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_UN)
    os.close(handle)
    if sys.platform == "win32":  # on systems where an open file cannot be removed
        with contextlib.suppress(OSError):
            os.unlink(name)


def _try_lock(handle: int) -> bool:
    """Take the lock; return whether that succeeded."""
    if sys.platform == "win32":
        import msvcrt

        try:
            os.lseek(handle, 1 << 20, os.SEEK_SET)  # beyond the written part, which others may read
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        os.lseek(handle, 0, os.SEEK_SET)
        return True
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise InvalidInput(f"the lock of a file cannot be taken ({error.strerror}).") from error
    return True


def _same(handle: int, name: str) -> bool:
    """Whether the locked file is still the one under this name."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(name))
    except FileNotFoundError:
        return False


def _writer(handle: int) -> str:
    """The process that holds the lock, if the lock file states it."""
    with contextlib.suppress(OSError):
        os.lseek(handle, 0, os.SEEK_SET)
        number = os.read(handle, 20)
        if number.isdigit():
            return f" ({number.decode()})"
    return ""


def _forget() -> None:
    """After a fork: the locks belong to the parent process, and end with it."""
    for handle, _ in _held.values():
        with contextlib.suppress(OSError):
            os.close(handle)
    _held.clear()
    global _guard
    _guard = threading.Lock()  # another thread of the parent may have held it


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
