"""Small contacts under channels that sense far: few cells are solved for, and the single solve knows the zero's noise."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.elastic.pad import Floats
from palpate.tracking import Tracker
from palpate.tracking.single import SingleSolve

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
DISPLACED = ["displacement_x", "displacement_y", "displacement_z"]
NOISE = 1e-6
#: Unknowns whose matrix takes a quarter of a second to invert.
MANY = 1500
BALL = pp.solutions.hertz_point(contact_radius=1e-3, force=0.02)


def displaced(count: int) -> pp.Skin:
    array = pp.AreaArray(shape=(count, count), pitch=1e-3, depth=0.7e-3, channels=DISPLACED, noise=NOISE)
    return pp.Skin(PAD, array)


def noise(skin: pp.Skin, seed: int) -> Floats:
    shape = len(DISPLACED), *skin.planes[0].shape
    return np.asarray(NOISE * np.random.default_rng(seed).standard_normal(shape))


def unknowns(tracker: Tracker) -> int:
    cells = tracker._contact.cells
    return 0 if cells is None else len(DISPLACED) * len(cells)


def test_a_small_contact_among_displacements_is_sought_in_few_cells() -> None:
    """All of 32 x 32 cells score above half of the peak: 3072 unknowns were solved for."""
    skin = displaced(12)
    first = skin.sense(BALL.shifted(-2e-3, 0.0))
    tracker = skin.track()
    tracker._alone = None
    for seed in range(8):
        tracker.step(noise(skin, seed))
    touch = tracker.step(first + noise(skin, 8))
    assert unknowns(tracker) < MANY / 2
    assert float(touch.force[2]) == pytest.approx(0.02, rel=0.1)


@pytest.mark.long
def test_a_second_contact_among_displacements_adds_few_cells() -> None:
    """It scores on the whole surface: 3800 unknowns were solved for, in 9 s."""
    skin = displaced(16)
    first = skin.sense(BALL.shifted(-4e-3, 0.0))
    both = first + skin.sense(BALL.shifted(5e-3, 2e-3))
    tracker = skin.track()
    tracker._alone = None
    for seed in range(10):
        tracker.step(noise(skin, seed))
    largest = []
    for seed, frame in enumerate([first] * 9 + [both] * 4):
        touch = tracker.step(frame + noise(skin, 10 + seed))
        largest.append(unknowns(tracker))
    assert max(largest) < 1.2 * MANY
    assert float(touch.force[2]) == pytest.approx(0.04, rel=0.1)


def test_the_single_solve_knows_the_noise_of_the_zero() -> None:
    """Readings minus a zero of one frame have twice the variance of the noise that was given."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=20.0))
    press = skin.sense(pp.solutions.hertz_point(contact_radius=4e-3, force=0.05))
    rng = np.random.default_rng(1)
    readings = press + 20.0 * rng.standard_normal(press.shape) - 20.0 * rng.standard_normal(press.shape)
    solve = SingleSolve(skin, ("z",), None)
    assert float(solve([readings], [], 1.0).touch.fit) < 0.01
    assert float(solve([readings], [], 2.0**0.5).touch.fit) > 0.01
