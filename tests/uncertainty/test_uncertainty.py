"""Gains of taxels of which nothing is said: a net force that few taxels carry is as uncertain as these are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import palpate as pp

Contact = Any

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
KNOWN = {"youngs_modulus": 0.0, "thickness": 0.0, "depth": 0.0, "scale": 0.0}


def line(**known: float) -> pp.Skin:
    array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=20.0)
    return pp.Skin(PAD, array, uncertainty=pp.Uncertainty(**(KNOWN | known)))


def area(**known: float) -> pp.Skin:
    array = pp.AreaArray(
        shape=(7, 7), pitch=2e-3, depth=2e-3, channels=["stress_xz", "stress_yz", "stress_zz"], noise=20.0
    )
    return pp.Skin(PAD, array, uncertainty=pp.Uncertainty(**(KNOWN | known)))


CASES = [
    (line, pp.solutions.hertz_line(half_width=2.5e-3, force=10.0)),
    (area, pp.solutions.hertz_point(contact_radius=3e-3, force=1.0)),
]


@pytest.mark.long
@pytest.mark.parametrize(("make", "contact"), CASES)
def test_room_for_gains_is_how_far_forces_scatter(make: Callable[..., pp.Skin], contact: Contact) -> None:
    """Sixty arrays whose gains spread by 5 %. On areas forces scatter up to twice as far: the contact's cells and weights, which the room takes
    as they are, change with the gains.
    """
    skin, rng = make(), np.random.default_rng(5)
    readings = np.asarray(skin.sense(contact))
    found = [
        np.asarray(skin.reconstruct(readings * (1.0 + 0.05 * rng.standard_normal(readings.shape))).force)
        for _ in range(60)
    ]
    said = np.asarray(skin.reconstruct(readings)._errors.pad.force)
    sought = said > 0
    assert sought[-1]
    ratio = np.std(found, axis=0)[sought] / said[sought]
    assert (ratio > 0.7).all()
    assert (ratio < 2.2).all()


@pytest.mark.parametrize(("make", "contact"), CASES)
def test_gains_that_are_stated_or_exact_need_no_room(make: Callable[..., pp.Skin], contact: Contact) -> None:
    readings = np.asarray(make().sense(contact))
    assert make(gain=0.0).reconstruct(readings)._errors.pad is None
    stated, assumed = (s.reconstruct(readings)._errors.pad for s in (make(gain=0.05), make()))
    # the same in the force, and where they are stated in all the rest
    np.testing.assert_allclose(stated.force, assumed.force, rtol=1e-6)
    assert stated.peak > 0
    assert assumed.peak == 0
