"""Compute readings of round contacts at any place and of any size, and of waves within them, on cells that are fine
compared with the depth of the taxels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate._arrays import irfftn
from palpate.elastic.pad import Floats, Pad
from palpate.errors import Unsupported
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import AreaGrid
from palpate.sensing.operator import Operator

__all__ = ["BALL", "FLAT", "Shapes", "by_reading", "flat_readings"]

BALL, FLAT = "ball", "flat"
#: Cells per depth of the taxels, and the fraction of the cells' waves that is not damped. The rest would contribute
#: exp(-pi FADES CELLS) = 5e-6.
CELLS, FADES = 6.0, 0.65
#: Largest number of cells along an axis.
MAX_CELLS = 160
#: Step for finite differences of readings, as a fraction of depth plus contact radius.
STEP = 0.02


class Shapes:
    """Computes readings for unit forces of round contacts with middles between ``low`` and ``high`` (x, y) [m] and
    radii up to ``largest`` [m].
    """

    def __init__(
        self, pad: Pad, planes: Sequence[Array], components: Sequence[str], low: Floats, high: Floats, largest: float
    ) -> None:
        self.planes, self.components, self.largest = tuple(planes), tuple(components), largest
        #: Corners (x, y) [m] between which places are kept.
        self.bounds = (low, high)
        low, high = low - largest, high + largest
        self.depth = min(p.depth for p in planes)
        size = float(np.max(high - low))
        if self.depth <= 0.0:
            self.depth = size / 20.0
        self.grid = _grid(planes[0], low, high, max(self.depth / CELLS, size / MAX_CELLS))
        self.operator = Operator(pad, planes, self.grid)
        self._rows = [p.valid.ravel() for p in planes]
        # the operator assumes uniform pressure in each cell, a sinc in the spectrum: divide the spectrum by it beforehand
        (ny, nx), (hy, hx) = self.grid.shape, self.grid.spacings
        fy, fx = np.fft.fftfreq(ny), np.fft.rfftfreq(nx)
        self._waves = 2.0 * math.pi * np.hypot(fy[:, None] / hy, fx / hx)
        self._uneven = 1.0 / (np.sinc(fy)[:, None] * np.sinc(fx) * hx * hy)
        # damp the shortest waves smoothly, otherwise they oscillate up to the ends of the grid
        for part in (np.abs(fy)[:, None], fx):
            self._uneven = (
                self._uneven * np.cos(0.5 * math.pi * np.clip((2.0 * part - FADES) / (1.0 - FADES), 0.0, 1.0)) ** 2
            )
        self._phases = (np.exp(-2j * math.pi * fy), np.exp(-2j * math.pi * fx))

    @property
    def smallest(self) -> float:
        """Contacts of smaller radius [m] all give the same readings."""
        return 0.1 * self.depth

    def step(self, radius: float) -> float:
        """Return the distance [m] over which readings are nearly linear."""
        return STEP * (self.depth + radius)

    def traction(self, shape: str, center: Floats, radius: float) -> Floats:
        """Return the pressure (*cell) [Pa] of a unit force at (x, y), from its spectrum W(k a) exp(-i k center) up to
        the shortest wave of the cells.

        W(x) = 3 (sin x - x cos x)/x^3 for Hertz's pressure and sin x/x for a flat (I. N. Sneddon, Fourier Transforms,
        1951).
        """
        x = self._waves * radius
        with np.errstate(invalid="ignore", divide="ignore"):
            w = np.sin(x) / x if shape == FLAT else 3.0 * (np.sin(x) - x * np.cos(x)) / x**3
        w[x < 1e-2] = 1.0
        shift = self._phases[0] ** ((center[1] - self.grid.axes[0][0]) / self.grid.spacings[0])
        along = self._phases[1] ** ((center[0] - self.grid.x[0]) / self.grid.spacings[1])
        found = irfftn(w * self._uneven * shift[:, None] * along, self.grid.shape)
        return np.asarray(found)

    def read(self, cells: Sequence[Floats]) -> Floats:
        """Return readings (n, component, reading) of tractions (n, *cell), separately for each component."""
        every = self.grid.components
        given = np.zeros((len(cells), len(self.components), len(every), *self.grid.shape))
        for i, name in enumerate(self.components):
            given[:, i, every.index(name)] = np.stack(cells)
        found = self.operator.forward(given)
        n = len(cells) * len(self.components)
        parts = [
            np.asarray(part).reshape(n, len(p.channels), -1)[:, :, rows].reshape(n, -1)
            for part, p, rows in zip(found, self.planes, self._rows)
        ]
        return np.concatenate(parts, axis=1).reshape(len(cells), len(self.components), -1)

    def waves(self, cells: Floats, wavevectors: Floats, center: Floats) -> Floats:
        """Return readings (2 n, reading) of a traction (component, *cell) multiplied by the cosine, and by the sine,
        of waves (n, 2) [rad/m] around a place.
        """
        phase = wavevectors[:, 0, None, None] * (self.grid.x - center[0])
        phase = phase + wavevectors[:, 1, None, None] * (self.grid.axes[0] - center[1])[:, None]
        both = np.concatenate([np.cos(phase), np.sin(phase)])
        found = self.operator.forward(both[:, None] * cells)
        parts = [
            np.asarray(part).reshape(len(both), len(p.channels), -1)[:, :, rows].reshape(len(both), -1)
            for part, p, rows in zip(found, self.planes, self._rows)
        ]
        return np.concatenate(parts, axis=1)


def flat_readings(planes: Sequence[Array], parts: Sequence[Floats]) -> Floats:
    """Return the readings of one frame (reading,), given one array (channel, *array) for each plane, in the order of
    the operator's rows.
    """
    return np.concatenate(
        [
            np.asarray(r, dtype=np.float64).reshape(len(p.channels), -1)[:, p.valid.ravel()].ravel()
            for p, r in zip(planes, parts)
        ]
    )


def by_reading(planes: Sequence[Array], channels: Floats) -> Floats:
    """Repeat a number of each channel (over all planes) for each of its readings."""
    out, start = [], 0
    for p in planes:
        out.append(np.repeat(channels[start : start + len(p.channels)], int(p.valid.sum())))
        start += len(p.channels)
    return np.concatenate(out)


def _grid(array: Array, low: Floats, high: Floats, width: float) -> AreaGrid:
    """Return cells between two corners; taxels of a regular array lie above the centres of cells."""
    counts, spacings, centers = [], [], []
    for axis, (a, b) in enumerate(((low[1], high[1]), (low[0], high[0]))):  # of the array axes (y, x)
        h, start = width, float(a)
        if not isinstance(array, ScatteredArray):
            pitch = array.grid.spacings[axis]
            h = pitch / max(math.ceil(pitch / width * (1 - 1e-9)), 1)
            start = float(array.grid.axes[axis][0])
        first, last = math.floor((a - start) / h), math.ceil((b - start) / h)
        counts.append(max(last - first + 1, 3))
        spacings.append(h)
        centers.append(start + 0.5 * (2 * first + counts[-1] - 1) * h)
    if max(counts) > 4 * MAX_CELLS:
        raise Unsupported(
            f"the contact is {max(counts)} cells wide at the depth of these taxels: too many to fit. Describe a part of the array around it."
        )
    return AreaGrid(shape=(counts[0], counts[1]), spacing=(spacings[0], spacings[1]), center=(centers[1], centers[0]))
