"""Process a stream of readings in a thread (tracker, monitor, recorder), and make packets for the page.

A packet consists of the bytes "PLP1", the length of a JSON text (uint32, little-endian), that text, and the maps as
float32, row by row: pressure, shear along x and (on an area) shear along y. If the layout announces "readings", that
many raw readings follow, and then the same minus the zero (plane, channel, taxel). The JSON text holds the numbers:
"frame" (count), "time" [s], "born" (clock of this machine when the frame came [ms]), "force", "force_low",
"force_high" [N or N/m], "peak", "peak_low", "peak_high" [Pa], "utilisation" and its "utilisation_std" (Q/(mu P)),
"center", "center_low", "center_high" [m] along x and (on an area) y, "friction", "touching", "converged", "ms" (time
spent on the frame), "going_on", "events" (new ones, as text) and "health".
"""

from __future__ import annotations

import contextlib
import json
import math
import struct
import threading
import time as clock
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._numbers import plain_time
from palpate._threads import few_threads
from palpate.errors import InvalidInput, PalpateError
from palpate.grasp import Event, GraspMonitor
from palpate.live.taxels import MAX_READINGS, described, edge, flat_readings
from palpate.network.waiting import FrameSource
from palpate.recordings import Sink, recorder
from palpate.sensing.readings import checked_planes, joined_planes
from palpate.sensing.zero import MOVED, STANDS
from palpate.skin import Skin
from palpate.status import Status
from palpate.touch import Touch
from palpate.tracking import FRAMES_OF_ZERO, Tracker
from palpate.tracking.single import BEGUN

__all__ = ["MAGIC", "Session", "packed", "recorded", "unpacked"]

MAGIC = b"PLP1"
#: Number of past events that are sent to a page when it connects.
REMEMBERED = 200
#: Number of past frames whose forces and friction left are sent to it.
HISTORY = 1000
TRAIL = ("time", "touching", "force", "force_low", "force_high", "utilisation", "utilisation_std")


def recorded(skin: Skin) -> dict[str, Any]:
    """Return channels and positions of a skin's readings in the form that recorders need; no positions if the planes
    have different ones.
    """
    places: list[Any] = [getattr(p, "positions", None) for p in skin.planes]
    return {
        "channels": [c for p in skin.planes for c in p.channels],
        "positions": places[0] if all(np.array_equal(places[0], other) for other in places[1:]) else None,
    }


def _number(value: Any) -> float | None:
    """Return a number, or None for NaN, which JSON does not have."""
    number = float(value)
    return number if math.isfinite(number) else None


def packed(
    touch: Touch,
    monitor: GraspMonitor,
    events: Iterable[Event],
    health: dict[str, Any],
    *,
    born: float,
    ms: float,
    readings: Sequence[Any] = (),
) -> bytes:
    """Build one packet; ``readings`` are the raw ones and those minus the zero."""
    state = monitor.state
    status = None if touch.status is None else Status.coded(int(touch.status))
    values = to_numpy(touch.values).astype("<f4")
    text: dict[str, Any] = {
        "frame": health["frames"],
        "time": _number(touch.time),
        "born": born,
        "ms": round(ms, 3),
        "touching": bool(touch.touching) if status is None or status.known else None,
        "status": None if status is None else status.label,
        "converged": bool(touch.converged),
        "force": [_number(v) for v in to_numpy(touch.force)],
        "peak": _number(touch.peak_pressure),
        "utilisation": None if state is None else _number(state.utilisation),
        "utilisation_std": None if state is None else _number(state.utilisation_std),
        "friction": None if state is None else _number(state.friction),
        "going_on": list(monitor.going_on()),
        "events": [str(e) for e in events],
        "health": health,
    }
    if "z" in touch.components and text["touching"]:
        text["center"] = [_number(v) for v in np.ravel(to_numpy(touch.center_of_pressure))]
    if touch.has_intervals:
        named = [("force", "force"), ("peak", "peak_pressure")]
        for name, of in [*named, ("center", "center_of_pressure")] if "center" in text else named:
            low, high = touch.interval(0.95, of)
            text[f"{name}_low"] = [_number(v) for v in np.atleast_1d(low)]
            text[f"{name}_high"] = [_number(v) for v in np.atleast_1d(high)]
    body = json.dumps(text, separators=(",", ":")).encode()
    maps = [values[-1], *values[:-1]]
    return (
        MAGIC
        + struct.pack("<I", len(body))
        + body
        + b"".join(np.ascontiguousarray(m, dtype="<f4").tobytes() for m in (*maps, *readings))
    )


