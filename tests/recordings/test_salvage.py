"""What was lost of a recording that was salvaged is said, by palpate convert and in the recording itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from command_line import run
from palpate.recordings import read_recording, recorder, write_recording


def recording(frames: int = 60) -> pp.Recording:
    readings = np.random.default_rng(0).standard_normal((frames, 1, 30)).astype(np.float32)
    return pp.Recording(readings=readings, channels=["stress_zz"], time=0.01 * np.arange(frames), meta={"hand": "left"})


@pytest.mark.parametrize("name", ["r.nc", "r.csv", "r.npz"])
def test_of_a_whole_file_nothing_is_lost(name: str, tmp_path: Path) -> None:
    write_recording(recording(), tmp_path / name)
    saved = read_recording(tmp_path / name, salvage=True)
    assert saved.meta["salvaged"].startswith("nothing is lost")
    assert saved.meta["hand"] == "left"
    assert len(saved.time) == 60
    assert "salvaged" not in read_recording(tmp_path / name).meta


@pytest.mark.parametrize("kept", [0.99, 0.5])
@pytest.mark.long
def test_a_torn_mcap(kept: float, tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    rng = np.random.default_rng(1)
    with recorder(path, ["stress_zz"]) as out:
        for i in range(200):
            out.readings(0.01 * i, rng.standard_normal((1, 16, 16)).astype(np.float32))
    assert read_recording(path, salvage=True).meta["salvaged"] == "nothing is lost"
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    saved = read_recording(path, salvage=True)
    words = saved.meta["salvaged"].split()
    assert words[1:6] == ["bytes", "from", "the", "damage", "on,"]
    # the part of the file that is gone altogether is not known
    assert 0 < int(words[7]) <= 200 - len(saved.time)
    done = run("convert", "r.mcap", "saved.npz", "--salvage", cwd=tmp_path)
    assert f"salvaged        {saved.meta['salvaged']}" in done.stdout
    assert read_recording(tmp_path / "saved.npz").meta["salvaged"] == saved.meta["salvaged"]


@pytest.mark.parametrize("suffix", [".nc", ".zarr"])
def test_frames_that_were_begun(suffix: str, tmp_path: Path) -> None:
    """A stream whose last times were not written: they read as fill values."""
    path = tmp_path / f"r{suffix}"
    with recorder(path, ["stress_zz"]) as out:
        for i in range(50):
            out.readings(0.01 * i, np.full((1, 30), float(i), dtype=np.float32))
    if suffix == ".nc":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "r+") as file:
            file.attrs.pop("palpate_crc32", None)
            file["time"][43:] = np.nan
    else:
        zarr = pytest.importorskip("zarr")
        root = zarr.open_group(str(path), mode="r+")
        root.attrs.pop("palpate_crc32", None)
        root["time"][43:] = np.nan
    saved = read_recording(path, salvage=True)
    assert len(saved.time) == 43
    assert saved.meta["salvaged"] == "7 of 50 frames that it has room for were not written whole"


def test_numbers_that_are_not_what_was_written(tmp_path: Path) -> None:
    """Damage that leaves every frame in place: no frame is lost, but none can be trusted."""
    path = tmp_path / "r.csv"
    write_recording(recording(5), path)
    lines = path.read_text().splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.startswith("0.02"))
    lines[at] = lines[at].replace(",", ",1", 1) if ",-" not in lines[at][:6] else lines[at].replace(",-", ",-1", 1)
    path.write_text("".join(lines))
    with pytest.raises(pp.InvalidInput, match="damaged or changed"):
        read_recording(path)
    assert "any of its numbers may be wrong" in read_recording(path, salvage=True).meta["salvaged"]
    path.write_text("".join(lines[:-2]) + lines[-2][:20])
    assert read_recording(path, salvage=True).meta["salvaged"].startswith("the last line is torn and lost, and its end")
