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

from test_camera_live import BLACK, SKIN, filmed  # noqa: E402

from palpate.camera import overlay, write_video  # noqa: E402
from palpate.recordings import read_recording, read_touch  # noqa: E402

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
        "pictures 7, 8: of 35 dots 0 are visible",
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


@pytest.mark.long
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


@pytest.mark.long
def test_a_folder_of_bad_pictures_gives_a_row_for_each(tmp_path: Path) -> None:
    """Wrong size in mid-stream, cut off, empty, no picture at all, all dots lost: rows of the table, in order, with what is known."""
    good = filmed()
    bad = [cv2.resize(good[-1], (80, 60)), cv2.resize(good[-1], (320, 240)), GREY, GREY]
    folder = tmp_path / "frames"
    folder.mkdir()
    for index, image in enumerate([*good[:6], *bad, *[good[-1]] * 6]):
        cv2.imwrite(str(folder / f"{index}.png"), image)
    whole = (folder / "10.png").read_bytes()
    (folder / "10.png").write_bytes(whole[: len(whole) // 2])
    (folder / "11.png").write_bytes(b"")
    (folder / "12.png").write_text("no picture")
    (tmp_path / "gel.toml").write_text(SKIN)
    done = run("track", "frames", "--skin", "gel.toml", "--fast", "--rate", "30", "--out", "forces.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for words in (
        "picture 6: the picture is 80 x 60, the first was 160 x 120",
        "picture 7: the picture is 320 x 240",
        "pictures 8, 9: of 35 dots 0 are visible",
        "picture 10: 10.png cannot be decoded as a picture",
        "picture 11: 11.png cannot be decoded as a picture",
        "picture 12: 12.png cannot be decoded as a picture",
    ):
        assert words in done.stderr
    # no words of other libraries
    assert all(line.startswith("warning: ") for line in done.stderr.splitlines())
    rows = [line.split(",") for line in (tmp_path / "forces.csv").read_text().splitlines()]
    assert len(rows) == 1 + 16
    status, across = rows[0].index("status"), rows[0].index("force_x (N)")
    assert [i for i, row in enumerate(rows[1:]) if row[status] == "missing"] == list(range(6, 13))
    assert float(rows[-1][across]) == pytest.approx(0.45, abs=0.05)


@pytest.mark.parametrize(
    ("ending", "known", "other"),
    [(".mp4", b"avc1", b"zzzz"), (".mkv", b"V_MPEG4/ISO/AVC", b"V_MPEGX/ISO/XXX"), (".avi", b"H264", b"ZZZZ")],
)
@pytest.mark.long
def test_a_codec_that_nobody_knows_is_said_with_what_to_do(
    tmp_path: Path, ending: str, known: bytes, other: bytes
) -> None:
    """A whole video but for the name of its codec."""
    path = tmp_path / f"press{ending}"
    write_video(path, filmed(), rate=30.0)
    whole = path.read_bytes()
    assert known in whole
    path.write_bytes(whole.replace(known, other))
    (tmp_path / "gel.toml").write_text(SKIN)
    done = run("track", path.name, "--skin", "gel.toml", "--out", "t.nc", cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "no codec for this video is installed. Convert it once, such as with: ffmpeg" in done.stderr
    assert not (tmp_path / "t.nc").exists()


def test_a_video_that_is_damaged_in_the_middle_is_used_after_it_too(tmp_path: Path) -> None:
    """Every eighth picture stands alone. Those between the damage and the next of these are built on what is not there: none of them is passed on."""
    import av

    from palpate.camera import open_pictures

    rng = np.random.default_rng(1)
    images = [cv2.GaussianBlur(rng.integers(0, 255, (120, 160)).astype(np.uint8), (0, 0), 3) for _ in range(24)]
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt, stream.codec_context.gop_size = 160, 120, "yuv420p", 8
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode(None))
    data = bytearray((tmp_path / "a.mp4").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 300] = rng.integers(0, 256, 300, dtype=np.uint8).tobytes()
    (tmp_path / "a.mp4").write_bytes(data)
    with open_pictures(tmp_path / "a.mp4") as pictures:
        found = list(pictures)
    assert [p.time for p in found] == pytest.approx(np.arange(24) / 30.0, abs=1e-3)
    lost = [p.index for p in found if p.image is None]
    assert 1 <= len(lost) <= 8
    assert lost[0] >= 8
    assert lost[-1] < 16
    assert all("the video is damaged here" in found[i].fault for i in lost)
    for picture in found:
        if picture.image is not None:
            assert np.abs(picture.image.mean(axis=-1) - images[picture.index]).mean() < 4.0


def test_a_stack_that_was_cut_off_says_how_much_of_it_is_there(tmp_path: Path) -> None:
    import tifffile

    tifffile.imwrite(tmp_path / "cut.tif", np.stack(filmed()))
    whole = (tmp_path / "cut.tif").read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[: int(0.7 * len(whole))])
    (tmp_path / "gel.toml").write_text(SKIN)
    done = run("track", "cut.tif", "--skin", "gel.toml", "--rate", "30", cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "cut.tif ends early: 1 of 8 pictures could be read" in done.stderr
