"""Linear algebra takes one thread where a problem is small, and gives the others back."""

from __future__ import annotations

import multiprocessing
import os
import threading
from typing import Any

import numpy as np
import pytest
import scipy.linalg.blas  # noqa: F401
import threadpoolctl

import palpate as pp
from palpate._threads import SMALL, Lock, _libraries, cached_property, few_threads, spare
from palpate.inverse.contact import discrepancy
from palpate.live import Session


@pytest.fixture(autouse=True)
def _every_library() -> None:
    """Other tests load libraries of linear algebra after the first problem of a process."""
    _libraries.cache_clear()


def counts() -> list[int]:
    return [x["num_threads"] for x in threadpoolctl.threadpool_info() if x["user_api"] == "blas"]


def test_threads_are_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (0.4, 0.0, 0.0), raising=False)
    before = counts()
    with few_threads(SMALL + 1):
        assert counts() == before
    with few_threads(10):
        assert set(counts()) == {1}
    assert counts() == before
    with few_threads(2 * SMALL, 100):  # few readings on many cells
        assert set(counts()) == {1}
    with few_threads(2 * SMALL, 2 * SMALL):
        assert counts() == before
    with pytest.raises(ValueError, match="mine"), few_threads(10):
        raise ValueError("mine")
    assert counts() == before


@pytest.mark.parametrize(
    ("load", "threads"), [(0.0, None), (1.3, None), (2.0, 3), (3.6, 1), (50.0, 1)], ids=lambda v: str(v)
)
def test_large_problems_leave_cores_to_other_programs(
    load: float, threads: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "getloadavg", lambda: (load, 0.0, 0.0), raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3}, raising=False)
    assert spare() == threads
    before = counts()
    with few_threads(SMALL + 1):
        # no more than a user's OPENBLAS_NUM_THREADS, where it is set
        assert counts() == [min(threads or n, n) for n in before]
    assert counts() == before


def test_a_library_that_has_fewer_keeps_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three threads for a large problem were given to a library to which its user had given one."""
    monkeypatch.setattr(os, "getloadavg", lambda: (2.0, 0.0, 0.0), raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3}, raising=False)
    first, *rest = threadpoolctl.ThreadpoolController().select(user_api="blas").lib_controllers
    with threadpoolctl.threadpool_limits(4, user_api="blas"):
        first.set_num_threads(1)
        before = counts()
        with few_threads(SMALL + 1):
            assert counts() == [1, *[min(3, n) for n in before[1:]]]
            assert len(rest) == len(before) - 1
        assert counts() == before


def test_a_system_that_knows_no_load_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown() -> tuple[float, float, float]:
        raise OSError

    monkeypatch.setattr(os, "getloadavg", unknown, raising=False)
    assert spare() is None


def test_they_are_given_back_by_callers_that_overlap() -> None:
    before = counts()
    inside, leave = threading.Event(), threading.Event()

    def other() -> None:
        with few_threads(10):
            inside.set()
            leave.wait(30)

    worker = threading.Thread(target=other)
    with few_threads(10):
        worker.start()
        assert inside.wait(30)
        assert set(counts()) == {1}
    leave.set()
    worker.join(30)
    assert counts() == before


def test_a_frame_leaves_the_threads_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    skin = pp.Skin(pad, pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
    prepared = pp.Constrained().prepare(skin.problem())
    seen: list[set[int]] = []
    real = discrepancy.search

    def search(*args: object) -> object:
        seen.append(set(counts()))
        return real(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(discrepancy, "search", search)
    before = counts()
    prepared.solve([np.ones((1, 9))])
    assert seen == [{1}]
    assert counts() == before


def test_a_live_session_and_what_is_learned_beside_it_take_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0))
    press = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
    before = counts()
    seen: dict[str, set[int]] = {}
    with skin.track(budget=60.0) as tracker:
        background = tracker._background

        def played() -> None:
            tracker.step(press, time=0.0)
            while "beside" not in seen:
                found = background.result("counts", lambda: set(counts()))
                seen.update({"beside": found} if found else {})

        session = Session(skin, lambda: iter(()), tracker, pp.GraspMonitor(friction=0.5), pace=False)
        monkeypatch.setattr(session, "_play", played)
        worker = threading.Thread(target=session.run)
        worker.start()
        worker.join(60)
    assert not worker.is_alive()
    assert seen == {"beside": {1}}
    assert counts() == before


def test_a_step_of_a_tracker_takes_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    tracker = pp.Skin(pad, pp.LineArray(count=9, pitch=1e-3, depth=1e-3, channels=["stress_zz"])).track()
    real, seen, before = tracker._step, [], counts()

    def step(*given: object) -> object:
        seen.append(set(counts()))
        return real(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(tracker, "_step", step)
    tracker.step(np.zeros((1, 9)))
    assert seen == [{1}]
    assert counts() == before


class Worked:
    """One property whose work waits."""

    begun, go_on = threading.Event(), threading.Event()

    def __init__(self, slow: bool) -> None:
        self.slow = slow

    @cached_property
    def value(self) -> int:
        if self.slow:
            self.begun.set()
            self.go_on.wait(120)
        return 7


def in_child(work: Any) -> int | None:
    """What work of a forked child ends with; None where it waits for ever."""
    child = multiprocessing.get_context("fork").Process(target=work)
    child.start()
    child.join(60)
    if child.is_alive():
        child.kill()
        child.join()
        return None
    return child.exitcode


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # forking with threads: from Python 3.12 on
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_child_forked_while_a_thread_works_does_not_wait_for_that_thread() -> None:
    """Neither for a property that it works out, nor for what is kept."""
    busy = threading.Thread(target=lambda: Worked(True).value)
    busy.start()
    lock = Lock()
    try:
        assert Worked.begun.wait(120)
        with lock:

            def work() -> None:
                assert Worked(False).value == 7
                with lock:
                    pass

            assert in_child(work) == 0
            assert not lock.acquire(blocking=False)  # the parent still has it
        assert lock.acquire(blocking=False)
    finally:
        Worked.go_on.set()
        busy.join()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.long
def test_children_forked_while_a_thread_reconstructs_reconstruct_too() -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=100.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    frame = skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=0.3), rng=np.random.default_rng(0))
    force = float(skin.reconstruct(frame).force[-1])
    ended = threading.Event()

    def busy() -> None:
        while not ended.is_set():
            skin.reconstruct(frame)

    def work() -> None:
        assert float(skin.reconstruct(frame).force[-1]) == pytest.approx(force, rel=1e-6)

    thread = threading.Thread(target=busy)
    thread.start()
    try:
        assert [in_child(work) for _ in range(8)] == [0] * 8
    finally:
        ended.set()
        thread.join()
