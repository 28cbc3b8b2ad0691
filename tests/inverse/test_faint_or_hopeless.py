"""Frames near the noise are solved with a discrepancy beside it; frames that nothing explains cost few searches."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.bench.trust import make_frame
from palpate.elastic.pad import Floats
from palpate.inverse.contact import discrepancy, solving
from palpate.tracking.discrepancy import without_numbers

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
THREE = ["stress_xz", "stress_yz", "stress_zz"]


def taxels(count: int) -> pp.Skin:
    return pp.Skin(
        PAD, pp.AreaArray(shape=(count, count), pitch=1e-3, depth=1e-3, channels=THREE, noise=[20.0, 20.0, 20.0])
    )


def white(count: int, noise: float, seed: int, *frames: int) -> Floats:
    return np.asarray(noise * np.random.default_rng(seed).standard_normal((*frames, 3, count, count)))


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 3])
def test_a_discrepancy_need_not_explain_the_noise_too(seed: int) -> None:
    """Readings of twice the noise, which is 10 % more than given: half of them is noise, and no discrepancy is as large."""
    skin = taxels(16)
    press = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=2e-3, force=0.004)))
    touch = skin.reconstruct(press + white(16, 22.0, seed), zero=white(16, 20.0, 0, 30))
    assert pp.Status.coded(int(touch.status)) is pp.Status.SOLVED
    low, high = touch.interval(0.95, "force")
    assert low[2] < 0.004 < high[2]


@pytest.mark.long
def test_readings_that_nothing_explains_are_searched_few_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """A restart gives every taxel another zero: six levels of noise were searched, each slower than a contact."""
    searches = []
    search = discrepancy.search

    def counted(*args: Any) -> Any:
        searches.append(None)
        return search(*args)

    monkeypatch.setattr(discrepancy, "search", counted)
    skin = taxels(8)
    touch = skin.reconstruct(white(8, 280.0, 3), zero=white(8, 20.0, 0, 30))
    assert pp.Status.coded(int(touch.status)) is pp.Status.UNEXPLAINED
    assert len(searches) <= 3


def test_even_noise_shares_what_was_prepared() -> None:
    skin = taxels(4)
    problem = skin._problem
    assert problem.with_even_noise() is problem
    uneven = pp.Skin(
        PAD, pp.AreaArray(shape=(4, 4), pitch=1e-3, depth=1e-3, channels=THREE, noise=[20.0, 20.0, 30.0])
    )._problem
    assert uneven.with_even_noise() is not uneven


def test_an_unexplained_frame_without_error_bars_has_bounds() -> None:
    skin = taxels(4)
    with skin.track() as tracker:
        touch = tracker.step(white(4, 20.0, 1))
        bare = without_numbers(replace(touch, _errors=None), tracker.estimator, np.full(48, 5.0))
    assert np.isfinite(bare.force_bounds).all()
    assert (bare.force_bounds[:, 0] < 0.0).all()


def _restless(solving: Any, leading: object) -> bool:
    """A noise estimate that goes back and forth between states with and without one reading."""
    solving.observed = solving.observed.copy()
    solving.observed[-1] ^= True
    return True


@pytest.mark.parametrize(("step", "never_ends"), [("_outliers", lambda solving: True), ("_noise_changed", _restless)])
def test_a_contact_that_never_settles_is_a_contact(
    monkeypatch: pytest.MonkeyPatch, step: str, never_ends: Callable[..., bool]
) -> None:
    """The last attempt makes models, of the readings that it keeps. "No contact", and a ValueError, were the answers."""
    array = pp.AreaArray(shape=(5, 5), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=20.0)
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48), array)
    ball = pp.solutions.hertz_point(contact_radius=3e-3, force=1.0)
    readings = skin.sense(ball, rng=np.random.default_rng(0))
    monkeypatch.setattr(solving._Solving, step, never_ends)
    assert float(skin.reconstruct(readings).force[2]) == pytest.approx(1.0, rel=0.1)


def test_a_pressure_of_next_to_nothing_has_a_finite_center() -> None:
    """A model of this pull presses with 1e-310 N: the division by it overflowed."""
    frame = make_frame("pulling", 51, seed=20283030)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        touch = frame.skin.reconstruct(frame.readings)
    assert float(touch.force[2]) == pytest.approx(float(frame.load.force[2]), rel=0.2)
