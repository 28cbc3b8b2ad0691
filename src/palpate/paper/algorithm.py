"""The paper's sections 3.1 and 3.2 on samples: division of transforms, and the contact with constant friction.

Samples n = -N ... N lie in order, the middle one at y = 0. Everything is written as the paper writes it; the library's own
methods are `palpate.inverse.Division`, `LinearSystem` and `ConstantFriction`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from palpate._arrays import irfftn, rfftn
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.inverse import LinearSystemEstimator
from palpate.paper.cases import DEPTH, PAD, PITCH, array, sense
from palpate.paper.formulas import kernels

__all__ = [
    "EDGE",
    "Sliding",
    "constant_shear",
    "discrete_kernel",
    "divide",
    "divide_slowly",
    "even_part",
    "half_width",
    "net_pressure",
    "sliding",
    "solve_linear",
    "transform",
    "without_shear",
]

#: The contact ends where the even part's pressure falls below this part of its peak. The paper names no rule; from strain it must
#: lie above the wrap-around (1e-3 of the peak), from stress above the rounding.
EDGE = 0.01


def discrete_kernel(channel: str, count: int, component: int = 0) -> Floats:
    """K(n) times the sampling period, n = -N ... N (equations 13 and 14): ``component`` 0 for K1, 1 for K2."""
    return kernels(channel, DEPTH, array([channel], count).grid.x)[component] * PITCH


def transform(samples: npt.ArrayLike) -> npt.NDArray[np.complex128]:
    """Discrete Fourier transform of samples n = -N ... N at k = 0 ... N (equation 16); the others are conjugates."""
    values: Floats = np.asarray(samples)
    if values.ndim != 1 or len(values) % 2 == 0:
        raise InvalidInput(f"samples must be one row of odd length, n = -N ... N; got shape {values.shape}.")
    return np.asarray(rfftn(np.roll(values, -(len(values) // 2)), (len(values),)))


def divide(readings: Floats, channel: str) -> Floats:
    """Pressure by division of transforms (equation 17)."""
    count = len(readings)
    quotient = transform(readings) / transform(discrete_kernel(channel, count))
    return np.roll(np.asarray(irfftn(quotient, (count,))), count // 2)


def divide_slowly(readings: Floats, channel: str) -> Floats:
    """Equation 17 as a program of the time may have done it: sums of cosines and sines, angles and all in single precision."""
    count = len(readings)
    n = np.arange(-(count // 2), count // 2 + 1)
    step = np.float32(2 * np.pi / count)
    angles = (step * n.astype(np.float32))[:, None] * n.astype(np.float32)
    cos, sin = np.cos(angles), np.sin(angles)
    g, k = readings.astype(np.float32), discrete_kernel(channel, count).astype(np.float32)
    quotient = ((cos @ g - 1j * (sin @ g)) / (cos @ k - 1j * (sin @ k))).astype(np.complex64)
    return np.asarray((cos @ quotient.real - sin @ quotient.imag) / np.float32(count), dtype=np.float64)


def solve_linear(readings: Floats, channel: str) -> Floats:
    """Ours: the linear system that made the data, solved as it stands."""
    found = LinearSystemEstimator(PAD, [array([channel], len(readings))], [1]).solve([readings[None, :]])
    return np.asarray(found.traction[1])


def even_part(readings: Floats) -> Floats:
    """Mean of the readings at y and -y: constant shear leaves no trace in it (equation 25)."""
    return 0.5 * (readings + readings[::-1])


def half_width(pressure: Floats, edge: float = EDGE) -> int:
    """M: the contact reaches the M-th sample either side of the middle, the last above ``edge`` times the peak."""
    middle = len(pressure) // 2
    loaded = np.flatnonzero(pressure > edge * pressure.max())
    if not loaded.size:
        raise InvalidInput("no sample of the pressure is positive: the readings hold no contact that presses.")
    return int(np.abs(loaded - middle).max())


def net_pressure(readings: Floats, channel: str) -> float:
    """Sum of the pressure's samples: transforms divided at k = 0 (equation 21); K2 is odd and adds nothing."""
    return float(readings.sum() / discrete_kernel(channel, len(readings)).sum())


def constant_shear(total: float, friction: float, half_samples: float) -> float:
    """c = mu/(2M) times the sum of the pressure (equations 18 and 22): 2a = 2M sampling periods."""
    return friction * total / (2 * half_samples)


def without_shear(readings: Floats, channel: str, shear: float, half_samples: int) -> Floats:
    """Readings less those of a constant shear on the samples -M ... M (equation 23)."""
    return readings - sense(_shear(len(readings), shear, half_samples), channel)[0]


def _shear(count: int, shear: float, half_samples: int) -> Floats:
    n = np.arange(count) - count // 2
    loaded = np.where(np.abs(n) <= half_samples, shear, 0.0)
    return np.stack([loaded, np.zeros(count)])


class Sliding(NamedTuple):
    """Traction (q_x, p) on the samples, and the M that was used."""

    traction: Floats
    half_samples: int


def sliding(
    readings: Floats,
    channel: str,
    friction: float,
    *,
    solve: Callable[[Floats, str], Floats] = divide,
    half_samples: int | None = None,
) -> Sliding:
    """Pressure and constant shear of a contact symmetric about the middle, from one channel (section 3.2).

    Parameters
    ----------
    readings : array (sensor,)
    channel : str
        "stress_zz" or "strain_zz".
    friction : float
        Coefficient mu.
    solve : callable
        Inversion for pressure alone: `divide` (the paper), `solve_linear` (ours), which also gives the net pressure then,
        or `divide_slowly`.
    half_samples : int, optional
        M if it is given, and not found from the even part.
    """
    even = solve(even_part(readings), channel)
    m = half_width(even) if half_samples is None else half_samples
    total = float(even.sum()) if solve is solve_linear else net_pressure(readings, channel)
    shear = constant_shear(total, friction, m)
    pressure = solve(without_shear(readings, channel, shear, m), channel)
    return Sliding(np.stack([_shear(len(readings), shear, m)[0], pressure]), m)
