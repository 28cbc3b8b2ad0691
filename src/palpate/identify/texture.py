"""Waves of the pressure within a contact: the strongest one that readings tell, or what they would have told.

Pressure p(x) (1 + A cos(k x) + B sin(k x)) with p that of the fitted contact is linear in A and B. Each wave is fitted beside what the fit already
has; T = gain in squares is chi-squared with two degrees of freedom where there is none. The power of a wave is (A^2 + B^2)/2, relative to the pressure's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.elastic.pad import Floats
from palpate.identify.findings import Finding
from palpate.identify.fitting import Data, Fit, columns_of
from palpate.identify.shapes import Shapes

__all__ = ["Texture", "texture"]

#: Longest wave over the contact radius (two across the contact), ratio of wavelengths, how many, and directions over half a turn.
LONGEST, RATIO, WAVES, DIRECTIONS = 1.0, 1.12, 16, 12
#: Amplitude, relative to the pressure, that must show (at 95 %) for a wave to count as seen.
SHOWS = 0.5
#: Chance of taking noise for a wave, over all waves together.
CHANCE = 0.01


@dataclass(frozen=True)
class Texture:
    """Power of the strongest wave, its wavelength, and its two columns of readings where it is beyond doubt."""

    power: Finding
    wavelength: Finding
    columns: Floats | None = None


def texture(shapes: Shapes, data: Data, best: Fit, rise: float) -> Texture:
    """The strongest wave of a single contact; ``rise``: square of the standard deviations to an end of an interval."""
    radius, center = float(best.radii[0]), best.centers[0]
    wavelengths = LONGEST * radius / RATIO ** np.arange(WAVES)
    wavelengths = wavelengths[wavelengths > 4.0 * max(shapes.grid.spacings)]
    if not len(wavelengths):
        return _blurred(radius)
    angle = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    size = (2.0 * math.pi / wavelengths)[:, None]
    vectors = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=-1).reshape(-1, 2)
    every = shapes.grid.components
    cells = np.zeros((len(every), *shapes.grid.shape))
    unit = shapes.traction(best.shape, center, radius)
    for name, force in zip(shapes.components, best.forces[0]):
        cells[every.index(name)] = force * unit
    read = shapes.waves(cells, vectors, center) * data.weights
    basis = columns_of(shapes, data, best)
    less = read - (read @ basis.T) @ basis
    n = len(vectors)
    c, s = less[:n], less[n:]
    cc, ss, cs = (c**2).sum(1), (s**2).sum(1), (c * s).sum(1)
    gc, gs = c @ best.residual, s @ best.residual
    noise = max(1.0, best.squares / max(best.freedom, 1))
    determinant = np.maximum(cc * ss - cs**2, 1e-300)
    a, b = (ss * gc - cs * gs) / determinant, (cc * gs - cs * gc) / determinant
    amplitude = np.hypot(a, b)
    deviation = np.sqrt(noise * 0.5 * (cc + ss) / determinant)
    gain = a * gc + b * gs
    quantile = math.sqrt(max(rise, 3.84))
    seen = quantile * deviation <= SHOWS
    if not seen.any():
        return _blurred(radius)
    length = np.repeat(wavelengths, DIRECTIONS)
    shortest, longest = float(length[seen].min()), float(length[seen].max())
    i = int(np.flatnonzero(seen)[np.argmax(gain[seen])])
    if gain[i] < 2.0 * noise * math.log(seen.sum() / CHANCE):
        high = float(np.max((amplitude + quantile * deviation)[seen]))
        reason = f"no wave of {1e3 * shortest:.3g} to {1e3 * longest:.3g} mm stands out of the noise; shorter ones would not show"
        return Texture(Finding(0.0, 0.0, 0.5 * high**2, "1", reason), Finding.unknown("m", reason))
    low, high = max(amplitude[i] - quantile * deviation[i], 0.0), amplitude[i] + quantile * deviation[i]
    alike = seen & (gain > gain[i] - max(rise, 3.84) * noise)
    step = math.sqrt(RATIO)
    return Texture(
        Finding(0.5 * float(amplitude[i]) ** 2, 0.5 * float(low) ** 2, 0.5 * float(high) ** 2, "1"),
        Finding(float(length[i]), float(length[alike].min()) / step, float(length[alike].max()) * step, "m"),
        read[[i, n + i]] / np.where(data.weights > 0, data.weights, 1.0),
    )


def _blurred(radius: float) -> Texture:
    reason = (
        f"the pad blurs what is finer than the contact's radius of {1e3 * radius:.2g} mm: half of the pressure could vary and not show. Press a larger contact, "
        "or use shallower or less noisy taxels"
    )
    return Texture(Finding.unknown("1", reason), Finding.unknown("m", reason))
