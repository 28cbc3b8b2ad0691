"""Pictures of a known contact, pictures in and out, and where they lie."""

from __future__ import annotations

import functools
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from camera_scenes import small_scene

cv2 = pytest.importorskip("cv2")
av = pytest.importorskip("av")
tifffile = pytest.importorskip("tifffile")

from palpate.camera import Dots, Lens, Looks, Scene, Texture, View, dot_grid, grey, open_pictures, write_video  # noqa: E402

GEL = pp.BondedLayers([pp.Layer(thickness=4e-3, youngs_modulus=3e5, poissons_ratio=0.48)])
BALL = pp.solutions.hertz_point(contact_radius=2.5e-3, force=2.0).sliding(0.4, direction=0.5)
CLEAN = Looks(noise=0.0, gradient=(0.0, 0.0))


BASE = small_scene(GEL, looks=CLEAN)


@functools.cache
def scene(**other: object) -> Scene:
    return BASE.changed(**other)


def centroids(picture: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Centres of ink about places [pixels]."""
    ink = picture.max() - picture.astype(float)
    out = []
    for column, row in near:
        left, top = round(column) - 8, round(row) - 8
        part = ink[top : top + 17, left : left + 17]
        part = np.clip(part - 0.3 * part.max(), 0.0, None)
        rows, columns = np.mgrid[top : top + 17, left : left + 17]
        out.append([(columns * part).sum() / part.sum(), (rows * part).sum() / part.sum()])
    return np.array(out)


# -- the renderer --------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_dots_move_as_the_pad_says() -> None:
    """Against the pad's own displacement at scattered markers, from traction on a grid of its own."""
    one = scene()
    found = one.truth(BALL)
    array = pp.ScatteredArray(
        positions=found.positions,
        depth=0.5e-3,
        channels=["displacement_x", "displacement_y", "displacement_z"],
    )
    direct = pp.Skin(GEL, array, surface=pp.AreaGrid(shape=(60, 60), spacing=0.25e-3)).sense(BALL)
    np.testing.assert_allclose(found.displacement.T, direct, atol=0.004 * float(np.abs(direct).max()))


def test_pictures_show_the_dots_where_the_truth_says() -> None:
    one = scene()
    # under the ball a dot is stretched unevenly, and its centroid is not where its middle is
    for contact, least in ((None, 0.03), (BALL, 0.2)):
        truth = one.truth(contact)
        assert truth.visible.all()
        seen = centroids(one.picture(contact), truth.pixels)
        assert float(np.abs(seen - truth.pixels).max()) < least
    # x goes to the right, y up: rows grow downwards
    moved = one.truth(BALL)
    far = np.abs(moved.displacement[:, 1]) > 2e-5
    assert (np.sign(moved.pixels - moved.rest)[far, 1] == -np.sign(moved.displacement[far, 1])).all()


def test_a_near_camera_sees_motion_towards_it() -> None:
    near, far = scene(distance=15e-3).truth(BALL), scene().truth(BALL)
    # what moves towards the camera moves away from the picture's middle
    gain = (near.pixels - far.pixels) / (far.pixels - np.array([79.5, 59.5]))
    towards = near.displacement[:, 2] / (15e-3 - near.displacement[:, 2])
    off_axis = np.abs(far.pixels - np.array([79.5, 59.5])) > 10
    np.testing.assert_allclose(gain[off_axis], np.repeat(towards[:, None], 2, axis=1)[off_axis], rtol=1e-6, atol=1e-9)
    assert np.abs(towards).max() > 0.01


def test_the_stage_moves_all_alike_and_a_lens_bends() -> None:
    still, moved = scene().truth(), scene().truth(None, shift=(0.3e-3, -0.2e-3))
    np.testing.assert_allclose(moved.pixels - still.pixels, np.broadcast_to([3.0, 2.0], (35, 2)), atol=1e-9)
    turned = scene().truth(None, rotation=0.02).pixels - still.pixels
    arm = still.pixels - np.array([79.5, 59.5])
    # counter-clockwise as seen in the picture: what is on the right goes up
    np.testing.assert_allclose(turned, 0.02 * np.stack([arm[:, 1], -arm[:, 0]], axis=1), atol=0.02)
    bent = scene(distortion=(-0.3, 0.0, 0.0, 0.0), distance=20e-3)
    seen = centroids(bent.picture(), bent.truth().rest)
    assert float(np.abs(seen - bent.truth().rest).max()) < 0.08
    assert float(np.abs(bent.truth().rest - still.rest).max()) > 1.0


def test_looks_do_what_they_say() -> None:
    rng = np.random.default_rng(0)
    plain = scene().picture().astype(float)
    noisy = scene(looks=Looks(noise=5.0, gradient=(0.0, 0.0))).picture(rng=rng).astype(float)
    assert float((noisy - plain).std()) == pytest.approx(5.0, rel=0.05)
    colour = scene(looks=Looks(colour=1.0, shading=1.0)).picture(BALL)
    assert colour.shape == (120, 160, 3)
    glare = scene(looks=Looks(noise=0.0, glare=((80.0, 60.0, 6.0),))).picture()
    assert glare[60, 80] == 255
    packed = scene(looks=Looks(noise=0.0, gradient=(0.0, 0.0), compression=20)).picture().astype(float)
    assert 0.5 < float(np.abs(packed - plain).mean()) < 10.0
    halved = scene(print=Dots(dot_grid((5, 7), 2e-3), 0.8e-3, halved=[0])).picture().astype(float)
    assert float((halved - plain).sum()) > 0
    texture = scene(print=Texture(0.15e-3)).picture()
    assert float(texture.std()) > 20


def test_a_contact_that_folds_the_print_is_refused() -> None:
    with pytest.raises(pp.InvalidInput, match="Press less"):
        scene().picture(pp.solutions.hertz_point(contact_radius=1e-3, force=60.0).sliding(1.0))


# -- where the picture lies ----------------------------------------------------------------------------------------------


def test_pixels_need_not_be_square() -> None:
    view = View.scaled((1e-4, 2e-4), size=(101, 51))
    np.testing.assert_allclose(view.places([[50, 25], [60, 25], [50, 35]]), [[0, 0], [1e-3, 0], [0, -2e-3]], atol=1e-12)
    np.testing.assert_allclose(view.pixels(view.places([[3.0, 7.0]])), [[3.0, 7.0]], atol=1e-9)
    np.testing.assert_allclose(view.jacobian([10.0, 10.0]), [[1e-4, 0.0], [0.0, -2e-4]], atol=1e-12)


def test_a_known_pitch_gives_both_scales() -> None:
    true = Scene(
        pad=GEL, depth=0.0, print=Dots(dot_grid((6, 8), 1.7e-3), 0.6e-3), size=(200, 160), scale=(0.09e-3, 0.11e-3)
    )
    dots = true.truth().rest + np.random.default_rng(0).normal(0, 0.1, (48, 2))
    view = View.from_pitch(np.delete(dots, [3, 20, 21], axis=0), 1.7e-3, size=(200, 160))
    np.testing.assert_allclose(np.abs(np.diag(view.homography)[:2]), [0.09e-3, 0.11e-3], rtol=2e-3)
    turned = dots @ np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    square = View.from_pitch(turned * [1.0, 11 / 9], 1.7e-3, size=(200, 160))
    assert np.isfinite(square.homography).all()
    with pytest.raises(pp.InvalidInput, match="nine dots"):
        View.from_pitch(dots[:5], 1.7e-3, size=(200, 160))
    with pytest.raises(pp.InvalidInput, match="grid"):
        View.from_pitch(np.random.default_rng(0).uniform(0, 200, (40, 2)), 1.7e-3, size=(200, 160))


def test_four_points_and_what_does_not_fit() -> None:
    places = np.array([[-8e-3, 6e-3], [8e-3, 6e-3], [8e-3, -6e-3], [-8e-3, -6e-3]])
    tilted = np.array([[12.0, 9.0], [301.0, 22.0], [290.0, 228.0], [20.0, 231.0]])
    view = View.from_points(tilted, places)
    np.testing.assert_allclose(view.places(tilted), places, atol=1e-9)
    np.testing.assert_allclose(view.pixels(places), tilted, atol=1e-6)
    step = view.places(tilted + np.array([0.01, 0.0])) - places
    np.testing.assert_allclose(view.jacobian(tilted)[..., 0], step / 0.01, rtol=1e-2)
    with pytest.raises(pp.InvalidInput, match="four points"):
        View.from_points(tilted[:3], places[:3])
    with pytest.raises(pp.InvalidInput, match="line"):
        View.from_points([[0, 0], [1, 1], [2, 2], [3, 3]], places)


@pytest.mark.long
def test_opencv_calibration_finds_the_lens() -> None:
    matrix = np.array([[400.0, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]])
    bent = np.array([-0.25, 0.05, 0.0, 0.0])
    field = np.kron(np.indices((8, 9)).sum(axis=0) % 2, np.ones((40, 40)))
    board = np.pad(1.0 - field, 40, constant_values=1.0)
    pictures = []
    for turn in ([0.3, 0.1, 0.0], [-0.3, 0.2, 0.1], [0.1, -0.35, 0.05], [0.05, 0.4, -0.1], [-0.2, -0.2, 0.2]):
        columns, rows = np.meshgrid(np.arange(320.0), np.arange(240.0))
        rays = Lens(matrix, bent).undistorted(np.stack([columns, rows], axis=-1))
        rotation = cv2.Rodrigues(np.array(turn))[0]
        pose = matrix @ np.column_stack([rotation[:, 0] / 40.0, rotation[:, 1] / 40.0, [-5.5, -5.0, 19.0]])
        at = np.concatenate([rays, np.ones((240, 320, 1))], axis=-1) @ np.linalg.inv(pose).T
        at = at[..., :2] / at[..., 2:]
        seen = cv2.remap(
            board, at[..., 0].astype(np.float32), at[..., 1].astype(np.float32), cv2.INTER_LINEAR, borderValue=1.0
        )
        pictures.append(cv2.GaussianBlur(60.0 + 150.0 * seen, (0, 0), 0.7).astype(np.uint8))
    lens = Lens.from_chessboard(pictures, corners=(8, 7))
    assert lens.error < 0.3
    corner = np.array([[20.0, 15.0], [300.0, 225.0]])
    np.testing.assert_allclose(lens.undistorted(corner), Lens(matrix, bent).undistorted(corner), atol=1.5)
    np.testing.assert_allclose(lens.distorted(lens.undistorted(corner)), corner, atol=1e-3)
    with pytest.raises(pp.InvalidInput, match="inner corners"):
        Lens.from_chessboard(pictures, corners=(11, 5))


# -- pictures in ---------------------------------------------------------------------------------------------------------

RAMP = (np.arange(48 * 64).reshape(48, 64) % 200).astype(np.uint8)


def film(path: Path, count: int = 6) -> Path:
    rng = np.random.default_rng(0)
    rough = rng.integers(0, 60, (count, 48, 64), dtype=np.uint8)
    write_video(path, [RAMP // 2 + part for part in rough], rate=25.0)
    return path


@pytest.mark.parametrize("ending", ["mp4", "mkv", "avi"])
def test_a_video_keeps_its_times(tmp_path: Path, ending: str) -> None:
    with open_pictures(film(tmp_path / f"press.{ending}")) as pictures:
        assert pictures.size == (64, 48)
        assert pictures.timed
        read = list(pictures)
    np.testing.assert_allclose([p.time for p in read], np.arange(6) / 25.0, atol=2e-3)
    assert float(np.abs(grey(read[2].image).astype(float) - RAMP // 2 - 30).mean()) < 25.0


def test_a_folder_counts_and_a_stack_keeps_sixteen_bits(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in (10, 2, 1):
        cv2.imwrite(str(folder / f"f{i}.png"), np.full((20, 30, 3), (i, 0, 0), np.uint8))  # OpenCV writes blue first
    with open_pictures(folder, rate=10.0) as pictures:
        read = list(pictures)
    assert [int(p.image[0, 0, 2]) for p in read if p.image is not None] == [1, 2, 10]
    assert [p.time for p in read] == [0.0, 0.1, 0.2]
    stack = np.arange(3 * 20 * 30, dtype=np.uint16).reshape(3, 20, 30) * 30
    tifffile.imwrite(tmp_path / "s.tif", stack, imagej=True, metadata={"finterval": 0.5, "axes": "TYX"})
    with open_pictures(tmp_path / "s.tif") as pictures:
        read = list(pictures)
    assert [p.time for p in read] == [0.0, 0.5, 1.0]
    np.testing.assert_array_equal([p.image for p in read], stack)


def test_nothing_is_lost_where_one_picture_is_bad(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for i in range(4):
        cv2.imwrite(str(folder / f"{i}.png"), RAMP)
    (folder / "1.png").write_bytes((folder / "1.png").read_bytes()[:40])
    cv2.imwrite(str(folder / "2.png"), RAMP[:20])
    with open_pictures(folder) as pictures:
        read = list(pictures)
    assert [p.image is None for p in read] == [False, True, True, False]
    assert "1.png" in read[1].fault
    assert "64 x 20" in read[2].fault
    assert "64 x 48" in read[2].fault


@pytest.mark.long
def test_a_video_that_was_cut_off_is_used_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = film(tmp_path / "press.mkv", 40).read_bytes()
    (tmp_path / "cut.mkv").write_bytes(whole[: len(whole) // 2])
    with open_pictures(tmp_path / "cut.mkv") as pictures:
        assert 3 < len(list(pictures)) < 40
        assert "was cut off" in pictures.notes[0]
    with open_pictures(tmp_path / "press.mkv") as pictures:
        assert (len(list(pictures)), pictures.notes) == (40, [])
    whole = film(tmp_path / "press.mp4", 40).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(pp.InvalidInput, match="no index"):
        open_pictures(tmp_path / "cut.mp4")


def test_sources_that_cannot_be_meant(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "zero.mp4").touch()
    (tmp_path / "text.mp4").write_text("no video\n" * 100)
    (tmp_path / "text.tif").write_text("no picture")
    (tmp_path / "x.doc").write_text("no")
    said = {
        tmp_path / "gone.mp4": "no such file",
        tmp_path / "empty": "holds no pictures",
        tmp_path / "zero.mp4": "not finished",
        tmp_path / "text.mp4": "cannot be opened as a video",
        tmp_path / "text.tif": "cannot be read as TIFF",
        tmp_path / "x.doc": "Accepted",
    }
    for source, words in said.items():
        with pytest.raises(pp.InvalidInput, match=words):
            open_pictures(source)
    with pytest.raises(pp.InvalidInput, match="leave out rate"):
        open_pictures(film(tmp_path / "a.mp4"), rate=3.0)
    with pytest.raises(pp.InvalidInput, match="rate must be"):
        open_pictures(RAMP[None], rate=0.0)
    with pytest.raises(pp.InvalidInput, match="shape"):
        open_pictures(RAMP)
    with pytest.raises(pp.InvalidInput, match="uint8, uint16"):
        open_pictures(np.zeros((2, 4, 4), dtype=complex))


def test_a_missing_codec_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = film(tmp_path / "a.mp4")

    class Stream:
        codec_context, frames, average_rate = None, 0, None

    class Container:
        class streams:
            video = (Stream(),)

        def close(self) -> None: ...

    monkeypatch.setattr(av, "open", lambda _: Container())
    with pytest.raises(pp.InvalidInput, match="ffmpeg -i"):
        open_pictures(path)


def test_a_camera_that_is_not_there() -> None:
    with pytest.raises(pp.InvalidInput, match="camera"):
        open_pictures("/dev/video97")


def test_stacks_of_microscopes_keep_their_times_and_channels_are_not_taken_for_pictures(tmp_path: Path) -> None:
    """Two channels of one time were taken for beads at rest and beads that are pulled."""
    from palpate.errors import InvalidInput
    from palpate.microscopy import read_pair

    both = np.random.default_rng(0).integers(0, 4000, (3, 2, 64, 80)).astype(np.uint16)
    one = both[:, 0]
    tifffile.imwrite(tmp_path / "ij.tif", one, imagej=True, metadata={"axes": "TYX", "finterval": 0.5})
    increment = {"axes": "TYX", "TimeIncrement": 500.0, "TimeIncrementUnit": "ms"}
    tifffile.imwrite(tmp_path / "o.ome.tif", one, metadata=increment)
    tifffile.imwrite(tmp_path / "slices.tif", one, imagej=True, metadata={"axes": "ZYX"})  # as ImageJ calls a sequence
    for name, times in {"ij.tif": [0.0, 0.5, 1.0], "o.ome.tif": [0.0, 0.5, 1.0], "slices.tif": [0.0, 1.0, 2.0]}.items():
        with open_pictures(tmp_path / name) as pictures:
            found = list(pictures)
        assert [p.time for p in found] == times
        assert all(np.array_equal(p.image, image) for p, image in zip(found, one))
    tifffile.imwrite(tmp_path / "tc.tif", both, imagej=True, metadata={"axes": "TCYX"})
    tifffile.imwrite(tmp_path / "c.ome.tif", both[0], metadata={"axes": "CYX"})
    tifffile.imwrite(tmp_path / "tz.tif", both, imagej=True, metadata={"axes": "TZYX"})
    for name, words in {
        "tc.tif": "2 channels",
        "c.ome.tif": "2 channels",
        "tz.tif": "2 planes of 3 times",
    }.items():
        with pytest.raises(InvalidInput, match=rf"{name}: holds {words} .*save"):
            open_pictures(tmp_path / name)
        with pytest.raises(InvalidInput, match=rf"{name}: holds {words} .*save"):
            read_pair([tmp_path / name])


# -- as people have them ---------------------------------------------------------------------------------------------------

#: Dark at the left, bright at the top: every turn and mirror shows.
TURNED = np.clip(40 + np.indices((48, 64))[1] * 2 + (47 - np.indices((48, 64))[0]), 0, 255).astype(np.uint8)


def corners(image: np.ndarray) -> list[int]:
    """Mean brightness of the four corners, from the upper left clockwise."""
    part = image.reshape(*image.shape[:2], -1).mean(axis=2)
    return [int(part[rows, columns].mean()) for rows, columns in ((TOP, TOP), (TOP, END), (END, END), (END, TOP))]


TOP, END = slice(0, 6), slice(-6, None)


@pytest.mark.parametrize(
    ("matrix", "shown"),
    [
        ((1, 0, 0, 1), TURNED),
        ((0, 1, -1, 0), np.rot90(TURNED, -1)),
        ((-1, 0, 0, -1), np.rot90(TURNED, 2)),
        ((0, -1, 1, 0), np.rot90(TURNED, 1)),
        ((-1, 0, 0, 1), TURNED[:, ::-1]),
    ],
    ids=["upright", "clockwise", "upside down", "counter-clockwise", "mirrored"],
)
def test_a_video_is_turned_as_a_phone_was_held(tmp_path: Path, matrix: tuple[int, ...], shown: np.ndarray) -> None:
    """The matrix of an MP4 track says it: x' = a x + c y, y' = b x + d y."""
    path = tmp_path / "phone.mp4"
    write_video(path, [np.stack([TURNED] * 3, axis=-1)] * 4, rate=20.0)
    whole = bytearray(path.read_bytes())
    at = whole.index(b"tkhd") + 4 + 40
    a, b, c, d = (65536 * m for m in matrix)
    whole[at : at + 20] = b"".join(int(v).to_bytes(4, "big", signed=True) for v in (a, b, 0, c, d))
    path.write_bytes(whole)
    with open_pictures(path) as pictures:
        images = [picture.image for picture in pictures]
        assert pictures.size == shown.shape[::-1]
    assert len(images) == 4
    assert images[0] is not None
    np.testing.assert_allclose(corners(images[0]), corners(shown), atol=6)


def test_a_still_is_turned_as_the_camera_was_held(tmp_path: Path) -> None:
    """EXIF orientation 6: the camera lay on its side."""
    _, code = cv2.imencode(".jpg", TURNED)
    entry = b"\x12\x01\x03\x00\x01\x00\x00\x00\x06\x00\x00\x00"
    exif = b"Exif\x00\x00II*\x00\x08\x00\x00\x00\x01\x00" + entry + b"\x00\x00\x00\x00"
    jpg = code.tobytes()
    segment = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    (tmp_path / "phone.jpg").write_bytes(jpg[:2] + segment + jpg[2:])
    with open_pictures(tmp_path / "phone.jpg") as pictures:
        (picture,) = pictures
    assert picture.image is not None
    np.testing.assert_allclose(corners(picture.image), corners(np.rot90(TURNED, -1)), atol=6)


def test_a_gif_is_a_video(tmp_path: Path) -> None:
    path = tmp_path / "press.gif"
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("gif", rate=20)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "rgb8"
        for level in (60, 120, 180):
            image = np.full((48, 64, 3), level, dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24").reformat(format="rgb8")))
        container.mux(stream.encode(None))
    with open_pictures(path) as pictures:
        found = list(pictures)
    assert [round(picture.time, 2) for picture in found] == [0.0, 0.05, 0.1]
    assert [int(np.mean(picture.image)) // 50 for picture in found] == [1, 2, 3]  # type: ignore[arg-type]


def test_a_still_that_moves_is_refused(tmp_path: Path) -> None:
    """Of an animated PNG or WebP the first picture alone was read, without a word."""
    _, code = cv2.imencode(".png", TURNED)
    png = code.tobytes()
    control = b"acTL" + (3).to_bytes(4, "big") + (0).to_bytes(4, "big")
    chunk = (8).to_bytes(4, "big") + control + zlib.crc32(control).to_bytes(4, "big")
    (tmp_path / "moves.png").write_bytes(png[:33] + chunk + png[33:])
    (tmp_path / "moves.webp").write_bytes(b"RIFF\x00\x00\x00\x00WEBPVP8X\x0a\x00\x00\x00\x02" + bytes(40))
    for name in ("moves.png", "moves.webp"):
        with pytest.raises(pp.InvalidInput, match="several pictures, of which one alone would be read: save it as"):
            open_pictures(tmp_path / name)


def test_a_stack_in_a_folder_is_not_read_as_its_first_picture(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    (tmp_path / "frames").mkdir()
    tifffile.imwrite(tmp_path / "frames" / "0.tif", RAMP)
    tifffile.imwrite(tmp_path / "frames" / "1.tif", np.stack([RAMP] * 3), photometric="minisblack")
    with open_pictures(tmp_path / "frames") as pictures:
        read = list(pictures)
    assert [p.image is None for p in read] == [False, True]
    assert "1.tif holds 3 pictures" in read[1].fault


def test_a_colour_picture_is_no_stack_of_its_rows(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile")
    colour = np.stack([RAMP] * 3, axis=-1)
    for name, values, count in (("one.tif", colour, 1), ("two.tif", np.stack([colour] * 2), 2)):
        tifffile.imwrite(tmp_path / name, values, photometric="rgb")
        with open_pictures(tmp_path / name) as pictures:
            assert len(list(pictures)) == pictures.count == count
            assert pictures.notes == []


def test_pictures_on_their_side_say_which_size_to_write() -> None:
    from palpate.camera.displacements import view_of
    from palpate.recordings.camerasection import CameraSettings

    settings = CameraSettings(scale=0.06e-3, size=(320, 240))
    with pytest.raises(pp.InvalidInput, match=r"on its side. Write size = \[240, 320\] in \[camera\]"):
        view_of(settings, (480, 640), np.zeros((0, 2)))


def test_boards_and_pictures_that_opencv_refuses_are_said() -> None:
    deep = [np.full((200, 200), 1000, dtype=np.uint16)] * 3
    with pytest.raises(pp.InvalidInput, match="at least 3 x 3 inner corners"):
        Lens.from_chessboard(deep, corners=(2, 5))
    for picture in (deep[0], deep[0].astype(np.float32), deep[0][:5, :5]):
        with pytest.raises(pp.InvalidInput, match="was found in 0 of 3 pictures"):
            Lens.from_chessboard([picture] * 3, corners=(7, 6))
    for picture in (np.zeros((2, 48, 64), np.uint8), np.zeros((48, 64, 2), np.uint8), np.zeros((0, 64), np.uint8)):
        with pytest.raises(pp.InvalidInput, match=r"8-bit pictures, \(row, column\)"):
            write_video("never.mp4", [picture])
    with open_pictures([np.zeros((4, 5), np.uint8), np.array(3, dtype=np.uint8)]) as pictures:
        assert list(pictures)[1].fault == "the picture is no picture, of shape (), the first was 5 x 4"
