"""One quantity from readings: members averaged by how well they predict presses that were left out, with intervals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.calibrate.process import FLOOR, MEMBERS, NAMES, Fitted, Process
from palpate.elastic.pad import Floats

__all__ = ["ForceMap"]

#: Labels that one map keeps: its work grows with their cube (500: 4 s).
MOST_LABELS = 500
#: Weights of members use the score over this power of the number of labels: labels of one recording are no independent proofs.
TEMPER = 0.5
#: Prior count of presses that say that errors are as large as the model says; the largest squared error, in variances, that one label counts for.
PRIOR_COUNT, LARGEST = 8.0, 25.0
#: Degrees of freedom of an interval: so many, and one more for each so many presses.
FREEDOM, PRESSES_OF_ONE = 4.0, 3.0
#: Gains between one run and the next, where the labels are of one run (a convention; four published sensors differed by 1 to 8 %).
RUN = 0.05


@dataclass(frozen=True, eq=False)
class ForceMap:
    """A map from readings (frame, reading) to one quantity, with its standard deviation.

    Attributes
    ----------
    process : Process
        Labels and what makes their covariance.
    members : tuple of Fitted
    weights : array (member,)
        They add up to 1.
    inflation : float
        Standard deviations are so many times those of the members, by how far off presses were that were left out.
    runs : int
        How many runs the labels come from.
    """

    process: Process
    members: tuple[Fitted, ...]
    weights: Floats
    inflation: float
    runs: int

    @classmethod
    def fit(cls, process: Process, *, runs: int = 1) -> ForceMap:
        """All members for these labels, and their weights."""
        return cls.of(process, tuple(process.fit(without) for without in MEMBERS), runs)

    @classmethod
    def of(cls, process: Process, members: tuple[Fitted, ...], runs: int) -> ForceMap:
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
        return cls(process, members, weights, float(inflation), runs)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of Student's distribution for intervals."""
        return FREEDOM + len(np.unique(self.process.press)) / PRESSES_OF_ONE

    def predict(self, readings: Floats) -> tuple[Floats, Floats]:
        """Value and standard deviation of each frame."""
        found = [self.process.predict(m, readings) for m in self.members]
        mean = np.asarray(sum(w * m for w, (m, _) in zip(self.weights, found)))
        square = sum(w * (s**2 + (m - mean) ** 2) for w, (m, s) in zip(self.weights, found))
        run = RUN * np.abs(mean) if self.runs == 1 else 0.0
        return mean, np.hypot(self.inflation * np.sqrt(square), run)

    @property
    def left_out(self) -> Floats:
        """Error of each label when its press is left out."""
        return np.asarray(sum(w * m.left_out for w, m in zip(self.weights, self.members)))

    # -- files ---------------------------------------------------------------------------------------------------------

    def arrays(self) -> dict[str, Any]:
        """What a file keeps: labels, scale, physics, and the hyperparameters of each member."""
        p = self.process
        out: dict[str, Any] = {
            "readings": p.readings, "values": p.values, "std": p.std, "scale": p.scale, "press": p.press,
            "log": np.stack([m.log for m in self.members]), "runs": np.asarray(self.runs),
        }  # fmt: skip
        if p.physics is not None:
            out["physics"] = p.physics
        if p.time is not None:
            out["time"] = p.time
        return out

    @classmethod
    def from_arrays(cls, held: Mapping[str, Any]) -> ForceMap:
        """The map of `arrays`."""
        if held["log"].shape != (len(MEMBERS), len(NAMES)):
            raise ValueError(f"holds {held['log'].shape} hyperparameters for {(len(MEMBERS), len(NAMES))}")
        process = Process(
            held["readings"], held["values"], held["std"], held["scale"], held.get("physics"), held["press"], held.get("time")
        )  # fmt: skip
        lacks = () if process.physics is not None else ("physics",)
        members = tuple(process.made(log, (*without, *lacks)) for log, without in zip(held["log"], MEMBERS))
        return cls.of(process, members, int(held["runs"]))


def usual_scale(readings: Floats) -> Floats:
    """What each reading is divided by, so that the usual frame has length 1."""
    square = (readings**2).mean(axis=0)
    if not square.any():
        return np.ones(len(square))
    scale = np.sqrt(square + FLOOR * square.mean())
    return np.asarray(scale * np.sqrt(((readings / scale) ** 2).sum(axis=1).mean()))
