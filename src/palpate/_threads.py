"""Threads of the libraries for linear algebra.

They use all cores for every product, also for matrices so small that the threads only wait for each other; where other programs run, they
wait for long (a frame of a 4 x 4 array took seven times the processor time on two busy cores).
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

#: Unknowns up to which one thread is enough: a factorisation takes less than a second then.
SMALL = 4096
#: Few readings on many cells make no matrix wider than some of these times the readings (`palpate.inverse.constrained.quadratic`): 432 readings on 5800 unknowns
#: took 190 s of processor time with two threads on two busy cores, 13 s with one.
WIDEST = 4


class cached_property(functools.cached_property[Value]):
    """A property that is worked out once for each object. Two threads may both work it out, to the same.

    That of functools has a lock for all objects of a class (Python 3.11): threads wait for each other, and a child that is forked while one
    of them has it waits for ever.
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
    """A lock that is free in a child that is forked while another thread of the parent has it: that thread is not in the child."""

    _all: ClassVar[weakref.WeakSet[Lock]] = weakref.WeakSet()

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._all.add(self)

    def acquire(self, blocking: bool = True) -> bool:
        """Take it; whether it was free, where it is not waited for."""
        return self._lock.acquire(blocking)

    def release(self) -> None:
        """Give it back."""
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
    """A context in which linear algebra uses one thread with few unknowns or ``readings``, else at most those that other programs leave.

    The number belongs to the whole process: of several threads of the caller, one changes it and gives the others back when it leaves,
    which costs the rest time and nothing else. (Were each to put back what it found, one of them would put back the change; and only one thread
    of a process may change it.)
    """
    libraries, mine = _libraries()
    if readings is not None:
        unknowns = min(unknowns, WIDEST * readings)
    threads = 1 if unknowns <= SMALL else spare()
    if threads is None or libraries is None or not mine.acquire(blocking=False):
        yield
        return
    try:
        # never more than one has: a user may have said how many (OPENBLAS_NUM_THREADS)
        more = [x.filepath for x in libraries.lib_controllers if x.user_api == "blas" and x.num_threads > threads]
        with libraries.select(filepath=more).limit(limits=threads):
            yield
    finally:
        mine.release()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def spare() -> int | None:
    """Threads that other programs leave: the cores minus the load of the last minute, without this program's own. None: all of them, or unknown.

    A thread that waits for its core keeps those that wait for it spinning: 4800 unknowns on two cores with two other programs took 30 s of
    processor time with two threads, 8 s with one, and four times as long.
    """
    try:
        load = os.getloadavg()[0]
    except (AttributeError, OSError):  # not on every system
        return None
    others = round(load) - 1
    return None if others <= 0 else max(1, cores() - others)


class _Beside(threading.local):
    """The check for more urgent work, one for each thread."""

    wait: Callable[[], None] | None = None


_this = _Beside()


def beside(wait: Callable[[], None]) -> None:
    """From now on work in this thread is beside something else: `give_way` calls ``wait``."""
    _this.wait = wait


def give_way() -> None:
    """Long work calls this every millisecond or two: it waits if more urgent work runs beside it.

    Python's threads take turns of 5 ms, and libraries for linear algebra take none: a frame of 2 ms beside such work took 10 to 50 ms.
    """
    if _this.wait is not None:
        _this.wait()


@functools.cache
def _libraries() -> tuple[Any, Lock]:
    """The controller of the loaded libraries of linear algebra (None without threadpoolctl), and its lock."""
    import scipy.linalg.blas  # noqa: F401

    try:
        import threadpoolctl
    except ModuleNotFoundError:
        return None, Lock()
    return threadpoolctl.ThreadpoolController(), Lock()
