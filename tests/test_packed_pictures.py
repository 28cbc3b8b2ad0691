"""Pictures of a microscope that are packed: what is damaged is refused, though the library that unpacks fills it with zeros."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.microscopy import read_picture
from palpate.microscopy.packed import lzw_length, packbits_length

cv2 = pytest.importorskip("cv2")
tifffile = pytest.importorskip("tifffile")
LZW, DEFLATE, PACKBITS = 5, 8, 32773


def picture(kind: int) -> np.ndarray:
    """Noise, few levels, nothing: what hardly packs, what does, and runs."""
    return np.random.default_rng(0).integers(0, (60_000, 3, 1)[kind], (80, 61)).astype(np.uint16)


@pytest.mark.parametrize("packing", [LZW, DEFLATE, PACKBITS])
@pytest.mark.parametrize("kind", [0, 1, 2])
def test_packed_pictures_are_read_as_they_were(kind: int, packing: int, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.tif"), picture(kind), [cv2.IMWRITE_TIFF_COMPRESSION, packing])
    np.testing.assert_array_equal(read_picture(tmp_path / "a.tif"), picture(kind))


@pytest.mark.parametrize(("packing", "kind"), [(LZW, 1), (DEFLATE, 0), (PACKBITS, 0)])
def test_a_packed_picture_whose_bytes_broke_is_refused(packing: int, kind: int, tmp_path: Path) -> None:
    """Each way of packing notices it where the stream cannot be: LZW and PackBits have no checksum."""
    path = tmp_path / "a.tif"
    cv2.imwrite(str(path), picture(kind), [cv2.IMWRITE_TIFF_COMPRESSION, packing])
    with tifffile.TiffFile(path) as file:
        start, count = file.pages[0].dataoffsets[0], file.pages[0].databytecounts[0]
    held = bytearray(path.read_bytes())
    for k in range(start + 20, start + min(count, 400)):
        held[k] = (held[k] * 7 + 13) % 256
    path.write_bytes(held)
    with pytest.raises(pp.InvalidInput, match="cannot be unpacked; it is damaged"):
        read_picture(path)


@pytest.mark.parametrize("length", [lzw_length, packbits_length])
def test_streams_of_nothing_and_of_noise(length: object) -> None:
    assert callable(length)
    assert length(b"") == 0
    rng = np.random.default_rng(1)
    for _ in range(50):
        try:
            assert length(rng.bytes(200)) >= 0
        except ValueError:
            continue


def test_a_run_that_ends_early_is_noticed() -> None:
    with pytest.raises(ValueError, match="within a run"):
        packbits_length(bytes([5, 1, 2]))
    with pytest.raises(ValueError, match="not in the table"):
        lzw_length(bytes([0x80, 0x3F, 0xFF, 0xFF]))
