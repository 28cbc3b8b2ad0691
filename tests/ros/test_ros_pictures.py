"""Pictures of a gel in the node for ROS 2, without ROS: rendered pictures, whose truth is known, through topics that fail as topics do."""

from __future__ import annotations

import array
import functools
import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import palpate as pp
from camera_scenes import BALL, gel_file, small_scene

cv2 = pytest.importorskip("cv2")
pytest.importorskip("pydantic")

from palpate.ros.pictures import PATIENCE, PictureIntake, are_pictures  # noqa: E402

SKIN = gel_file('scale = "0.1 mm"\nreference = 3', surface='shape = [10, 13]\nspacing = "1.2 mm"')
BLACK = np.zeros((120, 160), np.uint8)


@functools.cache
def filmed() -> tuple[np.ndarray, ...]:
    """At rest, and pressed twice."""
    scene = small_scene()
    rng, ball = np.random.default_rng(0), scene.skin.sample(BALL)
    return tuple(scene.picture(ball if pressed else None, rng=rng) for pressed in (0, 0, 0, 1, 1))


def image(picture: np.ndarray, at: float, encoding: str = "mono8") -> Any:
    """sensor_msgs/Image as rclpy gives it, or a CompressedImage."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=int(at), nanosec=round((at - int(at)) * 1e9)), frame_id="gel")
    if encoding in ("png", "jpeg"):
        data = cv2.imencode(f".{encoding}", picture)[1].tobytes()
        return SimpleNamespace(header=header, format=encoding, data=array.array("B", data))
    return SimpleNamespace(
        header=header, encoding=encoding, height=picture.shape[0], width=picture.shape[1],
        step=picture.strides[0], is_bigendian=0, data=array.array("B", picture.tobytes()),
    )  # fmt: skip


class Topic:
    """Pictures of a topic, one each time one is sent; every frame that comes of them."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.intake = PictureIntake("/gel/image", now=lambda: 10**11, publishers=lambda: {(b"a" * 16).hex(): "/camera"})
        self.intake.report = self.words.append
        self._number = itertools.count(1)
        self._frames: Iterator[tuple[int, float, Any]] | None = None

    def send(self, picture: np.ndarray, at: float, encoding: str = "mono8", *, lost: int = 0) -> str:
        for _ in range(lost):
            next(self._number)
        info = {"publisher_gid": {"data": b"a" * 16}, "publication_sequence_number": next(self._number)}
        return self.intake.take(image(picture, at, encoding), info)

    @contextmanager
    def sending(self, pictures: Any, **options: Any) -> Iterator[None]:
        """As a camera does, whether or not anybody looks."""
        stop = threading.Event()

        def run() -> None:
            for i, picture in enumerate(itertools.cycle(pictures)):
                self.send(picture, 1.0 + 0.01 * i, **options)
                if stop.wait(0.01):
                    return

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()

    def begin(self, folder: Path, **options: Any) -> Any:
        (folder / "gel.toml").write_text(SKIN)
        with self.sending(filmed()[:3]):
            touches = self.intake.begin(folder / "gel.toml", options=options)
        # those that came while the dots were looked for
        self._frames = self.intake.frames()
        for _ in range(touches.readings.reference):
            touches.step(next(self._frames)[2], 0.0)
        while self.intake._frames:
            next(self._frames)
        return touches

    def next(self) -> tuple[int, float, Any]:
        assert self._frames is not None
        return next(self._frames)


@pytest.fixture
def topic() -> Topic:
    return Topic()


