"""Map readings to one quantity, with intervals: an average of several models, weighted by how well each predicts
presses that were left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from palpate.calibrate.process import AT_REST, FLOOR, JITTER, MEMBERS, NAMES, Fitted, Process, Scaled
from palpate.calibrate.run import FrameErrors, RunLabels
from palpate.elastic.pad import Floats

__all__ = ["ForceMap"]

#: Largest number of labels that a map keeps: computing time grows with the cube (500: 4 s).
MAX_LABELS = 500
#: A model has the weight (mean square of its left-out errors)^(-n/2), its likelihood if the variance of errors is not
#: known. For n, this power of the number of labels: labels of one recording are not independent evidence. The models'
#: own standard deviations play no part: they are largest for presses that differ from the others.
TEMPER = 0.5
#: The prior that errors are as large as the models predict counts as PRIOR_PRESSES. LARGEST: limit on the squared
#: error of one label, in units of its variance.
PRIOR_PRESSES, LARGEST = 4.0, 25.0
#: Prior standard deviation of gains between runs, used until labels of several runs show it, and the number of runs as
#: which it counts. Presses at the same places differed by 3 and 11 % between two streams of four barometers, and by 2
#: and 3 % between two runs of five magnetometers.
RUN, RUNS_OF_PRIOR = 0.08, 1.0
#: Prior error of a value beyond the intervals of the models, relative to the typical value, for each unit of `distance`
#: from the labels. Readings below STRONG of the largest have no direction.
NOVEL, STRONG = 2.0, 0.2
#: The prior counts as one press at this distance.
FIRST_DISTANCE = 0.3
#: Logarithm of an amplitude that vanishes beside all others.
NO_TERM = -80.0
#: Number of labels as which the assumption counts that all readings of a sensor have the same magnitude: few presses do
#: not show that a taxel far from all of them reads little.
ALIKE_LABELS = 10.0


@dataclass(frozen=True, eq=False)
class ForceMap:
    """A map from readings (frame, reading) to one quantity and its standard deviation.

    Attributes
    ----------
    process : Process
        Labels and their covariance function.
    members : tuple of Fitted
    weights : array (member,)
        They add up to 1.
    inflation : float
        Factor on the members' standard deviations, from cross-validation errors; below 1 where these are smaller than the members say.
    this_run : RunLabels or None
        Labels of the run that the frames come from. None: the frames come from a new run, and its gain is unknown.
    """

    process: Process
    members: tuple[Fitted, ...]
    weights: Floats
    inflation: float
    this_run: RunLabels | None = None

    @classmethod
    def fit(cls, process: Process) -> ForceMap:
        """Fit all models to these labels, and weight them. Without times, models that differ only in the lag count once."""
        timed = process.time is not None
        return cls.of(process, tuple(process.fit(without) for without in MEMBERS if timed or "lag" not in without))

    @classmethod
    def of(cls, process: Process, members: tuple[Fitted, ...]) -> ForceMap:
        """Build the average of fitted models."""
        weights = relative_weights(np.array([(m.left_out**2).mean() for m in members]), process)
        made = cls(process, members, weights, 1.0)
        return replace(made, inflation=inflation((made.left_out / made.left_out_std) ** 2, process.press))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of Student's distribution for the intervals: one, plus the number of presses that show how
        large the quantity is, (sum r^2)^2 / sum r^4 for presses whose readings have the sizes r.

        Sizes of all terms are fractions of the typical label, which three labels do not show well, and a light press
        shows less than a strong one.
        """
        p = self.process
        square = Scaled.of(p.readings, p.scale).size ** 2
        each = np.array([square[p.press == press].mean() for press in np.unique(p.press)])
        return 1.0 + float(each.sum() ** 2 / (each**2).sum())

    def predict(self, readings: Floats) -> tuple[Floats, Floats]:
        """Return value and standard deviation for each frame."""
        frames = self.errors(readings)
        if self.this_run is None or self._of_this_run is None:
            return frames.mean, frames.std
        return self.this_run.corrected(frames, self._of_this_run)

    @cached_property
    def _of_this_run(self) -> tuple[FrameErrors, Floats] | None:
        """Return what the labels of this run tell of the errors of its frames; None without such labels."""
        return None if self.this_run is None else self.this_run.known(self.errors(self.this_run.readings))

    def errors(self, readings: Floats) -> FrameErrors:
        """Return the value of each frame for a run without labels, and the parts of its error."""
        found = [self.process.predict(m, readings) for m in self.members]
        mean = np.asarray(sum(w * m for w, (m, _) in zip(self.weights, found)))
        square = sum(w * (s**2 + (m - mean) ** 2) for w, (m, s) in zip(self.weights, found))
        p = self.process
        scaled = Scaled.of(readings, p.scale)
        noises = [p.noise(m, scaled) for m in self.members]
        noise, shared = (
            np.asarray(self.inflation**2 * sum(w * n[i] for w, n in zip(self.weights, noises))) for i in (0, 1)
        )
        # use the typical value for readings of this size: a component that is 0 by chance is not more accurate
        novel = self.novelty(readings) * p.unit * scaled.size
        local = np.sqrt(np.maximum(self.inflation**2 * square - noise - shared, 0.0) + novel**2)
        return FrameErrors(
            mean, scaled, np.sqrt(noise), np.sqrt(shared), local, self.run_share, self.run_zero, self.runs
        )

    def novelty(self, readings: Floats) -> Floats:
        """Return the standard deviation due to frames (frame, reading) that resemble no label, relative to the typical
        value for readings of their size.

        Errors near the labels are those of presses that were left out. Beyond the largest label a map extrapolates, which
        pads do not follow: that error grows with the square, as curvature does.
        """
        p = self.process
        labels, frames = Scaled.of(p.readings, p.scale), Scaled.of(readings, p.scale)
        return np.hypot(self.distance_share * distance(labels, frames), beyond(labels, frames) ** 2)

    def unlike(self, readings: Floats) -> float:
        """Return the largest novelty of the frames (frame, reading), or the largest fraction of their size that exceeds the
        largest label.
        """
        p = self.process
        past = beyond(Scaled.of(p.readings, p.scale), Scaled.of(readings, p.scale))
        most = np.maximum(self.novelty(readings), past)
        if self.this_run is not None:
            good = np.isfinite(readings).all(axis=1)
            most = most[good] * self.predict(readings[good])[1] / self.errors(readings[good]).std
        return float(np.nanmax(most, initial=0.0))

    @cached_property
    def distance_share(self) -> float:
        """Return the error of a value, relative to the typical one, for each unit of `distance`, beyond the intervals of the
        models, which also grow with distance: the slope of squared errors of left-out presses over squared distances,
        combined with the prior.
        """
        p = self.process
        labels, more = Scaled.of(p.readings, p.scale), self.left_out**2 - self.left_out_std**2
        strong = labels.size > STRONG * float(labels.size.max())
        slope, weight = FIRST_DISTANCE**4 * NOVEL**2, FIRST_DISTANCE**4
        for press in np.unique(p.press[strong]):
            at, other = strong & (p.press == press), p.press != press
            if other.any():
                square = float((distance(labels[other], labels[at]) ** 2).mean())
                slope += square * float(more[at].mean() / ((p.unit * labels.size[at]) ** 2).mean())
                weight += square**2
        return float(np.sqrt(max(slope, 0.0) / weight))

    @property
    def runs(self) -> float:
        """Return the number of runs that show the spread of gains; the prior counts as `RUNS_OF_PRIOR`."""
        return RUNS_OF_PRIOR + len(self.members[0].run_gains)

    @property
    def run_share(self) -> float:
        """Return the standard deviation of the gain of a new run: the prior combined with the cross-validation of each
        run.
        """
        gains = np.asarray(sum(w * m.run_gains for w, m in zip(self.weights, self.members)))
        return float(np.sqrt((RUNS_OF_PRIOR * RUN**2 + (gains**2).sum()) / self.runs))

    @property
    def gain_std(self) -> float:
        """Return the standard deviation of the gain of the run that the frames come from."""
        if self.this_run is None or self._of_this_run is None:
            return self.run_share
        return self.this_run.gain(self._of_this_run)[1]

    @cached_property
    def run_zero(self) -> float:
        """Return the standard deviation of the zero of a new run: the errors at rest when a press is left out, and the
        mean error at rest of each run when it is left out.
        """
        p = self.process
        size = Scaled.of(p.readings, p.scale).size
        rest = (size < AT_REST * size.max()) & (np.abs(p.values) < AT_REST * np.abs(p.values).max())
        known = float((self.left_out[rest] ** 2).mean()) if rest.any() else 0.0
        zeros = p.unit * np.asarray(sum(w * m.run_zeros for w, m in zip(self.weights, self.members)))
        zeros = zeros[np.isfinite(zeros)]
        return float(np.sqrt(known + float((zeros**2).mean()))) if len(zeros) else known**0.5

    @property
    def labels(self) -> Process:
        """Return all labels, with those of `this_run` as a run of their own."""
        p, new = self.process, self.this_run
        if new is None:
            return p
        runs = np.zeros(len(p.values), dtype=np.int64) if p.run is None else p.run
        return replace(
            p,
            readings=np.concatenate([p.readings, new.readings]),
            values=np.concatenate([p.values, new.values]),
            std=np.concatenate([p.std, new.std]),
            press=np.concatenate([p.press, new.press + p.press.max() + 1]),
            time=None,
            run=np.concatenate([runs, np.full(len(new.values), runs.max() + 1)]),
        )

    @property
    def left_out(self) -> Floats:
        """Return the error of each label when its press is left out of the fit."""
        return np.asarray(sum(w * m.left_out for w, m in zip(self.weights, self.members)))

    @property
    def left_out_std(self) -> Floats:
        """Return the standard deviation of `left_out` according to the models."""
        mean, found = self.left_out, zip(self.weights, self.members)
        return self.inflation * np.sqrt(sum(w * (m.left_out_std**2 + (m.left_out - mean) ** 2) for w, m in found))

    # -- files ---------------------------------------------------------------------------------------------------------

    def arrays(self) -> dict[str, Any]:
        """Return the arrays to write to a file: labels, scale, physics, and the hyperparameters of each model."""
        p = self.process
        out: dict[str, Any] = {
            "readings": p.readings, "values": p.values, "std": p.std, "scale": p.scale, "press": p.press,
            "log": np.stack([m.log for m in self.members]), "expected": np.asarray(p.expected),
        }  # fmt: skip
        if p.physics is not None:
            out["physics"] = p.physics
        if p.time is not None:
            out["time"] = p.time
        if p.run is not None:
            out["run"] = p.run
        if self.this_run is not None:
            out.update({f"this_run_{name}": value for name, value in vars(self.this_run).items()})
        return out

    @classmethod
    def from_arrays(cls, held: Mapping[str, Any]) -> ForceMap:
        """Return the map that `arrays` describes."""
        log = held["log"]
        # older files have fewer models and hyperparameters, in the same order, and no bend
        if log.ndim != 2 or not 1 <= len(log) <= len(MEMBERS) or not len(NAMES) - 1 <= log.shape[1] <= len(NAMES):
            raise ValueError(f"holds {log.shape} hyperparameters for {(len(MEMBERS), len(NAMES))}")
        log = np.pad(log, ((0, 0), (0, len(NAMES) - log.shape[1])), constant_values=NO_TERM)
        process = Process(
            held["readings"], held["values"], held["std"], held["scale"], held.get("physics"), held["press"], held.get("time"), held.get("run"),
            expected=float(held.get("expected", 0.0)),
        )  # fmt: skip
        lacks = () if process.physics is not None else ("physics",)
        members = tuple(process.made(row, (*without, *lacks)) for row, without in zip(log, MEMBERS))
        made = cls.of(process, members)
        if "this_run_values" not in held:
            return made
        return replace(made, this_run=RunLabels(*(held[f"this_run_{f.name}"] for f in fields(RunLabels))))


