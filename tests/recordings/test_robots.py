"""What robots record: bags, message types of the field, and the few lines of TOML that make readings of them."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import CliRunner
from palpate import solutions
from palpate.cli import app
from palpate.recordings import TopicMapping, read_recording, read_stream, write_recording
from palpate.recordings.mcapfile import McapRecorder
from palpate.recordings.robots import topics
from skin_files import skin_text

for library in ("mcap", "rosbags", "foxglove", "mcap_protobuf"):
    pytest.importorskip(library)

SHEAR = ("stress_xz", "stress_yz", "stress_zz")
SKIN = skin_text(4, 6, channels=SHEAR, depth="1.5 mm")
XELA = {
    "xela_server_ros2/msg/SensStream": "xela_server_ros2/SensorFull[] sensors\n",
    "xela_server_ros2/msg/SensorFull": (
        "uint8 message\nfloat64 time\nstring model\nuint8 sensor_pos\nxela_server_ros2/Taxel[] taxels\n"
        "xela_server_ros2/Forces[] forces\n"
    ),
    "xela_server_ros2/msg/Taxel": "uint16 x\nuint16 y\nuint16 z\n",
    "xela_server_ros2/msg/Forces": "float32 x\nfloat32 y\nfloat32 z\n",
}
TRUTH = np.random.default_rng(0).integers(0, 60_000, (5, 3, 24))


def store() -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    found = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in XELA.items():
        found.register(get_types_from_msg(text, name))
    found.register(get_types_from_msg("std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors\n", "tactile_msgs/msg/TactileState"))  # fmt: skip
    return found


def bag(folder: Path, messages: list[tuple[str, str, int, Any]], types: Any, version: int = 9) -> Path:
    """A ROS 2 bag of (topic, type, nanoseconds, message)."""
    from rosbags.rosbag2 import Writer

    with Writer(folder, version=version) as writer:
        connections = {}
        for topic, kind, stamp, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(connections[topic], stamp, types.serialize_cdr(message, kind))
    return folder


def xela(types: Any) -> list[tuple[str, str, int, Any]]:
    taxel, sensor, whole = (types.types[f"xela_server_ros2/msg/{n}"] for n in ("Taxel", "SensorFull", "SensStream"))
    made = []
    for i, frame in enumerate(TRUTH):
        taxels = [taxel(*(int(v) for v in frame[:, n])) for n in range(24)]
        one = sensor(message=i, time=100.0 + 0.25 * i, model="uSPa46", sensor_pos=0, taxels=taxels, forces=[])
        made.append(("/xServTopic", "xela_server_ros2/msg/SensStream", 10**9 * i, whole(sensors=[one])))
    return made


STREAM = """
[stream]
topic = "/xServTopic"
path = "sensors[0].taxels"
fields = ["x", "y", "z"]
unit = ["25 Pa", "25 Pa", "-0.03 kPa"]
stamp = "sensors[0].time"
"""


@pytest.mark.long
def test_xela_by_a_few_lines_of_toml(tmp_path: Path) -> None:
    folder = bag(tmp_path / "finger", xela(store()), store())
    (tmp_path / "skin.toml").write_text(SKIN + STREAM)
    mapping = read_stream(tmp_path / "skin.toml")
    assert mapping == TopicMapping(
        topic="/xServTopic", channels=SHEAR, path="sensors[0].taxels", fields=("x", "y", "z"), scale=(25.0, 25.0, -30.0),
        shape=(4, 6), stamp="sensors[0].time",
    )  # fmt: skip
    found = read_recording(folder, mapping=mapping)
    np.testing.assert_array_equal(
        found.readings, (TRUTH.reshape(5, 3, 4, 6) * np.array([25, 25, -30]).reshape(3, 1, 1)).astype(np.float32)
    )
    np.testing.assert_array_equal(found.time, 100.0 + 0.25 * np.arange(5))
    assert topics(folder) == {"/xServTopic": "xela_server_ros2/msg/SensStream"}
    # and the commands take the bag as it is
    result = CliRunner().invoke(
        app, ["convert", str(folder), str(tmp_path / "a.nc"), "--skin", str(tmp_path / "skin.toml")]
    )
    assert result.exit_code == 0, result.output
    np.testing.assert_array_equal(read_recording(tmp_path / "a.nc").readings, found.readings)
    for command in ("track", "reconstruct"):
        result = CliRunner().invoke(
            app,
            [command, str(folder), "--skin", str(tmp_path / "skin.toml"), "--out", str(tmp_path / f"{command}.npz")],
        )
        assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('unit = "25 mm"', "line 15: unit has the unit 'mm'"),
        ("unit = 25", "unit"),
        ('unit = ["25 Pa", "25 Pa"]', "one per channel"),
        ('unit = "0 Pa"', "not 0"),
        ('unit = "Pa"\nfields = ["x"]', "1 fields for 3 channels"),
        ('unit = "Pa"\nfeilds = ["x"]', "feilds is not a key"),
        ('unit = "Pa"\nchannels = ["pressure"]', "pressure"),
        ('unit = "Pa"\nmarkers = true', "displacement_x"),
        ("", "[stream] has no unit"),
    ],
)
def test_wrong_lines_are_named(tmp_path: Path, line: str, words: str) -> None:
    (tmp_path / "skin.toml").write_text(f'{SKIN}\n[stream]\ntopic = "/a"\n{line}\n')
    with pytest.raises(pp.InvalidInput) as caught:
        read_stream(tmp_path / "skin.toml")
    assert words in str(caught.value)
    assert str(tmp_path / "skin.toml") in str(caught.value)


def test_units_alone(tmp_path: Path) -> None:
    (tmp_path / "skin.toml").write_text(SKIN + '\n[stream]\ntopic = "/a"\nunit = "kPa"\n')
    mapping = read_stream(tmp_path / "skin.toml")
    assert mapping is not None
    assert mapping.scale == (1e3, 1e3, 1e3)
    (tmp_path / "plain.toml").write_text(SKIN)
    assert read_stream(tmp_path / "plain.toml") is None
    result = CliRunner().invoke(app, ["convert", "x.mcap", "y.nc", "--skin", str(tmp_path / "plain.toml")])
    assert "no section [stream]" in str(result.exception)


@pytest.mark.long
def test_tactile_state_and_wrong_names(tmp_path: Path) -> None:
    """Pressure alone, from a bag of an older ROS, which carries no definitions."""
    types = store()
    header, stamp, channel, state = (
        types.types[n]
        for n in (
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
            "sensor_msgs/msg/ChannelFloat32",
            "tactile_msgs/msg/TactileState",
        )
    )
    made = []
    for i, frame in enumerate(TRUTH[:, 2]):
        head = header(stamp=stamp(sec=7, nanosec=int(2e8) * i), frame_id="tip")
        values = channel(name="tip", values=frame.astype(np.float32))
        made.append(("/tactile", "tactile_msgs/msg/TactileState", 10**7 * i, state(header=head, sensors=[values])))
    folder = bag(tmp_path / "tip", made, types, version=8)
    mapping = TopicMapping(
        topic="/tactile",
        channels=("stress_zz",),
        path="sensors[0].values",
        shape=(4, 6),
        stamp="header.stamp",
        scale=2.0,
    )
    found = read_recording(folder, mapping=mapping)
    np.testing.assert_array_equal(found.readings[:, 0], 2.0 * TRUTH[:, 2].reshape(5, 4, 6))
    np.testing.assert_allclose(found.time, 7.0 + 0.2 * np.arange(5))
    for wrong, words in (
        (TopicMapping(topic="/tip", channels=("stress_zz",)), "has no topic /tip; it has /tactile (tactile_msgs"),
        (TopicMapping(topic="/tactile", channels=("stress_zz",)), "There is header, sensors"),
        (TopicMapping(topic="/tactile", channels=("stress_zz",), path="sensors"), "There is name, values"),
        (TopicMapping(topic="/tactile", channels=("stress_zz",), path="sensors[0].numbers"), "There is name, values"),
        (
            TopicMapping(topic="/tactile", channels=("stress_zz",), path="sensors[0].values", stamp="header"),
            "not a time",
        ),
    ):
        with pytest.raises(pp.InvalidInput) as caught:
            read_recording(folder, mapping=wrong)
        assert words in str(caught.value)
    with pytest.raises(pp.InvalidInput, match="not written by palpate"):
        read_recording(folder)


@pytest.mark.long
def test_definitions_that_the_bag_lacks(tmp_path: Path) -> None:
    folder = bag(tmp_path / "old", xela(store()), store(), version=8)
    mapping = TopicMapping(topic="/xServTopic", channels=SHEAR, path="sensors[0].taxels", fields=("x", "y", "z"))
    # what an older ROS leaves out
    text = (folder / "metadata.yaml").read_text()
    import sqlite3

    with (
        contextlib.closing(sqlite3.connect(next(folder.glob("*.db3")))) as database,
        database,
    ):  # `with` commits, and does not close
        if database.execute("select count(*) from sqlite_master where name='message_definitions'").fetchone()[0]:
            database.execute("delete from message_definitions")
    assert "xela_server_ros2" in text
    with pytest.raises(pp.InvalidInput, match=r"does not define xela_server_ros2/msg/SensStream.*definitions"):
        read_recording(folder, mapping=mapping)
    messages = tmp_path / "share" / "xela_server_ros2" / "msg"
    messages.mkdir(parents=True)
    for name, words in XELA.items():
        (messages / f"{name.rsplit('/')[-1]}.msg").write_text(words)
    known = TopicMapping(**{**mapping.__dict__, "definitions": str(tmp_path / "share")})
    assert read_recording(folder, mapping=known).readings.shape == (5, 3, 24)
    with pytest.raises(pp.InvalidInput, match="no message definitions"):
        read_recording(folder, mapping=TopicMapping(**{**mapping.__dict__, "definitions": str(tmp_path / "none")}))


@pytest.mark.long
def test_grid_from_foxglove(tmp_path: Path) -> None:
    """The Grids that palpate writes are Grids that it reads: pressure and shear of a touch, as readings of others."""
    skin = pp.Skin(
        pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
        pp.AreaArray(shape=(7, 8), pitch=1e-3, depth=1e-3, channels=SHEAR),
    )
    touch = skin.reconstruct(
        skin.sense(skin.sample(solutions.hertz_point(contact_radius=2e-3, force=1.0).sliding(0.3)))
    )
    with McapRecorder(tmp_path / "a.mcap", ()) as out:
        for i in range(3):
            out.touch(touch, 0.1 * i)
    mapping = TopicMapping(
        topic="/palpate/touch", channels=SHEAR, fields=("shear_x", "shear_y", "pressure"), stamp="timestamp"
    )
    found = read_recording(tmp_path / "a.mcap", mapping=mapping)
    np.testing.assert_array_equal(
        found.readings, np.broadcast_to(touch.values.astype(np.float32), found.readings.shape)
    )
    np.testing.assert_allclose(found.time, [0.0, 0.1, 0.2])
    with pytest.raises(pp.InvalidInput, match="no field pressure_z; it has pressure, shear_x"):
        read_recording(
            tmp_path / "a.mcap",
            mapping=TopicMapping(topic="/palpate/touch", channels=("stress_zz",), fields=("pressure_z",)),
        )
    # what is palpate's own needs no mapping, and one of another topic does no harm
    recording = pp.Recording(readings=np.zeros((2, 1, 4)), channels=("stress_zz",))
    write_recording(recording, tmp_path / "own.mcap")
    elsewhere = TopicMapping(topic="/finger", channels=SHEAR)
    assert read_recording(tmp_path / "own.mcap", mapping=elsewhere).channels == ("stress_zz",)


@pytest.mark.long
def test_markers(tmp_path: Path) -> None:
    """Positions of markers become displacements from the first message, and their places."""
    types = store()
    point, cloud = types.types["geometry_msgs/msg/Point32"], types.types["sensor_msgs/msg/PointCloud"]
    header, stamp = types.types["std_msgs/msg/Header"], types.types["builtin_interfaces/msg/Time"]
    rng = np.random.default_rng(1)
    rest = rng.uniform(0, 300, (9, 2))
    moved = rest + rng.normal(0, 1, (4, 9, 2)) * np.array([0, 1, 1, 1]).reshape(4, 1, 1)
    made = [
        (
            "/markers",
            "sensor_msgs/msg/PointCloud",
            10**8 * i,
            cloud(
                header=header(stamp=stamp(sec=0, nanosec=0), frame_id=""),
                points=[point(x=float(x), y=float(y), z=0.0) for x, y in frame],
                channels=[],
            ),
        )
        for i, frame in enumerate(moved)
    ]
    folder = bag(tmp_path / "gel", made, types)
    (tmp_path / "gel.toml").write_text(
        '[pad]\nkind = "bonded_layers"\n[[pad.layer]]\nthickness = "4 mm"\nyoungs_modulus = "100 kPa"\npoissons_ratio = 0.49\n'
        '[[plane]]\nkind = "scattered"\ndepth = "1 mm"\nchannels = ["displacement_x", "displacement_y"]\n'
        '[stream]\ntopic = "/markers"\npath = "points"\nfields = ["x", "y"]\nunit = "50 um"\nmarkers = true\n'
    )
    found = read_recording(folder, mapping=read_stream(tmp_path / "gel.toml"))
    np.testing.assert_allclose(found.positions, 5e-5 * rest, rtol=1e-6)
    np.testing.assert_allclose(found.readings, 5e-5 * np.moveaxis(moved - rest, 1, 2), atol=5e-5 * 3e-5)
    skin = pp.Skin.from_file(tmp_path / "gel.toml", recording=found)
    assert skin.reconstruct(found.readings[1:]).values.shape == (len(moved) - 1, 3, *skin.surface.shape)
    # a marker that is lost in mid-stream
    (*head, last) = made
    last[3].points.pop()
    with pytest.raises(pp.InvalidInput, match="8 markers follow 9"):
        read_recording(bag(tmp_path / "lost", [*head, last], types), mapping=read_stream(tmp_path / "gel.toml"))


def test_ros1_bag(tmp_path: Path) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    array, layout = types.types["std_msgs/msg/Float32MultiArray"], types.types["std_msgs/msg/MultiArrayLayout"]
    with Writer(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/tip", "std_msgs/msg/Float32MultiArray", typestore=types)
        for i, frame in enumerate(TRUTH[:, 0]):
            message = array(layout=layout(dim=[], data_offset=0), data=frame.astype(np.float32))
            writer.write(connection, 10**8 * i, types.serialize_ros1(message, "std_msgs/msg/Float32MultiArray"))
    mapping = TopicMapping(topic="/tip", channels=("stress_zz",), path="data", shape=(4, 6))
    found = read_recording(tmp_path / "a.bag", mapping=mapping)
    np.testing.assert_array_equal(found.readings[:, 0], TRUTH[:, 0].reshape(5, 4, 6))


@pytest.mark.parametrize("part", ["metadata.yaml", "db3"])
def test_torn_bags(tmp_path: Path, part: str) -> None:
    folder = bag(tmp_path / "finger", xela(store()), store())
    file = folder / part if part.endswith("yaml") else next(folder.glob("*.db3"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 3])
    mapping = TopicMapping(topic="/xServTopic", channels=SHEAR, path="sensors[0].taxels", fields=("x", "y", "z"))
    with pytest.raises(pp.PalpateError, match="finger"):
        read_recording(folder, mapping=mapping)
    (tmp_path / "no.bag").write_bytes(b"not a bag")
    with pytest.raises(pp.PalpateError, match=r"no\.bag"):
        read_recording(tmp_path / "no.bag", mapping=mapping)
