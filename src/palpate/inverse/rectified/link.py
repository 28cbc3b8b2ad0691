"""From latent fields to traction: pressure is a rectified field, shear a part of friction times pressure."""

from __future__ import annotations

import numpy as np

from palpate.elastic.pad import Floats

__all__ = ["pressure", "traction"]


def pressure(f: Floats, rounding: float) -> tuple[Floats, Floats]:
    """The rectifier max(f, 0), rounded by a parabola over +-``rounding``, and its derivative."""
    v = np.clip(f / rounding, -1.0, 1.0)
    slope = 0.5 * (v + 1.0)
    return np.where(f > rounding, f, rounding * slope**2), slope


def traction(f: Floats, h: Floats, rounding: float, friction: float) -> tuple[Floats, Floats, Floats]:
    """Traction (component, cell), pressure last, and its derivatives by f (component, cell) and by h (direction, component, cell).

    p = max(f, 0);  q_j = p mu h_j / sqrt(1 + |h|^2), which stays inside the friction cone |q| <= mu p for any h.
    """
    p, slope = pressure(f, rounding)
    if not len(h):
        return p[None], slope[None], np.zeros((0, 1, len(f)))
    w = 1.0 / np.sqrt(1.0 + (h**2).sum(axis=0))
    ratio = friction * h * w
    by_f = np.concatenate([slope * ratio, slope[None]])
    by_h = np.zeros((len(h), len(h) + 1, len(f)))
    for j in range(len(h)):
        for i in range(len(h)):
            by_h[j, i] = friction * p * ((i == j) * w - w**3 * h[i] * h[j])
    return np.concatenate([p * ratio, p[None]]), by_f, by_h
