"""Numbers that users give: truth values are none, NumPy's are, and a friction that no surface has is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import palpate as pp
from palpate.cli.options import suspicious_units
from skin_files import skin_text

HOW: dict[str, Any] = {
    "shape": (4, 4),
    "pitch": 1e-3,
    "depth": 1e-3,
    "channels": ["stress_xz", "stress_yz", "stress_zz"],
}
PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)
SKIN = pp.Skin(PAD, pp.AreaArray(**HOW, noise=100.0))
TAKES: dict[str, Callable[[Any], Any]] = {
    "noise": lambda v: pp.AreaArray(**HOW, noise=v),
    "noise of each channel": lambda v: pp.AreaArray(**HOW, noise=[50.0, 50.0, v]),
    "noise of scattered taxels": lambda v: pp.ScatteredArray(
        positions=[[0, 0], [1, 0], [0, 1]], depth=0.0, channels=["stress_zz"], noise=v
    ),
    "pitch": lambda v: pp.AreaArray(**{**HOW, "pitch": v}),
    "aperture": lambda v: pp.AreaArray(shape=(3, 3), pitch=1.0, depth=1.0, channels=["stress_zz"], aperture=v),
    "Young's modulus": lambda v: pp.HalfSpace(youngs_modulus=v, poissons_ratio=0.3),
    "thickness": lambda v: pp.Layer(thickness=v, youngs_modulus=1e5, poissons_ratio=0.3),
    "force": lambda v: pp.solutions.flat_punch(radius=1e-3, force=v),
    "friction": lambda v: pp.Adaptive(friction=v),
}


@pytest.mark.parametrize("what", TAKES)
@pytest.mark.parametrize("value", [True, np.True_, "1", float("nan"), [True]])
def test_a_truth_value_is_no_number(what: str, value: Any) -> None:
    with pytest.raises(pp.InvalidInput):
        TAKES[what](value)


@pytest.mark.parametrize("what", TAKES)
@pytest.mark.parametrize("kind", [float, np.float64, np.float32, np.int64])
def test_a_number_of_numpy_is_a_number(what: str, kind: Any) -> None:
    TAKES[what](kind(1))


@pytest.mark.long
def test_friction_that_no_surface_has_is_refused_and_its_remedy_reads_the_force() -> None:
    readings = SKIN.sense(pp.solutions.hertz_point(contact_radius=1.2e-3, force=0.5), rng=np.random.default_rng(0))
    for friction in (10.5, 1e4, 1e12):
        for ask in (
            lambda mu: SKIN.reconstruct(readings, friction=mu),
            lambda mu: SKIN.reconstruct(readings, friction=mu, method="constrained"),
            lambda mu: SKIN.track(friction=mu),
        ):
            with pytest.raises(pp.InvalidInput, match=r"no coefficient of friction.*leave friction out"):
                ask(friction)
    for touch in (SKIN.reconstruct(readings), SKIN.reconstruct(readings, friction=10.0)):
        low, high = touch.interval(0.95, "force")
        assert low[2] < 0.5 < high[2]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"pitch": "5 m"}, "15 m: is the unit of pitch"),
        ({"modulus": "200 GPa"}, "200 GPa, as metal has: is the unit of youngs_modulus"),
        ({}, ""),
    ],
)
def test_a_slip_of_a_unit_in_a_skin_file_is_doubted(given: dict[str, str], said: str, tmp_path: Path) -> None:
    """Metres for millimetres made 2 MN of 2 N, without a word."""
    file = tmp_path / "skin.toml"
    file.write_text(skin_text(4, 4, **{"pitch": "5 mm", "depth": "1 mm", **given}))
    doubts = suspicious_units(pp.Skin.from_file(file))
    assert len(doubts) == bool(said)
    assert said in "".join(doubts)
