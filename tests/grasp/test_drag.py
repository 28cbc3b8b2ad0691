"""Slip under noise: the readings know the drag that a penalty shrinks, and which part of a contact sticks."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate import solutions
from palpate.grasp import GraspMonitor
from palpate.inverse.drag import STICK, sheared

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.49)
FRICTION, NOISE, REST = 0.25, 0.03, 20
BALL = solutions.hertz_point(contact_radius=4e-3, force=1.0)


def test_shear_of_a_ball_that_is_dragged_is_cattaneos() -> None:
    """q = mu [p(r) - s p(r / s)], whose force is mu P (1 - s^3)."""
    x = (np.arange(81) - 40) * 0.1e-3
    r = np.hypot(x[:, None], x[None, :])
    pressure = np.sqrt(np.maximum(1.0 - (r / 3e-3) ** 2, 0.0))
    for s, q in zip(STICK, sheared(pressure, STICK)):
        inner = s * np.sqrt(np.maximum(1.0 - (r / max(s * 3e-3, 1e-9)) ** 2, 0.0))
        assert np.linalg.norm(q - (pressure - inner)) < 0.03 * np.linalg.norm(pressure)
        assert q.sum() / pressure.sum() == pytest.approx(1.0 - s**3, abs=0.02)


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.long
def test_a_ball_that_slips_at_a_friction_of_a_quarter_is_noticed_under_three_per_cent_of_noise(given: bool) -> None:
    """The net force of its shear reads 0.6 to 0.8 of the truth; a firm hold at 0.4 of the friction raises nothing."""
    skin = pp.Skin(
        PAD,
        pp.AreaArray(shape=(14, 14), pitch=1.2e-3, depth=1.6e-3, channels=["stress_xz", "stress_yz", "stress_zz"]),
    )
    rng = np.random.default_rng(0)
    firm = np.asarray(skin.sense(BALL.partial_slip(FRICTION, 0.4 * FRICTION)))
    slides = np.asarray(skin.sense(BALL.sliding(FRICTION)))
    size = NOISE * float(np.abs(slides).max())
    mu = FRICTION if given else None
    tracker, monitor = skin.track(friction=mu, baseline=REST), GraspMonitor(friction=mu)
    found: dict[str, list[float]] = {"firm": [], "slides": []}
    shrunk, sticking = [], np.zeros(len(STICK))
    stages = [("rest", np.zeros_like(firm), REST), ("firm", firm, 20), ("slides", slides, 30)]
    for stage, clean, count in stages:
        for _ in range(count):
            touch = tracker.step(clean + size * rng.standard_normal(clean.shape))
            monitor.update(touch)
            if stage == "rest":
                continue
            assert touch.drag is not None
            found[stage].append(float(np.linalg.norm(touch.drag)))
            if stage == "firm":
                assert "incipient slip" not in monitor.going_on()
            else:
                shrunk.append(float(np.hypot(*touch.force[:2]) / touch.force[2]))
                sticking += np.asarray(touch.sticking)
    assert "incipient slip" in monitor.going_on()
    assert np.mean(found["slides"]) == pytest.approx(FRICTION, rel=0.1)
    assert np.mean(found["firm"]) == pytest.approx(0.4 * FRICTION, rel=0.25)
    # the standard deviation that is stated is that of the frames
    assert touch.drag_std == pytest.approx(np.std(found["slides"]), rel=0.6)
    if given:
        assert np.mean(shrunk) < 0.9 * FRICTION
    assert STICK[int(np.argmax(sticking))] < 0.5


@pytest.mark.long
def test_pressure_alone_has_no_drag() -> None:
    array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=5.0)
    skin = pp.Skin(PAD, array)
    press = np.asarray(skin.sense(solutions.hertz_line(half_width=3e-3, force=10.0)))
    assert skin.track(components=["z"]).step(press).drag is None
    both = pp.Skin(PAD, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0))
    slides = np.asarray(both.sense(solutions.hertz_line(half_width=3e-3, force=10.0).sliding(0.3)))
    drag = both.track().step(slides).drag
    assert drag is not None
    assert float(drag[0]) == pytest.approx(0.3, abs=0.02)
