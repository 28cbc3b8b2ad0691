"""Control the threads of libraries for linear algebra.

They use all cores for every product, even for matrices so small that the threads mainly wait for each other. If other
programs run, the threads wait long (a frame of a 4 x 4 array took seven times the processor time on two busy cores).
"""

from __future__ import annotations

import functools
import os
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar, Self, TypeVar, overload

__all__ = [
    "SMALL", "WIDEST", "Lock", "beside", "cached_property", "cores", "few_threads", "give_way", "spare",
]  # fmt: skip

Value = TypeVar("Value")

#: Largest number of unknowns for which one thread is enough: a factorisation then takes less than a second.
SMALL = 4096
#: With few readings on many cells no matrix is wider than WIDEST times the readings
#: (`palpate.inverse.constrained.quadratic`): 432 readings with 5800 unknowns took 190 s of processor time with two
#: threads on two busy cores, 13 s with one.
WIDEST = 4


class cached_property(functools.cached_property[Value]):
    """A property that is computed once for each object and then stored. Two threads may both compute it, with the same result.

    `functools.cached_property` has a lock for all objects of a class (Python 3.11): threads wait for each other, and a child
    process that is forked while a thread holds the lock waits for ever.
    """

    @overload
    def __get__(self, instance: None, owner: type[Any] | None = None) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type[Any] | None = None) -> Value: ...

    def __get__(self, instance: object | None, owner: type[Any] | None = None) -> Any:
        """The value, stored among the attributes of ``instance``."""
        if instance is None:
            return self
        kept, name = instance.__dict__, str(self.attrname)
        if name not in kept:
            kept[name] = self.func(instance)
        return kept[name]


class Lock:
    """A lock that is free in a child process even if another thread held it when the parent forked, because that
    thread does not exist in the child.
    """

    _all: ClassVar[weakref.WeakSet[Lock]] = weakref.WeakSet()

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._all.add(self)

    def acquire(self, blocking: bool = True) -> bool:
        """Acquire the lock. Without blocking, return whether it was free."""
        return self._lock.acquire(blocking)

    def release(self) -> None:
        """Release the lock."""
        self._lock.release()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    @classmethod
    def renew(cls) -> None:
        """Replace all locks in a child process."""
        for lock in list(cls._all):
            lock._lock = threading.Lock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=Lock.renew)


@contextmanager
def few_threads(unknowns: int, readings: int | None = None) -> Iterator[None]:
    """Limit linear algebra within the context: to one thread with few unknowns or ``readings``, otherwise to the
    number that other programs leave free.

    The number of threads belongs to the whole process. If several threads of the caller use this context, one of them
    changes the number and restores it when it leaves; meanwhile the others may run with fewer threads, which only
    costs time. (If each restored what it found, one of them would restore the changed number; and only one thread of a
    process may change it.)
    """
    libraries, mine = _libraries()
    if readings is not None:
        unknowns = min(unknowns, WIDEST * readings)
    threads = 1 if unknowns <= SMALL else spare()
    if threads is None or libraries is None or not mine.acquire(blocking=False):
        yield
        return
    try:
        # never increase the number: the user may have set it (OPENBLAS_NUM_THREADS)
        more = [x.filepath for x in libraries.lib_controllers if x.user_api == "blas" and x.num_threads > threads]
        with libraries.select(filepath=more).limit(limits=threads):
            yield
    finally:
        mine.release()


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def spare() -> int | None:
    """Return the number of threads that other programs leave free: the cores minus the load of the last minute, not
    counting this program. None means all of them, or unknown.

    A thread that waits for its core keeps the threads that wait for it spinning: 4800 unknowns on two cores with two
    other programs took 30 s of processor time with two threads, 8 s with one, and four times as long.
    """
    try:
        load = os.getloadavg()[0]
    except (AttributeError, OSError):  # not on every system
        return None
    others = round(load) - 1
    return None if others <= 0 else max(1, cores() - others)


class _Beside(threading.local):
    """Stores, for each thread, the check for more urgent work."""

    wait: Callable[[], None] | None = None


_this = _Beside()


def beside(wait: Callable[[], None]) -> None:
    """Mark work in this thread as background work: `give_way` calls ``wait``."""
    _this.wait = wait


def give_way() -> None:
    """Wait if more urgent work runs. Long work calls this every millisecond or two.

    Python's threads take turns of 5 ms, and libraries for linear algebra take none: a frame of 2 ms beside such work
    took 10 to 50 ms.
    """
    if _this.wait is not None:
        _this.wait()


@functools.cache
def _libraries() -> tuple[Any, Lock]:
    """Return the controller of the loaded libraries of linear algebra (None without threadpoolctl), and its lock."""
    import scipy.linalg.blas  # noqa: F401

    try:
        import threadpoolctl
    except ModuleNotFoundError:
        return None, Lock()
    return threadpoolctl.ThreadpoolController(), Lock()
