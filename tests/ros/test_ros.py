"""The node for ROS 2, without ROS: messages in, one publisher at a time, what is said where ROS is not there."""

from __future__ import annotations

import array
import math
import sys
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.network import Limits
from palpate.recordings import TopicMapping
from palpate.ros.client import message_class, ros_client
from palpate.ros.intake import Intake
from palpate.ros.outlet import CLOUD, TOPICS, Outlet, places
from palpate.status import Status

MAPPING = TopicMapping(topic="/finger", channels=["stress_xz", "stress_yz", "stress_zz"], scale=1e3)
SHAPE = (3, 2, 2)
SECOND = 10**9


def image(value: float = 1.0, *, at: float = 0.0, rows: int = 2, frame: str = "tip") -> Any:
    """sensor_msgs/Image as rclpy gives it."""
    values = np.full((rows, 2, 3), value, dtype="<f4")
    stamp = SimpleNamespace(sec=int(at), nanosec=round((at - int(at)) * 1e9))
    return SimpleNamespace(
        header=SimpleNamespace(stamp=stamp, frame_id=frame), encoding="32FC3", height=rows, width=2, step=24, is_bigendian=0,
        data=array.array("B", values.tobytes()),
    )  # fmt: skip


def info(publisher: str = "a", sequence: int | None = None) -> dict[str, Any]:
    found: dict[str, Any] = {"publisher_gid": {"data": publisher.encode() * 16}}
    return found if sequence is None else {**found, "publication_sequence_number": sequence}


class Graph:
    """Publishers that there are, and a clock."""

    def __init__(self) -> None:
        self.there = {(b"a" * 16).hex(): "/driver"}
        self.nanoseconds = 100 * SECOND
        self.words: list[str] = []

    def intake(self, mapping: TopicMapping = MAPPING, shape: tuple[int, ...] = SHAPE, **options: Any) -> Intake:
        made = Intake(mapping, shape, now=lambda: self.nanoseconds, publishers=lambda: self.there, **options)
        made.report = self.words.append
        return made


def taken(intake: Intake) -> list[tuple[int, float, Any]]:
    intake.close()
    return list(intake.frames())


def test_a_message_becomes_a_frame_with_its_stamp() -> None:
    intake = Graph().intake()
    assert intake.take(image(2.0, at=5.25), info(sequence=1)) == "frames"
    [(session, time, values)] = taken(intake)
    assert (session, time) == (1, 5.25)
    np.testing.assert_allclose(values, np.full(SHAPE, 2e3))
    assert (intake.header.stamp, intake.header.frame) == (5250 * 10**6, "tip")


def test_without_a_stamp_the_clock_of_ros_counts_and_never_stands_still() -> None:
    """A simulation's clock moves less often than a fast sensor sends."""
    graph = Graph()
    intake = graph.intake()
    for sequence in range(1, 5):
        graph.nanoseconds += SECOND // 100 if sequence == 3 else 0
        assert intake.take(image(), info(sequence=sequence)) == "frames"
    times = [time for _, time, _ in taken(intake)]
    assert times == sorted(set(times))
    assert times[-1] == pytest.approx(100.01, abs=1e-4)
    assert intake.header.stamp == graph.nanoseconds


def test_messages_that_do_not_fit_are_refused_by_name_and_the_stream_goes_on() -> None:
    graph = Graph()
    intake = graph.intake()
    broken = image(at=1.0)
    broken.data = broken.data[:-1]
    colours = image(at=1.15)
    colours.encoding = "rgb8"
    for sequence, message in enumerate([broken, image(at=1.1, rows=3), colours, image(at=1.2)]):
        intake.take(message, info(sequence=sequence))
    assert [time for _, time, _ in taken(intake)] == [1.2]
    assert (intake.counts["malformed"], intake.counts["frames"]) == (3, 1)
    assert "truncated" in graph.words[1]
    assert "/driver" in graph.words[1]


def test_a_shape_that_the_skin_does_not_have_says_both() -> None:
    graph = Graph()
    intake = graph.intake()
    intake.take(image(at=1.0, rows=3), info())
    assert taken(intake) == []
    assert "holds 3 x 3 x 2 numbers, the skin describes 3 x 2 x 2" in graph.words[-1]


def test_lost_messages_are_counted_by_their_sequence_numbers() -> None:
    intake = Graph().intake()
    for sequence in (1, 2, 5, 6):
        intake.take(image(at=sequence), info(sequence=sequence))
    assert intake.counts["lost"] == 2


