"""Read pictures recorded by a robot: sensor_msgs/Image and CompressedImage in MCAP files and bags, without ROS
installed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.errors import InvalidInput
from palpate.recordings.robots import is_bag, messages, topics
from palpate.sensing.view import opencv

__all__ = ["decoded", "picture_frames", "picture_topics"]

Image = npt.NDArray[Any]
IMAGE_TYPES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
#: Encodings of sensor_msgs/Image: number type, numbers per pixel, and their indices in the order red, green, blue.
ENCODINGS = {
    "mono8": ("u1", 1, (0,)),
    "8UC1": ("u1", 1, (0,)),
    "mono16": ("u2", 1, (0,)),
    "16UC1": ("u2", 1, (0,)),
    "rgb8": ("u1", 3, (0, 1, 2)),
    "bgr8": ("u1", 3, (2, 1, 0)),
    "8UC3": ("u1", 3, (2, 1, 0)),
    "rgba8": ("u1", 4, (0, 1, 2)),
    "bgra8": ("u1", 4, (2, 1, 0)),
    "8UC4": ("u1", 4, (2, 1, 0)),
    "rgb16": ("u2", 3, (0, 1, 2)),
    "bgr16": ("u2", 3, (2, 1, 0)),
}
#: Mosaics with one colour filter per pixel, and OpenCV's name of the conversion (it names a mosaic by its second row).
MOSAICS = {"bayer_rggb8": "BayerBG", "bayer_bggr8": "BayerRG", "bayer_gbrg8": "BayerGR", "bayer_grbg8": "BayerGB"}


def decoded(message: Any) -> Image:
    """The picture (row, column) or (row, column, 3) in a message; raises an error for floats, which are readings of
    taxels.

    Raises
    ------
    InvalidInput
        An encoding that is not read, or bytes that are no picture.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from palpate.camera.messages import decoded
    >>> decoded(SimpleNamespace(height=1, width=2, encoding="bgr8", step=6, is_bigendian=0, data=bytes(range(6)))).tolist()
    [[[2, 1, 0], [5, 4, 3]]]
    """
    given = message.data
    data = np.frombuffer(given, dtype=np.uint8) if isinstance(given, bytes) else np.asarray(given, dtype=np.uint8)
    encoding = getattr(message, "encoding", None)
    if encoding is None:
        return _unpacked(data, str(message.format))
    mosaic = MOSAICS.get(encoding)
    if encoding not in ENCODINGS and mosaic is None:
        raise InvalidInput(
            f"pictures in {encoding!r} are not read; accepted are {', '.join((*ENCODINGS, *MOSAICS))}. Convert them, such as with image_proc, before they are recorded."
        )
    kind, count, order = ENCODINGS.get(encoding, ("u1", 1, (0,)))
    rows, columns, step = int(message.height), int(message.width), int(message.step)
    size = np.dtype(kind).itemsize
    if (
        rows < 1
        or columns < 1
        or step < columns * count * size
        or len(data) < step * (rows - 1) + columns * count * size
    ):
        raise InvalidInput(
            f"a picture of {columns} x {rows} in {encoding} takes {columns * count * size} bytes a row; the message has {len(data)} bytes in rows of {step}."
        )
    whole = np.zeros(step * rows, dtype=np.uint8)
    whole[: min(len(data), len(whole))] = data[: len(whole)]
    row = np.ascontiguousarray(whole.reshape(rows, step)[:, : columns * count * size])
    image = (
        row.view(np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<"))
        .astype(kind)
        .reshape(rows, columns, count)
    )
    if mosaic is not None:
        cv2 = opencv()
        return np.asarray(cv2.cvtColor(image[..., 0], getattr(cv2, f"COLOR_{mosaic}2RGB")))
    return np.ascontiguousarray(image[..., 0] if count == 1 else image[..., list(order)])


def _unpacked(data: npt.NDArray[np.uint8], said: str) -> Image:
    """A JPEG or PNG of a CompressedImage."""
    cv2 = opencv()
    try:
        image = cv2.imdecode(data, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH) if len(data) else None
    except cv2.error:
        image = None
    if image is None:
        raise InvalidInput(
            f"a compressed picture ({said or 'of no named format'}) cannot be decoded: it is damaged, or no JPEG or PNG"
        )
    return np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image)


def picture_topics(path: str | Path) -> list[str]:
    """Topics of a file or bag with pictures: compressed ones, or images of whole numbers.

    Examples
    --------
    >>> from palpate.camera.messages import picture_topics
    >>> picture_topics("missing.nc")
    []
    """
    found = Path(path)
    if not (is_bag(found) or (found.suffix.lower() == ".mcap" and found.is_file())):
        return []
    out = []
    for topic, kind in topics(found).items():
        if kind.replace("/msg/", "/") not in [k.replace("/msg/", "/") for k in IMAGE_TYPES]:
            continue
        first = next(messages(found, topic), None)
        encoding = "" if first is None else getattr(first[1], "encoding", "compressed")
        if encoding == "compressed" or encoding in ENCODINGS or encoding in MOSAICS:
            out.append(topic)
    return out


def picture_frames(
    path: Path, topic: str | None, notes: list[str]
) -> tuple[str, Iterator[tuple[float | None, Image | None, str]]]:
    """The topic, and for each message (time [s], picture or None, reason): at the times in the headers, or of
    recording if these are 0.

    An early end is explained in ``notes``.

    Raises
    ------
    InvalidInput
        No pictures, several topics of them and none named, or one that there is not.
    """
    there = picture_topics(path)
    if topic is None and len(there) != 1:
        others = ", ".join(f"{t} ({k})" for t, k in topics(path).items()) or "no messages"
        raise InvalidInput(
            f'{path} holds pictures in {len(there)} topics ({", ".join(there)}): name one, open_pictures(..., topic="{there[0]}").'
            if there
            else f"{path} holds no pictures (sensor_msgs/Image in whole numbers, or CompressedImage); it has {others}."
        )
    if topic is not None and topic not in there:
        raise InvalidInput(f"{path} holds no pictures in {topic}; it does in {', '.join(there) or 'no topic'}.")
    wanted = there[0] if topic is None else topic

    def frames() -> Iterator[tuple[float | None, Image | None, str]]:
        number = 0
        try:
            for recorded, message in messages(path, wanted):
                stamp = message.header.stamp
                taken = int(stamp.sec) + 1e-9 * int(stamp.nanosec)
                at = taken if taken > 0 else recorded
                number += 1
                try:
                    image = decoded(message)
                except InvalidInput as error:
                    yield at, None, str(error).rstrip(".")
                    continue
                yield at, image, ""
        except InvalidInput as error:
            notes.append(f"{error} The {number} pictures before it are used.")

    return wanted, frames()
