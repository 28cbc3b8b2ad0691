"""Prepare displacement vectors for the sampler: their noise, outliers, means over tiles far from traction, and a first
guess.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.fft
import scipy.ndimage

from palpate.elastic.pad import Floats
from palpate.microscopy.blobs import Response
from palpate.microscopy.noise import Noise, Whitener, whitener

__all__ = ["Vectors", "find_doubtful", "first_guess", "noise_of", "outliers", "vectors_of"]

Flags = npt.NDArray[np.bool_]

#: A vector is an outlier if it differs from the median of its neighbours by this many times the noise plus the spread
#: of the neighbours. Of 4,096 good vectors with noise alone none does.
OFF = 4.5
#: Standard deviation of the difference between a vector and the median of its eight neighbours, in units of the noise:
#: the median has 0.39 of the noise, which with the vector's own makes 1.15.
DIFFERENCE = 1.15
#: Fields of more than FEW vectors are averaged over tiles of 4 x 4 vectors from 8 vectors on from strong traction, and
#: of 2 x 2 from 3 on: displacements are smooth there.
FEW, TILES = 1500, ((4, 8.0), (2, 3.0))
#: The displacement near a blob is averaged over this many points along each side of a window.
POINTS = 4
#: A vector is doubtful if it differs from its neighbours by DOUBTED_OFF, and their median moves by MOVED times the noise.
#: At most DOUBTED vectors are. Near traction, neighbours differ so much that one outlier in forty passes OFF; it was off
#: by 6 to 32 times the noise and was taken for a strong narrow adhesion. 2.5 finds all outliers of 24 cells, and three
#: normal vectors in each.
MOVED, DOUBTED_OFF, DOUBTED = 2.0, 2.5, 32
#: Margin round the field for the first guess, as a fraction of the field; its largest number of steps; and the ratio of
#: residual to noise at which it stops.
BEYOND, STEPS, NOISE = 0.15, 60, 1.02


def noise_of(u: Floats) -> float:
    """Return the standard deviation [m] of noise that is independent from vector to vector, from the median of mixed
    second differences (J. Immerkaer, Comput. Vis. Image Underst. 64, 1996, 300-302). The median is used because
    traction bends the field in few places.
    """
    filter_ = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]]) / 6.0
    found = np.concatenate([scipy.ndimage.convolve(c, filter_, mode="constant", cval=np.nan).ravel() for c in u])
    found = found[np.isfinite(found)]
    return 1.4826 * float(np.median(np.abs(found))) if len(found) else float(np.nanstd(u))


def _beside(u: Floats) -> tuple[Floats, Floats]:
    """Return the median of the eight neighbours of each vector, and their spread (2, row, column)."""
    padded = np.pad(u, ((0, 0), (1, 1), (1, 1)), constant_values=np.nan)
    rows, columns = u.shape[1:]
    around = np.stack(
        [padded[:, r : r + rows, c : c + columns] for r in range(3) for c in range(3) if (r, c) != (1, 1)]
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # vectors without neighbours
        middle = np.nanmedian(around, axis=0)
        return middle, 1.4826 * np.nanmedian(np.abs(around - middle), axis=0)


def _far(u: Floats, middle: Floats, spread: Floats, noise: Any) -> Floats:
    """Distance of vectors (row, column) from their neighbours' median, in units of noise and spread."""
    far = np.abs(u - middle) / np.maximum(np.hypot(DIFFERENCE * noise, spread), 1e-300)
    return np.asarray(np.nan_to_num(far).max(axis=0))


def outliers(u: Floats, noise: Any) -> Flags:
    """Return the vectors (row, column) that neither noise nor the spread of their neighbours explains: the median test
    (J. Westerweel, F. Scarano, Exp. Fluids 39, 2005, 1096-1100) with the noise of the field.
    """
    return np.asarray(_far(u, *_beside(u), noise) > OFF)


def find_doubtful(u: Floats, bad: Flags, there: Flags, noise: float) -> Flags:
    """Return the vectors (row, column) that differ from their neighbours where these move too. They may be outliers, or
    adhesions finer than the spacing of vectors, which move one vector far more than the next.
    """
    middle, spread = _beside(np.where(there & ~bad, u, np.nan))
    moved = np.nan_to_num(np.hypot(*middle))
    off = there & (bad | (_far(u, middle, spread, noise) > DOUBTED_OFF))
    moved = np.where(off, moved, 0.0)
    if not (moved > 0).any():
        return np.zeros_like(bad)
    least = max(MOVED * noise, float(np.sort(moved.ravel())[::-1][:DOUBTED][-1]))
    return np.asarray(moved >= least)


