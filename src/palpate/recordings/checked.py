"""Checks against damaged files: a checksum over everything written, and limits on the sizes in a header."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._numbers import plain_number
from palpate.errors import InvalidInput
from palpate.recordings.crc import combined
from palpate.recordings.labelled import recording_dataset
from palpate.recordings.recording import Recording

if TYPE_CHECKING:
    import xarray

__all__ = [
    "CHECKSUM",
    "SALVAGED",
    "affordable",
    "agree",
    "block_crc",
    "checksum",
    "confirm",
    "confirm_recording",
    "json_object",
    "recording_checksum",
    "with_losses",
]

#: Attribute that holds the checksum.
CHECKSUM = "palpate_crc32"
#: Entry of ``meta`` that describes the losses of a salvaged recording.
SALVAGED = "salvaged"
#: Bytes of a block in which numbers are read to be checked.
BLOCK = 1 << 22
#: Largest compression ratio of deflate (1032), and a size that is always accepted.
DEFLATE, SMALL = 1032, 1 << 20


def checksum(
    dataset: xarray.Dataset,
    *,
    long: Mapping[str, tuple[int, Iterable[Any]]] | None = None,
    known: Mapping[str, tuple[int, int]] | None = None,
) -> int:
    """CRC-32 of names, dimensions, values and attributes, independent of the file format: numbers count in double
    precision.

    A CRC-32 detects every change of up to 32 neighbouring bits, and all but one of 4e9 other changes. Numbers are read
    in blocks, so that a data set in a file is never completely in memory. ``long``: variables of which ``dataset``
    contains only an excerpt, with the number of their frames and an iterator over their blocks. ``known``: variables
    whose `block_crc` and number of bytes are known.
    """
    crc = 0
    for name in sorted(map(str, dataset.variables)):
        variable = dataset.variables[name]
        shape = variable.shape
        blocks: Iterable[Any] = _blocks(variable)
        if long is not None and name in long:
            count, blocks = long[name]
            shape = (count, *shape[1:])
        crc = zlib.crc32(json.dumps([name, *map(str, variable.dims), *shape]).encode(), crc)
        if known is not None and name in known:
            crc = combined(crc, *known[name])
            continue
        for block in blocks:
            crc = zlib.crc32(_canonical(block), crc)
    attributes = {str(k): _plain(v) for k, v in dataset.attrs.items() if k != CHECKSUM}
    return zlib.crc32(json.dumps(attributes, sort_keys=True).encode(), crc)


def block_crc(values: Any) -> tuple[int, int]:
    """CRC-32 of numbers in the form that `checksum` uses, and their number of bytes."""
    block = _canonical(values)
    return zlib.crc32(block), len(block)


def _blocks(variable: xarray.Variable) -> Iterator[Any]:
    """The values in blocks of a few megabytes; text, which is short, as a whole."""
    if not variable.ndim or variable.dtype.kind not in "fbiu":
        yield variable.values
        return
    step = max(1, BLOCK // max(1, 8 * int(np.prod(variable.shape[1:], dtype=np.int64))))
    for start in range(0, len(variable), step):
        yield variable[start : start + step].values


def _canonical(values: Any) -> bytes:
    if values.dtype.kind == "f":
        block = values.astype("<f8")
        block[np.isnan(block)] = np.nan
        return bytes(block.tobytes())
    if values.dtype.kind in "biu":
        return bytes(values.astype("<i8").tobytes())
    return json.dumps([v.decode() if isinstance(v, bytes) else str(v) for v in np.ravel(values)]).encode()


def _plain(value: Any) -> Any:
    found = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    return list(found) if isinstance(found, tuple) else found


def confirm(dataset: xarray.Dataset, expected: Any, path: str | Path, remedy: str = "") -> None:
    """Refuse data that differ from what was written. ``expected`` None: no checksum (another program, a stream)."""
    if expected is not None:
        agree(checksum(dataset), expected, path, remedy)


def agree(found: int, expected: Any, path: str | Path, remedy: str = "") -> None:
    """Raise an error if the checksum differs from that in the file."""
    try:
        wanted = int(np.asarray(expected).item())
    except (TypeError, ValueError, OverflowError):
        wanted = -1
    if wanted != found:
        raise InvalidInput(
            f"{path} was damaged or changed: what it holds does not agree with its checksum. {remedy or 'Take another copy.'}"
        )


def recording_checksum(recording: Recording) -> int:
    """The checksum of a recording."""
    return checksum(recording_dataset(recording))


def confirm_recording(recording: Recording, expected: Any, path: str | Path, remedy: str = "") -> Recording:
    """The recording, after its checksum was verified."""
    if expected is not None:
        confirm(recording_dataset(recording), expected, path, remedy)
    return recording


def with_losses(recording: Recording, expected: Any, path: str | Path, losses: str) -> Recording:
    """The salvaged recording, with the losses in ``meta``. If a checksum of the whole matches, nothing was lost."""
    if expected is not None:
        try:
            confirm_recording(recording, expected, path)
        except InvalidInput:
            losses += "; it does not agree with its checksum, so that any of its numbers may be wrong"
        else:
            losses = "nothing is lost: it agrees with its checksum"
    return replace(recording, meta={**recording.meta, SALVAGED: losses})


def affordable(claimed: int, stored: int, path: str | Path, *, shrink: float = DEFLATE) -> None:
    """Refuse a header that claims more bytes than ``stored`` bytes can contain, before anything is allocated."""
    if claimed < 0 or claimed > SMALL + shrink * stored:
        raise InvalidInput(
            f"{path}: its header claims {plain_number(claimed, 3)} bytes of numbers, but only {plain_number(stored, 3)} bytes are stored; it is damaged."
        )


def json_object(text: Any, what: str) -> dict[str, Any]:
    """Parse a JSON object; `InvalidInput` if it is not JSON, nested a thousand times, or not an object."""
    try:
        found = json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise InvalidInput(f"{what} cannot be read; the file may be truncated.") from error
    if not isinstance(found, dict):
        raise InvalidInput(f"{what} must be a JSON object.")
    return found
