"""From displacements to traction, with samples of its posterior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from palpate.elastic.pad import Floats, Pad
from palpate.inverse.linear.matrix_free.memory import check_system, servable
from palpate.inverse.linear.matrix_free.path import Linear
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.matrix_free.system import System
from palpate.inverse.linear.methods import Tikhonov
from palpate.inverse.linear.posterior import LinearErrors
from palpate.inverse.linear.priors import DifferencePrior
from palpate.inverse.problem import Problem
from palpate.microscopy.fields import Field
from palpate.sensing.arrays import AreaArray
from palpate.sensing.uncertainty import Uncertainty
from palpate.skin import Skin
from palpate.touch import Touch

__all__ = ["Inverted", "inverted"]

COMPONENTS = ("x", "y")


@dataclass(frozen=True, kw_only=True)
class Iterated(Tikhonov):
    """Tikhonov's method without a decomposition at any size: a picture is solved once, and its posterior is sampled."""

    name: ClassVar[str] = "tikhonov"

    def prepare(self, problem: Problem) -> Linear:
        self.check(problem)
        if problem.boundary != "free" or not servable(problem.planes):
            return super().prepare(problem)
        check_system(problem.pad, problem.planes, problem.surface, len(problem.columns))
        priors = [DifferencePrior(problem.surface, self.order)] * len(problem.components)
        system = problem.kept.get(
            ("matrix-free system", False, problem.columns, tuple(p.key for p in priors)),
            lambda: System(problem.operator, priors, problem.columns),
        )
        return MatrixFree(system, self.chosen, nuisance=problem.nuisance)


@dataclass(frozen=True, eq=False)
class Inverted:
    """A traction on the field's own grid, and what it does there.

    Attributes
    ----------
    touch : Touch
        On the whole surface, which reaches beyond the field of view.
    traction, moved : array (2, row, column)
        Traction [Pa], and the displacement of the surface [m] that it makes.
    draws, moved_by_draws : array (draw, 2, row, column)
        Samples of the posterior, and the displacements that they make.
    """

    skin: Skin
    touch: Touch
    traction: Floats
    moved: Floats
    draws: Floats
    moved_by_draws: Floats


def inverted(
    field: Field,
    pad: Pad,
    *,
    depth: float,
    noise: float | None,
    order: int,
    rule: str,
    nuisance: tuple[str, ...] | str,
    uncertainty: Uncertainty | None,
    draws: int,
    seed: int,
) -> Inverted:
    """Traction of a field, with samples of its posterior."""
    array = field.array(depth=depth, noise=noise)
    skin = Skin(pad, array, nuisance=nuisance, uncertainty=uncertainty)
    readings = np.nan_to_num(field.displacement)
    touch = skin.reconstruct(readings, method=Iterated(order=order, rule=rule), components=COMPONENTS)
    errors = touch.errors
    if not isinstance(errors, LinearErrors):
        raise RuntimeError("the linear method has errors of its own")
    samples = errors.draws(draws, np.random.default_rng(seed))[0]
    # the surface itself moves, wherever the beads are
    grid: Any = skin.surface
    top = AreaArray(shape=grid.shape, pitch=grid.spacings[0], depth=0.0, channels=array.channels, center=grid.center)
    whole = Skin(pad, top, surface=grid)
    trim = tuple(slice((n - m) // 2, (n - m) // 2 + m) for n, m in zip(grid.shape, field.shape))
    pick: Any = (..., slice(0, 2), *trim)
    moved = np.stack([np.asarray(whole.sense(t)) for t in (np.asarray(touch.values), *samples)])
    return Inverted(
        skin,
        touch,
        np.asarray(touch.values)[pick],
        moved[(0, *pick[1:])],
        samples[pick],
        moved[(slice(1, None), *pick[1:])],
    )
