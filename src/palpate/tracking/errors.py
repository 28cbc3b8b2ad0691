"""Error bars of a stream, recomputed when the contact has changed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from palpate._threads import give_way
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.factors import cholesky
from palpate.inverse.constrained.model import ContactModel, Later, Normal
from palpate.inverse.constrained.variances import taken_by
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.summary import Summary
from palpate.inverse.contact.systematic import add_stated
from palpate.inverse.estimate import Errors, Stated
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.tracking.background import Background
from palpate.tracking.health import Flags, Index
from palpate.tracking.iteration import Iteration
from palpate.tracking.offsets import Observed, Offsets
from palpate.tracking.pulling import Pulling, firm
from palpate.tracking.region import NormalEquations, on_surface

__all__ = ["ErrorBars"]

Shrink = Callable[[Floats], Floats]
#: Errors, errors due to the pad, information about offsets, and degrees of freedom used.
Made = tuple[Errors | None, Stated | None, Observed | None, float]

#: Recompute error bars after this many frames (a second at 200 Hz), or if the number of cells in contact has changed by
#: this fraction; the standard deviation of a force then changes by an eighth.
REFRESH, CHANGED = 200, 0.25
#: Number of frames for which a contact counts as unchanged, when its information about offsets is added up.
SAME = 100.0
#: Ratio of successive sizes of unknown noise for which the errors without contact are computed.
SIZES = 1.2
#: Frames after which error bars are recomputed if the set of readings changed, which may change back.
SOON = 8


class ErrorBars:
    """Errors of the present contact, or of a frame without one."""

    def __init__(self, estimator: ConstrainedEstimator, equations: NormalEquations) -> None:
        self._estimator, self._equations = estimator, equations
        self._no_contact: tuple[float, Errors] | None = None
        self._age, self._cells = 0, 0
        self._pulls = False  # whether they belong to traction of either sign
        self.errors: Errors | None = None
        self.stated: Stated | None = None  # errors due to a pad that is not known exactly
        self.observed: Observed | None = None  # information about the channels' offsets
        self.taken = math.nan  # degrees of freedom used by the contact

    def clear(self) -> None:
        """Forget the errors: the contact has ended."""
        self.errors, self.stated, self.observed, self.taken = None, None, None, math.nan
        self._pulls = False

    def serves(self, solution: Iteration) -> bool:
        """Whether the present errors were computed for a similar contact."""
        count = int(solution.pressing.sum())
        return abs(count - self._cells) <= CHANGED * max(self._cells, 1)

    def age(self) -> None:
        """Recompute soon: the information about offsets belongs to other readings."""
        self._age += REFRESH // SOON

    def outdate(self, *, later: bool = False) -> None:
        """Mark the errors for recomputation, because noise or penalty have changed. With ``later`` they are recomputed
        in the next frame, to spread the work.
        """
        self._age = REFRESH - 1 if later else REFRESH + 1

    def without_contact(self, noise: float | None, y: Floats | None) -> Errors | None:
        """Errors of a frame without contact: the largest contact that would not be detected.

        ``noise`` is None if it is unknown. Then, as in a single frame, all of the readings ``y`` may be noise: their root
        mean square is rounded up so that the errors serve many frames.
        """
        if noise is None:
            if y is None:
                return self.errors
            size = float(np.sqrt(np.mean(y**2)))
            noise = SIZES ** math.ceil(math.log(size) / math.log(SIZES)) if size > 0.0 else 0.0
        if self._no_contact is None or self._no_contact[0] != noise:
            self._no_contact = noise, self._estimator.undetected(noise)
        return self._no_contact[1]

    def refresh(
        self,
        solution: Iteration | Pulling,
        y: Floats,
        noise: float,
        unused: Flags,
        background: Background,
        offsets: Offsets,
    ) -> None:
        """Recompute the errors if they are old or if the contact has changed."""
        estimator, contact, pulls = self._estimator, solution.contact, isinstance(solution, Pulling)
        name, other = ("errors of a pull", "errors") if pulls else ("errors", "errors of a pull")
        if self._pulls != pulls:
            background.drop(other)
            self.clear()
            self._pulls = pulls
        if contact is None or not len(contact[0]):
            return
        cells, traction = contact
        if not (self._due(len(cells)) or name in background):
            return
        weight = solution.parameter / noise**2 if noise > 0 else 0.0
        cov = offsets.cov.copy()

        def made() -> Made:
            frame = self._prepared(cells, y, noise, unused, offsets.columns)
            known, shrink = frame.marginalised(cov)
            give_way()
            if isinstance(solution, Pulling):
                model = solution.model(known, weight, traction)
            else:
                precisions = estimator.precisions(known.level, 1, weight)
                model = estimator.model(known, precisions, traction, keep_face=True)
                model.weight = 1.0
            self._add_stated(model, shrink, y, frame.std, unused)
            observed = self._observed(frame, model.penalty.dense(), unused)
            summary = Summary([model], estimator.posterior)
            summary.gain, summary.whites = estimator.problem.uncertainty.assumed_gain, [frame.white]
            give_way()
            return summary.errors(), summary.stated(), observed, taken_by(model)

        def work() -> tuple[Made, int]:
            try:
                return made(), len(cells)
            except np.linalg.LinAlgError:
                return (None, None, None, math.nan), len(cells)  # no error bars rather than no answer

        # A pull has no interim errors, so its first are computed at once.
        found = work() if pulls and self.errors is None else background.result(name, work)
        if found is not None:
            (self.errors, self.stated, self.observed, self.taken), self._cells = found
            self._age = 0

    def _observed(self, frame: _Prepared, penalty: Floats, unused: Flags) -> Observed:
        """Information about offsets in one frame."""
        import scipy.linalg

        estimator, equations = self._estimator, self._equations
        std, data, shared, crossed = frame.std, frame.data, frame.shared, frame.crossed
        give_way()
        factor = cholesky(firm(data.gram + penalty / SAME))
        give_way()
        solved = scipy.linalg.cho_solve((factor, True), crossed, check_finite=False)
        counts = std**2 * (shared.T @ shared - crossed.T @ solved)
        parts = solved.T.reshape(shared.shape[1], *data.linear.shape)
        whole = np.zeros((*parts.shape[:2], math.prod(estimator.operator.surface.shape)))
        whole[:, :, data.cells] = parts
        left = []
        for s, w in zip(equations.shared(unused), whole):
            give_way()
            seen = np.where(unused, 0.0, estimator.explained_by(w) / estimator.readings.std)
            left.append(s - equations.adjoint_of(seen, unused))
        return Observed(0.5 * (counts + counts.T), data.cells, parts, np.stack(left), unused.copy())

    def _add_stated(self, model: ContactModel, shrink: Shrink, y: Floats, std: float, unused: Flags) -> None:
        """Add stated errors of modulus, depth, thickness and gains to a model; ``std`` is the unit of its readings."""
        estimator, used = self._estimator, ~unused
        problem = estimator.problem
        if not problem.doubts.any:
            return
        traction = on_surface(estimator, model.cells, model.solution.traction)
        columns, prior = problem.doubtful(problem.doubts, traction, wide=estimator.wide)
        columns = estimator.readings.white((columns / (estimator.readings.std * std)[:, None])[used], used)
        add_stated(model, shrink(columns), prior, problem.doubts.gain * np.abs(y[used] / std))

    def _due(self, count: int) -> bool:
        self._age += 1
        stale = self.errors is None or self._age > REFRESH
        return stale or abs(count - self._cells) > CHANGED * max(self._cells, 1)

    def _prepared(self, cells: Index, y: Floats, noise: float, unused: Flags, columns: Floats) -> _Prepared:
        """Normal equations of a frame on some cells; ``columns`` (reading, channel) are those of the offsets."""
        estimator, used = self._estimator, ~unused
        readings, level = estimator.readings, estimator.level(1)
        std = max(noise, MODEL_ERROR * float(np.abs(y).max()))
        white = readings.white(y[used] / std, used)
        shared = readings.white(columns[used] / std, used)
        scale = readings.std * std
        gram = self._equations.known(cells, unused)
        if gram is None or not readings.independent:
            data = level.normal(cells, y / std, scale, used)
            if gram is not None:
                data = replace(data, known=gram / std**2)
            crossed = np.asarray(data.matrix.T @ shared, dtype=np.float64)
            return _Prepared(std, data, white, shared, crossed)
        # Two products with the operator give what is needed of the columns, many times faster than the columns
        # themselves.
        give_way()
        linear = estimator.misfit_gradient(y / std, scale, used)[:, cells]
        later = Later(lambda: level.matrix(cells, scale, used), len(white))
        of_offsets = self._equations.shared(unused)[:, :, cells].reshape(shared.shape[1], -1)
        crossed = np.asarray(of_offsets.T / std**2)
        return _Prepared(std, Normal(level, cells, later, linear, gram / std**2), white, shared, crossed)


class _Prepared(NamedTuple):
    """Normal equations of a frame, whitened by ``std`` times the readings' standard deviations; the whitened readings
    (reading,) and offset columns B (reading, channel); and A'B (unknown, channel).
    """

    std: float
    data: Normal
    white: Floats
    shared: Floats
    crossed: Floats

    def marginalised(self, cov: Floats) -> tuple[Normal, Shrink]:
        """The equations with offsets marginalised, whitened by (1 + B V B')^(-1/2) with V = ``cov``; and a function
        that applies the same to other rows (reading, ...).
        """
        data, crossed = self.data, self.crossed
        values, vectors = np.linalg.eigh(cov)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        basis = self.shared @ root
        # (1 + B V B')^-1 = 1 - B K B'
        gain = root @ np.linalg.inv(np.eye(len(root)) + basis.T @ basis) @ root.T

        @cache
        def parts() -> tuple[Floats, Floats]:
            u, s, _ = np.linalg.svd(basis, full_matrices=False)
            return u * (1.0 - 1.0 / np.sqrt(1.0 + s**2)), u

        def shrink(rows: Floats) -> Floats:
            shrunk, u = parts()
            return np.asarray(rows - shrunk @ (u.T @ rows))

        linear = data.linear - (crossed @ (gain @ (self.shared.T @ self.white))).reshape(data.linear.shape)
        gram = data.gram - (crossed @ gain) @ crossed.T
        later = Later(lambda: shrink(data.matrix), len(self.white))
        return Normal(data.level, data.cells, later, linear, gram), shrink
