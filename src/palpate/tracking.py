"""One frame after another: what touches the pad while it happens.

A `Tracker` solves the problem of ``method="constrained"`` (`palpate.inverse.contact.constrained`) for every frame of a stream. What that
needs is prepared once: the normal matrix of the whole surface. Between frames it keeps the cells where contact is possible, the
inverse of their normal matrix, and the solution with its multipliers, from which the alternating direction method of multipliers
(S. Boyd et al., Foundations and Trends in Machine Learning 3, 2011, 1-122) needs a few small matrix-vector products:

    x = (H + rho)^-1 (h + rho (z - u)),   z = P_K(x + u),   u = u + x - z,   rho = sqrt(lambda_min lambda_max).
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy
from palpate.elastic.half_space import Floats
from palpate.elastic.viscoelastic import CreepFilter
from palpate.errors import InvalidInput
from palpate.inverse.contact.constrained import FAINT, MARGIN, MODEL_ERROR, ConstrainedEstimator
from palpate.inverse.contact.model import grown
from palpate.inverse.estimate import Errors
from palpate.sensing.readings import Layout
from palpate.status import Status
from palpate.touch import Touch
from palpate.uncertainty import Case

__all__ = ["Health", "Tracker"]

Flags = npt.NDArray[np.bool_]
Index = npt.NDArray[np.intp]
Single = npt.NDArray[np.float32]

#: A contact is taken up where pressure somewhere is this many standard deviations from none, and given up below the second.
TAKEN, LOST = 5.5, 4.0
#: The region moves when the contact presses at its margin in so many frames in a row.
PRESSED = 4
#: Everything is looked at (new contacts, taxels that contact does not explain) once in so many frames.
EVERY = 8
#: A reading is bad where it is this many standard deviations, and this part of the largest, from what contact explains.
UNEXPLAINED, GROSS = 8.0, 0.1
#: A reading is left out after so many bad frames (or looks) in a row, and taken back after as many good ones.
BAD, GOOD = 5, 40
#: Frames in which a reading, or the whole sensor, may repeat itself exactly.
STUCK = 50
#: A sensor is taken for frozen only where so small a part of its frames repeated themselves before.
SELDOM = 0.1
#: A frame is answered where at least this part of the readings is finite, in range and not left out.
ENOUGH = 0.5
#: Noise is not learned to be less than this part of the largest reading: single precision tells no more.
FINEST_NOISE = 1e-6
#: The penalty is learned again when the energy of the readings has changed by this factor.
RELEARN = 4.0
#: Error bars are made again after so many frames, or when the contact has changed by this part.
REFRESH, CHANGED = 200, 0.25
#: Entries of the normal matrix of the whole surface that are kept.
LARGEST = 20_000_000
#: Smallest eigenvalue of the normal matrix over the largest, below which single precision does not tell it from zero.
SMALLEST = 1e-9
#: By so much the inverse is shrunk, more than single precision can be off.
SHRINK = 1e-6
#: Noise that was learned is doubted where frames without contact are so many times quieter.
LOUD = 3.0
#: Iterations of one frame at most.
ITERATIONS = 300


@dataclass
class Health:
    """What became of the frames so far, and of the taxels.

    ``str()`` of it says it in words. ``frames`` were given; ``late`` came with the time of the frame before, ``restarts`` with an
    earlier one, as where a sensor's clock begins anew; ``unknown`` could not be answered (see `Status`); ``approximate`` were
    answered before the tolerance was reached; ``repeated`` were the same as the frame before, bit by bit. ``left_out`` (reading)
    is True for readings that are not used now, with ``reasons`` (reading): "", "missing", "stuck", "out of range" or
    "unexplained"; ``label`` names a reading.
    """

    frames: int = 0
    late: int = 0
    restarts: int = 0
    unknown: int = 0
    approximate: int = 0
    repeated: int = 0
    rezeroed: int = 0
    left_out: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool), repr=False)
    reasons: npt.NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, dtype="<U12"), repr=False)
    label: Callable[[int], str] = field(default=str, repr=False)

    def __str__(self) -> str:
        rows = np.flatnonzero(self.left_out)
        named = [f"{self.label(int(r))} ({self.reasons[r]})" for r in rows[:8]]
        if len(rows) > 8:
            named.append(f"{len(rows) - 8} more")
        return (
            f"{self.frames} frames, {self.late} late, {self.approximate} approximate, {self.repeated} repeated, "
            f"{self.unknown} unknown, {self.restarts} restarts of the clock; left out: {', '.join(named) or 'none'}"
        )


@dataclass
class _Region:
    """Cells where contact is sought, and what solves their problem."""

    cells: Index
    ring: Flags
    inverse: Single
    rho: float
    parameter: float


class Tracker:
    """Contact followed from frame to frame; made by `Skin.track`.

    Parameters
    ----------
    estimator : ConstrainedEstimator
        The problem of one frame.
    names : tuple of str
        Components sought.
    layout : Layout
        How readings are checked and laid out.
    baseline : int or array
        Frames at the start, without contact, whose mean is taken as zero; or the zero itself, one frame of readings; 0: the
        readings are zero already.
    tolerance : float
        Change of traction, as a part of its peak, at which a frame's iteration ends.
    budget : float, optional
        Seconds a frame may take. The iteration ends early where it must (``converged`` is then False), and what takes longer
        (learning the penalty, moving the region of interest, error bars) runs beside the stream in a thread of its own.
    rezero : float, optional
        Time constant [s] with which the zero follows drift while nothing touches; None keeps it.
    rate : float
        Frames a second, for streams whose frames come without a time.
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
        for name, value in (("tolerance", tolerance), ("rate", rate), ("budget", budget), ("rezero", rezero)):
            if value is not None and not (isinstance(value, int | float) and math.isfinite(value) and value > 0):
                raise InvalidInput(f"{name} must be a positive number; got {value!r}.")
        self.estimator, self.names, self.notes = estimator, names, notes
        self.tolerance, self.budget, self.rezero, self.rate = tolerance, budget, rezero, rate
        self._make_creep, self._case = creep, case
        self._layout, self._limits, self._label = layout, layout.limits(), label
        self._std = estimator.readings.std
        self._arrays = estimator.readings.arrays
        self._all = np.ones(len(self._std), dtype=bool)
        self._zero_frames, self._zero = self._check_baseline(baseline)
        # in double precision: rounded to single it has negative eigenvalues, along which the iteration grows without end
        self._normal: Floats | None = None
        self._diagonal = self._prepare()
        self._worker = None if budget is None else ThreadPoolExecutor(1, thread_name_prefix="palpate-tracker")
        self._seconds = 0.0
        self.reset()

    # -- what is prepared ----------------------------------------------------------------------------------------------

    def _prepare(self) -> Floats:
        """The normal matrix of the whole surface where it fits; its diagonal, of pressure, in any case."""
        estimator = self.estimator
        grid, columns = estimator.operator.surface, estimator.columns
        count = math.prod(grid.shape)
        level = estimator.level(1)
        diagonal = np.empty(count)
        unknowns = len(columns) * count
        parts = []
        for start in range(0, count, 1024):
            cells = np.arange(start, min(start + 1024, count))
            matrix = level.matrix(cells, self._std, self._all)
            diagonal[cells] = (matrix[:, -len(cells) :] ** 2).sum(axis=0)
            if unknowns**2 <= LARGEST:
                parts.append(matrix.reshape(len(matrix), len(columns), len(cells)))
        if parts:
            whole = np.concatenate(parts, axis=2).reshape(len(self._std), -1)
            self._normal = whole.T @ whole
        return diagonal

    def _check_baseline(self, baseline: Any) -> tuple[int, Floats | None]:
        if isinstance(baseline, bool) or (isinstance(baseline, int | np.integer) and baseline < 0):
            raise InvalidInput(f"baseline must be a number of frames >= 0, or one frame of readings; got {baseline!r}.")
        if isinstance(baseline, int | np.integer):
            return int(baseline), np.zeros(len(self._std)) if baseline == 0 else None
        flat, _ = self._flat(baseline)
        if not np.isfinite(flat).all():
            raise InvalidInput("the baseline holds values that are not finite; mask dead taxels (Skin.masked).")
        return 0, flat / self._std

    def reset(self) -> None:
        """Forget contact, drift, penalty and the state of the taxels, as before the first frame."""
        n = len(self._std)
        self.health = Health(left_out=np.zeros(n, dtype=bool), reasons=np.zeros(n, dtype="<U12"), label=self._label)
        self._captured: list[Floats] = []
        self._baseline = None if self._zero is None else self._zero.copy()
        self._noise: float | None = 1.0 if self.estimator.noise_known else None
        self._noise_learned = self._noise is None  # from the frames in contact, unless the baseline tells it
        self._parameter: float | None = None
        self._learned_energy = 0.0
        self._resolution: float | None = None
        self._region: _Region | None = None
        self._pending: dict[str, Future[Any]] = {}
        self._z: Single = np.zeros((len(self.names), 0), dtype=np.float32)
        self._u = self._z.copy()
        self._errors: Errors | None = None
        self._errors_age, self._errors_cells = 0, 0
        self._unnoticed: tuple[float, Errors] | None = None
        self._touching = False
        self._bad = np.zeros(n, dtype=np.int32)
        self._gone = np.zeros(n, dtype=np.int32)  # frames in a row in which a reading was missing or out of range
        self._repeats = np.zeros(n, dtype=np.int32)
        self._last: Floats | None = None
        self._held = np.zeros(n)  # the last good value of each reading, for the memory of creep
        self._absent = np.zeros(n, dtype=bool)  # not usable in this frame, besides those left out
        self._doubts = 0
        self._run = 0  # whole frames in a row that repeated themselves
        self._last_time: float | None = None
        self._elapsed_total = 0.0
        self._filters = self._make_creep() if self._make_creep is not None else None
        self._residual = math.nan
        self._rho: tuple[float, float] | None = None
        self._extra = np.zeros(math.prod(self.estimator.operator.surface.shape), dtype=bool)
        self._pressed = 0

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
        """
        started = clock.perf_counter()
        flat, like = self._flat(reading)
        if time is not None and not math.isfinite(time):
            raise InvalidInput(f"time must be a finite number of seconds; got {time!r}.")
        now, elapsed, note = self._clocked(time)
        try:
            touch = self._step(flat, like, now, elapsed, started, note)
        except np.linalg.LinAlgError:
            # the next frame begins from nothing, so that what broke this one is not carried on
            self._touching = False
            self._release()
            touch = self._unknown(now, Status.FAILED, like, note)
        self._seconds = clock.perf_counter() - started
        return touch

    def _clocked(self, time: float | None) -> tuple[float, float, str | None]:
        """Time of a frame, time since the one before [s], and what there is to say about it."""
        usual = 1.0 / self.rate
        if time is None:
            now = 0.0 if self._last_time is None else self._last_time + usual
        else:
            now = float(time)
        elapsed, note = usual, None
        if time is not None and self._last_time is not None:
            elapsed = now - self._last_time
            if elapsed < 0.0:
                self.health.restarts += 1
                elapsed = usual
                note = (
                    f"the clock went back from {self._last_time:g} s to {now:g} s: contact is found afresh, the zero is kept"
                    + ("; the pad's creep is taken on as if without a pause" if self._filters is not None else "")
                )
                self._touching = False
                self._release()
            elif elapsed == 0.0:
                self.health.late += 1
        self._last_time = now
        self._elapsed_total += max(elapsed, 1e-6 * usual)
        return now, elapsed, note

    def _step(self, flat: Floats, like: Any, now: float, elapsed: float, started: float, note: str | None) -> Touch:
        health = self.health
        health.frames += 1
        scaled = self._sorted_out(flat)
        if (np.isfinite(scaled) & ~health.left_out).sum() < max(1.0, ENOUGH * len(scaled)):
            return self._unknown(now, Status.MISSING, like, note)
        if self._baseline is None:
            return self._capture(scaled, now, like, note)
        y = scaled - self._baseline
        absent = ~np.isfinite(y) & ~health.left_out
        y = np.where(absent | health.left_out, 0.0, y)
        if not np.array_equal(absent, self._absent):
            self._absent = absent
            self._remake()
        slope = self._adjoint(y)
        noise = self._noise if self._noise is not None else self._rough_noise(y)
        score = slope[-1] / np.sqrt(np.maximum(self._diagonal, 1e-300)) / max(noise, 1e-30)
        highest = float(score.max())
        if not self._touching and highest > TAKEN and self._one_taxel(y, noise):
            return self._answer(now, True, like, note)  # a glitch of one taxel is not a contact
        self._touching = highest > (LOST if self._touching else TAKEN)
        if not self._touching:
            self._release()
            self._follow_drift(scaled, elapsed, noise)
            self._doubt(y)
            return self._answer(now, True, like, note)
        self._learn(y, noise)
        noise = noise if self._noise is None else self._noise
        self._move(score)
        converged = self._iterate(slope, started)
        if not np.isfinite(self._z).all():
            raise np.linalg.LinAlgError("the iteration left the numbers")
        if health.frames % EVERY == 0:
            actual = np.where(np.isfinite(scaled - self._baseline), scaled - self._baseline, self._explained())
            # a solution on its way, or on cells that are about to move, says nothing against a taxel
            self._look(y, actual, noise, judge=converged and not self._pending)
        self._refresh_errors(y, noise)
        if not converged:
            health.approximate += 1
        return self._answer(now, converged, like, note)

    @property
    def seconds(self) -> float:
        """Time that the last frame took [s]."""
        return self._seconds

    def close(self) -> None:
        """End the thread that a budget needs."""
        if self._worker is not None:
            self._worker.shutdown(wait=True, cancel_futures=True)

    def __enter__(self) -> Tracker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- readings ------------------------------------------------------------------------------------------------------

    def _flat(self, reading: Any) -> tuple[Floats, Any]:
        """One vector of all readings, in SI units, and the caller's array."""
        rows, like = self._layout.frame(reading)
        return self.estimator.readings.flat(rows), like

    def _sorted_out(self, flat: Floats) -> Floats:
        """Readings in units of `_std` with NaN for those that cannot be right; keeps count of bad taxels."""
        health = self.health
        finite = np.isfinite(flat)
        with np.errstate(invalid="ignore"):
            wild = finite & (np.abs(flat) > self._limits)
        gone = ~finite | wild
        whole = bool((gone & ~health.left_out).mean() > 1.0 - ENOUGH)  # the sensor's fault, not that of its taxels
        if not whole:
            self._gone = np.where(gone, self._gone + 1, 0)
            self._bad[gone & health.left_out] += 1
            self._leave_out(~finite & (self._gone >= BAD), "missing")
            self._leave_out(wild & (self._gone >= BAD), "out of range")
        if self._last is not None:
            same = flat == self._last
            if same.all() or np.array_equal(flat, self._last, equal_nan=True):
                health.repeated += 1
                self._run += 1
            else:
                self._run = 0
                self._repeats = np.where(same, self._repeats + 1, 0)
                # a coarse converter repeats itself everywhere: only the taxel that does so alone is stuck
                if health.frames > STUCK and np.median(self._repeats) < STUCK // 10:
                    self._count((self._repeats > STUCK) & finite & ~wild, "stuck")
        self._last = flat
        # a bad reading is given back after many good frames
        settled = finite & ~wild & (self._repeats == 0)
        self._bad = np.where(settled & health.left_out & (health.reasons != "unexplained"), self._bad - 1, self._bad)
        back = health.left_out & (self._bad <= -GOOD)
        if back.any():
            health.left_out[back], health.reasons[back], self._bad[back] = False, "", 0
            self._remake()
        scaled = flat.copy()
        scaled[~finite | wild] = math.nan
        if self._filters is not None:
            # a reading that is missing leaves the memory of its creep as if it had stayed
            self._held = np.where(np.isfinite(scaled), scaled, self._held)
            planes = self.estimator.readings.planes(self._held)
            time = self._elapsed_total
            planes = [p if f is None else f.remove(p, time) for p, f in zip(planes, self._filters)]
            creeping = self._layout.creeping()
            scaled = np.where(creeping & np.isfinite(scaled), self.estimator.readings.flat(planes), scaled)
        return scaled / self._std

    def _count(self, bad: Flags, reason: str) -> None:
        self._bad[bad] = np.maximum(self._bad[bad], 0) + 1
        self._leave_out(bad & (self._bad >= BAD), reason)

    def _leave_out(self, bad: Flags, reason: str) -> None:
        health = self.health
        new = bad & ~health.left_out
        if new.any():
            self._bad[new] = BAD
            health.left_out[new], health.reasons[new] = True, reason
            self._absent &= ~new
            self._remake()

    def _remake(self) -> None:
        """The region's matrices after a change of the readings that are used."""
        if self._region is not None:
            self._region = self._rebuilt(self._region.cells)

    @property
    def _out(self) -> Flags:
        """Readings not used in this frame."""
        return self.health.left_out | self._absent

    def _capture(self, scaled: Floats, now: float, like: Any, note: str | None) -> Touch:
        """Frames of the start, whose mean is zero and whose spread is the noise."""
        self._captured.append(scaled)
        if len(self._captured) == self._zero_frames:
            frames = np.stack(self._captured)
            with np.errstate(invalid="ignore"):
                good = np.isfinite(frames)
                count = np.maximum(good.sum(axis=0), 1)
                mean = np.where(good, frames, 0.0).sum(axis=0) / count
                # a reading that never came has no zero yet
                self._baseline = np.where(good.any(axis=0), mean, math.nan)
                if self._noise is None and self._zero_frames >= 5:
                    square = np.where(good, (frames - mean) ** 2, 0.0).sum() / max((count - 1).sum(), 1)
                    self._noise = math.sqrt(square) if square > 0 else None
                    self._noise_learned = self._noise is None
            self._captured = []
        return self._answer(now, True, like, note, status=Status.CAPTURING_ZERO)

    def _doubt(self, y: Floats) -> None:
        """Forget a noise that was learned from a frame unlike those that follow: contact would hide in it for ever."""
        quiet = float(np.median(np.abs(y[~self._out]))) / 0.6745
        loud = self._noise_learned and self._noise is not None and 0.0 < LOUD * quiet < self._noise
        self._doubts = self._doubts + 1 if loud else 0
        if self._doubts >= PRESSED:
            self._noise, self._learned_energy, self._doubts = None, 0.0, 0

    def _follow_drift(self, scaled: Floats, elapsed: float, noise: float) -> None:
        if self._baseline is None:
            return
        good = np.isfinite(scaled)
        unset = good & np.isnan(self._baseline)
        self._baseline[unset] = scaled[unset]
        if self.rezero is None:
            return
        # after a long pause one frame alone, with its noise, does not become the zero
        share = -math.expm1(-min(elapsed, self.rezero) / self.rezero)
        # drift is slow: what is many times the noise in one frame is something else
        change = np.clip(scaled - self._baseline, -TAKEN * noise, TAKEN * noise)
        self._baseline[good] += share * change[good]
        self.health.rezeroed += 1

    def _rough_noise(self, y: Floats) -> float:
        """Noise of a frame before it is learned: robust, and no less than what a pad is known to."""
        heard = y[~self._out]
        return max(float(np.median(np.abs(heard))) / 0.6745, MODEL_ERROR * float(np.abs(heard).max(initial=0.0)))

    def _one_taxel(self, y: Floats, noise: float) -> bool:
        """Whether one reading alone makes the frame look like contact; it is then counted as bad."""
        loud = int(np.argmax(np.abs(y)))
        without = y.copy()
        without[loud] = 0.0
        score = self._adjoint(without)[-1] / np.sqrt(np.maximum(self._diagonal, 1e-300)) / max(noise, 1e-300)
        if float(score.max()) > TAKEN:
            return False
        self._count(np.arange(len(y)) == loud, "unexplained")
        return True

    # -- the problem ---------------------------------------------------------------------------------------------------

    def _adjoint(self, y: Floats) -> Single:
        """A' y of whitened readings, (component, cell)."""
        estimator = self.estimator
        if not estimator.readings.independent:
            heard = ~self._out
            white = np.zeros_like(y)
            white[heard] = estimator.readings.white(estimator.readings.white(y[heard], heard), heard)
            y = white
        adjoint = estimator.operator.adjoint(estimator.readings.planes(y / self._std))
        return np.asarray(adjoint.reshape(len(adjoint), -1)[list(estimator.columns)], dtype=np.float32)

    def _explained(self) -> Floats:
        """The readings that the present solution explains, in units of `_std`."""
        region = self._region
        if region is None:
            return np.zeros(len(self._std))
        whole = np.zeros((len(self.names), math.prod(self.estimator.operator.surface.shape)))
        whole[:, region.cells] = self._traction()
        return self.estimator.explained_by(whole) / self._std

    def _traction(self) -> Floats:
        return np.asarray(self._z * self.estimator.cone.scales[:, None], dtype=np.float64)

    def _release(self) -> None:
        self._region, self._errors = None, None
        self._pending.clear()  # what is under way belongs to the contact that has ended
        self._extra[:] = False
        self._z = np.zeros((len(self.names), 0), dtype=np.float32)
        self._u = self._z.copy()

    def _later(self, name: str, work: Callable[[], Any]) -> Any:
        """The result of ``work``: at once without a budget, else when its thread has it (None until then)."""
        if self._worker is None:
            return work()
        if name not in self._pending:
            self._pending[name] = self._worker.submit(work)
            return None
        if not self._pending[name].done():
            return None
        return self._pending.pop(name).result()

    def _learn(self, y: Floats, noise: float) -> None:
        """Weight of the penalty, and noise where it is not known, by evidence; again when the load has changed a lot."""
        energy = float(y @ y)
        if self._parameter is None and self._worker is not None:
            # until the thread has learned it: a gradient of the size that explains the readings over a depth
            self._parameter = noise**2 * float(self._diagonal.max()) / max(energy, 1e-300) * 10.0
        changed = not (self._learned_energy / RELEARN < energy < self._learned_energy * RELEARN)
        if self.estimator.parameter is not None:
            if self._parameter is None:
                self._resolution = self.estimator.resolution(self.estimator.parameter)
            self._parameter = self.estimator.parameter
            return
        if not changed and "learn" not in self._pending:
            return
        rows = self.estimator.readings.planes(y * self._std)
        known = None if self._noise_learned else self._noise

        def work() -> tuple[float, float, float]:
            linear = self.estimator.orders[1]
            _, parameter, scale, _ = self.estimator.evidence(linear, rows, known)
            return parameter, scale, energy

        found = self._later("learn", work)
        if found is None:
            return
        self._parameter, scale, self._learned_energy = found
        self._errors_age = REFRESH + 1  # the error bars go by what has been learned
        self._resolution = self.estimator.resolution(self._parameter)
        if self._noise_learned:
            self._noise = max(scale, FINEST_NOISE * float(np.abs(y).max()))
        self._remake()

    def _move(self, score: Floats) -> None:
        """Keep the contact inside the region of interest with a margin."""
        grid = self.estimator.operator.surface
        if self._region is None:
            depth = math.ceil(self.estimator.depth / min(grid.spacings)) + 1
            likely = (score > max(LOST, 0.5 * float(score.max()))).reshape(grid.shape)
            self._adopt(self._rebuilt(np.flatnonzero(grown(likely, depth))))
            return
        region = self._region
        p = self._z[-1]
        peak = float(p.max(initial=0.0))
        active = p > FAINT * peak
        wanted = np.zeros(math.prod(grid.shape), dtype=bool)
        wanted[region.cells[active]] = True
        if "move" not in self._pending:
            # noise presses at the margin now and then; a contact that moves presses there again and again
            self._pressed = self._pressed + 1 if (active & region.ring).any() else 0
            outgrown = self._pressed >= PRESSED or bool((p[region.ring] > 4.0 * FAINT * peak).any())
            if not outgrown and not self._extra.any():
                kept = int(grown(wanted.reshape(grid.shape), MARGIN + 1).sum())
                if len(region.cells) <= 2 * max(kept, 9):
                    return
            wanted |= self._extra
            cells = np.flatnonzero(grown(wanted.reshape(grid.shape), MARGIN))
            if not len(cells) or np.array_equal(cells, region.cells):
                self._extra[:] = False
                return
            self._extra[:] = False
        else:
            cells = region.cells
        found = self._later("move", lambda: self._rebuilt(cells))
        if found is not None:
            # the penalty may have been learned meanwhile
            self._adopt(found if found.parameter == self._parameter else self._rebuilt(found.cells))

    def _adopt(self, region: _Region) -> None:
        """Carry solution and multipliers over to another region."""
        count = math.prod(self.estimator.operator.surface.shape)
        whole = np.zeros((2, len(self.names), count), dtype=np.float32)
        if self._region is not None and self._z.shape[1] == len(self._region.cells):
            whole[0][:, self._region.cells], whole[1][:, self._region.cells] = self._z, self._u
        self._region, self._pressed = region, 0
        self._z, self._u = whole[0][:, region.cells], whole[1][:, region.cells]

    def _rebuilt(self, cells: Index) -> _Region:
        """Normal matrix of some cells with the penalty, and the inverse that the iteration needs."""
        estimator = self.estimator
        grid, c, n = estimator.operator.surface, len(self.names), len(cells)
        estimator.check_size(c * n)
        picks = (np.arange(c)[:, None] * math.prod(grid.shape) + cells[None, :]).ravel()
        out = self._out
        level = estimator.level(1)
        if self._normal is not None and (not out.any() or estimator.readings.independent):
            gram = self._normal[np.ix_(picks, picks)]
            if out.any():
                lost = level.matrix(cells, self._std, out)
                gram -= lost.T @ lost
        else:
            matrix = level.matrix(cells, self._std, ~out)
            gram = matrix.T @ matrix
        parameter = self._parameter or 1.0
        for i, q in enumerate(estimator.precisions(level, 1, parameter)):
            gram[i * n : (i + 1) * n, i * n : (i + 1) * n] += q[cells][:, cells].toarray()
        scale = np.repeat(estimator.cone.scales, n)
        gram *= scale[:, None] * scale[None, :]
        if self._rho is None or self._rho[0] != parameter:
            largest = _largest_eigenvalue(gram)
            inverse = _inverse(gram)
            # without noise next to nothing is penalised, and rounding decides about the smallest eigenvalue
            smallest = 0.0 if inverse is None else 1.0 / _largest_eigenvalue(inverse)
            self._rho = parameter, math.sqrt(largest * max(smallest, SMALLEST * largest))
        rho = self._rho[1]
        gram[np.diag_indices(c * n)] += rho
        inverse = _inverse(gram)
        if inverse is None:
            raise np.linalg.LinAlgError("the normal matrix of the region is not positive definite")
        # inverted in double precision and then rounded down: rounding must not let rho (H + rho)^-1 grow anything, since
        # the multipliers are carried from frame to frame
        single = (inverse * (1.0 - SHRINK)).astype(np.float32)
        inside = np.zeros(grid.shape, dtype=bool)
        inside.ravel()[cells] = True
        ring = inside & grown(~inside, 1)
        return _Region(cells, ring.ravel()[cells], single, rho, parameter)

    def _iterate(self, slope: Single, started: float) -> bool:
        """Bring the solution to this frame; False where time ended it."""
        region = self._region
        if region is None:
            return False
        cone = self.estimator.cone
        rho, inverse = np.float32(region.rho), region.inverse
        h = slope[:, region.cells] * cone.scales[:, None].astype(np.float32)
        z, u = self._z, self._u
        shape = z.shape
        deadline = math.inf if self.budget is None else started + 0.8 * self.budget
        converged = False
        for _ in range(ITERATIONS):
            x = (inverse @ (h + rho * (z - u)).ravel()).reshape(shape)
            relaxed = np.float32(1.6) * x - np.float32(0.6) * z
            new = cone.project(relaxed + u).astype(np.float32, copy=False)
            u = u + relaxed - new
            size = max(float(new[-1].max(initial=0.0)), 1e-30)
            change = max(float(np.abs(new - z).max(initial=0.0)), 0.5 * float(np.abs(x - new).max(initial=0.0)))
            z = new
            if change < self.tolerance * size:
                converged = True
                break
            if clock.perf_counter() > deadline:
                break
        self._z, self._u = z, u
        return converged

    def _look(self, y: Floats, actual: Floats, noise: float, *, judge: bool) -> None:
        """What the contact does not explain: pressure elsewhere, or taxels that are wrong."""
        health, grid = self.health, self.estimator.operator.surface
        out = self._out
        rest = actual - self._explained()
        left = np.where(out, 0.0, rest)
        self._residual = float(np.sqrt(np.mean(left[~out] ** 2)))
        typical = max(noise, float(np.median(np.abs(left[~out]))) / 0.6745)
        limit = max(UNEXPLAINED * typical, GROSS * float(np.abs(y).max()))
        size = np.abs(left)
        # a wrong taxel bends the solution round it: the worst first
        wrong = (size > limit) & (size > 0.6 * float(size.max()))
        few = int(wrong.sum()) <= 0.05 * len(left)
        if judge and few:
            self._count(wrong, "unexplained")
            right = ~wrong & ~out & (self._repeats == 0)
            self._bad[right] = np.minimum(self._bad[right], 0)
            # those left out for it are taken back when contact explains them again
            doubted = health.left_out & (health.reasons == "unexplained")
            self._bad[doubted] = np.where(np.abs(rest[doubted]) < limit, np.minimum(self._bad[doubted], 0) - EVERY, BAD)
        if few:
            left[wrong] = 0.0
        pull = self._adjoint(left)[-1] / np.sqrt(np.maximum(self._diagonal, 1e-300)) / typical
        if self._region is not None:
            pull[self._region.cells] = 0.0
            missing = pull > TAKEN
            if missing.any():
                self._extra |= grown(missing.reshape(grid.shape), 1).ravel()

    # -- the answer ----------------------------------------------------------------------------------------------------

    def _refresh_errors(self, y: Floats, noise: float) -> None:
        region = self._region
        if region is None:
            return
        p = self._z[-1]
        contact = p > FAINT * float(p.max(initial=0.0))
        count = int(contact.sum())
        self._errors_age += 1
        stale = self._errors is None or self._errors_age > REFRESH
        changed = abs(count - self._errors_cells) > CHANGED * max(self._errors_cells, 1)
        if count == 0 or (not (stale or changed) and "errors" not in self._pending):
            return
        cells = region.cells[contact]
        start = self._traction()[:, contact]
        heard = ~self._out
        std = max(noise, MODEL_ERROR * float(np.abs(y).max()))
        weight = region.parameter / noise**2 if noise > 0 else 0.0

        def work() -> tuple[Errors, int]:
            estimator = self.estimator
            level = estimator.level(1)
            data = estimator.normal(level, cells, y / std, self._std * std, heard)
            model = estimator.model(data, estimator.precisions(level, 1, weight), start, keep_face=True)
            model.weight = 1.0
            return estimator.summed_up([model])[1], len(cells)

        found = self._later("errors", work)
        if found is not None:
            self._errors, self._errors_cells = found
            self._errors_age = 0

    def _unknown(self, now: float, status: Status, like: Any, note: str | None) -> Touch:
        """A frame without an answer: NaN, and why."""
        self.health.unknown += 1
        grid = self.estimator.surface
        values = np.full((len(grid.components), *grid.shape), math.nan)
        return self._made(values, now, False, like, note, status, None)

    def _answer(
        self, now: float, converged: bool, like: Any, note: str | None, *, status: Status | None = None
    ) -> Touch:
        estimator = self.estimator
        grid = estimator.surface
        values = np.zeros((len(grid.components), math.prod(estimator.operator.surface.shape)))
        region = self._region
        if self._touching and region is not None:
            values[np.asarray(estimator.columns)[:, None], region.cells[None, :]] = self._traction()
        values = values.reshape(-1, *estimator.operator.surface.shape)
        noise = self._noise
        errors = self._errors
        if not self._touching and noise is not None:
            if self._unnoticed is None or self._unnoticed[0] != noise:
                self._unnoticed = noise, estimator.unnoticed(noise)
            errors = self._unnoticed[1]
        health = self.health
        earlier = health.frames - 1 - self._run
        if status is None and self._run >= STUCK and health.repeated - self._run < SELDOM * earlier:
            status = Status.FROZEN
        elif status is None and not self._touching:
            status = Status.NO_CONTACT
        elif status is None:
            status = Status.SOLVED if converged else Status.NOT_CONVERGED
        return self._made(values, now, converged, like, note, status, errors)

    def _made(
        self,
        values: Floats,
        now: float,
        converged: bool,
        like: Any,
        note: str | None,
        status: Status,
        errors: Errors | None,
    ) -> Touch:
        estimator, noise = self.estimator, self._noise
        said = [] if note is None else [note]
        if status not in (Status.SOLVED, Status.NO_CONTACT):
            said.append(f"{status.meaning}; {status.remedy}")
        return Touch(
            from_numpy(values, like),
            estimator.surface,
            self.names,
            "constrained",
            (*self.notes, *said),
            None if self._parameter is None else np.asarray(self._parameter),
            None if noise is None else noise * np.concatenate(estimator.scales),
            np.asarray(self._residual if status.known else math.nan),
            errors=errors,
            converged=np.asarray(converged),
            touching=np.asarray(self._touching and status.known),
            outliers=self._out,
            time=np.asarray(now),
            resolution=None if self._resolution is None else np.asarray(self._resolution),
            case=self._case,
            status=np.asarray(int(status), dtype=np.int8),
        )


def _inverse(matrix: npt.NDArray[Any]) -> npt.NDArray[Any] | None:
    """Of a symmetric positive matrix, in its own precision; None where it is not positive to that precision."""
    import scipy.linalg.lapack as lapack

    factorise, invert = (lapack.spotrf, lapack.spotri) if matrix.dtype == np.float32 else (lapack.dpotrf, lapack.dpotri)
    factor, failed = factorise(matrix, lower=True, clean=True)
    if failed:
        return None
    lower, failed = invert(factor, lower=True)
    if failed:
        return None
    return np.asarray(np.tril(lower) + np.tril(lower, -1).T)


def _largest_eigenvalue(matrix: Floats) -> float:
    """Of a positive matrix, by the power method; a few per cent are near enough."""
    x: Floats = np.random.default_rng(0).standard_normal(len(matrix))
    size = 1.0
    for _ in range(20):
        x = np.asarray(matrix @ (x / np.linalg.norm(x)))
        size = float(np.linalg.norm(x))
    return size
