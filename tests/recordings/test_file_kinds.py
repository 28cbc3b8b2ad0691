"""What is no ordinary file, or far too large, is refused before anything of it is read."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate._files import TEXT, ordinary
from palpate.errors import InvalidInput
from palpate.microscopy import read_field, read_mask
from palpate.recordings import read_recording, read_table

PIPE = "is a pipe or a device, not a file"
READERS = {
    "skin.toml": pp.Skin.from_file,
    "r.nc": read_recording,
    "r.csv": read_recording,
    "r.npz": read_recording,
    "r.mcap": read_recording,
    "table.csv": lambda path: read_table(path, columns=["x", "y", "u"], channels=["displacement_x"]),
    "field.npy": lambda path: read_field(path, pixel=1e-7, step=8, unit="px"),
    "field.csv": lambda path: read_field(path, pixel=1e-7, step=8, unit="px"),
    "mask.json": read_mask,
    "mask.npy": read_mask,
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("name", list(READERS))
def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(InvalidInput, match=PIPE):
        READERS[name](tmp_path / name)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no devices")
def test_a_device_without_end_is_refused() -> None:
    for read in (pp.Skin.from_file, read_recording):
        with pytest.raises(InvalidInput, match=PIPE):
            read("/dev/zero")


def test_a_pipe_of_pictures_is_refused(tmp_path: Path) -> None:
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes with names")
    from palpate.camera import open_pictures

    os.mkfifo(tmp_path / "press.mp4")
    with pytest.raises(InvalidInput, match=PIPE):
        open_pictures(tmp_path / "press.mp4")


def test_a_recording_in_place_of_a_skin_is_refused_by_its_size(tmp_path: Path) -> None:
    path = tmp_path / "skin.toml"
    with path.open("wb") as file:
        file.truncate(3 * 10**9)  # takes no room on the disk
    with pytest.raises(InvalidInput, match=r"has 3\.0 GB, but a skin file has at most 67 MB"):
        pp.Skin.from_file(path)
    assert ordinary(path).stat().st_size > TEXT


@pytest.mark.long
def test_a_table_of_gigabytes_that_is_no_text_is_refused_by_its_first_line(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    with path.open("wb") as file:
        file.write(b"time (s)" + b" " * 5000 + b"\0")
        file.truncate(3 * 10**9)
    with pytest.raises(InvalidInput):
        read_recording(path)


def test_an_ordinary_file_is_read_through_a_link(tmp_path: Path) -> None:
    np.save(tmp_path / "m.npy", np.ones((4, 4), dtype=bool))
    (tmp_path / "link.npy").symlink_to("m.npy")
    assert np.asarray(read_mask(tmp_path / "link.npy")).any()
    with pytest.raises(InvalidInput, match="no such file"):
        ordinary(tmp_path / "none")
    with pytest.raises(InvalidInput, match="is a folder"):
        ordinary(tmp_path)
