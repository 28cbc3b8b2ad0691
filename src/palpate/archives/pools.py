"""Workers that process pieces: this thread, threads, processes, or a Dask cluster. `Pool` is their interface."""

from __future__ import annotations

import abc
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from typing import TYPE_CHECKING, Any

from palpate._extras import missing
from palpate.archives.work import Solved, Task, packed, solve, solve_packed
from palpate.errors import InvalidInput, Unsupported

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from palpate.skin import Skin

__all__ = ["Pool", "in_order", "pool_of"]

#: Number of workers that a piece may lose: a piece that needs more memory than there is would kill one worker after
#: another.
LOSSES = 3
#: Timeout of a scheduler [s].
ANSWER = 10


class Pool(AbstractContextManager["Pool"]):
    """Runs tasks in workers; leaving the context stops all of them."""

    #: Number of tasks that wait or run at a time; it is limited so that memory does not grow with the recording.
    width: int = 1
    #: Whether tasks run in other processes, which write their own results if they can.
    elsewhere: bool = False

    @abc.abstractmethod
    def submit(self, task: Task) -> Callable[[], Solved]:
        """Start a task. Return a function that waits for it and returns its result."""

    def restart(self) -> None:
        """Start new workers in place of those that were lost."""

    def __exit__(self, *_: object) -> None: ...


def in_order(pool: Pool, tasks: Iterator[Task]) -> Iterator[tuple[Task, Solved]]:
    """Yield each task with its result, in the order of the tasks. If the worker of a task is lost, another gets the
    task.

    Raises
    ------
    Unsupported
        The same task lost one worker after another.
    """
    waiting: deque[tuple[Task, Callable[[], Solved]]] = deque()
    losses = 0
    while True:
        try:
            while len(waiting) < pool.width and (task := next(tasks, None)) is not None:
                waiting.append((task, _later(pool, task)))
            if not waiting:
                return
            task, wait = waiting[0]
            solved = wait()
        except BrokenExecutor as error:
            losses += 1
            first = waiting[0][0]
            if losses > LOSSES:
                raise Unsupported(
                    f"workers were stopped by the system {losses} times at frames {first.start} to {first.stop - 1}: there may not be "
                    "enough memory. Use fewer workers, or shorter pieces (--chunk, chunk=)."
                ) from error
            pool.restart()
            waiting = deque((t, pool.submit(t)) for t, _ in waiting)
            continue
        losses = 0
        waiting.popleft()
        yield task, solved


def _later(pool: Pool, task: Task) -> Callable[[], Solved]:
    """Submit a task, even if the pool has just lost a worker."""
    try:
        return pool.submit(task)
    except BrokenExecutor as error:
        lost = error

        def broken() -> Solved:
            raise lost

        return broken


def pool_of(skin: Skin, options: dict[str, Any], *, workers: int, scheduler: str | None) -> Pool:
    """Return the requested pool.

    Raises
    ------
    InvalidInput
        Not a number of workers, or a scheduler that is not known or does not answer.
    Unsupported
        A cluster without the extra that brings Dask.
    """
    if isinstance(workers, bool) or not isinstance(workers, int) or workers < 1:
        raise InvalidInput(f"workers must be a whole number from 1 on; got {workers!r}.")
    if scheduler is None:
        scheduler = "processes" if workers > 1 else "serial"
    if scheduler == "serial":
        return _Here(skin, options)
    if scheduler == "threads":
        return _Threads(skin, options, workers)
    if scheduler == "processes":
        return _Processes(packed(skin, options), workers)
    if "://" not in scheduler:
        raise InvalidInput(
            f'scheduler must be "threads", "processes" or the address of a Dask scheduler such as tcp://10.0.0.1:8786; got {scheduler!r}.'
        )
    if workers > 1:
        raise InvalidInput(f"the scheduler at {scheduler} knows its own workers: leave workers (--workers) out.")
    return _Dask(packed(skin, options), scheduler)


class _Here(Pool):
    def __init__(self, skin: Skin, options: dict[str, Any]) -> None:
        self._skin, self._options = skin, options

    def submit(self, task: Task) -> Callable[[], Solved]:
        return lambda: solve(self._skin, self._options, task)


