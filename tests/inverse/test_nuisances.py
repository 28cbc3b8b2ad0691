"""Offsets and ramps beside contact: in any unit, named or not, and a pattern of one's own."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.sensing.uncertainty import EXACT

PAD = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)


def _array(count: int, pitch: float, *channels: str, noise: float = 10.0) -> pp.AreaArray:
    return pp.AreaArray(shape=(count, count), pitch=pitch, depth=1.5 * pitch, channels=channels, noise=noise)


def _sizes(touch: pp.Touch) -> dict[str, tuple[float, float]]:
    """Size and standard deviation of each nuisance by its label."""
    assert touch.nuisance is not None
    assert touch.nuisance_std is not None
    labels = (label for label, _ in touch.nuisance_names)
    return {label: (float(v), float(s)) for label, v, s in zip(labels, touch.nuisance, touch.nuisance_std)}


@pytest.mark.parametrize("length", [1e-3, 1.0])
def test_a_ramp_beside_an_offset_has_the_same_error_on_a_small_sensor(length: float) -> None:
    """On an array of 12 um the ramp had 1/200 of its standard deviation: Pa/m was compared with Pa."""
    skin = pp.Skin(PAD, _array(7, 2e-3 * length, "stress_zz"), uncertainty=EXACT)
    clean = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=4e-3 * length, force=0.5 * length**2)))
    peak = float(np.abs(clean).max())
    noise = 10.0 * np.random.default_rng(4).standard_normal(clean.shape)
    found = _sizes(skin.reconstruct(clean + noise + 0.25 * peak * np.linspace(0.0, 2.0, 7)))
    size, std = (length * value for value in found["ramp of stress_zz along x"])
    assert size == pytest.approx(0.25 * peak / 6e-3, rel=0.01)
    assert std == pytest.approx(2200.0, rel=0.1)
