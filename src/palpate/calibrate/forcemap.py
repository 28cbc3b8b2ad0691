"""Map readings to one quantity, with intervals: an average of several models, weighted by how well each predicts
presses that were left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate.calibrate.process import FLOOR, MEMBERS, NAMES, Fitted, Process, Scaled
from palpate.elastic.pad import Floats

__all__ = ["ForceMap"]

#: Largest number of labels that a map keeps: computing time grows with the cube (500: 4 s).
MAX_LABELS = 500
#: Weights of the models use the score divided by this power of the number of labels, because labels of one recording
#: are not independent evidence.
TEMPER = 0.5
#: Number of presses as which the prior (errors are as large as the model predicts) counts; largest squared error, in
#: variances, that one label contributes.
PRIOR_COUNT, LARGEST = 8.0, 25.0
#: Degrees of freedom of an interval: FREEDOM, plus one for every PRESSES_OF_ONE presses.
FREEDOM, PRESSES_OF_ONE = 4.0, 3.0
#: Prior standard deviation of gains between runs, used until labels of several runs show it, and the number of runs as
#: which it counts. Presses at the same places differed by 3 and 11 % between two streams of four barometers, and by 2
#: and 3 % between two runs of five magnetometers.
RUN, RUNS_OF_PRIOR = 0.08, 1.0
#: Error of a value, relative to the usual one, for each unit of distance between the direction of its readings and the
#: nearest direction of a label. Readings below STRONG of the largest have no direction.
NOVEL, STRONG = 2.0, 0.2
#: Prior of the sum of squared distances: one press at a distance of 0.3.
FIRST_NOVELTY = 0.09


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
        Factor on the members' standard deviations, from cross-validation errors.
    """

    process: Process
    members: tuple[Fitted, ...]
    weights: Floats
    inflation: float

    @classmethod
    def fit(cls, process: Process) -> ForceMap:
        """Fit all models to these labels, and weight them."""
        return cls.of(process, tuple(process.fit(without) for without in MEMBERS))

    @classmethod
    def of(cls, process: Process, members: tuple[Fitted, ...]) -> ForceMap:
        """Build the average of fitted models."""
        count = len(process.values)
        score = np.array([m.score for m in members])
        weights = np.exp((score - score.max()) / count**TEMPER)
        weights /= weights.sum()
        squares = sum(w * (m.left_out / m.left_out_std) ** 2 for w, m in zip(weights, members))
        # labels of the same press share their error and count as one
        each = [
            float(np.minimum(np.asarray(squares)[process.press == p], LARGEST).mean()) for p in np.unique(process.press)
        ]
        inflation = np.sqrt(max((PRIOR_COUNT + sum(each)) / (PRIOR_COUNT + len(each)), 1.0))
        return cls(process, members, weights, float(inflation))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of Student's distribution for the intervals."""
        return FREEDOM + len(np.unique(self.process.press)) / PRESSES_OF_ONE

    def predict(self, readings: Floats) -> tuple[Floats, Floats]:
        """Return value and standard deviation for each frame."""
        found = [self.process.predict(m, readings) for m in self.members]
        mean = np.asarray(sum(w * m for w, (m, _) in zip(self.weights, found)))
        square = sum(w * (s**2 + (m - mean) ** 2) for w, (m, s) in zip(self.weights, found))
        own = self.inflation * np.sqrt(square)
        p = self.process
        # use the typical value for readings of this size: a component that is 0 by chance is not known better for that
        usual = p.unit * Scaled.of(readings, p.scale).size
        return mean, np.sqrt(own**2 + (self.run_share * mean) ** 2 + (self.novelty(readings) * usual) ** 2)

    def novelty(self, readings: Floats) -> Floats:
        """Return the standard deviation due to frames (frame, reading) that resemble no label, relative to the typical
        value for readings of their size.

        It has two parts. Beyond the largest labelled readings a map extrapolates, which pads do not follow exactly.
        And a press at a place without labels has readings of another direction u = z/|z|, at some distance from that
        of the nearest label.
        """
        p = self.process
        labels, frames = Scaled.of(p.readings, p.scale), Scaled.of(readings, p.scale)
        largest = float(labels.size.max())
        beyond = 1.0 - largest / np.maximum(frames.size, largest)
        strong = labels.size > STRONG * largest
        away = chord(frames.direction @ labels.direction[strong].T)
        # the direction of faint readings is that of their noise
        return np.hypot(beyond, self.direction_share * away * np.minimum(frames.size / (STRONG * largest), 1.0))

    @cached_property
    def direction_share(self) -> float:
        """Return the error of a value, relative to the typical one, for each unit of distance between directions: the
        prior combined with the error of each press when it is left out.
        """
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
        """Return the standard deviation of the gain of a new run: the prior combined with the cross-validation of each
        run.
        """
        gains = np.asarray(sum(w * m.run_gains for w, m in zip(self.weights, self.members)))
        return float(np.sqrt((RUNS_OF_PRIOR * RUN**2 + (gains**2).sum()) / (RUNS_OF_PRIOR + len(gains))))

    @property
    def left_out(self) -> Floats:
        """Return the error of each label when its press is left out of the fit."""
        return np.asarray(sum(w * m.left_out for w, m in zip(self.weights, self.members)))

    # -- files ---------------------------------------------------------------------------------------------------------

    def arrays(self) -> dict[str, Any]:
        """Return the arrays to write to a file: labels, scale, physics, and the hyperparameters of each model."""
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
        """Return the map that `arrays` describes."""
        log = held["log"]
        # older files have fewer models, in the same order
        if log.ndim != 2 or not 1 <= len(log) <= len(MEMBERS) or log.shape[1] != len(NAMES):
            raise ValueError(f"holds {log.shape} hyperparameters for {(len(MEMBERS), len(NAMES))}")
        process = Process(
            held["readings"], held["values"], held["std"], held["scale"], held.get("physics"), held["press"], held.get("time"), held.get("run")
        )  # fmt: skip
        lacks = () if process.physics is not None else ("physics",)
        members = tuple(process.made(row, (*without, *lacks)) for row, without in zip(log, MEMBERS))
        return cls.of(process, members)


def chord(cosine: Floats) -> Floats:
    """Return the distance of each direction from the nearest of others, given the cosines between them (direction,
    other).
    """
    return np.asarray(np.sqrt(np.maximum(2.0 - 2.0 * cosine.max(axis=1), 0.0)))


def usual_scale(readings: Floats) -> Floats:
    """Return the divisor of each reading with which the typical frame has length 1."""
    square = (readings**2).mean(axis=0)
    if not square.any():
        return np.ones(len(square))
    scale = np.sqrt(square + FLOOR * square.mean())
    return np.asarray(scale * np.sqrt(((readings / scale) ** 2).sum(axis=1).mean()))
