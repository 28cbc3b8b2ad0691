"""MCAP: written while it happens, read by the reference readers, and what others recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from command_line import CliRunner
from palpate import simulation, solutions
from palpate.cli import app
from palpate.recordings import TopicMapping, read_recording, write_recording, write_touch
from palpate.recordings.mcapfile import McapRecorder
from palpate.recordings.robots import read_robot, topics
from skin_files import SHEAR, skin_text

mcap = pytest.importorskip("mcap.reader")
typesys = pytest.importorskip("rosbags.typesys")
pytest.importorskip("foxglove")

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
ARRAY = pp.AreaArray(shape=(10, 12), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
SKIN = skin_text(10, 12, channels=SHEAR, depth="1.5 mm")


def recording(frames: int = 30, scattered: bool = False) -> pp.Recording:
    rng = np.random.default_rng(0)
    shape = (frames, 2, 7) if scattered else (frames, 3, 10, 12)
    values = rng.standard_normal(shape).astype(np.float32)
    values[3, 0, 2] = np.nan
    return pp.Recording(
        readings=values,
        channels=("displacement_x", "displacement_y") if scattered else tuple(ARRAY.channels),
        time=np.cumsum(rng.uniform(0.004, 0.006, frames)).round(9),
        positions=rng.uniform(0, 1e-2, (7, 2)) if scattered else None,
        meta={"sensor": "finger 3"},
    )


@pytest.mark.parametrize("scattered", [False, True])
def test_round_trip(tmp_path: Path, scattered: bool) -> None:
    before = recording(scattered=scattered)
    write_recording(before, tmp_path / "a.mcap")
    after = read_recording(tmp_path / "a.mcap")
    np.testing.assert_array_equal(after.readings, before.readings)
    np.testing.assert_allclose(after.time, before.time, rtol=0, atol=1e-9)
    assert after.channels == before.channels
    assert after.meta == before.meta
    if scattered:
        np.testing.assert_array_equal(after.positions, before.positions)
    write_recording(after, tmp_path / "b.nc")
    np.testing.assert_array_equal(read_recording(tmp_path / "b.nc").readings, before.readings)


@pytest.mark.long
def test_reference_readers_open_it(tmp_path: Path) -> None:
    """The library of the format, and the ROS 2 reader, agree on what was written."""
    skin = pp.Skin(PAD, ARRAY)
    touch = skin.reconstruct(
        skin.sense(np.stack([skin.sample(solutions.hertz_point(contact_radius=2e-3, force=f)) for f in (0.5, 1.0)])),
        method="constrained",
    )
    with McapRecorder(tmp_path / "a.mcap", ARRAY.channels) as out:
        for i in range(2):
            out.readings(0.5 + i, np.full((3, 10, 12), float(i)))
            out.touch(touch.frame(i), 0.5 + i)
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    seen: dict[str, list[Any]] = {}
    with open(tmp_path / "a.mcap", "rb") as file:
        reader = mcap.make_reader(file)
        assert reader.get_header().profile == "ros2"
        for schema, channel, message in reader.iter_messages():
            seen.setdefault(channel.topic, []).append((schema.name, message))
    assert {t: len(m) for t, m in seen.items()} == {
        "/palpate/readings": 2,
        "/palpate/touch": 2,
        "/palpate/wrench": 2,
    }
    name, message = seen["/palpate/wrench"][1]
    assert name == "geometry_msgs/msg/WrenchStamped"
    wrench = store.deserialize_cdr(message.data, name)
    assert wrench.wrench.force.z == pytest.approx(float(touch.force[1, 2]))
    assert (wrench.header.stamp.sec, wrench.header.stamp.nanosec) == (1, 500_000_000)
    assert seen["/palpate/touch"][0][0] == "foxglove.Grid"
    # the pressure lies in the grid's bytes as it does in the touch
    data, fields = seen["/palpate/touch"][1][1].data, 4
    pressure = np.ascontiguousarray(touch.values[1, 2], dtype="<f4")
    row = np.stack([pressure[8], touch.values[1, 0, 8], touch.std()[1, 2, 8], touch.values[1, 1, 8]], axis=-1)
    assert row.astype("<f4").tobytes() in data
    assert len(data) > pressure.size * 4 * fields


@pytest.mark.long
def test_what_others_recorded(tmp_path: Path) -> None:
    """A message of points (as xela_server's SensStream has) and one of numbers (as TactileState), definitions from the file."""
    from mcap.writer import Writer

    text = (
        "my/Sensor[] sensors\n"
        + "=" * 80
        + "\nMSG: my/Sensor\nuint8 number\nmy/Forces[] forces\nfloat32[] values\n"
        + "=" * 80
        + "\nMSG: my/Forces\nfloat32 x\nfloat32 y\nfloat32 z\n"
    )
    types = typesys.get_types_from_msg(text, "my/msg/Stream")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(types)
    point, sensor, stream = (store.types[f"my/msg/{n}"] for n in ("Forces", "Sensor", "Stream"))
    truth = np.arange(5 * 3 * 6, dtype=np.float32).reshape(5, 3, 6)
    with open(tmp_path / "robot.mcap", "wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("my/msg/Stream", "ros2msg", text.encode())
        channel = writer.register_channel("/finger", "cdr", schema)
        for i, frame in enumerate(truth):
            forces = [point(*(float(v) for v in frame[:, n])) for n in range(6)]
            message = stream(sensors=[sensor(number=1, forces=forces, values=frame[2])])
            writer.add_message(channel, i * 10**7, bytes(store.serialize_cdr(message, "my/msg/Stream")), i * 10**7)
        writer.finish()
    channels = ("stress_xz", "stress_yz", "stress_zz")
    mapping = TopicMapping(
        topic="/finger",
        channels=channels,
        path="sensors[0].forces",
        fields=("x", "y", "z"),
        scale=(2, 2, -3),
        shape=(2, 3),
    )
    found = read_robot(tmp_path / "robot.mcap", mapping)
    np.testing.assert_array_equal(found.readings, truth.reshape(5, 3, 2, 3) * np.array([2, 2, -3]).reshape(3, 1, 1))
    np.testing.assert_allclose(found.time, np.arange(5) * 0.01)
    normal = read_robot(
        tmp_path / "robot.mcap", TopicMapping(topic="/finger", channels=("stress_zz",), path="sensors[0].values")
    )
    np.testing.assert_array_equal(normal.readings[:, 0], truth[:, 2])
    result = CliRunner().invoke(
        app,
        [
            "convert", str(tmp_path / "robot.mcap"), str(tmp_path / "out.nc"), "--topic", "/finger", "--channels",
            ",".join(channels), "--path", "sensors[0].forces", "--fields", "x,y,z", "--scale", "2,2,-3", "--shape", "2x3",
        ],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    np.testing.assert_array_equal(read_recording(tmp_path / "out.nc").readings, found.readings)
    for wrong, words in (
        (TopicMapping(topic="/hand", channels=channels), "it has /finger"),
        (TopicMapping(topic="/finger", channels=channels, path="sensors[4].forces"), "no \\[4\\]"),
        (TopicMapping(topic="/finger", channels=channels, path="taxels"), "There is sensors"),
        (TopicMapping(topic="/finger", channels=("stress_zz",), path="sensors[0].values", shape=(4, 4)), "do not make"),
        (TopicMapping(topic="/finger", channels=channels, path="sensors[0].values"), "1 channels"),
    ):
        with pytest.raises(pp.InvalidInput, match=words):
            read_robot(tmp_path / "robot.mcap", wrong)
    with pytest.raises(pp.InvalidInput, match="not written by palpate"):
        read_recording(tmp_path / "robot.mcap")


@pytest.mark.parametrize("cut", [0.0, 0.001, 0.3, 0.5, 0.9, 0.999])
def test_torn_anywhere(tmp_path: Path, cut: float) -> None:
    write_recording(recording(200), tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "b.mcap").write_bytes(data[: int(cut * len(data))])
    with pytest.raises(pp.PalpateError):
        read_recording(tmp_path / "b.mcap")
    if cut >= 0.1:
        saved = read_robot(tmp_path / "b.mcap", salvage=True)
        assert len(saved.readings) >= int(200 * cut) - 60
    else:
        with pytest.raises(pp.PalpateError):
            read_robot(tmp_path / "b.mcap", salvage=True)


def test_noise_in_place_of_a_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for size in (1, 8, 100, 10_000):
        (tmp_path / "a.mcap").write_bytes(rng.bytes(size))
        for salvage in (False, True):
            with pytest.raises(pp.PalpateError):
                read_robot(tmp_path / "a.mcap", salvage=salvage)


def test_a_recording_is_never_overwritten(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "a.mcap", ["stress_zz"]) as out:
        out.readings(0.0, np.zeros((1, 4)))
        with pytest.raises(pp.InvalidInput, match="channels"):
            out.readings(0.1, np.zeros((2, 4)))
        with pytest.raises(pp.InvalidInput, match="from 0 on"):
            out.readings(-1.0, np.zeros((1, 4)))
    with pytest.raises(pp.InvalidInput, match="not overwritten"):
        McapRecorder(tmp_path / "a.mcap", ["stress_zz"])
    with pytest.raises(pp.InvalidInput, match="does not exist; make it first"):
        McapRecorder(tmp_path / "no" / "a.mcap", ["stress_zz"])
    assert len(read_recording(tmp_path / "a.mcap").readings) == 1


@pytest.mark.long
def test_track_from_the_shell(tmp_path: Path) -> None:
    skin = pp.Skin(PAD, ARRAY)
    frames = list(simulation.stream(skin, simulation.handling(0.6, 1e-3), friction=0.6, radius=10e-3, rate=20.0))
    values = np.stack([np.asarray(f.readings) for f in frames])
    values = values + 0.01 * np.abs(values).max() * np.random.default_rng(0).standard_normal(values.shape)
    stamps = np.array([f.time for f in frames])
    write_recording(pp.Recording(readings=values, channels=tuple(ARRAY.channels), time=stamps), tmp_path / "finger.nc")
    (tmp_path / "skin.toml").write_text(SKIN)
    common = ["track", str(tmp_path / "finger.nc"), "--skin", str(tmp_path / "skin.toml"), "--baseline", "8"]
    result = CliRunner().invoke(
        app, [*common, "--friction", "0.6", "--max-force", "0.5 N", "--out", str(tmp_path / "a.mcap")]
    )
    assert result.exit_code == 0, result.output
    for words in ("contact began", "excess force began", "incipient slip began", "contact ended", "left out: none"):
        assert words in result.output
    assert set(topics(tmp_path / "a.mcap")) == {
        "/palpate/readings", "/palpate/touch", "/palpate/wrench", "/palpate/events",
    }  # fmt: skip
    np.testing.assert_allclose(read_recording(tmp_path / "a.mcap").readings, values, rtol=1e-6)
    result = CliRunner().invoke(app, [*common, "--out", str(tmp_path / "touch.nc")])
    assert result.exit_code == 0, result.output
    import xarray

    np.testing.assert_array_equal(read_recording(tmp_path / "touch.nc").readings, values)
    with xarray.open_dataset(tmp_path / "touch.nc", engine="h5netcdf", group="touch") as found:
        held = np.array([f.stage == "hold" for f in frames])
        force = found["force"].values[held, 2]
        np.testing.assert_allclose(force, 0.6, atol=0.05)
        assert (found["force_high"].values[held, 2] > 0.55).all()
    result = CliRunner().invoke(app, [*common[:-1], "100000"])
    assert isinstance(result.exception, pp.InvalidInput)
    assert "leaves no frame" in str(result.exception)


@pytest.mark.long
def test_touch_as_mcap(tmp_path: Path) -> None:
    skin = pp.Skin(PAD, ARRAY)
    touch = skin.reconstruct(skin.sense(solutions.hertz_point(contact_radius=2e-3, force=1.0)))
    write_touch(touch, tmp_path / "touch.mcap")
    assert set(topics(tmp_path / "touch.mcap")) == {"/palpate/touch", "/palpate/wrench"}


@pytest.mark.parametrize("shape", [(1, 12), (12, 1), (12,), (1, 1), (1,)], ids=str)
def test_the_axes_of_a_frame_are_kept(tmp_path: Path, shape: tuple[int, ...]) -> None:
    """A message of one row may be taxels in any place, or an area of one row."""
    before = pp.Recording(readings=np.ones((3, 1, *shape)), channels=("stress_zz",))
    write_recording(before, tmp_path / "a.mcap")
    assert read_recording(tmp_path / "a.mcap").readings.shape == before.readings.shape


@pytest.mark.long
def test_double_precision_is_kept_where_single_rounds(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rounded = rng.normal(size=(3, 1, 4)).astype(np.float32)
    for name, values, kind in (
        ("single", rounded, np.float32),
        ("counts", np.float64([[[1.0, 2.0, 65535.0]]]), np.float32),
        ("double", rng.normal(size=(3, 1, 4)), np.float64),
        ("huge and tiny", np.array([[[1e300, -1e-300, np.nan]]]), np.float64),
    ):
        path = tmp_path / f"{name}.mcap"
        write_recording(pp.Recording(readings=values, channels=("stress_zz",)), path)
        found = read_recording(path).readings
        np.testing.assert_array_equal(found, values)
        assert found.dtype == kind, name


def test_readings_that_are_not_finite_are_missing(tmp_path: Path) -> None:
    """As they are for a tracker, whose stream goes on."""
    with McapRecorder(tmp_path / "a.mcap", ["stress_zz"]) as out:
        out.readings(0.0, np.array([[1.0, np.inf, -np.inf]]))
    np.testing.assert_array_equal(read_recording(tmp_path / "a.mcap").readings, [[[1.0, np.nan, np.nan]]])


def test_times_since_1970_come_back_to_the_last_bit(tmp_path: Path) -> None:
    time = 1.7e9 + 0.123456789 + 0.02 * np.arange(50)
    before = pp.Recording(readings=np.zeros((50, 1, 2)), channels=("stress_zz",), time=time)
    write_recording(before, tmp_path / "a.mcap")
    np.testing.assert_array_equal(read_recording(tmp_path / "a.mcap").time, time)


@pytest.mark.parametrize(
    ("time", "words"),
    [
        ([0.0, 1e-10, 2e-10], "frames 0 and 1 are 1e-10 s apart; write .nc"),
        ([-1.0, 0.0, 1.0], "from 0 on"),
        ([2.2e9, 2.3e9, 2.4e9], r"below 2\*\*31 s; got 2.2e\+09"),
    ],
)
def test_times_that_messages_cannot_keep_are_refused_before_anything_is_written(
    tmp_path: Path, time: list[float], words: str
) -> None:
    before = pp.Recording(readings=np.zeros((3, 1, 2)), channels=("stress_zz",), time=time)
    with pytest.raises(pp.InvalidInput, match=words):
        write_recording(before, tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_milliseconds_since_1970_are_said_and_kept(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time (s),stress_zz[0] (Pa)\n1700000000000,1\n1700000000010,3\n")
    with pytest.warns(pp.errors.UncheckedInput, match="taken as milliseconds since 1970"):
        found = read_recording(tmp_path / "a.csv")
    write_recording(found, tmp_path / "a.mcap")
    np.testing.assert_allclose(read_recording(tmp_path / "a.mcap").time, [1.7e9, 1.7e9 + 0.01], atol=1e-6)
