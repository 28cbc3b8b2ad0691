"""Constants of a pad from balls of known force at unknown places: how often the truth lies inside the 95 % intervals; pad models told apart.

    python benchmarks/constants.py --oracles FOLDER            # holds fem_layer_3d.npz
    python benchmarks/constants.py --oracles FOLDER --write    # docs/_generated/constants.md

The readings are closed forms of a half-space (`palpate.solutions`) or finite elements of a bonded layer (FOLDER): never the forward model that is fitted. Noise:
1 % of the largest reading. Truths are drawn from the spread that the fit assumes before the presses.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from palpate.calibrate.constants import PadConstants, fit_constants

GENERATED = Path(__file__).parents[1] / "docs" / "_generated" / "constants.md"
NOISE, PITCH, SHAPE = 0.01, 2e-3, (6, 6)
FORCES = (1.0, 2.0, 4.0)


def grid(shape: tuple[int, int] = SHAPE, pitch: float = PITCH) -> np.ndarray:
    return np.asarray(pp.AreaArray(shape=shape, pitch=pitch, depth=1e-3, channels=["stress_zz"]).points).reshape(-1, 2)


def noisy(readings: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    noise = NOISE * float(np.abs(readings).max())
    return readings + noise * rng.standard_normal(readings.shape), noise


def gel(rng: np.random.Generator, presses: int) -> tuple[PadConstants, dict[str, float], tuple[Any, ...]]:
    """A camera gel deep enough to be a half-space: in-plane displacement of markers; balls of 4, 6, 9 mm radius at unknown places."""
    std = rng.standard_normal(3) * [0.4, 0.2, 0.1]
    modulus, depth, scale = np.exp(std) * [1e5, 2e-3, 1.0]
    pad = pp.HalfSpace(youngs_modulus=modulus, poissons_ratio=0.48)
    points = grid() * scale
    radius = np.resize([4e-3, 6e-3, 9e-3], presses)
    force = np.resize(FORCES, presses)
    out = []
    for r, f in zip(radius, force):
        x, y = rng.uniform(-3e-3, 3e-3, 2)
        ball = pp.solutions.hertz_point(force=f, contact_radius=(0.75 * f * r * (1 - 0.48**2) / modulus) ** (1 / 3))
        out.append(ball.fields(pad, ["displacement_x", "displacement_y"], points[:, 0] - x, points[:, 1] - y, depth) / scale)
    readings, noise = noisy(np.stack(out).reshape(presses, 2, *SHAPE), rng)
    array = pp.AreaArray(shape=SHAPE, pitch=PITCH, depth=2e-3, channels=["displacement_x", "displacement_y"])
    skin = pp.Skin(pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.48), array)
    found = fit_constants(skin, readings, force, constants=["youngs_modulus", "depth", "pixel_scale"], noise=noise, ball_radius=radius)
    return found, {"youngs_modulus": modulus, "depth": depth, "pixel_scale": scale}, ()


if __name__ == "__main__":
    import time
    t = time.time()
    for n in (3, 6, 20):
        hits = []
        for s in range(20):
            found, truth, _ = gel(np.random.default_rng(s), n)
            z = [(np.log(truth[k]) - np.log(v)) / sd for k, v, sd in zip(found.names, found.values, found.std)]
            hits.append(z)
        z = np.array(hits)
        print(n, found.names, (np.abs(z) < 1.96).mean(0), z.std(0), z.mean(0), found.std, time.time() - t)
        print(found)
