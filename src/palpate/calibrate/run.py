"""Labels of one run that correct a map which was calibrated on other runs.

The value of a frame with the readings z (z = r u, size r and direction u) in a new run is that of the map, m(z), plus an error whose covariance is

    g^2 m m'                gain of the run, common to all taxels (`ForceMap.run_share`)
    o^2                     zero of the run (`ForceMap.run_zero`)
    r r' min(l/r, l'/r')^2 exp(-|u - u'|^2 / 2 w^2)
                            error l of the map at this place: what its models do not know, and what no label resembles
    b^2 + s^2               noise of each frame, and errors that frames of one press share

Without labels of the run its diagonal gives the interval. Labels of the run condition it (kriging of the errors of the map): one press
determines most of the gain, and of the error of the map near its own place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.calibrate.process import JITTER, Scaled
from palpate.elastic.pad import Floats

__all__ = ["FrameErrors", "RunLabels"]

#: Distance of directions over which errors of the map are correlated. Of 0.15, 0.3 and 0.6, this value gave the smallest errors
#: where a stream of four barometers was pressed at other places.
WIDTH = 0.15


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Value of each frame (frame,), and the standard deviations of the parts of its error.

    Attributes
    ----------
    mean : array (frame,)
    scaled : Scaled
        Readings.
    noise, shared, local : array (frame,)
        Noise of the frame, error that frames of its press share, error of the map at this place.
    gain : float
        Of the run, relative.
    zero : float
        Of the run [N].
    runs : float
        Number of runs that show the spread of gains.
    """

    mean: Floats
    scaled: Scaled
    noise: Floats
    shared: Floats
    local: Floats
    gain: float
    zero: float
    runs: float

    @property
    def std(self) -> Floats:
        """Return the standard deviation of each value."""
        own = self.noise**2 + self.shared**2 + self.local**2
        return np.asarray(np.sqrt(own + (self.gain * self.mean) ** 2 + self.zero**2))

    def covariance(self, other: FrameErrors) -> Floats:
        """Return the covariance of the errors of frames of one run (frame, other frame), without noise and what a press
        shares.
        """
        a, b = self.scaled, other.scaled
        apart = np.maximum(2.0 - 2.0 * a.direction @ b.direction.T, 0.0)
        least = np.minimum.outer(self.local / a.size, other.local / b.size)
        local = np.outer(a.size, b.size) * least**2 * np.exp(-0.5 * apart / WIDTH**2)
        return np.asarray(self.gain**2 * np.outer(self.mean, other.mean) + self.zero**2 + local)


@dataclass(frozen=True, eq=False)
class RunLabels:
    """Labels of the run that the frames to come belong to.

    Parameters
    ----------
    readings : array (label, reading)
        Without the zero of this run.
    values, std : array (label,)
        The quantity, and its standard deviation; 0 if exact.
    press : array (label,) of int
    """

    readings: Floats
    values: Floats
    std: Floats
    press: npt.NDArray[np.int64]

    def known(self, labels: FrameErrors) -> tuple[FrameErrors, Floats]:
        """Return the errors of the map at these labels with the standard deviation of the gain that they show, and the
        inverse of the covariance of the labels. Both serve all frames.
        """
        learnt = self._learnt(labels)
        return learnt, self._inverse(learnt)

    def corrected(self, frames: FrameErrors, known: tuple[FrameErrors, Floats]) -> tuple[Floats, Floats]:
        """Return the values of the frames given these labels, and their standard deviations. ``known`` is that of
        `known`.
        """
        labels, inverse = known
        frames = replace(frames, gain=labels.gain)
        across = frames.covariance(labels)
        mean = frames.mean + across @ inverse @ (self.values - labels.mean)
        told = ((across @ inverse) * across).sum(axis=1)
        return mean, np.sqrt(np.maximum(frames.std**2 - told, frames.noise**2 + frames.shared**2))

    def gain(self, known: tuple[FrameErrors, Floats]) -> tuple[float, float]:
        """Return the gain of this run over the map, and its standard deviation. ``known`` is that of `known`."""
        labels, inverse = known
        across = labels.gain**2 * labels.mean
        mean = 1.0 + float(across @ inverse @ (self.values - labels.mean))
        return mean, float(np.sqrt(max(labels.gain**2 - float(across @ inverse @ across), 0.0)))

    def _learnt(self, found: FrameErrors) -> FrameErrors:
        """Return the errors of the map at these labels. If there are several presses, the standard deviation of the gain
        takes in what they show of it, as one run more.

        That is its square, less its variance by the scatter between presses: one press does not distinguish the gain
        of the run from an error of the map at its place.
        """
        presses = np.unique(self.press)
        square = np.array([found.mean[self.press == p] @ found.mean[self.press == p] for p in presses])
        each = np.array([found.mean[self.press == p] @ (self.values - found.mean)[self.press == p] for p in presses])
        if len(presses) < 2 or not square.all():
            return found
        gain = each.sum() / square.sum()
        scatter = float(((each - gain * square) ** 2).sum()) / square.sum() ** 2 * len(presses) / (len(presses) - 1)
        known = found.runs
        return replace(
            found, gain=float(np.sqrt((known * found.gain**2 + max(gain**2 - scatter, 0.0)) / (known + 1.0)))
        )

    def _inverse(self, labels: FrameErrors) -> Floats:
        same = self.press[:, None] == self.press[None]
        size = float((labels.std**2).mean())
        noise = np.diag(labels.noise**2 + self.std**2 + JITTER * size)
        return np.asarray(
            np.linalg.inv(labels.covariance(labels) + np.outer(labels.shared, labels.shared) * same + noise)
        )
