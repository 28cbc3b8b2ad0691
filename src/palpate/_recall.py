"""Load arrays that take long to compute from a file that an earlier run wrote. The key of an array is a digest of
everything that it depends on.

A file is an uncompressed NPZ of plain arrays with a header in JSON. Nothing in it is executed, and each array has the
checksum of its zip entry.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.errors import InvalidInput

__all__ = ["Recall", "digest", "read", "write"]

Arrays = tuple[npt.NDArray[Any], ...]

#: Version of the file layout; other versions are refused.
FORMAT = 1
#: Largest length of a header: a few hundred entries of a hundred characters.
LONGEST_HEADER = 1_000_000


class _Unknown(Exception):
    """Raised for an object that has no digest."""


def digest(*things: Any) -> str | None:
    """Return the SHA-256 of numbers, text, arrays, and palpate's dataclasses made of these, exact to the last bit;
    None if anything else is among them.
    """
    out = hashlib.sha256()
    try:
        for thing in things:
            _walk(thing, out.update)
    except _Unknown:
        return None
    return out.hexdigest()


def _walk(thing: Any, say: Callable[[bytes], None]) -> None:
    if thing is None or isinstance(thing, bool | int | float | str | np.generic):
        value = thing.item() if isinstance(thing, np.generic) else thing
        say(f"{type(value).__name__}:{value!r};".encode())
    elif isinstance(thing, np.ndarray):
        if thing.dtype.hasobject:
            raise _Unknown
        say(f"array:{thing.dtype.str}{thing.shape};".encode())
        say(np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, Mapping):
        say(f"map:{len(thing)};".encode())
        for key in sorted(thing, key=repr):
            _walk(key, say)
            _walk(thing[key], say)
    elif isinstance(thing, Sequence):
        say(f"list:{len(thing)};".encode())
        for item in thing:
            _walk(item, say)
    elif is_dataclass(thing) and not isinstance(thing, type) and type(thing).__module__.startswith("palpate."):
        # subclasses of palpate's classes may do anything
        say(f"{type(thing).__module__}.{type(thing).__qualname__};".encode())
        for f in fields(thing):
            _walk(getattr(thing, f.name), say)
    else:
        raise _Unknown


@dataclass(frozen=True)
class Recall:
    """Stored arrays, by the `digest` of everything that they depend on."""

    entries: Mapping[str, Arrays]

    def find(self, key: str | None, shapes: Sequence[tuple[int, ...]]) -> Arrays | None:
        """Return the arrays stored under a key if they have these shapes and double precision."""
        found = None if key is None else self.entries.get(key)
        if found is None or [a.shape for a in found] != list(shapes):
            return None
        return found if all(a.dtype == np.float64 for a in found) else None


def write(path: str, entries: Mapping[str, Arrays], about: Mapping[str, str]) -> None:
    """Write a file; ``about`` (texts or digests) goes into its header, which `read` returns."""
    header = {"format": FORMAT, "about": dict(about), "entries": {key: len(parts) for key, parts in entries.items()}}
    text = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    arrays: dict[str, Any] = {f"{key}.{i}": part for key, parts in entries.items() for i, part in enumerate(parts)}
    with open(path, "wb") as file:
        np.savez(file, header=text, **arrays)


def read(path: str | Path, check: Callable[[Mapping[str, str]], None]) -> Recall:
    """Read a file; call ``check`` with its header before reading large arrays.

    Raises
    ------
    InvalidInput
        The file does not exist, is of another kind, or is damaged.
    """
    path = Path(path)
    if not path.is_file():
        raise InvalidInput(f"{path}: there is no such file; write one with Skin.save_prepared.")
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            if "header" not in file.files:
                raise ValueError("it has no header")
            if file.zip.getinfo("header.npy").file_size > LONGEST_HEADER:
                raise ValueError("its header is too long")
            header = json.loads(file["header"].tobytes())
            if not isinstance(header, dict) or not isinstance(header.get("about"), dict):
                raise ValueError("its header is of another kind")
            if header.get("format") != FORMAT:
                raise InvalidInput(
                    f"{path}: its form is {header.get('format')!r}, and this version reads {FORMAT}. Prepare the skin again and save it "
                    "(Skin.prepare, Skin.save_prepared)."
                )
            check(header["about"])
            entries = {
                str(key): tuple(file[f"{key}.{i}"] for i in range(int(count)))
                for key, count in dict(header["entries"]).items()
            }
    except InvalidInput:
        raise
    except (OSError, ValueError, KeyError, TypeError, EOFError, MemoryError, zipfile.BadZipFile) as error:
        raise InvalidInput(
            f"{path} is damaged, or is not a file of a prepared skin ({error}). Prepare the skin again and save it (Skin.prepare, "
            "Skin.save_prepared)."
        ) from error
    return Recall(entries)
