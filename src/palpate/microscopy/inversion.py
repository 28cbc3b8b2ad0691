"""Invert displacements to traction, and draw samples of its posterior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats, Pad
from palpate.inverse.linear.matrix_free.memory import servable
from palpate.inverse.linear.matrix_free.path import Linear, system_of
from palpate.inverse.linear.matrix_free.solver import MatrixFree
from palpate.inverse.linear.methods import Tikhonov
from palpate.inverse.linear.posterior import LinearErrors
from palpate.inverse.linear.priors import DifferencePrior
from palpate.inverse.problem import Problem
from palpate.microscopy.adhesions import Adhesions, Maps, Sample, sampled
from palpate.microscopy.blobs import Response
from palpate.microscopy.fields import Field
from palpate.sensing.arrays import AreaArray
from palpate.sensing.uncertainty import Uncertainty
from palpate.skin import Skin
from palpate.touch import Touch

__all__ = ["Inverted", "inverted", "of_adhesions"]

COMPONENTS = ("x", "y")
#: The mean displacement of the field of view is computed from this many rows and columns.
MEAN_SAMPLES = 12


@dataclass(frozen=True, kw_only=True)
class Iterated(Tikhonov):
    """Tikhonov's method without a matrix decomposition: a picture is solved once, and its posterior sampled."""

    name: ClassVar[str] = "tikhonov"

    def prepare(self, problem: Problem) -> Linear:
        self.check(problem)
        if problem.boundary != "free" or not servable(problem.planes):
            return super().prepare(problem)
        priors = [DifferencePrior(problem.surface, self.order)] * len(problem.components)
        return MatrixFree(system_of(problem, priors), self.chosen, nuisance=problem.nuisance)


@dataclass(frozen=True, eq=False)
class Inverted:
    """A traction on the grid of the field, and the quantities that derive from it.

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
    #: The samples of adhesions, and the work of each blob [J]; None if a linear method was used.
    samples: tuple[Sample, ...] | None = None
    work: tuple[Floats, ...] | None = None
    notes: tuple[str, ...] = ()
    response: Response | None = None
    #: Normal traction, if the field has displacements out of the plane.
    normal: Any = None


def of_adhesions(
    field: Field,
    pad: Pad,
    *,
    depth: float,
    noise: float | None,
    likely: npt.NDArray[np.bool_] | None,
    drift: bool,
    uncertainty: Uncertainty | None,
    draws: int,
    seed: int,
) -> Inverted:
    """Estimate the traction of a field as adhesions, by sampling. ``likely`` (row, column) marks where adhesions are
    expected.
    """
    found = sampled(field, pad, depth=depth, noise=noise, likely=likely, drift=drift, draws=draws, seed=seed)
    skin = Skin(pad, field.array(depth=depth, noise=field.noise if noise is None else noise), uncertainty=uncertainty)
    maps = Maps.of(found, field, skin.surface)
    touch = skin.reconstruct(
        np.nan_to_num(field.displacement), method=Adhesions(found=found, maps=maps), components=COMPONENTS
    )
    rows, columns = field.shape
    pitch = field.pitch
    x, y = pitch * np.arange(columns), pitch * np.arange(rows)
    steps = [max(1, n // MEAN_SAMPLES) for n in (columns, rows)]
    some = np.stack([a.ravel() for a in np.meshgrid(x[:: steps[0]], y[:: steps[1]])], axis=1)
    shift = [s.moved(some, pitch**2 / 12, found.response).mean(axis=1) for s in found.samples]
    work = tuple(s.work(found.response, m) for s, m in zip(found.samples, shift))
    nothing = np.zeros((0, 2, rows, columns))
    return Inverted(
        skin,
        touch,
        maps.draws.mean(axis=0),
        nothing[:0].sum(axis=0),
        maps.draws,
        nothing,
        tuple(found.samples),
        work,
        found.notes,
        found.response,
    )


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
    """Estimate the traction of a field by Tikhonov's method, and draw samples of its posterior."""
    array = field.array(depth=depth, noise=noise)
    skin = Skin(pad, array, nuisance=nuisance, uncertainty=uncertainty)
    readings = np.nan_to_num(field.displacement)
    touch = skin.reconstruct(readings, method=Iterated(order=order, rule=rule), components=COMPONENTS)
    errors = None if touch._errors is None else touch._errors.posterior
    if not isinstance(errors, LinearErrors):
        raise RuntimeError("the linear method has errors of its own")
    samples = errors.draws(draws, np.random.default_rng(seed))[0]
    # work is done by the displacement of the surface, however deep the beads lie
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
