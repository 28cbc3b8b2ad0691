"""The ROS 2 node. It subscribes to readings, tracks the contact in a session, publishes the results and diagnostics, and offers parameters and a service for a new zero."""

from __future__ import annotations

import contextlib
import math
import threading
import time as clock
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from palpate._numbers import plain_number
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput, PalpateError
from palpate.grasp import GraspMonitor
from palpate.live import Session
from palpate.network.admission import REFUSALS
from palpate.recordings import TopicMapping
from palpate.ros.client import message_class, ros_client
from palpate.ros.intake import Intake
from palpate.ros.outlet import TOPICS, Outlet
from palpate.ros.pictures import PictureIntake
from palpate.skin import Skin
from palpate.touch import Touch
from palpate.tracking import FRAMES_OF_ZERO, Tracker

__all__ = ["BUDGET", "Ros", "TouchNode", "diagnosed"]

#: Time in which a frame should be processed [s].
BUDGET = 0.01
#: Messages that the middleware keeps for the node; the oldest make room.
DEPTH = 10
#: Number of past events that a late subscriber receives.
PAST = 100
#: Period of diagnostics [s]; a topic without a message for longer is stale.
PERIOD = 1.0
#: Parameters that are positive numbers, with their meaning; 0 stands for none.
NUMBERS = {
    "friction": "coefficient of friction of the touched object; 0: unknown, estimated from the shear",
    "max_pressure": "an event when the peak pressure exceeds this [Pa]; 0: none",
    "max_force": "an event when the normal force exceeds this [N]; 0: none",
    "cloud_rate": "largest rate of point clouds of the traction [1/s]; 0: none",
}


