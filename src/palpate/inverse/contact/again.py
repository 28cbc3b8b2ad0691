"""Solve later frames of the same contact with the models of an earlier one.

The models of a frame (cells, penalties, noise, weights) follow from all that `palpate.inverse.contact.search` tries. As
long as the same contact presses, they describe the next frames too: only the readings change, so each frame costs one
warm start per model instead of a search. The result for the frame itself is the same. A later frame that the models do
not explain leaves a larger residual.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate._threads import WIDEST
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import minimise
from palpate.inverse.constrained.model import ContactModel, Normal
from palpate.inverse.constrained.variances import variance_of_sums
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.prepared import PreparedContact
from palpate.inverse.contact.summary import shares

__all__ = ["Again", "Kept", "Models", "keep", "keeping"]

Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Models:
    """The solved explanations of a frame, whose weights add up to one; ``factor``: how many times the noise of
    ``prepared`` they were solved with (the readings were divided by it); ``free``: degrees of freedom of the residual.
    """

    prepared: PreparedContact
    runs: tuple[Solved, ...]
    factor: float = 1.0
    free: float = math.nan

    @classmethod
    def of(cls, prepared: PreparedContact, *runs: Solved) -> Models | None:
        """The models of these runs, if there are any and all of them push, or all pull."""
        signs = {run.explanation.sign for run in runs if run.members}
        return cls(prepared, runs) if signs in ({1}, {-1}) else None

    @property
    def sign(self) -> int:
        """1 for push, -1 for pull."""
        return next(run.explanation.sign for run in self.runs if run.members)

    @property
    def pushes(self) -> bool:
        """Whether no cell may pull."""
        return self.sign == 1 and not self.prepared.cone.free

    @property
    def serve(self) -> bool:
        """Whether later frames can be solved with them in little time: contacts of many cells cannot, and where shear
        follows pressure at one ratio, that ratio changes.
        """
        members = [m for run in self.runs for m in run.members]
        widest = WIDEST * len(self.prepared.readings.std)
        most = self.prepared.policy.work.again_unknowns
        small = all(min(m.solution.traction.size, widest) <= most for m in members)
        return small and not any(m.ray is not None for m in members)

    def times(self, factor: float) -> Models:
        """The same models for readings that are divided by ``factor``."""
        return replace(self, factor=factor * self.factor)


@dataclass
class Kept:
    """The models of the last frame that was solved inside `keeping`, None if it does not push, and the notes about its
    contact.
    """

    models: Models | None = None
    notes: tuple[str, ...] = ()


_kept: ContextVar[Kept | None] = ContextVar("kept", default=None)


@contextmanager
def keeping() -> Iterator[Kept]:
    """Keep the models of the frame that the default method solves inside."""
    kept = Kept()
    token = _kept.set(kept)
    try:
        yield kept
    finally:
        _kept.reset(token)


def keep(models: Models | None, notes: tuple[str, ...] = ()) -> None:
    """Hand the models of a frame, and the notes about its contact, to whoever keeps them."""
    kept = _kept.get()
    if kept is not None:
        kept.models, kept.notes = models, notes


class Again:
    """Solves frames with the models of an earlier one; each solution starts from the last. ``observed`` (reading,): the
    readings that the models were made from.
    """

    def __init__(self, models: Models) -> None:
        self._prepared, self._factor, self._sign = models.prepared, models.factor, models.sign
        self._parts = [_Part(models.prepared, run) for run in models.runs]
        self.observed = np.logical_and.reduce([part.run.observed for part in self._parts])

    def serves(self, unused: Flags) -> bool:
        """Whether frames can be solved without these readings: where the noise of readings is correlated, with all."""
        return self._prepared.readings.independent or not (unused & self.observed).any()

    def solve(self, readings: Sequence[Floats], unused: Flags) -> tuple[Floats, Floats]:
        """Traction (component, *surface) of readings (one array per plane) but those ``unused`` (reading,), and the residual
        (reading,) in units of the models' noise, 0 for readings that are not used.
        """
        prepared = self._prepared
        data = prepared.readings.flat(prepared.operator.observed(readings)) / self._factor
        grid = prepared.operator.surface
        traction, residual = np.zeros((len(grid.components), math.prod(grid.shape))), np.zeros(len(data))
        for part in self._parts:
            told = part.run.observed & ~unused
            found, left = part.solve(data, told)
            for column, values in zip(prepared.columns, found):
                traction[column] += values
            residual[told] += left
        whole = prepared.cut(self._sign * self._factor * traction.reshape(-1, *grid.shape))
        return whole, np.where(self.observed, residual, 0.0)

    def widening(self, unused: Flags) -> float:
        """Factor by which the standard deviation of the normal force grows without these readings."""
        if not (unused & self.observed).any():
            return 1.0
        each = [part.variances(part.run.observed & ~unused) for part in self._parts]
        before, after = np.sum(each, axis=0)
        return math.sqrt(max(after / max(before, 1e-300), 1.0))


class _Part:
    """One explanation, solved again."""

    def __init__(self, prepared: PreparedContact, run: Solved) -> None:
        self.prepared, self.run = prepared, run
        self._shift = prepared.shifts @ run.explanation.sizes
        white = self._white(run.data, run.observed)
        self._members = [_Member(prepared, m, white) for m in run.members]

    def _white(self, data: Floats, told: Flags) -> Floats:
        return self.prepared.readings.white((data / self.run.noise)[told], told)

    def solve(self, data: Floats, told: Flags) -> tuple[Floats, Floats]:
        """Weighted sum of the tractions (component sought, cell of the surface), and the residual of the readings ``told``."""
        white = self._white(self.run.explanation.sign * (data - self._shift), told)
        out = np.zeros((len(self.prepared.columns), math.prod(self.prepared.operator.surface.shape)))
        residual = np.zeros(len(white))
        for member in self._members:
            traction, left = member.solve(white, told[self.run.observed])
            out[:, member.cells] += member.model.weight * traction
            residual += member.model.weight * left
        return out, residual

    def variances(self, told: Flags) -> Floats:
        """Weighted sums of the variances of the normal force: with all readings, and with those ``told``."""
        rows = told[self.run.observed]
        return np.sum(
            [m.model.weight * np.array([m.variance(rows | True), m.variance(rows)]) for m in self._members], axis=0
        )


class _Member:
    """One model, solved again, which was made from the readings ``white``."""

    def __init__(self, prepared: PreparedContact, model: ContactModel, white: Floats) -> None:
        self.model, self._cone, self._tolerance = model, prepared.cone, prepared.policy.work.again
        self._last = model.solution.traction
        self._known = {np.ones(len(white), dtype=bool).tobytes(): model}
        self._share: scipy.sparse.csr_array
        self._share, self.cells = shares(model, prepared.operator.surface)
        first = self._minimised(white, model)
        #: Shear in proportion to the pressure that was added afterwards (`systematic.add_common_shear`), per load.
        self._added = (model.solution.traction - first) / max(float(np.abs(first[-1]).sum()), 1e-300)

    def solve(self, white: Floats, told: Flags) -> tuple[Floats, Floats]:
        """Traction (component, cell) on the surface's ``cells``, and the residual of the readings ``told``."""
        model = self._of(told)
        traction = self._minimised(white, model)
        traction = traction + self._added * float(np.abs(traction[-1]).sum())
        return np.asarray((self._share @ traction.T).T), white - model.data.matrix @ traction.ravel()

    def variance(self, told: Flags) -> float:
        """Variance of the sum of the pressure, on the face of the last solution."""
        model, total = self._of(told), np.zeros(self._last.shape)
        total[-1] = 1.0
        linear = model.hessian.product(self._last)
        found = minimise(model.hessian, linear, self._cone, self._last, keep_face=True)
        return float(variance_of_sums(replace(model, solution=found, shared=None), total.reshape(1, -1))[0])

    def _of(self, told: Flags) -> ContactModel:
        """The model for these of its readings."""
        key = told.tobytes()
        if key not in self._known:
            data = self.model.data
            data = Normal(data.level, data.cells, np.asarray(data.matrix)[told], data.linear, None)
            self._known[key] = replace(self.model, data=data, hessian=data.quadratic(self.model.penalty))
        return self._known[key]

    def _minimised(self, white: Floats, model: ContactModel) -> Floats:
        """The solution (component, cell) for whitened readings."""
        linear = (white @ model.data.matrix).reshape(-1, len(model.cells))
        self._last = minimise(model.hessian, linear, self._cone, self._last, tolerance=self._tolerance).traction
        return self._last
