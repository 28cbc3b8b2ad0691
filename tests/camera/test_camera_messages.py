"""Pictures of a gel from what a robot recorded: sensor_msgs/Image and CompressedImage in MCAP files and ROS 2 bags, without ROS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import palpate as pp
from palpate.camera import is_pictures, open_pictures
from palpate.camera.messages import picture_topics
from palpate.recordings.messages import ros_types

cv2 = pytest.importorskip("cv2")
pytest.importorskip("rosbags")
pytest.importorskip("mcap")

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


def encoded(store, image: np.ndarray, time: float, encoding: str):
    """A message of a picture (row, column, red green blue)."""
    types = store.types
    whole = int(time)
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=whole, nanosec=round((time - whole) * 1e9)), frame_id="gel"
    )
    if encoding in ("png", "jpeg"):
        data = cv2.imencode(f".{encoding}", image[..., ::-1])[1]
        return COMPRESSED, types[COMPRESSED](
            header=header, format=encoding, data=np.asarray(data, dtype=np.uint8).ravel()
        )
    raw = {
        "rgb8": image,
        "bgr8": image[..., ::-1],
        "rgba8": np.concatenate([image, np.zeros_like(image[..., :1])], axis=-1),
        "mono8": image[..., :1],
        "mono16": image[..., :1].astype("<u2") * 257,
    }[encoding]
    rows = np.ascontiguousarray(raw).view(np.uint8).reshape(len(image), -1)
    # rows may be longer than their pixels
    rows = np.concatenate([rows, np.zeros((len(rows), 4), np.uint8)], axis=1)
    return IMAGE, types[IMAGE](
        header=header,
        height=image.shape[0],
        width=image.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=rows.shape[1],
        data=rows.ravel(),
    )


def write(path: Path, images, encoding: str, *, topics=("/gel",), rate: float = 30.0) -> None:
    """An MCAP file, or a bag where the name has no ending."""
    typesys = ros_types()
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    made = [(i / rate + 1.0, encoded(store, image, i / rate + 1.0, encoding)) for i, image in enumerate(images)]
    if not path.suffix:
        from rosbags.rosbag2 import StoragePlugin, Writer

        with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
            for topic in topics:
                connection = bag.add_connection(topic, made[0][1][0], typestore=store)
                for time, (kind, message) in made:
                    bag.write(connection, round(time * 1e9), store.serialize_cdr(message, kind))
        return
    from mcap.writer import Writer as McapWriter

    with path.open("wb") as file:
        out = McapWriter(file)
        out.start()
        kind = made[0][1][0]
        text = store.generate_msgdef(kind, ros_version=2)[0]
        schema = out.register_schema(kind, "ros2msg", text.encode())
        for topic in topics:
            channel = out.register_channel(topic, "cdr", schema)
            for time, (_, message) in made:
                at = round(time * 1e9)
                out.add_message(channel, at, bytes(store.serialize_cdr(message, kind)), at)
        out.finish()


@pytest.fixture
def images() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 255, (24, 32, 3), dtype=np.uint8) for _ in range(3)]


@pytest.mark.parametrize("name", ["film.mcap", "bag"])
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "mono8", "mono16", "png"])
@pytest.mark.long
def test_pictures_come_out_as_they_went_in(tmp_path, images, encoding, name) -> None:
    path = tmp_path / name
    write(path, images, encoding)
    assert is_pictures(path)
    with open_pictures(path) as opened:
        found = list(opened)
    assert [p.time for p in found] == pytest.approx([1.0, 1.0 + 1 / 30, 1.0 + 2 / 30])
    for picture, image in zip(found, images):
        expected = image if encoding in ("rgb8", "bgr8", "rgba8", "png") else image[..., 0]
        assert np.array_equal(picture.image, expected if encoding != "mono16" else expected.astype(np.uint16) * 257)


def test_jpeg_is_read_nearly_so(tmp_path) -> None:
    smooth = np.tile(np.linspace(0, 250, 32, dtype=np.uint8)[None, :, None], (24, 1, 3))
    write(tmp_path / "film.mcap", [smooth], "jpeg")
    (picture,) = open_pictures(tmp_path / "film.mcap")
    assert np.abs(picture.image.astype(int) - smooth).max() < 12


def test_readings_are_no_pictures(tmp_path) -> None:
    from palpate.recordings import Recording, write_recording

    path = tmp_path / "readings.mcap"
    write_recording(
        Recording(readings=np.zeros((3, 1, 4, 4)), channels=("stress_zz",), time=np.arange(3) / 10 + 1.0), path
    )
    assert picture_topics(path) == []
    assert not is_pictures(path)
    with pytest.raises(pp.InvalidInput, match="holds no pictures"):
        open_pictures(path)


def test_several_topics_have_to_be_named(tmp_path, images) -> None:
    path = tmp_path / "film.mcap"
    write(path, images, "rgb8", topics=("/left", "/right"))
    with pytest.raises(pp.InvalidInput, match="2 topics"):
        open_pictures(path)
    assert len(list(open_pictures(path, topic="/right"))) == 3
    with pytest.raises(pp.InvalidInput, match="no pictures in /middle"):
        open_pictures(path, topic="/middle")
    with pytest.raises(pp.InvalidInput, match="belongs to an MCAP file"):
        open_pictures(tmp_path / "film.mp4", topic="/left")


def test_a_broken_picture_is_said_and_the_others_are_used(tmp_path, images) -> None:
    from palpate.camera.messages import decoded

    typesys = ros_types()
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    _, message = encoded(store, images[0], 1.0, "rgb8")
    message.data = message.data[:100]
    with pytest.raises(pp.InvalidInput, match="takes 96 bytes a row"):
        decoded(message)
    message.encoding = "yuv422"
    with pytest.raises(pp.InvalidInput, match="'yuv422' are not read"):
        decoded(message)
