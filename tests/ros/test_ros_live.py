"""The node for ROS 2 as a robot meets it: `palpate ros` in a process of its own, publishers and subscribers of ROS in this one."""

from __future__ import annotations

import array
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import test_ros_pictures as gels

import palpate as pp
from palpate.calibrate import write_calibrated
from palpate.ros import message_class, ros_client
from skin_files import SHEAR, skin_text

# two processes that find each other over the network's own discovery: the gate runs it, where ROS is
pytestmark = [
    pytest.mark.long,
    # the parser of message definitions that comes with ROS's own wheels
    pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning"),
]

SKIN = skin_text(4, 4, channels=SHEAR, pitch="3 mm", depth="2 mm", noise="100 Pa") + (
    '\n[stream]\ntopic = "/finger"\nunit = "kPa"\n'
)
#: What one answer consists of.
PARTS = ("wrench", "wrench_low", "wrench_high", "center", "traction")
WRENCH, IMAGE = "geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/Image"
#: How long something may take on a busy machine [s].
PATIENCE = 180.0


class Robot:
    """A node with the publishers and subscribers of a robot, and the readings that its sensor gives."""

    def __init__(self, kind: str = IMAGE, topic: str = "/finger") -> None:
        self.kind, self.topic = kind, topic
        self.client = ros_client()
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.qos import DurabilityPolicy, QoSProfile

        self.context = self.client.Context()
        self.client.init(context=self.context)
        self.node = self.client.create_node("robot", context=self.context)
        self.heard: dict[str, list[Any]] = {}
        past = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for topic, kind, profile in (
            ("/palpate/wrench", WRENCH, 100),
            ("/palpate/wrench_low", WRENCH, 100),
            ("/palpate/wrench_high", WRENCH, 100),
            ("/palpate/center", "geometry_msgs/msg/PoseWithCovarianceStamped", 100),
            ("/palpate/traction", "sensor_msgs/msg/PointCloud2", 100),
            ("/palpate/utilisation", "std_msgs/msg/Float32", 100),
            ("/palpate/events", "std_msgs/msg/String", past),
            ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", 10),
        ):
            kept = self.heard[topic.removeprefix("/palpate/")] = []
            self.node.create_subscription(message_class(kind), topic, kept.append, profile)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()
        self.driver: Any = None
        self.restart()

    def restart(self) -> None:
        """The sensor's driver as it is after a crash: another publisher."""
        from rclpy.qos import qos_profile_sensor_data

        if self.driver is not None:
            self.node.destroy_publisher(self.driver)
        self.driver = self.node.create_publisher(message_class(self.kind), self.topic, qos_profile_sensor_data)

    def send(self, readings: Any, at: float) -> None:
        """One frame [Pa] with its stamp."""
        values = np.ascontiguousarray(np.moveaxis(np.asarray(readings) * 1e-3, 0, -1), dtype="<f4")
        rows, columns = values.shape[:2]
        message = message_class(IMAGE)(height=rows, width=columns, encoding="32FC3", step=12 * columns)
        message.data = array.array("B", values.tobytes())
        message.header.stamp.sec, message.header.stamp.nanosec = int(at), round((at - int(at)) * 1e9)
        message.header.frame_id = "fingertip"
        self.driver.publish(message)

    def show(self, picture: Any, at: float) -> None:
        """One picture of a gel, raw or as a PNG."""
        message = message_class(self.kind)()
        told = gels.image(picture, at, "mono8" if self.kind == IMAGE else "png")
        for name in vars(told).keys() - {"header"}:
            setattr(message, name, getattr(told, name))
        message.header.stamp.sec, message.header.stamp.nanosec = told.header.stamp.sec, told.header.stamp.nanosec
        message.header.frame_id = "fingertip"
        self.driver.publish(message)

    def until(self, done: Callable[[], Any], what: str, meanwhile: Callable[[], None] = lambda: None) -> Any:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            meanwhile()
            found = done()
            if found:
                return found
            time.sleep(0.02)
        raise AssertionError(f"not within {PATIENCE:g} s: {what}; events: {self.events()}")

    def events(self) -> list[str]:
        return [m.data for m in self.heard["events"]]

    def call(self, kind: Any, service: str, request: Any) -> Any:
        client = self.node.create_client(kind, service)
        assert client.wait_for_service(timeout_sec=PATIENCE)
        future = client.call_async(request)
        self.until(future.done, service)
        self.node.destroy_client(client)
        return future.result()

    def set(self, name: str, value: float) -> Any:
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        return self.call(SetParameters, "/palpate/set_parameters", request).results[0]

    def close(self) -> None:
        self.executor.shutdown(timeout_sec=60.0)
        self.thread.join(timeout=60.0)
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """On a domain of its own, on this machine only; without ROS the tests are left out, in the words of the error."""
    ros_client()
    found = tmp_path_factory.mktemp("ros")
    (found / "skin.toml").write_text(SKIN)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        patch.setenv("ROS_LOG_DIR", str(found))
        yield found


