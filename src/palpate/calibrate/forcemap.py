"""One quantity from readings: members averaged by how well they predict presses that were left out, with intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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
#: Prior count of presses that say that errors are as large as the model says; the largest squared error, in variances, that one label counts for.
PRIOR_COUNT, LARGEST = 8.0, 25.0
#: Degrees of freedom of an interval: this many, and one more per this many presses.
FREEDOM, PRESSES_OF_ONE = 4.0, 3.0
#: Spread of gains from one run to the next before labels of several runs show it, and how many runs that counts for. Presses at the same places: 3 and 11 % between
#: two streams of four barometers, 2 and 3 % between two runs of five magnetometers.
RUN, RUNS_OF_PRIOR = 0.08, 1.0
#: Error of a value, as a part of the usual one, for each unit by which the direction of its readings is away from that of every label; readings have a direction from this part of the largest on.
NOVEL, STRONG = 2.0, 0.2
#: Prior count of the sum of squared distances: one press at a distance of 0.3.
FIRST_NOVELTY = 0.09


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
        Factor on the members' standard deviations, from cross-validation errors.
    """

    process: Process
    members: tuple[Fitted, ...]
    weights: Floats
    inflation: float

    @classmethod
    def fit(cls, process: Process) -> ForceMap:
        """All members for these labels, and their weights."""
        return cls.of(process, tuple(process.fit(without) for without in MEMBERS))

    @classmethod
    def of(cls, process: Process, members: tuple[Fitted, ...]) -> ForceMap:
        """The average of fitted members."""
        count = len(process.values)
        score = np.array([m.score for m in members])
        weights = np.exp((score - score.max()) / count**TEMPER)
        weights /= weights.sum()
        squares = sum(w * (m.left_out / m.left_out_std) ** 2 for w, m in zip(weights, members))
        # labels of one press share their error: they count as one
        each = [
            float(np.minimum(np.asarray(squares)[process.press == p], LARGEST).mean()) for p in np.unique(process.press)
        ]
        inflation = np.sqrt(max((PRIOR_COUNT + sum(each)) / (PRIOR_COUNT + len(each)), 1.0))
        return cls(process, members, weights, float(inflation))

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
        """Standard deviation that is open because no label is like the frame (frame, reading), as a part of what is usual for readings of its size.

        Two parts: beyond the largest labelled readings a map goes on as it began, and pads do not; and a press at another place than any label's has readings
        of another direction u = z/|z|, at a distance from that of the nearest label.
        """
        p = self.process
        labels, frames = Scaled.of(p.readings, p.scale), Scaled.of(readings, p.scale)
        largest = float(labels.size.max())
        beyond = 1.0 - largest / np.maximum(frames.size, largest)
        strong = labels.size > STRONG * largest
        away = chord(frames.direction @ labels.direction[strong].T)
        # faint readings have the direction of their noise
        return np.hypot(beyond, self.direction_share * away * np.minimum(frames.size / (STRONG * largest), 1.0))

    @cached_property
    def direction_share(self) -> float:
        """Error of a value, as a part of the usual one, for each unit of distance between directions: the prior, and what each press shows when it is left out."""
        p = self.process
        labels, error = Scaled.of(p.readings, p.scale), self.left_out
        strong = labels.size > STRONG * float(labels.size.max())
        squares, distances = FIRST_NOVELTY * NOVEL**2, FIRST_NOVELTY
        for press in np.unique(p.press[strong]):
            one, other = strong & (p.press == press), strong & (p.press != press)
            size = float(((p.unit * labels.size[one]) ** 2).mean())
            if other.any():
                squares += float((error[one] ** 2).mean()) / size
                distances += float((chord(labels.direction[one] @ labels.direction[other].T) ** 2).mean())
        return float(np.sqrt(squares / distances))

    @property
    def run_share(self) -> float:
        """Standard deviation of a new run's gain: the prior, and the cross-validation of each run."""
        gains = np.asarray(sum(w * m.run_gains for w, m in zip(self.weights, self.members)))
        return float(np.sqrt((RUNS_OF_PRIOR * RUN**2 + (gains**2).sum()) / (RUNS_OF_PRIOR + len(gains))))

    @property
    def left_out(self) -> Floats:
        """Error of each label when its press is left out."""
        return np.asarray(sum(w * m.left_out for w, m in zip(self.weights, self.members)))

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


def chord(cosine: Floats) -> Floats:
    """Distance of each direction from the nearest of others, from the cosines between them (direction, other)."""
    return np.asarray(np.sqrt(np.maximum(2.0 - 2.0 * cosine.max(axis=1), 0.0)))


def usual_scale(readings: Floats) -> Floats:
    """What each reading is divided by, so that the usual frame has length 1."""
    square = (readings**2).mean(axis=0)
    if not square.any():
        return np.ones(len(square))
    scale = np.sqrt(square + FLOOR * square.mean())
    return np.asarray(scale * np.sqrt(((readings / scale) ** 2).sum(axis=1).mean()))
