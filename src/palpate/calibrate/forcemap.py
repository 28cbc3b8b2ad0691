"""One quantity from readings: members averaged by how well they predict presses that were left out, with intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from palpate.calibrate.process import FLOOR, MEMBERS, NAMES, Fitted, Process, Scaled
from palpate.elastic.pad import Floats

__all__ = ["ForceMap"]

#: Labels that one map keeps: its work grows with their cube (500: 4 s).
MAX_LABELS = 500
#: Weights of members use the score over this power of the number of labels: labels of one recording are no independent proofs.
TEMPER = 0.5
#: Degrees of freedom of an interval before any press, which is also the number of presses that say beforehand that errors are as large as the members say;
#: each press in so many adds one. The largest squared error, in variances, that one label counts for.
FREEDOM, PRESSES_OF_ONE, LARGEST = 4.0, 3.0, 25.0
#: Spread of gains from one run to the next before labels of several runs show it, and how many runs that counts for. Presses at the same places: 3 and 11 % between
#: two streams of four barometers, 2 and 3 % between two runs of five magnetometers.
RUN, RUNS_OF_PRIOR = 0.08, 1.0
#: Error of a value beyond what the members say, as a part of the usual one, for each unit of `distance` of its readings from those of every label; readings have a direction from this part of the largest on.
NOVEL, STRONG = 1.0, 0.2
#: The prior counts as one press at this distance.
FIRST_DISTANCE = 0.3
#: Labels that count as much as the assumption that all readings of a sensor have one size: a taxel that no press came near is not a small one.
ALIKE_LABELS = 10.0


@dataclass(frozen=True, eq=False)
class ForceMap:
    """A map from readings (frame, reading) to one quantity, with its standard deviation.

    Attributes
    ----------
    process : Process
        Labels and their covariance function.
    members : tuple of Fitted
    weights : array (member,)
        They add up to 1.
    inflation : float
        Factor on the members' standard deviations, from cross-validation errors; below 1 where these are smaller than the members say.
    """

    process: Process
    members: tuple[Fitted, ...]
    weights: Floats
    inflation: float

    @classmethod
    def fit(cls, process: Process) -> ForceMap:
        """All members for these labels, and their weights; without times those that differ by the lag alone are one."""
        timed = process.time is not None
        return cls.of(process, tuple(process.fit(without) for without in MEMBERS if timed or "lag" not in without))

    @classmethod
    def of(cls, process: Process, members: tuple[Fitted, ...]) -> ForceMap:
        """The average of fitted members."""
        score = np.array([m.score for m in members])
        weights = np.exp((score - score.max()) / len(process.values) ** TEMPER)
        made = cls(process, members, weights / weights.sum(), 1.0)
        squares = np.minimum((made.left_out / made.left_out_std) ** 2, LARGEST)
        # labels of one press share their error: they count as one
        each = [float(squares[process.press == p].mean()) for p in np.unique(process.press)]
        return replace(made, inflation=float(np.sqrt((FREEDOM + sum(each)) / (FREEDOM + len(each)))))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of Student's distribution for intervals."""
        return FREEDOM + len(np.unique(self.process.press)) / PRESSES_OF_ONE

    def predict(self, readings: Floats) -> tuple[Floats, Floats]:
        """Value and standard deviation of each frame."""
        found = [self.process.predict(m, readings) for m in self.members]
        mean = np.asarray(sum(w * m for w, (m, _) in zip(self.weights, found)))
        square = sum(w * (s**2 + (m - mean) ** 2) for w, (m, s) in zip(self.weights, found))
        own = self.inflation * np.sqrt(square)
        p = self.process
        # what is usual for readings of this size: a component of either sign may be 0 by chance, and is no better known there
        usual = p.unit * Scaled.of(readings, p.scale).size
        return mean, np.sqrt(own**2 + (self.run_share * mean) ** 2 + (self.novelty(readings) * usual) ** 2)

    def novelty(self, readings: Floats) -> Floats:
        """Standard deviation because no label resembles the frame (frame, reading), as a part of the usual value for readings of its size.

        What presses that were left out show holds near the labels. Beyond the largest of them a map goes on as it began, and pads do not: an error that grows with the square, as curvature does.
        """
        p = self.process
        labels, frames = Scaled.of(p.readings, p.scale), Scaled.of(readings, p.scale)
        return np.hypot(self.distance_share * distance(labels, frames), beyond(labels, frames) ** 2)

    def unlike(self, readings: Floats) -> float:
        """The largest of the novelties of frames (frame, reading), or of the parts of their readings that are beyond the largest label."""
        p = self.process
        past = beyond(Scaled.of(p.readings, p.scale), Scaled.of(readings, p.scale))
        return float(max(np.nanmax(self.novelty(readings), initial=0.0), np.nanmax(past, initial=0.0)))

    @cached_property
    def distance_share(self) -> float:
        """Error of a value, as a part of the usual one, for each unit of `distance`: the slope of squared errors over squared distances of presses that were left out, and the prior.

        It is what errors have beyond the members' own intervals, which grow with that distance too.
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
    def run_share(self) -> float:
        """Standard deviation of a new run's gain: the prior, and the cross-validation of each run."""
        gains = np.asarray(sum(w * m.run_gains for w, m in zip(self.weights, self.members)))
        return float(np.sqrt((RUNS_OF_PRIOR * RUN**2 + (gains**2).sum()) / (RUNS_OF_PRIOR + len(gains))))

    @property
    def left_out(self) -> Floats:
        """Error of each label when its press is left out."""
        return np.asarray(sum(w * m.left_out for w, m in zip(self.weights, self.members)))

    @property
    def left_out_std(self) -> Floats:
        """Its standard deviation by the members."""
        mean, found = self.left_out, zip(self.weights, self.members)
        return self.inflation * np.sqrt(sum(w * (m.left_out_std**2 + (m.left_out - mean) ** 2) for w, m in found))

    # -- files ---------------------------------------------------------------------------------------------------------

    def arrays(self) -> dict[str, Any]:
        """The arrays for a file: labels, scale, physics, and the hyperparameters of each member."""
        p = self.process
        out: dict[str, Any] = {
            "readings": p.readings, "values": p.values, "std": p.std, "scale": p.scale, "press": p.press,
            "log": np.stack([m.log for m in self.members]),
        }  # fmt: skip
        if p.physics is not None:
            out["physics"] = p.physics
        if p.time is not None:
            out["time"] = p.time
        if p.run is not None:
            out["run"] = p.run
        return out

    @classmethod
    def from_arrays(cls, held: Mapping[str, Any]) -> ForceMap:
        """The map of `arrays`."""
        log = held["log"]
        # files of before have fewer members, in the same order
        if log.ndim != 2 or not 1 <= len(log) <= len(MEMBERS) or log.shape[1] != len(NAMES):
            raise ValueError(f"holds {log.shape} hyperparameters for {(len(MEMBERS), len(NAMES))}")
        process = Process(
            held["readings"], held["values"], held["std"], held["scale"], held.get("physics"), held["press"], held.get("time"), held.get("run")
        )  # fmt: skip
        lacks = () if process.physics is not None else ("physics",)
        members = tuple(process.made(row, (*without, *lacks)) for row, without in zip(log, MEMBERS))
        return cls.of(process, members)