def started(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    skin = [] if "--skin" in arguments else ["--skin", "skin.toml"]
    with (folder / "node.log").open("w") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "palpate", "ros", *skin, *arguments],
            cwd=folder, stdout=log, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip


def ended(process: subprocess.Popen[str], how: int = signal.SIGINT) -> int:
    process.send_signal(how)
    try:
        return process.wait(PATIENCE)
    finally:
        process.kill()


def test_a_robot_and_the_node(folder: Path) -> None:
    robot = Robot()
    process = started(
        folder, "--baseline", "5", "--budget", "60000", "--record", "run.h5", "--ros-args", "-p", "max_force:=3"
    )
    try:
        story(robot, pp.Skin.from_file(folder / "skin.toml"))
        assert ended(process) == 130, (folder / "node.log").read_text()
    finally:
        process.kill()
        process.wait()
        robot.close()
    assert len(pp.recordings.read_recording(folder / "run.h5").time) > 5


def stamp(message: Any) -> tuple[int, int]:
    return message.header.stamp.sec, message.header.stamp.nanosec


def newest(heard: dict[str, list[Any]], force: tuple[float, float], *topics: str) -> dict[str, Any] | None:
    """The messages of one time, the newest that all of these topics have had, once its force lies between these [N]."""
    by_time = {t: {stamp(m): m for m in heard[t]} for t in topics}
    shared = set.intersection(*(set(by_time[t]) for t in topics))
    found = {t: by_time[t][max(shared)] for t in topics} if shared else {}
    return found if found and force[0] < found["wrench"].wrench.force.z < force[1] else None