def beyond(labels: Scaled, frames: Scaled) -> Floats:
    """Return the fraction of the size of each frame that exceeds the largest label."""
    largest = float(labels.size.max())
    return np.asarray(1.0 - largest / np.maximum(frames.size, largest))


def distance(labels: Scaled, frames: Scaled) -> Floats:
    """Return the distance of each frame from all labels: in size, beyond the largest label, and in the direction
    u = z/|z| of its readings, which depends on the place of the press.
    """
    strong = labels.size > STRONG * float(labels.size.max())
    cosine = (frames.direction @ labels.direction[strong].T).max(axis=1)
    # small readings have the direction of their noise
    away = np.minimum(frames.size / (STRONG * labels.size.max()), 1.0) * np.sqrt(np.maximum(2.0 - 2.0 * cosine, 0.0))
    return np.hypot(beyond(labels, frames), away)


def usual_scale(readings: Floats) -> Floats:
    """Return the divisor of each of the ``readings`` (label, reading) with which the typical frame has length 1."""
    square = (readings**2).mean(axis=0)
    if not square.any():
        return np.ones(len(square))
    common = max(FLOOR, ALIKE_LABELS / (len(readings) + ALIKE_LABELS))
    scale = np.sqrt((1.0 - common) * square + common * square.mean())
    return np.asarray(scale * np.sqrt(((readings / scale) ** 2).sum(axis=1).mean()))


def relative_weights(squares: Floats, process: Process) -> Floats:
    """Return the weights of models whose left-out errors have these mean squares; they add up to 1 (see `TEMPER`)."""
    square = squares + JITTER * process.unit**2
    weights = (square.min() / square) ** (0.5 * len(process.values) ** TEMPER)
    return np.asarray(weights / weights.sum())


def inflation(squares: Floats, press: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> float:
    """Return the factor on a model's standard deviations, from squared left-out errors in units of its variances."""
    squares = np.minimum(squares, LARGEST)
    # labels of the same press share their error and count as one
    each = [float(squares[press == p].mean()) for p in np.unique(press)]
    return float(np.sqrt((PRIOR_PRESSES + sum(each)) / (PRIOR_PRESSES + len(each))))
