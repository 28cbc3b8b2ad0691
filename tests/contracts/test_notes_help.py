"""What a result says of itself helps on that very call, and is said once; a zero that moved while it was taken is questioned."""

from __future__ import annotations

from collections.abc import Iterator
from unittest import mock

import numpy as np
import pytest

import palpate as pp
from palpate.sensing.zero import MOVED, Rest, moved
from palpate.status import Status
from palpate.tracking import iteration
from palpate.tracking.held import Held
from remedies.noted import MISSING, line, readings, tracked


@pytest.mark.parametrize(("budget", "said"), [(1e-7, "budget larger than 1e-07 s"), (None, "tolerance= looser than")])
def test_what_ended_an_iteration_is_what_the_note_offers(budget: float | None, said: str) -> None:
    """A looser tolerance does not help where time ran out, nor more time where steps did."""
    # without the models of a single solve, which would answer the frame
    with mock.patch.object(iteration, "ITERATIONS", 15 if budget is None else 300), mock.patch.object(Held, "hold"):
        touch = tracked(readings(0.0, 0.0, 1.0, 1.0), budget=budget)[-1]
    notes = " ".join(touch.notes)
    assert touch.status == Status.NOT_CONVERGED
    assert said in notes
    assert ("budget" in notes) is not ("tolerance= looser" in notes)


@pytest.mark.parametrize(
    ("frames", "status"),
    [
        (np.concatenate([readings(0.0), MISSING]), Status.MISSING),
        (readings(0.0), Status.CAPTURING_ZERO),
        (-readings(0.0, 0.0, 1.0), Status.NOT_PUSHING),
    ],
)
def test_a_tracker_says_a_status_once(frames: np.ndarray, status: Status) -> None:
    touch = tracked(frames, baseline=5 if status is Status.CAPTURING_ZERO else 0)[-1]
    assert touch.status == status
    text = "\n".join(touch.notes)
    if status is Status.NOT_PUSHING:  # answered by the models of a single solve, which says more
        assert text.count("the contact pulls as a whole") == 1
        assert status.meaning.split(":")[0] not in text
    else:
        assert text.count(status.meaning.split(":")[0]) == 1
        assert text.count(status.remedy) == 1


@pytest.mark.parametrize("step", [0.005, 0.03, 0.3])
def test_a_zero_taken_while_a_finger_presses_in_equal_steps_is_questioned(step: float) -> None:
    """Twelve frames of zero, the finger from the seventh on: the press that follows is read too small by what the zero holds of it."""
    loads = [0.0] * 6 + [step * k for k in range(1, 7)]
    touches = tracked(readings(*loads, loads[-1]), baseline=12)
    assert [MOVED in t.notes for t in touches] == [False] * 11 + [True] * 2
    assert Rest.of(readings(*loads)).wanders


def test_a_zero_at_rest_is_not_questioned_and_a_new_one_ends_the_question() -> None:
    tracker = line()[0].track(baseline=12)
    at_rest = tracked(readings(*[0.0] * 14), tracker=tracker)
    assert not any(MOVED in t.notes for t in at_rest)
    spoilt = tracked(
        readings(*np.linspace(0.0, 0.3, 12), 0.3), baseline=12, tracker=(other := line()[0].track(baseline=12))
    )
    assert MOVED in spoilt[-1].notes
    other.rezero()
    assert MOVED not in tracked(readings(*[0.0] * 11, seed=5), tracker=other, begin=1.0)[-1].notes


def test_counts_that_toggle_by_one_are_no_trend() -> None:
    """A reading that is the same but for one count has no noise to compare with."""
    counts = np.full((12, 16), 7.0)
    counts[5:, 3] += 1.0
    assert not moved(counts, np.zeros(16))
    counts[6:, 3] += 5.0
    counts[2, 4] += 1.0
    assert moved(counts, np.zeros(16))


def test_noise_that_differs_from_taxel_to_taxel_is_no_trend() -> None:
    rng = np.random.default_rng(0)
    std = 10.0 ** rng.uniform(-1.0, 1.0, 48)
    index = np.repeat(np.arange(3), 16)
    assert sum(moved(std * rng.standard_normal((12, 48)), index) for _ in range(100)) == 0


def test_a_frame_without_answer_is_said_once_in_the_table_of_forces() -> None:
    from palpate.touch import Forces

    forces = Forces()
    for touch in tracked(np.concatenate([readings(0.0, 1.0), MISSING])):
        forces.add(touch)
    assert sum("too few readings are finite" in n for n in forces.notes) == 1


def test_a_network_that_does_not_settle_offers_what_it_has() -> None:
    """The budget and the tolerance of a tracker are no options of a method."""
    from remedies.noted import network

    touch = network(method="network", parameter=1e-12)
    text = " ".join(touch.notes)
    assert touch.status == Status.NOT_CONVERGED
    assert "a larger parameter helps" in text
    assert "budget" not in text
    with pytest.raises(pp.Unsupported, match="budget"):
        network(method="network", budget=1.0)


def test_the_frames_of_the_zero_are_the_first_ones_also_where_a_live_view_is_late() -> None:
    """A paced stream that fell behind skips frames, and would take its zero from those in which the finger presses already."""
    import time

    from palpate.live.session import Session

    skin, full = line()
    found: list[pp.Touch] = []

    def source() -> Iterator[tuple[float, np.ndarray]]:
        for i in range(40):
            if i == 3:
                time.sleep(0.3)
            yield 0.005 * i, full * (i >= 20)

    tracker = skin.track(baseline=12)

    def step(reading: np.ndarray, now: float) -> pp.Touch:
        found.append(tracker.step(reading, now))
        return found[-1]

    one = Session(skin, source, tracker, pp.GraspMonitor(), pace=True, step=step)
    one.run()
    assert one.behind > 0
    assert [int(t.status) for t in found].count(int(Status.CAPTURING_ZERO)) == 12
    assert not any(MOVED in t.notes for t in found)
    assert not any("the readings move" in text for text in one.past)
