"""Find waves of the pressure within a contact: the strongest one in the readings, or the smallest that would be
detectable.

The pressure p(x) (1 + A cos(k x) + B sin(k x)), with p that of the fitted contact, is linear in A and B. Each wave is
added to the fit; without a wave the decrease T of the squares is chi-squared with two degrees of freedom. The power of
a wave is (A^2 + B^2)/2, relative to that of the pressure.
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

#: Longest wave as a multiple of the contact radius (two wavelengths across the contact), ratio of successive
#: wavelengths, their number, and the number of directions over half a turn.
LONGEST, RATIO, WAVES, DIRECTIONS = 1.0, 1.12, 16, 12
#: A wave counts as detectable at a place if this amplitude, relative to the pressure, would be significant at 95 %.
SHOWS = 0.5
#: Number of times that the search halves its step around the strongest wave.
FINER = 4
#: Probability of taking noise for a wave, over all waves together.
CHANCE = 0.01


@dataclass(frozen=True)
class Texture:
    """Power and wavelength of the strongest wave, and its two columns of readings if it is significant."""

    power: Finding
    wavelength: Finding
    columns: Floats | None = None


def texture(shapes: Shapes, data: Data, best: Fit, rise: float) -> Texture:
    """Find the strongest wave in the pressure of a single contact. ``rise`` is the squared number of standard deviations at the end of
    an interval.
    """
    radius = float(best.radii[0])
    wavelengths = LONGEST * radius / RATIO ** np.arange(WAVES)
    wavelengths = wavelengths[wavelengths > 4.0 * max(shapes.grid.spacings)]
    if not len(wavelengths):
        return _blurred(radius)
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    search = _Search(shapes, data, best)
    found = search.waves(*(v.ravel() for v in np.meshgrid(wavelengths, angles, indexing="ij")))
    noise = max(1.0, best.squares / max(best.freedom, 1))
    quantile = math.sqrt(max(rise, 3.84))
    # detectability uses the stated noise: with the noise of the residuals a real wave would count as noise
    seen = quantile * found.std <= SHOWS
    if not seen.any():
        return _blurred(radius)
    shortest, longest = float(found.length[seen].min()), float(found.length[seen].max())
    i = int(np.flatnonzero(seen)[np.argmax(found.gain[seen])])
    left = max(1.0, (best.squares - float(found.gain[i])) / max(best.freedom - 2, 1))
    if found.gain[i] < 2.0 * min(noise, left) * math.log(seen.sum() / CHANCE):
        high = float(np.max((found.amplitude + quantile * found.std)[seen]))
        reason = f"no wave of {1e3 * shortest:.3g} to {1e3 * longest:.3g} mm exceeds the noise; shorter ones cannot be detected"
        return Texture(Finding(0.0, 0.0, 0.5 * high**2, "1", reason), Finding.unknown("m", reason))
    length, angle, step, turn = float(found.length[i]), float(found.angle[i]), math.log(RATIO), math.pi / DIRECTIONS
    for _ in range(FINER):
        steps = np.linspace(-1.0, 1.0, 5)
        near = search.waves(
            *(v.ravel() for v in np.meshgrid(length * np.exp(step * steps), angle + turn * steps, indexing="ij"))
        )
        i = int(np.argmax(near.gain))
        length, angle, step, turn = float(near.length[i]), float(near.angle[i]), 0.5 * step, 0.5 * turn
    amplitude, std = float(near.amplitude[i]), math.sqrt(left) * float(near.std[i])
    low, high = max(amplitude - quantile * std, 0.0), amplitude + quantile * std
    # interval of the wavelength: from the curvature, where the gain has decreased by ``rise``
    sides = search.waves(length * np.exp(np.array([-0.03, 0.0, 0.03])), np.full(3, angle)).gain
    bent = max(2.0 * float(sides[1]) - float(sides[0]) - float(sides[2]), 1e-9) / (2.0 * 0.03**2)
    half = min(math.sqrt(max(rise, 3.84) * left / bent) + step, 0.5)
    return Texture(
        Finding(0.5 * amplitude**2, 0.5 * low**2, 0.5 * high**2, "1"),
        Finding(length, length * math.exp(-half), length * math.exp(half), "m"),
        near.columns[:, i] / np.where(data.weights > 0, data.weights, 1.0),
    )


@dataclass(frozen=True)
class _Waves:
    length: Floats
    angle: Floats
    amplitude: Floats
    std: Floats
    gain: Floats
    columns: Floats  # (cosine and sine, wave, reading), divided by the noise


class _Search:
    """Fits waves one by one, in addition to the terms of a fit."""

    def __init__(self, shapes: Shapes, data: Data, best: Fit) -> None:
        self._shapes, self._data, self._best = shapes, data, best
        self._basis = columns_of(shapes, data, best)
        self._cells = np.zeros((len(shapes.grid.components), *shapes.grid.shape))
        unit = shapes.traction(best.shape, best.centers[0], float(best.radii[0]))
        for name, force in zip(shapes.components, best.forces[0]):
            self._cells[shapes.grid.components.index(name)] = force * unit

    def waves(self, length: Floats, angle: Floats) -> _Waves:
        """Return the waves of these wavelengths [m] and directions [rad]."""
        vectors = 2.0 * math.pi / length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        read = self._shapes.waves(self._cells, vectors, self._best.centers[0]) * self._data.weights
        less = (read - (read @ self._basis.T) @ self._basis).reshape(2, len(length), -1)
        c, s = less
        cc, ss, cs = (c**2).sum(1), (s**2).sum(1), (c * s).sum(1)
        gc, gs = c @ self._best.residual, s @ self._best.residual
        determinant = np.maximum(cc * ss - cs**2, 1e-300)
        a, b = (ss * gc - cs * gs) / determinant, (cc * gs - cs * gc) / determinant
        std = np.sqrt(0.5 * (cc + ss) / determinant)
        return _Waves(length, angle, np.hypot(a, b), std, a * gc + b * gs, read.reshape(less.shape))


def _blurred(radius: float) -> Texture:
    reason = (
        f"the pad blurs detail finer than the contact's radius of {1e3 * radius:.2g} mm: even a variation of half the pressure would not be detected. Press a larger contact, "
        "or use shallower or less noisy taxels"
    )
    return Texture(Finding.unknown("1", reason), Finding.unknown("m", reason))
