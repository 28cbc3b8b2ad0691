"""Run long work in a thread beside the stream, if frames have a time budget."""

from __future__ import annotations

import math
import threading
import time as clock
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Any

from palpate._threads import beside

__all__ = ["Background"]

#: Longest time [s] for which a piece of the work waits for the current frame: without pauses in the stream it still
#: makes progress.
LONGEST = 0.01


class Background:
    """Run work immediately, or with ``threaded`` in a thread that pauses while a frame is being solved."""

    def __init__(self, *, threaded: bool) -> None:
        self.threaded = threaded
        self._between = threading.Event()  # set while no frame is being solved
        self._between.set()
        self._worker: ThreadPoolExecutor | None = None
        if threaded:
            self._worker = ThreadPoolExecutor(
                1, thread_name_prefix="palpate-tracker", initializer=beside, initargs=(self._give_way,)
            )
        self._pending: dict[str, Future[Any]] = {}

    @contextmanager
    def frame(self) -> Iterator[None]:
        """Context in which a frame is being solved."""
        self._between.clear()
        try:
            yield
        finally:
            self._between.set()

    def _give_way(self) -> None:
        self._between.wait(LONGEST)

    def result(self, name: str, work: Callable[[], Any]) -> Any:
        """The result of ``work``: immediately without a thread; otherwise None until the thread has finished."""
        if self._worker is None:
            return work()
        if name not in self._pending:
            self._pending[name] = self._worker.submit(work)
            return None
        if not self._pending[name].done():
            return None
        return self._pending.pop(name).result()

    def __contains__(self, name: str) -> bool:
        """Whether work of this name is pending."""
        return name in self._pending

    def wait(self, names: Sequence[str], deadline: float) -> bool:
        """Wait for work of these names until ``deadline`` (in `time.perf_counter`); return whether there was any and
        it is finished.
        """
        pending = [self._pending[n] for n in names if n in self._pending]
        left = max(deadline - clock.perf_counter(), 0.0)
        answering = not self._between.is_set()
        self._between.set()
        try:
            return bool(pending) and not wait(pending, None if math.isinf(left) else left).not_done
        finally:
            if answering:
                self._between.clear()

    def drop(self, name: str) -> None:
        """Discard the result of this work, if pending."""
        self._pending.pop(name, None)

    def forget(self) -> None:
        """Discard the results of all pending work."""
        self._pending.clear()

    def close(self) -> None:
        """End the thread."""
        if self._worker is not None:
            self._worker.shutdown(wait=True, cancel_futures=True)