@dataclass(eq=False)
class Vectors:
    """Vectors, or means of vectors over tiles: ``places`` (n, 2) [m], ``values`` (2, n) [m], and the variance [m^2] of
    the square that each is a mean over. Multiplying by ``weight`` gives all the same noise; where noise differs or is
    shared, ``white`` does so instead. ``window`` is the side [m] of the square of a single vector.
    """

    places: Floats
    values: Floats
    variance: Floats
    weight: Floats
    window: float
    white: Whitener | None = None
    #: Indices of vectors that may be outliers; each may have an offset of its own.
    doubtful: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        self.y = self._whitened(self.values).ravel()
        self.middle = self.places.mean(axis=0)
        steps = (np.arange(POINTS) - 0.5 * (POINTS - 1)) * self.window / POINTS
        self._points = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        patterns = self._whitened(self.drift(self.places).reshape(3, 2, -1)).reshape(3, -1)
        self.units = 1.0 / np.sqrt((patterns**2).mean(axis=1))
        #: Shift along x and y, and rotation, each of mean square one: (3, 2 n).
        self.patterns = patterns * self.units[:, None]
        if self.doubtful:
            alone = np.zeros((2 * len(self.doubtful), 2, len(self.places)))
            for k, n in enumerate(self.doubtful):
                alone[2 * k, 0, n] = alone[2 * k + 1, 1, n] = 1.0
            #: Followed by the effects of an offset of each doubtful vector, along x and y.
            self.patterns = np.concatenate([self.patterns, self._whitened(alone).reshape(len(alone), -1)])

    def _whitened(self, values: Floats) -> Floats:
        """Transform values (..., n) so that all have equal and independent noise."""
        return self.weight * values if self.white is None else self.white(values)

    def drift(self, places: Floats) -> Floats:
        """Return shifts and a rotation of the picture at some places: (3, 2 n)."""
        nothing, weight = np.zeros(len(places)), np.ones(len(places))
        x, y = (places - self.middle).T
        return np.stack(
            [
                np.concatenate([weight, nothing]),
                np.concatenate([nothing, weight]),
                np.concatenate([-weight * y, weight * x]),
            ]
        )

    def rows(self, response: Response, x: float, y: float, size: float) -> Floats:
        """Effect on the vectors (2, 2 n) of a unit force along x and y in a blob of standard deviation ``size`` [m]."""
        dx, dy = self.places[:, 0] - x, self.places[:, 1] - y
        xx, xy, yy = response.tensor(dx, dy, size**2 + self.variance)
        if self.window > 0:
            near = np.flatnonzero(dx * dx + dy * dy < (2.0 * self.window) ** 2)
            if len(near):
                parts = response.tensor(
                    dx[near, None] + self._points[:, 0],
                    dy[near, None] + self._points[:, 1],
                    size**2 + self.variance[near, None] - self.window**2 / 12 * (1.0 - POINTS**-2),
                )
                for whole, part in zip((xx, xy, yy), parts):
                    whole[near] = part.mean(axis=1)
        out = np.empty((2, 2, len(dx)))
        out[0, 0], out[0, 1], out[1, 0], out[1, 1] = xx, xy, xy, yy
        return self._whitened(out).reshape(2, -1)


