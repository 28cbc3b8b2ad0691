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
import scipy.sparse

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import minimise
from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.contact.explanation import Solved
from palpate.inverse.contact.prepared import Prepared
from palpate.inverse.contact.summary import shares

__all__ = ["Again", "Kept", "Models", "keep", "keeping"]


@dataclass(frozen=True)
class Models:
    """The solved explanations of a pushing frame, whose weights add up to one; ``factor``: how many times the noise of
    ``prepared`` they were solved with (the readings were divided by it); ``free``: degrees of freedom of the residual.
    """

    prepared: Prepared
    runs: tuple[Solved, ...]
    factor: float = 1.0
    free: float = math.nan

    @classmethod
    def of(cls, prepared: Prepared, *runs: Solved) -> Models | None:
        """The models of these runs, if there are any and all of them push."""
        members = any(run.members for run in runs)
        return cls(prepared, runs) if members and all(run.explanation.sign == 1 for run in runs) else None

    @property
    def serve(self) -> bool:
        """Whether later frames can be solved with them in little time: contacts of many cells cannot, and where shear
        follows pressure at one ratio, that ratio changes.
        """
        members = [m for run in self.runs for m in run.members]
        most = self.prepared.policy.work.again_unknowns
        small = all(m.solution.traction.size <= most for m in members)
        return small and not any(m.ray is not None for m in members)

    def times(self, factor: float) -> Models:
        """The same models for readings that are divided by ``factor``."""
        return replace(self, factor=factor * self.factor)


@dataclass
class Kept:
    """The models of the last frame that was solved inside `keeping`, None if it does not push."""

    models: Models | None = None


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


def keep(models: Models | None) -> None:
    """Hand the models of a frame to whoever keeps them."""
    kept = _kept.get()
    if kept is not None:
        kept.models = models


class Again:
    """Solves frames with the models of an earlier one; each solution starts from the last."""

    def __init__(self, models: Models) -> None:
        self._prepared, self._factor = models.prepared, models.factor
        self._parts = [_Part(models.prepared, run) for run in models.runs]
        self.observed = np.logical_and.reduce([part.run.observed for part in self._parts])

    def solve(self, readings: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Traction (component, *surface) of readings (one array per plane), and the residual (reading,) in units of the
        models' noise, 0 for readings that they do not use.
        """
        prepared = self._prepared
        data = prepared.readings.flat(prepared.operator.observed(readings)) / self._factor
        grid = prepared.operator.surface
        traction, residual = np.zeros((len(grid.components), math.prod(grid.shape))), np.zeros(len(data))
        for part in self._parts:
            for column, values in zip(prepared.columns, part.solve(data)):
                traction[column] += values
            residual[part.run.observed] += part.residual
        whole = prepared.cut(self._factor * traction.reshape(-1, *grid.shape))
        return whole, np.where(self.observed, residual, 0.0)


class _Part:
    """One explanation, solved again."""

    def __init__(self, prepared: Prepared, run: Solved) -> None:
        self.prepared, self.run = prepared, run
        self._shift = prepared.shifts @ run.explanation.sizes
        white = self._white(run.data)
        self._members = [_Member(prepared, m, white) for m in run.members]

    def _white(self, data: Floats) -> Floats:
        run = self.run
        return self.prepared.readings.white((data / run.noise)[run.observed], run.observed)

    def solve(self, data: Floats) -> Floats:
        """Weighted sum of the tractions (component sought, cell of the surface)."""
        white, cells = self._white(data - self._shift), math.prod(self.prepared.operator.surface.shape)
        out, residual = np.zeros((len(self.prepared.columns), cells)), np.zeros(len(white))
        for member in self._members:
            traction, left = member.solve(white)
            out[:, member.cells] += member.model.weight * traction
            residual += member.model.weight * left
        self.residual = residual
        return out


class _Member:
    """One model, solved again, which was made from the readings ``white``."""

    def __init__(self, prepared: Prepared, model: ContactModel, white: Floats) -> None:
        self.model, self._cone, self._tolerance = model, prepared.cone, prepared.policy.work.again
        self._last = model.solution.traction
        self._matrix = np.asarray(model.data.matrix)
        self._share: scipy.sparse.csr_array
        self._share, self.cells = shares(model, prepared.operator.surface)
        first = self._minimised(white)
        #: Shear in proportion to the pressure that was added afterwards (`systematic.with_common_shear`), per load.
        self._added = (model.solution.traction - first) / max(float(first[-1].sum()), 1e-300)

    def solve(self, white: Floats) -> tuple[Floats, Floats]:
        """Traction (component, cell) on the surface's ``cells``, and the residual (reading used,)."""
        traction = self._minimised(white)
        traction = traction + self._added * float(traction[-1].sum())
        return np.asarray((self._share @ traction.T).T), white - self._matrix @ traction.ravel()

    def _minimised(self, white: Floats) -> Floats:
        """The solution (component, cell) for whitened readings."""
        linear = (white @ self._matrix).reshape(-1, len(self.model.cells))
        solution = minimise(self.model.hessian, linear, self._cone, self._last, tolerance=self._tolerance)
        self._last = solution.traction
        return self._last
