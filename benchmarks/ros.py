"""`palpate ros` at the rate of a robot: messages sent by one process, answered by the node in another, and what restarts do.

python benchmarks/ros.py [--rates 200 1000] [--seconds 10] [--taxels 4]
    python benchmarks/ros.py --gel 320 240 --rates 30 [--jpeg]    (pictures of a gel with 35 dots, bgr8 or JPEG, in place of taxels)

A simulated finger presses, twists and slides; each frame is a sensor_msgs/Image with best effort, as drivers send. Needs ROS 2 (palpate[ros2]). Both
processes run on this machine, on a domain of their own. Latency is from just before a message is published to when its wrench is received, by one
clock. Prints a table for each rate (cpu: the node's processor time per answer), and how long the node is without an answer when its publisher comes late, is killed, or leaves and comes again.
"""

from __future__ import annotations

import argparse
import array
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate import simulation
from palpate.ros import message_class, ros_client

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from camera_scenes import BALL, gel_file, small_scene
from skin_files import SHEAR, skin_text

STREAM = '\n[stream]\ntopic = "/finger"\nunit = "Pa"\n'
REST = 20
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


class Robot:
    """Publishes frames, and keeps what comes back: from a message's stamp to when its wrench came [ns]."""

    def __init__(self, frames: list[Any], kind: str = IMAGE) -> None:
        self.kind = kind
        client = ros_client()
        from rclpy.executors import SingleThreadedExecutor

        client.init()
        self.node = client.create_node("robot")
        self.frames = frames
        self.came: dict[int, int] = {}
        self.sent: list[int] = []
        self.diagnostics: dict[str, str] = {}
        self.level = b""
        self.words = ""
        self.node.create_subscription(
            message_class("geometry_msgs/msg/WrenchStamped"), "/palpate/wrench", self._came, 1000
        )
        self.node.create_subscription(
            message_class("diagnostic_msgs/msg/DiagnosticArray"), "/diagnostics", self._diagnosed, 10
        )
        executor = SingleThreadedExecutor()
        executor.add_node(self.node)
        threading.Thread(target=executor.spin, daemon=True).start()
        self.driver: Any = None

    def _came(self, message: Any) -> None:
        stamp = message.header.stamp
        self.came[stamp.sec * 10**9 + stamp.nanosec] = time.time_ns()

    def _diagnosed(self, message: Any) -> None:
        [status] = message.status
        self.level, self.words = status.level, status.message
        self.diagnostics = {v.key: v.value for v in status.values}

    def begin(self) -> None:
        from rclpy.qos import qos_profile_sensor_data

        self.driver = self.node.create_publisher(message_class(self.kind), "/finger", qos_profile_sensor_data)

    def leave(self) -> None:
        self.node.destroy_publisher(self.driver)

    def send(self, which: int) -> int:
        message = self.frames[which % len(self.frames)]
        now = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
        self.driver.publish(message)
        self.sent.append(now)
        return now

    def run(self, rate: float, seconds: float) -> list[int]:
        """Stamps of the frames that were sent."""
        begun, first = time.perf_counter(), len(self.sent)
        for i in range(int(rate * seconds)):
            self.send(i)
            wait = begun + (i + 1) / rate - time.perf_counter()
            if wait > 0:
                time.sleep(wait)
        return self.sent[first:]

    def wait(self, seconds: float = 60.0) -> float:
        """Send at 100 Hz until an answer comes to one of these; seconds that it took."""
        begun = time.monotonic()
        mine = []
        while time.monotonic() - begun < seconds:
            mine.append(self.send(0))
            time.sleep(0.01)
            if any(stamp in self.came for stamp in mine):
                return time.monotonic() - begun
        return float("nan")


def images(skin: pp.Skin) -> list[Any]:
    """The story as messages, after rest."""
    kind = message_class(IMAGE)
    story = simulation.stream(
        skin, simulation.handling(force=1.0), friction=0.6, radius=15e-3, rate=200.0, rng=np.random.default_rng(0)
    )
    out = []
    for readings in (f.readings for f in story):
        values = np.ascontiguousarray(np.moveaxis(np.asarray(readings), 0, -1), dtype="<f4")
        rows, columns, channels = values.shape
        message = kind(height=rows, width=columns, encoding=f"32FC{channels}", step=4 * channels * columns)
        message.data = array.array("B", values.tobytes())
        message.header.frame_id = "tip"
        out.append(message)
    return out


def pictures(columns: int, rows: int, kind: str) -> list[Any]:
    """A press that comes and goes, filmed; the gel is at rest first."""
    import cv2

    scene = small_scene(columns=columns, rows=rows)
    press = scene.skin.sample(BALL)
    rng = np.random.default_rng(0)
    out = []
    for part in (*[0.0] * REST, *np.sin(np.linspace(0.0, np.pi, 40)[1:]) ** 2):
        grey = scene.picture(part * press if part else None, rng=rng)
        data = np.repeat(np.asarray(grey, np.uint8)[..., None], 3, axis=-1)
        if kind == COMPRESSED:
            message = message_class(kind)(format="jpeg")
            message.data = array.array("B", cv2.imencode(".jpg", data)[1].tobytes())
        else:
            message = message_class(kind)(height=rows, width=columns, encoding="bgr8", step=3 * columns)
            message.data = array.array("B", data.tobytes())
        message.header.frame_id = "gel"
        out.append(message)
    return out