@pytest.mark.parametrize("encoding", ["mono8", "png"])
@pytest.mark.long
def test_a_press_is_told_with_the_stamp_of_its_picture(topic: Topic, tmp_path: Path, encoding: str) -> None:
    touches = topic.begin(tmp_path)
    for i, picture in enumerate(filmed()[3:]):
        assert topic.send(picture, 50.0 + 0.03125 * i, encoding) in ("frames", "jump")
    topic.send(filmed()[4], 50.0 + 0.03125 * 2, encoding)
    session, at, values = topic.next()
    assert values.shape == (2, 35)
    assert (session, at) == (2, 50.0625)  # far from those at rest: a new session, once three follow each other
    assert (topic.intake.header.stamp, topic.intake.header.frame) == (50_062_500_000, "gel")
    touch = touches.step(values, 1.0, std=topic.intake.std)
    assert touch.force[:2] == pytest.approx([0.45, 0.0], abs=0.02)


def test_only_the_newest_picture_is_looked_at(topic: Topic, tmp_path: Path) -> None:
    topic.begin(tmp_path)
    before = topic.intake.counts["dropped"]
    last = topic.intake.header.stamp / 1e9
    for i in (1, 2, 3):
        topic.send(filmed()[0], last + 0.03 * i)
    assert topic.next()[1] == pytest.approx(last + 0.09)
    assert topic.intake.counts["dropped"] - before == 2


def test_pictures_that_tell_nothing_are_frames_without_an_answer_and_said_once(topic: Topic, tmp_path: Path) -> None:
    topic.begin(tmp_path)
    last = topic.intake.header.stamp / 1e9
    story = [
        (BLACK, "mono8", "black"),
        (BLACK, "mono8", ""),
        (filmed()[0][:100], "mono8", "the picture is 160 x 100, the first was 160 x 120"),
        (filmed()[0], "32FC1", "pictures in '32FC1' are not read"),
        (filmed()[0], "mono8", "the pictures are good again"),
    ]
    for i, (picture, encoding, said) in enumerate(story, 1):
        topic.words.clear()
        topic.send(picture, last + 0.03 * i, encoding)
        values = topic.next()[2]
        assert np.isnan(values).all() == (i < len(story))
        assert [said in text for text in topic.words] == ([True] if said else []), topic.words
    assert topic.intake.counts["malformed"] == 1


def test_lost_pictures_are_counted(topic: Topic, tmp_path: Path) -> None:
    topic.begin(tmp_path)
    last = topic.intake.header.stamp / 1e9
    topic.send(filmed()[0], last + 0.1, lost=4)
    assert topic.intake.counts["lost"] == 4


def test_a_clock_that_goes_back_begins_a_session_and_keeps_the_dots(topic: Topic, tmp_path: Path) -> None:
    topic.begin(tmp_path)
    for i in range(3):
        topic.send(filmed()[3], 0.1 + 0.03 * i)
    session, at, values = topic.next()
    assert (session, at) == (2, pytest.approx(0.16))
    assert 5e-6 < np.nanmax(np.abs(values)) < 1e-3
    assert any("began again" in text for text in topic.words)


def test_a_topic_without_readable_pictures_is_given_up(topic: Topic, tmp_path: Path) -> None:
    (tmp_path / "gel.toml").write_text(SKIN)
    with topic.sending(filmed()[:1], encoding="yuv422"), pytest.raises(pp.InvalidInput, match="'yuv422' are not read"):
        topic.intake.begin(tmp_path / "gel.toml", options={})
    assert topic.intake.counts["malformed"] == PATIENCE


def test_a_gel_that_is_touched_at_the_start_is_refused(topic: Topic, tmp_path: Path) -> None:
    (tmp_path / "gel.toml").write_text(SKIN)
    pressing = [filmed()[0], filmed()[3], filmed()[0], filmed()[4]]
    with topic.sending(pressing), pytest.raises(pp.InvalidInput, match="Nothing may touch the gel"):
        topic.intake.begin(tmp_path / "gel.toml", reference=8, options={})


def test_which_types_are_pictures() -> None:
    assert are_pictures("sensor_msgs/msg/Image")
    assert are_pictures("sensor_msgs/CompressedImage")
    assert not are_pictures("sensor_msgs/msg/PointCloud2")
