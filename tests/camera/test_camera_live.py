"""A camera as the source of a live session: rendered pictures, whose truth is known, through a camera that fails as cameras do."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from camera_scenes import BALL, gel_file, small_scene
from command_line import run

cv2 = pytest.importorskip("cv2")
pytest.importorskip("av")
pytest.importorskip("starlette")
for _name in ("typer", "pydantic", "h5netcdf"):
    pytest.importorskip(_name)

from palpate.camera import open_pictures, write_video  # noqa: E402
from palpate.camera.latest import Latest  # noqa: E402
from palpate.camera.pictures import Pictures  # noqa: E402
from palpate.live import Session, unpacked  # noqa: E402
from palpate.live.camera import CameraSource  # noqa: E402
from palpate.recordings import read_recording, read_touch, recorder  # noqa: E402

SKIN = gel_file('scale = "0.1 mm"\nreference = 3', surface='shape = [10, 13]\nspacing = "1.2 mm"')
SCENE = small_scene()
BLACK = np.zeros((120, 160), np.uint8)
#: Seconds that a machine with other things to do may take.
PATIENCE = 120.0


@functools.cache
def filmed() -> tuple[np.ndarray, ...]:
    rng, ball = np.random.default_rng(0), SCENE.skin.sample(BALL)
    return tuple(SCENE.picture(part * ball if part else None, rng=rng) for part in (0, 0, 0, 0, 0.5, 1, 1, 1))


class Camera:
    """What OpenCV gives of a camera: pictures of a list, each when it is asked for by a test; None: it gives none."""

    def __init__(self, images: list[Any], *, hold: bool = False) -> None:
        self.images, self.released = list(images), False
        self.asked = threading.Semaphore(0 if hold else 10**6)

    def isOpened(self) -> bool:
        return True

    def read(self) -> tuple[bool, Any]:
        self.asked.acquire()
        image = self.images.pop(0) if self.images else None
        return image is not None, image

    def release(self) -> None:
        self.released = True


def plugged(monkeypatch: pytest.MonkeyPatch, camera: Camera) -> Camera:
    monkeypatch.setattr(cv2, "VideoCapture", lambda _: camera)
    return camera


def gel(folder: Path) -> Path:
    path = folder / "gel.toml"
    path.write_text(SKIN)
    return path


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def watched(source: CameraSource, **options: Any) -> Session:
    tracker = source.touches.tracker
    assert tracker is not None
    session = Session(
        source.touches.skin,
        source,
        tracker,
        pp.GraspMonitor(friction=0.6),
        pace=False,
        end=source.close,
        step=source.step,
        **options,
    )
    source.report, source.skip = session.note, session.skip
    return session


@pytest.mark.long
def test_a_camera_that_fails_as_cameras_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Black, saturated, blurred, of another size, dots hidden, good again, unplugged: each said, the rest kept, all recorded."""
    pictures, blank = filmed(), np.full((120, 160), 128, np.uint8)
    blurred = cv2.GaussianBlur(pictures[-1], (0, 0), 9)
    bad = [BLACK, BLACK, BLACK + 255, blurred, np.zeros((60, 80), np.uint8), blank, None]
    images = [*pictures[:6], *bad, *pictures[6:]]
    camera = plugged(monkeypatch, Camera(images, hold=True))
    camera.asked.release(3)  # the reference
    source = CameraSource("0", gel(tmp_path))
    said: list[str] = []
    session = watched(
        source,
        sinks=[
            recorder(
                tmp_path / "run.nc", ["displacement_x", "displacement_y"], positions=source.touches.readings.positions
            )
        ],
        report=said.append,
    )
    session.start()
    for i in range(3, len(images) + 1):
        until(lambda i=i: session.count >= i)  # type: ignore[misc]
        camera.asked.release()
    camera.asked.release(20)
    until(lambda: session.ended)
    assert session.count >= len(images)
    assert session.failure is not None
    assert "unplugged" in session.failure
    assert said == [session.failure]
    assert session.packet is not None
    events = " | ".join(session.past)
    for words in (
        "black",
        "saturated",
        "of 35 dots 0 are visible",
        "the picture is 80 x 60, the first was 160 x 120",
        "the camera gave no picture",
        "good again",
    ):
        assert words in events
    assert events.count("black") == 1  # once for as long as it lasts
    session.stop()
    assert camera.released
    recording, touches = read_recording(tmp_path / "run.nc"), read_touch(tmp_path / "run.nc")
    lost = np.isnan(recording.readings).all(axis=(1, 2))
    assert lost[: len(images)].tolist() == [False] * 6 + [True] * 7 + [False] * 2
    force = np.asarray(touches.force)[[5, 14]]
    np.testing.assert_allclose(force[:, 0], 0.45, atol=0.05)
    assert np.isnan(np.asarray(touches.force)[6:13]).all()


