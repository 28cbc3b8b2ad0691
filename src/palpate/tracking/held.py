"""Answer frames with the models of the last single solve of the same contact.

The tracker's own model has one even penalty on cells of the surface, because it has to serve any frame: noise presses
each of its cells a little, and on 4 x 4 taxels of three channels it reads 1.8 times the force. A single solve also finds
fine cells, local penalties and discs. Its models serve the following frames while the same contact presses
(`palpate.inverse.contact.again`), in a millisecond or two, or ten with friction. A frame is of the same contact if they leave
no more of it than of the frame of the single solve, up to noise. If they leave more, the tracker answers by itself until
the next comparison; its interval then reaches from its own result as far as the last single solve was from it.
"""

from __future__ import annotations

import math
import time as clock
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.again import Again
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.estimate import Errors, Stated
from palpate.status import Status
from palpate.touch import Touch
from palpate.touch.fields import ErrorParts
from palpate.tracking.contact import Contact
from palpate.tracking.discrepancy import widened
from palpate.tracking.frames import Frame, Numbers
from palpate.tracking.health import Flags
from palpate.tracking.offsets import Offsets
from palpate.tracking.region import NormalEquations, on_surface
from palpate.tracking.single import Answer, Compared, Comparison, Single

__all__ = ["Held", "HeldAnswer", "own_force", "own_traction"]

#: The models do not explain a frame if they leave more than they left of theirs, by this many standard deviations: of the
#: sum of squares of noise, or of the pressure of any cell alone.
UNUSUAL = 6.0
#: A contact grows with its load, and local penalties hold it back: beyond this factor, a comparison is due. The force of a
#: ball on 32 x 32 x 3 was still right to 2 % at 1.9, but the error of the pressure rose from 0.09 to 0.24.
GROWN = 1.4
#: Models that leave fewer degrees of freedom explain any frame; the interval then reaches as far as the tracker's own
#: result. On four barometers (benchmarks/real.py), they answered for presses elsewhere: 0.91 of the forces were inside.
FREE = 2.0


class HeldAnswer(NamedTuple):
    """Traction (component, *surface) of a frame by the models of a single solve, its errors, the discrepancy, the single
    solve and the root mean square of the residual in units of the noise. ``proven``: the residual shows that they hold;
    ``pushes``: no cell may pull; ``apart``: how far the force lies from that with other offsets; ``unused`` (reading,):
    readings that were left out; ``notes`` about the contact.
    """

    traction: Floats
    errors: Errors
    stated: Stated | None
    discrepancy: float
    single: Touch
    residual: float
    proven: bool
    pushes: bool
    apart: float
    unused: Flags
    notes: tuple[str, ...]


@dataclass
class _Kept:
    """Models, the single solve they come from, its errors, its load [N], and of its frame the root mean square of the
    residual and the largest score of pressure in it; ``free``: degrees of freedom of that residual.
    """

    again: Again
    single: Touch
    errors: ErrorParts
    load: float
    left: float
    score: float
    free: float
    pushes: bool
    notes: tuple[str, ...]
    seconds: float = 0.0  # that the last frame took


