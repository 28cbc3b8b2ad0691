"""Error bars of a stream, made anew when the contact has changed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import FAINT, ConstrainedEstimator
from palpate.inverse.contact.factors import cholesky
from palpate.inverse.contact.model import ContactModel, Normal
from palpate.inverse.contact.summary import Summary
from palpate.inverse.contact.systematic import state
from palpate.inverse.estimate import Errors, Stated
from palpate.inverse.linear.parameter import MODEL_ERROR
from palpate.tracking.background import Background
from palpate.tracking.health import Flags, Index
from palpate.tracking.iteration import Iteration
from palpate.tracking.offsets import Observed, Offsets
from palpate.tracking.pulling import Pulling, firm
from palpate.tracking.region import NormalEquations

__all__ = ["ErrorBars"]

Shrink = Callable[[Floats], Floats]
#: Errors, what is owed to a pad that is not known exactly, what is told about offsets, and degrees of freedom taken.
Made = tuple[Errors | None, Stated | None, Observed | None, float]

#: Error bars are made again after so many frames (a second at 200 Hz), or when the number of cells in contact has changed by this
#: part: the standard deviation of a force goes about with the square root of it, by an eighth.
REFRESH, CHANGED = 200, 0.25
#: A contact is taken to be the same in so many frames, when what they tell about offsets is counted.
SAME = 100.0
#: Work on the error bars of traction of either sign.
PULLING = "errors of a pull"
#: Frames after which error bars are made again for other readings that are used: these may come and go.
SOON = 8


class ErrorBars:
    """The errors of the present contact, or of a frame without one."""

    def __init__(self, estimator: ConstrainedEstimator, equations: NormalEquations) -> None:
        self._estimator, self._equations = estimator, equations
        self._no_contact: tuple[float, Errors] | None = None
        self._age, self._cells = 0, 0
        self._pulls = False  # whether they are of traction of either sign
        self.errors: Errors | None = None
        self.stated: Stated | None = None  # what is owed to a pad that is not known exactly
        self.observed: Observed | None = None  # about the channels' offsets
        self.taken = math.nan  # degrees of freedom of the readings that the contact takes up

    def clear(self) -> None:
        """The contact has ended."""
        self.errors, self.stated, self.observed, self.taken = None, None, None, math.nan
        self._pulls = False

    def serves(self, solution: Iteration) -> bool:
        """Whether the errors that there are were made for a contact like the present one."""
        count = int((solution.pressure > FAINT * float(solution.pressure.max(initial=0.0))).sum())
        return abs(count - self._cells) <= CHANGED * max(self._cells, 1)

    def age(self) -> None:
        """Make them again soon: what is known of offsets is for other readings."""
        self._age += REFRESH // SOON

    def outdate(self, *, later: bool = False) -> None:
        """Make them again: noise or penalty are others. ``later``: in the frame after this one, which has enough to do."""
        self._age = REFRESH - 1 if later else REFRESH + 1

    def without_contact(self, noise: float | None) -> Errors | None:
        """Errors of a frame without contact: what would not be detected."""
        if noise is None:
            return self.errors
        if self._no_contact is None or self._no_contact[0] != noise:
            self._no_contact = noise, self._estimator.undetected(noise)
        return self._no_contact[1]

    def refresh(
        self,
        solution: Iteration,
        y: Floats,
        noise: float,
        unused: Flags,
        background: Background,
        offsets: Offsets,
    ) -> None:
        """Make them again where they are old, or the contact is another."""
        region, estimator = solution.region, self._estimator
        if self._pulls:
            background.drop(PULLING)
            self.clear()
        if region is None:
            return
        pressure = solution.pressure
        contact = pressure > FAINT * float(pressure.max(initial=0.0))
        count = int(contact.sum())
        if count == 0 or (not self._due(count) and "errors" not in background):
            return
        cells = region.cells[contact]
        start = solution.traction[:, contact]
        weight = region.parameter / noise**2 if noise > 0 else 0.0
        cov = offsets.cov.copy()

        def work() -> tuple[Made, int]:
            try:
                return made(), len(cells)
            except np.linalg.LinAlgError:
                return (None, None, None, math.nan), len(cells)  # no error bars rather than no answer

        def made() -> Made:
            level = estimator.level(1)
            std, data, white = self._data(cells, y, noise, unused)
            shared = estimator.readings.white(offsets.columns[~unused] / std, ~unused)
            known, shrink = marginalised(data, white, shared, cov)
            model = estimator.model(known, estimator.precisions(level, 1, weight), start, keep_face=True)
            model.weight = 1.0
            self._owe(model, shrink, y, std, unused)
            observed = self._observed(data, shared, model.penalty.dense(), std, unused)
            summary = Summary([model], estimator.posterior)
            return summary.errors(), summary.stated(), observed, _taken(model)

        found = background.result("errors", work)
        if found is not None:
            (self.errors, self.stated, self.observed, self.taken), self._cells = found
            self._age = 0

    def refresh_pulling(
        self,
        pulling: Pulling,
        y: Floats,
        noise: float,
        unused: Flags,
        parameter: float,
        background: Background,
        offsets: Offsets,
    ) -> None:
        """The same for traction of either sign, of which those of a contact that only pushes say nothing."""
        estimator, cells = self._estimator, pulling.cells
        if not self._pulls:
            background.drop("errors")
            self.clear()
            self._pulls = True
        if cells is None or not (self._due(len(cells)) or PULLING in background):
            return
        traction, cov = pulling.traction, offsets.cov.copy()

        def work() -> tuple[Made, int]:
            try:
                std, data, white = self._data(cells, y, noise, unused)
                shared = estimator.readings.white(offsets.columns[~unused] / std, ~unused)
                weight = parameter / noise**2 if noise > 0 else 0.0
                known, shrink = marginalised(data, white, shared, cov)
                either = pulling.model(known, weight, traction)
                self._owe(either, shrink, y, std, unused)
                summary = Summary([either], estimator.posterior)
                errors, stated = summary.errors(), summary.stated()
                model = pulling.model(data, weight, traction)
                observed = self._observed(data, shared, model.penalty.dense(), std, unused)
            except np.linalg.LinAlgError:
                return (None, None, None, math.nan), len(cells)  # no error bars rather than no answer
            return (errors, stated, observed, _taken(model)), len(cells)

        # an answer without error bars is none: the first are made at once
        found = work() if self.errors is None else background.result(PULLING, work)
        if found is not None:
            (self.errors, self.stated, self.observed, self.taken), self._cells = found
            self._age = 0

    def _observed(self, data: Normal, shared: Floats, penalty: Floats, std: float, unused: Flags) -> Observed:
        """What a frame tells about offsets; whitened columns of ``data`` and ``shared`` are in units of ``std``."""
        import scipy.linalg

        estimator, equations = self._estimator, self._equations
        crossed = np.asarray(data.matrix.T @ shared, dtype=np.float64)
        factor = cholesky(firm(data.gram + penalty / SAME))
        solved = scipy.linalg.cho_solve((factor, True), crossed, check_finite=False)
        counts = std**2 * (shared.T @ shared - crossed.T @ solved)
        parts = solved.T.reshape(shared.shape[1], *data.linear.shape)
        whole = np.zeros((*parts.shape[:2], math.prod(estimator.operator.surface.shape)))
        whole[:, :, data.cells] = parts
        left = [
            s - equations.adjoint(np.where(unused, 0.0, estimator.explained_by(w) / estimator.readings.std), unused)
            for s, w in zip(equations.shared(unused), whole)
        ]
        return Observed(0.5 * (counts + counts.T), data.cells, parts, np.stack(left), unused.copy())

    def _owe(self, model: ContactModel, shrink: Shrink, y: Floats, std: float, unused: Flags) -> None:
        """What is stated of modulus, depth, thickness and gains does to a model's errors; ``std`` is the unit of its readings."""
        estimator, used = self._estimator, ~unused
        problem = estimator.problem
        if not problem.doubts.any:
            return
        grid = estimator.operator.surface
        full = np.zeros((len(grid.components), math.prod(grid.shape)))
        full[np.asarray(estimator.columns)[:, None], model.cells[None, :]] = model.solution.traction
        columns, prior = problem.doubtful(problem.doubts, full.reshape(-1, *grid.shape), wide=estimator.wide)
        columns = estimator.readings.white((columns / (estimator.readings.std * std)[:, None])[used], used)
        state(model, shrink(columns), prior, problem.doubts.gain * np.abs(y[used] / std))

    def _due(self, count: int) -> bool:
        self._age += 1
        stale = self.errors is None or self._age > REFRESH
        return stale or abs(count - self._cells) > CHANGED * max(self._cells, 1)

    def _data(self, cells: Index, y: Floats, noise: float, unused: Flags) -> tuple[float, Normal, Floats]:
        estimator = self._estimator
        std = max(noise, MODEL_ERROR * float(np.abs(y).max()))
        data = estimator.level(1).normal(cells, y / std, estimator.readings.std * std, ~unused)
        gram = self._equations.known(cells, unused)
        if gram is not None:
            data = replace(data, known=gram / std**2)
        return std, data, estimator.readings.white(y[~unused] / std, ~unused)


