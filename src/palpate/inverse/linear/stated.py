"""Errors of linear methods due to uncertain pads, depths and gains, by the delta method.

An estimate t = K y has a fixed parameter, and the readings are y = A(theta) t. An error d of theta causes an error K
(dA/dtheta t) d to first order. Modulus, depth and thickness are one direction each; the gains of n readings are n
directions, or `SKETCHES` sums of them with random signs, whose squares have the same mean. `ErrorParts.scale`
(`palpate.touch.fields`) covers factors of all results (the scale; the modulus if every reading depends on it). These
errors are separate from the closed-form ones: the calibration constants of a method correct its prior, which is
unrelated to the uncertainty of the pad.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.inverse.estimate import Estimate, Stated, in_frames
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.posterior import center_rows, moment_rows
from palpate.inverse.linear.regularised import Regularised
from palpate.inverse.linear.whitening import Readings
from palpate.inverse.problem import Problem
from palpate.sensing.grids import Grid
from palpate.sensing.nuisance import nuisances
from palpate.sensing.uncertainty import Uncertainty

__all__ = ["InDoubt", "with_offsets"]

#: Number of sums of gain errors with random signs; the resulting standard deviations are accurate to 1/sqrt(2
#: SKETCHES), 9 %.
SKETCHES = 64
#: Standard deviation of channel offsets, as a fraction of the largest reading, that a frame not explained by pushing
#: contact may contain. A convention: offsets of 10 to 30 % of the peak, as in `palpate bench trust`, are then within
#: two of them, even if they reduce the largest reading.
OFFSET_FRACTION = 0.25


class InDoubt:
    """A linear method whose errors include a `palpate.Uncertainty`, and channel offsets of ``hidden`` times the
    largest reading.
    """

    def __init__(
        self, linear: Regularised | MatrixFree, problem: Problem, known: Uncertainty, hidden: float = 0.0
    ) -> None:
        self.linear, self.problem, self.known, self.grid, self.hidden = linear, problem, known, linear.grid, hidden
        self.readings = Readings(linear.operator, linear.scales)
        self.offsets = [t.rows for t in nuisances(linear.operator.planes_of, ("offset",))] if hidden else []

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Solve with the linear method, and add these errors."""
        found = self.linear.solve(readings, rng)
        if found.parameter is None:
            raise RuntimeError("a linear method names its parameter")
        batch = np.shape(found.parameter)
        traction = to_numpy(found.traction).astype(np.float64).reshape(-1, len(self.grid.components), *self.grid.shape)
        flat = [to_numpy(r).astype(np.float64).reshape(-1, *r.shape[len(batch) :]) for r in readings]
        frames = []
        for i, (t, lam) in enumerate(zip(traction, np.reshape(found.parameter, -1))):

            def again(rows: list[Floats], lam: float = float(lam)) -> Floats:
                return self.linear.again(rows, np.full(len(rows[0]), lam))

            frames.append(deviations(self.directions([r[i] for r in flat], t, again), t, self.grid))
        joined = {f.name: np.stack([getattr(one, f.name) for one in frames]) for f in fields(Stated)}
        said = list(found.said)
        if self.offsets:
            said.append(
                f"an offset of the readings would be taken for such a contact{in_frames(np.ones(batch, dtype=bool), batch)}, and the error bars allow "
                "for one: nuisance=[] excludes it"
            )
        return replace(
            found, said=tuple(said), stated=Stated(**{n: v.reshape((*batch, *v.shape[1:])) for n, v in joined.items()})
        )

    def directions(self, readings: list[Floats], traction: Floats, again: Callable[[list[Floats]], Floats]) -> Floats:
        """Errors of an estimate (direction, component, *surface), one standard deviation each; ``again`` solves other
        readings in the same way.
        """
        known = self.known
        columns, size = self.problem.doubtful(known, traction)
        rows = list((columns * size).T)
        if known.gain:
            off = known.gain * self.readings.flat(readings)
            signs = np.eye(len(off))
            if len(off) > SKETCHES:
                signs = np.random.default_rng(0).choice([-1.0, 1.0], (SKETCHES, len(off))) / math.sqrt(SKETCHES)
            rows.extend(signs * off)
        flat = np.abs(self.readings.flat(readings))
        rows.extend(self.hidden * flat[o != 0].max(initial=0.0) / np.abs(o).max() * o for o in self.offsets)
        if not rows:
            return np.zeros((1, *traction.shape))
        return again([np.stack(each) for each in zip(*(self.readings.planes(row) for row in rows))])


def deviations(directions: Floats, traction: Floats, grid: Grid) -> Stated:
    """Standard deviations of a frame's force, moment, centre and peak. ``directions`` (n, component, *surface) are
    independent errors of its ``traction`` (component, *surface), each of one standard deviation.
    """

    def size(values: Floats) -> Floats:
        return np.asarray(np.sqrt((values**2).sum(axis=0)))

    d = grid.dimensions
    pressure = traction[-1]
    moments = np.tensordot(directions, moment_rows(grid), (range(1, d + 2), range(1, d + 2)))
    centers = np.tensordot(directions[:, -1], center_rows(grid, pressure), (range(1, d + 1), range(1, d + 1)))
    return Stated(
        traction=size(directions),
        force=size(grid.total_force(directions)),
        moment=size(moments),
        center=size(centers),
        peak=size(directions[:, -1].reshape(len(directions), -1)[:, int(np.argmax(pressure))]),
    )


def with_offsets(linear: Regularised | MatrixFree | InDoubt, problem: Problem) -> Regularised | MatrixFree | InDoubt:
    """A linear method that replaces a contact method for some frames: it includes the same uncertainty of pad and
    depths, and of offsets that the user neither named nor excluded. The linear method would take these for contact
    everywhere (`palpate.inverse.linear.patterns`).
    """
    alone = linear.linear if isinstance(linear, InDoubt) else linear
    hidden = OFFSET_FRACTION if problem.nuisance is None and problem.boundary == "free" else 0.0
    return InDoubt(alone, problem, problem.doubts, hidden) if hidden or problem.doubts.any else alone
