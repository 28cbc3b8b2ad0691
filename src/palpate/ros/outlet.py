"""Publish results as messages: net force with its interval, centre of pressure with its covariance, the traction as a
cloud, and text.

All results of a frame have the time stamp of the message with its readings. The surface's frame of
reference has x and y along the surface and z into the pad, so that a push has fz > 0. Quantities that a frame could
not determine are NaN, so that nobody continues with an old result.
"""

from __future__ import annotations

import array
import math
import time as clock
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.status import Status
from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event, GraspMonitor
    from palpate.ros.intake import Intake
    from palpate.sensing.grids import Grid

__all__ = ["CLOUD", "TOPICS", "Outlet"]

#: Topics below the node's name, and their types.
TOPICS = {
    "wrench": "geometry_msgs/msg/WrenchStamped",
    "wrench_low": "geometry_msgs/msg/WrenchStamped",
    "wrench_high": "geometry_msgs/msg/WrenchStamped",
    "center": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "traction": "sensor_msgs/msg/PointCloud2",
    "utilisation": "std_msgs/msg/Float32",
    "events": "std_msgs/msg/String",
}
#: Fields of the cloud, float32: position of a cell [m], force on it and standard deviation of fz [N].
CLOUD = ("x", "y", "z", "fx", "fy", "fz", "std")
#: Variance given for quantities that are not measured: the height and the orientation of the centre of pressure.
UNKNOWN_COVARIANCE = 1e6
#: Number of frames in the latency statistics.
LATENCY_FRAMES = 2000


