"""The linear operator from surface traction to readings, and its adjoint.

Four ways to apply it, chosen by geometry only; all have the same accuracy:
- a regular array whose pitch is a whole number of surface cells: convolution with the exact influence of one cell, by
zero-padded FFT (linear, no wrap-around);
- any other layout: the same influences as a matrix, or for many positions by interpolation from a lattice (`palpate.sensing.scattered`);
- a pad with a position-dependent response computes its own map (`palpate.sensing.maps`);
- ``boundary="periodic"``: the surface repeats periodically, and each wavevector has its own matrix (`palpate.elastic.transfer`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from palpate._arrays import device_of, from_numpy, irfftn, is_numpy, namespace, rfftn
from palpate._memory import require
from palpate._recall import Recall, digest
from palpate._threads import cached_property
from palpate.elastic.channels import find_channel
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import Floats, Pad
from palpate.elastic.quantities import transfer
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid, refined
from palpate.sensing.kernels import aperture_rule, influence
from palpate.sensing.maps import Among, Cached, LinearMap, MatrixMap, body_of
from palpate.sensing.scattered import Lattice

__all__ = [
    "Boundary",
    "Convolution",
    "Operator",
    "Periodic",
    "commensurate",
    "multiply",
    "periodic_transfer",
    "sampled_kernel",
]

Boundary = Literal["free", "periodic"]

#: Largest size of a dense map [bytes].
LARGEST_DENSE = 3_000_000_000


#: Largest number of readings, at positions not on a lattice, whose map is a matrix, which is exact.
LARGEST_MATRIX = 4096
#: Bytes of a block of wavevectors in products of spectra: fits with its sources into the processor's second-level
#: cache.
BLOCK_BYTES = 1 << 17


def multiply(xp: Any, matrix: Any, spectrum: Any, rows: int, columns: Sequence[int], d: int, *, adjoint: bool) -> Any:
    """Apply ``columns`` of (rows, all columns, *k) to (..., columns, *k), or their conjugate transpose to (..., rows,
    *k).

    The latter overwrites ``spectrum``.
    """
    if is_numpy(spectrum):
        return _multiplied(matrix, spectrum, columns, d, adjoint=adjoint)
    tail = (slice(None),) * d
    if adjoint:  # conj(K) y = conj(K conj(y)): fewer entries than those of K
        spectrum = xp.conj(spectrum)
    out = []
    for i in columns if adjoint else range(rows):
        total = None
        for place, j in enumerate(range(rows) if adjoint else columns):
            entry = matrix[j, i, ...] if adjoint else matrix[i, j, ...]
            term = entry * spectrum[(..., place, *tail)]
            total = term if total is None else total + term
        out.append(total)
    stacked = xp.stack(out, axis=-1 - d)
    return xp.conj(stacked) if adjoint else stacked


def _multiplied(matrix: Any, spectrum: Any, columns: Sequence[int], d: int, *, adjoint: bool) -> Any:
    """Multiply NumPy arrays, one block of wavevectors at a time, so that sums stay in the processor's cache."""
    lead, waves = spectrum.shape[: -1 - d], spectrum.shape[-d:]
    step = columns[1] - columns[0] if len(columns) > 1 else 1
    component_index: Any = slice(columns[0], columns[-1] + 1, step or 1)
    if list(range(matrix.shape[1]))[component_index] != list(columns):  # a copy if they are unordered
        component_index = list(columns)
    if adjoint:  # conj(K) y = conj(K conj(y)): fewer entries than those of K
        np.conjugate(spectrum, out=spectrum)
        matrix = np.swapaxes(matrix[:, component_index], 0, 1)
    else:
        matrix = matrix[:, component_index]
    count, sources = matrix.shape[:2]
    out: Any = np.empty((*lead, count, *waves), dtype=spectrum.dtype)
    each = spectrum.itemsize * max(1, math.prod(lead)) * count * math.prod(waves[1:])
    block = min(waves[0], max(1, BLOCK_BYTES // each))
    term: Any = np.empty((*lead, count, block, *waves[1:]), dtype=spectrum.dtype)
    tail = (slice(None),) * (d - 1)
    for start in range(0, waves[0], block):
        block_index: tuple[Any, ...] = (slice(start, min(start + block, waves[0])), *tail)
        part = term[(..., slice(0, block_index[0].stop - start), *tail)]
        total = out[(..., *block_index)]
        for source in range(sources):
            entry, wave = matrix[(slice(None), source, *block_index)], spectrum[(..., source, None, *block_index)]
            if source == 0:
                np.multiply(entry, wave, out=total)
            else:
                np.multiply(entry, wave, out=part)
                np.add(total, part, out=total)
    if adjoint:
        np.conjugate(out, out=out)
    return out


def commensurate(array: Array, grid: Grid) -> tuple[tuple[int, ...], tuple[float, ...]] | None:
    """Cells per pitch, and first taxel minus first cell centre, for each axis; None if the layout allows no FFT."""
    if isinstance(array, ScatteredArray):
        return None
    ratios, shifts = [], []
    for axis, spacing in enumerate(grid.spacings):
        ratio = array.grid.spacings[axis] / spacing
        if abs(ratio - round(ratio)) > 1e-9 * ratio or round(ratio) < 1:
            return None
        ratios.append(round(ratio))
        shifts.append(float(array.grid.axes[axis][0] - grid.axes[axis][0]))
    return tuple(ratios), tuple(shifts)


def _rules(array: Array, grid: Grid, shifts: Sequence[float] | None) -> list[tuple[Floats, Floats]]:
    return [
        aperture_rule(width, array.depth, spacing, None if shifts is None else shifts[axis])
        for axis, (width, spacing) in enumerate(zip(array.apertures, grid.spacings))
    ]


class _Spectral:
    """A map that is a product with a spectrum in the Fourier domain."""

    size: tuple[int, ...]
    rows: int
    count: int
    spectrum: Cached

    def _product(self, values: Any, among: Among, *, adjoint: bool) -> Any:
        """The product with the spectrum, or its adjoint, in the transformed domain."""
        xp, d = namespace(values), len(self.size)
        columns = range(self.count) if among is None else among
        waves = rfftn(values, self.size)
        return multiply(xp, self.spectrum.like(values), waves, self.rows, columns, d, adjoint=adjoint)


class Convolution(_Spectral):
    """Zero-padded FFT convolution with the influence of one cell."""

    def __init__(
        self, pad: Pad, array: Array, grid: Grid, *, concentrated: bool = False, recall: Recall | None = None
    ) -> None:
        from scipy.fft import next_fast_len

        layout = commensurate(array, grid)
        if layout is None:
            raise Unsupported("the array is not commensurate with the surface grid.")
        self.ratios, shifts = layout
        self.taxels, self.cells = array.shape, grid.shape
        self.rows, self.count = len(array.channels), len(grid.components)
        lags = [np.arange(-(n - 1), (m - 1) * r + 1) for n, m, r in zip(self.cells, self.taxels, self.ratios)]
        offsets = [s + lag * dx for s, lag, dx in zip(shifts, lags, grid.spacings)]
        # Largest number of values per lag, measured: the kernel, its padded copy, its transform and temporaries of the
        # formulas.
        values_per_lag = (10 + 8 * self.rows) if isinstance(pad, HalfSpace) else (60 + 80 * self.rows)
        require(
            8.0 * values_per_lag * math.prod(len(lag) for lag in lags),
            f"{' x '.join(map(str, self.taxels))} taxels and {' x '.join(map(str, self.cells))} surface cells",
            "Describe the array in parts that overlap by a few depths.",
        )
        self.key = digest("influence", pad, array, grid, concentrated)
        shape = (self.rows, self.count, *(len(lag) for lag in lags))
        stored = None if recall is None else recall.find(self.key, [shape])
        self.kernel = (
            stored[0]
            if stored is not None
            else influence(
                pad,
                offsets,
                grid.spacings,
                array.depth,
                array.channels,
                _rules(array, grid, shifts),
                concentrated=concentrated,
            )
        )
        self.size = tuple(
            next_fast_len(max(len(lag), m * r), real=True) for lag, m, r in zip(lags, self.taxels, self.ratios)
        )
        padded = np.zeros((*self.kernel.shape[:2], *self.size))
        padded[(slice(None), slice(None), *(slice(0, len(lag)) for lag in lags))] = self.kernel
        padded = np.roll(padded, [-(n - 1) for n in self.cells], axis=tuple(range(2, 2 + len(lags))))
        self.spectrum = Cached(rfftn(padded, self.size))

    def forward(self, traction: Any, among: Among = None) -> Any:
        product = self._product(traction, among, adjoint=False)
        keep = [slice(0, (m - 1) * r + 1, r) for m, r in zip(self.taxels, self.ratios)]
        return irfftn(product, self.size, keep, overwrite=True)

    def adjoint(self, readings: Any, among: Among = None) -> Any:
        xp, d = namespace(readings), len(self.size)
        upsampled = readings
        for axis, ratio in enumerate(self.ratios):
            upsampled = _upsampled(xp, upsampled, axis - d, ratio)
        product = self._product(upsampled, among, adjoint=True)
        return irfftn(product, self.size, [slice(0, n) for n in self.cells], overwrite=True)

    def dense(self) -> Floats:
        """(channel, *taxels, component, *cells)."""
        d = len(self.cells)
        return np.array(np.moveaxis(self.windows, range(1 + d), range(1 + d, 2 + 2 * d)), order="C")

    @property
    def windows(self) -> Floats:
        """(component, *cells, channel, *taxels), as a view of the kernel's memory."""
        kernel = self.kernel
        # The kernel index for (taxel i, cell j) is i r - j + (n - 1) along each axis: one taxel further adds r, one
        # cell further subtracts 1.
        steps = kernel.strides[2:]
        first: tuple[Any, ...] = (..., *(slice(n - 1, None) for n in self.cells))
        return np.lib.stride_tricks.as_strided(
            kernel[first],
            (kernel.shape[1], *self.cells, kernel.shape[0], *self.taxels),
            (
                kernel.strides[1],
                *(-s for s in steps),
                kernel.strides[0],
                *(s * r for s, r in zip(steps, self.ratios)),
            ),
            writeable=False,
        )

    def columns(self, component: int, cells: npt.NDArray[np.intp]) -> Floats:
        """(channel, taxel, cell): readings of unit traction in some ``cells`` (flat indices), cell by cell in memory."""
        # Copy windows row by row: 40 times as fast as single entries.
        windows = self.windows[(component, *np.unravel_index(cells, self.cells))]
        return np.asarray(windows.reshape(len(cells), self.rows, -1).transpose(1, 2, 0))


def _upsampled(xp: Any, x: Any, axis: int, ratio: int) -> Any:
    """Put ``ratio - 1`` zeros after each entry along a negative ``axis``."""
    if ratio == 1:
        return x
    shape = list(x.shape)
    position = len(shape) + axis
    x = xp.expand_dims(x, axis=position + 1)
    zeros = xp.zeros((*shape[: position + 1], ratio - 1, *shape[position + 1 :]), dtype=x.dtype, device=device_of(x))
    shape[position] *= ratio
    return xp.reshape(xp.concat([x, zeros], axis=position + 1), tuple(shape))


class _Dense(MatrixMap):
    """A matrix of influences, for scattered positions and pitches that do not fit the cells."""

    def __init__(self, pad: Pad, array: Array, grid: Grid) -> None:
        points = array.points
        rows, columns = len(array.channels), len(grid.components)
        total = 8 * len(points) * math.prod(grid.shape) * rows * columns
        if total > LARGEST_DENSE:
            raise Unsupported(
                f"{len(points)} scattered positions and {math.prod(grid.shape)} surface cells make a map of "
                f"{total / 1e9:.1f} GB (limit {LARGEST_DENSE / 1e9:.0f} GB). Give a coarser surface, or grid the recording "
                "(Recording.gridded, palpate convert --grid) and use an AreaArray."
            )
        require(
            total + 8.0 * rows * columns * max(2_000_000, math.prod(grid.shape)) * 4.0,
            f"{len(points)} scattered positions and {math.prod(grid.shape)} surface cells",
            "Give a coarser surface, or grid the recording (Recording.gridded, palpate convert --grid).",
        )
        rules = _rules(array, grid, None)
        matrix = np.empty((rows, len(points), columns, *grid.shape))
        chunk = max(1, 2_000_000 // math.prod(grid.shape))
        for start in range(0, len(points), chunk):
            part = points[start : start + chunk]
            offsets = [part[:, a : a + 1] - grid.axes[a][None, :] for a in range(grid.dimensions)]
            block = influence(pad, offsets, grid.spacings, array.depth, array.channels, rules)
            matrix[:, start : start + chunk] = np.moveaxis(block, 1, 2)
        super().__init__(matrix, array.shape)


def periodic_transfer(pad: Pad, grid: Grid, array: Array) -> npt.NDArray[np.complex128]:
    """Matrix (channel, component, *k) of each wavevector of a periodic surface, for an array at the cell centres.

    At k = 0 a half-space's displacement has no finite value and is set to 0, so that the readings do not depend on the
    mean traction; stress and strain use the mean of their limit over directions. A Nyquist row is its own mirror image
    and uses the mean of both signs. The taxel's aperture multiplies by its transform.
    """
    waves = [
        2 * np.pi * (np.fft.rfftfreq(n, dx) if axis == grid.dimensions - 1 else np.fft.fftfreq(n, dx))
        for axis, (n, dx) in enumerate(zip(grid.shape, grid.spacings))
    ]
    signs = [(1.0, -1.0) if n % 2 == 0 else (1.0,) for n in grid.shape]
    total: Any = 0.0
    count = 0
    for flips in np.ndindex(*(len(s) for s in signs)):
        axes: list[Floats] = []
        for wave, n, dx, flip in zip(waves, grid.shape, grid.spacings, flips):
            flipped: Floats = wave.copy()
            if flip:
                flipped[np.isclose(np.abs(wave), np.pi / dx) & (n % 2 == 0)] *= -1.0
            axes.append(flipped)
        kx: Floats
        ky: Floats
        if grid.dimensions == 1:
            kx, ky = axes[0], np.zeros(1)
        else:
            ky, kx = axes[0][:, None], axes[1][None, :]
        total = total + transfer(pad, kx, ky, array.depth, array.channels, line=grid.dimensions == 1)
        count += 1
    matrix = np.nan_to_num(total / count, nan=0.0)
    if grid.dimensions == 1:
        matrix = matrix[..., [0, 2]]
    matrix = np.moveaxis(matrix, (-2, -1), (0, 1))
    for axis, (wave, width) in enumerate(zip(waves, array.apertures)):
        shape = [1] * grid.dimensions
        shape[axis] = -1
        matrix = matrix * np.sinc(wave * width / (2 * np.pi)).reshape(shape)
    return np.asarray(matrix)


class Periodic(_Spectral):
    """One matrix per wavevector of a periodic surface."""

    def __init__(self, pad: Pad, array: Array, grid: Grid) -> None:
        self.rows, self.count, self.size = len(array.channels), len(grid.components), grid.shape
        require(
            16.0 * 3.0 * self.rows * self.count * math.prod(grid.shape),
            f"{' x '.join(map(str, array.shape))} taxels on a periodic surface",
            "Cut the readings into parts that overlap by a few depths.",
        )
        self.transfer = periodic_transfer(pad, grid, array)
        self.spectrum = Cached(self.transfer)

    def forward(self, traction: Any, among: Among = None) -> Any:
        return irfftn(self._product(traction, among, adjoint=False), self.size, overwrite=True)

    def adjoint(self, readings: Any, among: Among = None) -> Any:
        return irfftn(self._product(readings, among, adjoint=True), self.size, overwrite=True)

    def dense(self) -> Floats:
        """(channel, *taxels, component, *cells)."""
        cells = math.prod(self.size)
        unit = np.eye(self.count * cells).reshape(self.count * cells, self.count, *self.size)
        out = np.moveaxis(self.forward(unit), 0, -1)
        return np.asarray(out.reshape(self.rows, *self.size, self.count, *self.size))

    def columns(self, component: int, cells: npt.NDArray[np.intp]) -> Floats:
        """(channel, taxel, cell): readings of unit traction in some ``cells`` (flat indices)."""
        unit = np.zeros((len(cells), self.count, math.prod(self.size)))
        unit[np.arange(len(cells)), component, cells] = 1.0
        out = self.forward(unit.reshape(len(cells), self.count, *self.size))
        return np.asarray(np.moveaxis(out.reshape(len(cells), self.rows, -1), 0, -1))


class Operator:
    """Map from traction (..., component, *surface) to one readings array (..., channel, *array) per plane, and its
    transpose.

    Parameters
    ----------
    pad : Pad
    planes : sequence of arrays
    surface : grid
    boundary : "free" or "periodic"
    recall : Recall, optional
        Influences that an earlier run computed.

    Raises
    ------
    InvalidInput
        A line's surface for an area's array, or the other way round.
    Unsupported
        A periodic surface that is not the array's own grid; scattered positions whose map is too large.

    Notes
    -----
    Missing taxels (``mask``) read 0 and are not used. In line contact the displacement of a half-plane is defined up to
    a constant: such channels are relative to their mean over the array.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> from palpate.sensing import Operator
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> array = pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_zz"], mask=[True, True, False])
    >>> operator = Operator(pad, [array], pp.LineGrid(count=5, spacing=1e-3))
    >>> traction = np.zeros((2, 5))
    >>> traction[1, 2] = 1000.0  # pressure on the cell in the middle [Pa]
    >>> (readings,) = operator.forward(traction)
    >>> readings.round(1).tolist()  # the third taxel is masked
    [[184.8, 549.8, 0.0]]

    >>> operator.adjoint([readings]).shape, operator.dense().shape  # two working taxels
    ((2, 5), (2, 10))

    >>> np.allclose(operator.columns([1], np.array([2]))[:, 0, 0] * 1000.0, readings[0, :2])
    True

    >>> len(operator.planes), operator.observed([np.ones((1, 3))])[0].tolist()
    (1, [[1.0, 1.0, 0.0]])
    """

    def __init__(
        self,
        pad: Pad,
        planes: Sequence[Array],
        surface: Grid,
        boundary: Boundary = "free",
        *,
        recall: Recall | None = None,
    ) -> None:
        self.recall = recall
        self.pad, self.planes_of, self.surface, self.boundary = pad, tuple(planes), surface, boundary
        check_surface(planes, surface)
        for array in planes:
            if boundary == "periodic":
                if body_of(pad) is not None:
                    raise Unsupported(
                        f'a {type(pad).__name__} has sides: boundary="periodic" repeats a pad endlessly. Use boundary="free", which is the default.'
                    )
                _check_periodic(array, surface)
        self._weights = [Cached(a.valid.astype(np.float64)) if a.mask is not None else None for a in planes]
        self._floating = [_floating_channels(pad, a, boundary) for a in planes]

    @cached_property
    def planes(self) -> list[LinearMap]:
        """The map of each array, built at first use, so that a method can refuse a size before that."""
        maps: list[LinearMap] = []
        body = body_of(self.pad)
        for array in self.planes_of:
            if body is not None:
                maps.append(body.response(array, self.surface))
            elif self.boundary == "periodic":
                maps.append(Periodic(self.pad, array, self.surface))
            elif commensurate(array, self.surface) is not None:
                maps.append(Convolution(self.pad, array, self.surface, recall=self.recall))
            elif len(array.points) * len(array.channels) > LARGEST_MATRIX:
                maps.append(Lattice(self.pad, array, self.surface, Convolution))
            else:
                maps.append(_Dense(self.pad, array, self.surface))
        return maps

    def finer(self, ratio: int) -> Operator:
        """The same operator for cells ``ratio`` times finer along each axis.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=11, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        >>> skin.operator.finer(2).surface.shape
        (30,)
        """
        if ratio == 1:
            return self
        return Operator(self.pad, self.planes_of, refined(self.surface, ratio), self.boundary, recall=self.recall)

    def worked_out(self) -> dict[str, tuple[Floats, ...]]:
        """Computed influences, for `Recall`.

        Examples
        --------
        >>> import palpate as pp
        >>> from palpate.sensing import Operator
        >>> array = pp.LineArray(count=5, pitch=1e-3, depth=1e-3, channels=["stress_zz"])
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> len(Operator(pad, [array], pp.LineGrid(count=5, spacing=1e-3)).worked_out())  # nothing was asked for
        0
        """
        maps = self.planes if "planes" in self.__dict__ else []
        return {p.key: (p.kernel,) for p in maps if isinstance(p, Convolution) and p.key is not None}

    def forward(self, traction: Any, among: Among = None) -> list[Any]:
        """Readings of each plane for traction (..., component, *surface); ``among``: the components it contains."""
        return [self._project(i, plane.forward(traction, among)) for i, plane in enumerate(self.planes)]

    def adjoint(self, readings: Sequence[Any], among: Among = None) -> Any:
        """Transpose of `forward`: traction-shaped from one readings array per plane."""
        total = None
        for i, (plane, part) in enumerate(zip(self.planes, readings)):
            term = plane.adjoint(self._project(i, part), among)
            total = term if total is None else total + term
        return total

    def dense(self) -> Floats:
        """The whole operator as a matrix (reading, traction): planes, then channels, then working taxels only."""
        blocks = []
        for array, plane, floating in zip(self.planes_of, self.planes, self._floating):
            block = plane.dense().reshape(len(array.channels), math.prod(array.shape), -1)[:, array.valid.ravel()]
            for channel in floating:
                block[channel] -= block[channel].mean(axis=0)
            blocks.append(block.reshape(-1, block.shape[-1]))
        return np.concatenate(blocks)

    def columns(self, components: Sequence[int], cells: npt.NDArray[np.intp]) -> Floats:
        """Columns of `dense` (reading, component, cell) for components and flat cells, column by column in memory."""
        sizes = [len(a.channels) * int(np.count_nonzero(a.valid)) for a in self.planes_of]
        out = np.empty((len(components), len(cells), sum(sizes)))
        start = 0
        for array, plane, floating, size in zip(self.planes_of, self.planes, self._floating, sizes):
            block = out[:, :, start : start + size].reshape(*out.shape[:2], len(array.channels), -1)
            for i, c in enumerate(components):
                columns = plane.columns(c, cells).transpose(2, 0, 1)
                block[i] = columns if array.mask is None else columns[..., array.valid.ravel()]
            for channel in floating:
                block[:, :, channel] -= block[:, :, channel].mean(axis=-1, keepdims=True)
            start += size
        return out.transpose(2, 0, 1)

    @property
    def floats(self) -> bool:
        """Whether the mean of a channel is subtracted: then each of its readings must be there.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> pp.Skin(pad, pp.LineArray(count=5, pitch=1e-3, depth=0.0, channels=["displacement_z"])).operator.floats
        True
        """
        return any(self._floating)

    def observed(self, readings: Sequence[Any]) -> list[Any]:
        """Readings that the operator can produce: missing taxels set to zero, undetermined means subtracted."""
        return [self._project(i, r) for i, r in enumerate(readings)]

    def _project(self, i: int, readings: Any) -> Any:
        """Set missing taxels to zero and subtract the mean of channels without a zero: an orthogonal projection."""
        weights, floating = self._weights[i], self._floating[i]
        if weights is not None:
            readings = readings * weights.like(readings)
        if not floating:
            return readings
        xp = namespace(readings)
        working = int(np.count_nonzero(self.planes_of[i].valid))
        mean = xp.sum(readings, axis=-1, keepdims=True) / working
        if weights is not None:
            mean = mean * weights.like(readings)
        keep = np.ones((len(self.planes_of[i].channels), 1))
        keep[list(floating)] = 0.0
        return readings - from_numpy(1.0 - keep, readings) * mean


def check_surface(planes: Sequence[Array], surface: Grid) -> None:
    """Raise an error for a surface of another kind of contact than the arrays, or with a single row of cells."""
    if min(surface.shape) < 2:
        raise InvalidInput(
            f"the surface has {' x '.join(map(str, surface.shape))} cells, and at least 2 are needed along each axis. Leave surface out, or give more rows."
        )
    for array in planes:
        if array.dimensions != surface.dimensions:
            raise InvalidInput(
                f"the surface is a {type(surface).__name__} but the array is a {type(array).__name__} in "
                f"{'line' if array.dimensions == 1 else 'area'} contact; use "
                f"{'LineGrid' if array.dimensions == 1 else 'AreaGrid'}."
            )


def _floating_channels(pad: Pad, array: Array, boundary: Boundary) -> tuple[int, ...]:
    if array.dimensions == 2 or boundary == "periodic" or pad.mean_compliance(array.depth) is not None:
        return ()
    return tuple(i for i, c in enumerate(array.channels) if find_channel(c).kind.absolute)


def _check_periodic(array: Array, surface: Grid) -> None:
    same = not isinstance(array, ScatteredArray) and array.shape == surface.shape
    if same:
        for a, b in zip(array.grid.axes, surface.axes):  # type: ignore[union-attr]
            same = same and bool(np.allclose(a, b, rtol=0, atol=1e-9 * abs(b[1] - b[0])))
    if not same:
        raise Unsupported(
            'boundary="periodic" needs a LineArray or AreaArray and the surface to be the array\'s own grid. Leave surface '
            'out, grid the recording first (Recording.gridded), or use boundary="free".'
        )


def sampled_kernel(pad: Pad, array: Array) -> Operator:
    """The founding paper's model: concentrated loads on the array's own grid, free boundary."""
    if isinstance(array, ScatteredArray):
        raise Unsupported(
            'methods "dft" and "linear" need a regular array (LineArray or AreaArray); use method="tikhonov" for '
            "scattered positions."
        )
    operator = Operator.__new__(Operator)
    operator.pad, operator.planes_of, operator.surface, operator.boundary = pad, (array,), array.grid, "free"
    operator.recall = None
    operator.planes = [Convolution(pad, array, array.grid, concentrated=True)]
    operator._weights = [Cached(array.valid.astype(np.float64)) if array.mask is not None else None]
    operator._floating = [_floating_channels(pad, array, "free")]
    return operator
