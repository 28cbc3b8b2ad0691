"""Channels that read nothing, and channels that are louder than the others."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.errors import NotObservable
from palpate.inverse.fit import misfit_probability, neighbours
from palpate.status import Status


@pytest.mark.parametrize("noise", [None, 1e-4])
def test_a_channel_that_reads_rounding_errors_tells_nothing(noise: float | None) -> None:
    """An incompressible layer is not strained along its normal where it is glued to its base."""
    layers = [pp.Layer(thickness=t, youngs_modulus=3e5, poissons_ratio=nu) for t, nu in ((2e-3, 0.48), (1e-3, 0.5))]
    array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth="base", channels=["strain_zz"], noise=noise)
    with pytest.raises(NotObservable):
        _ = pp.Skin(pp.BondedLayers(layers), array).components


def test_a_loud_channel_hides_no_order_of_a_quiet_one() -> None:
    array = pp.AreaArray(shape=(10, 10), pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"])
    pairs, channels = neighbours([array]), np.repeat([0, 1], 100)
    x, y = np.meshgrid(np.arange(10), np.arange(10))
    noise = np.random.default_rng(0).standard_normal((2, 100))
    noise[0] *= 300.0
    ordered = noise.copy()
    ordered[1] += 5.0 * np.exp(-0.1 * ((x - 5) ** 2 + (y - 5) ** 2)).ravel()
    all_used = np.ones(200, dtype=bool)

    def probability(residual: np.ndarray, index: np.ndarray | None) -> float:
        return misfit_probability(residual.ravel(), all_used, pairs, taken=0.0, known=False, channels=index)

    assert probability(noise, channels) > 0.05
    assert probability(ordered, None) > 0.05
    assert probability(ordered, channels) < 1e-6


@pytest.mark.long
def test_a_press_beside_a_channel_of_noise_is_not_no_contact() -> None:
    """The noise of each channel is not known, and one has thrice its largest reading."""
    pad = pp.HalfSpace(youngs_modulus=3e5, poissons_ratio=0.45)
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    skin = pp.Skin(pad, pp.AreaArray(shape=(14, 14), pitch=3e-3, depth=3e-3, channels=channels))
    readings = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=6e-3, force=1.5)))
    size = np.abs(readings).max(axis=(1, 2), keepdims=True) * np.array([3.0, 0.01, 0.01]).reshape(3, 1, 1)
    touch = skin.reconstruct(readings + size * np.random.default_rng(1).standard_normal(readings.shape))
    low, high = touch.interval(0.95, "force")
    assert Status.coded(int(touch.status)) is Status.UNDECIDED
    assert low[2] < 1.5 < high[2]
