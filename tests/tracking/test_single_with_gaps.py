"""Single solves of frames in which readings are missing or saturated, which the tracker compares its answer with."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import palpate as pp
from palpate.sensing.uncertainty import EXACT
from palpate.tracking.single import SingleSolve

THREE = ["stress_xz", "stress_yz", "stress_zz"]
PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
BALL = pp.solutions.hertz_point(contact_radius=1.6e-3, force=1.0)


def sensed(n: int, noise: float = 0.01, seed: int = 0) -> tuple[pp.Skin, np.ndarray, np.ndarray]:
    """A skin, frames at rest, and frames of a ball that presses and stays."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(n, n), pitch=1e-3, depth=1e-3, channels=THREE), uncertainty=EXACT)
    rng = np.random.default_rng(seed)
    ball = np.asarray(skin.sense(BALL))
    frames = np.concatenate([np.zeros(20), np.arange(1, 7) / 6, np.ones(30)])[:, None, None, None] * ball
    frames = frames + noise * np.abs(ball).max() * rng.standard_normal(frames.shape)
    return skin, frames[:20], frames[20:]


def errors(skin: pp.Skin, rest: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, list[pp.Touch]]:
    """Relative errors of the normal force of the last 20 frames of a stream."""
    tracker = skin.track(baseline=20)
    touches = [tracker.step(frame) for frame in np.concatenate([rest, frames])][-20:]
    return np.array([float(t.force[2]) - 1.0 for t in touches]), touches


def test_a_single_solve_leaves_missing_readings_out_as_a_masked_array_does() -> None:
    skin, rest, frames = sensed(6)
    reading = frames[-1] - rest.mean(axis=0)
    reading[:, 2, 3] = math.nan
    working = np.ones((6, 6), dtype=bool)
    working[2, 3] = False
    none = [list(f[None]) for f in rest - rest.mean(axis=0)]
    gaps = SingleSolve(skin, ("x", "y", "z"), None)([reading], none).touch
    masked = SingleSolve(skin.masked(working), ("x", "y", "z"), None)([reading], none).touch
    assert float(gaps.force[2]) == pytest.approx(float(masked.force[2]), rel=0.02)
    assert float(gaps.force[2]) == pytest.approx(1.0, rel=0.05)
    assert np.asarray(gaps.outliers).sum() == 3


def test_missing_readings_are_refused_by_a_skin_of_the_user() -> None:
    skin, rest, frames = sensed(4)
    frames[-1, 0, 0, 0] = math.nan
    with pytest.raises(pp.InvalidInput, match="missing or not finite"):
        skin.reconstruct(frames[-1], zero=rest)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_contact_that_begins_on_a_dead_taxel_is_answered_as_well_as_another(seed: int) -> None:
    """The tracker's own model, which answered such contacts, reads them 33 to 48 % too high."""
    skin, rest, frames = sensed(6, noise=0.02, seed=seed)
    frames[:, :, 2, 3] = math.nan
    off, touches = errors(skin, rest, frames)
    assert np.abs(off).max() < 0.1
    low, high = (
        np.array([float(end[2]) for end in ends]) for ends in zip(*(t.interval(0.95, "force") for t in touches))
    )
    assert ((low < 1.0) & (high > 1.0)).all()


@pytest.mark.long
@pytest.mark.parametrize(("radius", "x", "y"), [(0.5e-3, 0.9e-3, 0.9e-3), (0.6e-3, 0.8e-3, 0.6e-3)])
def test_a_stream_at_the_end_of_its_range_is_not_read_many_times_too_high(radius: float, x: float, y: float) -> None:
    """Two or four of nine pressures end at 70 % of the largest; the tracker's own model makes 11 N of the first ball of 1 N."""
    pad = pp.BondedLayers([pp.Layer(thickness=2.4e-3, youngs_modulus=7e5, poissons_ratio=0.5)])
    array = pp.AreaArray(shape=(3, 3), pitch=1.9e-3, depth="base", channels=THREE)
    ball = np.asarray(
        pp.Skin(pad, array).sense(pp.solutions.hertz_point(contact_radius=radius, force=1.0).shifted(x, y))
    )
    level = 0.7 * float(np.abs(ball).max())
    skin = pp.Skin(pad, replace(array, limits=level, noise=0.02 * level), uncertainty=EXACT)
    steps = np.concatenate([np.zeros(20), np.arange(1, 7) / 6, np.ones(30)])[:, None, None, None]
    largest = []
    for seed in range(3):
        noise = 0.02 * level * np.random.default_rng(seed).standard_normal((len(steps), *ball.shape))
        frames = np.clip(steps * ball + noise, -level, level)
        off, touches = errors(skin, frames[:20], frames[20:])
        largest.append(float(np.abs(off).max()))
        assert {pp.Status.coded(int(t.status)) for t in touches} == {pp.Status.OVERLOAD}
        assert all(np.isinf(float(t.interval(0.95, "force")[1][2])) for t in touches)
    assert np.median(largest) < 0.75
    assert max(largest) < 1.5
