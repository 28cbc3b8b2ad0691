"""Read pictures of a microscope: a single one, or a pair."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._extras import missing
from palpate._files import ordinary
from palpate._memory import require
from palpate.camera import grey, is_pictures, open_pictures
from palpate.camera.stacks import check_size
from palpate.errors import InvalidInput, PalpateError

__all__ = ["read_all", "read_pair", "read_picture"]


def read_all(path: Path, most: int = 10_000, *, channel: int | None = None) -> list[npt.NDArray[Any]]:
    """Read all pictures of a file or folder as grey levels (row, column); ``channel`` counts from 1."""
    if not path.is_dir() and ordinary(path).stat().st_size == 0:
        raise InvalidInput(f"{path} is empty.")
    if not is_pictures(path):
        raise InvalidInput(f"{path}: is no picture: .tif, .png and so on.")
    if channel is not None:
        return _of_channel(path, channel)
    if path.suffix.lower() in (".tif", ".tiff"):
        _check_stack(path)
    out = []
    with open_pictures(path) as pictures:
        for picture in pictures:
            if picture.image is None:
                raise InvalidInput(f"{path}: picture {picture.index} cannot be used: {picture.fault}.")
            out.append(_plain(picture.image))
            if len(out) > most:
                break
    if not out:
        raise InvalidInput(f"{path}: holds no picture.")
    return out


def _of_channel(path: Path, channel: int) -> list[npt.NDArray[Any]]:
    """Return the pictures of one channel of a TIFF file, ordered by time, then by depth."""
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF stacks", error) from error
    if path.suffix.lower() not in (".tif", ".tiff"):
        raise InvalidInput(f"{path}: channel (--channel) picks a channel of a TIFF file; leave it out.")
    try:
        with tifffile.TiffFile(path) as file:
            series = file.series[0]
            axes = series.axes
            for number, page in enumerate(series.pages):
                if page is not None:
                    check_size(int(page.nbytes), f"{path}: page {number}")
            at = axes.find("C") if "C" in axes else axes.find("S")
            if at < 0:
                raise InvalidInput(
                    f"{path}: says nothing of channels (its axes are {axes}): leave out channel (--channel)."
                )
            if not 1 <= channel <= series.shape[at]:
                raise InvalidInput(
                    f"{path}: holds {series.shape[at]} channels: channel (--channel) is from 1 to {series.shape[at]}; got {channel}."
                )
            require(2.0 * series.nbytes, f"the pictures of {path}", "Save only the channel of the beads.")
            values = np.take(series.asarray(), channel - 1, axis=at)
    except PalpateError:
        raise
    except (tifffile.TiffFileError, OSError, ValueError, AttributeError, IndexError, TypeError, KeyError) as error:
        raise InvalidInput(
            f"{path}: cannot be read as TIFF ({str(error)[:80]}); it is truncated or damaged."
        ) from error
    left = axes.replace(axes[at], "", 1)
    long = {axis: n for axis, n in zip(left, values.shape) if axis not in "YX" and n > 1}
    if len(long) > 1:
        raise InvalidInput(
            f"{path}: holds {' and '.join(f'{n} along {axis}' for axis, n in long.items())} of each channel: save one plane by itself (ImageJ: Image > Duplicate)."
        )
    return [_plain(np.ascontiguousarray(page)) for page in values.reshape(-1, *values.shape[-2:])]


def _check_stack(path: Path) -> None:
    """Raise an error for a TIFF file of several channels, or for one that needs more memory than there is."""
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF stacks", error) from error
    try:
        with tifffile.TiffFile(path) as file:
            series = file.series[0]
            count = dict(zip(series.axes, series.shape)).get("C", 1)
            if count > 1:
                raise InvalidInput(
                    f"{path}: holds {count} channels (its axes are {series.axes}): say which shows the beads with channel=1 to channel={count} (--channel 1), or save it by itself (ImageJ: Image > Color > Split Channels)."
                )
            for number, page in enumerate(file.pages):
                check_size(int(page.nbytes), f"{path}: page {number}")
            total = 2.0 * sum(page.nbytes for page in file.pages)
            require(total, f"the pictures of {path}", "Save only those at rest and pulled.")
    except PalpateError:
        raise
    except (tifffile.TiffFileError, OSError, ValueError, AttributeError, IndexError, TypeError) as error:
        raise InvalidInput(
            f"{path}: cannot be read as TIFF ({str(error)[:80]}); it is truncated or damaged."
        ) from error


def _plain(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the picture as grey levels of 8 or 16 bits or single precision."""
    if (image.dtype.kind in "iu" and image.dtype.itemsize > 2) or image.dtype.kind == "f" or image.dtype == np.int16:
        image = image.astype(np.float32)
    return grey(image)


