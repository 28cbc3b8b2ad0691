"""The paper's numbers, loads, data and measure of error.

The paper states neither the half-width a, nor the load P, nor the amount eps that it adds to a, nor the friction coefficient mu.
a = 3.5, P = 0.678 and eps = 0.068, added to a in both profiles as the paper says, give both printed strain errors without
friction to three digits, and are the only values that also keep to the axes of its figures (`studies.profile_readings`).
mu = 0.433 gives the printed tangential strain error under one reading of its algorithm (`studies.friction_readings`). All four
are fits, not recoveries.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import Floats
from palpate.sensing.arrays import LineArray
from palpate.sensing.operator import sampled_kernel

__all__ = [
    "CASES",
    "PAPER_ERRORS",
    "array",
    "cylinder",
    "data",
    "mean_error",
    "punch",
    "sliding_punch",
]

#: The paper's material: E = 1, ν = 0.5.
PAD = HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
#: Of the sensors, as the paper gives them: how deep, how far apart, how many.
DEPTH, PITCH, SENSORS = 1.5, 0.5, 121
#: Values that the paper does not state and that follow from its errors and axes: half-width, load, increment of the half-width, friction.
HALF_WIDTH, LOAD, EPS, FRICTION = 3.5, 0.678, 0.068, 0.433

#: Mean absolute errors that the paper prints, (case, component, channel) -> text; "?" is an exponent that cannot be read.
PAPER_ERRORS = {
    ("cylinder", "vertical", "stress_zz"): "3.93e-6",
    ("cylinder", "vertical", "strain_zz"): "4.04e-5",
    ("punch", "vertical", "stress_zz"): "4.44e-6",
    ("punch", "vertical", "strain_zz"): "1.06e-4",
    ("punch with friction", "vertical", "stress_zz"): "6.21e-?",
    ("punch with friction", "vertical", "strain_zz"): "1.15e-3",
    ("punch with friction", "tangential", "stress_zz"): "2.95e-?",
    ("punch with friction", "tangential", "strain_zz"): "1.45e-3",
}


def cylinder(x: Floats, *, half_width: float = HALF_WIDTH, load: float = LOAD, eps: float = EPS) -> Floats:
    """Traction (q_x, p) under a cylinder: Hertz pressure 2P/(pi a^2) sqrt(a^2 - x^2) on |x| <= a, ``eps`` added to a in it."""
    a = half_width + eps
    p = 2 * load / (math.pi * a**2) * np.sqrt(np.maximum(a**2 - x**2, 0.0))
    return np.stack([np.zeros_like(x), np.where(_inside(x, half_width), p, 0.0)])


def punch(x: Floats, *, half_width: float = HALF_WIDTH, load: float = LOAD, eps: float = EPS) -> Floats:
    """Traction (q_x, p) under the rectangle: P/(pi sqrt(a^2 - x^2)) on |x| <= a, ``eps`` added to a keeps its edge finite."""
    root = np.sqrt(np.maximum((half_width + eps) ** 2 - x**2, 1e-300))
    return np.stack([np.zeros_like(x), np.where(_inside(x, half_width), load / (math.pi * root), 0.0)])


def sliding_punch(x: Floats, *, friction: float = FRICTION) -> Floats:
    """Traction (q_x, p): the rectangle with a constant shear mu/(2M) sum F under it (equation 22 with 2a = 2M samples)."""
    out = punch(x)
    out[0] = np.where(_inside(x, HALF_WIDTH), friction * out[1].sum() * PITCH / (2 * HALF_WIDTH), 0.0)
    return out


def _inside(x: Floats, half_width: float) -> Floats:
    return np.asarray(np.abs(x) <= half_width + 1e-9)


#: The contacts of the paper without friction, by name: positions to pressure.
CASES: dict[str, Callable[[Floats], Floats]] = {
    "cylinder": cylinder,
    "punch": punch,
    "punch with friction": sliding_punch,
}


def array(channels: Sequence[str], count: int = SENSORS) -> LineArray:
    """The paper's array with ``count`` sensors."""
    return LineArray(count=count, pitch=PITCH, depth=DEPTH, channels=list(channels))


def sense(traction: Floats, channel: str) -> Floats:
    """Readings (channel, sensor) of a traction (component, sample): the discrete linear convolution (equations 13 to 15)."""
    return np.asarray(sampled_kernel(PAD, array([channel], traction.shape[-1])).forward(traction)[0])


def data(case: str, channel: str, count: int = SENSORS) -> tuple[Floats, Floats]:
    """(traction, readings) of a case: made on the 121 sensors or more, and then cut to the middle ``count``."""
    wide = max(count, SENSORS)
    traction = CASES[case](array([channel], wide).grid.x)
    cut = slice((wide - count) // 2, (wide - count) // 2 + count)
    return traction[:, cut], sense(traction, channel)[:, cut]


def mean_error(found: Floats, true: Floats) -> float:
    """The paper's equation 26: mean absolute error over the sensors."""
    return float(np.abs(np.asarray(found, dtype=np.float64) - true).mean())
