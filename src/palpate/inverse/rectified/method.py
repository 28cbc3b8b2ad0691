"""method="rectified": contact as the positive part of a Gaussian process.

    y = s A t + B b + e,   p = max(f, 0),   q_j = p mu h_j / sqrt(1 + |h|^2)

with a Gaussian process f that has few positive values, offsets and broken readings b, and noise e that is given or learned. Pressure cannot pull and shear
stays inside the friction cone by construction. Explanations (push or pull, correlation length, offsets, broken readings, a discrepancy of the pad's
model, nothing at all) compete by one score, the log evidence with prior odds, and the result is their weighted mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from palpate._arrays import from_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone
from palpate.inverse.contact.methods import cone_of
from palpate.inverse.contact.policy import Policy as ContactPolicy
from palpate.inverse.contact.posterior import Posterior
from palpate.inverse.contact.summary import widened
from palpate.inverse.estimate import Errors, Estimate, Stated, batch_of, frames_of
from palpate.inverse.fit import MODEL_DETAIL, POOR_FIT, misfit_probability
from palpate.inverse.linear.posterior import center_rows, moment_rows
from palpate.inverse.linear.whitening import Readings
from palpate.inverse.method import Method, Needs, number
from palpate.inverse.problem import Problem
from palpate.inverse.rectified.newton import Mode
from palpate.inverse.rectified.policy import Policy
from palpate.inverse.rectified.posterior import CellPosterior, mixture
from palpate.inverse.rectified.prepared import Prepared
from palpate.inverse.rectified.search import Found, explain

__all__ = ["Rectified", "RectifiedEstimator"]


@dataclass(frozen=True, kw_only=True)
class Rectified(Method):
    """Contact as the positive part of a Gaussian process, solved by Newton steps in the space of the readings: for pressure on small arrays.

    Parameters
    ----------
    friction : float, optional
        Coefficient mu: |shear| <= mu * pressure in every cell. Without it, mu = 1.2 bounds the shear.

    Notes
    -----
    It serves up to 1000 readings and 6000 fine cells. Ramps and rotations are in the model only where ``Skin(..., nuisance=...)`` names them; offsets compete by evidence.
    Readings at the end of their range are taken as they are.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=25, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=20.0))
    >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
    >>> touch = skin.reconstruct(readings, method="rectified")
    >>> round(float(touch.force[1])), float(touch.pressure.min())  # [N/m], [Pa]
    (10, 0.0)
    """

    name: ClassVar[str] = "rectified"
    summary: ClassVar[str] = (
        "contact as a rectified Gaussian process, for small arrays: sharper on areas, slower, error bars"
    )
    needs: ClassVar[Needs] = Needs(free_boundary=True, pressure=True)
    error_bars: ClassVar[bool] = True
    narrows: ClassVar[bool] = True
    by_frame: ClassVar[bool] = True

    friction: float | None = number(help="coefficient of friction mu: |shear| <= mu * pressure in every cell")

    def prepare(self, problem: Problem) -> RectifiedEstimator:
        """Fine cells, their responses and kernels."""
        self.check(problem)
        return RectifiedEstimator(problem, cone_of(problem.components, self.friction))


class RectifiedEstimator:
    """The method prepared for a skin."""

    def __init__(self, problem: Problem, cone: Cone, policy: Policy | None = None) -> None:
        self.problem, self.cone = problem, cone
        self.prepared = Prepared(problem, policy or Policy(), cone.friction)
        self.operator, self.grid = problem.operator, problem.surface
        self.readings = Readings(
            self.operator, [np.asarray(a.noise_std or (1.0,) * len(a.channels)) for a in problem.planes]
        )
        inside = np.ones(self.grid.shape, dtype=bool)
        outside = self.prepared.means(self.prepared.outside.astype(np.float64)) > 0.5
        #: what frames without contact, few readings and cells beyond the taxels mean is the same for all methods that know contact
        self.contact = ContactPolicy()
        self.posterior = Posterior(self.operator, problem.columns, cone, inside, outside, 1, self.contact)

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane; every frame is decided alone."""
        batch = batch_of(readings, self.operator)
        rows = [self._frame(self.readings.flat(self.operator.observed(f))) for f in frames_of(readings, self.operator)]

        def gathered(name: str) -> Any:
            values = np.stack([np.asarray(getattr(r, name)) for r in rows])
            return values.reshape((*batch, *values.shape[1:]))

        def together(kind: type, name: str) -> dict[str, Floats]:
            out = {}
            for f in fields(kind):
                values = np.stack([np.asarray(getattr(getattr(r, name), f.name)) for r in rows])
                out[f.name] = values.reshape((*batch, *values.shape[1:]))
            return out

        names = tuple((pattern.label, pattern.unit) for pattern in self.prepared.patterns)
        stated = rows[0].stated is not None
        return Estimate(
            from_numpy(gathered("traction"), readings[0]),
            None,
            None,
            gathered("residual"),
            errors=Errors(**together(Errors, "errors")),
            stated=Stated(**together(Stated, "stated")) if stated else None,
            converged=gathered("converged"),
            contact=gathered("contact"),
            outliers=gathered("outliers"),
            noise_std=gathered("noise"),
            sign=gathered("sign"),
            fit=gathered("fit"),
            nuisance=gathered("nuisance"),
            nuisance_std=gathered("nuisance_std"),
            nuisance_names=names,
            discrepancy=gathered("discrepancy"),
            unexplained=gathered("unexplained"),
            undecided=gathered("undecided"),
            force_bounds=gathered("bounds"),
            said=_said(rows, batch),
        )

    def _frame(self, data: Floats) -> _Row:
        p = self.prepared
        found = explain(p, data)
        if found is None or found.nothing > 0.5 or not found.modes:
            return self._nothing(data, found)
        cells = mixture(p, found.modes, found.weights)
        top = found.modes[int(np.argmax(found.weights))]
        unit = found.unit
        shape = (len(self.grid.components), *self.grid.shape)
        columns = list(self.problem.columns)
        traction = np.zeros(shape)
        traction[columns] = unit * cells.mean.reshape(-1, *self.grid.shape)
        share = self._discrepancy(found, top, data)
        fit = self._fit(found, top)
        if share == 0.0 and fit < POOR_FIT:
            share = min(_rms(top.residual) / max(_rms(data / p.scale / unit), 1e-300), 1.0)
        sizes, deviations = self._patterns(found)
        return _Row(
            traction=traction,
            errors=self._errors(cells, unit, traction),
            stated=self._stated(cells, unit, traction),
            residual=_rms(top.residual / np.sqrt(self._variance(top))),
            converged=bool(all(m.converged for m, w in zip(found.modes, found.weights) if w > 0.1)),
            contact=True,
            outliers=np.isin(np.arange(p.n), top.explanation.broken),
            noise=self._noise(top, unit),
            sign=top.explanation.sign,
            fit=fit,
            nuisance=sizes,
            nuisance_std=deviations,
            discrepancy=share,
            unexplained=share > self.contact.detection.most_left,
            undecided=False,
            bounds=np.full((len(self.grid.components), 2), math.nan),
        )

    # -- what a frame says ---------------------------------------------------------------------------------------------

    def _rows(self, pressure: Floats) -> dict[str, Floats]:
        """Force, moment and centre as sums over the cells (sum, component and cell)."""
        grid = self.grid
        count, cells = len(grid.components), math.prod(grid.shape)
        force = np.zeros((count, count, cells))
        force[range(count), range(count)] = grid.cell
        center = np.zeros((len(grid.shape), count, cells))
        center[:, -1] = center_rows(grid, pressure).reshape(len(grid.shape), cells)
        moment = moment_rows(grid).reshape(-1, count, cells)
        columns = list(self.problem.columns)
        return {
            name: rows[:, columns].reshape(len(rows), -1)
            for name, rows in (("force", force), ("moment", moment), ("center", center))
        }

    def _errors(self, cells: CellPosterior, unit: float, traction: Floats) -> Errors:
        columns = list(self.problem.columns)
        shape = traction.shape
        std, reduction = np.zeros(shape), np.full(shape, math.nan)
        variance = unit**2 * np.diag(cells.covariance).reshape(-1, *self.grid.shape)
        std[columns] = np.sqrt(widened(np.maximum(variance, 0.0)))
        reduction[columns] = cells.reduction.reshape(-1, *self.grid.shape)
        rows = self._rows(np.abs(traction[-1]))
        found = {name: unit * cells.std_of(r) for name, r in rows.items()}
        load = self.contact.errors.force * self.grid.cell * float(np.abs(traction[-1]).sum())
        top = np.unravel_index(int(np.argmax(np.abs(traction[-1]))), self.grid.shape)
        parts = self.posterior.outside_parts(traction)
        sought = np.isin(np.arange(shape[0]), columns)
        force = np.where(sought, np.hypot(found["force"], load), 0.0)
        return Errors(std, force, found["moment"], found["center"], np.asarray(std[-1][top]), reduction, **parts)

    def _stated(self, cells: CellPosterior, unit: float, traction: Floats) -> Stated | None:
        """What the result owes to a pad that is not known exactly: the gain times the change of the readings."""
        changes, size = self.problem.doubtful(self.problem.doubts, traction)
        if not len(size):
            return None
        columns = list(self.problem.columns)
        moved = cells.gain @ (changes * size / self.prepared.scale[:, None])  # (component and cell, unknown)
        std = np.zeros(traction.shape)
        std[columns] = np.sqrt((moved**2).sum(axis=1)).reshape(-1, *self.grid.shape)
        found = {name: np.sqrt(((r @ moved) ** 2).sum(axis=1)) for name, r in self._rows(np.abs(traction[-1])).items()}
        top = np.unravel_index(int(np.argmax(np.abs(traction[-1]))), self.grid.shape)
        return Stated(std, found["force"], found["moment"], found["center"], np.asarray(std[-1][top]))

    def _nothing(self, data: Floats, found: Found | None) -> _Row:
        """A frame in which nothing was found: its errors are those of what would not show."""
        p = self.prepared
        columns = len(self.grid.components)
        if found is None:
            sigma = np.zeros(p.count) if p.noise is None else p.noise
            unit, fit, outliers = 1.0, math.nan, np.zeros(p.n, dtype=bool)
        else:
            best = max(found.none, key=lambda n: n.odds)
            sigma, unit = np.sqrt(best.variance[[int(np.argmax(p.channel == c)) for c in range(p.count)]]), found.unit
            outliers = np.isin(np.arange(p.n), best.explanation.broken)
            fit = self._probability(best.residual, best.variance, 0.0, outliers, known=p.noise is not None)
        std = sigma[p.channel] * unit * p.scale
        level = np.array([float(std[p.channel == c][0]) for c in range(p.count)])
        split = np.split(level, np.cumsum([len(a.channels) for a in self.problem.planes])[:-1])
        scaled = Readings(self.operator, split)
        depth = max(a.depth for a in self.problem.planes)
        data = np.where(outliers, 0.0, data)
        errors = self.posterior.undetected(scaled, depth, 1.0, data=data if (std > 0).all() else None)
        few = p.noise is None and p.n <= self.contact.detection.few_readings and bool(np.any(data))
        bounds = np.full((columns, 2), math.nan)
        traction = np.zeros((columns, *self.grid.shape))
        if few:
            traction = traction * math.nan
            bounds = 1.96 * np.stack([-errors.force, errors.force], axis=-1)
        stated = None
        if len(self.problem.doubtful(self.problem.doubts, np.zeros_like(traction))[1]):
            stated = Stated(*(np.zeros(np.shape(getattr(errors, f.name))) for f in fields(Stated)))
        return _Row(
            traction=traction,
            errors=errors,
            stated=stated,
            residual=1.0 if found is not None else 0.0,
            converged=True,
            contact=False,
            outliers=outliers,
            noise=level,
            sign=1,
            fit=fit,
            nuisance=np.zeros(len(p.patterns)),
            nuisance_std=np.zeros(len(p.patterns)),
            discrepancy=0.0,
            unexplained=False,
            undecided=few,
            bounds=bounds,
        )

    def _variance(self, mode: Mode) -> Floats:
        """Variance of each scaled reading."""
        noise = mode.explanation.noise
        square = mode.sigma**2 if noise.given is None else noise.given**2 + mode.sigma**2 * noise.discrepancy
        return np.asarray(square[self.prepared.channel] + self.prepared.detail**2)

    def _noise(self, mode: Mode, unit: float) -> Floats:
        p = self.prepared
        std = np.sqrt(self._variance(mode)) * unit * p.scale
        return np.array([float(std[p.channel == c][0]) for c in range(p.count)])

    def _fit(self, found: Found, mode: Mode) -> float:
        p = self.prepared
        outliers = np.isin(np.arange(p.n), mode.explanation.broken)
        known = p.noise is not None and not mode.explanation.noise.discrepancy
        return self._probability(
            mode.residual, self._variance(mode), mode.taken - len(mode.explanation.broken), outliers, known=known
        )

    def _probability(self, residual: Floats, variance: Floats, taken: float, outliers: Any, *, known: bool) -> float:
        left = np.where(outliers, 0.0, residual / np.sqrt(variance))
        detail = MODEL_DETAIL / float(np.sqrt(variance).min())
        return misfit_probability(left, ~outliers, self.prepared.pairs, taken=taken, known=known, detail=detail)

    def _discrepancy(self, found: Found, mode: Mode, data: Floats) -> float:
        if not mode.explanation.noise.discrepancy:
            return 0.0
        return min(_rms(mode.sigma) / max(_rms(data / self.prepared.scale / found.unit), 1e-300), 1.0)

    def _patterns(self, found: Found) -> tuple[Floats, Floats]:
        """Sizes of the patterns and their standard deviations, in the unit of each, over all explanations."""
        p = self.prepared
        k = p.columns.shape[1]
        values, squares = np.zeros(k), np.zeros(k)
        weights = found.weights / found.weights.sum()
        for w, m in zip(weights, found.modes):
            if not m.explanation.patterns:
                continue
            b = m.columns[:, :k]
            value = p.policy.offset * m.explanation.sign * (b.T @ m.weights)
            variance = p.policy.offset**2 * (1.0 - ((m.inverse @ b) * b).sum(axis=0))
            values += w * value
            squares += w * (np.maximum(variance, 0.0) + value**2)
        unit = found.unit / p.pattern_size if k else np.zeros(0)
        return values * unit, np.sqrt(np.maximum(squares - values**2, 0.0)) * unit


@dataclass(frozen=True)
class _Row:
    """One frame of an `Estimate`."""

    traction: Floats
    errors: Errors
    stated: Stated | None
    residual: float
    converged: bool
    contact: bool
    outliers: Any
    noise: Floats
    sign: int
    fit: float
    nuisance: Floats
    nuisance_std: Floats
    discrepancy: float
    unexplained: bool
    undecided: bool
    bounds: Floats


def _rms(values: Floats) -> float:
    return math.sqrt(float(np.mean(np.square(values)))) if np.size(values) else 0.0


def _said(rows: Sequence[_Row], batch: tuple[int, ...]) -> tuple[str, ...]:
    short = sum(not r.converged for r in rows)
    if not short:
        return ()
    where = f" in {short} of {len(rows)} frames" if batch else ""
    return (
        f"the iteration did not reach its tolerance{where}: the best traction met is given, and the error bars may be too narrow; "
        'method="tikhonov" has no such iteration',
    )
