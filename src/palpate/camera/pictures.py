"""Read pictures one after another from a video, a folder, a TIFF stack, a camera, or arrays; each with its time.

A picture that cannot be used (it cannot be decoded, or its size differs from that of the first) is returned as a
`Picture` without an image and with the reason, so that no other picture is lost.
"""

from __future__ import annotations

import re
import time as clock
from collections.abc import Callable, Iterable, Iterator, Sized
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._extras import missing
from palpate._files import ordinary
from palpate.camera.messages import picture_frames, picture_topics
from palpate.camera.stacks import check_axes, check_page, check_size, pages_claimed, rate_of, size_claimed
from palpate.errors import InvalidInput
from palpate.recordings.damage import DAMAGE_OF_PACKED
from palpate.recordings.robots import is_bag
from palpate.sensing.view import grey, opencv

__all__ = ["Picture", "Pictures", "is_pictures", "open_pictures", "write_video"]

Image = npt.NDArray[Any]

#: Endings of single pictures, of stacks and of videos.
STILLS = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".webp")
STACKS = (".tif", ".tiff")
VIDEOS = (
    ".mp4",
    ".avi",
    ".mkv",
    ".mov",
    ".webm",
    ".m4v",
    ".mpg",
    ".mpeg",
    ".mjpeg",
    ".wmv",
    ".3gp",
    ".mts",
    ".gif",
    ".apng",
)
#: A camera is given up after this many failed pictures in a row, or after this many seconds without one.
FAILED, SILENT = 10, 3.0
#: Number of bytes at the start of a file that show whether it is animated.
SNIFFED = 2000
DAMAGED = "the video is damaged here"
CODEC = "Convert it once, such as with: ffmpeg -i IN -c:v libx264 -crf 12 OUT.mp4"


