"""A stand-in for a USB camera, and `palpate live --camera` on it: no such camera is needed, and when each picture was there is known.

`Camera` does what OpenCV's capture does with a camera that sends MJPEG through Video for Linux: pictures come by a clock of their own, four of them
wait for whoever reads, the driver drops what comes while all four are full, and each is decoded from JPEG when it is read. What it does not do: exposure, the way over the
cable, and the kernel's copying.

Time is that of one core with nothing else to do: the processor time of this process, and the waiting for pictures; what else the machine does is not in it. Threads then
take turns: pictures that came while one was worked on are decoded when the next is asked for, as the thread that reads them would. With `wall` it is the clock's time, with threads
as they are, on a core that other programs may want too.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import palpate as pp
from palpate.camera import Pictures, Scene
from palpate.live import Session
from palpate.live.camera import CameraSource
from palpate.live.server import BUDGET

#: Pictures that wait in Video for Linux until they are read.
BUFFERS = 4
#: Pictures at rest at the start, of which the reference are the first ten; then presses of so many pictures.
REST, REFERENCE, PRESS = 15, 10, 40


class Camera:
    """In place of `cv2.VideoCapture`: JPEG pictures, over and over, so many a second, ``last`` of them.

    The number of each picture is written into its first pixel, so that results are known by it.
    """

    def __init__(self, packed: list[bytes], rate: float, last: int, *, wall: bool) -> None:
        self.packed, self.rate, self.last, self.wall = packed, rate, last, wall
        self.waiting: deque[int] = deque()
        self.came = self.dropped = self.skipped = 0
        self.started: float | None = None
        self.idle = 0.0
        self.spent: list[float] = []
        self.newest = False

    def now(self) -> float:
        """[s]"""
        return time.perf_counter() if self.wall else time.process_time() + self.idle

    def due(self, number: int) -> float:
        """When a picture comes."""
        if self.started is None:
            self.started = self.now()
        return self.started + number / self.rate

    def isOpened(self) -> bool:
        return True

    def release(self) -> None:
        pass

    def read(self) -> tuple[bool, Any]:
        """The picture that waits longest, as OpenCV gives it, or the next one."""
        self._wait()
        return (True, self._decoded(self.waiting.popleft())) if self.waiting else (False, None)

    def pictures(self) -> Iterator[tuple[float, Any, str]]:
        """The same as a source of pictures in one thread: the reference one by one, then the newest of all that came."""
        while True:
            self._wait()
            if not self.waiting:
                return
            image = self._decoded(self.waiting.popleft())
            while self.newest and (self._come() or self.waiting):
                self.skipped += 1
                image = self._decoded(self.waiting.popleft())
            yield self.now(), np.ascontiguousarray(image[..., ::-1]), ""

    def _come(self) -> bool:
        """Take in what has come by now; whether anything waits."""
        while self.came < self.last and self.due(self.came) <= self.now():
            # one thread of two reads while the other works: nothing is dropped for want of buffers
            if len(self.waiting) < BUFFERS or not self.wall:
                self.waiting.append(self.came)
            else:
                self.dropped += 1
            self.came += 1
        return bool(self.waiting)

    def _wait(self) -> None:
        while not self._come() and self.came < self.last:
            left = max(0.0, self.due(self.came) - self.now())
            if self.wall:
                time.sleep(left)
            else:
                self.idle += left

    def _decoded(self, number: int) -> Any:
        begun = time.thread_time()
        # at rest, then pressed harder and less hard, over and over
        which = number if number < REST else REST + (number - REST) % (len(self.packed) - REST)
        image = cv2.imdecode(np.frombuffer(self.packed[which], np.uint8), cv2.IMREAD_COLOR)
        self.spent.append(time.thread_time() - begun)
        assert image is not None
        image[0, 0] = number & 255, number >> 8 & 255, number >> 16
        return image


def rates(scenes: list[tuple[str, Scene, str]], seconds: float, *, wall: bool) -> Iterator[str]:
    """`palpate live --camera`, page packets and all, on one core; each scene with its [camera] section, at 30 and 60 pictures a second."""
    cv2.setNumThreads(1)
    yield (
        "| camera | a second | decode [ms] | follow [ms] | invert [ms] | results a second | skipped for newer ones | dropped by the driver | "
        "from picture to result, median [ms] | 99 % [ms] |"
    )
    yield "|---" * 10 + "|"
    cores = os.sched_getaffinity(0)
    capture, clock = cv2.VideoCapture, time.perf_counter
    try:
        if not wall:
            time.perf_counter = time.thread_time  # what a tracker's budget is measured by
        os.sched_setaffinity(0, {max(cores)})
        for label, one, section in scenes:
            rng = np.random.default_rng(0)
            ball = one.skin.sample(pp.solutions.hertz_point(contact_radius=2.5e-3, force=1.0).sliding(0.3))
            presses = [0.5 - 0.5 * np.cos(2 * np.pi * i / PRESS) for i in range(PRESS)]
            images = [one.picture(p * ball if p > 1e-9 else None, rng=rng) for p in [0.0] * REST + presses]
            packed = [cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes() for image in images]
            for rate in (30.0, 60.0):
                camera = Camera(packed, rate, round(seconds * rate), wall=wall)
                yield f"| {label} | {rate:.0f} | " + _run(camera, section) + " |"
    finally:
        os.sched_setaffinity(0, cores)
        cv2.VideoCapture, time.perf_counter = capture, clock  # type: ignore[misc]


def _source(camera: Camera, section: str) -> CameraSource:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "gel.toml"
        path.write_text(section)
        options = {"friction": 0.6, "budget": BUDGET}
        if camera.wall:
            cv2.VideoCapture = lambda _: camera  # type: ignore[misc,assignment]
            return CameraSource("0", path, reference=REFERENCE, options=options)
        shown = Pictures(camera.pictures(), name="stand-in", timed=True)
        found = CameraSource(shown, path, reference=REFERENCE, options=options)

    def newest() -> None:
        camera.newest = True

    found.latest.start = newest  # type: ignore[method-assign]
    return found


def _run(camera: Camera, section: str) -> str:
    source = _source(camera, section)
    readings, tracker = source.touches.readings, source.touches.tracker
    assert tracker is not None
    spent: dict[str, list[float]] = {"follow": [], "step": []}
    delays: list[float] = []
    number = 0

    def timed(act: Callable[..., Any], name: str) -> Callable[..., Any]:
        def same(*given: Any) -> Any:
            nonlocal number
            if name == "follow" and given[0] is not None:
                number = sum(int(v) << 8 * i for i, v in enumerate(given[0][0, 0, ::-1]))
            begun = time.thread_time()
            found = act(*given)
            spent[name].append(time.thread_time() - begun)
            return found

        return same

    readings.markers.follow = timed(readings.markers.follow, "follow")  # type: ignore[method-assign]
    session = Session(
        source.touches.skin,
        source,
        tracker,
        pp.GraspMonitor(friction=0.6),
        pace=False,
        end=source.close,
        step=timed(source.step, "step"),
    )
    source.report, source.skip = session.note, session.skip
    session.listen(lambda: None if session.ended else delays.append(camera.now() - camera.due(number)))
    begun, first = camera.now(), camera.came
    session.run()
    lasted, came = camera.due(camera.last) - begun, camera.last - first
    session.stop()
    # the first seconds take the zero, and catch up with what waited meanwhile
    late = 1e3 * np.array(delays[len(delays) // 4 :])
    decode, follow, step = (
        1e3 * float(np.median(part[len(part) // 4 :])) for part in (camera.spent, spent["follow"], spent["step"])
    )
    return (
        f"{decode:.1f} | {follow:.1f} | {step:.1f} | {session.count / lasted:.0f} | {session.behind + camera.skipped} of {came} | {camera.dropped} | "
        f"{np.median(late):.0f} | {np.quantile(late, 0.99):.0f}"
    )