def test_two_publishers_are_not_mixed() -> None:
    graph = Graph()
    graph.there[(b"b" * 16).hex()] = "/other"
    intake = graph.intake()
    assert intake.take(image(at=1.0), info("a", 1)) == "frames"
    assert intake.take(image(at=1.1), info("b", 1)) == "busy"
    assert intake.take(image(at=1.2), info("a", 2)) == "frames"
    assert "/driver" in str(intake.sender)
    assert any("/other" in text and "busy" in text for text in graph.words)


def test_a_publisher_that_has_left_makes_room_at_once() -> None:
    """Restarted, it is another publisher whose numbers begin anew."""
    graph = Graph()
    intake = graph.intake()
    intake.take(image(at=50.0), info("a", 1000))
    graph.there = {(b"b" * 16).hex(): "/driver"}
    assert intake.take(image(at=0.5), info("b", 1)) == "frames"
    assert [session for session, _, _ in taken(intake)] == [1, 2]


def test_a_publisher_that_died_without_leaving_makes_room_after_a_silence() -> None:
    """The graph still lists what was killed, for as long as its lease."""
    graph = Graph()
    graph.there[(b"b" * 16).hex()] = "/driver"
    intake = graph.intake(limits=Limits(silence=1e-3))
    intake.take(image(at=50.0), info("a", 1000))
    time.sleep(2e-3)
    intake.take(image(at=51.0), info("b", 1))
    assert intake.counts["sessions"] == 2


def test_a_clock_that_begins_anew_begins_a_session() -> None:
    """A simulation that is reset: the publisher and its numbers go on, its stamps do not."""
    intake = Graph().intake()
    for sequence, at in enumerate([50.0, 50.01, 0.01, 0.02, 0.03, 0.04]):
        intake.take(image(at=at), info(sequence=sequence))
    found = [(session, time) for session, time, _ in taken(intake)]
    assert found == [(1, 50.0), (1, 50.01), (2, 0.01), (2, 0.02), (2, 0.03), (2, 0.04)]


def test_markers_are_displaced_from_the_first_message() -> None:
    mapping = TopicMapping(
        topic="/gel", channels=["displacement_x", "displacement_y"], path="points", fields=["x", "y"], markers=True
    )

    def cloud(by: float, at: float) -> Any:
        stamp = SimpleNamespace(sec=0, nanosec=round(at * 1e9))
        points = [SimpleNamespace(x=i + by, y=2.0 * i) for i in range(3)]
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id=""), points=points)

    intake = Graph().intake(mapping, (2, 3))
    intake.take(cloud(0.0, 0.1), info(sequence=1))
    intake.take(cloud(0.25, 0.2), info(sequence=2))
    np.testing.assert_allclose(taken(intake)[-1][2], [[0.25] * 3, [0.0] * 3])


# -- what is sent ------------------------------------------------------------------------------------------------------


class Sent:
    """A publisher that somebody listens to."""

    def __init__(self) -> None:
        self.messages: list[Any] = []

    def publish(self, message: Any) -> None:
        self.messages.append(message)

    def get_subscription_count(self) -> int:
        return 1


def plain(**fields: Any) -> Any:
    vector = SimpleNamespace
    filled = {
        "header": vector(stamp=vector(), frame_id=""),
        "stamp": vector(),
        "wrench": vector(force=vector(), torque=vector()),
        "pose": vector(pose=vector(position=vector(), orientation=vector()), covariance=None),
    }
    return SimpleNamespace(**{**filled, **fields})


