"""Noise that was given and is small: cells of the surface are too coarse to explain the readings so closely, finer ones are not."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.elastic.pad import Floats
from palpate.sensing.uncertainty import EXACT

PAD = pp.HalfSpace(youngs_modulus=4e5, poissons_ratio=0.48)
FINE = pp.AreaGrid(shape=(100, 100), spacing=0.1e-3)


def _array(*, noise: float | None = None, depth: float = 1.1e-3) -> pp.AreaArray:
    return pp.AreaArray(shape=(8, 8), pitch=1e-3, depth=depth, channels=["stress_zz"], noise=noise)


def _tilted_block() -> tuple[Floats, float, float]:
    """Readings of a block that rests on one edge, with noise of 2e-4 of the largest, the noise, and the force."""
    y, x = FINE.axes
    pressure = np.where(np.abs(x) < 1.9e-3, 1e4 * (1.0 + x / 1.9e-3), 0.0)[None] * (np.abs(y) < 1.4e-3)[:, None]
    clean = np.asarray(pp.Skin(PAD, _array(), surface=FINE).sense(np.stack([0.0 * pressure, 0.0 * pressure, pressure])))
    std = 2e-4 * float(np.abs(clean).max())
    noise = std * np.random.default_rng(1).standard_normal(clean.shape)
    return clean + noise, std, float(pressure.sum() * FINE.cell)


def _interval(touch: pp.Touch, force: float) -> tuple[float, float]:
    low, high = (float(np.asarray(side)[2]) / force for side in touch.interval(0.95, "force"))
    return low, high


def test_small_noise_that_was_given_is_believed() -> None:
    readings, std, force = _tilted_block()
    touch = pp.Skin(PAD, _array(noise=std), uncertainty=EXACT).reconstruct(readings)
    low, high = _interval(touch, force)
    # before: "the model does not explain the readings", and 0.973 to 1.015
    assert touch.fit > 0.01
    assert low < 1.0 < high
    assert high - low < 0.01
    assert not np.asarray(touch.outliers).any()


def test_a_dead_taxel_is_found_in_small_noise_and_no_other() -> None:
    readings, std, force = _tilted_block()
    readings[0, 3, 4] = 0.0
    touch = pp.Skin(PAD, _array(noise=std)).reconstruct(readings)
    low, high = _interval(touch, force)
    assert low < 1.0 < high
    assert touch.fit > 0.01
    assert np.flatnonzero(np.asarray(touch.outliers)).tolist() == [3 * 8 + 4]


@pytest.mark.long
def test_what_finer_cells_do_not_explain_either_is_said() -> None:
    readings, std, _ = _tilted_block()
    touch = pp.Skin(PAD, _array(noise=std, depth=1.5e-3)).reconstruct(readings)
    assert touch.fit < 0.01 or any("a wrong pad or unit?" in note for note in touch.notes)