def story(robot: Robot, skin: pp.Skin) -> None:
    rest = np.zeros((3, 4, 4))
    press = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=4e-3, force=2.0)))
    heard, now = robot.heard, [1000.0]

    def frame(readings: Any = press) -> None:
        now[0] += 0.02
        robot.send(readings, now[0])

    def force() -> Any:
        return heard["wrench"][-1].wrench.force if heard["wrench"] else None

    # a late publisher, a zero, a press
    robot.until(lambda: len(heard["wrench"]) > 7, "an answer at rest", lambda: frame(rest))
    # each topic comes when it comes, and the first frames of a contact know less of it
    at = robot.until(lambda: newest(heard, (1.85, 2.15), *PARTS), "a press, every part of its answer", frame)
    last = at["wrench"]
    assert last.header.frame_id == "fingertip"
    assert 1000.0 < last.header.stamp.sec + 1e-9 * last.header.stamp.nanosec <= now[0] + 1e-6
    low, high = at["wrench_low"].wrench.force, at["wrench_high"].wrench.force
    assert low.z < high.z
    assert low.z - 0.1 < 2.0 < high.z + 0.1
    cloud = at["traction"]
    points = np.frombuffer(bytes(cloud.data), dtype="<f4").reshape(-1, len(cloud.fields))
    assert points[:, 5].sum() == pytest.approx(2.0, abs=0.2)
    assert at["center"].pose.covariance[0] > 0
    robot.until(lambda: any("contact began" in text for text in robot.events()), "an event")

    # limits from the launch file, changed while it runs; what cannot be is refused
    robot.until(lambda: robot.set("max_force", 1.0).successful, "a parameter")
    robot.until(lambda: any("excess force began" in t for t in robot.events()), "an excess", frame)
    refused = robot.set("friction", -1.0)
    assert not refused.successful
    assert "friction must be a number from 0 on; got -1.0" in refused.reason
    assert robot.set("friction", 0.4).successful
    robot.until(lambda: any("the friction is 0.4" in t for t in robot.events()), "another friction", frame)
    many = len(heard["wrench"])
    robot.until(lambda: len(heard["wrench"]) > many + 5, "answers", frame)
    robot.until(lambda: abs(force().z - 2.0) < 0.2, "the zero was kept", frame)

    # messages that do not fit are refused and said; the stream goes on
    def misfit() -> None:
        frame(np.zeros((3, 5, 4)))
        frame()

    robot.until(lambda: any("20 taxels do not make a shape of 4 x 4" in t for t in robot.events()), "a refusal", misfit)

    # a driver that is killed and started again, with a clock that begins anew
    robot.restart()
    now[0] = 0.0
    robot.until(lambda: heard["wrench"][-1].header.stamp.sec < 1000, "answers after a restart", frame)
    robot.until(lambda: abs(force().z - 2.0) < 0.2, "the same press", frame)

    # a new zero, while something touches: done, and said
    from std_srvs.srv import Trigger

    answer = robot.call(Trigger, "/palpate/rezero", Trigger.Request())
    assert answer.success
    assert "will count as zero" in answer.message
    robot.until(lambda: abs(force().z) < 0.1, "a new zero", frame)

    # the topic falls silent: no old answer is sent again, and the diagnostics say so
    robot.until(lambda: any(s.status[0].level == b"\x03" for s in heard["/diagnostics"][-1:]), "stale")
    time.sleep(0.3)
    answered = [stamp(m) for m in heard["wrench"]]
    assert len(set(answered)) == len(answered)


@pytest.mark.parametrize("kind", [IMAGE, "sensor_msgs/msg/CompressedImage"])
def test_a_camera_gel_and_the_node(folder: Path, kind: str) -> None:
    """Pictures of a gel in, among them those that tell nothing; the node started again finds the gel at rest anew."""
    (folder / "gel.toml").write_text(gels.SKIN)
    topic = "/gel/image_raw" if kind == IMAGE else "/gel/image_raw/compressed"
    film = f"{kind.rpartition('/')[2]}.h5"
    robot = Robot(kind, topic)
    command = ("--skin", "gel.toml", "--topic", topic, "--budget", "60000", "--friction", "0.6")
    process = started(folder, *command, "--record", film)
    try:
        watch(robot)
        assert ended(process) == 130, (folder / "node.log").read_text()
        for heard in robot.heard.values():
            heard.clear()
        process = started(folder, *command, "--type", kind)
        watch(robot)
        assert ended(process) == 130, (folder / "node.log").read_text()
    finally:
        process.kill()
        process.wait()
        robot.close()
    recording = pp.recordings.read_recording(folder / film)
    assert recording.readings.shape[1:] == (2, 35)
    assert recording.positions is not None