def unpacked(packet: bytes) -> tuple[dict[str, Any], Any]:
    """Return (numbers, maps (n,) as float32 in a row) of a packet; raise `InvalidInput` if it is not one."""
    if len(packet) < 8 or packet[:4] != MAGIC:
        raise InvalidInput("not a palpate packet: it does not begin with PLP1.")
    (size,) = struct.unpack("<I", packet[4:8])
    if len(packet) < 8 + size or (len(packet) - 8 - size) % 4:
        raise InvalidInput(f"an incomplete palpate packet of {len(packet)} bytes.")
    try:
        numbers = json.loads(packet[8 : 8 + size])
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InvalidInput("a palpate packet whose numbers are not JSON.") from error
    return numbers, np.frombuffer(packet, dtype="<f4", offset=8 + size)


class Session:
    """Passes a stream through a tracker and a monitor, and keeps the newest packet.

    Parameters
    ----------
    skin : Skin
    source : callable
        Returns an iterable of (time [s], readings), or a `FrameSource`. If its times jump back (a restarted sensor) or the sender changes, times
        continue from the last one by this machine's clock: page, tracker and sinks see one increasing time. An event reports it. The zero is kept.
    tracker, monitor : Tracker, GraspMonitor
    pace : bool
        Wait until each frame is due by its time (a recording); else process frames as they come (a sensor).
    loop : bool
        Start again when the source ends.
    speed : float
        With ``pace``, play this many times faster than the times say; page, tracker and sinks see the times of the source.
    end : callable, optional
        Ends a source that waits for frames.
    sinks : sequence of Sink
        Receivers of readings, touches and events besides the page: a `palpate.recordings.recorder`, a `FoxgloveServer`, a `RerunSink`. One that fails
        is reported and dropped; the stream continues.
    report : callable, optional
        Called with one sentence when a sink or the source fails.
    step : callable, optional
        Takes readings and time and returns the `Touch`, in place of ``tracker.step``.
    pages : bool
        Make packets for pages.
    """

    def __init__(
        self,
        skin: Skin,
        source: Callable[[], Iterable[tuple[float, Any]]],
        tracker: Tracker,
        monitor: GraspMonitor,
        *,
        name: str = "",
        pace: bool = True,
        loop: bool = False,
        speed: float = 1.0,
        end: Callable[[], None] | None = None,
        sinks: Sequence[Sink] = (),
        report: Callable[[str], None] | None = None,
        step: Callable[[Any, float], Touch] | None = None,
        pages: bool = True,
    ) -> None:
        self.skin, self.source, self.tracker, self.monitor = skin, source, tracker, monitor
        self.name, self.pace, self.loop, self.speed, self._end = name, pace, loop, speed, end
        self._step, self._pages = step, pages
        self._next: Tracker | None = None
        self.packet: bytes | None = None
        self.count = self.behind = 0
        self.failure: str | None = None
        self.ended = False
        self.past: list[str] = []
        self._noted = 0
        self._listener: FrameSource | None = None
        self._shift: float | None = None
        self._raw = self._now = self._arrived = 0.0
        self.history: deque[dict[str, Any]] = deque(maxlen=HISTORY)
        self._listeners: set[Callable[[], None]] = set()
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._sinks = list(sinks)
        self._report = report
        #: Errors of sinks that were dropped; the stream continued without them.
        self.lost: list[PalpateError] = []
        self._recorder: Sink | None = None
        self.recording: str | None = None
        self._stands = False  # whether a constant press at the zero was reported
        self._moved = False  # whether readings moved since the current zero
        self._zero_from = 0  # number of frames that a new zero is to be taken from
        self._taxels, self._edge = described(skin), edge(skin)
        #: Number of readings in a packet; 0 if there are too many for a page.
        self.readings = sum(len(p["names"]) * len(p["channels"]) for p in self._taxels)
        self.readings = self.readings if self.readings <= MAX_READINGS else 0

    def start(self) -> None:
        """Start the stream in a thread."""
        self._thread = threading.Thread(target=self.run, name="palpate-session", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread and finish the recording."""
        self._stop.set()
        if self._end is not None:
            self._end()
        if self._thread is not None:
            self._thread.join(timeout=10)
        with self._lock:
            self._recorder, self.recording = None, None
            while self._sinks:
                sink = self._sinks.pop()
                try:
                    sink.close()
                except PalpateError as error:  # such as a full disk; finish the other sinks nevertheless
                    self._leave(sink, error)
        self.tracker.close()

    def listen(self, wake: Callable[[], None]) -> Callable[[], None]:
        """Call ``wake`` for each new packet. Return the function that stops this."""
        with self._lock:
            self._listeners.add(wake)

        def end() -> None:
            with self._lock:
                self._listeners.discard(wake)

        return end

    def add(self, sink: Sink) -> None:
        """Pass frames, touches and events to one more sink."""
        with self._lock:
            self._sinks.append(sink)

    def layout(self) -> dict[str, Any]:
        """Return the part that is the same in all packets."""
        grid = self.skin.surface
        line = grid.dimensions == 1
        with self._lock:
            history, past, noted = list(self.history), list(self.past), self._noted
        return {
            "name": self.name,
            "shape": [1, *grid.shape] if line else list(grid.shape),
            "spacing": [float(s) for s in grid.spacings],
            "x": [float(grid.x[0]), float(grid.x[-1])],
            "y": [0.0, 0.0] if line else [float(grid.axes[0][0]), float(grid.axes[0][-1])],
            "components": list(grid.components),
            "sought": list(self.tracker.names),
            "unit": "N/m" if line else "N",
            "planes": self._taxels if self.readings else [],
            "readings": self.readings,
            "edge": self._edge,
            "notes": list(self.tracker.notes),
            "past": past,
            "noted": noted,
            "history": history,
        }

    def state(self) -> dict[str, Any]:
        """Return the state of the stream and its losses, for a page when no new frames come."""
        listener = self._listener
        return {
            "failure": self.failure,
            "ended": self.ended,
            "recording": self.recording,
            "sender": None if listener is None else listener.sender,
            "received": {} if listener is None else dict(listener.counts),
        }

    def skip(self) -> None:
        """Count a frame that came before the previous one was processed."""
        self.behind += 1

    def note(self, text: str) -> None:
        """Add a remark to the list of events."""
        with self._lock:
            self._remember([text])
        self._notify()

    def noted(self, after: int) -> tuple[int, list[str]]:
        """Return the number of events so far, and the events after number ``after`` that are still stored."""
        with self._lock:
            count = self._noted
            return count, self.past[-(count - after) :] if count > after else []

    def _remember(self, texts: list[str]) -> None:
        self.past += texts
        del self.past[:-REMEMBERED]
        self._noted += len(texts)

    def record(self, path: str | Path | None) -> str | None:
        """Start a recording (.mcap, .nc, .zarr) at ``path``, or stop the current one (None). Return its name."""
        with self._lock:
            if self._recorder is not None:
                ended, self._recorder, self.recording = self._recorder, None, None
                self._sinks.remove(ended)
                ended.close()
            if path is not None:
                self._recorder = recorder(path, **recorded(self.skin), meta={"source": self.name})
                self._sinks.append(self._recorder)
                self.recording = Path(path).name
        return self.recording

    def rezero(self, frames: int = FRAMES_OF_ZERO) -> None:
        """Take a new zero from the next ``frames`` frames, during which nothing may touch the pad; record an event."""
        with self._lock:
            self._zero_from = frames

    def go_on_with(self, tracker: Tracker) -> None:
        """Continue with another tracker of the skin, from the next frame for which the zero is known; the new tracker
        takes over the zero.
        """
        with self._lock:
            unused, self._next = self._next, tracker
        if unused is not None:
            unused.close()

    def run(self) -> None:
        """Process the stream to its end, in this thread."""
        try:
            # waiting threads of linear algebra occupy cores: the work took twice as long as on a single core
            with few_threads(self.tracker.unknowns):
                while not self._stop.is_set():
                    self._play()
                    if not self.loop:
                        return
        except Exception as error:
            # the page must show that the stream has ended, whatever the reason
            self.failure = str(error) or type(error).__name__
            if self._report is not None:
                self._report(self.failure)
            if not isinstance(error, PalpateError):
                raise
        finally:
            self.ended = True
            self._notify()

    def _play(self) -> None:
        """Process the source once, from beginning to end."""
        begun, first = clock.perf_counter(), None
        number: int | None = None
        for which, time, reading in self._frames():
            if self._stop.is_set():
                return
            if first is None:
                first = time
                self._shift = (0.0 if self._shift is None else self._now + 0.02) - time
            elif which != number or time < self._raw:
                if self.pace:
                    begun, first = clock.perf_counter(), time
                waited = max(clock.monotonic() - self._arrived, 1e-3)
                if time < self._raw:
                    self.note(
                        f"{self._now:.3f} s  the sensor's clock went back by {plain_time(self._raw - time)} s; the zero is kept"
                    )
                self._shift = self._now + waited - time
            number = which
            if self.pace:
                wait = (time - first) / self.speed - (clock.perf_counter() - begun)
                if wait > 0:
                    self._stop.wait(wait)
                elif wait < -0.1 and not self.tracker.capturing:
                    # skip frames that come too late for a live view, but never the first ones, from which the zero is taken
                    self.behind += 1
                    continue
            self._raw, self._now, self._arrived = time, time + (self._shift or 0.0), clock.monotonic()
            self._frame(self._now, reading)

    def _frames(self) -> Iterator[tuple[int, float, Any]]:
        """Yield (session, time [s], readings) of the source."""
        source = self.source()
        if isinstance(source, FrameSource):
            self._listener = source
            for text in list(source.events):
                self.note(text)
            source.report, source.zero = self.note, self.rezero
            yield from source.frames()
        else:
            for time, reading in source:
                yield 0, time, reading

    def _frame(self, time: float, reading: Any) -> None:
        born = 1e3 * clock.time()
        with self._lock:
            wanted, self._zero_from = self._zero_from, 0
            fresh = self._next
            if fresh is not None and fresh.take_zero(self.tracker):
                self.tracker.close()
                self.tracker, self._next = fresh, None
        if wanted:
            self.tracker.rezero(frames=wanted)
            self.note(f"{time:.3f} s  a new zero is taken from {wanted} frames: nothing must touch")
        touch = (self.tracker.step if self._step is None else self._step)(reading, time)
        # in the order of the skin's channels and axes, masked values NaN, and planes of one shape in one array
        reading = joined_planes(checked_planes(reading, self.skin.planes, single=True), self.skin.planes)
        events = self.monitor.update(touch) if "z" in touch.components else []
        self._check_zero(touch, time)
        packet = self._packed(touch, events, born, self._shown(reading)) if self._pages else None
        with self._lock:
            self._remember([str(e) for e in events])
            for sink in list(self._sinks):
                try:
                    sink.readings(time, reading)
                    sink.touch(touch, time)
                    for event in events:
                        sink.event(event)
                except PalpateError as error:
                    self._sinks.remove(sink)
                    self._leave(sink, error)
        if packet is not None:
            self.packet = packet
            numbers = unpacked(packet)[0]
            with self._lock:
                self.history.append({k: numbers[k] for k in TRAIL if k in numbers})
        self.count += 1
        self._notify()

    def _check_zero(self, touch: Touch, time: float) -> None:
        """Record an event if readings stay far from 0: once for each zero after which readings moved, and when a
        contact begins again.
        """
        if STANDS in touch.notes and not self._stands:
            self._stands = True
            self.note(f"{time:.3f} s  {STANDS}")
        for text in touch.notes:
            if text.startswith(BEGUN):
                self.note(f"{time:.3f} s  {text}")
        if (MOVED in touch.notes) is not self._moved:
            self._moved = not self._moved
            if self._moved:
                self.note(f"{time:.3f} s  {MOVED}")

    def _shown(self, reading: Any) -> Sequence[Any]:
        """Return the readings for the page, and the same minus the tracker's zero (NaN if there is none yet)."""
        if not self.readings:
            return ()
        found = flat_readings(reading, self.skin)
        return found, found - np.concatenate([np.ravel(plane) for plane in self.tracker.zero])

    def _packed(self, touch: Touch, events: Iterable[Event], born: float, readings: Sequence[Any]) -> bytes:
        """Build one packet for the pages."""
        health = self.tracker.health
        rows = np.flatnonzero(health.left_out)
        facts = {
            "frames": health.frames,
            "late": health.late,
            "unknown": health.unknown,
            "restarts": health.restarts,
            "approximate": health.approximate,
            "behind": self.behind,
            "left_out": [f"{health.label(int(r))} ({health.reasons[r]})" for r in rows[:20]],
            "left_out_count": len(rows),
        }
        return packed(touch, self.monitor, events, facts, born=born, ms=1e3 * self.tracker.seconds, readings=readings)

    def _leave(self, sink: Sink, error: PalpateError) -> None:
        """Continue without a sink that failed."""
        self.failure = str(error)
        self.lost.append(error)
        if sink is self._recorder:
            self._recorder, self.recording = None, None
        with contextlib.suppress(PalpateError):  # its error is already reported
            sink.close()
        if self._report is not None:
            self._report(f"{error} The live view continues without it.")

    def _notify(self) -> None:
        with self._lock:
            listeners = list(self._listeners)
        for wake in listeners:
            wake()
