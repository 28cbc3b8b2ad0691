"""CRC-32 of concatenated bytes from the CRC-32 of their parts: zlib's ``crc32_combine``, which Python does not
provide.

A CRC is the remainder of a polynomial over two elements; appending bytes multiplies it by x^(8 bytes) (M. Adler, zlib,
crc32.c).
"""

from __future__ import annotations

import functools

__all__ = ["combined"]

#: The polynomial of CRC-32, its lowest power in the highest bit.
POLYNOMIAL = 0xEDB88320
ONE = 1 << 31


def combined(first: int, second: int, length: int) -> int:
    """CRC-32 of some bytes followed by ``length`` others, from the CRC-32 of each part.

    Examples
    --------
    >>> import zlib
    >>> from palpate.recordings.crc import combined
    >>> combined(zlib.crc32(b"pal"), zlib.crc32(b"pate"), 4) == zlib.crc32(b"palpate")
    True
    """
    return _product(_shift(length), first) ^ second


def _product(a: int, b: int) -> int:
    """a b modulo the polynomial."""
    out, bit = 0, ONE
    while a:
        if a & bit:
            out ^= b
            a ^= bit
        bit >>= 1
        b = (b >> 1) ^ POLYNOMIAL if b & 1 else b >> 1
    return out


@functools.lru_cache(maxsize=256)
def _shift(length: int) -> int:
    """x^(8 length) modulo the polynomial."""
    out, power = ONE, ONE >> 8
    while length:
        if length & 1:
            out = _product(power, out)
        power = _product(power, power)
        length >>= 1
    return out