def vectors_of(
    u: Floats,
    there: Flags,
    pitch: float,
    window: float,
    strong: Flags,
    noise: Noise | None = None,
    doubtful: Flags | None = None,
) -> Vectors:
    """Return single vectors near ``strong`` traction and where ``doubtful``, and means over tiles elsewhere."""
    rows, columns = there.shape
    alone = np.zeros_like(there) if doubtful is None else doubtful & there
    far = scipy.ndimage.distance_transform_edt(~strong) if strong.any() else np.full(there.shape, np.inf)
    taken = np.zeros_like(there)
    places, values, variance, weight = [], [], [], []
    members: list[npt.NDArray[np.intp]] = []

    def put(first: npt.NDArray[np.intp], side: int) -> None:
        middle = first + 0.5 * (side - 1)
        places.append(pitch * middle[:, ::-1])
        steps = [(a, b) for a in range(side) for b in range(side)]
        values.append(sum(u[:, first[:, 0] + a, first[:, 1] + b] for a, b in steps) / side**2)
        for a, b in steps:
            taken[first[:, 0] + a, first[:, 1] + b] = True
        variance.append(np.full(len(first), (window**2 + (side**2 - 1) * pitch**2) / 12))
        weight.append(np.full(len(first), float(side)))
        numbers = [(first[:, 0] + a) * columns + first[:, 1] + b for a, b in steps]
        members.extend(np.stack(numbers, axis=1))

    if rows * columns > FEW:
        for side, least in TILES:
            shape = rows // side, side, columns // side, side

            def tiles(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
                return values[: shape[0] * side, : shape[2] * side].reshape(shape)  # noqa: B023

            free = (tiles(far) > least).all(axis=(1, 3)) & tiles(there & ~taken & ~alone).all(axis=(1, 3))
            put(np.argwhere(free) * side, side)
    single = np.argwhere(there & ~taken)
    before = sum(map(len, places))
    numbers_of_doubtful = tuple(int(n) for n in before + np.flatnonzero(alone[single[:, 0], single[:, 1]]))
    put(single, 1)
    every = np.concatenate(places)
    white = None if noise is None or noise.plain else whitener(noise, pitch, members, every)
    return Vectors(
        every,
        np.concatenate(values, axis=1),
        np.concatenate(variance),
        np.concatenate(weight),
        window,
        white,
        numbers_of_doubtful,
    )


def first_guess(
    u: Floats, there: Flags, response: Response, pitch: float, window: float, noise: float
) -> tuple[Floats, tuple[int, int]]:
    """Return a smooth traction (2, row, column) that fits the field to within the noise, on the squares of the field
    plus a margin, and that margin (rows, columns). It uses conjugate gradients and stops early.
    """
    shape = there.shape
    margin = [math.ceil(max(BEYOND * n, 1.0)) for n in shape]
    cells = [n + 2 * m for n, m in zip(shape, margin)]
    size = [scipy.fft.next_fast_len(a + b, real=True) for a, b in zip(cells, shape)]
    lags = [np.arange(m + 1 - n, s + m) for n, m, s in zip(cells, margin, shape)]
    y, x = pitch * lags[0][:, None], pitch * lags[1][None, :]
    kernel = np.zeros((3, *size))
    kernel[:, (lags[0] % size[0])[:, None], (lags[1] % size[1])[None, :]] = response.tensor(
        x, y, (pitch**2 + window**2) / 12 + 0.0 * x * y
    )
    xx, xy, yy = scipy.fft.rfft2(kernel)
    k = [2 * np.pi * np.fft.fftfreq(cells[0])[:, None], 2 * np.pi * np.fft.rfftfreq(cells[1])[None, :]]
    smooth = 1.0 / np.sqrt(1.0 + 4.0 * (k[0] ** 2 + k[1] ** 2))
    count = float(there.sum())

    def smoothed(t: Floats) -> Floats:
        return np.asarray(scipy.fft.irfft2(scipy.fft.rfft2(t) * smooth, cells))

    def still(r: Floats) -> Floats:
        r = r * there
        return np.asarray((r - r.sum(axis=(1, 2), keepdims=True) / count) * there)

    def multiplied(values: Floats) -> Floats:
        a, b = scipy.fft.rfft2(values, size)
        return np.asarray(scipy.fft.irfft2(np.stack([xx * a + xy * b, xy * a + yy * b]), size))

    def forward(z: Floats) -> Floats:
        room = np.zeros((2, *size))
        room[:, : cells[0], : cells[1]] = smoothed(z)
        moved = multiplied(np.roll(room, [-m for m in margin], axis=(1, 2)))
        return still(moved[:, : shape[0], : shape[1]])

    def adjoint(r: Floats) -> Floats:
        # the kernel is symmetric
        back = np.roll(multiplied(still(r)), margin, axis=(1, 2))
        return smoothed(back[:, : cells[0], : cells[1]])

    left = still(np.where(there, u, 0.0))
    found = np.zeros((2, *cells))
    gradient = direction = adjoint(left)
    power = float(np.vdot(gradient, gradient))
    for _ in range(STEPS):
        if not power > 0:
            break
        moved = forward(direction)
        step = power / max(float(np.vdot(moved, moved)), 1e-300)
        found += step * direction
        left -= step * moved
        if float(np.vdot(left, left)) < 2 * count * (NOISE * noise) ** 2:
            break
        gradient = adjoint(left)
        new = float(np.vdot(gradient, gradient))
        direction, power = gradient + new / power * direction, new
    return smoothed(found) / pitch**2, (margin[0], margin[1])  # from forces to traction