def outlet_of(touch: pp.Touch) -> tuple[Outlet, dict[str, Any]]:
    """What is sent for a touch whose message came with the stamp 7.5 s."""
    intake = Graph().intake()
    intake.header = type(intake.header)(7 * SECOND + SECOND // 2, "tip", 0)
    publishers = {name: Sent() for name in TOPICS}
    messages = dict.fromkeys({*TOPICS.values(), "std_msgs/msg/Header", "sensor_msgs/msg/PointField"}, plain)
    outlet = Outlet(publishers, messages, intake, pp.GraspMonitor(friction=0.5))
    outlet.touch(touch)
    return outlet, {name: sent.messages[-1] for name, sent in publishers.items() if sent.messages}


@pytest.fixture(scope="module")
def touch() -> pp.Touch:
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    array = pp.AreaArray(
        shape=(6, 6), pitch=2e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=50.0
    )
    skin = pp.Skin(pad, array)
    press = pp.solutions.hertz_point(contact_radius=3e-3, force=2.0).shifted(1e-3, -2e-3)
    with skin.track(friction=0.5) as tracker:
        # traction that is even in cells: without noise the interval holds no other error
        return tracker.step(skin.sense(skin.sample(press)), 1.0)


def points_of(cloud: Any) -> Any:
    return np.frombuffer(bytes(cloud.data), dtype="<f4").reshape(cloud.height, cloud.width, len(CLOUD))


def test_the_cloud_adds_up_to_the_wrench(touch: pp.Touch) -> None:
    _, sent = outlet_of(touch)
    points, wrench = points_of(sent["traction"]), sent["wrench"].wrench
    total = points[..., 3:6].sum(axis=(0, 1))
    np.testing.assert_allclose(total, [wrench.force.x, wrench.force.y, wrench.force.z], rtol=1e-4, atol=1e-4)
    moment = np.cross(points[..., :3], points[..., 3:6]).sum(axis=(0, 1))
    np.testing.assert_allclose(moment, [wrench.torque.x, wrench.torque.y, wrench.torque.z], rtol=1e-4, atol=1e-6)
    assert wrench.force.z == pytest.approx(2.0, abs=0.1)
    assert sent["wrench_low"].wrench.force.z < 2.0 < sent["wrench_high"].wrench.force.z
    assert (points[..., 6] >= 0).all()


def test_the_cloud_says_where_its_fields_lie(touch: pp.Touch) -> None:
    _, sent = outlet_of(touch)
    cloud = sent["traction"]
    assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
        (n, 4 * i, 7, 1) for i, n in enumerate(CLOUD)
    ]
    assert (cloud.point_step, cloud.row_step) == (28, 28 * cloud.width)
    assert len(cloud.data) == cloud.row_step * cloud.height
    grid = touch.surface
    np.testing.assert_allclose(points_of(cloud)[0, :, 0], grid.x, rtol=1e-6)
    np.testing.assert_allclose(points_of(cloud)[:, 0, 1], grid.axes[0], rtol=1e-6)


def test_the_centre_comes_with_its_covariance(touch: pp.Touch) -> None:
    _, sent = outlet_of(touch)
    pose = sent["center"].pose
    variance = np.reshape(pose.covariance, (6, 6))
    assert pose.pose.position.x == pytest.approx(1e-3, abs=3e-4)
    assert pose.pose.position.y == pytest.approx(-2e-3, abs=3e-4)
    assert 0 < variance[0, 0] < 1e-6
    np.testing.assert_array_equal(np.diag(variance)[2:], 1e6)


def test_an_answer_carries_the_stamp_and_frame_of_its_message(touch: pp.Touch) -> None:
    _, sent = outlet_of(touch)
    for name in ("wrench", "wrench_low", "center", "traction"):
        header = sent[name].header
        assert (header.stamp.sec, header.stamp.nanosec, header.frame_id) == (7, 5 * 10**8, "tip")


def test_a_frame_without_an_answer_is_nan_and_not_the_last_one(touch: pp.Touch) -> None:
    pad = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
    skin = pp.Skin(
        pad, pp.AreaArray(shape=(4, 4), pitch=2e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"])
    )
    with skin.track() as tracker:
        lost = tracker.step(np.full((3, 4, 4), np.nan), 1.0)
    outlet, sent = outlet_of(lost)
    assert outlet.status is Status.MISSING
    assert math.isnan(sent["wrench"].wrench.force.z)
    assert math.isnan(sent["utilisation"].data)
    assert sent["traction"].is_dense is False


def test_cells_of_a_line_lie_along_x() -> None:
    out = places(pp.LineGrid(count=4, spacing=1e-3))
    assert out.shape == (1, 4, len(CLOUD))
    assert (out[..., 1:] == 0).all()


# -- where ROS is not there --------------------------------------------------------------------------------------------


def test_without_rclpy_the_remedy_fits_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    with pytest.raises(pp.Unsupported, match=r'pip install "palpate\[ros2\]"'):
        ros_client()
    monkeypatch.setattr("platform.machine", lambda: "aarch64")
    with pytest.raises(pp.Unsupported, match=r"no wheels of it for linux on aarch64.*source /opt/ros"):
        ros_client()


def test_a_library_of_another_ros_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(name: str) -> Any:
        raise ImportError("librcl.so: cannot open shared object file")

    monkeypatch.setattr("importlib.import_module", broken)
    with pytest.raises(pp.Unsupported, match=r"librcl\.so: cannot open.*this Python"):
        ros_client()


@pytest.mark.parametrize(
    ("name", "said"),
    [("Image", "package/msg/Name"), ("no_such_msgs/msg/Skin", "no_such_msgs.*workspace"), ("", "package/msg/Name")],
)
def test_types_that_are_not_here(name: str, said: str) -> None:
    with pytest.raises(pp.InvalidInput, match=said):
        message_class(name)
