"""The picture of `palpate pad`: what a pad lets through, drawn as it is."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.pads import plot_response

pytest.importorskip("matplotlib")


@pytest.mark.parametrize(("channel", "unit"), [("stress_zz", "Pa per Pa"), ("displacement_z", "m per Pa")])
def test_short_waves_fall_exponentially_with_depth_and_the_axis_has_a_unit(channel: str, unit: str) -> None:
    """A half-space damps a wave by exp(-k d), and no curve levels off where it leaves the axis."""
    depth = 4e-3
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    figure = plot_response(pad, [pp.LineArray(count=21, pitch=1e-3, depth=depth, channels=[channel])])
    (axes,) = [a for a in figure.axes if a.get_visible()]
    assert unit in axes.get_ylabel()
    assert "mm" in axes.get_xlabel()
    for curve in axes.get_lines():
        x, y = np.asarray(curve.get_xdata()) * 1e-3, np.asarray(curve.get_ydata())
        short = x < 1.2e-3
        slope = np.diff(np.log(y[short])) / np.diff(2 * np.pi / x[short])
        np.testing.assert_allclose(slope, -depth, rtol=0.15)
    low, high = axes.get_ylim()
    assert 1e-7 < low / high < 1e-5