def _taken(model: ContactModel) -> float:
    """Trace of A (A'A + penalty)^-1 A' over the face."""
    face, factor = model.solution.face, model.solution.factor
    if face is None or factor is None or not len(face.index):
        return 0.0
    return float(np.trace(factor.back(factor.half(face.restrict(model.data.gram)))))


def marginalised(data: Normal, white: Floats, shared: Floats, cov: Floats) -> tuple[Normal, Shrink]:
    """The data with offsets marginalised: whitened by (1 + B V B')^(-1/2), B = ``shared`` (reading, channel) and V = ``cov``; and what
    does the same to other rows (reading, ...).

    ``white`` are the whitened readings.
    """
    values, vectors = np.linalg.eigh(cov)
    u, s, _ = np.linalg.svd(shared @ (vectors * np.sqrt(np.maximum(values, 0.0))), full_matrices=False)
    shrunk = u * (1.0 - 1.0 / np.sqrt(1.0 + s**2))

    def shrink(rows: Floats) -> Floats:
        return np.asarray(rows - shrunk @ (u.T @ rows))

    matrix = shrink(data.matrix)
    linear = matrix.T @ shrink(white)
    # (1 - U D U')^2 = 1 - U (2 D - D^2) U', with U'U = 1
    part = 1.0 - 1.0 / np.sqrt(1.0 + s**2)
    seen = u.T @ data.matrix
    gram = data.gram - (seen.T * (part * (2.0 - part))) @ seen
    return Normal(data.level, data.cells, matrix, linear.reshape(data.linear.shape), gram), shrink