class _Threads(Pool):
    """Threads of this process, for methods that spend their time in large matrix products, and if memory is short."""

    def __init__(self, skin: Skin, options: dict[str, Any], workers: int) -> None:
        self._skin, self._options, self.width = skin, options, 2 * workers
        self._stack = ExitStack()
        limits = _limit_threads()
        if limits is not None:
            self._stack.callback(limits.restore_original_limits)
        self._executor = ThreadPoolExecutor(workers, thread_name_prefix="palpate-worker")

    def submit(self, task: Task) -> Callable[[], Solved]:
        return self._executor.submit(solve, self._skin, self._options, task).result

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown(wait=True, cancel_futures=True)
        self._stack.close()


class _Processes(Pool):
    """Processes that end with this one, however it ends: each watches a pipe whose other end is here."""

    elsewhere = True

    def __init__(self, job: bytes, workers: int) -> None:
        self._job, self._workers, self.width = job, workers, 2 * workers
        self._begin()

    def _begin(self) -> None:
        import multiprocessing

        # do not fork: a copy of a process that has threads may hang
        context = multiprocessing.get_context("spawn")
        watched, self._held = context.Pipe(duplex=False)
        self._executor = ProcessPoolExecutor(
            self._workers, mp_context=context, initializer=_begin_worker, initargs=(watched,)
        )

    def submit(self, task: Task) -> Callable[[], Solved]:
        future: Future[Solved] = self._executor.submit(solve_packed, self._job, task)
        return future.result

    def restart(self) -> None:
        self._end()
        self._begin()

    def _end(self) -> None:
        self._held.close()  # their work is no longer needed
        self._executor.shutdown(wait=True, cancel_futures=True)

    def __exit__(self, *_: object) -> None:
        self._end()


def _begin_worker(watched: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the first process reports
    _limit_threads()
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()


def _end_with(watched: Connection) -> None:
    try:
        watched.recv()
    except (EOFError, OSError):
        os._exit(1)


def _limit_threads() -> Any:
    """Limit linear algebra in this process to one thread, because other processes use the other cores. Return None if
    no library supports this.
    """
    import scipy.linalg.blas  # noqa: F401  # so that its own library is there to be told

    try:
        import threadpoolctl
    except ModuleNotFoundError:
        return None
    return threadpoolctl.threadpool_limits(limits=1, user_api="blas")


class _Dask(Pool):
    """A Dask cluster, whose scheduler gives the task of a lost worker to another and limits the workers' threads."""

    elsewhere = True

    def __init__(self, job: bytes, address: str) -> None:
        try:
            import distributed
        except ImportError as error:
            raise missing("Dask schedulers", error) from error
        self._job, self._address = job, address
        self._lost: tuple[type[Exception], ...] = (distributed.KilledWorker,)
        try:
            self._client = distributed.Client(address, timeout=ANSWER, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InvalidInput(
                f"no Dask scheduler answers at {address} ({str(error) or type(error).__name__}): start one (dask scheduler), and give the address "
                "that it says."
            ) from error
        threads = sum(self._client.nthreads().values())
        if not threads:
            self._client.close()
            raise InvalidInput(f"the Dask scheduler at {address} has no workers: start some (dask worker {address}).")
        self.width = 2 * threads
        self._waiting: set[Any] = set()

    def submit(self, task: Task) -> Callable[[], Solved]:
        future = self._client.submit(solve_packed, self._job, task, pure=False)
        self._waiting.add(future)

        def wait() -> Solved:
            try:
                return future.result()
            except self._lost as error:
                raise Unsupported(
                    f"the cluster lost one worker after another at frames {task.start} to {task.stop - 1}: there may not be enough memory. "
                    "Use shorter pieces (--chunk, chunk=)."
                ) from error
            except (OSError, CancelledError) as error:
                raise InvalidInput(f"the Dask scheduler at {self._address} is gone ({error}).") from error
            finally:
                self._waiting.discard(future)

        return wait

    def __exit__(self, *_: object) -> None:
        if self._waiting:
            self._client.cancel(list(self._waiting), force=True)
        self._client.close()