def started(folder: Path, kind: str) -> subprocess.Popen[bytes]:
    with (folder / "node.log").open("ab") as log:
        return subprocess.Popen(
            [
                *(sys.executable, "-m", "palpate", "ros", "--skin", "skin.toml"),
                *("--topic", "/finger", "--type", kind),
            ],
            cwd=folder, stdout=log, stderr=log,
        )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rates", type=float, nargs="+", default=[200.0, 1000.0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--send", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--taxels", type=int, default=4, help="along each side")
    parser.add_argument("--gel", type=int, nargs=2, metavar=("COLUMNS", "ROWS"), help="pictures in place of taxels")
    parser.add_argument("--jpeg", action="store_true", help="the pictures as CompressedImage")
    arguments = parser.parse_args()
    if arguments.send:  # a driver that will be killed
        robot = Robot(images(pp.Skin.from_file(arguments.send)))
        robot.begin()
        robot.run(50.0, 600.0)
    os.environ |= {"ROS_DOMAIN_ID": str(os.getpid() % 100), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    rows: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["ROS_LOG_DIR"] = name
        kind = COMPRESSED if arguments.jpeg else IMAGE
        if arguments.gel:
            (folder / "skin.toml").write_text(gel_file(f'scale = "{16.0 / arguments.gel[0]} mm"'))
            robot = Robot(pictures(*arguments.gel, kind), kind)
        else:
            taxels, pitch = (arguments.taxels, arguments.taxels), f"{12.0 / arguments.taxels} mm"
            text = skin_text(*taxels, channels=SHEAR, pitch=pitch, depth="2 mm", noise="200 Pa") + STREAM
            (folder / "skin.toml").write_text(text)
            robot = Robot(images(pp.Skin.from_file(folder / "skin.toml")))
        process = started(folder, robot.kind)
        try:
            measured(robot, arguments, rows, process.pid)
            if not arguments.gel:
                killed(robot, folder, rows)
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(30)
    print(json.dumps(rows))


def processor_time(pid: int) -> float:
    """Seconds of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def killed(robot: Robot, folder: Path, rows: dict[str, Any]) -> None:
    """Another process publishes, is killed without a word, and this one takes its place at once."""
    robot.leave()
    came = len(robot.came)
    other = subprocess.Popen([sys.executable, __file__, "--send", str(folder / "skin.toml")])
    while len(robot.came) < came + 20:
        time.sleep(0.05)
    other.kill()
    other.wait()
    robot.begin()
    rows["killed"] = robot.wait()
    print(f"one that is killed, with another in its place: {rows['killed']:.2f} s from its first message to an answer")


def measured(robot: Robot, arguments: Any, rows: dict[str, Any], pid: int) -> None:
    # the node is there long before its publisher; of pictures its topics come after the gel at rest
    while not arguments.gel and (
        "/palpate/wrench" not in dict(robot.node.get_topic_names_and_types()) or not robot.level
    ):
        time.sleep(0.1)
    print(f"before there is a publisher: {robot.words!r} (level {robot.level[:1]!r})")
    robot.begin()
    rows["late"] = robot.wait()
    print(
        f"{'from the start of the node' if arguments.gel else 'a late publisher: from its first message'} to an answer: {rows['late']:.2f} s"
    )
    while not robot.level:
        time.sleep(0.1)
    print(
        f"\n{'frames/s':>9} {'sent':>7} {'received':>9} {'answered':>9} {'p50 [ms]':>9} {'p99 [ms]':>9} {'worst':>7} {'cpu [ms]':>9}   load {os.getloadavg()[0]:.1f}"
    )
    for rate in arguments.rates:
        time.sleep(2.0)
        before = {k: int(robot.diagnostics[k]) for k in ("messages", "answered")}
        used = processor_time(pid)
        sent = robot.run(rate, arguments.seconds)
        time.sleep(2.5)  # the last answers, and diagnostics that count them
        used = processor_time(pid) - used
        counts = {k: int(robot.diagnostics[k]) - before[k] for k in before}
        waited = np.array([robot.came[s] - s for s in sent if s in robot.came]) * 1e-6
        p50, p99, worst = np.percentile(waited, (50, 99, 100)) if len(waited) else (np.nan,) * 3
        cpu = 1e3 * used / max(counts["answered"], 1)
        rows[f"{rate:g}"] = {
            "sent": len(sent),
            **counts,
            "came": len(waited),
            "p50": p50,
            "p99": p99,
            "worst": worst,
            "cpu": cpu,
        }
        print(
            f"{rate:9g} {len(sent):7d} {counts['messages']:9d} {counts['answered']:9d} {p50:9.2f} {p99:9.2f} {worst:7.1f} {cpu:9.2f}   {os.getloadavg()[0]:.1f}"
        )
    robot.leave()
    robot.begin()
    rows["restarted"] = robot.wait()
    print(f"\na publisher that leaves and comes again: {rows['restarted']:.2f} s from its first message to an answer")


if __name__ == "__main__":
    main()
