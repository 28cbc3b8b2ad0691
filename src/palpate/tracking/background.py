"""Long work beside the stream, where a frame has a budget of time."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

__all__ = ["Background"]


class Background:
    """Work done at once, or with ``threaded`` in one thread of its own."""

    def __init__(self, *, threaded: bool) -> None:
        self.threaded = threaded
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="palpate-tracker") if threaded else None
        self._pending: dict[str, Future[Any]] = {}

    def result(self, name: str, work: Callable[[], Any]) -> Any:
        """What ``work`` returns: at once without a thread, else None until the thread has it."""
        if self._worker is None:
            return work()
        if name not in self._pending:
            self._pending[name] = self._worker.submit(work)
            return None
        if not self._pending[name].done():
            return None
        return self._pending.pop(name).result()

    def __contains__(self, name: str) -> bool:
        """Whether work of this name is under way."""
        return name in self._pending

    def wait(self, names: Sequence[str], deadline: float) -> bool:
        """Wait for work of these names, to the time ``deadline`` of `time.perf_counter`; whether there was any and it is done."""
        pending = [self._pending[n] for n in names if n in self._pending]
        left = max(deadline - clock.perf_counter(), 0.0)
        return bool(pending) and not wait(pending, None if math.isinf(left) else left).not_done

    def drop(self, name: str) -> None:
        """Drop the result of this work, if it is under way."""
        self._pending.pop(name, None)

    def forget(self) -> None:
        """Drop the results of what is under way."""
        self._pending.clear()

    def close(self) -> None:
        """End the thread."""
        if self._worker is not None:
            self._worker.shutdown(wait=True, cancel_futures=True)
