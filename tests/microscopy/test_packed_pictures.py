"""Pictures of a microscope that are packed: all ways of packing are read, what is damaged is refused."""

from __future__ import annotations

import functools
import lzma
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.camera import open_pictures
from palpate.camera.stacks import size_claimed
from palpate.microscopy import is_field, read_field, read_picture

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
    with pytest.raises(pp.InvalidInput, match="it is damaged, or packed"):
        read_picture(path)


@functools.cache
def bomb(xz: bool) -> bytes:
    """40 MiB of zeros, packed."""
    return (lzma.compress if xz else zlib.compress)(bytes(40 << 20))


def tiff(path: Path, width: int, height: int, data: bytes, *, packing: int = DEFLATE, bits: int = 8) -> None:
    """A TIFF file of one strip, whatever its bytes unpack to."""
    tags = [
        (256, width), (257, height), (258, bits), (259, packing), (262, 1), (273, 200), (277, 1), (278, height), (279, len(data)), (339, 3 if bits == 32 else 1),
    ]  # fmt: skip
    head = b"II*\0" + struct.pack("<IH", 8, len(tags)) + b"".join(struct.pack("<HHII", k, 4, 1, v) for k, v in tags)
    path.write_bytes(head.ljust(200, b"\0") + data)


@pytest.mark.parametrize("bits", [8, 32])
@pytest.mark.parametrize("packing", [DEFLATE, 32946, 34925])
@pytest.mark.long
def test_strips_that_unpack_to_more_than_they_claim_are_refused_early(tmp_path: Path, bits: int, packing: int) -> None:
    path = tmp_path / "a.tif"
    tiff(path, 64, 64, bomb(packing == 34925), packing=packing, bits=bits)
    for read in (read_picture, lambda p: list(open_pictures(p)), lambda p: read_field(p, pixel=1e-7)):
        with pytest.raises(pp.InvalidInput, match="more than the 64 x 64 pixels"):
            read(path)
    # what they claim is read, and counted no further
    tiff(path, 64, 64, zlib.compress(bytes(64 * 64)))
    assert read_picture(path).shape == (64, 64)


@pytest.mark.parametrize(("packing", "bits"), [(DEFLATE, 8), (DEFLATE, 32), (1, 16), (LZW, 8)])
def test_a_picture_that_claims_gigabytes_is_refused_by_its_head(tmp_path: Path, packing: int, bits: int) -> None:
    path = tmp_path / "a.tif"
    tiff(path, 60_000, 60_000, zlib.compress(bytes(1000)), packing=packing, bits=bits)
    for read in (read_picture, open_pictures, *([lambda p: is_field([p])] if bits == 32 else [])):
        with pytest.raises(pp.InvalidInput, match="GB, more than a picture"):
            read(path)


def test_heads_of_other_pictures_are_read_before_they_are_unpacked(tmp_path: Path) -> None:
    small = np.random.default_rng(0).integers(0, 255, (40, 50, 3)).astype(np.uint8)
    for ending, size in ((".png", 6000), (".jpg", 6000), (".bmp", 6000), (".ppm", 6000), (".pgm", 2000)):
        path = tmp_path / f"a{ending}"
        cv2.imwrite(str(path), small if size == 6000 else small[..., 0])
        assert size_claimed(path.read_bytes()) == size, ending
        read_picture(path)
    head = b"IHDR" + struct.pack(">IIBBBBB", 50_000, 50_000, 8, 2, 0, 0, 0)
    path = tmp_path / "b.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + head + struct.pack(">I", zlib.crc32(head)))
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "0.png").write_bytes(path.read_bytes())
    for read, source in ((read_picture, path), (open_pictures, path), (open_pictures, folder)):
        with pytest.raises(pp.InvalidInput, match=r"7\.5 GB"):
            read(source)


def test_fields_that_claim_gigabytes_are_refused_by_their_head(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("u.npy", bytes(100))
        archive.filelist[0].file_size = 3 << 30  # written into the directory at the end
    inner = struct.pack("<II", 14, 3 << 30) + bytes(64)
    packed = zlib.compress(inner)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    (tmp_path / "a.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    for name in ("a.npz", "a.mat"):
        with pytest.raises(pp.InvalidInput, match="GB, more than"):
            read_field(tmp_path / name, pixel=1e-7)


def test_stacks_that_are_broken_are_refused_in_words(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.random.default_rng(0).integers(0, 255, (2, 40, 50)), compression="deflate")
    whole = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "none.tif").write_bytes(whole[:4] + bytes(4))
    with pytest.raises(pp.InvalidInput, match="truncated or damaged"):
        open_pictures(tmp_path / "none.tif")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        start, count = file.pages[0].dataoffsets[0], file.pages[0].databytecounts[0]
    (tmp_path / "cut.tif").write_bytes(whole[: start + 10] + bytes(count - 10) + whole[start + count :])
    with pytest.raises(pp.InvalidInput, match="cannot be read"):
        open_pictures(tmp_path / "cut.tif")