def watch(robot: Robot) -> None:
    rest, pressed = gels.filmed()[0], gels.filmed()[4]
    heard, now = robot.heard, [1000.0]

    def show(picture: Any = pressed) -> None:
        now[0] += 0.05
        robot.show(picture, now[0])

    def force() -> Any:
        return heard["wrench"][-1].wrench.force if heard["wrench"] else None

    # pictures are 50 ms apart by their stamps; a robot that sends them without a pause would leave out most
    def at_rest() -> None:
        show(rest)
        time.sleep(0.03)

    robot.until(lambda: len(heard["wrench"]) > 5 and abs(force().x) < 0.02, "rest", at_rest)
    assert any("35 dots; the first 3 pictures are the gel at rest" in text for text in robot.events())
    robot.until(lambda: abs(force().x - 0.45) < 0.03 and abs(force().y) < 0.03, "a press and its shear", show)
    assert heard["wrench"][-1].header.frame_id == "fingertip"
    robot.until(lambda: robot.set("friction", 0.5).successful, "another friction")
    robot.until(lambda: any("the friction is 0.5" in t for t in robot.events()), "the words of it", show)
    robot.until(lambda: abs(force().x - 0.45) < 0.03, "the same press", show)

    for picture, words in (
        (gels.BLACK, "the picture is black"),
        (pressed[:100], "the picture is 160 x 100, the first was 160 x 120"),
    ):
        robot.until(lambda words=words: words in robot.events(), words, lambda picture=picture: show(picture))
        robot.until(lambda: np.isnan(force().x), "no answer", lambda picture=picture: show(picture))
    robot.until(lambda: abs(force().x - 0.45) < 0.03, "an answer again", show)
    assert "the pictures are good again" in robot.events()

    # a camera that is started again, with a clock that begins anew
    robot.restart()
    now[0] = 10.0
    robot.until(lambda: heard["wrench"][-1].header.stamp.sec < 1000, "answers after a restart", show)
    robot.until(lambda: abs(force().x - 0.45) < 0.03, "the same press", show)


def test_the_zero_of_a_calibration_serves_where_none_is_taken(folder: Path) -> None:
    """A node that starts under load, on raw readings with an offset: as palpate live does."""
    skin = pp.Skin.from_file(folder / "skin.toml")
    rng, shape = np.random.default_rng(0), (3, 4, 4)
    offset = 2e4 + 2e3 * rng.standard_normal(shape)
    force = np.linspace(0.5, 4.0, 12)
    presses = [np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=4e-3, force=f))) for f in force]
    frames = offset + np.array([np.zeros(shape)] * 12 + presses) + 50.0 * rng.standard_normal((24, *shape))
    found = skin.calibrate(frames, reference=np.r_[np.zeros(12), force])
    write_calibrated(folder / "calibrated.toml", folder / "skin.toml", found.calibration)
    robot = Robot()
    process = started(folder, "--skin", "calibrated.toml", "--budget", "60000")
    at = [1000.0]

    def press() -> None:
        at[0] += 0.02
        robot.send(offset + presses[6], at[0])

    try:
        near = robot.until(
            lambda: newest(robot.heard, (0.9 * force[6], 1.1 * force[6]), "wrench", "wrench_low"), "2.4 N", press
        )
        assert near["wrench_low"].wrench.force.z > 0.0
        assert ended(process) == 130, (folder / "node.log").read_text()
    finally:
        process.kill()
        process.wait()
        robot.close()
    assert "that of the calibration" in (folder / "node.log").read_text()


def test_a_node_that_waits_says_so_and_ends(folder: Path) -> None:
    process = started(folder, "--topic", "/nobody")
    log = folder / "node.log"
    end = time.monotonic() + PATIENCE
    while "waiting for a publisher of /nobody" not in log.read_text() and time.monotonic() < end:
        time.sleep(0.1)
    assert ended(process, signal.SIGTERM) == 143, log.read_text()
    assert "waiting for a publisher of /nobody" in log.read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--skin", "gel.toml", "--topic", "/finger", "--type", WRENCH], "gel.toml describes pictures"),
        (["--skin", "gel.toml"], "name it, e.g. --topic /gel/image_raw"),
        (["--ros-args", "-p", "friction:=-1.0"], "friction must be a number from 0 on"),
        (["--ros-args", "-r", "nonsense"], "ROS does not begin"),
        (["--type", "no_such_msgs/msg/Skin"], "no_such_msgs"),
    ],
)
def test_what_cannot_be_is_said_at_once(folder: Path, arguments: list[str], said: str) -> None:
    (folder / "gel.toml").write_text(gels.SKIN)
    kind = [] if "--type" in arguments else ["--type", IMAGE]
    process = started(folder, *kind, *arguments)
    assert process.wait(PATIENCE) == 2
    text = (folder / "node.log").read_text()
    assert said in text.splitlines()[-1]
    assert "Traceback" not in text
