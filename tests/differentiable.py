"""Skins and derivatives that the tests of PyTorch and of JAX share."""

from __future__ import annotations

from typing import Any

import numpy as np

import palpate as pp

PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.45)
#: Weight of the penalty: that of evidence for these contacts, to a factor of a few.
PARAMETER = 1e-4
#: Of the skins, the contact, whether it is constrained and its friction.
CASES = {
    "linear": (False, None),
    "pressing": (True, None),
    "within friction": (True, 0.5),
}


def skin(kind: str = "stress") -> pp.Skin:
    """Seven by six taxels of all three components; one of them is dead."""
    names = {
        "stress": ["stress_xz", "stress_yz", "stress_zz"],
        "mixed": ["displacement_x", "strain_zz", "stress_zz"],
    }
    mask = np.ones((6, 7), dtype=bool)
    mask[1, 2] = False
    noise = {"stress": [60.0, 60.0, 80.0], "mixed": [2e-7, 3e-4, 80.0]}
    array = pp.AreaArray(
        shape=(6, 7), pitch=1.5e-3, depth=1.5e-3, channels=names[kind], noise=noise[kind], mask=mask, aperture=0.8e-3
    )
    surface = pp.AreaGrid(shape=(8, 9), spacing=(1.5e-3, 1.5e-3))
    return pp.Skin(PAD, array, surface=surface, nuisance=())


def frames(of: pp.Skin, count: int, seed: int = 0) -> np.ndarray:
    """Readings (frame, channel, y, x) of balls that slide or stick, with noise; masked taxels NaN."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        ball = pp.solutions.hertz_point(
            contact_radius=float(rng.uniform(1e-3, 3e-3)), force=float(rng.uniform(0.3, 1.5))
        )
        ball = ball.partial_slip(0.5, 0.4 * ball.force[2], direction=float(rng.uniform(0, 6)))
        out.append(of.sense(ball.shifted(*rng.uniform(-1e-3, 1e-3, 2)), rng=rng))
    return np.stack(out)


def parameters(of: pp.Skin) -> dict[str, Any]:
    """All that may be varied, a little off what the skin says."""
    rng = np.random.default_rng(3)
    array = of.planes[0]
    shape = (len(array.channels), *array.shape)
    noise = np.asarray(array.noise_std)[:, None, None] * np.ones(shape)
    return {
        "modulus": np.array(1.07),
        "depth": np.array(0.96),
        "gains": 1.0 + 0.03 * rng.standard_normal(shape),
        "noise": noise * (1.0 + 0.05 * rng.random(shape)),
    }


def weights(shape: tuple[int, ...]) -> np.ndarray:
    """What a loss multiplies a traction or readings by."""
    return np.random.default_rng(9).standard_normal(shape)


def quotient(function: Any, at: Any, direction: np.ndarray, step: float) -> float:
    """The derivative of a function along a direction, by central differences of fourth order."""
    values = [float(function(at + k * step * direction)) for k in (-2, -1, 1, 2)]
    return (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
