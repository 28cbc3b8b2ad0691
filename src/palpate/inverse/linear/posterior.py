"""Error bars of a linear estimate, in closed form.

For a traction of covariance alpha W and noise of variance sigma^2 (in units of the whitening), the estimate V
diag(phi/s) U^T y has the error covariance

    alpha (W - V V^T) + V diag(e) V^T,      e = alpha (1 - phi)^2 + sigma^2 phi^2/s^2.

For Tikhonov's filter with alpha = sigma^2/lambda this is the posterior covariance alpha W - alpha W A^T (A W A^T +
lambda N)^{-1} A W (G. Wahba, J. R. Stat. Soc. B 45, 1983, 133-150); it also holds for other filters. alpha and sigma^2
are posterior means (`palpate.inverse.linear.parameter.amplitude`), so that an empty frame has the error of a load too
small to detect. Nuisances of unknown size c (`palpate.sensing.nuisance`) add G cov(c) G^T, where G is the estimate's
response to each.

The part that does not depend on the frame is one table for all frames. It takes as long as solving about a hundred
frames, and the maps take three times the memory of the traction, so everything is computed at first use.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._batches import Deferred
from palpate._memory import require
from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.estimate import Errors
from palpate.inverse.linear.memory import spectrum_memory
from palpate.inverse.linear.parameter import TINY, Filter, amplitude, filtered_inverse
from palpate.inverse.linear.spectrum import Spectrum
from palpate.sensing.grids import Grid
from palpate.sensing.operator import Operator

__all__ = [
    "PATTERN",
    "UNEXPLAINED",
    "Frames",
    "LinearErrors",
    "SpectrumVariances",
    "Uncertainty",
    "Variances",
    "center_rows",
    "finest",
    "moment_rows",
]

#: Smallest relative error of the net force to assume: no pad and no grid is more accurate. A convention, which only
#: matters for lower noise.
MODEL_FORCE = 5e-4
#: Factor on the error of net force and moment due to nuisances. The calibration constant is a quarter to a half,
#: because the surroundings of a contact within the array are empty; but this does not help against a shift of the
#: image, so the factor cancels it.
PATTERN = 4.0
#: Cells above this fraction of the peak pressure count for the centre of pressure (`palpate.touch.numbers`).
CONTACT = 0.1
#: Smallest fraction of degrees of freedom in the residual for a noise estimate: with less, its error is a factor of two
#: or more on any array of ten readings or more. The error bars then use the largest possible noise: that of the FINEST
#: fraction of the coefficients.
UNEXPLAINED, FINEST = 0.1, 0.2
#: Frames per batch.
CHUNK = 32


def finest(eigenvalues: Floats, multiplicity: Floats, datum: Floats) -> Floats:
    """Mean power (frame,) of the coefficients to which traction contributes least: an upper bound of white noise.
    ``datum`` (frame, n) is |c|^2 of all data of each coefficient.
    """
    order = np.argsort(eigenvalues, kind="stable")
    counts = multiplicity[order]
    least = np.cumsum(counts) <= max(FINEST * counts.sum(), counts[0])
    return np.asarray(datum[:, order[least]].sum(axis=1) / max(counts[least].sum(), TINY))


def moment_rows(grid: Grid) -> Floats:
    """The moments as sums over cells (moment, component, *surface)."""
    return grid.moment_rows(range(len(grid.components)))


def center_rows(grid: Grid, pressure: Floats) -> Floats:
    """Derivative of the centre of pressure with respect to the ``pressure`` of a frame (axis, *surface); 0 without
    pressure.
    """
    places = np.stack(np.meshgrid(*grid.axes, indexing="ij")[::-1])
    inside = np.where((pressure > CONTACT * pressure.max()) & (pressure.max() > 0), pressure, 0.0)
    areas = grid.areas / grid.cell
    inside = inside * areas
    total = inside.sum()
    if not total > 0:
        return np.zeros_like(places)
    return np.stack([(inside > 0) * areas * (x - (x * inside).sum() / total) / total for x in places])


class Frames(NamedTuple):
    """Some frames (frame,): prior amplitude alpha, noise variance sigma^2 and parameter; and their filter."""

    amplitude: Floats
    noise: Floats
    parameter: Floats
    filter: Filter


class Variances(abc.ABC):
    """Variances of the traction and of its sums: the part that does not depend on the frame, computed at first use."""

    def __init__(self, operator: Operator, columns: Sequence[int]) -> None:
        self.operator, self.grid, self.columns = operator, operator.surface, tuple(columns)

    @property
    def mean_seen(self) -> npt.NDArray[np.bool_]:
        """Whether the readings determine the mean of each component sought."""
        return np.ones(len(self.columns), dtype=bool)

    @property
    @abc.abstractmethod
    def nbytes(self) -> int:
        """Memory in bytes."""

    @property
    @abc.abstractmethod
    def prior(self) -> Floats:
        """The diagonal of W (component sought, *surface)."""

    @abc.abstractmethod
    def sizes(
        self, data: Floats, floor: Floats | None, parameter: Floats, filter_factors: Filter
    ) -> tuple[Floats, Floats]:
        """Posterior means of the amplitude and the noise variance (frame,), NaN if all readings are zero. ``data`` and
        ``floor`` are those of `Uncertainty`.
        """

    @abc.abstractmethod
    def of_cells(self, frames: Frames) -> Floats:
        """Variance in every cell (frame, component sought, *surface); axes of length 1 if it is the same everywhere."""

    @abc.abstractmethod
    def of_sums(self, frames: Frames, name: str, rows: Floats) -> Floats:
        """Variance (frame, row) of sums ``rows`` w (row, component sought, *surface); ``name`` identifies the rows in
        a cache.
        """

    @abc.abstractmethod
    def of_own_sums(self, frames: Frames, rows: Callable[[slice], Floats]) -> Floats:
        """Variance (frame, row) of sums that differ between frames: ``rows`` (frame, row, component sought, *surface)
        for some frames.
        """

    @abc.abstractmethod
    def response(self, frames: Frames, rows: Floats) -> Floats:
        """The estimates (frame, direction, component sought, *surface) for ``rows`` (frame, direction, n) of readings."""

    def errors(self, frames: Frames, i: int, count: int, rng: np.random.Generator) -> Floats:
        """Random errors (draw, component sought, *surface) of the estimate of frame ``i``."""
        raise Unsupported(
            "samples of the posterior are drawn where the problem is solved by iteration, not of a decomposition."
        )


class SpectrumVariances(Variances):
    """Variances from a spectral decomposition."""

    def __init__(self, spectrum: Spectrum, columns: Sequence[int]) -> None:
        super().__init__(spectrum.operator, columns)
        self.spectrum = spectrum
        self._sums: dict[str, tuple[Floats, Floats]] = {}

    @property
    def mean_seen(self) -> npt.NDArray[np.bool_]:
        return self.spectrum.mean_seen

    @property
    def nbytes(self) -> int:
        return sum(part.nbytes for part in self.__dict__.get("cells", ()))

    @cached_property
    def cells(self) -> tuple[Floats, Floats, Floats]:
        """See `Spectrum.cells`."""
        operator = self.operator
        if operator.boundary == "free":
            require(
                spectrum_memory(operator.pad, operator.planes_of, self.grid, len(self.columns)),
                "the error bars of a map",
                'interval(of="force") and the other numbers need little: ask for those, or give a coarser surface.',
            )
        return self.spectrum.cells()

    @property
    def prior(self) -> Floats:
        _, powers, rest = self.cells
        return np.asarray(rest + powers.sum(axis=0))

    def sizes(
        self, data: Floats, floor: Floats | None, parameter: Floats, filter_factors: Filter
    ) -> tuple[Floats, Floats]:
        spectrum = self.spectrum
        values, counts = spectrum.eigenvalues, spectrum.multiplicity
        size, noise = amplitude(values, counts, data, floor, tried=spectrum.tried)
        if floor is not None:
            left = (1.0 - filter_factors(values, parameter[:, None])) @ counts / counts.sum()
            blind = left < UNEXPLAINED
            noise = np.where(blind, np.maximum(noise, finest(values, counts, counts * data)), noise)
            nothing = data @ counts == 0
            size, noise = np.where(nothing, np.nan, size), np.where(nothing, np.nan, noise)
        return size, noise

    def of_cells(self, frames: Frames) -> Floats:
        nodes, powers, rest = self.cells
        flat, left = powers.reshape(len(nodes), -1), rest.ravel()
        parts = [np.maximum(each @ flat, 0.0) + size * left for _, size, each in self._weights(frames, nodes)]
        return np.concatenate(parts).reshape(-1, *rest.shape)

    def of_sums(self, frames: Frames, name: str, rows: Floats) -> Floats:
        if name not in self._sums:
            self._sums[name] = self.spectrum.sums(rows)
        powers, rest = self._sums[name]
        weights = self._weights(frames, self.spectrum.eigenvalues)
        return np.concatenate([each @ powers.T + size * rest for _, size, each in weights])

    def of_own_sums(self, frames: Frames, rows: Callable[[slice], Floats]) -> Floats:
        parts = []
        for part, size, each in self._weights(frames, self.spectrum.eigenvalues):
            here = rows(part)
            powers, rest = self.spectrum.sums(here.reshape(-1, *here.shape[2:]))
            shape = here.shape[:2]
            parts.append((each[:, None, :] * powers.reshape(*shape, -1)).sum(axis=-1) + size * rest.reshape(shape))
        return np.concatenate(parts)

    def response(self, frames: Frames, rows: Floats) -> Floats:
        gains = filtered_inverse(frames.filter, self.spectrum.eigenvalues, frames.parameter)
        maps = [np.asarray(self.spectrum.solve(part * g)) for part, g in zip(rows, gains)]
        return np.stack(maps)[:, :, list(self.columns)]

    def _weights(self, frames: Frames, values: Floats) -> Iterator[tuple[slice, Floats, Floats]]:
        """For batches of frames: the slice, their amplitude (frame, 1), and e (frame, n) at the eigenvalues ``values``."""
        size, noise, parameter = (each[:, None] for each in frames[:3])
        safe = np.where(values > 0, values, 1.0)
        for start in range(0, len(parameter), CHUNK):
            part = slice(start, start + CHUNK)
            phi = np.where(values > 0, frames.filter(values[None, :], parameter[part]), 0.0)
            yield part, size[part], size[part] * (1.0 - phi) ** 2 + noise[part] * phi**2 / safe


@dataclass(frozen=True)
class Uncertainty:
    """Parameter and assumed sizes of noise and traction for each frame (*batch).

    Give either ``noise`` sigma^2 and ``amplitude`` alpha (*batch), or ``data`` (*batch, n) to estimate them (|c|^2 per
    datum; without a spectrum, the whitened readings) with the lower bound ``floor`` (*batch) of the noise variance,
    None if the noise is known. ``patterns`` (*batch, direction, n) are B L, where L L^T is the covariance of the sizes
    of nuisances.
    """

    parameter: Floats
    noise: Floats | None = None
    amplitude: Floats | None = None
    data: Floats | None = None
    floor: Floats | None = None
    patterns: Floats | None = None

    def changed(self, change: Callable[[Any], Any]) -> Uncertainty:
        """A copy with ``change`` applied to every array."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        made: dict[str, Any] = {name: None if v is None else change(v) for name, v in values.items()}
        return Uncertainty(**made)


