"""Solve for the contact in one frame of a stream, and judge whether it fits the readings.

The contact pushes and is solved from all readings except outliers, or its traction has either sign. A frame that fits
like the ones before costs one solution. If the misfit is unusual, and at regular intervals, the tracker checks whether
something else explains that frame better: pressure on more cells, wrong readings, or traction that pulls.

| `Contact.pushing` | every frame | at regular intervals, and where the misfit is unusual |
|---|---|---|
| True | `_push`, then `_refined`: learn the penalty if too much is left | `_weigh`: push against pull |
| False | `_follow_pull`: `_pull` | `_weigh`; also where it no longer pulls or fits |

A frame is *late* after many that were not finished: it waits for the thread, and is finished whatever the time. *Fresh*
is the first frame of a contact.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from functools import partial

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.discrepancy import degrees_of_share
from palpate.inverse.contact.noise import MEDIAN
from palpate.inverse.estimate import Errors, Stated
from palpate.inverse.fit import DISCREPANCY, POOR_FIT
from palpate.tracking.background import Background
from palpate.tracking.discrepancy import LARGEST, share_of
from palpate.tracking.dragging import Drag, Dragging
from palpate.tracking.errors import ErrorBars
from palpate.tracking.frames import Alternative, Frame, Residual
from palpate.tracking.health import Flags, Index, ReadingCheck
from palpate.tracking.interim import Interim, wider
from palpate.tracking.iteration import Iteration
from palpate.tracking.learning import Learning
from palpate.tracking.misfit import probability_of
from palpate.tracking.offsets import Marginal, Offsets
from palpate.tracking.pulling import Pulling
from palpate.tracking.region import NormalEquations, Region
from palpate.tracking.search import TAKEN, Search
from palpate.tracking.trial import residual_by_penalty

__all__ = ["EVERY", "Contact"]

#: Longest number of frames between two checks for new contacts and bad taxels; a check costs about as much as a frame.
EVERY = 8
#: A reading is bad if its residual exceeds this many standard deviations and this fraction of the largest reading; the model of a pad may be wrong by some per cent of the largest reading.
UNEXPLAINED, GROSS = 8.0, 0.1
#: A bad reading distorts the solution around it. So only residuals above this fraction of the largest are judged in each turn; those hidden by them follow, in at most TURNS turns.
WORST, TURNS = 0.6, 8
#: With many unknowns, where each turn takes a second, those turns are spread over frames.
TURNS_OF_MANY = 3
#: If at most FEW of the readings (or FEWEST of them) are bad, accept the contact. Above that, compare it with pull. Above MOST, the contact is judged wrong, not the readings.
FEW, FEWEST, MOST = 0.02, 3, 0.2
#: A frame fits if its residual is at most this many times the noise, plus the fraction of the signal that the batch method allows. A root mean square of 1.5 over a hundred readings is seven of its
#: standard deviations.
EXCESS = 1.5
#: After this many consecutive frames without convergence, finish one frame whatever the time. Only finished frames reveal a penalty learned from incomplete readings, or a drifting zero: after a minute
#: of unfinished frames 1 N read 290 N.
PATIENCE = 32
#: Time [s] for which such a frame waits for the thread, since a stream without pauses leaves the thread no time.
UNDER_WAY = 0.1
#: Largest number of consecutive penalties to discard because readings were found bad while they were learned.
HOLED = 3
#: Background work whose result changes the solution.
MOVING = ("learn", "move")
#: How many times one frame waits for such work, if there is time.
ROUNDS_OF_WAITING = 5
#: Check at once if the misfit exceeds the noise by UNUSUAL of its standard deviations and exceeds ENERGY of the readings' energy (a dead taxel under a contact causes per cents), or TOLERATED times
#: what was accepted before.
UNUSUAL, ENERGY, TOLERATED = 6.0, 5e-4, 1.5
#: Traction of either sign fits only if it leaves at least this fraction of the degrees of freedom to noise.
LEAST_FREE = 0.05
#: Cells whose pressure would become negative suggest a pull if their score exceeds this fraction of the highest score, and the threshold for a new contact.
WANTS = 0.05
#: Prior log odds for a bad reading (one in 3000), and for a pull (as unlikely as a new contact in one of 1000 cells).
COST_OF_READING, COST_OF_PULL = 8.0, TAKEN**2


class Contact:
    """The contact of a stream, frame by frame."""

    def __init__(
        self,
        estimator: ConstrainedEstimator,
        equations: NormalEquations,
        learning: Learning,
        check: ReadingCheck,
        offsets: Offsets,
        background: Background,
        tolerance: float,
    ) -> None:
        self._estimator, self._equations, self._learning, self._check = estimator, equations, learning, check
        self._offsets, self._background, self._tolerance = offsets, background, tolerance
        self._limits = estimator.policy.detection
        self._solution = Iteration(estimator.cone, len(estimator.columns), math.prod(estimator.operator.surface.shape))
        self._search, self._errors = Search(estimator), ErrorBars(estimator, equations)
        self._interim = Interim(estimator)
        self._pulling = Pulling(estimator, equations)
        self._dragging = Dragging(estimator, equations)
        self.residual = math.nan
        self._unjudged: Residual | None = None
        self._told_by = ~check.unused  # the readings that the present penalty was learned from
        self.release()

    def release(self) -> None:
        """Forget the contact."""
        self._solution.clear()
        self._search.clear()
        self._errors.clear()
        self._pulling.clear()
        self._dragging.clear()
        self.drag: Drag | None = None
        self._background.forget()  # pending work belongs to the contact that has ended
        self._check.suspects[:] = False
        self._tolerated = ENERGY
        self.pushing = self.fits = True
        self.noise = 0.0
        self.fit = math.nan
        self._marginal: Marginal | None = None
        self._energy = self._objective = 0.0
        self._fresh = True
        self.errors: Errors | None = None
        self._behind = 0  # frames in a row that were not finished, or found no contact that pushes
        self._at_once = not self._background.threaded  # whether all is done in this frame
        self._since_learned = self._holed = 0
        self._learned_of = self._check.unused.copy()  # the readings that were not used when learning began
        self.observes = True  # whether the last frame told the offsets

    # -- results --------------------------------------------------------------------------------------------------------

    @property
    def _present(self) -> Iteration | Pulling:
        return self._solution if self.pushing else self._pulling

    @property
    def cells(self) -> Index | None:
        """Flat indices of the surface cells for which `traction` is given; None without contact."""
        return self._present.cells

    @property
    def traction(self) -> Floats:
        """Traction (component, cell) [Pa]."""
        return self._present.traction

    @property
    def exhausted(self) -> bool:
        """Whether the iteration ended because of its number of steps, not its time."""
        return self._solution.exhausted

    @property
    def judged(self) -> bool:
        """Whether its error bars have been computed."""
        return self._errors.errors is not None

    @property
    def size(self) -> float:
        """Sum of the pressure's magnitudes [Pa] over the cells, for comparison between frames."""
        return float(np.abs(self.traction[-1]).sum())

    @property
    def _net_pull(self) -> bool:
        """Whether traction of either sign pulls in total."""
        return float(self._pulling.traction[-1].sum()) < 0.0

    @property
    def stated(self) -> Stated | None:
        """Errors due to pad properties that are not known exactly."""
        return self._errors.stated

    def undetected(self, noise: float | None, y: Floats | None) -> Errors | None:
        """Errors of a frame without contact: the largest contact that would not be detected."""
        return self._errors.without_contact(noise, y)

    # -- one frame -----------------------------------------------------------------------------------------------------

    def solve(self, frame: Frame, *, regular: bool) -> bool:
        """Solve for the contact in a frame; False if the iteration did not converge.

        ``regular``: check alternatives even if the misfit is normal.
        """
        regular = regular or self._fresh
        late = self._behind >= PATIENCE
        self._at_once = late or not self._background.threaded
        if late:
            frame, regular, self._behind = frame._replace(deadline=math.inf), True, 0
            self._background.wait(MOVING, self._under_way())
        used = self._check.unused
        # the penalty is learned from readings that this frame's contact fills: filled by the last one, a load that has jumped is ragged there
        filling = self.pushing and self.cells is not None and bool(used.any())
        converged = self._push(frame) if filling else True
        learned = self._learn(frame)
        noise = self._noise(frame, np.isfinite(frame.actual) & ~used)
        frame = frame._replace(noise=noise)
        if self.pushing:
            converged = self._push(frame) if learned or not filling else converged
            learned, converged = self._refined(frame, learned, converged, regular=regular, late=late)
        else:
            converged = self._follow_pull(frame, converged, regular=regular)
        unused = self._check.unused
        # With a thread, `_learn` drops a penalty that is being learned from such readings.
        lost = not self._background.threaded and bool((unused & self._told_by).any())
        if self.pushing and (unused.any() if self._fresh else lost or not np.array_equal(unused, used)):
            converged = self._relearn_for_other_readings(frame, learned or lost, converged)
        self._fresh = False
        behind = self._background.threaded and not (converged and self.pushing)
        self._behind = self._behind + 1 if behind and not late else 0
        self._finish(frame, converged)
        return converged

    def _follow_pull(self, frame: Frame, converged: bool, *, regular: bool) -> bool:
        """Solve traction of either sign. Compare it with contact that pushes if it no longer pulls or no longer fits, but
        a frame that nothing explained before only in ``regular`` frames.
        """
        pulled = self._net_pull
        residual = self._pull(frame)
        ended = pulled and not self._net_pull
        if regular or ended or (self.fits and not residual.fits):
            return self._weigh(frame)
        self._take(residual, frame.noise)
        return converged

    def _refined(self, frame: Frame, learned: bool, converged: bool, *, regular: bool, late: bool) -> tuple[bool, bool]:
        """Learn the penalty if contact that pushes leaves too much, and compare it with the alternatives if that does not
        help, or in a ``regular`` frame; whether the penalty was learned, and whether the iteration converged.
        """
        noise = frame.noise
        if self._beyond(noise, ENERGY) and not learned and self._learn(frame, misfit=True):
            learned, converged = True, self._push(frame)
        unusual = self._beyond(noise, self._tolerated)
        until = self._under_way() if late else frame.deadline
        for _ in range(ROUNDS_OF_WAITING):
            # A result from the thread may require more work: a new penalty changes the cells.
            if not (unusual and self._background.wait(MOVING, until)):
                break
            learned = self._learn(frame) or learned
            converged = self._push(frame)
            unusual = self._beyond(noise, self._tolerated)
        if not (regular or unusual):
            return learned, converged
        moving = any(name in self._background for name in MOVING)
        if late or ((converged or self._at_once) and not moving):
            return learned, self._weigh(frame)
        return learned, converged and not unusual  # if unusual, the cells are about to move

    def _relearn_for_other_readings(self, frame: Frame, learned: bool, converged: bool) -> bool:
        """Learn the penalty again, because other readings are in use. Missing readings look like fine detail, so it is
        learned from readings filled by a smooth contact.
        """
        if not (learned if self._at_once else self._since_learned < PATIENCE):
            return converged
        self._background.drop("learn")
        self._discard_penalty(frame, self._check.unused)
        if not self._at_once:
            return converged
        self._push(frame)
        if self._learn(frame) or (self._background.wait(("learn",), self._under_way()) and self._learn(frame)):
            self._push(frame)
            converged = self._weigh(frame)
        return converged

    def _noise(self, frame: Frame, used: Flags) -> float:
        """Noise of a frame in contact, as far as it is learned."""
        learned = self._learning.in_contact(frame.actual[used])
        return frame.noise if learned is None else learned

    def _discard_penalty(self, frame: Frame, unused: Flags) -> None:
        """Discard a penalty that was learned from readings that are now excluded."""
        largest = float(self._equations.diagonal.max())
        self._told_by = ~unused
        self._learning.again(np.where(unused, 0.0, frame.actual), frame.noise, largest)

    def _learn(self, frame: Frame, *, misfit: bool = False) -> bool:
        """Learn penalty and noise if the load has changed; return whether they changed."""
        unused = self._check.unused
        if "learn" not in self._background:
            self._learned_of = unused.copy()
        elif self._holed < HOLED and (unused & ~self._learned_of).any():
            # Missing readings look like fine detail. Discard a penalty learned from them and learn it from readings filled by a smooth contact.
            self._holed += 1
            self._background.drop("learn")
            self._discard_penalty(frame, unused)
            self._learned_of = unused.copy()
        filled = self._filled(frame)
        # Include readings that the contact does not fit: if the penalty is too smooth, the contact fits few.
        came = np.where(self._check.suspects & np.isfinite(frame.actual), frame.actual, filled)
        changed = self._learning.learn(
            filled,
            frame.noise,
            float(self._equations.diagonal.max()),
            self._background,
            energy=float(came @ came),
            leaving=lambda: self._leaving(filled, frame.noise),
            misfit=misfit,
        )
        self._since_learned = 0 if changed else self._since_learned + 1
        self._holed = 0 if changed else self._holed
        if changed:
            self._told_by = ~self._learned_of
            self._errors.outdate(later=True)
        return changed

    def _leaving(self, y: Floats, noise: float) -> Callable[[float], float]:
        """A function from penalty to the residual of pushing contact, in the present region or where it would start."""
        region = self._solution.region if self.pushing else None
        cells = None if region is None else self._enough(region)
        return residual_by_penalty(self._estimator, self._equations, self._search, y, noise, cells, self._tolerance)

    def _finish(self, frame: Frame, converged: bool) -> None:
        """Update offsets, error bars, drag and fit."""
        y = np.where(self._check.unused, 0.0, frame.actual)
        if not converged and self.pushing:
            self._level(self._push_residual(frame), frame.noise)
        if self.fits:
            self._offsets.seen(y, frame.noise)
        self._update_errors(y, converged)
        self.drag = self._drag(frame, y) if self.pushing else None
        if self._unjudged is None and self.fit < POOR_FIT and self.pushing:
            self._unjudged = self._push_residual(frame)  # that a frame is not explained is no news of the next
        if self._unjudged is not None:
            self.fit, self._unjudged = self._fit(self._unjudged, frame), None
        self.observes = converged
        self._update_offsets(y)

    def _update_errors(self, y: Floats, converged: bool) -> None:
        """Update the error bars; interim ones where the others are not made yet, or the iteration has not converged."""
        if self.pushing or self.fits:
            self._errors.refresh(self._present, y, self.noise, self._check.unused, self._background, self._offsets)
        else:
            self._errors.clear()  # what no traction explains has no numbers
        bars = self._errors.errors
        if self.pushing:
            if bars is None or not self._errors.serves(self._solution):
                bars = wider(bars, self._interim.errors(self._solution, self.noise))
            bars = bars if converged or bars is None else self._interim.unconverged(self._solution, bars)
        self.errors = bars

    def _drag(self, frame: Frame, y: Floats) -> Drag | None:
        """Drag of a contact that pushes."""
        return self._dragging.found(
            self._solution,
            self._equations.adjoint(y, self._check.unused),
            self._sums,
            self._check.unused,
            self._offsets,
            self.noise * frame.noisier,
            float(np.abs(y).max(initial=0.0)),
        )

    def _update_offsets(self, y: Floats) -> None:
        """Update the offsets by what the frame tells of them."""
        observed, contact, unused = self._errors.observed, self._present.contact, self._check.unused
        if observed is None or contact is None or not self.fits:
            return
        if not np.array_equal(observed.unused, unused):
            self._errors.age()
            return
        innovation = observed.innovation(self._sums, self._equations.adjoint(y, unused), *contact)
        self._offsets.update(observed.counts, innovation, self.noise)

    @property
    def _sums(self) -> Floats:
        """Sums over the readings of the frame that was solved (`Marginal.sums`)."""
        if self._marginal is None:
            raise RuntimeError("the frame was not solved")
        return self._marginal.sums

    def _fit(self, residual: Residual, frame: Frame) -> float:
        """Misfit probability of the residual."""
        used = ~residual.unused
        return probability_of(
            self._estimator,
            residual.values,
            used,
            self._noise(frame, used) * frame.noisier,
            largest=float(np.abs(frame.actual[used]).max(initial=0.0)),
            taken=min(self._taken(int(used.sum())) + self._offsets.columns.shape[1], used.sum() - 1.0),
            known=self._learning.noise_known,
            ordered=self._learning.discrepancy.least * float(np.sqrt(np.mean(frame.actual[used] ** 2))),
        )

    @property
    def _parameter(self) -> float:
        return self._learning.parameter or 1.0

    def _filled(self, frame: Frame) -> Floats:
        """The readings, with predictions in place of unused ones; saturated readings keep at least their value."""
        unused, clipped = self._check.unused, self._check.clipped
        if not unused.any():
            return frame.actual
        explained = self._equations.explained(self.cells, self.traction)
        lower_bound = np.where(clipped, frame.actual, 0.0)
        saturated = np.where(lower_bound < 0.0, np.minimum(explained, lower_bound), np.maximum(explained, lower_bound))
        return np.where(unused, np.where(clipped, saturated, explained), frame.actual)

    # -- alternatives ---------------------------------------------------------------------------------------------------

    def _prepared(self, frame: Frame) -> tuple[Floats, Flags, Marginal]:
        unused = self._check.unused
        y = np.where(unused, 0.0, frame.actual)
        return y, unused, self._offsets.marginal(y, unused, frame.noise)

    def _push(self, frame: Frame) -> bool:
        """Solve pushing contact on the readings in use."""
        y, unused, marginal = self._prepared(frame)
        equations, solution = self._equations, self._solution
        slope = equations.adjoint(y, unused)
        score = equations.score(slope) / frame.noise
        gain = marginal.gain if marginal.gain.any() else None
        if gain is not None:
            slope = slope - equations.of_offsets(gain @ marginal.sums, unused)
        region, parameter = solution.region, self._learning.parameter
        if not self._at_once or region is None or region.parameter != parameter:
            self._renew()  # otherwise after the move: that one may build the same region with more cells
        if solution.region is None and self._check.clipped.any():
            # Pressure is highest where readings are saturated.
            score = equations.score(
                equations.adjoint(np.where(self._check.clipped, frame.actual, y), unused & ~self._check.clipped)
            )
            score = score / frame.noise
        self._move(score, y, frame.noise)
        self._renew()
        converged = solution.solve(slope, gain, tolerance=self._tolerance, deadline=frame.deadline)
        self._marginal = marginal
        white = y if self._estimator.readings.independent else self._estimator.readings.white(y[~unused], ~unused)
        self._energy = float(white @ white)
        self._objective = self._energy - float(marginal.sums @ marginal.gain @ marginal.sums) - solution.product
        self._used = int((~unused).sum())
        return converged

    def _pull(self, frame: Frame) -> Residual:
        """Solve traction of either sign."""
        y, unused, marginal = self._prepared(frame)
        self._pulling.solve(y, frame.noise, unused, self._parameter, marginal)
        self._marginal = marginal
        return self._residual_of(
            frame, self._equations.explained(self._pulling.cells, self._pulling.traction), self._pulling.shared()
        )

    def _beyond(self, noise: float, tolerated: float) -> bool:
        """Whether the misfit exceeds the noise plus a fraction ``tolerated`` of the readings' energy."""
        n = self._used
        return self._objective > noise**2 * (n + UNUSUAL * math.sqrt(2.0 * n)) + tolerated * self._energy

    def _residual_of(self, frame: Frame, explained: Floats, shared: Floats) -> Residual:
        """Residual of a solution in this frame."""
        if self._marginal is None:
            raise RuntimeError("the frame was not solved")
        unused = self._check.unused
        shift = self._marginal.gain @ (self._marginal.sums - shared)
        residual = frame.actual - explained - shift[self._offsets.index]
        residual = np.where(np.isfinite(residual), residual, 0.0)
        used = ~unused
        rms = float(np.sqrt(np.mean(residual[used] ** 2)))
        signal = float(np.sqrt(np.mean(frame.actual[used] ** 2)))
        fits = rms <= math.hypot(EXCESS * frame.noise, self._limits.unexplained_signal * signal)
        return Residual(residual, rms, unused.copy(), fits)

    def _push_residual(self, frame: Frame) -> Residual:
        """Residual of the present pushing contact in this frame."""
        solution = self._solution
        explained = self._equations.explained(solution.cells, solution.traction, single=True)
        return self._residual_of(frame, explained, solution.shared())

    def _wrong(self, frame: Frame, residual: Residual) -> tuple[Flags, float]:
        """Mask of readings with the largest residuals, and the limit beyond which a residual counts as wrong."""
        used, values = ~residual.unused, residual.values
        typical = self._typical(frame, residual)
        largest = float(np.abs(np.where(used, frame.actual, 0.0)).max())
        limit = max(UNEXPLAINED * typical, GROSS * largest)
        size = np.where(np.isfinite(frame.actual) & ~self._check.clipped, np.abs(values), 0.0)
        unsuspected = np.where(self._check.suspects, 0.0, size)
        worst = unsuspected > max(limit, WORST * float(unsuspected.max()))
        return worst | (self._check.suspects & (size > limit)), limit

    def _typical(self, frame: Frame, residual: Residual) -> float:
        """Typical size of the residual of a reading, at least the noise."""
        return max(frame.noise, float(np.median(np.abs(residual.values[~residual.unused]))) / MEDIAN)

    def _weigh(self, frame: Frame) -> bool:
        """Compare the alternatives and take the best."""
        check, before = self._check, self._check.suspects.copy()
        push = self._pushed(frame)
        pushed, converged = push.residual, push.converged
        if pushed.fits and not push.pulls and push.suspects.sum() <= max(FEWEST, FEW * len(pushed.values)):
            return self._accept_push(frame, pushed, converged)
        check.suspects[:] = False
        pull = self._pulled(frame)
        unexplained = DISCREPANCY if self._learning.discrepancy.zeroed else self._limits.unexplained_signal
        variance = frame.noise**2 + (unexplained * float(np.sqrt(np.mean(frame.actual[~pushed.unused] ** 2)))) ** 2
        if _cost(pull, variance) + COST_OF_PULL < _cost(push, variance):
            self.pushing = False
            self._solution.clear()
            self._take(pull.residual, frame.noise)
            self._errors.outdate()
            return True
        # Back to the push: the pull has changed the suspects and the offsets.
        check.suspects[:] = push.suspects if pushed.fits else before & push.suspects
        self._marginal = push.marginal
        if not np.array_equal(check.unused, pushed.unused) or self._solution.region is None:
            converged = self._push(frame)
            pushed = self._push_residual(frame)
        return self._accept_push(frame, pushed, converged)

    def _accept_push(self, frame: Frame, pushed: Residual, converged: bool) -> bool:
        self.pushing = True
        self._pulling.clear()
        frame, pushed = self._with_discrepancy(frame, pushed)
        if pushed.fits and self._check.suspects.sum() <= MOST * len(pushed.values):
            _, limit = self._wrong(frame, pushed)
            self._check.judge(self._check.suspects.copy(), pushed.values, limit, EVERY)
        excess = self._objective - frame.noise**2 * self._used
        self._tolerated = max(ENERGY, TOLERATED * excess / max(self._energy, 1e-300))
        self._take(pushed, frame.noise)
        return converged

    def _with_discrepancy(self, frame: Frame, residual: Residual) -> tuple[Frame, Residual]:
        """Learn the discrepancy of the pad's model; accept a frame whose residual it explains."""
        noise, discrepancy, used = self._learning.noise, self._learning.discrepancy, ~residual.unused
        if noise is None or not discrepancy.zeroed or not used.any():
            return frame, residual
        size, count = float(np.sqrt(np.mean(frame.actual[used] ** 2))), int(used.sum())
        free = count - self._taken(count)
        share = share_of(residual.rms, noise, size, used=count, free=free)
        if share <= LARGEST:
            discrepancy.look(share, free=degrees_of_share(share, free, frame.actual[used]))
            if not residual.fits:
                discrepancy.raised(share)
            frame, residual = frame._replace(noise=discrepancy.noise(noise, size)), residual._replace(fits=True)
        return frame, residual

    def _taken(self, count: int) -> float:
        """Degrees of freedom that the contact uses of ``count`` readings, at most one less than these."""
        freedom = self._errors.taken
        if math.isnan(freedom) and not self.pushing:
            freedom = self._estimator.start.freedom(self._parameter)
        elif math.isnan(freedom):
            freedom = self._estimator.taken(self._solution.pressure, self._parameter)
        return min(freedom, count - 1.0)

    def _take(self, residual: Residual, noise: float) -> None:
        self.fits, self.residual, self._unjudged = residual.fits, residual.rms, residual
        self._level(residual, noise)

    def _level(self, residual: Residual, noise: float) -> None:
        """Set the noise level used for error bars."""
        level = noise if residual.fits else max(noise, residual.rms)
        if not 0.8 * level < self.noise < 1.25 * level:
            self._errors.outdate()
            self.noise = level

    def _pushed(self, frame: Frame) -> Alternative:
        """Solve pushing contact, add cells where pressure is missing, and exclude readings that it does not fit."""
        check, equations, solution = self._check, self._equations, self._solution
        if solution.region is None or not self.pushing:
            self._search.clear()
            converged = self._push(frame)
        else:
            converged = True
        pulls = False
        region = solution.region
        turns = TURNS_OF_MANY if region is not None and self._search.many(len(region.cells)) else TURNS
        for turn in range(turns):
            residual = self._push_residual(frame)
            wrong, _ = self._wrong(frame, residual)
            plausible = bool(wrong.mean() <= MOST)
            wrong = wrong & plausible & ~check.health.left_out
            changed = not np.array_equal(wrong, check.suspects)
            unexplained = np.where(residual.unused | wrong, 0.0, residual.values)
            typical = self._typical(frame, residual)
            score = equations.score(equations.adjoint(unexplained, residual.unused)) / typical
            highest = float(
                equations.score(equations.adjoint(np.where(residual.unused, 0.0, frame.actual), residual.unused)).max()
            )
            pulls = bool(score.min() < -max(TAKEN, WANTS * highest / typical))
            if solution.region is not None:
                score[solution.region.cells] = 0.0
            missing = score > TAKEN
            if missing.any() and not changed:  # a wrong reading bends the solution round it
                y = np.where(residual.unused, 0.0, frame.actual)
                self._search.request(missing, y, frame.noise, residual.unused, self._parameter)
            check.suspects = wrong
            # With a time budget, missing cells are added in later frames.
            if turn == turns - 1 or not (changed or (missing.any() and self._at_once)):
                break
            region = solution.region
            converged = self._push(frame)
            if not changed and solution.region is region:
                residual = self._push_residual(frame)
                break
        return Alternative(residual, check.suspects.copy(), self._marginal, converged, pulls)

    def _pulled(self, frame: Frame) -> Alternative:
        """Solve traction of either sign, and exclude readings that it does not fit."""
        check = self._check
        residual = self._pull(frame)
        for _ in range(TURNS):
            wrong, _ = self._wrong(frame, residual)
            wrong = wrong & ~check.health.left_out
            if wrong.mean() > MOST:
                check.suspects[:] = False
                residual = self._pull(frame)
                break
            if np.array_equal(wrong, check.suspects):
                break
            check.suspects = wrong
            residual = self._pull(frame)
        # Traction with as many degrees of freedom as readings fits anything.
        used = float((~residual.unused).sum())
        free = used - self._estimator.start.freedom(self._parameter)
        residual = residual._replace(fits=residual.fits and free >= LEAST_FREE * used)
        return Alternative(residual, check.suspects.copy(), self._marginal)

    # -- cells ----------------------------------------------------------------------------------------------------------

    def _making(self, cells: Index) -> Callable[[], Region]:
        """The task of building a region, for the readings and the penalty of this frame."""
        return partial(self._equations.region, cells, self._parameter, self._check.unused)

    def _renew(self) -> None:
        """Rebuild the region's inverse if the penalty or the set of readings has changed."""
        region = self._solution.region
        if region is None or self._holds(region):
            return
        # A new penalty needs a new inverse anyway, so drop unneeded cells.
        cells = self._enough(region) if region.parameter != self._learning.parameter else region.cells
        if self._background.threaded and self._serves(region):
            # Keep using the old region until the new one is built (`_move`).
            if "move" not in self._background:
                self._background.result("move", self._making(cells))
            return
        self._solution.move(self._making(cells)())

    def _enough(self, region: Region) -> Index:
        """The cells that a region needs, if fewer than it has."""
        needed = self._search.needed(self._solution)
        fewer = 0 < len(needed) < len(region.cells) and np.isin(needed, region.cells).all()
        return needed if fewer else region.cells

    def _holds(self, region: Region) -> bool:
        return region.parameter == self._learning.parameter and np.array_equal(region.unused, self._check.unused)

    def _serves(self, region: Region) -> bool:
        """Whether a region was built for the readings in use. With a thread, a slightly outdated penalty is acceptable."""
        if not self._background.threaded:
            return self._holds(region)
        return np.array_equal(region.unused, self._check.unused)

    def _move(self, score: Floats, y: Floats, noise: float) -> None:
        """Keep the contact and a margin inside the region."""
        region = self._solution.region
        if region is None:
            self._moved(self._making(self._search.first(score, y, noise, self._check.unused, self._parameter))())
        elif "move" in self._background:
            matrix = self._background.result("move", lambda: None)
            if matrix is not None:
                # Penalty and readings may have changed in the meantime.
                self._moved(matrix if self._serves(matrix) else self._making(matrix.cells)())
        else:
            cells = self._search.next(self._solution)
            if cells is None:
                return
            making = self._making(cells)
            matrix = self._background.result("move", making)
            if matrix is None and self._at_once and self._background.wait(("move",), self._under_way()):
                matrix = self._background.result("move", lambda: None)
            if matrix is not None:
                self._moved(matrix)

    def _under_way(self) -> float:
        """Deadline until which a late frame waits for the thread, in `time.perf_counter`."""
        return clock.perf_counter() + UNDER_WAY

    def _moved(self, region: Region) -> None:
        self._solution.move(region)
        self._search.moved()


def _cost(tried: Alternative, variance: float) -> float:
    """Half the squares of the residual in units of ``variance``, plus what the readings that count as wrong cost."""
    used = float((~tried.residual.unused).sum())
    return 0.5 * tried.residual.rms**2 * used / variance + COST_OF_READING * int(tried.suspects.sum())