class Ros:
    """A connection to ROS: its context, an empty node, and a thread that serves it.

    Parameters
    ----------
    arguments : sequence of str
        After ``--ros-args``: remappings, parameters, as every node takes them.
    """

    def __init__(self, arguments: Sequence[str] = ()) -> None:
        client = ros_client()
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        self._context = client.Context()
        try:
            client.init(
                args=["--ros-args", *arguments] if arguments else [],
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self.node = client.create_node("palpate", context=self._context)
        except Exception as error:  # wrong arguments or the middleware: rclpy has a class of errors for each
            self._context.try_shutdown()
            raise InvalidInput(f"ROS does not begin ({' '.join(str(error).split())}).") from error
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name="palpate-ros", daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException, ShutdownException

        with contextlib.suppress(ExternalShutdownException, ShutdownException):
            self._executor.spin()

    def type_of(self, topic: str, *, wait: float = 0.0) -> str | None:
        """Return the type of a topic's messages from its publishers; None if there is no publisher within ``wait``
        [s].

        Raises
        ------
        InvalidInput
            Publishers of different types.
        """
        full, until = self.node.resolve_topic_name(topic), clock.monotonic() + wait
        while True:
            kinds = sorted({i.topic_type for i in self.node.get_publishers_info_by_topic(full)})
            if len(kinds) > 1:
                raise InvalidInput(
                    f"{full} has publishers of different types, {' and '.join(kinds)}: say which with --type."
                )
            if kinds or clock.monotonic() >= until:
                return kinds[0] if kinds else None
            clock.sleep(0.05)

    def first(self, topic: str, kind: str, *, wait: float) -> Any:
        """Return the first message of a topic, or None if none arrives within ``wait`` [s]."""
        from rclpy.qos import qos_profile_sensor_data

        found: list[Any] = []
        came = threading.Event()

        def keep(message: Any) -> None:
            found.append(message)
            came.set()

        subscription = self.node.create_subscription(message_class(kind), topic, keep, qos_profile_sensor_data)
        came.wait(wait)
        self.node.destroy_subscription(subscription)
        return found[0] if found else None

    def close(self) -> None:
        """Stop the thread, the node and the connection."""
        self._executor.shutdown(timeout_sec=2.0)
        self._thread.join(timeout=5.0)
        self.node.destroy_node()
        self._context.try_shutdown()


class TouchNode:
    """Computes touches from a topic of readings, or of pictures of a gel with dots.

    Publishes below the node's name the topics that `palpate.ros.outlet` describes, and ``/diagnostics``. Offers the
    service ``~/rezero`` (std_srvs/Trigger).

    Parameters
    ----------
    ros : Ros
    skin : Skin, str or Path
        Of pictures: a skin.toml with a section [camera]; the node then waits here for the gel at rest.
    mapping : TopicMapping or str
        What is where in a message; of pictures the name of their topic.
    kind : str
        Type of the messages.
    options : dict
        For `Skin.track`: friction and others.
    baseline : int
        Frames at the start that are the zero. Of pictures: how many show the gel at rest; 0: as [camera] says.
    zero : array, optional
        Frames at rest, as for `Skin.track`.
    budget : float, optional
        Time limit for a frame [s].
    max_pressure, max_force : float, optional
        [Pa], [N].
    rest : array, optional
        Where markers are at rest.
    frame : str
        Frame of reference of the published messages.
    pages : bool
        Whether live pages will show the session.

    Attributes
    ----------
    session : Session
    intake : Intake
    skin : Skin
        Of pictures with the dots where they were found.

    Raises
    ------
    InvalidInput
        A skin whose planes have several shapes, a parameter out of its range; pictures as `PictureIntake.begin` says.
    """

    def __init__(
        self,
        ros: Ros,
        skin: Skin | str | Path,
        mapping: TopicMapping | str,
        *,
        kind: str,
        options: dict[str, Any] | None = None,
        baseline: int = 0,
        zero: Any = None,
        budget: float | None = BUDGET,
        max_pressure: float | None = None,
        max_force: float | None = None,
        rest: Any = None,
        frame: str = "",
        pages: bool = False,
    ) -> None:
        self._node, self._budget = ros.node, budget
        self._options = dict(options or {})
        self._settings = self._declared(max_pressure, max_force, frame)
        self._options["friction"] = self._settings["friction"] or None
        #: The zero of a calibration, whose scatter the intervals include; any other zero is passed on by the tracker
        #: that took it.
        self._zero = zero
        self._topic = self._node.resolve_topic_name(mapping if isinstance(mapping, str) else mapping.topic)
        self.intake: Intake
        self.skin, tracker = self._begun(skin, mapping, kind, baseline, rest)
        monitor = GraspMonitor(
            friction=self._options["friction"],
            max_pressure=self._settings["max_pressure"] or None,
            max_force=self._settings["max_force"] or None,
        )
        self._outlet = self._made_outlet(monitor)
        self.session = Session(
            self.skin,
            lambda: self.intake,
            tracker,
            monitor,
            name=self._topic,
            pace=False,
            end=self.intake.close,
            sinks=[self._outlet],
            report=self._failed,
            step=self._pictured if isinstance(self.intake, PictureIntake) else None,
            pages=pages,
        )
        self._said = 0
        self._before: dict[str, int] = {}
        self._end_of_words = self.session.listen(self._say_new)
        self._serve()
        if isinstance(self.intake, PictureIntake):
            readings = self.intake.touches.readings
            self.session.note(
                f"{len(readings.positions)} dots; the first {readings.reference} pictures are the gel at rest: nothing may touch it in them"
            )
        else:
            self._subscribe(kind)

    def _begun(
        self, skin: Skin | str | Path, mapping: TopicMapping | str, kind: str, baseline: int, rest: Any
    ) -> tuple[Skin, Tracker]:
        """Return the skin and its tracker. The intake must exist before."""
        node = self._node

        def now() -> int:
            return int(node.get_clock().now().nanoseconds)

        if isinstance(mapping, str):
            self.intake = pictures = PictureIntake(mapping, now=now, publishers=self._publishers)
            self._subscribe(kind)
            given = {**self._options, "budget": self._budget}
            touches = pictures.begin(skin, reference=baseline or None, options=given)
            return touches.skin, cast(Tracker, touches.tracker)
        whole = skin if isinstance(skin, Skin) else Skin.from_file(skin)
        shapes = {p.shape for p in whole.planes}
        if len(shapes) != 1:
            raise InvalidInput("messages hold planes of one shape; this skin has several.")
        shape = (sum(len(p.channels) for p in whole.planes), *shapes.pop())
        self.intake = Intake(mapping, shape, now=now, rest=rest, publishers=self._publishers)
        return whole, whole.track(**self._options, baseline=baseline, zero=self._zero, budget=self._budget)

    def _pictured(self, values: Any, time: float) -> Touch:
        """Return the touch of a picture by the current tracker, which `_with_friction` may replace."""
        touches = cast(PictureIntake, self.intake).touches
        touches.tracker = self.session.tracker
        return touches.step(values, time, std=cast(PictureIntake, self.intake).std)

    def _declared(self, max_pressure: float | None, max_force: float | None, frame: str) -> dict[str, Any]:
        """Return the values of the parameters; values of a launch file override those of the command line."""
        from rcl_interfaces.msg import ParameterDescriptor

        given = {
            "friction": self._options.get("friction"),
            "max_pressure": max_pressure,
            "max_force": max_force,
            "cloud_rate": 30.0,
        }
        settings: dict[str, Any] = {}
        for name, words in NUMBERS.items():
            # accept whole numbers as numbers: -p max_force:=5
            described = ParameterDescriptor(description=words, dynamic_typing=True)
            settings[name] = self._node.declare_parameter(name, float(given[name] or 0.0), described).value
        settings["rezero_frames"] = self._node.declare_parameter(
            "rezero_frames", FRAMES_OF_ZERO, ParameterDescriptor(description="frames that ~/rezero takes for the zero")
        ).value
        settings["frame_id"] = self._node.declare_parameter(
            "frame_id", frame, ParameterDescriptor(description='frame of reference; "": that of the messages')
        ).value
        for name, value in settings.items():
            why = _refused(name, value)
            if why:
                raise InvalidInput(f"parameter {why}.")
        return {n: float(v) if n in NUMBERS else v for n, v in settings.items()}

    def _made_outlet(self, monitor: GraspMonitor) -> Outlet:
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from rclpy.qos_overriding_options import QoSOverridingOptions

        kinds = {*TOPICS.values(), "std_msgs/msg/Header", "sensor_msgs/msg/PointField"}
        messages = {k: message_class(k) for k in kinds}
        # reliable, so that both kinds of subscribers are served; late subscribers receive past events
        kept = QoSProfile(depth=PAST, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publishers = {
            name: self._node.create_publisher(
                messages[kind],
                f"~/{name}",
                kept if name == "events" else QoSProfile(depth=DEPTH),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
            for name, kind in TOPICS.items()
        }
        return Outlet(
            publishers,
            messages,
            self.intake,
            monitor,
            frame=self._settings["frame_id"],
            cloud_rate=self._settings["cloud_rate"],
        )

    def _subscribe(self, kind: str) -> None:
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from rclpy.qos_overriding_options import QoSOverridingOptions

        def came(message: Any, info: Any) -> None:
            self.intake.take(message, info)

        self._node.create_subscription(
            message_class(kind),
            self._topic,
            came,
            # best effort receives from both kinds of publishers; late messages are of no use
            QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def _serve(self) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.clock import Clock, ClockType
        from std_srvs.srv import Trigger

        node = self._node
        node.create_service(Trigger, "~/rezero", self._rezero)
        node.add_on_set_parameters_callback(self._changed)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # use the steady clock, which also runs while a simulation is paused: otherwise a pause would look like a node that has stopped
        node.create_timer(PERIOD, self._diagnose, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # -- running -------------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start the stream in a thread."""
        self.session.start()

    def close(self) -> None:
        """Stop the stream and finish its recordings. The caller closes the `Ros`."""
        self.session.stop()
        self._end_of_words()

    def _publishers(self) -> dict[str, str]:
        """Return the nodes that publish the topic, by the identifiers of their publishers."""
        return {
            bytes(i.endpoint_gid).hex(): f"{i.node_namespace.rstrip('/')}/{i.node_name}"
            for i in self._node.get_publishers_info_by_topic(self._topic)
        }

    def _say_new(self) -> None:
        """Write new messages of the session to the log of ROS and to ~/events."""
        count, texts = self.session.noted(self._said)
        self._said = count
        for text in texts:
            self._outlet.say(text)
            self._node.get_logger().info(text)

    def _failed(self, text: str) -> None:
        self._node.get_logger().error(text)

    # -- what others ask for -------------------------------------------------------------------------------------------

    def _rezero(self, _: Any, response: Any) -> Any:
        frames = int(self._settings["rezero_frames"])
        state = self.session.monitor.state
        self.session.rezero(frames)
        response.success = True
        response.message = f"a new zero is taken from the next {frames} frames: nothing must touch"
        if state is not None and state.touching:
            response.message += f"; but something touches the pad with {plain_number(float(state.force[-1]), 3)} N, and this force will count as zero"
            self.session.note(
                f"a new zero was requested while something touched, with {plain_number(float(state.force[-1]), 3)} N"
            )
        return response

    def _changed(self, parameters: Any) -> Any:
        from rcl_interfaces.msg import SetParametersResult

        wanted = {p.name: p.value for p in parameters if p.name in self._settings}
        for name, value in wanted.items():
            why = _refused(name, value)
            if why:
                return SetParametersResult(successful=False, reason=why)
        friction = wanted.get("friction", self._settings["friction"])
        changed = float(friction) != self._settings["friction"]
        if changed and isinstance(self.skin.pad, Viscoelastic):
            why = "with a pad that creeps, the friction cannot change while the node runs: start the node again with -p friction:=..."
            return SetParametersResult(successful=False, reason=why)
        self._settings.update({n: float(v) if n in NUMBERS else v for n, v in wanted.items()})
        monitor = self.session.monitor
        monitor.max_pressure = self._settings["max_pressure"] or None
        monitor.max_force = self._settings["max_force"] or None
        self._outlet.frame, self._outlet.cloud_rate = self._settings["frame_id"], self._settings["cloud_rate"]
        if changed:
            threading.Thread(target=self._with_friction, args=(float(friction) or None,), daemon=True).start()
        return SetParametersResult(successful=True)

    def _with_friction(self, friction: float | None) -> None:
        """Continue with another friction and the same zero; the rest of the state is found again within some frames."""
        options = {**self._options, "friction": friction}
        try:
            tracker = self.skin.track(**options, zero=self._zero, budget=self._budget)
        except PalpateError as error:
            self._failed(f"the friction stays as it was: {error}")
            return
        self._options = options
        self.session.go_on_with(tracker)
        self.session.monitor.given = friction
        self.session.note("the friction is not known" if friction is None else f"the friction is {friction:g}")

    # -- diagnostics ---------------------------------------------------------------------------------------------------

    def _diagnose(self) -> None:
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

        counts = {**self.intake.counts, "answered": self._outlet.answered}
        level, words, values = diagnosed(self.session, self._outlet, counts, self._before, len(self._publishers()))
        self._before = counts
        status = DiagnosticStatus(
            level=bytes([level]), name=f"{self._node.get_fully_qualified_name().lstrip('/')}: touch", message=words,
            hardware_id=self._topic, values=[KeyValue(key=k, value=v) for k, v in values.items()],
        )  # fmt: skip
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(array)


def _refused(name: str, value: Any) -> str:
    """Return why a parameter cannot have a value; "" if it can."""
    if name in NUMBERS and (
        isinstance(value, bool) or not isinstance(value, int | float) or not (math.isfinite(value) and value >= 0)
    ):
        return f"{name} must be a number from 0 on; got {value!r}"
    if name == "rezero_frames" and (isinstance(value, bool) or not isinstance(value, int) or value < 1):
        return f"rezero_frames must be a whole number of at least 1; got {value!r}"
    return ""


#: Levels of diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR, STALE = 0, 1, 2, 3


def diagnosed(
    session: Session, outlet: Outlet, counts: dict[str, int], before: dict[str, int], publishers: int
) -> tuple[int, str, dict[str, str]]:
    """Return (level, message, values) for a period in which the counts rose from ``before`` to ``counts``."""
    new = {name: count - before.get(name, 0) for name, count in counts.items()}
    health = session.tracker.health
    refused = {name: new[name] for name in REFUSALS if new.get(name)}
    latency = np.array(outlet.latency)[-max(new["answered"], 1) :] * 1e3
    left_out = np.flatnonzero(health.left_out)
    values = {
        "publishers": str(publishers),
        **{
            name: str(count)
            for name, count in counts.items()
            if count or name in ("messages", "answered", "lost", "dropped")
        },
        "status": str(outlet.status),
        "unknown": str(health.unknown),
        "approximate": str(health.approximate),
        "taxels left out": ", ".join(f"{health.label(int(r))} ({health.reasons[r]})" for r in left_out[:8]) or "none",
        "latency p50 [ms]": f"{np.percentile(latency, 50):.2f}" if len(latency) else "",
        "latency p99 [ms]": f"{np.percentile(latency, 99):.2f}" if len(latency) else "",
        "force z": f"{outlet.force[-1]:.4g}",
        "fit": f"{outlet.fit:.2g}",
    }
    if session.ended:
        return ERROR, f"the stream has ended: {session.failure or 'closed'}", values
    if not new["messages"]:
        who = f"{publishers} publisher{'s' if publishers > 1 else ''} of it" if publishers else "nobody publishes it"
        return STALE, f"no message for {PERIOD:g} s; {who}", values
    if not new["answered"]:
        why = ", ".join(f"{n} {name}" for name, n in refused.items()) or "none was ready"
        return ERROR, f"{new['messages']} messages and no answer: {why}; see ~/events", values
    doubts = [f"{n} {name}" for name, n in refused.items()]
    if new["dropped"]:
        doubts.append(f"{new['dropped']} left out because newer ones came: this machine is too slow for them")
    if new["lost"]:
        doubts.append(f"{new['lost']} lost on the way")
    if publishers > 1:
        doubts.append(f"{publishers} publishers: one is served")
    if not outlet.status.known:
        doubts.append(f"{outlet.status}: {outlet.status.meaning}")
    if len(left_out):
        doubts.append(f"{len(left_out)} taxels left out")
    words = f"{new['answered'] / PERIOD:.0f} answers a second"
    return (WARN, f"{words}; {'; '.join(doubts)}", values) if doubts else (OK, words, values)
