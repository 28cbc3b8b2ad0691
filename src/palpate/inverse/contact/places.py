"""Models of concentrated traction, one for each correlation length (`palpate.inverse.contact.local`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg

from palpate._threads import cached_property, few_threads
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import Level
from palpate.inverse.fit import rms
from palpate.inverse.linear.matrix_free.evidence import LinearAtSize
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.inverse.linear.patterns import SIZES
from palpate.inverse.linear.regularised import Regularised
from palpate.inverse.linear.spectrum import in_components
from palpate.inverse.linear.whitening import Readings
from palpate.inverse.problem import Problem
from palpate.sensing.arrays import ScatteredArray

__all__ = ["Data", "Member", "Places", "Start"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]

#: Correlation lengths: FIRST taxel pitches, then LENGTHS - 1 more, each twice the one before.
FIRST, LENGTHS = 0.5, 4
#: Width of the moving average that estimates the local variance, in correlation lengths; and the smallest width, in cells.
WIDTH, LEAST_WIDTH = 0.6, 0.5
#: Cells below this fraction of the largest variance are left out: a tenth of the largest traction.
QUIET = 0.01
#: Largest number of unknowns of a frame. If there are more, traction is everywhere and not concentrated.
LARGEST = 2400
#: The cells left out are grouped in TILES tiles per component. Their traction has one of these fractions of their
#: variance: 0 for no traction, or more for weak traction everywhere.
TILES, AROUND = 36, (0.0, 0.3)
#: Finer cells matter because traction may end inside a cell: candidate divisions per axis, finest first, and a limit on
#: the multiplications of a normal matrix.
RATIOS, WORK = (3, 2, 1), 8e9
#: Largest number of entries in the columns of all readings: 320 MB.
ENTRIES = 4e7
#: Added to the diagonal of the correlations: they are singular to rounding if cells are much finer than the length.
JITTER = 1e-6
#: Number of rounds in which the noise is estimated together with the traction.
ROUNDS = 2
#: The log evidence is divided by this before models are weighted. The variance was estimated from the same readings,
#: and errors from cells and edges, which no model can follow, affect the choice as much as the readings do.
TEMPER = 30.0
#: Smallest log evidence from which a frame has traction. Frames of noise alone stay below 2, and a model with almost no traction would
#: be almost certain of it.
SEEN = 5.0
#: Models of less weight are left out.
LEAST_WEIGHT = 1e-3


@dataclass
class Member:
    """The model of a frame for one correlation length: traction and its posterior.

    ``root`` (direction, component * cell) is one standard deviation along each direction of the posterior. ``apply``
    (component * cell, reading) maps whitened readings to the estimate (empty unless needed). ``beyond`` (component,
    *surface) is the variance of cells left out, ``prior`` the prior variance of the others. Fields ``around``
    (unknown, component, *surface) over the cells left out are part of the traction, with ``around_root`` (direction,
    unknown).
    """

    cells: Index
    traction: Floats
    root: Floats
    around: Floats
    around_root: Floats
    apply: Floats
    beyond: Floats
    prior: Floats
    length: float
    noise: float
    taken: float
    left: Floats
    evidence: float
    sizes: Floats
    spread: Floats
    weight: float = 0.0

    @cached_property
    def variance(self) -> Floats:
        """Posterior variance of the traction (component * cell,)."""
        return np.asarray((self.root**2).sum(axis=0))


@dataclass(frozen=True)
class Start:
    """Tikhonov's result for a frame: traction (component sought, *surface), noise variance in units of the whitening,
    regularisation parameter.
    """

    traction: Floats
    noise: float
    parameter: float


@dataclass(frozen=True)
class Data:
    """Readings of a frame per plane, the same whitened (reading,), and the mask of those used."""

    planes: list[Floats]
    y: Floats
    observed: Flags
    start: Start


class Places:
    """The models of a problem's frames. ``alone`` is Tikhonov's method, both their start and the alternative; with
    ``applied`` the models keep the map from readings to traction.
    """

    def __init__(self, problem: Problem, alone: Regularised | MatrixFree, *, applied: bool) -> None:
        self.problem, self.alone, self.applied = problem, alone, applied
        self.operator, self.columns, self.grid = problem.operator, problem.columns, problem.operator.surface
        self.known = alone.noise_known
        self.readings = Readings(self.operator, alone.scales)
        self.every = np.ones(len(self.readings.std), dtype=bool)
        self._levels: dict[int, Level] = {}
        patterns = alone.patterns
        self.patterns = [] if patterns is None else patterns.all
        rows = [self.white(p.rows[None])[0] for p in self.patterns]
        size = [rms(r) or 1.0 for r in rows]
        #: Patterns scaled to a root mean square of one, and the size of each in its own unit.
        self.units = np.array([1.0 / s for s in size])
        self.rows = np.stack(rows) * self.units[:, None] if rows else np.zeros((0, len(self.every)))
        #: Groups of components with a common variance: those in the plane, and pressure.
        last = len(self.grid.components) - 1
        self.groups = [[i for i, c in enumerate(self.columns) if (c == last) == normal] for normal in (False, True)]

    def white(self, rows: Floats) -> Floats:
        """Whitened readings (row, reading): independent, with unit noise."""
        return np.asarray(self.readings.white((rows / self.readings.std).T, self.every).T)

    @cached_property
    def lengths(self) -> list[float]:
        """Correlation lengths [m]."""
        spacing, apart = min(self.grid.spacings), math.inf
        for array in self.operator.planes_of:
            if isinstance(array, ScatteredArray):
                spans = np.maximum(np.ptp(array.points, axis=0), spacing)
                apart = min(apart, float((np.prod(spans) / len(array.points)) ** (1.0 / len(spans))))
            else:
                apart = min(apart, *array.grid.spacings)
        return [FIRST * max(apart, spacing) * 2.0**i for i in range(LENGTHS)]

    def members(self, data: Data, *, told: bool = False) -> list[Member]:
        """The models of a frame, with their weights; empty if its traction is not concentrated or if there is none.
        With ``told``, the noise in ``data`` is used unchanged.
        """
        import scipy.ndimage

        first = data.start.traction
        floor = (MODEL_ERROR * float(np.abs(data.y[data.observed]).max(initial=0.0))) ** 2
        noise = max(data.start.noise, floor)
        if not noise > 0.0 or not first.any():
            return []

        def of(length: float) -> list[Member]:
            width = [max(WIDTH * length, LEAST_WIDTH * min(self.grid.spacings)) / dx for dx in self.grid.spacings]
            variance = np.zeros_like(first)
            for group in (g for g in self.groups if g):
                mean = scipy.ndimage.gaussian_filter((first[group] ** 2).mean(axis=0), width, mode="constant")
                variance[group] = mean
            size = variance.max(axis=0)
            keep = size > QUIET * size.max()
            unknowns = len(first) * int(keep.sum())
            if unknowns > LARGEST or unknowns * len(data.y) > ENTRIES:
                return []
            return self._of_length(data, variance, keep, length, noise, floor, told=told)

        members: list[Member] = []
        evidence: list[float] = []
        with few_threads(LARGEST):
            for length in self.lengths:
                found = of(length)
                if found:
                    evidence.append(max(m.evidence for m in found))
                    members += found
                    members = [m for m in members if m.evidence > max(evidence) + TEMPER * math.log(LEAST_WEIGHT)]
                if len(evidence) > 2 and evidence[-1] < evidence[-2] < evidence[-3]:
                    break  # the evidence decreases with length
        best = max((m.evidence for m in members), default=-math.inf)
        if not best > self._nothing(data) + SEEN:
            return []
        if not told and data.observed.all() and not best > self._even(data, noise):
            return []
        for m in members:
            m.weight = math.exp((m.evidence - best) / TEMPER)
        total = sum(m.weight for m in members)
        for m in members:
            m.weight /= total
        return members

    def _of_length(
        self, data: Data, variance: Floats, keep: Flags, length: float, noise: float, floor: float, *, told: bool
    ) -> list[Member]:
        """The models for one correlation length; empty if rounding makes the system singular."""
        cells = np.flatnonzero(keep)
        c, q, k = len(variance), len(self.patterns), len(cells)
        ratio = self._ratio(c * k)
        level, parts = self._level(ratio), self._parts(cells, ratio)
        each = parts.shape[1]
        n, m = k * each, c * k * each
        grid = level.grid
        places = np.stack(np.unravel_index(parts.ravel(), grid.shape), axis=1) * np.asarray(grid.spacings)
        squares = ((places[:, None, :] - places[None, :, :]) ** 2).sum(axis=-1)
        root = scipy.linalg.cholesky(np.exp(-0.5 * squares / length**2) + JITTER * np.eye(n), lower=True)
        size = np.repeat(np.sqrt(variance.reshape(c, -1)[:, cells]), each, axis=1)
        rows = level.rows(parts.ravel(), self.readings.std, self.every).reshape(c, n, -1)
        y, big = data.y[data.observed], SIZES[-1] * math.sqrt(noise)
        if not y.any():
            return []
        around = self._around(variance, keep)
        all_rows = np.concatenate(
            [*(root.T @ (size[i][:, None] * rows[i]) for i in range(c)), big * self.rows, self._seen(around)]
        )
        every = all_rows if data.observed.all() else all_rows[:, data.observed]
        gram, linear = every @ every.T, every @ y
        sides = [self._means(root.T * size[i], k) for i in range(c)]  # (direction, cell)
        prior = np.stack([(side**2).sum(axis=0) for side in sides])
        beyond = np.where(keep, 0.0, variance)
        members = []
        for part in AROUND:
            # Scale the joint system by the variance of the surrounding tiles.
            scale = np.concatenate([np.ones(m + q), np.full(len(around), math.sqrt(part))])
            solved = self._solved(
                gram * scale[:, None] * scale, linear * scale, every * scale[:, None], y, noise, floor, told=told
            )
            if solved is None:
                continue
            found, inverse, taken, evidence, used, final = solved
            fields = math.sqrt(part) * around
            spread = np.concatenate([inverse[:, i * n : (i + 1) * n] @ side for i, side in enumerate(sides)], axis=1)
            traction = np.zeros((c, keep.size))
            traction[:, cells] = np.stack([found[i * n : (i + 1) * n] @ side for i, side in enumerate(sides)])
            unsure = big * inverse[:, m : m + q]
            apply = np.zeros((0, len(data.y)))
            if self.applied:
                apply = np.zeros((spread.shape[1], len(data.y)))
                apply[:, data.observed] = spread.T @ (inverse @ (every * scale[:, None])) / final
            members.append(
                Member(
                    cells=cells,
                    traction=traction.reshape(variance.shape) + np.tensordot(found[m + q :], fields, 1),
                    root=spread,
                    around=fields,
                    around_root=inverse[:, m + q :],
                    apply=apply,
                    beyond=beyond,
                    prior=prior,
                    length=length,
                    noise=used,
                    taken=taken,
                    left=data.y - (found * scale) @ all_rows,
                    evidence=evidence,
                    sizes=big * found[m : m + q],
                    spread=np.asarray((unsure**2).sum(axis=0)),
                )
            )
        return members

    @staticmethod
    def _means(values: Floats, cells: int) -> Floats:
        """Mean over the parts of each cell (last axis)."""
        return np.asarray(values.reshape(*values.shape[:-1], cells, -1).mean(axis=-1))

    def _solved(
        self, gram: Floats, linear: Floats, rows: Floats, y: Floats, noise: float, floor: float, *, told: bool
    ) -> tuple[Floats, Floats, float, float, float, float] | None:
        """Posterior for unknowns with prior variance 1: mean, root of the covariance, degrees of freedom used, log
        evidence, noise variance estimated, noise variance used.
        """
        known = told or self.known
        used = 1.0 if known and not told else noise
        for _ in range(1 if known else ROUNDS):
            noise = used
            matrix = gram / noise
            matrix[np.diag_indices(len(matrix))] += 1.0
            try:
                lower = scipy.linalg.cholesky(matrix, lower=True, overwrite_a=True)
            except np.linalg.LinAlgError:
                return None
            inverse = scipy.linalg.lapack.dtrtri(lower, lower=1)[0]
            found = inverse.T @ (inverse @ linear) / noise
            left = y - found @ rows
            taken = len(matrix) - float((inverse**2).sum())
            if not known:
                used = max(float(left @ left) / max(len(y) - taken, 1.0), floor)
        evidence = -0.5 * float(y @ left / noise + 2.0 * np.log(np.diag(lower)).sum() + len(y) * math.log(noise))
        return found, inverse, taken, evidence, used, noise

    def _nothing(self, data: Data) -> float:
        """Log evidence of noise and nuisances alone, comparable with `Member.evidence`."""
        y, rows = data.y[data.observed], self.rows[:, data.observed]
        left = y - rows.T @ np.linalg.lstsq(rows.T, y, rcond=None)[0] if len(rows) else y
        noise = 1.0 if self.known else float(left @ left) / max(len(y) - len(rows), 1)
        if not noise > 0.0:
            return -math.inf
        gram = np.eye(len(rows)) + SIZES[-1] ** 2 * rows @ rows.T
        explained = SIZES[-1] ** 2 * float((rows @ y) @ np.linalg.solve(gram, rows @ y))
        logdet = float(np.linalg.slogdet(gram)[1])
        return -0.5 * ((float(y @ y) - explained) / noise + logdet + len(y) * math.log(noise))

    def _even(self, data: Data, noise: float) -> float:
        """Log evidence of Tikhonov's model, comparable with `Member.evidence`."""
        noise, q = 1.0 if self.known else noise, len(self.patterns)
        if isinstance(self.alone, MatrixFree):
            frame = LinearAtSize(self.alone.system).frame()
            found = frame.evidence(data.planes, data.start.parameter, None, self.rows if q else None)
            logdet = found.logdet + 2.0 * q * math.log(SIZES[-1])
            return -0.5 * (found.objective / noise + logdet + len(data.y) * math.log(noise))
        spectrum = self.alone.spectrum
        c, values = np.asarray(spectrum.project([p[None] for p in data.planes]))[0], spectrum.eigenvalues
        weights = 1.0 / (1.0 + values / data.start.parameter)
        rows = SIZES[-1] * self._spread
        middle = np.eye(len(rows)) + (rows * weights) @ rows.T
        along = (rows * weights) @ c
        explained = float(c @ (weights * c) - along @ np.linalg.solve(middle, along))
        logdet = float(np.linalg.slogdet(middle)[1] - np.log(weights).sum())
        return -0.5 * (explained / noise + logdet + len(c) * math.log(noise))

    @cached_property
    def _spread(self) -> Floats:
        """The patterns' rows in the basis of the spectrum."""
        if self.alone.patterns is None or not self.patterns:
            return np.zeros((0, len(self.readings.std)))
        return self.alone.patterns.rows

    def _around(self, variance: Floats, keep: Flags) -> Floats:
        """Fields (unknown, component sought, *surface) of the cells left out, one for each tile, so that weak traction
        far away is not attributed to drift.

        Within a tile the traction has one sign, as traction that fades out does; the readings determine sign and size.
        """
        shape = self.grid.shape
        tiles = TILES if len(shape) == 1 else math.isqrt(TILES)
        places = [np.floor((np.arange(n) + 0.5) * min(tiles, n) / n).astype(int) for n in shape]
        number = places[0] if len(shape) == 1 else places[0][:, None] * tiles + places[1][None, :]
        fields = []
        for i, each in enumerate(variance):
            for tile in np.unique(number):
                here = (number == tile) & ~keep & (each > 0)
                if here.any():
                    field = np.zeros_like(variance)
                    field[i] = np.sqrt(each) * here
                    fields.append(field)
        return np.stack(fields) if fields else np.zeros((0, *variance.shape))

    def _seen(self, fields: Floats) -> Floats:
        """Whitened readings (unknown, reading) that fields (unknown, component sought, *surface) cause."""
        if not len(fields):
            return np.zeros((0, len(self.every)))
        whole = in_components(fields, self.columns, len(self.grid.components), self.grid.dimensions)
        planes = self.operator.forward(whole)
        return self.white(np.stack([self.readings.flat([p[i] for p in planes]) for i in range(len(fields))]))

    def _ratio(self, unknowns: int) -> int:
        """How many times finer than the surface grid to solve ``unknowns`` cell unknowns."""
        for ratio in RATIOS[:-1]:
            finer = unknowns * ratio**self.grid.dimensions
            if finer <= LARGEST and len(self.readings.std) * finer**2 <= WORK:
                return ratio
        return RATIOS[-1]

    def _level(self, ratio: int) -> Level:
        """The operator on cells ``ratio`` times finer; built once."""
        if ratio not in self._levels:
            operator = self.problem.kept.get(("level", False, ratio), lambda: self.operator.finer(ratio))
            self._levels[ratio] = Level(operator, ratio, self.columns, self.readings)
        return self._levels[ratio]

    def _parts(self, cells: Index, ratio: int) -> Index:
        """Indices (cell, part) of the finer cells that make up each surface cell."""
        shape = self.grid.shape
        places = np.unravel_index(cells, shape)
        steps = np.indices((ratio,) * len(shape)).reshape(len(shape), -1)
        fine = tuple(p[:, None] * ratio + s[None, :] for p, s in zip(places, steps))
        return np.asarray(np.ravel_multi_index(fine, tuple(x * ratio for x in shape)))
