"""A penalty that was learned while a reading was broken is learned again without that reading."""

from __future__ import annotations

import numpy as np

import palpate as pp
from palpate import simulation

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
ARRAY = pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"])


def test_a_reading_that_jumps_to_seven_times_the_largest_is_forgotten() -> None:
    # It was left out after four frames, and the penalty was learned with it: 4 to 15 N were read for 1 N, until the contact ended.
    skin, rng = pp.Skin(PAD, ARRAY), np.random.default_rng(5)
    story = list(simulation.stream(skin, simulation.handling(1.0, 0.4e-3), friction=0.6, radius=20e-3, rate=100.0))[
        ::2
    ][:110]
    clean = np.stack([np.asarray(f.readings) for f in story])
    largest = float(np.abs(clean).max())
    frames = clean + 0.01 * largest * rng.standard_normal(clean.shape)
    frames[40:, -1, 4, 4] = 0.0
    frames[80:, 0, 1, 1] = 7.0 * largest
    true = np.array([float(skin.surface.total_force(f.traction)[-1]) for f in story])
    with skin.track(baseline=15, friction=0.6) as tracker:
        touches = [tracker.step(frame) for frame in frames]
    found = np.array([float(t.force[-1]) for t in touches])
    assert np.abs(found[86:] / true[86:] - 1.0).max() < 0.1
    low, high = (np.array([float(t.interval(0.95, "force")[k][-1]) for t in touches[86:]]) for k in (0, 1))
    assert ((low <= true[86:]) & (true[86:] <= high)).all()