def beyond(labels: Scaled, frames: Scaled) -> Floats:
    """Part of the size of each frame by which it is larger than the largest label."""
    largest = float(labels.size.max())
    return np.asarray(1.0 - largest / np.maximum(frames.size, largest))


def distance(labels: Scaled, frames: Scaled) -> Floats:
    """How unlike all labels each frame is: in size, beyond the largest label, and in the direction u = z/|z| of its readings, which is that of a place."""
    strong = labels.size > STRONG * float(labels.size.max())
    cosine = (frames.direction @ labels.direction[strong].T).max(axis=1)
    # faint readings have the direction of their noise
    away = np.minimum(frames.size / (STRONG * labels.size.max()), 1.0) * np.sqrt(np.maximum(2.0 - 2.0 * cosine, 0.0))
    return np.hypot(beyond(labels, frames), away)


def usual_scale(readings: Floats) -> Floats:
    """The divisor of each of the ``readings`` (label, reading) that gives the usual frame length 1."""
    square = (readings**2).mean(axis=0)
    if not square.any():
        return np.ones(len(square))
    common = max(FLOOR, ALIKE_LABELS / (len(readings) + ALIKE_LABELS))
    scale = np.sqrt((1.0 - common) * square + common * square.mean())
    return np.asarray(scale * np.sqrt(((readings / scale) ** 2).sum(axis=1).mean()))
