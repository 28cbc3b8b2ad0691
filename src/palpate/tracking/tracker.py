"""The loop of one frame.

A `Tracker` solves the problem of ``method="constrained"`` (`palpate.inverse.contact.constrained`) for every frame of a stream. What that
needs is prepared once: the normal matrix of the whole surface. Between frames it keeps the cells where contact is possible, the
inverse of their normal matrix, and the solution with its multipliers, from which a frame needs a few small matrix-vector products
(`palpate.tracking.iteration`).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from typing import Any

import numpy as np

from palpate._arrays import from_numpy
from palpate.elastic.pad import Floats
from palpate.elastic.viscoelastic import CreepFilter
from palpate.errors import InvalidInput
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.estimate import Errors
from palpate.sensing.readings import Layout
from palpate.status import Status
from palpate.touch import Touch
from palpate.tracking.background import Background
from palpate.tracking.errors import ErrorBars
from palpate.tracking.health import Flags, Health, ReadingCheck
from palpate.tracking.iteration import Iteration
from palpate.tracking.learning import NORMAL, Learning, rough_noise
from palpate.tracking.region import Index, NormalEquations, Region
from palpate.tracking.search import LOST, TAKEN, Search
from palpate.tracking.times import FrameTime, FrameTimes
from palpate.tracking.zero import Zero
from palpate.uncertainty import Case

__all__ = ["Tracker", "check_settings"]

#: Everything is looked at (new contacts, taxels that contact does not explain) once in so many frames: a look costs about as
#: much as a frame.
EVERY = 8
#: A reading is bad where it is this many standard deviations, and this part of the largest, from what contact explains: the model
#: of a pad may be wrong by some per cent of the largest reading.
UNEXPLAINED, GROSS = 8.0, 0.1
#: A wrong taxel bends the solution round it: of those that are not explained only the worst are judged, down to this part of the
#: largest misfit, and none where they are more than the second part of all (then it is the contact that is not found yet).
WORST, FEW = 0.6, 0.05
#: Part of the budget in which a frame's iteration ends; the rest is for the answer.
BUDGET_OF_ITERATION = 0.8


def check_settings(**settings: float | None) -> None:
    """Refuse settings that are no positive numbers; None, where it is a choice, passes."""
    for name, value in settings.items():
        if value is None and name in ("budget", "rezero"):
            continue
        if isinstance(value, bool) or not (isinstance(value, int | float) and math.isfinite(value) and value > 0):
            raise InvalidInput(f"{name} must be a positive number; got {value!r}.")


class Tracker:
    """Contact followed from frame to frame; made by `Skin.track`.

    Parameters
    ----------
    estimator : ConstrainedEstimator
        The problem of one frame.
    names : tuple of str
        Components sought.
    layout : Layout
        How readings are checked and ordered.
    baseline : int or array
        Frames at the start, without contact, whose mean is taken as zero; or the zero itself, one frame of readings; 0: the
        readings are zero already.
    tolerance : float
        Change of traction, as a part of its peak, at which a frame's iteration ends.
    budget : float, optional
        Seconds a frame may take. The iteration ends early where it must (``converged`` is then False), and what takes longer
        (learning the penalty, moving the region of interest, error bars) runs beside the stream in a thread of its own.
    rezero : float, optional
        Time constant [s], and at least ten frames, with which the zero follows drift while nothing touches; None keeps it.
    rate : float
        Frames a second, for streams whose frames come without a time.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
    >>> array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0)
    >>> skin = pp.Skin(pad, array)
    >>> press = pp.solutions.hertz_line(half_width=3e-3, force=10.0)
    >>> with skin.track() as tracker:
    ...     forces = [float(tracker.step(skin.sense(press.shifted(x))).force[1]) for x in (0.0, 1e-3, 2e-3)]
    >>> [round(f) for f in forces]  # three frames [N/m]
    [10, 10, 10]
    """

    def __init__(
        self,
        estimator: ConstrainedEstimator,
        names: tuple[str, ...],
        layout: Layout,
        *,
        notes: tuple[str, ...] = (),
        creep: Callable[[], list[CreepFilter | None]] | None = None,
        case: Case | None = None,
        baseline: Any = 0,
        tolerance: float = 1e-3,
        budget: float | None = None,
        rezero: float | None = 2.0,
        rate: float = 100.0,
        label: Callable[[int], str] = str,
    ) -> None:
        check_settings(tolerance=tolerance, rate=rate, budget=budget, rezero=rezero)
        self.estimator, self.names, self.notes = estimator, names, notes
        self.tolerance, self.budget, self.rezero, self.rate = tolerance, budget, rezero, rate
        self._make_creep, self._case = creep, case
        self._layout, self._limits, self._label = layout, layout.limits(), label
        self._std = estimator.readings.std
        self._zero_frames, self._given_zero = self._check_baseline(baseline)
        self._equations = NormalEquations(estimator)
        self._background = Background(threaded=budget is not None)
        self._seconds = 0.0
        self.reset()

    def _check_baseline(self, baseline: Any) -> tuple[int, Floats | None]:
        if isinstance(baseline, bool) or (isinstance(baseline, int | np.integer) and baseline < 0):
            raise InvalidInput(f"baseline must be a number of frames >= 0, or one frame of readings; got {baseline!r}.")
        if isinstance(baseline, int | np.integer):
            return int(baseline), np.zeros(len(self._std)) if baseline == 0 else None
        flat, _ = self._flat(baseline)
        if not np.isfinite(flat).all():
            raise InvalidInput(
                f"the baseline holds {np.count_nonzero(~np.isfinite(flat))} values that are not finite: give another frame, or leave "
                "these taxels out (Skin.masked)."
            )
        return 0, flat / self._std

    def reset(self) -> None:
        """Forget contact, drift, penalty and the state of the taxels, as before the first frame.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> tracker = skin.track(baseline=1)  # the first frame is the zero
        >>> touch = tracker.step([[0.0] * 21] * 2)
        >>> tracker.health.frames
        1

        >>> tracker.reset()
        >>> tracker.health.frames
        0
        """
        n, estimator = len(self._std), self.estimator
        self.health = Health(left_out=np.zeros(n, dtype=bool), reasons=np.zeros(n, dtype="<U12"), label=self._label)
        self._check = ReadingCheck(self.health, self._limits)
        self._times = FrameTimes(self.rate)
        self._zero = Zero(self._given_zero, self._zero_frames, self.rezero)
        self._learning = Learning(estimator)
        self._search = Search(estimator)
        self._solution = Iteration(estimator.cone, len(self.names), math.prod(estimator.operator.surface.shape))
        self._errors = ErrorBars(estimator)
        self._equations.reset()
        self._background.forget()
        self._touching = False
        self._held = np.zeros(n)  # the last good value of each reading, for the memory of creep
        self._filters = self._make_creep() if self._make_creep is not None else None
        self._residual = math.nan

    # -- one frame -----------------------------------------------------------------------------------------------------

    def step(self, reading: Any, time: float | None = None) -> Touch:
        """Contact in the next frame.

        Parameters
        ----------
        reading : array (channel, *array), or a list with one per plane
            In SI units. Values that are missing, not finite or out of range are left out in this frame where the others suffice, and
            for longer where it happens again and again (see `health`).
        time : float, optional
            Time of the frame [s]. A time before that of the last frame is taken for a clock that has begun anew: contact is found
            afresh, the zero is kept, and the touch says so in its notes.

        Returns
        -------
        Touch
            Without batch axes; always that of this frame. ``status`` says what became of it (`Status`): traction and all that follows
            from it are NaN where the frame has no answer. ``converged`` is False where the budget ended the iteration;
            ``outliers`` are the readings left out.

        Raises
        ------
        InvalidInput
            A reading of the wrong shape or kind, or a time that is not finite; the tracker is then as it was before.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> array = pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0)
        >>> skin = pp.Skin(pad, array)
        >>> tracker = skin.track()
        >>> touch = tracker.step(skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0)), time=0.01)
        >>> touch.time.item(), pp.Status.coded(touch.status).label, round(float(touch.force[1]))
        (0.01, 'solved', 10)

        >>> tracker.step([[0.0] * 21] * 2, time=0.02).force.tolist()  # let go
        [0.0, 0.0]
        """
        started = clock.perf_counter()
        flat, like = self._flat(reading)
        if time is not None and not math.isfinite(time):
            raise InvalidInput(f"time must be a finite number of seconds; got {time!r}.")
        frame = self._times.next(time)
        note = self._note(frame)
        try:
            status, converged = self._step(flat, frame.elapsed, started)
        except np.linalg.LinAlgError:
            # the next frame begins from nothing, so that what broke this one is not carried on
            self._release()
            status, converged = Status.FAILED, False
        touch = self._answer(status, frame.now, converged, like, note)
        self._seconds = clock.perf_counter() - started
        return touch

    def _note(self, frame: FrameTime) -> str | None:
        """Counts a frame whose time is out of order; what there is to say about it."""
        if frame.repeated:
            self.health.late += 1
        if not frame.restarted:
            return None
        self.health.restarts += 1
        self._release()
        creep = "; the pad's creep is taken on as if without a pause" if self._filters is not None else ""
        return f"the clock went back from {frame.before:g} s to {frame.now:g} s: contact is found afresh, the zero is kept{creep}"

    def _step(self, flat: Floats, elapsed: float, started: float) -> tuple[Status, bool]:
        """What becomes of a frame, and whether its iteration converged."""
        health, check, zero, learning = self.health, self._check, self._zero, self._learning
        health.frames += 1
        scaled = self._scaled(flat, check.usable(flat))
        if not check.enough(np.isfinite(scaled)):
            return Status.MISSING, False
        if zero.baseline is None:
            learning.take_noise(zero.capture(scaled))
            return Status.CAPTURING_ZERO, True
        y = check.zeroed(scaled - zero.baseline)
        slope = self._equations.adjoint(y, check.unused)
        noise = learning.noise if learning.noise is not None else rough_noise(y[~check.unused])
        score = self._equations.score(slope) / max(noise, 1e-30)
        highest = float(score.max())
        if not self._touching and highest > TAKEN and self._one_taxel(y, noise):
            return self._unless_frozen(Status.NO_CONTACT), True  # a glitch of one taxel is not a contact
        self._touching = highest > (LOST if self._touching else TAKEN)
        if not self._touching:
            self._release()
            health.rezeroed += zero.follow(scaled, elapsed, noise)
            learning.doubt(y[~check.unused])
            return self._unless_frozen(Status.NO_CONTACT), True
        if learning.learn(y, noise, float(self._equations.diagonal.max()), self._background):
            self._errors.outdate()
        noise = noise if learning.noise is None else learning.noise
        self._renew()
        self._move(score)
        deadline = math.inf if self.budget is None else started + BUDGET_OF_ITERATION * self.budget
        converged = self._solution.solve(slope, tolerance=self.tolerance, deadline=deadline)
        if health.frames % EVERY == 0:
            actual = np.where(np.isfinite(scaled - zero.baseline), scaled - zero.baseline, self._explained())
            # a solution on its way, or on cells that are about to move, says nothing against a taxel
            self._look(y, actual, noise, judge=converged and self._background.idle)
        self._errors.refresh(self._solution, y, noise, check.unused, self._background)
        if not converged:
            health.approximate += 1
        return self._unless_frozen(Status.SOLVED if converged else Status.NOT_CONVERGED), converged

    def _unless_frozen(self, status: Status) -> Status:
        """The status of a frame that is answered, unless the sensor stands still."""
        return Status.FROZEN if self._check.frozen else status

    @property
    def seconds(self) -> float:
        """Time that the last frame took [s].

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> tracker = skin.track()
        >>> touch = tracker.step([[0.0] * 21] * 2)
        >>> tracker.seconds > 0.0
        True
        """
        return self._seconds

    def close(self) -> None:
        """End the thread that a budget needs.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> tracker = skin.track(budget=0.02)
        >>> tracker.close()  # or: with skin.track(budget=0.02) as tracker
        """
        self._background.close()

    def __enter__(self) -> Tracker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- readings ------------------------------------------------------------------------------------------------------

    def _flat(self, reading: Any) -> tuple[Floats, Any]:
        """One vector of all readings, in SI units, and the caller's array."""
        rows, like = self._layout.frame(reading)
        return self.estimator.readings.flat(rows), like

    def _scaled(self, flat: Floats, usable: Flags) -> Floats:
        """Readings without creep, in units of their standard deviations, NaN where they cannot be used."""
        scaled = np.where(usable, flat, math.nan)
        if self._filters is not None:
            # a reading that is missing leaves the memory of its creep as if it had stayed
            self._held = np.where(usable, flat, self._held)
            planes = self.estimator.readings.planes(self._held)
            time = self._times.total
            planes = [p if f is None else f.remove(p, time) for p, f in zip(planes, self._filters)]
            creeping = self._layout.creeping()
            scaled = np.where(creeping & usable, self.estimator.readings.flat(planes), scaled)
        return scaled / self._std

    def _one_taxel(self, y: Floats, noise: float) -> bool:
        """Whether one reading alone makes the frame look like contact; it is then counted as bad."""
        largest = int(np.argmax(np.abs(y)))
        without = y.copy()
        without[largest] = 0.0
        adjoint = self._equations.adjoint(without, self._check.unused)
        if float((self._equations.score(adjoint) / max(noise, 1e-300)).max()) > TAKEN:
            return False
        self._check.count(np.arange(len(y)) == largest, "unexplained")
        return True

    # -- the contact ---------------------------------------------------------------------------------------------------

    def _explained(self) -> Floats:
        """The readings that the present solution explains, in units of their standard deviations."""
        return self._equations.explained(self._solution.region, self._solution.traction)

    def _making(self, cells: Index) -> Callable[[], Region]:
        """The making of a region, for the readings and the penalty of this frame."""
        parameter, unused = self._learning.parameter or 1.0, self._check.unused
        return lambda: self._equations.region(cells, parameter, unused)

    def _renew(self) -> None:
        """The region's inverse, where the penalty or the readings that are used have changed."""
        region = self._solution.region
        if region is not None and not self._holds(region):
            self._solution.region = self._making(region.cells)()

    def _holds(self, region: Region) -> bool:
        return region.parameter == self._learning.parameter and np.array_equal(region.unused, self._check.unused)

    def _move(self, score: Floats) -> None:
        """Keep the contact inside the region with a margin."""
        region = self._solution.region
        if region is None:
            self._moved(self._making(self._search.first(score))())
        elif "move" in self._background:
            found = self._background.result("move", lambda: None)
            if found is not None:
                # penalty and readings may have changed meanwhile
                self._moved(found if self._holds(found) else self._making(found.cells)())
        else:
            cells = self._search.next(region, self._solution.pressure)
            found = None if cells is None else self._background.result("move", self._making(cells))
            if found is not None:
                self._moved(found)

    def _moved(self, region: Region) -> None:
        self._solution.move(region)
        self._search.moved()

    def _release(self) -> None:
        """No contact."""
        self._touching = False
        self._solution.clear()
        self._search.clear()
        self._errors.clear()
        self._background.forget()  # what is under way belongs to the contact that has ended

    def _look(self, y: Floats, actual: Floats, noise: float, *, judge: bool) -> None:
        """What the contact does not explain: pressure elsewhere, or taxels that are wrong."""
        check = self._check
        unused = check.unused
        rest = actual - self._explained()
        left = np.where(unused, 0.0, rest)
        self._residual = float(np.sqrt(np.mean(left[~unused] ** 2)))
        typical = max(noise, float(np.median(np.abs(left[~unused]))) / NORMAL)
        limit = max(UNEXPLAINED * typical, GROSS * float(np.abs(y).max()))
        size = np.abs(left)
        wrong = (size > limit) & (size > WORST * float(size.max()))
        few = int(wrong.sum()) <= FEW * len(left)
        if judge and few:
            check.judge(wrong, rest, limit, EVERY)
        if few:
            left[wrong] = 0.0
        score = self._equations.score(self._equations.adjoint(left, check.unused)) / typical
        if self._solution.region is not None:
            score[self._solution.region.cells] = 0.0
            self._search.missing(score > TAKEN)

    # -- the answer ----------------------------------------------------------------------------------------------------

    def _answer(self, status: Status, now: float, converged: bool, like: Any, note: str | None) -> Touch:
        estimator, learning, solution = self.estimator, self._learning, self._solution
        grid, noise = estimator.surface, learning.noise
        values = np.zeros((len(grid.components), math.prod(estimator.operator.surface.shape)))
        errors: Errors | None = None
        if not status.known:
            self.health.unknown += 1
            values[:] = math.nan
        elif self._touching and solution.region is not None:
            values[np.asarray(estimator.columns)[:, None], solution.region.cells[None, :]] = solution.traction
            errors = self._errors.errors
        else:
            errors = self._errors.without_contact(noise)
        said = [] if note is None else [note]
        if status not in (Status.SOLVED, Status.NO_CONTACT):
            said.append(f"{status.meaning}; {status.remedy}")
        return Touch(
            from_numpy(values.reshape(-1, *estimator.operator.surface.shape), like),
            grid,
            self.names,
            "constrained",
            (*self.notes, *said),
            None if learning.parameter is None else np.asarray(learning.parameter),
            None if noise is None else noise * np.concatenate(estimator.scales),
            np.asarray(self._residual if status.known else math.nan),
            errors=errors,
            converged=np.asarray(converged),
            touching=np.asarray(self._touching and status.known),
            outliers=self._check.unused,
            time=np.asarray(now),
            resolution=None if learning.resolution is None else np.asarray(learning.resolution),
            case=self._case,
            status=np.asarray(int(status), dtype=np.int8),
        )