@pytest.mark.long
def test_a_video_is_played_at_its_rate_and_its_cut_is_said(tmp_path: Path) -> None:
    write_video(tmp_path / "press.mkv", filmed(), rate=10.0)
    whole = (tmp_path / "press.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(whole[: int(0.8 * len(whole))])
    source = CameraSource(str(tmp_path / "press.mkv"), gel(tmp_path), options={"friction": 0.6})
    session = watched(source)
    begun = time.monotonic()
    session.run()
    assert time.monotonic() - begun > 0.35  # four pictures after the reference and the first
    assert session.failure is None
    assert session.count + session.behind == len(filmed())
    assert session.packet is not None
    assert unpacked(session.packet)[0]["force"][0] == pytest.approx(0.45, abs=0.05)
    assert any("misreads the normal force" in note for note in session.layout()["notes"])
    session.stop()
    cut = watched(CameraSource(str(tmp_path / "cut.mkv"), gel(tmp_path)))
    cut.run()
    assert cut.count + cut.behind < len(filmed())
    assert "cut off" in str(cut.failure)
    cut.stop()


def test_only_the_newest_picture_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = plugged(monkeypatch, Camera([np.full((8, 8), i, np.uint8) for i in range(20)], hold=True))
    camera.asked.release(2)
    latest = Latest(open_pictures(0), pace=False)
    taken = iter(latest.pictures)
    first = [next(taken).image for _ in range(2)]
    latest.start()
    camera.asked.release(10)
    until(lambda: latest.skipped == 9)
    third = next(taken).image
    assert [int(i[0, 0]) for i in (*first, third) if i is not None] == [0, 1, 11]
    waiting = threading.Timer(0.05, latest.close)  # who waits is let go
    waiting.start()
    camera.asked.release(40)
    assert [p.fault for p in taken if p.image is None and p.fault != "the camera gave no picture"] == []
    waiting.join()
    assert camera.released


def test_a_camera_that_opencv_itself_reads_ends_and_is_opened_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file in place of the device, through OpenCV's own capture: colours and times; its end is an unplugged camera; plugged in again, it begins anew."""
    red = np.zeros((120, 160, 3), np.uint8)
    red[:, :80, 2] = 200  # OpenCV writes blue, green, red
    writer = cv2.VideoWriter(str(tmp_path / "device.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (160, 120))
    for _ in range(5):
        writer.write(red)
    writer.release()
    capture, opened = cv2.VideoCapture, []

    def device(source: int) -> Any:
        opened.append(capture(str(tmp_path / "device.avi")))
        return opened[-1]

    monkeypatch.setattr(cv2, "VideoCapture", device)
    for _ in range(2):
        with open_pictures(0) as pictures:
            found = list(pictures)
        assert pictures.size == (160, 120)
        assert [p.fault for p in found[:5]] == [""] * 5
        image = found[4].image
        assert image is not None
        assert image[60, 40].tolist() == pytest.approx([200, 0, 0], abs=12)  # red comes first
        assert image[60, 120].tolist() == pytest.approx([0, 0, 0], abs=12)
        assert (np.diff([p.time for p in found]) > 0).all()
        assert {p.fault for p in found[5:]} == {"the camera gave no picture"}
        assert "camera 0 gives no pictures any more: it was unplugged" in pictures.notes[0]
        assert not opened[-1].isOpened()  # let go, so that it can be opened again
    assert len(opened) == 2


def test_a_camera_that_hangs_is_given_up_after_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """A driver that waits for seconds before it says that there is no picture."""
    from palpate.camera import pictures as module

    now = [0.0]

    class Hanging(Camera):
        def read(self) -> tuple[bool, Any]:
            now[0] += 0.03 if self.images else 2.0
            return super().read()

    monkeypatch.setattr(module.clock, "monotonic", lambda: now[0])
    camera = plugged(monkeypatch, Hanging([BLACK + 9] * 3))
    with open_pictures(0) as source:
        found = list(source)
    assert [p.image is None for p in found] == [False] * 3 + [True]
    assert now[0] < 5.0
    assert camera.released


def test_a_camera_that_is_late_is_said_once_and_what_comes_then_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cable that drops out for two seconds in the middle of a press: within what a driver waits, so that the camera is not given up."""
    from palpate.camera import pictures as module

    now = [0.0]

    class Late(Camera):
        def read(self) -> tuple[bool, Any]:
            found = super().read()
            now[0] += 2.5 if len(self.images) == 2 else 0.03
            return found

    monkeypatch.setattr(module.clock, "monotonic", lambda: now[0])
    camera = plugged(monkeypatch, Late(list(filmed()), hold=True))
    camera.asked.release(3)
    source = CameraSource("0", gel(tmp_path))
    said: list[str] = []
    source.report = said.append
    count = 0
    for count, (_, values) in enumerate(source(), 1):
        assert np.isfinite(values).all()
        if count == len(filmed()):
            break
        if count >= 3:
            camera.asked.release()
    assert [words.split("  ")[1] for words in said] == ["the camera was late: no picture for 2.5 s"]
    camera.asked.release(40)
    source.close()


def test_what_a_thread_finds_is_raised_where_pictures_are_taken() -> None:
    def broken() -> Iterator[tuple[float, Any, str]]:
        yield 0.0, BLACK, ""
        yield 0.1, BLACK, ""
        raise OSError("gone")

    latest = Latest(Pictures(broken(), name="pictures"), pace=True)
    taken = iter(latest.pictures)
    next(taken)
    latest.start()
    with pytest.raises(OSError, match="gone"):
        for _ in taken:
            pass
    latest.close()


@pytest.mark.long
def test_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_video(tmp_path / "press.mp4", filmed()[:2], rate=10.0)
    write_video(tmp_path / "none.mp4", [np.full((120, 160), 128, np.uint8)] * 4, rate=10.0)
    coded = (tmp_path / "press.mp4").read_bytes()
    (tmp_path / "coded.mp4").write_bytes(coded.replace(b"avc1", b"zzzz"))
    gel(tmp_path)
    (tmp_path / "plain.toml").write_text(SKIN[: SKIN.index("[camera]")])
    for arguments, words in {
        ("--camera", "press.mp4"): "the live view needs a skin",
        ("--camera", "press.mp4", "--skin", "gel.toml"): "smaller reference",
        ("--camera", "coded.mp4", "--skin", "gel.toml"): "no codec for this video is installed. Convert it once",
        ("--camera", "none.mp4", "--skin", "gel.toml"): "none of the first 4 pictures shows anything",
        ("--camera", "press.mp4", "--skin", "plain.toml"): "how pixels become metres",
        ("--camera", "press.png", "--skin", "gel.toml"): "--camera takes the number of a camera",
        ("--camera", "nothing.mp4", "--skin", "gel.toml"): "no such file",
        ("--camera", "press.mp4", "--skin", "gel.toml", "--loop"): "leave out --loop",
        ("--camera", "press.mp4", "--skin", "gel.toml", "--speed", "2"): "leave out --speed",
        ("--camera", "press.mp4", "--skin", "gel.toml", "--map", "x=x"): "leave it out",
        ("--camera", "press.mp4", "--skin", "gel.toml", "--udp", "9000"): "give either",
    }.items():
        done = run("live", *arguments, cwd=tmp_path)
        assert (done.returncode, done.stderr.count("error:")) == (2, 1), done.stderr
        assert words in done.stderr

    class Absent(Camera):
        def isOpened(self) -> bool:
            return False

    plugged(monkeypatch, Absent([]))
    done = run("live", "--camera", "7", "--skin", "gel.toml", cwd=tmp_path)
    assert "camera 7: cannot be opened" in done.stderr
