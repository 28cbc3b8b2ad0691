"""Depth of the taxels and thickness of the layers, of which nobody says how well they are known."""

from __future__ import annotations

import numpy as np
import pytest

import palpate as pp
from palpate.bench.trust.rows import make_frame
from palpate.sensing.uncertainty import EXACT, GEOMETRY

GEL = ["displacement_x", "displacement_y", "displacement_z"]


def gel(height: float = 8e-3, *, count: int = 10, **known: float) -> pp.Skin:
    pad = pp.BondedLayers([pp.Layer(thickness=height, youngs_modulus=1e5, poissons_ratio=0.48)])
    array = pp.AreaArray(shape=(count, count), pitch=2e-3, depth=3e-3, channels=GEL)
    exact = {"youngs_modulus": 0.0, "thickness": 0.0, "depth": 0.0, "gain": 0.0, "scale": 0.0}
    return pp.Skin(pad, array, uncertainty=pp.Uncertainty(**(exact | known)))


def noisy(skin: pp.Skin, force: float = 2.0) -> np.ndarray:
    clean = np.asarray(skin.sense(pp.solutions.hertz_point(contact_radius=4e-3, force=force)))
    return clean + 0.01 * float(np.abs(clean).max()) * np.random.default_rng(0).standard_normal(clean.shape)


@pytest.mark.long
def test_thickness_widens_the_interval_by_what_it_does_to_the_force() -> None:
    """The half-width beside the method's own is ten times what forces found with a gel 1 % thicker and thinner differ by on
    either side. Farther off, the weight of discs changes.
    """
    readings = noisy(gel(count=14))
    of_method = gel(count=14).reconstruct(readings)
    touch = gel(count=14, thickness=0.1).reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    least, most = of_method.interval(0.95, "force")
    own = float(np.sqrt(((high[2] - low[2]) / 2) ** 2 - ((most[2] - least[2]) / 2) ** 2)) / 1.96
    found = [float(gel(h, count=14).reconstruct(readings).force[2]) for h in (7.92e-3, 8.08e-3)]
    assert own == pytest.approx(10.0 * (found[0] - found[1]) / 2, rel=0.15)
    assert touch._errors.pad.force[2] == pytest.approx(own, rel=1e-2)
    # the constants of the method neither scale it nor lean it to one side
    assert (high[2] + low[2]) / 2 == pytest.approx((most[2] + least[2]) / 2, rel=1e-9)


@pytest.mark.long
def test_what_nobody_says_of_depth_and_thickness_is_a_tenth() -> None:
    readings = noisy(gel())
    assumed = pp.Skin(gel().pad, gel().planes, uncertainty=pp.Uncertainty(youngs_modulus=0.0, gain=0.0, scale=0.0))
    stated = gel(thickness=GEOMETRY, depth=GEOMETRY)
    np.testing.assert_array_equal(
        assumed.reconstruct(readings)._errors.pad.force, stated.reconstruct(readings)._errors.pad.force
    )
    assert gel().reconstruct(readings)._errors.pad is None
    assert assumed.reconstruct(readings, method="tikhonov")._errors.pad is None  # which takes both as described


@pytest.mark.long
def test_markers_on_the_surface_are_there() -> None:
    pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48)
    array = pp.AreaArray(shape=(8, 8), pitch=2e-3, depth=0.0, channels=GEL)
    skin = pp.Skin(pad, array, uncertainty=pp.Uncertainty(gain=0.0))
    assert skin.reconstruct(noisy(skin))._errors.pad is None


@pytest.mark.parametrize("index", [8, 12])
@pytest.mark.long
def test_taxels_that_are_not_as_deep_as_said(index: int) -> None:
    """0.7 and 1.4 times; the second is on a glued gel, whose forces are most sensitive. Without the room both lie outside."""
    frame = make_frame("depth", index, seed=1009)
    touch = frame.skin.reconstruct(frame.readings)
    low, high = touch.interval(0.95, "force")
    half = 0.5 * (high[-1] - low[-1])
    assert low[-1] - 0.5 * half < frame.load.force[-1] < high[-1] + 0.5 * half
    sure = frame.described.skin(
        frame.noise, uncertainty={"youngs_modulus": 0.0, "thickness": 0.0, "depth": 0.0, "scale": 0.0}
    )
    low, high = sure.reconstruct(frame.readings).interval(0.95, "force")
    assert not low[-1] < frame.load.force[-1] < high[-1]


@pytest.mark.long
@pytest.mark.parametrize("thickness", [7.2e-3, 8.8e-3])
def test_pull_all_round_with_a_shift_against_it_explains_nothing(thickness: float) -> None:
    """A push of 2 N on a gel that is a tenth thicker or thinner than said read a pull of 140 to 300 N: even pull, which a glued gel hardly feels,
    and a shift of the picture against it leave the rest free to push and to pull."""
    true = gel(count=24)
    readings = noisy(true)
    pad = pp.BondedLayers([pp.Layer(thickness=thickness, youngs_modulus=1e5, poissons_ratio=0.48)])
    touch = pp.Skin(pad, true.planes).reconstruct(readings)
    low, high = touch.interval(0.95, "force")
    assert 1.0 < touch.force[2] < 3.5
    assert low[2] < 2.0 < high[2]


def test_exact_says_so_of_everything() -> None:
    assert not EXACT.any


@pytest.mark.parametrize("method", ["adaptive", "tikhonov"])
@pytest.mark.long
def test_taxels_just_above_the_base(method: str) -> None:
    """A depth 2 % larger lies below the base: the effect of a smaller one is taken. It was refused."""
    pad = pp.BondedLayers([pp.Layer(thickness=2e-3, youngs_modulus=1e5, poissons_ratio=0.48)])
    half = {}
    for depth in (1.95e-3, 1.99e-3):
        array = pp.AreaArray(shape=(5, 5), pitch=1.5e-3, depth=depth, channels=["stress_zz"], noise=50.0)
        skin = pp.Skin(pad, array, uncertainty=pp.Uncertainty(depth=0.1))
        readings = skin.sense(pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0))
        low, high = skin.reconstruct(readings, method=method).interval(0.95, "force")
        assert low[2] < 1.0 < high[2]
        half[depth] = high[2] - low[2]
    assert half[1.99e-3] == pytest.approx(half[1.95e-3], rel=0.2)