class LinearErrors(Deferred, Errors):
    """`Errors` of linear estimates; each field is computed at first use."""

    _made_of: Source

    @classmethod
    def of(cls, variances: Variances, filter_factors: Filter, traction: Any, known: Uncertainty) -> LinearErrors:
        """Errors for ``traction`` (*batch, component, *surface), given the parameters of each frame in ``known``."""
        out: LinearErrors = object.__new__(cls)
        object.__setattr__(out, "_made_of", Source(variances, filter_factors, traction, known))
        return out

    def __getattr__(self, name: str) -> Any:
        source = self.__dict__.get("_made_of")
        if source is None or name not in _NAMES:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        value = np.asarray(getattr(source, "traction_error" if name == "traction" else name)())
        value.flags.writeable = False
        object.__setattr__(self, name, value)
        return value

    def __reduce__(self) -> Any:
        return Errors, tuple(getattr(self, name) for name in _NAMES)  # a copy elsewhere needs no spectrum

    def work_out(self) -> None:
        for name in _NAMES:
            getattr(self, name)

    @property
    def deferred(self) -> bool:
        """Whether some fields are still to be computed."""
        return "_made_of" in self.__dict__

    def draws(self, count: int, rng: np.random.Generator) -> Floats:
        """Samples of the posterior (frame, draw, component, *surface); `Unsupported` if solved by a decomposition."""
        return self._made_of.draws(count, rng)

    def inputs(self) -> Iterator[tuple[str, Any]]:
        """The inputs of the fields."""
        yield "parameter", self._made_of.known.parameter

    def changed(self, change: Callable[[Any], Any]) -> LinearErrors:
        """Apply ``change``, an index operation on batch axes, to computed fields and to those still to be computed."""
        source = self._made_of
        out = self.of(source.variances, source.filter, change(source.traction), source.known.changed(change))
        for name in _NAMES:
            if name in self.__dict__:
                object.__setattr__(out, name, change(self.__dict__[name]))
        return out


