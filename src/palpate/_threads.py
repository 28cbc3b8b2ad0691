"""Threads of the libraries for linear algebra.

They use all cores for every product, also for matrices so small that the threads only wait for each other; where other programs run, they
wait for long (a frame of a 4 x 4 array took seven times the processor time on two busy cores).
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["SMALL", "few_threads"]

#: Unknowns up to which one thread is enough: a factorisation takes less than a second then.
SMALL = 4096
#: Few readings on many cells make no matrix wider than some of these times the readings (`palpate.inverse.contact.quadratic`): 432 readings on 5800 unknowns
#: took 190 s of processor time with two threads on two busy cores, 13 s with one.
WIDEST = 4


@contextmanager
def few_threads(unknowns: int, readings: int | None = None) -> Iterator[None]:
    """A context in which linear algebra takes one thread where there are few unknowns, or few ``readings`` that tell of them.

    The number belongs to the whole process: of several threads of the caller, one changes it and gives the others back when it leaves,
    which costs the rest time and nothing else. (Were each to put back what it found, one of them would put back the change.)
    """
    libraries, mine = _libraries()
    if readings is not None:
        unknowns = min(unknowns, WIDEST * readings)
    if unknowns > SMALL or libraries is None or not mine.acquire(blocking=False):
        yield
        return
    try:
        with libraries.limit(limits=1, user_api="blas"):
            yield
    finally:
        mine.release()


@functools.cache
def _libraries() -> tuple[Any, threading.Lock]:
    """Those that are loaded (SciPy brings its own; None where nothing is installed that could tell them), and whose turn it is."""
    import scipy.linalg.blas  # noqa: F401

    try:
        import threadpoolctl
    except ModuleNotFoundError:
        return None, threading.Lock()
    return threadpoolctl.ThreadpoolController(), threading.Lock()
