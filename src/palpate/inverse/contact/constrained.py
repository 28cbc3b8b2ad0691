"""method="constrained": one penalised problem with its constraints, solved exactly.

The penalty is the first derivative of traction, evenly weighed; its weight and the noise come from marginal likelihood of the
linear model (`palpate.inverse.linear.parameter`) where they are not given. Pressure never pulls, shear stays inside the friction cone.
It is solved over the cells where contact is possible (`palpate.inverse.constrained.cone`); cells are added until none is missing. This is
what `palpate.inverse.contact.adaptive` starts from and what `palpate.tracking` repeats frame after frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property, few_threads
from palpate.elastic.pad import Floats
from palpate.inverse.constrained.model import ContactModel, dilated
from palpate.inverse.contact.answer import nothing_fits
from palpate.inverse.contact.frame import Frame
from palpate.inverse.contact.gathered import gathered
from palpate.inverse.contact.overload import solve_within_range
from palpate.inverse.contact.prepared import PreparedContact, TooLarge
from palpate.inverse.estimate import Estimate, batch_of, frames_of
from palpate.inverse.linear.evidence import LinearEvidence

__all__ = ["ConstrainedEstimator"]

Flags = npt.NDArray[np.bool_]


class ConstrainedEstimator(PreparedContact):
    """The constrained estimator, prepared once for a problem and its constraints."""

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction from one readings array (*batch, channel, *array) per plane; every frame is decided alone."""
        return gathered(self, self.frames(readings, rng), batch_of(readings, self.operator), readings[0])

    def frames(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> list[Frame]:
        """The result of each frame, counted over all batch axes."""
        frames, batch = [], batch_of(readings, self.operator)
        for f in frames_of(readings, self.operator):
            with few_threads(self.widest, len(self.readings.std)), self.rounds:
                try:
                    frames.append(solve_within_range(self, f, rng))
                except TooLarge as error:
                    frames.append(nothing_fits(self, self.data_of(f)[0], str(error)))
                if math.prod(batch) > 1:
                    frames[-1] = replace(frames[-1], errors=frames[-1].known)
        return frames

    @cached_property
    def even_noise(self) -> ConstrainedEstimator:
        """The same estimator with one noise level for all channels of a kind (`Problem.with_even_noise`)."""
        problem = self.problem.with_even_noise()
        out = ConstrainedEstimator(problem, self.cone, parameter=self.parameter, draws=self.draws, policy=self.policy)
        out.signs = tuple(sign for sign in self.signs if sign)
        return out

    def models(
        self,
        first: Floats,
        y: Floats,
        noise: Floats,
        observed: Flags,
        evidence: Mapping[int, LinearEvidence],
        near: ContactModel | None = None,
    ) -> Iterator[ContactModel]:
        """Yield the one model of a frame: the constrained solution on the contact and a margin around it.

        Pressure farther away is noise (noise pressed to be non-negative keeps half of itself), and so is a patch that
        improves the fit no more than noise would.
        """
        import scipy.ndimage

        policy = self.policy
        level = self.level(1)
        precisions = self.precisions(level, 1, evidence[1].weight)
        region = dilated(
            (first[-1] > policy.extent.faint * first[-1].max()).reshape(level.grid.shape), policy.extent.margin
        )
        cells = np.flatnonzero(region)
        data = self.normal(level, cells, y, noise, observed)
        patches = scipy.ndimage.label(region, np.ones((3,) * region.ndim))[0].ravel()[cells]
        weight = {}
        for patch in np.unique(patches):
            alone = np.where(patches == patch, first[:, cells], 0.0)
            weight[patch] = 0.5 * float(((data.matrix @ alone.ravel()) ** 2).sum())
        largest = max(weight, key=lambda patch: weight[patch])
        kept = [patch for patch, w in weight.items() if w > policy.detection.patch or patch == largest]
        position = np.flatnonzero(np.isin(patches, kept))
        model = self.model(data.part(position), precisions, first[:, cells[position]], keep_face=True)
        pressure = model.solution.traction[-1]
        sure = np.flatnonzero(pressure >= policy.extent.faint * pressure.max())  # all of them where nothing presses
        model.contact = self.model(model.data.part(sure), precisions, model.solution.traction[:, sure], keep_face=True)
        model.weight = 1.0
        yield model
