"""A contact that is twisted until it slips, and the margin of every cell."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate import simulation, solutions
from palpate.simulation import Stage

MU = 0.6
SKIN = pp.Skin(
    pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48),
    pp.AreaArray(shape=(12, 12), pitch=1e-3, depth=1.5e-3, channels=["stress_xz", "stress_yz", "stress_zz"]),
)


def touched(shear: Any) -> pp.Touch:
    """A ball's pressure with (x, y) shear from pressure and offsets from its centre, as it is, without noise."""
    traction = np.asarray(SKIN.sample(solutions.hertz_point(contact_radius=2.5e-3, force=1.0)))
    grid = SKIN.surface
    x, y = np.meshgrid(np.asarray(grid.x), np.asarray(grid.y))
    traction[0], traction[1] = shear(traction[2], x, y, np.maximum(np.hypot(x, y), 1e-12))
    return pp.Touch(traction, grid, ("x", "y", "z"), "tikhonov", resolution=np.asarray(0.05e-3))


@pytest.mark.parametrize("part", [0.3, 1.0, -1.0])
def test_a_contact_that_turns_uses_its_friction_up(part: float) -> None:
    """q = part mu p across the arm: M / int p r dA is |part| mu, and no net force says so."""
    touch = touched(lambda p, x, y, r: (-part * MU * p * y / r, part * MU * p * x / r))
    monitor = pp.GraspMonitor(friction=MU)
    monitor.update(touch)
    assert monitor.state is not None
    assert monitor.state.twist == pytest.approx(abs(part) * MU, rel=0.03)
    assert monitor.state.utilisation == pytest.approx(abs(part), abs=0.04)
    assert monitor.state.utilisation_map is not None
    assert np.nanmedian(monitor.state.utilisation_map) == pytest.approx(abs(part), abs=0.02)


def test_force_and_moment_share_the_friction() -> None:
    """Of the limit's ellipse: 0.6 of the force and 0.8 of the moment are all there is."""
    touch = touched(lambda p, x, y, r: (MU * p * (0.6 - 0.8 * y / r), MU * p * 0.8 * x / r))
    monitor = pp.GraspMonitor(friction=MU)
    monitor.update(touch)
    assert monitor.state is not None
    assert monitor.state.utilisation == pytest.approx(1.0, abs=0.04)


def test_utilisation_tells_the_rim_that_slips_from_the_middle_that_sticks() -> None:
    def shear(p: Any, x: Any, y: Any, r: Any) -> tuple[Any, Any]:
        return np.where(r > 1.2e-3, MU, 0.2 * MU) * p, np.zeros_like(p)

    monitor = pp.GraspMonitor(friction=MU)
    touch = touched(shear)
    monitor.update(touch)
    assert monitor.state is not None
    used = monitor.state.utilisation_map
    assert used is not None
    values = np.asarray(touch.values)
    slips = values[0] > 0.9 * MU * values[2]
    contact = values[2] > 0.1 * values[2].max()
    np.testing.assert_allclose(used[contact & slips], 1.0, atol=1e-9)
    np.testing.assert_allclose(used[contact & ~slips], 0.2, atol=1e-9)
    assert np.isnan(used[~contact]).all()


def test_a_line_has_no_twist() -> None:
    values = np.array([[0.0, 100.0, 0.0], [0.0, 1000.0, 0.0]])
    monitor = pp.GraspMonitor(friction=0.5)
    monitor.update(pp.Touch(values, pp.LineGrid(count=3, spacing=1e-3), ("x", "z"), "tikhonov"))
    assert monitor.state is not None
    assert math.isnan(monitor.state.twist)
    assert monitor.state.utilisation == pytest.approx(0.2)


@pytest.mark.parametrize(("full", "slips"), [(1.0, True), pytest.param(0.7, False, marks=pytest.mark.long)])
def test_full_twist_is_said_to_slip(full: float, slips: bool) -> None:
    """A ball at 1 % noise that is turned without being dragged."""
    stages = [Stage("rest", 0.4, 0.0), Stage("press", 0.2, 1.2), Stage("turn", 0.3, 1.2, twist=full)]
    stages += [Stage("turned", 0.3, 1.2, twist=full)]
    frames = list(simulation.stream(SKIN, stages, friction=MU, radius=15e-3, rate=50.0))
    size = 0.01 * max(float(np.abs(np.asarray(f.readings)).max()) for f in frames)
    rng = np.random.default_rng(0)
    tracker, monitor = SKIN.track(friction=MU, baseline=15, rate=50.0), pp.GraspMonitor(friction=MU)
    for frame in frames:
        monitor.update(tracker.step(frame.readings + size * rng.standard_normal((3, 12, 12)), frame.time))
    assert any(e.kind == "slip" for e in monitor.events) is slips
    assert any(e.kind == "incipient slip" for e in monitor.events) is slips