def is_pictures(name: str | Path) -> bool:
    """Whether `open_pictures` can read a file or folder: by its ending, a folder with pictures, or an MCAP file or bag
    with a topic of pictures (sensor_msgs/Image of whole numbers, CompressedImage; images of floats are readings of
    taxels).

    Examples
    --------
    >>> from palpate.camera import is_pictures
    >>> is_pictures("press.mp4"), is_pictures("press.nc")
    (True, False)
    """
    path = Path(name)
    if path.suffix.lower() in (*STILLS, *STACKS, *VIDEOS) or re.fullmatch(r"/dev/video\d+", str(name)):
        return True
    if path.is_dir() and any(p.suffix.lower() in (*STILLS, *STACKS) for p in path.iterdir()):
        return True
    return bool(picture_topics(path))


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture of a stream.

    Attributes
    ----------
    index : int
        Its number in the source, from 0.
    time : float
        [s], as the source gives it.
    image : array (row, column) or (row, column, 3), or None
        Grey, or red, green, blue; None if it could not be read.
    fault : str
        Why there is no image, else "".
    """

    index: int
    time: float
    image: Image | None
    fault: str = ""


class Pictures:
    """A source of pictures; iterate over it once, ``with`` closes it.

    Attributes
    ----------
    name : str
        Name of the source, for messages.
    size : (int, int)
        Columns and rows of the first picture.
    count : int or None
        Number of pictures that the source states, or None.
    timed : bool
        Whether times come from the source; otherwise they are the number of the picture over ``rate``, or the number itself.
    notes : list of str
        Errors at the end, such as a cut file.
    """

    def __init__(
        self,
        frames: Iterator[tuple[float | None, Image | None, str]],
        *,
        name: str,
        count: int | None = None,
        rate: float | None = None,
        timed: bool = False,
        close: Callable[[], None] | None = None,
        notes: list[str] | None = None,
    ) -> None:
        self.name, self.count, self.timed = name, count, timed
        self.notes: list[str] = [] if notes is None else notes
        self._frames, self._rate, self._close = frames, rate, close
        self._first = self._next_raw()
        if self._first is None or self._first[1] is None:
            why = self._first[2] if self._first is not None else "it holds no pictures"
            self.close()
            raise InvalidInput(f"{name}: {why}. {' '.join(self.notes)}".strip())
        grey(self._first[1])
        rows, columns = self._first[1].shape[:2]
        self.size = (int(columns), int(rows))

    def _next_raw(self) -> tuple[float | None, Image | None, str] | None:
        return next(self._frames, None)

    def __iter__(self) -> Iterator[Picture]:
        index, raw, last = 0, self._first, -np.inf
        self._first = None
        while raw is not None:
            given, image, fault = raw
            at = given if given is not None else index / self._rate if self._rate else float(index)
            if at <= last:  # two with one time, or a clock that went back: one picture later
                at = last + (1.0 / self._rate if self._rate else 1e-3)
            last = at
            if image is not None and image.shape[1::-1] != self.size:
                got = (
                    f"{image.shape[1]} x {image.shape[0]}" if image.ndim > 1 else f"no picture, of shape {image.shape}"
                )
                fault, image = f"the picture is {got}, the first was {self.size[0]} x {self.size[1]}", None
            yield Picture(index, at, image, fault)
            index += 1
            raw = self._next_raw()
        if self.count is not None and index < self.count and not self.notes:
            self.notes.append(f"{self.name} ends early: {index} of {self.count} pictures could be read.")

    def close(self) -> None:
        """Close the file or camera."""
        if self._close is not None:
            self._close()
            self._close = None

    def __enter__(self) -> Pictures:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_pictures(source: Any, *, rate: float | None = None, topic: str | None = None) -> Pictures:
    """Pictures from a video, a folder, a TIFF stack, a robot's recording, a camera, or arrays.

    Parameters
    ----------
    source : str, Path, int, or iterable of arrays
        A video (.mp4, .avi, .mkv, .mov, .webm, .gif, ...), rotated as its file states; a folder of pictures, in the order of the numbers in their
        names; a .tif stack, or a single picture;
        an MCAP file or a bag of ROS with sensor_msgs/Image or CompressedImage; the number of a camera, or /dev/video0; an array (picture, row, column[, 3]) or any iterable of arrays.
    topic : str, optional
        For an MCAP file or bag with pictures in several topics.
    rate : float, optional
        Pictures a second, for sources without times (folders, stacks, arrays). Default: 1.

    Returns
    -------
    Pictures
        Iterate over it for `Picture` objects.

    Raises
    ------
    InvalidInput
        No such file, nothing in it, a file that is no video, a codec that is not installed, a rate for a source that has times.
    Unsupported
        A library is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.camera import open_pictures
    >>> with open_pictures(np.zeros((3, 20, 30), dtype=np.uint8), rate=10.0) as pictures:
    ...     print(pictures.size, [picture.time for picture in pictures])
    (30, 20) [0.0, 0.1, 0.2]
    """
    if rate is not None and (isinstance(rate, bool) or not (np.isfinite(rate) and rate > 0)):
        raise InvalidInput(f"rate must be a positive number of pictures a second; got {rate!r}.")
    device = isinstance(source, int) or (isinstance(source, str) and re.fullmatch(r"/dev/video\d+", source))
    if isinstance(source, bool):
        raise InvalidInput("a source of pictures is a path, the number of a camera, or arrays; got a bool.")
    if device:
        return _camera(source, rate)
    if not isinstance(source, str | Path):
        return _arrays(source, rate)
    path = Path(source)
    if topic is not None and not (is_bag(path) or path.suffix.lower() == ".mcap"):
        raise InvalidInput(f"topic={topic!r} belongs to an MCAP file or a bag; {path} is neither. Leave it out.")
    if not path.exists():
        raise InvalidInput(
            f"{path}: no such file or folder. For a camera give its number, such as 0, or its device, such as /dev/video0."
        )
    if is_bag(path) or path.suffix.lower() == ".mcap":
        if rate is not None:
            raise InvalidInput(f"{path} has times of its own: leave out rate.")
        notes: list[str] = []
        found, frames = picture_frames(path, topic, notes)
        return Pictures(frames, name=f"{path} {found}", timed=True, notes=notes)
    if path.is_dir():
        return _folder(path, rate)
    ending = path.suffix.lower()
    if ordinary(path).stat().st_size == 0:
        raise InvalidInput(f"{path} is empty: the recording was not finished. Record it again.")
    if ending in STACKS:
        return _stack(path, rate)
    if ending in STILLS:
        return Pictures(_read([path]), name=str(path), count=1, rate=rate)
    if ending in VIDEOS:
        if rate is not None:
            raise InvalidInput(f"{path} has times of its own: leave out rate.")
        return _video(path)
    raise InvalidInput(
        f"{path}: not an ending of pictures. Accepted: videos ({', '.join(VIDEOS)}), pictures ({', '.join(STILLS)}), stacks "
        f"({', '.join(STACKS)}), a folder of pictures, or an .mcap or bag with a topic of them."
    )


# -- one kind of source after another ---------------------------------------------------------------------------------------


def _arrays(source: Any, rate: float | None) -> Pictures:
    if isinstance(source, np.ndarray) and source.ndim < 3:
        raise InvalidInput(f"an array of pictures has shape (picture, row, column[, 3]); got {source.shape}.")
    if not isinstance(source, Iterable):
        raise InvalidInput(
            f"a source of pictures is a path, the number of a camera, or arrays; got {type(source).__name__}."
        )
    count = len(source) if isinstance(source, Sized) else None
    return Pictures(((None, np.asarray(image), "") for image in source), name="pictures", count=count, rate=rate)


def _natural(path: Path) -> list[Any]:
    """Sort key that orders frame2 before frame10."""
    return [int(part) if part.isdigit() else part.lower() for part in re.split(r"(\d+)", path.name)]


def _folder(path: Path, rate: float | None) -> Pictures:
    found = sorted((p for p in path.iterdir() if p.suffix.lower() in (*STILLS, *STACKS) and p.is_file()), key=_natural)
    if not found:
        raise InvalidInput(f"{path} holds no pictures ({', '.join((*STILLS, *STACKS))}).")
    return Pictures(_read(found), name=str(path), count=len(found), rate=rate)


def _read(paths: list[Path]) -> Iterator[tuple[None, Image | None, str]]:
    cv2 = opencv()
    for path in paths:
        # not imread: it prints on stderr, and does not open every name on Windows
        try:
            several = _check_still(path)
        except InvalidInput as error:
            yield None, None, str(error).rstrip(".")
            continue
        if several:
            yield (
                None,
                None,
                f"{path.name} holds {several} pictures, of which one alone would be read: give this stack by itself",
            )
            continue
        data = np.fromfile(path, dtype=np.uint8)
        if _moves(data[:SNIFFED].tobytes()):
            yield (
                None,
                None,
                f"{path.name} holds several pictures, of which one alone would be read: save it as .gif or .mp4",
            )
            continue
        try:
            # Rotated as the camera was held (EXIF); transparency is dropped.
            image = cv2.imdecode(data, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH) if data.size else None
        except cv2.error:  # more pixels than OpenCV accepts
            image = None
        if image is None:
            yield None, None, f"{path.name} cannot be decoded as a picture: it is damaged, cut off or too large"
            continue
        yield None, np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image), ""


def _moves(head: bytes) -> bool:
    """Whether a .webp or .png that begins with these bytes is animated."""
    if head[:4] == b"RIFF" and head[8:16] == b"WEBPVP8X":
        return bool(head[20] & 2)
    return head[:4] == b"\x89PNG" and b"acTL" in head[: head.find(b"IDAT")]


def _check_still(path: Path) -> int:
    """Raise an error for a single-picture file that is, or unpacks to, more than a picture can be. Return the number of
    pictures in a TIFF file of several, else 0.
    """
    check_size(path.stat().st_size, path.name)
    if path.suffix.lower() not in STACKS:
        with path.open("rb") as file:
            check_size(size_claimed(file.read(1 << 16)), path.name)
        return 0
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF stacks", error) from error
    try:
        with tifffile.TiffFile(path) as file, path.open("rb") as raw:
            check_page(raw, file.pages[0], path.name)
            # smaller pages are previews
            whole = sum(page.shape == file.pages[0].shape for page in file.pages)
            return whole if whole > 1 else 0
    except InvalidInput:
        raise
    except (tifffile.TiffFileError, OSError, ValueError, IndexError, TypeError, AttributeError):
        return 0  # errors appear when it is unpacked


def _stack(path: Path, rate: float | None) -> Pictures:
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF stacks", error) from error
    file = None
    try:
        file = tifffile.TiffFile(path)
        pages = file.pages
        count = len(pages)
        claimed = max(count, pages_claimed(file))
        check_axes(file, path)
        if rate is None:
            rate = rate_of(file)
    except (tifffile.TiffFileError, OSError, ValueError, IndexError, KeyError, TypeError, AttributeError) as error:
        if file is not None:
            file.close()
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"{path}: cannot be read as TIFF ({error}); it is truncated or damaged.") from error

    def frames() -> Iterator[tuple[None, Image | None, str]]:
        for number in range(count):
            try:
                check_page(file.filehandle, pages[number], f"page {number}")
                image = np.asarray(pages[number].asarray())
            except InvalidInput as error:
                yield None, None, str(error).rstrip(".")
                continue
            except (tifffile.TiffFileError, *DAMAGE_OF_PACKED) as error:
                yield (
                    None,
                    None,
                    f"page {number} cannot be read ({error}): it is damaged, or packed in a way that is not known; save it without compression",
                )
                continue
            yield None, image, ""

    return Pictures(frames(), name=str(path), count=claimed, rate=rate, close=file.close)


def _video(path: Path) -> Pictures:
    try:
        import av
    except ImportError as error:
        raise missing("videos", error) from error
    try:
        container = av.open(str(path))
    except (av.error.FFmpegError, OSError) as error:
        raise InvalidInput(
            f"{path}: cannot be opened as a video ({_plain(error)}). A recording that was cut off has no index: record .mkv, which needs none, or "
            "repair it."
        ) from error
    if not container.streams.video:
        container.close()
        raise InvalidInput(f"{path} holds no pictures, only {len(container.streams)} other streams.")
    stream = container.streams.video[0]
    if stream.codec_context is None:
        container.close()
        raise InvalidInput(f"{path}: no codec for this video is installed. {CODEC}")
    stream.thread_type = "AUTO"
    notes: list[str] = []
    rate = float(stream.average_rate) if stream.average_rate else None

    def frames() -> Iterator[tuple[float | None, Image | None, str]]:
        number, last, broken = 0, None, ""
        try:
            for frame in _decoded(container, stream):
                number += 1
                # AVI has no times, only an order of decoding: use its frame rate.
                timed = not isinstance(frame, str) and frame.time is not None and container.format.name != "avi"
                at = float(frame.time) if timed else None
                if isinstance(frame, str):
                    broken = frame
                elif not broken or frame.key_frame:
                    broken = DAMAGED if frame.is_corrupt else ""
                if broken:
                    # Later pictures depend on it, up to the next key frame.
                    last = at if at is not None else last + 1.0 / rate if last is not None and rate else None
                    yield last, None, broken
                    continue
                plain = frame.format.name in ("gray", "gray8", "gray10le", "gray12le", "gray16le")
                image = frame.to_ndarray(format="gray" if plain else "rgb24")
                yield at, _turned(image, frame), ""
                last = at
            short = _short(container, rate, last)
            if short is not None:
                notes.append(
                    f"{path} was cut off: it ends {short:.3g} s early, after {number} pictures; those are used."
                )
        except (av.error.FFmpegError, OSError) as error:
            notes.append(
                f"{path} cannot be decoded after {number} pictures ({_plain(error)}): it is damaged or was cut off; those before are used."
            )

    return Pictures(
        frames(), name=str(path), count=stream.frames or None, rate=rate, timed=True, close=container.close, notes=notes
    )


def _turned(image: Image, frame: Any) -> Image:
    """Rotate a picture for display: phones film on their side and store a matrix (to column, to row) with each
    picture.
    """
    said = next((bytes(d) for d in frame.side_data if getattr(d.type, "name", "") == "DISPLAYMATRIX"), None)
    if said is None:
        return image
    (a, b), (c, d) = np.frombuffer(said, dtype="<i4")[:9].reshape(3, 3)[:2, :2]
    if abs(b) + abs(c) > abs(a) + abs(d):  # columns become rows
        image = np.swapaxes(image, 0, 1)
        a, d = c, b
    return np.ascontiguousarray(image[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1])


def _decoded(container: Any, stream: Any) -> Iterator[Any]:
    """Pictures of a video; if one cannot be decoded, the reason and then the following ones."""
    import av

    failed = 0
    for packet in container.demux(stream):
        try:
            frames = packet.decode()
        except av.error.InvalidDataError as error:
            failed += 1
            if failed > FAILED:
                raise
            yield f"{DAMAGED} ({_plain(error)})"
            continue
        if frames:
            failed = 0
        yield from frames


def _short(container: Any, rate: float | None, last: float | None) -> float | None:
    """Seconds missing at the end of a video without a number of pictures (Matroska), by the length in its header."""
    if container.streams.video[0].frames or not container.duration or last is None or not rate:
        return None
    short = 1e-6 * container.duration - (last + 1.0 / rate)
    # The sound may be longer than the pictures.
    return float(short) if short > (0.75 / rate if len(container.streams) == 1 else 1.0) else None


def _plain(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error)


def _camera(source: Any, rate: float | None) -> Pictures:
    cv2 = opencv()
    if rate is not None:
        raise InvalidInput("a camera has times of its own: leave out rate.")
    capture = cv2.VideoCapture(source)
    if not capture.isOpened():
        capture.release()
        raise InvalidInput(
            f"camera {source}: cannot be opened. Is it connected, is another program using it, and may you read it (group video)?"
        )

    notes: list[str] = []

    def frames() -> Iterator[tuple[float | None, Image | None, str]]:
        started = last = clock.monotonic()
        failed = 0
        while True:
            there, image = capture.read()
            now = clock.monotonic()
            if there and image is not None and image.size:
                failed, last = 0, now
                yield now - started, np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image), ""
                continue
            failed += 1
            # A driver may fail at once, or wait for seconds each time.
            if failed > FAILED or now - last > SILENT:
                notes.append(
                    f"camera {source} gives no pictures any more: it was unplugged, or another program took it. Plug it in and start again."
                )
                return
            yield now - started, None, "the camera gave no picture"

    return Pictures(frames(), name=f"camera {source}", timed=True, close=capture.release, notes=notes)


# -- out --------------------------------------------------------------------------------------------------------------------


def write_video(path: str | Path, images: Iterable[Image], *, rate: float = 30.0, quality: int = 14) -> None:
    """Write 8-bit pictures as a video; the container follows the file name (.mp4, .mkv, .avi).

    Parameters
    ----------
    path : str or Path
    images : iterable of array (row, column) or (row, column, 3)
    rate : float
        Pictures a second.
    quality : int
        Constant rate factor of H.264, 0 (nothing lost) to 51.

    Raises
    ------
    InvalidInput
        No pictures, or pictures of different sizes.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from palpate.camera import open_pictures, write_video
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_video(f"{folder}/press.mp4", np.full((4, 48, 64), 90, dtype=np.uint8), rate=20.0)
    ...     with open_pictures(f"{folder}/press.mp4") as pictures:
    ...         times = [round(picture.time, 3) for picture in pictures]
    >>> times
    [0.0, 0.05, 0.1, 0.15]
    """
    try:
        import av
    except ImportError as error:
        raise missing("videos", error) from error
    from palpate.recordings.files import atomically

    def write(name: str) -> None:
        size = None
        with av.open(name, mode="w", format=_container(path)) as container:
            stream: Any = None
            for image in images:
                values = np.asarray(image)
                colour = values.ndim == 3 and values.shape[-1] == 3
                if values.dtype != np.uint8 or not (values.ndim == 2 or colour) or not values.size:
                    raise InvalidInput(
                        f"a video takes 8-bit pictures, (row, column) or (row, column, 3); got {values.dtype} of shape {values.shape}."
                    )
                if stream is None:
                    size = values.shape[:2]
                    stream = _h264(container, rate, quality)
                    stream.height, stream.width = size
                    # halved colour needs even sides
                    stream.pix_fmt = "yuv444p" if size[0] % 2 or size[1] % 2 else "yuv420p"
                elif values.shape[:2] != size:
                    raise InvalidInput(f"the pictures of a video have one size; got {size} and {values.shape[:2]}.")
                frame = av.VideoFrame.from_ndarray(
                    np.ascontiguousarray(values), format="gray" if values.ndim == 2 else "rgb24"
                )
                container.mux(stream.encode(frame))
            if stream is None:
                raise InvalidInput("there are no pictures to write.")
            container.mux(stream.encode(None))

    atomically(path, write)


def _container(path: str | Path) -> str:
    known = {".mp4": "mp4", ".mkv": "matroska", ".avi": "avi", ".mov": "mov"}
    ending = Path(path).suffix.lower()
    if ending not in known:
        raise InvalidInput(f"{path}: a video is written as {', '.join(known)}.")
    return known[ending]


def _h264(container: Any, rate: float, quality: int) -> Any:
    import av

    exact = Fraction(rate).limit_denominator(1000)
    try:
        return container.add_stream("libx264", rate=exact, options={"crf": str(quality), "preset": "fast", "bf": "0"})
    except (av.error.FFmpegError, ValueError):  # built without it
        stream = container.add_stream("mpeg4", rate=exact, options={"qscale": "3"})
        stream.bit_rate = 8_000_000
        return stream
