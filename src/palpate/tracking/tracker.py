"""Track contact through a stream.

A `Tracker` solves the problem of ``method="constrained"`` for every frame of a stream. It computes the normal matrix of the surface once, and keeps the cells in contact, the inverse of their matrix
and the solution from frame to frame (`palpate.tracking.iteration`).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from palpate._arrays import from_numpy
from palpate._threads import WIDEST, few_threads
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.prepared import TooLarge
from palpate.inverse.fit import POOR_FIT
from palpate.inverse.words import surface_strain
from palpate.sensing.limits import ends_of
from palpate.sensing.readings import Layout
from palpate.sensing.times import as_second
from palpate.sensing.zero import MOVED, STANDS
from palpate.status import Status
from palpate.touch import Touch
from palpate.touch.fields import ErrorParts
from palpate.tracking.background import Background
from palpate.tracking.contact import EVERY, UNEXPLAINED, Contact
from palpate.tracking.creep import Creep
from palpate.tracking.discrepancy import bounds_of, without_numbers
from palpate.tracking.frames import Frame, Look, Numbers
from palpate.tracking.health import ENOUGH, Flags, Health, ReadingCheck
from palpate.tracking.held import Held, own_force
from palpate.tracking.learning import ROUNDING, Learning, rough_noise, typical_noise
from palpate.tracking.misfit import probability_of
from palpate.tracking.offsets import Offsets
from palpate.tracking.ready import make_ready
from palpate.tracking.region import NormalEquations
from palpate.tracking.rest import Rest
from palpate.tracking.search import LOST, TAKEN, only_reading
from palpate.tracking.settings import MISREAD, check_settings, chosen_channels
from palpate.tracking.single import Alone, Answer, Compared, Comparison, Single
from palpate.tracking.slow import SlowPress
from palpate.tracking.standing import Standing, Steady
from palpate.tracking.times import FrameTime, FrameTimes
from palpate.tracking.words import at_their_end, drifted, one_taxel, restarted, unfinished
from palpate.tracking.zero import Zero, checked_zero
from palpate.uncertainty import Case

__all__ = ["FRAMES_OF_ZERO", "Tracker"]

#: Number of frames averaged for a new zero.
FRAMES_OF_ZERO = 10
BUDGET_OF_ITERATION = 0.8  # fraction of the budget for the iteration; the rest builds the result


class Tracker:
    """Contact followed from frame to frame; made by `Skin.track`.

    Parameters
    ----------
    estimator : ConstrainedEstimator
        The problem of one frame.
    names : tuple of str
        Components that are estimated.
    layout : Layout
        How readings are checked and ordered.
    baseline : int or array
        Frames at the start, without contact, whose mean is taken as zero (of three and more, those far from most are left out); or
        the zero itself, one frame of readings; 0: the readings are zero already.
    tolerance : float
        Change of traction, as a part of its peak, at which a frame's iteration ends.
    budget : float, optional
        Seconds a frame may take. The iteration ends early where it must (``converged`` is then False); the rest runs beside the stream.
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
        prony: Any = None,
        case: Case | None = None,
        alone: Alone | None = None,
        baseline: Any = 0,
        tolerance: float = 1e-3,
        budget: float | None = None,
        rezero: float | None = 2.0,
        rate: float = 100.0,
        label: Callable[[int], str] = str,
    ) -> None:
        check_settings(tolerance=tolerance, rate=rate, budget=budget, rezero=rezero)
        self.estimator, self.names = estimator, names
        self.notes = (*notes, MISREAD) if estimator.ambiguous and "z" in names else notes
        self.tolerance, self.budget, self.drift_time, self.rate = tolerance, budget, rezero, rate
        self._prony, self._case = prony, case
        self._layout, self._limits, self._label = layout, layout.limits(), label
        self._std = estimator.readings.std
        self._zero_frames, self._given_zero = self._check_baseline(baseline)
        self._offsets = Offsets(estimator)
        self._equations = NormalEquations(estimator, self._offsets.columns)
        self.unknowns = min(estimator.inside.size * len(estimator.columns), WIDEST * len(self._std))
        self._background = Background(threaded=budget is not None)
        self._alone, self._beside = alone, Background(threaded=budget is not None and alone is not None)
        self._slow = SlowPress(estimator)
        make_ready(estimator, self._equations)
        self._seconds = 0.0
        self.reset()

    def _check_baseline(self, baseline: Any) -> tuple[int, Floats | None]:
        if isinstance(baseline, int | np.integer):
            return int(baseline), np.zeros(len(self._std)) if baseline == 0 else None
        return 0, checked_zero(self._flat(baseline)[0]) / self._std

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
        self._check = ReadingCheck(self.health, self._limits, ends_of(estimator.operator.planes_of), self._std)
        self._standing, self._rest = Standing(), Rest()
        self._times = FrameTimes(self.rate)
        self._zero = Zero(self._given_zero, self._zero_frames, self.drift_time, self._offsets.index)
        self._learning = Learning(estimator)
        self._equations.reset()
        self._background.forget()
        self._offsets.reset()
        self._contact = Contact(
            estimator,
            self._equations,
            self._learning,
            self._check,
            self._offsets,
            self._background,
            self.tolerance,
        )
        self._touching = False
        self._comparison = Comparison(n, rested=self._given_zero is None or bool(self._given_zero.any()))
        self._held = Held(estimator, self._equations)
        self._beside.forget()
        self._compared: Compared | None = None  # the frame that is solved by itself beside the stream
        self._frame: Frame | None = None
        self._steady = Steady()
        self._said: list[str] = []
        self._creep = None if self._prony is None else Creep(self._prony, self._layout, estimator.readings)
        self._residual = self._fit = math.nan
        self._quiet: Floats | None = None  # readings of the last frame without contact

    def rezero(self, channels: Sequence[str] | None = None, *, frames: int = FRAMES_OF_ZERO) -> None:
        """Take the zero anew from the next frames, in which nothing must touch.

        Parameters
        ----------
        channels : sequence of str, optional
            Only of these channels; the others keep theirs.
        frames : int
            Number of frames that are averaged; they have the status "capturing zero".

        Raises
        ------
        InvalidInput
            A channel that no array has, or fewer than one frame.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0))
        >>> tracker = skin.track()
        >>> tracker.rezero(["stress_zz"], frames=1)
        >>> [str(pp.Status.coded(tracker.step([[0.0] * 21, [50.0] * 21]).status)) for _ in range(2)]
        ['capturing zero', 'no contact']
        """
        if isinstance(frames, bool) or not (isinstance(frames, int) and frames >= 1):
            raise InvalidInput(f"frames must be a whole number of at least 1; got {frames!r}.")
        only = chosen_channels(channels, self.estimator.readings.arrays)[self._offsets.index]
        self._release()
        self._offsets.forget()
        self._zero.again(frames, only)

    @property
    def capturing(self) -> bool:
        """Whether the next frame is taken for the zero.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> tracker = skin.track(baseline=1)
        >>> before = tracker.capturing
        >>> touch = tracker.step([[0.0] * 21] * 2)
        >>> before, tracker.capturing
        (True, False)
        """
        return self._zero.capturing

    @property
    def zero(self) -> list[Floats]:
        """The zero in use, drift included: (channel, *array) per plane, in the unit of the readings; NaN if not known or masked.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> skin.track(zero=[[7.0] * 3, [5.0] * 3]).zero[0].tolist()
        [[7.0, 7.0, 7.0], [5.0, 5.0, 5.0]]
        """
        known = self._zero.baseline
        flat = np.full(len(self._std), math.nan) if known is None else (known + self._offsets.value()) * self._std
        return [
            np.where(a.valid, p, math.nan) for a, p in zip(self._layout.planes, self.estimator.readings.planes(flat))
        ]

    def take_zero(self, other: Tracker) -> bool:
        """Continue with the zero of another tracker of the same skin; False, without change, while that one captures its own.

        Raises
        ------
        InvalidInput
            A tracker of other readings.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"], noise=5.0))
        >>> offset = [[0.0] * 21, [50.0] * 21]
        >>> first, second = skin.track(baseline=1), skin.track(friction=0.5)
        >>> second.take_zero(first)  # it has none yet
        False

        >>> touch = first.step(offset)
        >>> second.take_zero(first), str(pp.Status.coded(second.step(offset).status))
        (True, 'no contact')
        """
        if len(other._std) != len(self._std):
            raise InvalidInput(f"a tracker of {len(other._std)} readings has no zero for one of {len(self._std)}.")
        if other._zero.capturing or other._zero.baseline is None:
            return False
        self._zero = Zero(other._zero.baseline * other._std / self._std, 0, self.drift_time, self._offsets.index)
        self._zero.moved, self._zero.variance = other._zero.moved, other._zero.variance
        if other._learning._told is not None and np.allclose(other._std, self._std):
            self._learning.take_noise(other._learning._told)
        return True

    def step(self, reading: Any, time: float | None = None, *, std: Any = None) -> Touch:
        """Contact in the next frame.

        Parameters
        ----------
        reading : array (channel, *array), or a list with one per plane
            In SI units. Values that are missing, not finite or out of range are left out in this frame where the others suffice, and
            for longer where it happens again and again (see `health`).
        time : float, optional
            Time of the frame [s], or a ``datetime64``, ``timedelta64`` and the like. A time before that of the last frame is taken for a clock that has begun anew: contact is found
            afresh, the zero is kept, and the touch says so in its notes.
        std : array like ``reading``, optional
            Standard deviations of these readings, from a source that knows them frame by frame, such as the dots of a camera, which are less well
            known where they have moved. The noise of the frame is then their typical one, and no less than that of the zero.

        Returns
        -------
        Touch
            Without batch axes; always that of this frame, but for ``fit``: that is of the last look, which is taken every eighth frame and
            at once where more is left than before. ``status`` says what became of it (`Status`): traction and all that follows
            from it are NaN where the frame has no answer. ``converged`` is False where the budget ended the iteration;
            ``outliers`` are the readings left out.

        Raises
        ------
        InvalidInput
            A reading or std of the wrong shape or kind, or a time that is no finite number of seconds; the tracker is then as it was before.

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
        with self._background.frame():
            return self._stepped(reading, time, std)

    def _stepped(self, reading: Any, time: float | None, std: Any) -> Touch:
        """`step`, while background work pauses."""
        started = clock.perf_counter()
        flat, like = self._flat(reading)
        noise = None if std is None else typical_noise(self._flat(std)[0] / self._std)
        frame = self._times.next(None if time is None else as_second(time))
        self._said, note = [], self._note(frame)
        answer = partial(self._answer, now=frame.now, like=like, note=note)
        try:
            with few_threads(self.unknowns):
                status, converged = self._step(flat, frame.elapsed, started, noise)
            touch = answer(status, converged)
            if self._touching and status.known:
                touch = self._compare(touch, answer)
                if touch.status == Status.UNEXPLAINED and self._frame is not None:
                    touch = without_numbers(touch, self.estimator, self._check.used(self._frame.actual))
        except (np.linalg.LinAlgError, TooLarge) as error:
            self._release()  # the next frame does not inherit the cause of the failure
            self._offsets.clear()
            self._said = [] if isinstance(error, np.linalg.LinAlgError) else [str(error)]
            touch = answer(Status.FAILED, False)
        self._seconds = clock.perf_counter() - started
        return touch

    def _compare(self, touch: Touch, rebuild: Callable[[Status, bool], Touch]) -> Touch:
        """The touch of a frame in contact, compared with a single solve if one is due; ``rebuild`` builds it again."""
        alone, comparison, frame, beside = self._alone, self._comparison, self._frame, self._beside
        if alone is None or frame is None:
            return touch
        if "alone" not in beside:
            load, shear = self._contact.size, self._contact.traction[:-1].sum(axis=1)
            due = self._contact.judged and comparison.due(
                load, shear, stale=self._held.stale, missing=self._held.missing
            )
            gaps = ~np.isfinite(frame.actual)  # of this frame alone, unless the reading is left out
            waits = gaps.any() and (self.estimator.operator.floats or bool((gaps & ~self.health.left_out).any()))
            if not due or waits or self._check.clipped.mean() > ENOUGH:
                return touch
            comparison.begun(load, shear)
            self._compared = Compared(
                Answer.of(touch), own_force(self.estimator, self._contact), frame.actual * self._std
            )
        rest, actual = list(self._rest.frames), np.where(self._check.lacks, np.nan, frame.actual * self._std)
        clipped = self._check.clipped.astype(np.float64)

        def solved() -> Single:
            planes = self.estimator.readings.planes
            return alone(planes(actual), [planes(f * self._std) for f in rest], frame.noisier, planes(clipped))

        try:
            single = beside.result("alone", solved)
        except InvalidInput:  # readings minus their offsets that no elastic pad gives
            comparison.refuted = True
            return rebuild(*self._status(bool(touch.converged)))
        if single is None or self._compared is None:
            return touch
        reference, compared = Answer.of(single.touch), self._compared
        if comparison.settle(compared.answer, reference):
            if (comparison.share or comparison.rested) and self.drift_time is not None:
                self._offsets.take(single.touch, self._layout.planes, self._std)
            self._held.hold(single, compared, reference)
        else:
            self._begin_anew(single.touch)
            unit = "N/m" if self.estimator.operator.surface.dimensions == 1 else "N"
            self._said.append(comparison.words(compared.answer, reference, unit))
            if not beside.threaded:
                again = frame._replace(actual=frame.actual - self._offsets.value())
                touch = rebuild(*self._in_contact(again, 0.0, regular=True))
                compared = compared._replace(answer=Answer.of(touch), own=own_force(self.estimator, self._contact))
                comparison.settle(compared.answer, reference)
                self._held.hold(single, compared, reference)
        self._answer_by_held()
        return rebuild(*self._status(bool(touch.converged)))

    def _answer_by_held(self) -> None:  # by the models of the last single solve
        if self._frame is not None:
            self._held.follow(self._frame, self._offsets, self._check.unused, pushing=self._contact.pushing)

    def _begin_anew(self, single: Touch) -> None:
        """Forget what the result depends on, except readings, zero and noise; take the offsets of a single solve."""
        self._contact.release()
        self._offsets.forget()
        if self.drift_time is not None:
            self._offsets.take(single, self._layout.planes, self._std)
        self._held.clear()
        self._learning.anew()
        self._check.pardon()

    def _note(self, frame: FrameTime) -> str | None:
        """Count a frame whose time is out of order; return a note about it."""
        if frame.repeated:
            self.health.late += 1
        if not frame.restarted:
            return None
        self.health.restarts += 1
        self._release()
        return restarted(frame, creeps=self._creep is not None)

    def _step(self, flat: Floats, elapsed: float, started: float, noise_given: float | None) -> tuple[Status, bool]:
        """Process a frame; return its status, and whether its iteration converged."""
        health, check, zero, learning = self.health, self._check, self._zero, self._learning
        health.frames += 1
        scaled = check.present(self._scaled(flat, check.usable(flat)))
        if not check.enough(np.isfinite(scaled)):
            return Status.MISSING, False
        if zero.baseline is None or zero.capturing:
            return self._capture(scaled), True
        learning.state(noise_given)
        if zero.moved:
            self._said.append(MOVED)
        look = self._look(zero.baseline, scaled, flat, elapsed)
        if not self._touching and look.highest > TAKEN:
            alone = only_reading(self._equations, look.y, look.level, check.unused)
            if alone is not None:
                check.count(alone, "unexplained")
                return self._undecided(alone), True
        look = self._without_unreal_offsets(zero.baseline, look, flat)
        was_touching, self._touching = self._touching, look.highest > (LOST if self._touching else TAKEN)
        if not self._touching:
            return self._untouched(look, elapsed, ended=was_touching), True
        deadline = math.inf if self.budget is None else started + BUDGET_OF_ITERATION * self.budget
        self._frame = Frame(scaled - zero.baseline, look.noise, deadline, math.sqrt(1.0 + zero.variance))
        frame = self._frame._replace(actual=look.actual)
        return self._in_contact(frame, elapsed, regular=health.frames % EVERY == 0)

    def _capture(self, scaled: Floats) -> Status:
        """Take a frame for the zero."""
        zero = self._zero
        self._standing = Standing()
        self._learning.take_noise(zero.capture(scaled))
        if not zero.capturing:
            self._rest = Rest.of(zero.shown, self._equations)
            if zero.moved:
                self._said.append(MOVED)
        return Status.CAPTURING_ZERO

    def _look(self, baseline: Floats, scaled: Floats, flat: Floats, elapsed: float) -> Look:
        """What a frame shows before contact is sought."""
        check, learning, offsets, follows = self._check, self._learning, self._offsets, self.drift_time is not None
        if follows and self._touching:
            offsets.go_on(elapsed)
        actual = scaled - baseline - offsets.value()
        y = check.zeroed(actual, flat, offsets.index, learning.noise or 0.0)
        unused = check.unused
        noise, rounding = learning.noise, ROUNDING * float(np.abs(scaled[~unused]).max(initial=0.0))
        if noise is None:  # rounding is no contact: a frame that is the zero but for it
            self._rest = Rest()  # what rest showed was in units of another noise
            noise = max(rough_noise(y[~unused]), rounding)
        if follows:
            offsets.pass_time(elapsed, offsets.scale(learning.noise, y), observed=self._contact.observes)
        slope, level = self._equations.adjoint(y, unused), self._rest.level(max(noise, 1e-30))
        return Look(scaled, actual, y, noise, slope, self._equations.score(slope), level, rounding)

    def _without_unreal_offsets(self, baseline: Floats, look: Look, flat: Floats) -> Look:
        """The look without offsets, if the frame is at rest with the old zero: then they, and a rate of drift smaller
        than its error, were not real.
        """
        check, offsets, equations = self._check, self._offsets, self._equations
        if not self._touching or not offsets.mean.any():
            return look
        raw = look._replace(score=equations.score(look.slope + equations.of_offsets(offsets.mean, check.unused)))
        if not raw.highest < LOST:
            return look
        offsets.clear()
        if raw.highest <= look.highest:
            offsets.rate = np.zeros_like(offsets.rate)
        return raw._replace(y=check.zeroed(look.scaled - baseline, flat, offsets.index, look.noise))

    def _untouched(self, look: Look, elapsed: float, *, ended: bool) -> Status:
        """Let zero, noise and health follow a frame without contact; ``ended``: contact has just ended."""
        health, check, zero, offsets = self.health, self._check, self._zero, self._offsets
        of_zero = math.sqrt(1.0 + zero.variance)
        if ended:
            self._release()
            zero.shift(offsets.value())  # quiet with them: they are the zero's
        offsets.clear()
        if self.drift_time is not None and self._learning.noise is not None:
            self._rest.look(
                np.where(check.unused, math.nan, look.y), look.score, largest=TAKEN * float(look.level.max())
            )
        alone = check.unexplained & (np.abs(look.actual) > UNEXPLAINED * look.noise)
        health.rezeroed += zero.follow(np.where(alone, math.nan, look.scaled), elapsed, look.noise)
        self._at_rest(look.y, look.noise * of_zero, look.rounding)
        check.forgive(np.abs(look.actual) < UNEXPLAINED * look.noise, 1)
        return self._undecided(alone) if alone.any() else self._unless_frozen(Status.NO_CONTACT)

    def _at_rest(self, y: Floats, noise: float, rounding: float) -> None:
        """Learn from a frame without contact (readings minus zero and offsets): drift, noise, and whether noise explains
        it.
        """
        learning, offsets, unused = self._learning, self._offsets, self._check.unused
        if follows := self.drift_time is not None:
            self._zero.shift(offsets.follow(y, unused))
        self._residual, self._quiet = math.nan, np.where(unused, 0.0, y)
        self._standing.look(y, unused)
        self._comparison.rested |= learning.noise is not None and not self._standing.now
        if self._standing.now and not learning.discrepancy.zeroed:
            self._said.append(STANDS)
        learning.doubt(y[~unused])
        if float(np.abs(y[~unused]).max(initial=0.0)) <= rounding:
            self._fit = 1.0
        elif self.health.frames % EVERY == 0 or math.isnan(self._fit):
            self._fit = probability_of(
                self.estimator,
                y,
                ~unused,
                noise,
                largest=float(np.abs(y).max(initial=0.0)),
                taken=len(offsets.mean) if follows else 0.0,
                known=learning.noise_known,
            )

    def _in_contact(self, frame: Frame, elapsed: float, *, regular: bool) -> tuple[Status, bool]:
        """Solve a frame in contact (readings minus zero and offsets)."""
        contact = self._contact
        converged = contact.solve(frame, regular=regular)
        self._residual, self._fit = contact.residual, contact.fit
        self._answer_by_held()
        self._say(elapsed)
        if not converged:
            self.health.approximate += 1
        return self._status(converged)

    def _status(self, converged: bool) -> tuple[Status, bool]:
        """The status of a frame in contact."""
        contact = self._contact
        if self._check.overload:
            return Status.OVERLOAD, converged
        if self._held.answer is not None and self._held.answer.proven:
            return self._unless_frozen(Status.SOLVED if self._held.answer.pushes else Status.NOT_PUSHING), True
        if not contact.fits or self._comparison.refutes(contact.size):
            return self._unless_frozen(Status.UNEXPLAINED), converged
        solved = Status.SOLVED if converged else Status.NOT_CONVERGED
        return self._unless_frozen(solved if contact.pushing else Status.NOT_PUSHING), converged

    def _say(self, elapsed: float) -> None:
        """Add the notes about the present contact."""
        contact, notes = self._contact, self._said
        self._standing.interrupt()
        if self._standing.now and not self._learning.discrepancy.zeroed:
            notes.append(STANDS)
        if not contact.pushing and contact.fits and self._held.answer is None:
            notes.append("traction that pulls in places explains the readings, and was allowed")
        notes += at_their_end(int(self._check.clipped.sum()), overload=self._check.overload)
        notes += drifted(self._offsets.notable(), self._offsets.index, self._std, self._label)
        notes += self._steady.look(contact.size, elapsed)

    def _undecided(self, alone: Flags) -> Status:
        """The status of a frame in which a contact too small for its neighbours may press a taxel that reads ``alone``."""
        self._said.append(one_taxel(self._label(int(np.argmax(alone)))))
        return self._unless_frozen(Status.UNDECIDED)

    def _unless_frozen(self, status: Status) -> Status:
        """The status of a solved frame, or FROZEN if the sensor repeats itself."""
        return Status.FROZEN if self._check.frozen else status

    @property
    def seconds(self) -> float:
        """Processing time of the last frame [s].

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
        """End the background thread, if there is one.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"]))
        >>> tracker = skin.track(budget=0.02)
        >>> tracker.close()  # or: with skin.track(budget=0.02) as tracker
        """
        self._background.close()
        self._beside.close()

    def __enter__(self) -> Tracker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _flat(self, reading: Any) -> tuple[Floats, Any]:
        """One vector of all readings, in SI units, and the caller's array."""
        rows, like = self._layout.frame(reading)
        return self.estimator.readings.flat(rows), like

    def _scaled(self, flat: Floats, usable: Flags) -> Floats:
        """Readings with creep removed, in units of their standard deviations, NaN if unusable."""
        if self._creep is not None:
            return self._creep.removed(flat, usable, self._times.total) / self._std
        return np.where(usable, flat, math.nan) / self._std

    def _release(self) -> None:
        """Forget the contact."""
        self._touching = False
        self._contact.release()
        self._comparison.release()
        self._held.clear()
        self._beside.forget()
        self._steady = Steady()
        self._fit = math.nan

    def _answer(self, status: Status, converged: bool, *, now: float, like: Any, note: str | None) -> Touch:
        estimator, learning, contact = self.estimator, self._learning, self._contact
        touching, noise = self._touching and status.known, learning.noise
        held = self._held.answer if touching else None
        values, errors, pad_std, share = self._numbers(status)
        proven = learning.noise_known or len(self._std) > estimator.policy.detection.few_readings
        if status is Status.NO_CONTACT and (not proven or self._fit < POOR_FIT):
            status, values = Status.UNDECIDED, values if noise is not None else math.nan * values
        fits = contact.pushing and contact.fits if held is None else held.pushes
        drag = contact.drag if touching else None
        if status is Status.NOT_CONVERGED:
            self._said.append(unfinished(self.budget, self.tolerance, exhausted=self._contact.exhausted))
        return Touch(
            from_numpy(values, like),
            estimator.surface,
            self.names,
            "constrained" if held is None else held.single.method,
            (*self.notes, *(() if note is None else (note,)), *self._said, *(() if held is None else held.notes)),
            None if learning.parameter is None else np.asarray(learning.parameter),
            None if noise is None else noise * np.concatenate(estimator.scales),
            np.asarray(self._residual if held is None else held.residual) if status.known else np.asarray(math.nan),
            _errors=ErrorParts.of(errors, pad_std, estimator.problem.common_std),
            converged=np.asarray(converged),
            touching=np.asarray(touching),
            outliers=self._check.unused if held is None else held.unused,
            time=np.asarray(now),
            resolution=None if learning.resolution is None else np.asarray(learning.resolution),
            case=self._case if held is None else held.single.case,
            friction=estimator.cone.friction,
            status=np.asarray(int(status), dtype=np.int8),
            force_bounds=bounds_of(status, estimator, self._quiet if noise is None else None, pushing=contact.pushing),
            pushing=np.asarray(fits or not touching),
            drag=None if drag is None else drag.ratio,
            drag_std=None if drag is None else np.asarray(drag.std),
            sticking=None if drag is None else drag.sticking,
            fit=np.asarray(self._fit if status.known else math.nan),
            discrepancy=np.asarray(share),
            strain=surface_strain(estimator.problem, values),
        )

    def _numbers(self, status: Status) -> Numbers:
        """The numbers of a frame with this status."""
        grid, noise = self.estimator.surface, self._learning.noise
        nothing: Floats = np.zeros((len(grid.components), *grid.shape))
        if not status.known:
            self.health.unknown += 1
            return Numbers(math.nan * nothing)
        if self._touching and self._contact.cells is not None:
            share, overload = self._learning.discrepancy.posterior, status is Status.OVERLOAD
            return self._held.numbers(self._contact, share, self._comparison, overload=overload)
        if status is Status.UNDECIDED:
            return Numbers(math.nan * nothing)
        errors = self._contact.undetected(noise, self._quiet)
        if errors is not None and status is Status.NO_CONTACT:
            errors, slow = self._slow.room(errors, self._zero.wandered, noise or 0.0)
            self._said += slow
        return Numbers(nothing, errors)
