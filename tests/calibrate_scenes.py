"""Presses of balls on a half-space by closed forms, and the sensor that they calibrate."""

from __future__ import annotations

import numpy as np

import palpate as pp

PITCH, DEPTH = 4e-3, 3e-3
PAD = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.48)


def taxels(depth: float = DEPTH) -> pp.AreaArray:
    return pp.AreaArray(shape=(4, 4), pitch=PITCH, depth=depth, channels=["stress_zz"])


def ball(force: float, x: float = 0.0, y: float = 0.0, *, radius: float = 2e-3, depth: float = DEPTH) -> np.ndarray:
    """Vertical stress (1, 4, 4) [Pa] under a Hertzian pressure on a half-space: s_zz = 3 P z^3 / (2 pi R^5) for each of 400 point loads (Boussinesq, 1885)."""
    n = 400
    share, turn = (np.arange(n) + 0.5) / n, np.arange(n) * np.pi * (3.0 - np.sqrt(5.0))
    away = radius * np.sqrt(
        1.0 - (1.0 - share) ** (2.0 / 3.0)
    )  # load within r of Hertz's pressure: 1 - (1 - r^2/a^2)^(3/2)
    at = np.stack([x + away * np.cos(turn), y + away * np.sin(turn)], axis=1)
    places = taxels().points
    squared = ((places[:, None] - at[None]) ** 2).sum(axis=-1) + depth**2
    return (3.0 * force / n * depth**3 / (2.0 * np.pi) * squared**-2.5).sum(axis=1).reshape(1, 4, 4)


def bench(
    count: int, seed: int, *, unit: float = 41.0, depth: float = 3.4e-3, gains: float = 0.1, noise: float = 0.01
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Readings (press, 1, 4, 4), forces, places of presses on a sensor whose depth and gains the skin does not know."""
    rng = np.random.default_rng(seed)
    gain = 1.0 + gains * np.random.default_rng(seed % 1000).normal(size=(1, 4, 4))
    force, place = rng.uniform(0.5, 5.0, count), rng.uniform(-5e-3, 5e-3, (count, 2))
    clean = np.stack(
        [ball(f, *p, radius=r, depth=depth) for f, p, r in zip(force, place, rng.choice([1e-3, 2e-3, 3e-3], count))]
    )
    noisy = gain * clean / unit
    return noisy * (1.0 + 0.0 * noise) + noise * np.abs(noisy).max() * rng.standard_normal(noisy.shape), force, place
