"""Whether a packed page of a TIFF file unpacks: the library that reads it fills what it cannot unpack with zeros, and says so to nobody who can act on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from palpate.camera.stacks import check_page, inflated

__all__ = ["lzw_length", "packbits_length", "unpacks"]

#: Ways of packing, by their numbers in the file.
PLAIN, LZW, JPEG, DEFLATE, PACKBITS = 1, 5, 7, (8, 32946), 32773
#: Codes of LZW that are no entries of its table, and the largest table.
CLEAR, END, LARGEST = 256, 257, 4096


def unpacks(path: Path, pages: Any) -> bool:
    """Whether every page is packed in a way that is known, and all of it is there; one that unpacks to too much is refused."""
    with path.open("rb") as file:
        for number, page in enumerate(pages):
            check_page(file, page, f"{path}: page {number}")
        return all(_page_unpacks(file, page) for page in pages)


def _page_unpacks(file: Any, page: Any) -> bool:
    kind = int(page.compression)
    if kind in (PLAIN, JPEG):
        return True
    length = {LZW: lzw_length, PACKBITS: packbits_length}.get(kind)
    if length is None and kind not in DEFLATE:
        return False
    total = 0
    for start, count in zip(page.dataoffsets, page.databytecounts):
        file.seek(start)
        held = file.read(count)
        if len(held) < count:
            return False
        try:
            total += inflated(held, page.nbytes, kind) if length is None else length(held)
        except ValueError:
            return False
    # tiles reach past the edge of a picture, and several bits share a byte
    return total == page.nbytes or page.bitspersample < 8 or (page.is_tiled and total > page.nbytes)


def packbits_length(data: bytes) -> int:
    """Bytes that a strip of PackBits unpacks to (TIFF 6.0, section 9); `ValueError` where it ends within a run.

    Examples
    --------
    >>> from palpate.microscopy.packed import packbits_length
    >>> packbits_length(bytes([0xFE, 0xAA, 0x02, 0x80, 0x00, 0x2A]))  # a byte three times, and three others
    6
    """
    at = total = 0
    while at < len(data):
        count = data[at]
        if count < 128:  # so many others, and one more
            at, total = at + count + 2, total + count + 1
        elif count > 128:
            at, total = at + 2, total + 257 - count
        else:
            at += 1
    if at > len(data):
        raise ValueError("it ends within a run")
    return total


def lzw_length(data: bytes) -> int:
    """Bytes that a strip of LZW unpacks to (TIFF 6.0, section 13); `ValueError` where it holds a code that is not in the table yet.

    Examples
    --------
    >>> from palpate.microscopy.packed import lzw_length
    >>> lzw_length(bytes([0x80, 0x01, 0xE0, 0x40, 0x80, 0x44, 0x08, 0x0C, 0x06, 0x80, 0x80]))  # 7 7 7 8 8 7 7 6 6, of the standard
    9
    """
    lengths = [1] * 258
    width, previous, total = 9, -1, 0
    held = bits = 0
    for byte in data:
        held, bits = (held << 8) | byte, bits + 8
        if bits < width:
            continue
        bits -= width
        code = held >> bits
        held &= (1 << bits) - 1
        if code == CLEAR:
            lengths, width, previous = lengths[:258], 9, -1
            continue
        if code == END:
            break
        if code > len(lengths) - (previous < 0) or (previous < 0 and code > 255):
            raise ValueError("a code that is not in the table yet")
        if previous >= 0 and len(lengths) < LARGEST:
            lengths.append(lengths[previous] + 1)
            # the width grows one entry early
            if len(lengths) == (1 << width) - 1 and width < 12:
                width += 1
        if code >= len(lengths):
            raise ValueError("a code that is not in the table yet")
        total += lengths[code]
        previous = code
    return total