class Held:
    """Holds the models of the last single solve of this contact.

    ``answer`` is that to the last frame, None if they do not explain it; ``apart`` how far the single solve was from the
    tracker's own result, as a part of the load.
    """

    def __init__(self, estimator: ConstrainedEstimator, equations: NormalEquations) -> None:
        self._estimator, self._equations = estimator, equations
        self.clear()

    def clear(self) -> None:
        """Forget the models: the contact has ended."""
        self._kept: _Kept | None = None
        self.answer: HeldAnswer | None = None
        self.apart = 0.0
        self.stale = False  # whether the models do not explain the last frame, or its load has outgrown them
        self.missing = False  # whether the last single solve has no models that can be held

    @property
    def has_offsets(self) -> bool:
        """Whether the single solve found offsets or other patterns in the readings."""
        sizes = None if self._kept is None else self._kept.single.nuisance
        return sizes is not None and bool(np.nan_to_num(sizes).any())

    def hold(self, single: Single, compared: Compared, reference: Answer) -> None:
        """Hold the models of a single solve that agrees with the tracker: ``reference`` are its numbers."""
        self.clear()
        load = max(reference.load, compared.answer.load)
        if reference.explained and load > 0.0:
            self.apart = float(np.abs(reference.force - compared.own).max()) / load
        touch, models = single.touch, single.models
        solved = int(np.asarray(touch.status)) in (Status.SOLVED, Status.OVERLOAD) and reference.meets(compared.answer)
        if models is None or touch._errors is None or not solved:
            self.missing = True
        elif models.serve:
            again = Again(models)
            traction, residual = again.solve(self._planes(compared.readings), ~again.observed)
            left, score = self._left(again, residual, ~again.observed)
            if (size := self._load(traction)) > 0.0:
                self._kept = _Kept(
                    again, touch, touch._errors, size, left, score / left, models.free, models.pushes, single.notes
                )

    def follow(self, frame: Frame, offsets: Offsets, unused: Flags, *, pushing: bool) -> None:
        """Answer a frame (with its offsets) if the models explain it without the ``unused`` readings, and before its
        deadline. Models that are not proven answer only if the tracker's own model is ``pushing`` as they are.

        Offsets that only the tracker found are drift since the single solve, or part of the contact that does not show in
        one frame of few readings: the force is that without them, and its interval reaches as far as that with them.
        """
        drifted = offsets.beyond(frame.noise) and not self.has_offsets
        self.missing |= drifted
        kept, self.answer, self.stale = self._kept, None, False
        started = clock.perf_counter()
        if kept is None or not kept.again.serves(unused) or started + kept.seconds > frame.deadline:
            return
        # Each reading that is missing takes one degree of freedom at most.
        proven = kept.free - float((unused & kept.again.observed).sum()) >= FREE
        if not proven and pushing != kept.pushes:
            return
        apart, total, std = 0.0, self._estimator.surface.total_force, self._estimator.readings.std
        drift = offsets.value() if drifted else np.zeros_like(std)
        traction, residual = kept.again.solve(self._planes((frame.actual - drift) * std), unused)
        if drifted:
            other, _ = kept.again.solve(self._planes(frame.actual * std), unused)
            apart = float(np.abs(total(traction) - total(other)).max())
        kept.seconds = clock.perf_counter() - started
        grows = max(self._load(traction) / kept.load, 1.0)
        used = kept.again.observed & ~unused
        left, score = self._left(kept.again, residual, unused)
        loud = left**2 > (grows * kept.left) ** 2 * (1.0 + UNUSUAL * math.sqrt(2.0 / max(used.sum(), 1)))
        unlike = loud or score / kept.left > grows * max(UNUSUAL, kept.score)
        self.stale = unlike or grows > GROWN
        if not unlike:
            errors, pad, share = kept.errors.posterior, kept.errors.pad, kept.single.discrepancy
            wider = grows * kept.again.widening(unused)
            self.answer = HeldAnswer(
                traction,
                errors.times(wider),
                None if pad is None else pad.times(grows),
                0.0 if share is None else float(np.nan_to_num(share)),
                kept.single,
                left,
                proven,
                kept.pushes,
                apart,
                ~used,
                kept.notes,
            )

    def numbers(self, contact: Contact, share: float, comparison: Comparison, *, overload: bool) -> Numbers:
        """The numbers of a frame in contact: those of `answer`, or of the tracker's own model with the discrepancy
        ``share``. The interval reaches as far as the last single solve was from the tracker's own result.
        """
        answer, grid = self.answer, self._estimator.surface
        own = own_traction(self._estimator, contact)
        if answer is None:
            traction, errors, stated = own, contact.errors, contact.stated
        else:
            traction, errors, stated, share = answer.traction, answer.errors, answer.stated, answer.discrepancy
        if overload and errors is not None and contact.pushing:
            errors = replace(errors, beyond_force=np.full_like(errors.beyond_force, math.inf))  # no upper end
        load = float(grid.integral(np.sqrt((traction**2).sum(axis=0))))
        apart = self.apart * load if answer is None else answer.apart
        if answer is not None and not answer.proven:
            apart = max(apart, float(np.abs(grid.total_force(traction) - grid.total_force(own)).max()))
        spread = comparison.reaching(apart, load)
        if spread and traction.any():
            stated = widened(stated, traction, grid, spread)
        return Numbers(traction, errors, stated, share)

    def _left(self, again: Again, residual: Floats, unused: Flags) -> tuple[float, float]:
        """Root mean square of the residual, and the largest score of pressure in it: a contact that has moved is seen by
        few of many readings.
        """
        used = again.observed & ~unused
        slope = self._equations.adjoint_of(residual, ~used)
        score = float(np.abs(self._equations.score(slope)).max())
        return max(float(np.sqrt(np.mean(residual[used] ** 2))) if used.any() else 0.0, 1e-300), score

    def _planes(self, readings: Floats) -> list[Floats]:
        return self._estimator.readings.planes(np.nan_to_num(readings))

    def _load(self, traction: Floats) -> float:
        """The normal load."""
        return float(self._estimator.surface.integral(np.abs(traction[-1])))


def own_traction(estimator: ConstrainedEstimator, contact: Contact) -> Floats:
    """Traction (component, *surface) by the tracker's own model."""
    cells = np.zeros(0, dtype=np.intp) if contact.cells is None else contact.cells
    return on_surface(estimator, cells, contact.traction)


def own_force(estimator: ConstrainedEstimator, contact: Contact) -> Floats:
    """Net force by the tracker's own model."""
    return np.asarray(estimator.surface.total_force(own_traction(estimator, contact)))
