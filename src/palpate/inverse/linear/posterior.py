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

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import to_numpy
from palpate._batches import Deferred
from palpate._memory import require
from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.errors import Unsupported
from palpate.inverse.estimate import Errors
from palpate.inverse.linear.fourier import FourierSpectrum
from palpate.inverse.linear.memory import spectrum_memory
from palpate.inverse.linear.parameter import Filter, amplitude
from palpate.inverse.linear.spectrum import Spectrum
from palpate.sensing.grids import Grid

__all__ = [
    "FINEST",
    "PATTERN",
    "UNEXPLAINED",
    "LinearErrors",
    "Source",
    "Uncertainty",
    "Variances",
    "center_rows",
    "moment_rows",
    "unexplained",
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


def unexplained(filter_factors: Filter, spectrum: Spectrum, parameter: Floats) -> Floats:
    """Fraction of the readings' degrees of freedom in the residual, for a parameter (frame,)."""
    counts = spectrum.multiplicity
    return np.asarray((1.0 - filter_factors(spectrum.eigenvalues[None, :], parameter[:, None])) @ counts / counts.sum())


def finest(spectrum: Spectrum, power: Floats) -> Floats:
    """Mean power (frame,) of the coefficients to which traction contributes least: an upper bound of white noise."""
    order = np.argsort(spectrum.eigenvalues, kind="stable")
    counts = spectrum.multiplicity[order]
    least = np.cumsum(counts) <= max(FINEST * counts.sum(), counts[0])
    return np.asarray((power[:, order] * counts * least).sum(axis=1) / np.maximum((counts * least).sum(), 1.0))


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


class Variances:
    """Prior and posterior variances of sums of the traction, for any parameter: the part that does not depend on the frame."""

    def __init__(self, spectrum: Spectrum, grid: Grid, columns: tuple[int, ...]) -> None:
        self.spectrum, self.grid, self.columns = spectrum, grid, columns
        self.operator = spectrum.operator

    @property
    def nbytes(self) -> int:
        """Memory in bytes."""
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

    @cached_property
    def force(self) -> tuple[Floats, Floats]:
        """See `Spectrum.sums`: the net force of each component sought."""
        return self.spectrum.sums(self.grid.force_rows(self.columns))

    @cached_property
    def moment_rows(self) -> Floats:
        """The moments as sums over cells (moment, component sought, *surface)."""
        return moment_rows(self.grid)[:, list(self.columns)]

    @cached_property
    def moment(self) -> tuple[Floats, Floats]:
        """See `Spectrum.sums`."""
        return self.spectrum.sums(self.moment_rows)

    @cached_property
    def outside(self) -> Any:
        """Cells (*surface) outside the outermost taxels; a periodic surface has none."""
        grid, planes = self.grid, self.operator.planes_of
        out = np.zeros(grid.shape, dtype=bool)
        if self.operator.boundary == "periodic":
            return out
        points = np.concatenate([a.points[np.ravel(a.valid)] for a in planes])
        for axis, (x, dx) in enumerate(zip(grid.axes, grid.spacings)):
            low, high = points[:, axis].min() - 0.5 * dx, points[:, axis].max() + 0.5 * dx
            beyond = (x < low - 1e-9 * dx) | (x > high + 1e-9 * dx)
            out |= beyond.reshape([-1 if a == axis else 1 for a in range(grid.dimensions)])
        return out

    @property
    def mean_seen(self) -> Any:
        """Whether the readings depend on the mean of each component sought."""
        if isinstance(self.spectrum, FourierSpectrum):
            return self.spectrum.mean_seen
        return np.ones(len(self.columns), dtype=bool)


@dataclass(frozen=True)
class Uncertainty:
    """Parameter and assumed sizes of noise and traction for each frame (*batch).

    Give either ``noise`` sigma^2 and ``amplitude`` alpha (*batch), or the data to estimate them: ``power`` |c|^2 per
    datum (*batch, n), and the lower bound ``floor`` (*batch) of the noise variance, None if the noise is known.
    ``patterns`` (*batch, direction, n) are B L, where L L^T is the covariance of the sizes of nuisances. Without a
    spectrum, ``rows`` (*batch, n) of the readings replace ``power``.
    """

    parameter: Floats
    noise: Floats | None = None
    amplitude: Floats | None = None
    power: Floats | None = None
    floor: Floats | None = None
    patterns: Floats | None = None
    rows: Floats | None = None

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
        return cls.made_of(Source(variances, filter_factors, traction, known))

    @classmethod
    def made_of(cls, source: Source) -> LinearErrors:
        """Errors from a source of the fields."""
        out: LinearErrors = object.__new__(cls)
        object.__setattr__(out, "_made_of", source)
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
        with self._made_of.together():
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
        source = self._made_of
        yield "parameter", source.known.parameter

    def changed(self, change: Callable[[Any], Any]) -> LinearErrors:
        """Apply ``change``, an index operation on batch axes, to computed fields and to those still to be computed."""
        source = self._made_of
        out = self.made_of(replace(source, traction=change(source.traction), known=source.known.changed(change)))
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
        """Raise `Unsupported`: samples are only available from the matrix-free method."""
        raise Unsupported(
            "samples of the posterior are drawn where the problem is solved by iteration, not of a decomposition."
        )

    # -- maps

    def traction_error(self) -> Floats:
        nodes, powers, rest = self.variances.cells
        return self._everywhere(np.sqrt(self._cells(nodes, powers, rest)))

    def variance_reduction(self) -> Floats:
        nodes, powers, rest = self.variances.cells
        size = self._sizes[0][:, None]
        prior = rest.ravel() + powers.reshape(len(nodes), -1).sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            part = 1.0 - self._cells(nodes, powers, rest).reshape(len(size), -1) / (size * prior)
        shape = (len(part), len(self.variances.columns), *rest.shape[1:])
        return self._everywhere(np.clip(part, 0.0, 1.0).reshape(shape), fill=math.nan)

    def _cells(self, nodes: Floats, powers: Floats, rest: Floats) -> Floats:
        """Variance of the traction in every cell, (frame, component sought, *surface), from the three arrays of
        `Spectrum.cells`. If it is the same in all cells, the axes of the surface have length 1.
        """
        flat, left = powers.reshape(len(nodes), -1), rest.ravel()
        parts = []
        for part, size, weights in self._weights(nodes):
            variance = (np.maximum(weights @ flat, 0.0) + size * left).reshape(-1, *rest.shape)
            if self._patterns is not None:
                variance = variance + (self._patterns[part] ** 2).sum(axis=1)
            parts.append(variance)
        return np.concatenate(parts)

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
        out = np.sqrt(self._summed("moment", self.variances.moment_rows))
        lost = {c for c, seen in zip(self.variances.columns, self.variances.mean_seen) if not seen}
        needs = [{1}] if self.variances.grid.dimensions == 1 else [{2}, {2}, {0, 1}]
        out[:, [i for i, n in enumerate(needs) if n & lost]] = math.nan
        return self._batched(out)

    def center(self) -> Floats:
        grid = self.variances.grid
        out = np.full((self._count, grid.dimensions), math.nan)
        if not self._presses or not self.variances.mean_seen[-1]:
            return self._batched(out)
        out = np.sqrt(self._of_pressure(self._center_rows))
        out[self._all[:, -1].reshape(self._count, -1).max(axis=1) <= 0] = math.nan
        return self._batched(out)

    def _center_rows(self, part: slice) -> Floats:
        """Return the derivative of the centre of pressure with respect to pressure (frame, axis, *surface) for some frames."""
        grid = self.variances.grid
        some = to_numpy(self.traction).reshape(-1, len(grid.components), *grid.shape)[part, -1].astype(np.float64)
        return np.stack([center_rows(grid, p) for p in some])

    def peak(self) -> Floats:
        if not self._presses:
            return self._batched(np.full(self._count, math.nan))
        return self._batched(np.sqrt(self._of_cells(self._all[:, -1].reshape(self._count, -1).argmax(axis=1))))

    def _summed(self, name: str, rows: Floats) -> Floats:
        """Variance (frame, row) of sums ``rows`` w that are the same in all frames, cached under a name."""
        powers, rest = self.variances.force if name == "force" else self.variances.moment
        parts = []
        for part, size, weights in self._weights(self.variances.spectrum.eigenvalues):
            variance = weights @ powers.T + size * rest
            if self._patterns is not None:
                here = self._patterns[part]
                inner = here.reshape(*here.shape[:2], -1) @ rows.reshape(len(rows), -1).T
                variance = variance + ((PATTERN * inner) ** 2).sum(axis=1)
            parts.append(variance)
        return np.concatenate(parts)

    def _of_pressure(self, rows: Callable[[slice], Floats]) -> Floats:
        """Variance (frame, row) of sums of the pressure that differ between frames: ``rows`` (frame, row, *surface)
        for some frames.
        """
        parts = []
        for part, size, weights in self._weights(self.variances.spectrum.eigenvalues):
            here = rows(part)
            powers, rest = self.variances.spectrum.sums(self._only_pressure(here.reshape(-1, *here.shape[2:])))
            variance = (weights[:, None, :] * powers.reshape(*here.shape[:2], -1)).sum(axis=-1)
            variance = variance + size * rest.reshape(here.shape[:2])
            if self._patterns is not None:
                flat = here.reshape(*here.shape[:2], -1)
                patterns = self._patterns[part][:, :, -1]
                inner = flat @ np.swapaxes(patterns.reshape(*patterns.shape[:2], -1), 1, 2)
                variance = variance + (inner**2).sum(axis=-1)
            parts.append(variance)
        return np.concatenate(parts)

    def _of_cells(self, cells: npt.NDArray[np.intp]) -> Floats:
        """Variance (frame,) of the pressure in one cell (flat index) of each frame."""
        parts = []
        for part, size, weights in self._weights(self.variances.spectrum.eigenvalues):
            # Consecutive frames often have their peak in the same cell.
            each, places = np.unique(cells[part], return_inverse=True)
            rows = np.zeros((len(each), math.prod(self.variances.grid.shape)))
            rows[np.arange(len(each)), each] = 1.0
            powers, rest = self.variances.spectrum.sums(
                self._only_pressure(rows.reshape(-1, *self.variances.grid.shape))
            )
            variance = (weights * powers[places]).sum(axis=-1) + size[:, 0] * rest[places]
            if self._patterns is not None:
                patterns = self._patterns[part][:, :, -1]
                flat = patterns.reshape(*patterns.shape[:2], -1)
                variance = variance + (flat[np.arange(len(flat)), :, cells[part]] ** 2).sum(axis=-1)
            parts.append(variance)
        return np.concatenate(parts)

    def _only_pressure(self, rows: Floats) -> Floats:
        """Sums (row, *surface) of the pressure as sums (row, component sought, *surface)."""
        out = np.zeros((len(rows), len(self.variances.columns), *rows.shape[1:]))
        out[:, -1] = rows
        return out

    # -- loads outside the measured area: they are extrapolated smoothly, but the edge of a contact is not smooth

    def outside_traction(self) -> Floats:
        return self._batched(np.abs(self._all) * self.variances.outside)

    def outside_force(self) -> Floats:
        return self._batched(np.abs(self.variances.grid.total_force(self._far)))

    def outside_moment(self) -> Floats:
        return self._batched(np.abs(self.variances.grid.total_moment(self._far)))

    def outside_center(self) -> Floats:
        out = np.zeros((self._count, len(self._places)))
        if self._presses:
            far = np.flatnonzero(self.variances.outside)
            if len(far):
                rows = self._center_rows(slice(None)).reshape(*out.shape, -1)[..., far]
                pressure = self._all[:, -1].reshape(self._count, -1)[:, None, far]
                out = np.abs((rows * pressure).sum(axis=-1))
        return self._batched(out)

    def outside_peak(self) -> Floats:
        pressure = self._all[:, -1].reshape(self._count, -1)
        top = pressure.argmax(axis=1)
        there = self.variances.outside.ravel()[top]
        return self._batched(np.abs(pressure[np.arange(self._count), top]) * there)

    def beyond_force(self) -> Floats:
        return self._batched(np.zeros((self._count, self._all.shape[1])))

    # -- helpers

    def _weights(self, values: Floats) -> Iterator[tuple[slice, Floats, Floats]]:
        """For batches of frames: the slice, their prior amplitude (frame, 1), and e (frame, n) at the eigenvalues
        ``values``.
        """
        if values is not self.variances.spectrum.eigenvalues or "_kept" not in self.__dict__:
            return self._worked_weights(values)
        if not self.__dict__["_kept"]:
            self.__dict__["_kept"].extend(self._worked_weights(values))
        return iter(self.__dict__["_kept"])

    @contextmanager
    def together(self) -> Iterator[None]:
        """Context in which intermediate results that several fields share are cached, with as much memory as the
        traction.
        """
        self.__dict__["_kept"] = []
        try:
            yield
        finally:
            del self.__dict__["_kept"]

    def _worked_weights(self, values: Floats) -> Iterator[tuple[slice, Floats, Floats]]:
        parameter = np.reshape(self.known.parameter, (-1, 1))
        size, noise = (each[:, None] for each in self._sizes)
        safe = np.where(values > 0, values, 1.0)
        for start in range(0, len(parameter), CHUNK):
            part = slice(start, start + CHUNK)
            phi = np.where(values > 0, self.filter(values[None, :], parameter[part]), 0.0)
            yield part, size[part], size[part] * (1.0 - phi) ** 2 + noise[part] * phi**2 / safe

    @property
    def _batch(self) -> tuple[int, ...]:
        return tuple(np.shape(self.known.parameter))

    @property
    def _count(self) -> int:
        return math.prod(self._batch)

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
    def _far(self) -> Any:
        """Traction (frame, component, *surface) of the cells outside the outermost taxels."""
        return self._all * self.variances.outside

    @property
    def _places(self) -> Any:
        """x, then y of every cell."""
        return np.stack(np.meshgrid(*self.variances.grid.axes, indexing="ij")[::-1])

    @cached_property
    def _patterns(self) -> Floats | None:
        """The estimate's response to the patterns (frame, direction, component sought, *surface)."""
        if self.known.patterns is None:
            return None
        rows = self.known.patterns.reshape(self._count, -1, self.known.patterns.shape[-1])
        values = self.variances.spectrum.eigenvalues
        phi = self.filter(values[None, :], np.reshape(self.known.parameter, (-1, 1)))
        gain = np.where(values > 0, phi / np.sqrt(np.where(values > 0, values, 1.0)), 0.0)
        maps = [np.asarray(self.variances.spectrum.solve(part * g)) for part, g in zip(rows, gain)]
        return np.stack(maps)[:, :, list(self.variances.columns)]

    @cached_property
    def _sizes(self) -> tuple[Floats, Floats]:
        """Prior amplitude and noise variance (frame,); NaN if all readings are zero."""
        known = self.known
        if known.amplitude is not None and known.noise is not None:
            return np.reshape(known.amplitude, -1), np.reshape(known.noise, -1)
        if known.power is None:
            raise RuntimeError("neither the sizes of noise and traction are given nor what tells them")
        spectrum = self.variances.spectrum
        power = known.power.reshape(self._count, -1)
        floor = None if known.floor is None else np.reshape(known.floor, -1)
        size, noise = amplitude(spectrum.eigenvalues, spectrum.multiplicity, power, floor, tried=spectrum.tried)
        if floor is not None:
            blind = unexplained(self.filter, spectrum, np.reshape(known.parameter, -1)) < UNEXPLAINED
            noise = np.where(blind, np.maximum(noise, finest(spectrum, power)), noise)
            nothing = power @ spectrum.multiplicity == 0
            size, noise = np.where(nothing, np.nan, size), np.where(nothing, np.nan, noise)
        return size, noise

    def _batched(self, values: Floats) -> Floats:
        return values.reshape((*self._batch, *values.shape[1:]))

    def _everywhere(self, values: Floats, fill: float = 0.0) -> Floats:
        """(*batch, component, *surface) of maps of the components sought."""
        grid = self.variances.grid
        out = np.full((len(values), len(grid.components), *grid.shape), fill)
        out[:, list(self.variances.columns)] = values
        return self._batched(out)
