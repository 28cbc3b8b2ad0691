"""Displacement vectors as the sampler takes them: their noise, outliers, means over tiles far from traction, and a first guess."""

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

#: An outlier differs from its neighbours' median by so many times noise and the neighbours' own spread together. Of 4,096 good vectors with noise alone none does.
OFF = 4.5
#: A median of eight neighbours has 0.39 of their noise: with the vector's own, 1.15 is what the difference has, and more where neighbours differ.
DIFFERENCE = 1.15
#: Fields of more vectors than this are averaged over tiles, which begin so many vectors from strong traction: displacements are smooth there.
FEW, TILES = 1500, ((4, 8.0), (2, 3.0))
#: Points along each side of a window over which the displacement near a blob is averaged.
POINTS = 4
#: A vector that differs by the second number is doubtful if its neighbours' median moves by this many times the noise; and the largest number of them. Near traction neighbours
#: differ so much that one outlier in forty passes the test above (off by 6 to 32 times the noise, which made a strong narrow adhesion of it); 2.5 finds all of them in 24 cells, and
#: three good vectors a cell besides.
MOVED, DOUBTED_OFF, DOUBTED = 2.0, 2.5, 32
#: Margin of the first guess round the field, as a part of it, and its largest number of steps: it ends when the residual is as large as the noise.
BEYOND, STEPS, NOISE = 0.15, 60, 1.02


def noise_of(u: Floats) -> float:
    """Standard deviation of noise that is independent from vector to vector, by the median of mixed second differences (J. Immerkaer, Comput. Vis. Image Underst. 64, 1996,
    300-302): traction bends the field in few places.
    """
    filter_ = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]]) / 6.0
    found = np.concatenate([scipy.ndimage.convolve(c, filter_, mode="constant", cval=np.nan).ravel() for c in u])
    found = found[np.isfinite(found)]
    return 1.4826 * float(np.median(np.abs(found))) if len(found) else float(np.nanstd(u))


def _beside(u: Floats) -> tuple[Floats, Floats]:
    """Median of the eight neighbours of each vector, and their spread (2, row, column)."""
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
    """How far vectors (row, column) are from their neighbours' median, in what noise and the neighbours' spread explain."""
    far = np.abs(u - middle) / np.maximum(np.hypot(DIFFERENCE * noise, spread), 1e-300)
    return np.asarray(np.nan_to_num(far).max(axis=0))


def outliers(u: Floats, noise: Any) -> Flags:
    """Vectors (row, column) that neither noise nor the spread of their neighbours explains: the median test (J. Westerweel, F. Scarano, Exp. Fluids 39, 2005, 1096-1100) with the
    noise of the field.
    """
    return np.asarray(_far(u, *_beside(u), noise) > OFF)


def find_doubtful(u: Floats, bad: Flags, there: Flags, noise: float) -> Flags:
    """Return the vectors (row, column) that differ from their neighbours where these move too. They may be outliers, or adhesions finer than the vectors, which move one vector far
    more than the next.
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
    """Vectors or means of tiles: ``places`` (n, 2) [m], ``values`` (2, n), variance [m^2] of the square that each is a mean over, ``weight`` by which
    it is multiplied so that all have one noise, or ``white`` that does this where noise differs or is shared; ``window`` is the side of the square of a single vector.
    """

    places: Floats
    values: Floats
    variance: Floats
    weight: Floats
    window: float
    white: Whitener | None = None
    #: Numbers of vectors that may be outliers: each may have an offset of its own.
    doubtful: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        self.y = self._whitened(self.values).ravel()
        self.middle = self.places.mean(axis=0)
        steps = (np.arange(POINTS) - 0.5 * (POINTS - 1)) * self.window / POINTS
        self._points = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        patterns = self._whitened(self.drift(self.places).reshape(3, 2, -1)).reshape(3, -1)
        self.units = 1.0 / np.sqrt((patterns**2).mean(axis=1))
        #: Shift along x and y, and rotation, of mean square one: (3, 2 n).
        self.patterns = patterns * self.units[:, None]
        if self.doubtful:
            alone = np.zeros((2 * len(self.doubtful), 2, len(self.places)))
            for k, n in enumerate(self.doubtful):
                alone[2 * k, 0, n] = alone[2 * k + 1, 1, n] = 1.0
            #: And the effect of an offset of each doubtful vector, along x and y.
            self.patterns = np.concatenate([self.patterns, self._whitened(alone).reshape(len(alone), -1)])

    def _whitened(self, values: Floats) -> Floats:
        """Values (..., n) so that all have one noise of their own."""
        return self.weight * values if self.white is None else self.white(values)

    def drift(self, places: Floats) -> Floats:
        """Shifts and a rotation of a picture at some places: (3, 2 n)."""
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
        """What a unit force along x and along y in a blob of standard deviation ``size`` makes of the vectors: (2, 2 n)."""
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
    """Single vectors near ``strong`` traction and where ``doubtful``, and means of tiles elsewhere."""
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
    """A smooth traction (2, row, column) that leaves the noise, on the field's squares and a margin (rows, columns) of them: conjugate gradients that stop early."""
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
        # the kernel is even
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
    return smoothed(found) / pitch**2, (margin[0], margin[1])  # of forces
