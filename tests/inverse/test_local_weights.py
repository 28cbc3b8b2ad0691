"""Local weights on few readings: each round learns from the gradients of the one before, and less and less of the contact was left."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp

PAD = pp.HalfSpace(youngs_modulus=6e4, poissons_ratio=0.48)


@pytest.mark.long
@pytest.mark.parametrize("given", [True, False])
def test_contact_between_few_shallow_taxels_is_not_shrunk(given: bool) -> None:
    plain = pp.AreaArray(shape=(4, 4), pitch=3.5e-3, depth=2.4e-3, channels=["stress_zz"])
    contact = pp.solutions.hertz_point(contact_radius=4e-3, force=0.17).shifted(-1e-3, 2e-3)
    clean = pp.Skin(PAD, plain).sense(contact)
    std = 0.05 * float(np.abs(clean).max())
    array = pp.AreaArray(shape=(4, 4), pitch=3.5e-3, depth=2.4e-3, channels=["stress_zz"], noise=std if given else None)
    touch = pp.Skin(PAD, array).reconstruct(clean + std * np.random.default_rng(0).standard_normal((8, *clean.shape)))
    force = np.asarray(touch.force)[:, 2] / 0.17
    low, high = (np.asarray(side)[:, 2] / 0.17 for side in touch.interval(0.95, "force"))
    # before: 0.59 to 0.99, one interval of eight held the truth, and the misfit was one in ten thousand or less
    assert abs(force.mean() - 1.0) < 0.05
    assert np.abs(force - 1.0).max() < 0.14  # 0.869 to 1.04 of exact readings
    assert np.count_nonzero((low < 1.0) & (high > 1.0)) >= 7
    assert np.median(touch.fit) > 0.02
