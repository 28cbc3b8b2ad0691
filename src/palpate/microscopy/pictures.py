"""Pictures of a microscope: one, or a pair."""

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
from palpate.camera.stacks import check_axes, check_size
from palpate.errors import InvalidInput, PalpateError
from palpate.microscopy.packed import unpacks
from palpate.sensing.view import opencv

__all__ = ["read_all", "read_pair", "read_picture"]


def read_all(path: Path, most: int = 10_000) -> list[npt.NDArray[Any]]:
    """All pictures of a file or folder as grey levels (row, column)."""
    if not path.is_dir() and ordinary(path).stat().st_size == 0:
        raise InvalidInput(f"{path} is empty.")
    if not is_pictures(path):
        raise InvalidInput(f"{path}: is no picture: .tif, .png and so on.")
    packed = _packed(path) if path.suffix.lower() in (".tif", ".tiff") else None
    if packed is not None:
        return packed
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


def _packed(path: Path) -> list[npt.NDArray[Any]] | None:
    """The pages of a TIFF file that is compressed (LZW, as ImageJ and most microscopes write it), which needs more than tifffile; None of others."""
    cv2 = opencv()
    try:
        import tifffile
    except ImportError as error:
        raise missing("TIFF stacks", error) from error
    try:
        with tifffile.TiffFile(path) as file:
            check_axes(file, path)
            plain = all(page.compression == 1 for page in file.pages)
            for number, page in enumerate(file.pages):
                check_size(int(page.nbytes), f"{path}: page {number}")
            total = 2.0 * sum(page.nbytes for page in file.pages)
            require(total, f"the pictures of {path}", "Save only those at rest and pulled.")
            good = plain or unpacks(path, file.pages)
    except PalpateError:
        raise
    except (tifffile.TiffFileError, OSError, ValueError, AttributeError, IndexError, TypeError) as error:
        raise InvalidInput(
            f"{path}: cannot be read as TIFF ({str(error)[:80]}); it is truncated or damaged."
        ) from error
    if plain:
        return None
    try:
        whole, pages = cv2.imreadmulti(str(path), flags=cv2.IMREAD_UNCHANGED) if good else (False, [])
    except cv2.error:
        whole, pages = False, []
    if not whole or not pages:
        raise InvalidInput(
            f"{path}: cannot be unpacked; it is damaged, or compressed in a way that is not known. Save it without compression."
        )
    return [_plain(page if page.ndim == 2 else page[..., ::-1]) for page in pages]


def _plain(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """8 or 16 bits or single precision, grey."""
    if (image.dtype.kind in "iu" and image.dtype.itemsize > 2) or image.dtype.kind == "f" or image.dtype == np.int16:
        image = image.astype(np.float32)
    return grey(image)


def read_picture(path: str | Path) -> npt.NDArray[Any]:
    """One picture as grey levels (row, column); of a stack there must be one page.

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
    pages = [found] if found.is_dir() else read_all(found, 1)
    if found.is_dir() or len(pages) > 1:
        raise InvalidInput(f"{path}: holds several pictures: give one.")
    return np.asarray(pages[0])


def read_pair(
    paths: Sequence[str | Path], *, frames: tuple[int, int] | None = None
) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Beads at rest and beads that are pulled: two files, or two pictures of one stack or folder.

    Parameters
    ----------
    paths : one or two paths
        Two: at rest (after the cell was taken off), pulled. One: a stack of two pictures in that order, or of more and ``frames``.
    frames : (int, int), optional
        Numbers of both in a stack, from 0; -1 is the last.

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
        pair = [read_picture(p) for p in found]
    elif len(found) == 1:
        pages = read_all(found[0])
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