_NAMES = tuple(f.name for f in fields(Errors))


@dataclass(frozen=True)
class Source:
    """Computes the errors of some frames from their traction and parameters."""

    variances: Variances
    filter: Filter
    traction: Any
    known: Uncertainty

    def draws(self, count: int, rng: np.random.Generator) -> Floats:
        """Samples of the posterior (frame, draw, component, *surface): the estimate plus its errors for random
        traction and noise.
        """
        columns = list(self.variances.columns)
        out = np.repeat(self._all[:, None], count, axis=1)
        for i in range(self._count):
            error = self.variances.errors(self._frames, i, count, rng)
            if self._patterns is not None:
                weights = rng.standard_normal((count, len(self._patterns[i])))
                error += np.tensordot(weights, self._patterns[i], axes=1)
            out[i][:, columns] += error
        return out

    # -- maps

    def traction_error(self) -> Floats:
        return self._everywhere(np.sqrt(self._cells()))

    def variance_reduction(self) -> Floats:
        prior = self.variances.prior
        size = self._frames.amplitude.reshape(-1, *(1,) * prior.ndim)
        with np.errstate(divide="ignore", invalid="ignore"):
            part = 1.0 - self._cells() / (size * prior)
        return self._everywhere(np.clip(part, 0.0, 1.0), fill=math.nan)

    def _cells(self) -> Floats:
        """Variance in every cell, as `Variances.of_cells`, with that of nuisances."""
        variance = self.variances.of_cells(self._frames)
        return variance if self._patterns is None else variance + (self._patterns**2).sum(axis=1)

    # -- numbers

    def force(self) -> Floats:
        grid, columns = self.variances.grid, list(self.variances.columns)
        variance = self._summed("force", grid.force_rows(columns))
        axes = list(grid.force_axes(columns))
        total = grid.total_force(self._all)[:, axes]
        out = np.zeros((len(variance), len(grid.components)))
        out[:, axes] = np.sqrt(variance + (MODEL_FORCE * total) ** 2)
        out[:, [c for c, seen in zip(columns, self.variances.mean_seen) if not seen]] = math.nan
        return self._batched(out)

    def moment(self) -> Floats:
        grid, columns = self.variances.grid, list(self.variances.columns)
        out = np.sqrt(self._summed("moment", moment_rows(grid)[:, columns]))
        lost = {c for c, seen in zip(columns, self.variances.mean_seen) if not seen}
        needs = [{1}] if grid.dimensions == 1 else [{2}, {2}, {0, 1}]
        out[:, [i for i, n in enumerate(needs) if n & lost]] = math.nan
        return self._batched(out)

    def center(self) -> Floats:
        out = np.full((self._count, self.variances.grid.dimensions), math.nan)
        if self._presses and self.variances.mean_seen[-1]:
            out = np.sqrt(self._of_pressure(self._center_rows))
            out[self._pressure.max(axis=1) <= 0] = math.nan
        return self._batched(out)

    def peak(self) -> Floats:
        if not self._presses:
            return self._batched(np.full(self._count, math.nan))
        return self._batched(np.sqrt(self._of_pressure(self._peak_rows)[:, 0]))

    def _center_rows(self, part: slice) -> Floats:
        """Derivative of the centre of pressure with respect to pressure (frame, axis, *surface) for some frames."""
        grid = self.variances.grid
        return np.stack([center_rows(grid, p.reshape(grid.shape)) for p in self._pressure[part]])

    def _peak_rows(self, part: slice) -> Floats:
        """Derivative of the peak pressure with respect to pressure (frame, 1, *surface) for some frames."""
        pressure = self._pressure[part]
        rows = np.zeros(pressure.shape)
        rows[np.arange(len(rows)), pressure.argmax(axis=1)] = 1.0
        return rows.reshape(-1, 1, *self.variances.grid.shape)

    def _summed(self, name: str, rows: Floats) -> Floats:
        """Variance (frame, row) of the same sums of all frames; ``name`` identifies the rows in a cache."""
        return self.variances.of_sums(self._frames, name, rows) + self._of_patterns(PATTERN * rows)

    def _of_pressure(self, rows: Callable[[slice], Floats]) -> Floats:
        """Variance (frame, row) of sums ``rows`` (frame, row, *surface) of the pressure for some frames."""

        def whole(part: slice) -> Floats:
            here = rows(part)
            out = np.zeros((*here.shape[:2], len(self.variances.columns), *here.shape[2:]))
            out[:, :, -1] = here
            return out

        variance = self.variances.of_own_sums(self._frames, whole)
        return variance if self._patterns is None else variance + self._of_patterns(whole(slice(None)))

    def _of_patterns(self, rows: Floats) -> Any:
        """Variance (frame, row) that nuisances add to sums (row, component sought, *surface), of each frame or of all."""
        if self._patterns is None:
            return 0.0
        flat = rows.reshape(*rows.shape[: -1 - self.variances.grid.dimensions], -1)
        patterns = self._patterns.reshape(*self._patterns.shape[:2], -1)
        return ((patterns @ np.swapaxes(flat, -1, -2)) ** 2).sum(axis=1)

    # -- loads outside the measured area: they are extrapolated smoothly, but the edge of a contact is not smooth

    def outside_traction(self) -> Floats:
        return self._batched(np.abs(self._all) * self._outside)

    def outside_force(self) -> Floats:
        return self._batched(np.abs(self.variances.grid.total_force(self._all * self._outside)))

    def outside_moment(self) -> Floats:
        return self._batched(np.abs(self.variances.grid.total_moment(self._all * self._outside)))

    def outside_center(self) -> Floats:
        out = np.zeros((self._count, self.variances.grid.dimensions))
        far = np.flatnonzero(self._outside)
        if self._presses and len(far):
            rows = self._center_rows(slice(None)).reshape(*out.shape, -1)[..., far]
            out = np.abs((rows * self._pressure[:, None, far]).sum(axis=-1))
        return self._batched(out)

    def outside_peak(self) -> Floats:
        top = self._pressure.argmax(axis=1)
        return self._batched(np.abs(self._pressure[np.arange(self._count), top]) * self._outside.ravel()[top])

    def beyond_force(self) -> Floats:
        return self._batched(np.zeros((self._count, self._all.shape[1])))

    # -- helpers

    @property
    def _count(self) -> int:
        return int(np.size(self.known.parameter))

    @property
    def _presses(self) -> bool:
        """Whether pressure was sought."""
        return self.variances.columns[-1] == len(self.variances.grid.components) - 1

    @property
    def _all(self) -> Any:
        """Traction (frame, component, *surface)."""
        grid = self.variances.grid
        return to_numpy(self.traction).reshape(-1, len(grid.components), *grid.shape).astype(np.float64, copy=False)

    @property
    def _pressure(self) -> Any:
        """Pressure (frame, cell)."""
        return self._all[:, -1].reshape(self._count, -1)

    @property
    def _outside(self) -> npt.NDArray[np.bool_]:
        """Cells (*surface) outside the outermost taxels; a periodic surface has none."""
        grid, operator = self.variances.grid, self.variances.operator
        out = np.zeros(grid.shape, dtype=bool)
        if operator.boundary == "periodic":
            return out
        points = np.concatenate([a.points[np.ravel(a.valid)] for a in operator.planes_of])
        for axis, (x, dx) in enumerate(zip(grid.axes, grid.spacings)):
            low, high = points[:, axis].min() - 0.5 * dx, points[:, axis].max() + 0.5 * dx
            beyond = (x < low - 1e-9 * dx) | (x > high + 1e-9 * dx)
            out |= beyond.reshape([-1 if a == axis else 1 for a in range(grid.dimensions)])
        return out

    @cached_property
    def _frames(self) -> Frames:
        known, parameter = self.known, np.reshape(self.known.parameter, -1)
        if known.amplitude is not None and known.noise is not None:
            return Frames(np.reshape(known.amplitude, -1), np.reshape(known.noise, -1), parameter, self.filter)
        if known.data is None:
            raise RuntimeError("neither the sizes of noise and traction are given nor what tells them")
        floor = None if known.floor is None else np.reshape(known.floor, -1)
        data = known.data.reshape(self._count, -1)
        return Frames(*self.variances.sizes(data, floor, parameter, self.filter), parameter, self.filter)

    @cached_property
    def _patterns(self) -> Floats | None:
        """The estimate's response to the patterns (frame, direction, component sought, *surface)."""
        rows = self.known.patterns
        return (
            None if rows is None else self.variances.response(self._frames, rows.reshape(self._count, *rows.shape[-2:]))
        )

    def _batched(self, values: Floats) -> Floats:
        return values.reshape((*np.shape(self.known.parameter), *values.shape[1:]))

    def _everywhere(self, values: Floats, fill: float = 0.0) -> Floats:
        """(*batch, component, *surface) of maps of the components sought."""
        grid = self.variances.grid
        out = np.full((len(values), len(grid.components), *grid.shape), fill)
        out[:, list(self.variances.columns)] = values
        return self._batched(out)
