"""Work beside a stream: in pieces, between which a frame goes first; and what came too late for the load that there is now is dropped."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate._threads import give_way
from palpate.tracking import background, pieces
from palpate.tracking.background import Background
from palpate.tracking.learning import OUTGROWN

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)


@pytest.mark.parametrize("piece", [1, 10_000, 10**9])
def test_pieces_make_the_whole(piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "PIECE", piece)
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((301, 77)), rng.standard_normal((77, 205))
    np.testing.assert_allclose(pieces.product(a, b), a @ b, atol=1e-12)
    found = pieces.square(a)
    np.testing.assert_allclose(found, a @ a.T, atol=1e-12)
    np.testing.assert_array_equal(found, found.T)
    matrix = found + np.eye(301)
    np.testing.assert_allclose(pieces.lower_factor(matrix), np.linalg.cholesky(matrix), atol=1e-10)
    matrix[200, 200] = -1.0
    with pytest.raises(np.linalg.LinAlgError):
        pieces.lower_factor(matrix)


def test_work_beside_a_stream_lets_a_frame_go_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "LONGEST", 20.0)
    thread, steps, begun = Background(threaded=True), [0], threading.Event()

    def work() -> str:
        for _ in range(1000):
            begun.set()
            give_way()
            steps[0] += 1
        return "done"

    with thread.frame():
        assert thread.result("work", work) is None
        begun.wait(20.0)
        time.sleep(0.05)
        assert steps[0] == 0
        # a frame that waits for it lets it go on, and only as long as it waits
        assert thread.wait(["work"], time.perf_counter() + 20.0)
        assert steps[0] == 1000
    assert thread.result("work", work) == "done"
    thread.close()


def test_a_stream_without_pauses_leaves_it_pieces_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "LONGEST", 0.001)
    thread, done = Background(threaded=True), threading.Event()

    def work() -> None:
        for _ in range(3):
            give_way()
        done.set()

    with thread.frame():
        thread.result("work", work)
        assert done.wait(20.0)
    thread.close()


def test_other_threads_do_not_wait() -> None:
    give_way()


@pytest.fixture(scope="module")
def skin() -> pp.Skin:
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    return pp.Skin(PAD, pp.AreaArray(shape=(20, 20), pitch=1e-3, depth=2e-3, channels=channels))


def pressed(skin: pp.Skin, force: float) -> Any:
    press = pp.solutions.hertz_point(contact_radius=3e-3, force=1.0)
    return force * np.asarray(skin.sense(skin.sample(press)))


@pytest.mark.long
def test_error_bars_need_no_columns(skin: pp.Skin, monkeypatch: pytest.MonkeyPatch) -> None:
    """What two products with the operator say is what the columns say."""
    from palpate.tracking.region import NormalEquations

    known, errors = NormalEquations.known, []
    rng = np.random.default_rng(0)
    noise = 0.01 * float(np.abs(pressed(skin, 1.0)).max())
    frames = [load * pressed(skin, 1.0) + noise * rng.standard_normal((3, 20, 20)) for load in [0.0] * 12 + [1.0] * 3]
    for at_hand in (known, lambda *_: None):
        monkeypatch.setattr(NormalEquations, "known", at_hand)
        tracker = skin.track(baseline=10, friction=0.6)
        for frame in frames:
            touch = tracker.step(frame)
        errors.append(touch._errors.posterior)
    for field in fields(errors[0]):
        one, other = (np.nan_to_num(getattr(e, field.name)) for e in errors)
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6 * max(float(np.abs(other).max()), 1e-300))


@pytest.mark.long
def test_a_penalty_that_the_load_has_outgrown_is_dropped(skin: pp.Skin) -> None:
    """Learned from a touch and taken up in a press, it read 0.000 N for 0.3 N."""
    tracker = skin.track(baseline=10, friction=0.6, budget=0.05)
    kept: dict[str, Callable[[], Any]] = {}

    class Late:
        """A thread that is done when it is told so."""

        threaded, ready = True, False

        def result(self, name: str, work: Callable[[], Any]) -> Any:
            if name not in kept:
                kept[name] = work
                return None
            return kept.pop(name)() if self.ready else None

        def __contains__(self, name: str) -> bool:
            return name in kept

    learning, thread = tracker._learning, Late()
    noise = 0.01 * float(np.abs(pressed(skin, 1.0)).max())
    learning.take_noise(noise)
    rng = np.random.default_rng(0)

    def learned(load: float) -> bool:
        y = load * pressed(skin, 1.0).ravel() + noise * rng.standard_normal(1200)
        return learning.learn(y, noise, 1.0, thread, energy=float(y @ y), leaving=lambda: lambda parameter: noise)  # type: ignore[arg-type]

    assert not learned(0.05)
    provisional, thread.ready = learning.parameter, True
    for k in range(OUTGROWN):
        assert not learned(0.3 * 4.0**k)
        assert learning.parameter == provisional
        assert "learn" in kept
    assert learned(0.3 * 4.0**OUTGROWN)  # what never comes in time is better than nothing
    assert learning.parameter != provisional
    tracker.close()
