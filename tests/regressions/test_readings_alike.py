"""Readings that are all alike, as a converter at rest, a placeholder or a shifted picture gives: offsets, found at once, and never an exception."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.bench.trust import make_frame

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
STRESSES = ["stress_xz", "stress_yz", "stress_zz"]
MOVES = ["displacement_x", "displacement_y", "displacement_z"]


@pytest.mark.parametrize("count", [4, 8, 12])
@pytest.mark.parametrize(("channels", "value"), [(STRESSES, 1e3), (MOVES, 1e-4)])
@pytest.mark.long
def test_readings_without_any_noise_that_are_all_alike_are_offsets(
    channels: list[str], value: float, count: int
) -> None:
    """What offsets left of them was divided by nothing: a load of 0.2 to 1.2 N, after 10 to 60 seconds, or an exception of linear algebra."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(count, count), pitch=2e-3, depth=2e-3, channels=channels))
    touch = skin.reconstruct(np.full((3, count, count), value))
    # an even press would read the same (not as displacements: the image may have moved), and 48 readings tell no noise
    alone = channels == MOVES and count > 4
    assert str(pp.Status.coded(touch.status)) == ("no contact" if alone else "undecided")
    assert not touch.touching
    assert touch.nuisance is not None
    assert touch.nuisance[:3] == pytest.approx([value] * 3, rel=1e-4)
    assert any("offset of stress_zz" in n or "shift along z" in n for n in touch.notes)


@pytest.mark.parametrize("value", [1e3, -1e3])
def test_one_channel_that_is_alike_may_be_an_even_load(value: float) -> None:
    """An even pressure and an offset read the same: the interval holds both, or the offset is named."""
    skin = pp.Skin(PAD, pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"]))
    touch = skin.reconstruct(np.full((1, 8, 8), value))
    assert any("offset" in n or "is uncertain" in n for n in touch.notes), touch.notes


@pytest.mark.long
def test_a_frame_whose_readings_are_all_at_the_largest_is_answered() -> None:
    """Displacements of 12 x 12 taxels with friction given: numbers overflowed, and least squares did not converge."""
    frame = make_frame("channel offsets", 7, seed=7741)
    given: dict[str, Any] = {} if frame.friction is None else {"friction": frame.friction}
    largest = float(np.abs(frame.readings).max())
    touch = frame.skin.reconstruct(np.full_like(frame.readings, largest), **given)
    assert np.abs(touch.force).max() == 0.0
    assert any("shift along" in n for n in touch.notes)
