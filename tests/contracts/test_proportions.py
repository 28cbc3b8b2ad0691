"""Lengths and noise out of all proportion are named with their ratio before any work; what lies within is served."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.errors import InvalidInput
from palpate.inverse.contact.adaptive import AdaptiveEstimator

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
CHANNELS = ("stress_xz", "stress_yz", "stress_zz")


def array(**changed: Any) -> pp.AreaArray:
    return pp.AreaArray(
        **{"shape": (6, 6), "pitch": 1e-3, "depth": 1e-3, "channels": CHANNELS, "noise": 100.0, **changed}
    )


def film(thickness: float) -> pp.Skin:
    layers = [pp.Layer(thickness=thickness, youngs_modulus=2e5, poissons_ratio=0.48)]
    return pp.Skin(pp.BondedLayers(layers), array(depth="base", channels=["stress_zz"]))


READINGS = np.full((3, 6, 6), 1e3)
CONTACT = pp.solutions.hertz_point(contact_radius=2e-3, force=0.5)
REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "aperture": (lambda: array(aperture=0.1), "aperture = 0.1 m is 20 times the array's extent of 0.005 m"),
    "correlation of noise": (lambda: array(noise_correlation=1e300), "2e+302 times the array's extent"),
    "thickness of a nanometre": (lambda: film(1e-9), "1e-09 m thick, 1e-06 of the pitch"),
    "thickness of a micrometre": (lambda: film(1e-6), "0.001 of the pitch"),
    "depth": (lambda: pp.Skin(PAD, array(depth=0.1)).prepare(method="tikhonov"), "depth = 0.1 m is 20 times"),
    "depth of many": (
        lambda: pp.Skin(PAD, array(shape=(32, 32), depth=0.128)).prepare(method="tikhonov"),
        "is 4.13 times the array's extent",
    ),
    "contact wider than rooms": (
        lambda: pp.Skin(PAD, array()).sense(pp.solutions.hertz_point(contact_radius=1.0, force=1.0)),
        "2e+03 times the surface's cells",
    ),
    "pitch of an atom": (lambda: pp.Skin(PAD, array(pitch=1e-12)).sense(CONTACT), "times the surface's cells"),
    "noise below rounding": (
        lambda: pp.Skin(PAD, array(noise=1e-12)).reconstruct(READINGS),
        "1e+15 times less than its readings",
    ),
    "noise that underflows": (lambda: array(noise=1e-300), "positive standard deviation"),
    "noise that overflows": (lambda: array(noise=1e300), "positive standard deviation"),
    "surface beside the array": (
        lambda: pp.Skin(
            PAD, array(), surface=pp.AreaGrid(shape=(10, 10), spacing=1e-3, center=(0.02, 0.0))
        ).reconstruct(READINGS),
        "the surface lies beside the array: its cells go from x = 0.0155 to 0.0245 m",
    ),
    "radius that underflows": (
        lambda: pp.solutions.hertz_point(contact_radius=1e-300, force=1.0),
        "positive, finite number",
    ),
    "contact nowhere": (lambda: CONTACT.shifted(np.nan, 0.0), "x must be a finite number"),
    "contact on a line nowhere": (
        lambda: pp.solutions.hertz_line(half_width=1e-3, force=1.0).shifted(np.inf),
        "center must be a finite number",
    ),
    "friction in words": (lambda: CONTACT.sliding("0.3"), "friction must be a finite number"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("name", list(REFUSED))
def test_what_is_out_of_proportion_is_refused_with_the_ratio(name: str) -> None:
    make, words = REFUSED[name]
    with pytest.raises(InvalidInput) as said:
        make()
    assert words in str(said.value)


def test_what_lies_within_is_served() -> None:
    """A deep array, a wide aperture, a thin film: seconds before, and now."""
    deep = pp.Skin(PAD, array(depth=0.024, channels=["stress_zz"], noise=None))
    assert np.isfinite(deep.reconstruct(READINGS[2:], method="tikhonov").force).all()
    pp.Skin(PAD, array(aperture=8e-3))
    assert film(2e-4).sense(CONTACT).max() > 0


@pytest.mark.parametrize(
    "noise", [100, np.float32(100), np.int64(100), np.array(100.0), [100.0] * 3, np.full(3, 100, dtype=np.float32)]
)
def test_noise_is_a_number_of_any_kind(noise: Any) -> None:
    assert array(noise=noise).noise_std == (100.0, 100.0, 100.0)


@pytest.mark.parametrize(
    "noise",
    ["5", True, ["a", "b", "c"], [None, 1, 1], [1, [2], 3], [1, 2], np.nan, np.ma.array([1, 2, 3], mask=[0, 1, 0])],
)
def test_noise_that_is_no_number_is_refused(noise: Any) -> None:
    with pytest.raises(InvalidInput, match="noise must be"):
        array(noise=noise)


@pytest.mark.long
def test_finer_cells_are_bounded_by_the_readings(monkeypatch: pytest.MonkeyPatch) -> None:
    """108 readings whose noise is stated ten times too small asked for 3672 unknowns, and took ten seconds."""
    unknowns, ratio = [], AdaptiveEstimator._ratio

    def watched(self: Any, places: float, freedom: float, count: int, joined: bool) -> int:
        found = ratio(self, places, freedom, count, joined=joined)
        unknowns.append(count * found**2)
        return found

    monkeypatch.setattr(AdaptiveEstimator, "_ratio", watched)
    skin, known = pp.Skin(PAD, array(noise=10.0)), pp.Skin(PAD, array())
    ball = pp.solutions.hertz_point(contact_radius=4e-3, force=0.5)
    readings = known.sense(ball, rng=np.random.default_rng(0))
    found = skin.reconstruct(readings)
    low, high = (side[2] for side in found.interval(0.95, "force"))
    assert low <= 0.5 <= high
    assert 0 < max(unknowns) <= 24 * 108
    assert float(found.force[2]) == pytest.approx(0.5, rel=0.15)
