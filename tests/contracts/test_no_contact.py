""" "No contact" is a claim: what would not be noticed is as wide as it is, between shallow taxels, and for pulls too."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)


def test_a_load_between_shallow_taxels_that_noise_hides_is_inside_the_interval() -> None:
    """3 x 3 taxels 0.46 pitches deep under a ball between four of them: "no contact" with 0.02 N at most, where there were 0.1 N.

    Nobody gave the noise, so that few readings cannot prove that nothing touches.
    """
    array = pp.AreaArray(shape=(3, 3), pitch=4.7e-3, depth=2.2e-3, channels=["stress_zz"])
    skin = pp.Skin(PAD, array)
    fine = pp.Skin(PAD, array, surface=pp.AreaGrid(shape=(36, 36), spacing=0.5e-3))
    clean = fine.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=0.1).shifted(2.35e-3, 2.35e-3))
    rng = np.random.default_rng(0)
    touch = skin.reconstruct(clean + 0.3 * np.abs(clean).max() * rng.standard_normal((20, *clean.shape)))
    low, high = touch.interval(0.95, of="force")
    empty = np.asarray(touch.status) == pp.Status.UNDECIDED
    assert empty.sum() >= 5  # else it shows nothing
    assert ((low[..., 2] <= 0.1) & (high[..., 2] >= 0.1))[empty].mean() >= 0.9


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_nothing_found_may_be_a_pull_as_well(sign: float) -> None:
    array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=100.0)
    skin = pp.Skin(PAD, array)
    touch = skin.reconstruct(sign * 30.0 * np.random.default_rng(1).standard_normal((1, 8, 8)))
    low, high = touch.interval(0.95, of="force")
    assert touch.status == pp.Status.NO_CONTACT
    assert low[2] == pytest.approx(-high[2])
    assert high[2] > 0.0


@pytest.mark.long
def test_an_empty_frame_stays_narrow_where_taxels_feel_every_place() -> None:
    """Twice what is one standard deviation of a patch as wide as the depth, whatever the array's size; not ten times.

    Wider only where the frame holds more than chance does nine times in ten: such a frame cannot be told from a faint touch.
    """
    array = pp.AreaArray(shape=(12, 12), pitch=2e-3, depth=4e-3, channels=["stress_zz"], noise=100.0)
    skin = pp.Skin(PAD, array)
    touch = skin.reconstruct(100.0 * np.random.default_rng(1).standard_normal((200, 1, 12, 12)))
    patch = pp.solutions.hertz_point(contact_radius=4e-3, force=1.0)
    least = 100.0 / np.linalg.norm(np.asarray(skin.sense(patch)))
    high = touch.interval(0.95, of="force")[1][..., 2]
    assert (high > 1.9 * least).all()
    assert np.mean(high < 6.0 * least) > 0.85


def test_strips_that_push_and_pull_alike_are_not_one_push_and_broken_taxels() -> None:
    """Three taxels in a row that read a pull were left out as broken, and the rest read 14 N/m where the net force is nothing."""
    array = pp.LineArray(count=16, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
    skin = pp.Skin(PAD, array)
    x = skin.surface.axes[0]
    traction = np.zeros((2, len(x)))
    traction[1] = 5e3 * (np.abs(x + 3e-3) <= 1.5e-3) - 5e3 * (np.abs(x - 3e-3) <= 1.5e-3)
    readings = skin.sense(traction)
    for seed in range(4):
        touch = skin.reconstruct(readings + 5.0 * np.random.default_rng(seed).standard_normal(readings.shape))
        low, high = touch.interval(0.95, of="force")
        assert low[1] < float(traction[1].sum()) * skin.surface.cell < high[1]
        assert any("does not explain" in note for note in touch.notes)
