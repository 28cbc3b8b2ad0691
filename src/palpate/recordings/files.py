"""Atomic writing of a file or a folder."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InvalidInput
from palpate.recordings.locks import sole_writer

__all__ = ["atomically", "in_place", "is_store", "moved_into_place", "write_arrays"]


def is_store(path: str | Path) -> bool:
    """Whether a path is a Zarr store, the only folder that may be replaced as a whole."""
    return (Path(path) / "zarr.json").is_file()


@contextlib.contextmanager
def in_place(path: str | Path, *, sole: bool = True) -> Iterator[Path]:
    """Context that yields a temporary name to write a file or folder to, and moves it to ``path`` when the block
    succeeds.

    The old file at ``path`` is replaced in one step, and stays unchanged if the block fails or is interrupted. The
    temporary name has the same ending and lies in a hidden folder beside ``path`` (".palpate-...") that is removed in
    any case; only a killed process leaves it. If ``path`` is a symbolic link, the link is kept and the file that it points to is replaced. With ``sole``, nobody
    else may write ``path`` meanwhile (`sole_writer`); otherwise the last writer wins.

    Raises
    ------
    InvalidInput
        The folder does not exist, cannot be written to, the disk does not take it, or another process writes it.
    """
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise InvalidInput(f"{path}: the folder {target.parent} does not exist; make it first.")
    try:
        try:  # exists() may hide that a name is too long
            before = os.stat(target)
        except FileNotFoundError:
            before = None
        if before is not None and not (stat.S_ISREG(before.st_mode) or is_store(target)):
            what = "is a folder" if stat.S_ISDIR(before.st_mode) else "is no ordinary file"
            raise InvalidInput(f"{path} {what}; give a file name.")
        if before is not None and not os.access(target, os.W_OK):
            raise InvalidInput(f"{path} may not be written to (it is read-only); give another name.")
        folder = Path(tempfile.mkdtemp(prefix=".palpate-", dir=target.parent))
    except OSError as error:
        raise InvalidInput(f"{path}: cannot write there ({error.strerror}).") from error
    with contextlib.ExitStack() as stack:
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        if sole:
            stack.enter_context(sole_writer(path))
        yield from _moved(path, target, folder, before)


def _moved(path: str | Path, target: Path, folder: Path, before: os.stat_result | None) -> Iterator[Path]:
    fresh = folder / target.name
    try:
        yield fresh
        _settle(fresh)
        if before is not None and stat.S_ISREG(before.st_mode):
            os.chmod(fresh, stat.S_IMODE(before.st_mode))
        _move(fresh, target, folder / "before")
    except (OSError, InvalidInput) as error:
        # A recorder's messages name the temporary file and its lost frames: correct them.
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            raise
        kept = "" if before is None else ", and what was there is kept"
        raise InvalidInput(f"{path}: writing failed ({cause.strerror or cause}); nothing was written{kept}.") from cause


def atomically(path: str | Path, write: Callable[[str], None], *, sole: bool = True) -> None:
    """Call ``write`` with the name of an empty file beside ``path``, then move it there; remove it on failure (`in_place`)."""
    if os.path.isdir(path):  # Path raises it for a name that is too long
        raise InvalidInput(f"{path} is a folder; give a file name.")
    with in_place(path, sole=sole) as fresh:
        fresh.touch()
        write(str(fresh))


def write_arrays(path: str | Path, arrays: Mapping[str, Any]) -> None:
    """Write named arrays as .npz by `atomically`."""

    def fill(name: str) -> None:
        with open(name, "wb") as file:
            np.savez_compressed(file, **arrays)

    atomically(path, fill)


def moved_into_place(fresh: Path, path: str | Path) -> None:
    """Move a complete file or store on the same disk to ``path``; if that fails, it stays where it is.

    Raises
    ------
    InvalidInput
        The disk does not take it.
    """
    target = Path(os.path.realpath(path))
    try:
        _settle(fresh)
        _move(fresh, target, fresh.with_name("before"))
    except OSError as error:
        raise InvalidInput(
            f"{path}: writing failed ({error.strerror or error}); what was written is in {fresh}."
        ) from error


def _settle(path: Path) -> None:
    """Flush to the disk before replacing anything: a power cut must not leave an empty file under a good name."""
    places = [path, *path.rglob("*")] if path.is_dir() else [path]
    for place in places:
        if place.is_file():
            with open(place, "rb+") as file:
                os.fsync(file.fileno())


def _move(fresh: Path, target: Path, aside: Path) -> None:
    if fresh.is_dir() and target.exists():
        # Not all systems can exchange two folders in one call: move the old one aside, and back if the new one cannot
        # be moved in.
        try:
            os.rename(target, aside)
            os.rename(fresh, target)
        finally:
            if aside.exists() and not target.exists():
                os.rename(aside, target)
    else:
        os.replace(fresh, target)
    if os.name == "posix":  # the name too
        handle = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