class Outlet:
    """A sink of a `palpate.live.Session` that publishes each result on the topics in `TOPICS`.

    Parameters
    ----------
    publishers : dict
        One for each of `TOPICS`.
    messages : dict
        Class of messages for each type's name.
    intake : Intake
        The intake of the frames, whose header the results carry.
    monitor : GraspMonitor
    frame : str
        Frame of reference; "": that of the messages, or "palpate" where they name none.
    cloud_rate : float
        Clouds a second at most; 0: none.
    """

    def __init__(
        self,
        publishers: dict[str, Any],
        messages: dict[str, Any],
        intake: Intake,
        monitor: GraspMonitor,
        *,
        frame: str = "",
        cloud_rate: float = 30.0,
    ) -> None:
        self._publishers, self._messages, self._intake, self._monitor = publishers, messages, intake, monitor
        self.frame, self.cloud_rate = frame, cloud_rate
        #: Time from a message's arrival to its result [s], for the last frames.
        self.latency: deque[float] = deque(maxlen=LATENCY_FRAMES)
        self.answered = 0
        self.status = Status.NO_CONTACT
        self.force: Floats = np.full(3, math.nan)
        self.fit = math.nan
        self._cloud_at = -math.inf
        self._layout: tuple[int, Any] | None = None

    # -- a sink --------------------------------------------------------------------------------------------------------

    def readings(self, time: float, values: Any) -> None:
        """Do nothing: readings came from a topic and are not sent again."""

    def touch(self, touch: Touch, time: float | None = None) -> None:
        """Publish the result of one frame."""
        header = self._header()
        self.status = Status.SOLVED if touch.status is None else Status.coded(int(touch.status))
        force, moment = spatial(to_numpy(touch.force), to_numpy(touch.moment))
        self.force, self.fit = force, math.nan if touch.fit is None else float(touch.fit)
        self._send("wrench", self._wrench(header, force, moment))
        for name, bounds in self._bounds(touch).items():
            self._send(name, self._wrench(header, *bounds))
        if self._wanted("center") and "z" in touch.components:
            self._send("center", self._center(header, touch))
        state = self._monitor.state
        used = math.nan if state is None or not state.touching else float(state.utilisation)
        self._send("utilisation", self._messages[TOPICS["utilisation"]](data=used))
        self._publish_cloud(header, touch)
        self.answered += 1
        self.latency.append(1e-9 * (clock.monotonic_ns() - self._intake.header.came))

    def event(self, event: Event) -> None:
        """Do nothing: events are among the messages of the session (`say`)."""

    def close(self) -> None:
        """Do nothing: the node ends its publishers."""

    def say(self, text: str) -> None:
        """Publish a text on the topic of events."""
        self._send("events", self._messages[TOPICS["events"]](data=text))

    # -- messages ------------------------------------------------------------------------------------------------------

    def _send(self, name: str, message: Any) -> None:
        self._publishers[name].publish(message)

    def _wanted(self, name: str) -> bool:
        return bool(self._publishers[name].get_subscription_count())

    def _header(self) -> Any:
        seen = self._intake.header
        header = self._messages["std_msgs/msg/Header"]()
        header.stamp.sec, header.stamp.nanosec = divmod(seen.stamp, 10**9)
        header.frame_id = self.frame or seen.frame or "palpate"
        return header

    def _wrench(self, header: Any, force: Floats, moment: Floats) -> Any:
        out = self._messages[TOPICS["wrench"]](header=header)
        for axis, f, m in zip("xyz", force.tolist(), moment.tolist()):
            setattr(out.wrench.force, axis, f)
            setattr(out.wrench.torque, axis, m)
        return out

    def _bounds(self, touch: Touch) -> dict[str, tuple[Floats, Floats]]:
        """Return lower and upper ends of the 95 % intervals, if anyone subscribes to them."""
        names = [n for n in ("wrench_low", "wrench_high") if self._wanted(n)]
        if not names:
            return {}
        if not touch.has_intervals:
            lost = np.full(3, math.nan)
            return dict.fromkeys(names, (lost, lost))
        ends = zip(touch.interval(0.95, "force"), touch.interval(0.95, "moment"))
        both = dict(zip(("wrench_low", "wrench_high"), (spatial(f, m) for f, m in ends)))
        return {n: both[n] for n in names}

    def _center(self, header: Any, touch: Touch) -> Any:
        out = self._messages[TOPICS["center"]](header=header)
        d = touch.surface.dimensions
        place = np.zeros(3)
        place[:d] = np.atleast_1d(to_numpy(touch.center_of_pressure))
        # in line contact the other direction is unknown
        variance = np.array([UNKNOWN_COVARIANCE] * 6)
        if not touch.has_intervals:
            variance[:d] = math.nan
        else:
            variance[:d] = to_numpy(touch.std("center_of_pressure")) ** 2
        pose = out.pose.pose
        pose.position.x, pose.position.y, pose.position.z = map(float, place)
        pose.orientation.w = 1.0
        out.pose.covariance = np.diag(variance).reshape(-1)
        return out

    def _publish_cloud(self, header: Any, touch: Touch) -> None:
        now = clock.monotonic()
        if not (self.cloud_rate > 0 and now - self._cloud_at >= 1.0 / self.cloud_rate and self._wanted("traction")):
            return
        self._cloud_at = now
        grid = touch.surface
        if self._layout is None or self._layout[0] != id(grid):
            self._layout = (id(grid), places(grid))
        out = self._messages[TOPICS["traction"]](header=header)
        points = self._layout[1].copy()
        values = grid.cell_forces(to_numpy(touch.values))
        points[..., 3] = values[0]
        points[..., 4] = values[1] if grid.dimensions == 2 else 0.0
        points[..., 5] = values[-1]
        points[..., 6] = math.nan if not touch.has_intervals else to_numpy(touch.std())[-1] * grid.areas
        field = self._messages["sensor_msgs/msg/PointField"]
        out.height, out.width = points.shape[:2]
        out.fields = [field(name=n, offset=4 * i, datatype=7, count=1) for i, n in enumerate(CLOUD)]
        out.point_step, out.row_step = 4 * len(CLOUD), 4 * len(CLOUD) * out.width
        out.data = array.array("B", points.tobytes())  # rclpy accepts this type without checking every byte
        out.is_dense = bool(np.isfinite(points).all())
        self._send("traction", out)


def spatial(force: Any, moment: Any) -> tuple[Floats, Floats]:
    """Return force and moment with three components each; line contact, along x, has none across it."""
    f, m = np.atleast_1d(np.asarray(force, float)), np.atleast_1d(np.asarray(moment, float))
    if len(f) == 2:
        return np.array([f[0], 0.0, f[1]]), np.array([0.0, m[0], 0.0])
    return f, m


def places(grid: Grid) -> Any:
    """Return an array (y, x, field) in which the positions of the cells are filled in."""
    where = grid.positions.reshape(-1, len(grid.x), 3)
    out = np.zeros((*where.shape[:2], len(CLOUD)), dtype="<f4")
    out[..., :3] = where
    return out
