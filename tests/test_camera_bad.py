"""Bad pictures through `palpate track`: each is said, those before and after are kept; what cannot be used at all is refused with what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from command_line import run

cv2 = pytest.importorskip("cv2")
pytest.importorskip("av")
for _name in ("typer", "pydantic", "h5netcdf"):
    pytest.importorskip(_name)

from palpate.camera import overlay, write_video  # noqa: E402
from palpate.recordings import read_recording, read_touch  # noqa: E402
from test_camera_live import BLACK, SKIN, filmed  # noqa: E402

WHITE = np.full_like(BLACK, 255)
GREY = np.full_like(BLACK, 150) + np.random.default_rng(0).integers(0, 9, BLACK.shape).astype(np.uint8)


@pytest.mark.long
def test_each_bad_picture_is_said_and_nothing_else_is_lost(tmp_path: Path) -> None:
    good = filmed()
    blurred = cv2.GaussianBlur(good[-1], (0, 0), 9)
    pictures = [*good[:5], BLACK, WHITE, blurred, GREY, *good[5:]]
    (tmp_path / "gel.toml").write_text(SKIN)
    write_video(tmp_path / "whole.mkv", [*pictures, *good[-1:] * 4], rate=30.0)
    whole = (tmp_path / "whole.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(whole[: int(0.93 * len(whole))])
    done = run("track", "cut.mkv", "--skin", "gel.toml", "--fast", "--out", "t.nc", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for words in (
        "picture 5: the picture is black",
        "picture 6: the picture is saturated",
        "pictures 7, 8: of 35 dots 0 are to be seen",
        "cut.mkv was cut off",
    ):
        assert words in done.stderr
    assert "Traceback" not in done.stderr
    lost = np.isnan(read_recording(tmp_path / "t.nc").readings).all(axis=(1, 2))
    assert np.flatnonzero(lost).tolist() == [5, 6, 7, 8]
    touch = read_touch(tmp_path / "t.nc")
    force, status = np.asarray(touch.force), np.asarray(touch.status)
    assert (status[5:9] == int(pp.Status.MISSING)).all()
    assert np.isnan(force[5:9]).all()
    assert force[10, 0] == pytest.approx(0.45, abs=0.05)
    # and a frame of the file lies over its picture
    assert len(overlay(good[-1], touch.isel(time=10)).axes) > 1


def test_what_cannot_be_used_is_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "gel.toml").write_text(SKIN)
    write_video(tmp_path / "cut.mp4", filmed(), rate=30.0)
    whole = (tmp_path / "cut.mp4").read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: int(0.8 * len(whole))])
    (tmp_path / "words.mp4").write_text("no video " * 500)
    (tmp_path / "empty.mp4").touch()
    for name, images in {"black.mp4": [BLACK] * 5, "white.mp4": [WHITE] * 5, "none.mp4": [GREY] * 5}.items():
        write_video(tmp_path / name, images, rate=30.0)
    for name, words in {
        "black.mp4": "picture is black). Check light, exposure and lens cap",
        "white.mp4": "saturated: most of it is white). Check light",
        "none.mp4": "no dots found",
        "cut.mp4": "record .mkv, which needs none",
        "words.mp4": "cannot be opened as a video",
        "empty.mp4": "Record it again",
        "gone.mp4": "no such file",
    }.items():
        done = run("track", name, "--skin", "gel.toml", "--out", "t.nc", cwd=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert words in done.stderr
        assert not (tmp_path / "t.nc").exists()