def read_picture(path: str | Path, *, channel: int | None = None) -> npt.NDArray[Any]:
    """Read one picture as grey levels (row, column); a stack must have a single page. ``channel`` selects one of
    several channels, counted from 1.

    Raises
    ------
    InvalidInput
        No such file, a damaged one, or one of several pictures.

    Examples
    --------
    >>> from palpate.microscopy import read_picture
    >>> read_picture("cell.tif")  # doctest: +SKIP
    """
    found = Path(path)
    pages = [found] if found.is_dir() else read_all(found, 1, channel=channel)
    if found.is_dir() or len(pages) > 1:
        raise InvalidInput(f"{path}: holds several pictures: give one.")
    return np.asarray(pages[0])


def read_pair(
    paths: Sequence[str | Path], *, frames: tuple[int, int] | None = None, channel: int | None = None
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Read the pictures of the beads at rest and while the cell pulls: from two files, or as two pictures of one stack
    or folder.

    Parameters
    ----------
    paths : one or two paths
        Two: at rest (after the cell was taken off), pulled. One: a stack of two pictures in that order, or of more and ``frames``.
    frames : (int, int), optional
        Numbers of both in a stack, from 0; -1 is the last.
    channel : int, optional
        Which channel shows the beads, from 1, of TIFF files that hold several; channels are never guessed.

    Raises
    ------
    InvalidInput
        No such file, a stack of one picture, a stack of several without ``frames``, pictures of different sizes.

    Examples
    --------
    >>> from palpate.microscopy import read_pair
    >>> rest, pulled = read_pair(["beads.tif"], frames=(-1, 0))  # doctest: +SKIP
    """
    found = [Path(p) for p in paths]
    if len(found) == 2:
        if frames is not None:
            raise InvalidInput("frames= picks two pictures of one stack; two files are a pair.")
        pair = [read_picture(p, channel=channel) for p in found]
    elif len(found) == 1:
        pages = read_all(found[0], channel=channel)
        if len(pages) < 2:
            raise InvalidInput(
                f"{found[0]}: holds one picture. Displacements need two: the beads at rest (without the cell) and pulled; give both files."
            )
        if frames is None and len(pages) > 2:
            raise InvalidInput(
                f"{found[0]}: holds {len(pages)} pictures: say which shows the beads at rest and which pulled, such as frames=(-1, 0) (--frames=-1,0)."
            )
        picks = frames or (0, 1)
        if any(not -len(pages) <= p < len(pages) for p in picks) or len({p % len(pages) for p in picks}) != 2:
            raise InvalidInput(
                f"{found[0]}: frames must be two different numbers from 0 to {len(pages) - 1}; got {picks}."
            )
        pair = [pages[p] for p in picks]
    else:
        raise InvalidInput(f"a pair is one stack or two files; got {len(found)}.")
    if pair[0].shape != pair[1].shape:
        raise InvalidInput(
            f"the pictures have {pair[0].shape[1]} x {pair[0].shape[0]} and {pair[1].shape[1]} x {pair[1].shape[0]} pixels: both must show the same field of view."
        )
    return pair[0], pair[1]
