"""Check the headers of pictures before unpacking: channels, planes, times, and sizes."""

from __future__ import annotations

import contextlib
import importlib
import lzma
import math
import re
import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from palpate.errors import InvalidInput
from palpate.units import UNITS

__all__ = ["check_axes", "check_page", "check_size", "inflated", "pages_claimed", "rate_of", "size_claimed"]

#: Largest unpacked size of one picture [bytes]: far more than any picture of a gel or of cells.
LARGEST = 1 << 29
#: Bytes to unpack at a time while counting.
CHUNK_BYTES = 1 << 24


def check_axes(file: Any, path: Path) -> None:
    """Raise an error if the file declares that its pages are not successive pictures of the same thing: several
    channels, or planes at several times.

    Planes alone are accepted: ImageJ calls the pictures of a sequence slices.
    """
    series = file.series[0]
    sizes = {axis: int(size) for axis, size in zip(series.axes, series.shape) if size > 1}
    if "C" in sizes:
        raise InvalidInput(
            f"{path}: holds {sizes['C']} channels (its axes are {series.axes}): save the one that shows beads or dots by itself (ImageJ: Image > Color > Split Channels)."
        )
    if "Z" in sizes and "T" in sizes:
        raise InvalidInput(
            f"{path}: holds {sizes['Z']} planes of {sizes['T']} times (its axes are {series.axes}): save one plane by itself (ImageJ: Image > Duplicate, one slice)."
        )


def check_size(size: int, what: str) -> None:
    """Raise an error for a picture that would unpack to more than `LARGEST` bytes."""
    if size > LARGEST:
        raise InvalidInput(
            f"{what} unpacks to {size / 1e9:.3g} GB, more than a picture of a gel or of cells: at most {LARGEST / 1e9:.2g} GB. Save a part of it, or a smaller picture."
        )


def check_page(file: Any, page: Any, what: str) -> None:
    """Raise an error for a TIFF page that is too large, larger than its file can contain, or whose compressed parts
    unpack to more than it declares.
    """
    check_size(int(page.nbytes), what)
    packing = int(page.compression)
    bits = int(page.keyframe.bitspersample)
    claimed = int(page.size) * bits // 8
    if packing == 1 and sum(page.databytecounts) < claimed:
        raise InvalidInput(
            f"{what} claims {claimed} bytes, and {sum(page.databytecounts)} are there: it is truncated or damaged."
        )
    if packing not in UNPACKERS:
        return
    chunk = int(page.dtype.itemsize) if page.dtype is not None else 1
    for size in page.chunks:
        chunk *= int(size)
    for start, count in zip(page.dataoffsets, page.databytecounts):
        file.seek(start)
        try:
            found = inflated(file.read(min(count, LARGEST)), chunk, packing)
        except ValueError:
            continue  # reported when it is unpacked
        if found > chunk:
            raise InvalidInput(
                f"{what} unpacks to more than the {page.keyframe.imagewidth} x {page.keyframe.imagelength} pixels that it claims: it is damaged."
            )


def inflated(data: bytes, most: int, packing: int) -> int:
    """Unpacked size in bytes, counted in chunks up to a little more than ``most``; `ValueError` for damaged data."""
    unpack, total = UNPACKERS[packing](), 0
    try:
        while total <= most and not unpack.eof:
            piece = unpack.decompress(data, CHUNK_BYTES)
            total += len(piece)
            data = getattr(unpack, "unconsumed_tail", b"")
            if not piece and not data:
                break
    except (zlib.error, lzma.LZMAError, EOFError, OSError) as error:
        raise ValueError(str(error)) from error
    return total


#: Compression methods of TIFF with unlimited ratio, by their numbers.
UNPACKERS: dict[int, Any] = {
    **dict.fromkeys((8, 32946, 50013), zlib.decompressobj),
    34925: lzma.LZMADecompressor,
}
with contextlib.suppress(ImportError):  # from Python 3.14 on
    UNPACKERS[50000] = importlib.import_module("compression.zstd").ZstdDecompressor


def size_claimed(head: bytes) -> int:
    """Unpacked size in bytes by the header of a PNG, JPEG, BMP or PNM picture, or 0.

    Examples
    --------
    >>> from palpate.camera.stacks import size_claimed
    >>> size_claimed(b"P5 400 300 255\\n")
    120000
    """
    if head.startswith(b"\x89PNG\r\n\x1a\n") and len(head) >= 26:
        width, height = (int.from_bytes(head[k : k + 4], "big") for k in (16, 20))
        channels = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}.get(head[25], 4)
        return width * height * channels * max(1, head[24] // 8)
    if head.startswith(b"\xff\xd8"):
        at = 2
        while at + 9 < len(head) and head[at] == 0xFF:
            kind = head[at + 1]
            if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
                height, width = (int.from_bytes(head[at + k : at + k + 2], "big") for k in (5, 7))
                return width * height * head[at + 9]
            at += 1 if kind == 0xFF else 2 + int.from_bytes(head[at + 2 : at + 4], "big")
        return 0
    if head.startswith(b"BM") and len(head) >= 30:
        width, height = (abs(int.from_bytes(head[k : k + 4], "little", signed=True)) for k in (18, 22))
        return width * height * max(1, int.from_bytes(head[28:30], "little") // 8)
    found = re.match(rb"P([1-6])(?:\s|#[^\n]*\n)+(\d+)(?:\s|#[^\n]*\n)+(\d+)\s(?:(?:#[^\n]*\n|\s)*(\d+))?", head)
    if found is not None:
        deep = 2 if found[4] and int(found[4]) > 255 else 1
        return int(found[2]) * int(found[3]) * deep * (3 if found[1] in b"36" else 1)
    return 0


def pages_claimed(file: Any) -> int:
    """Number of pictures according to the header of a file, for a stack whose end is missing."""
    size = max(int(file.pages[0].size), 1)  # of one picture, with its colours
    shaped = [
        math.prod(map(int, m["shape"])) // size for m in file.shaped_metadata or () if len(m.get("shape", ())) > 2
    ]
    return max([0, int((file.imagej_metadata or {}).get("images", 0)), *shaped])


def rate_of(file: Any) -> float | None:
    """Pictures a second by ImageJ's frame interval or OME's time increment, or None."""
    interval = float((file.imagej_metadata or {}).get("finterval") or 0.0)
    if not interval and file.ome_metadata:
        try:
            pixels = next(
                e for e in ElementTree.fromstring(file.ome_metadata).iter() if re.fullmatch(r"(\{.*\})?Pixels", e.tag)
            )
        except (ElementTree.ParseError, StopIteration):
            return None
        unit = UNITS["time"].get(pixels.get("TimeIncrementUnit", "s"), 0.0)
        interval = unit * float(pixels.get("TimeIncrement") or 0.0)
    return 1.0 / interval if interval > 0 else None
