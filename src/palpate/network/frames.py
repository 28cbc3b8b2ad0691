"""The form of a frame on the wire.

One frame is, little-endian,

    "PLPF" | sequence uint32 | time float64 [s] | channels uint16 | rows uint16 | columns uint16 | values float32

with the values as (channel, row, column), in SI units, compression positive, NaN where missing; taxels on a line or scattered are one row. Every
frame states its shape. A sender may request a new zero when nothing touches:

    "PLPZ" | frames uint32

takes it from so many frames (1 to 10 000) that come next. The sequence counts frames and may wrap around; it and the time begin again when the sender does.
By UDP a frame is one datagram; by TCP each frame follows its length in bytes (uint32); by WebSocket a frame is one binary message.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np

from palpate._arrays import as_real, to_numpy
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.times import as_second

__all__ = [
    "HEAD",
    "MAGIC",
    "ZERO",
    "frame_bytes",
    "frame_from_bytes",
    "is_big_endian",
    "zero_bytes",
    "zero_from_bytes",
]

MAGIC, ZERO = b"PLPF", b"PLPZ"
#: Largest number of frames for a zero.
MAX_ZERO_FRAMES = 10_000
HEAD = struct.Struct("<4sIdHHH")
_SWAPPED = struct.Struct(">4sIdHHH")


def frame_bytes(sequence: int, time: float, readings: Any) -> bytes:
    """Encode one frame (channel, taxel) or (channel, y, x); masked values are missing (NaN).

    Raises
    ------
    InvalidInput
        Not real numbers, another shape, or a number beyond single precision.

    Examples
    --------
    >>> len(frame_bytes(0, 0.0, [[1.0, 2.0, 3.0]]))
    34
    """
    values = to_numpy(as_real(readings, "the readings of a frame"))
    if values.ndim not in (2, 3):
        raise InvalidInput(f"a frame must have shape (channel, taxel) or (channel, y, x); got {values.shape}.")
    with np.errstate(over="ignore"):
        sent = values.astype("<f4")
    if np.isinf(sent).any() and not np.isinf(values).any():
        raise InvalidInput("a frame holds single precision, which ends at 3.4e38; send readings in SI units.")
    rows, columns = (1, values.shape[1]) if values.ndim == 2 else values.shape[1:]
    if max(len(values), rows, columns) >= 2**16:
        raise InvalidInput(f"a frame has at most 65535 channels, rows and columns; got {values.shape}.")
    seconds = as_second(time, "the time of a frame")
    head = HEAD.pack(MAGIC, int(sequence) % 2**32, seconds, len(values), rows, columns)
    return head + np.ascontiguousarray(sent).tobytes()


def frame_from_bytes(data: bytes) -> tuple[int, float, Floats]:
    """Decode a frame to (sequence, time [s], readings (channel, row, column)); raise `InvalidInput` if it is not one.

    Examples
    --------
    >>> frame_from_bytes(frame_bytes(7, 0.5, [[1.0, 2.0]]))
    (7, 0.5, array([[[1., 2.]]]))
    """
    if len(data) < HEAD.size or data[:4] != MAGIC:
        raise InvalidInput("not a palpate frame: it does not begin with PLPF.")
    _, sequence, time, channels, rows, columns = HEAD.unpack_from(data)
    needed = HEAD.size + 4 * channels * rows * columns
    if len(data) != needed:
        if is_big_endian(data):
            raise InvalidInput("a frame of big-endian numbers; send them little-endian.")
        raise InvalidInput(f"a frame of {channels} x {rows} x {columns} floats has {needed} bytes; got {len(data)}.")
    as_second(time, "the time of a frame")
    values = np.frombuffer(data, dtype="<f4", offset=HEAD.size).reshape(channels, rows, columns)
    return sequence, time, np.asarray(values, dtype=np.float64)


def zero_bytes(frames: int = 10) -> bytes:
    """The message that requests a new zero from the next ``frames`` frames, in which nothing may touch.

    Examples
    --------
    >>> zero_bytes(20)
    b'PLPZ\\x14\\x00\\x00\\x00'
    """
    if isinstance(frames, bool) or not (isinstance(frames, int) and 1 <= frames <= MAX_ZERO_FRAMES):
        raise InvalidInput(f"frames must be a whole number from 1 to {MAX_ZERO_FRAMES}; got {frames!r}.")
    return ZERO + struct.pack("<I", frames)


def zero_from_bytes(data: bytes) -> int:
    """Return the number of frames in a message that requests a new zero; raise `InvalidInput` for other messages.

    Examples
    --------
    >>> zero_from_bytes(zero_bytes(20))
    20
    """
    frames = struct.unpack("<I", data[4:])[0] if len(data) == 8 and data[:4] == ZERO else 0
    if not 1 <= frames <= MAX_ZERO_FRAMES:
        raise InvalidInput(f"not a wish for a new zero: PLPZ and a uint32 from 1 to {MAX_ZERO_FRAMES}.")
    return int(frames)


def is_big_endian(data: bytes) -> bool:
    """Return whether the header of a frame is valid if read as big-endian, and only then."""
    if len(data) < HEAD.size or data[:4] != MAGIC:
        return False
    fits = [4 * math.prod(form.unpack_from(data)[3:]) == len(data) - HEAD.size for form in (HEAD, _SWAPPED)]
    return fits == [False, True]
