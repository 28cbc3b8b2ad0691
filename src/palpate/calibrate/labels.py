"""Labels of frames: known weights that stood on the pad, or a force-torque sensor with its own clock."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.times import interpolated
from palpate.units import UNITS, parse_quantity

__all__ = ["GRAVITY", "Labelled", "Weight", "find_delay", "plateaus", "press_numbers", "stuck_labels"]

#: Name of the label that states the radius of the ball.
BALL = "ball_radius"
#: Standard gravity [m/s^2] (CGPM 1901).
GRAVITY = 9.80665
#: Relative error of a weight: kitchen scale and placement (a convention: 1 g of 100 g, and a weight that leans).
SCALE_STD = 0.01
#: Units of mass in kilograms.
MASSES = {"g": 1e-3, "kg": 1.0, "mg": 1e-6, "oz": 0.028349523125, "lb": 0.45359237}
#: Largest usual difference between clocks that were set by hand or started together [s].
USUAL_DELAY = 2.0
#: A contact begins and ends at PRESSED times the largest force. If that gives fewer than FEWEST presses, each is cut
#: into pieces.
PRESSED, FEWEST = 0.05, 5
#: A force value that repeats in STUCK_FRAMES frames or more is not a measurement if the readings meanwhile vary by
#: STUCK_VARIES of the variance of all.
STUCK_FRAMES, STUCK_VARIES = 3, 0.1


@dataclass(frozen=True)
class Weight:
    """A known normal force [N] that stood on the pad from ``start`` to ``end`` [s].

    Examples
    --------
    >>> from palpate.calibrate import Weight
    >>> weight = Weight.parse("200 g, 12 s to 20 s")
    >>> round(weight.force, 4), weight.start, weight.end
    (1.9613, 12.0, 20.0)
    """

    force: float
    start: float
    end: float

    @classmethod
    def parse(cls, text: str) -> Weight:
        """Read text such as "200 g, 12 s to 20 s" or "2 N, 500 ms to 3 s".

        Raises
        ------
        InvalidInput
            Another form, an unknown unit, or an end before the start.

        Examples
        --------
        >>> from palpate.calibrate import Weight
        >>> Weight.parse("0 g, 0 s to 3 s").force
        0.0
        """
        example = '"200 g, 12 s to 20 s"'
        match = re.fullmatch(r"\s*([^,]+?)\s*,\s*(.+?)\s+to\s+(.+?)\s*", text) if isinstance(text, str) else None
        if match is None:
            raise InvalidInput(
                f"a weight needs its mass or force, and the times when it stood on the pad, such as {example}; got {text!r}."
            )
        mass = re.fullmatch(r"([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*(\S+)", match[1])
        if mass is not None and mass[2] in MASSES:
            try:
                force = float(mass[1]) * MASSES[mass[2]] * GRAVITY
            except ValueError as error:
                raise InvalidInput(f"{mass[1]!r} is no number; write {example}.") from error
        elif mass is not None and mass[2] in UNITS["force"]:
            force = parse_quantity(match[1], "force", "weight")
        else:
            raise InvalidInput(
                f"the weight {match[1]!r} needs a number and one of {', '.join(MASSES)}, {', '.join(UNITS['force'])}; write {example}."
            )
        start, end = (parse_quantity(match[i], "time", "weight") for i in (2, 3))
        if not end > start:
            raise InvalidInput(f"the weight {text!r} ends at {end:g} s, not after {start:g} s; write {example}.")
        if not np.isfinite(force) or force < 0.0:
            raise InvalidInput(f"the weight {text!r} must not be negative; write 0 g where nothing stood on the pad.")
        return cls(force, start, end)


def find_delay(
    time: Floats, readings: Floats, reference_time: Floats, reference: Floats, *, most: float | None = None
) -> float:
    """Return the delay [s] to add to the reference's clock so that it fits the readings best.

    It is the delay with which a linear map from readings (frame, reading) explains most of the reference (sample,).
    First 81 delays up to ``most`` are tried (default: 2 s, and a quarter of the recording at most, because periodic
    presses look alike a period later), then the neighbourhood of the best, twice.

    Raises
    ------
    InvalidInput
        Clocks that do not overlap, or forces that do not follow the readings at any delay.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.calibrate import find_delay
    >>> time = np.arange(0.0, 10.0, 0.01)
    >>> press = np.maximum(np.sin(time**1.5), 0.0)
    >>> round(find_delay(time, press[:, None], time - 0.35, press), 2)
    0.35
    """
    span = float(time[-1] - time[0])
    step = (min(0.25 * span, USUAL_DELAY) if most is None else most) / 40.0
    best, explained = 0.0, -np.inf
    if not span > 0.0:
        raise InvalidInput(
            f"all {len(time)} frames have the time {time[0]:g} s, so no delay can be found: give two frames or more with their times."
        )
    few = int(max(10.0, 0.4 * len(time))) - 3
    if readings.shape[1] > few:  # too few frames for a linear map of all readings: use their leading components
        middle = readings - readings.mean(axis=0)
        readings = middle @ np.linalg.svd(middle, full_matrices=False)[2][:few].T
    for _ in range(3):
        for delay in best + step * np.arange(-40, 41):
            force = interpolated(time, reference_time + delay, reference)
            seen = np.isfinite(force)
            if seen.sum() < max(10, 0.4 * len(time), readings.shape[1] + 3):
                continue
            x = np.column_stack([readings[seen], np.ones(seen.sum())])
            left = force[seen] - x @ np.linalg.lstsq(x, force[seen], rcond=1e-8)[0]
            total = float(((force[seen] - force[seen].mean()) ** 2).sum())
            share = 1.0 - float((left**2).sum()) / total if total > 0.0 else -np.inf
            if share > explained + 1e-12:
                best, explained = float(delay), share
        step /= 20.0
    if not np.isfinite(explained):
        raise InvalidInput(
            f"the clock of the forces ({reference_time[0]:g} to {reference_time[-1]:g} s) and that of the frames ({time[0]:g} to {time[-1]:g} s) overlap too little: "
            "give both on one clock, or forces for at least 40 % of the frames."
        )
    return best


def stuck_labels(force: Floats, flat: Floats) -> tuple[npt.NDArray[np.bool_], float]:
    """Return the frames (frame,) whose force is a stuck value, and that value. The value is the smallest or largest of
    all, and repeats while the readings (frame, reading) vary as in other frames.

    A force sensor repeats one value if it has no measurement (-1, 999) or is at the end of its range; such frames have
    no label. Frames at rest do not count as stuck, because their readings do not vary. Weights entered by hand do not
    either, because each of their values repeats.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.calibrate.labels import stuck_labels
    >>> force = np.array([0.1, 0.7, 1.4, -1.0, 2.2, -1.0, 1.1, -1.0])
    >>> stuck, value = stuck_labels(force, np.array([[1.0, 7.0, 14.0, 3.0, 22.0, 18.0, 11.0, 9.0]]).T)
    >>> np.flatnonzero(stuck).tolist(), value
    ([3, 5, 7], -1.0)
    """
    seen = np.isfinite(force) & np.isfinite(flat).all(axis=1)
    none = np.zeros(len(force), dtype=bool)
    if seen.sum() <= STUCK_FRAMES:
        return none, 0.0
    usual = float(flat[seen].var(axis=0).sum())
    for value in (float(force[seen].min()), float(force[seen].max())):
        alike = seen & (force == value)
        others = force[seen & ~alike]
        if len(np.unique(others)) <= 0.5 * len(others):
            continue
        if value != 0.0 and alike.sum() >= STUCK_FRAMES and float(flat[alike].var(axis=0).sum()) > STUCK_VARIES * usual:
            return alike, value
    return none, 0.0


def press_numbers(
    time: Floats, force: Floats, run: np.ndarray[tuple[int, ...], np.dtype[np.int64]]
) -> npt.NDArray[np.int64]:
    """Return the number of the press to which each labelled frame belongs, from the force over time. In a run without
    times (NaN) each frame is a press.
    """
    out = np.zeros(len(force), dtype=np.int64)
    size = np.abs(force).reshape(len(force), -1).max(axis=1)
    count = 0
    for number in np.unique(run):
        at = np.flatnonzero(run == number)
        if np.isnan(time[at]).any():
            out[at] = count + np.arange(len(at))
            count += len(at)
            continue
        at = at[np.argsort(time[at], kind="stable")]
        on = size[at] > PRESSED * size.max()
        piece = np.cumsum(np.r_[True, on[1:] & ~on[:-1]]) - 1
        if (
            piece[-1] + 1 < FEWEST
        ):  # too few presses, as if pressed all the time: cut into pieces with equal numbers of frames
            piece = np.arange(len(at)) * min(12, len(at)) // max(len(at), 1)
        out[at] = count + piece
        count += int(piece[-1]) + 1
    return out


def plateaus(known: Mapping[str, Floats], flat: Floats, number_of_frame: npt.NDArray[np.intp]) -> npt.NDArray[np.int64]:
    """Return the number of the plateau of each labelled frame: frames in a row whose labels are exactly equal, and whose
    readings (frame, reading) hardly vary. They share the error of the label, so that they count as one.
    """
    labels = np.nan_to_num(np.stack(list(known.values()), axis=1))
    alike = (labels[1:] == labels[:-1]).all(axis=1) & (np.diff(number_of_frame) == 1)
    number = np.cumsum(np.r_[True, ~alike]) - 1
    usual = STUCK_VARIES * float(np.nanvar(flat, axis=0).sum())
    vary = [float(flat[number == k].var(axis=0).sum()) > usual for k in range(number[-1] + 1)]
    return np.cumsum(np.r_[True, ~alike | np.asarray(vary)[number[1:]]]) - 1


def spread_over(force: Floats, count: int) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    """Select about ``count`` frames: half evenly spaced in time, half in force."""
    if len(force) <= count:
        return np.arange(len(force))
    size = np.abs(force).reshape(len(force), -1).max(axis=1)
    half = count // 2
    in_time = np.linspace(0, len(force) - 1, half).round().astype(int)
    by_force = np.argsort(size, kind="stable")[np.linspace(0, len(force) - 1, count - half).round().astype(int)]
    return np.unique(np.concatenate([in_time, by_force]))


def weights_of(given: Sequence[Weight | str]) -> list[Weight]:
    """Return weights, parsed if they are given as text."""
    return [w if isinstance(w, Weight) else Weight.parse(w) for w in given]


@dataclass(frozen=True, eq=False)
class Labelled:
    """Frames with a known force, place or ball radius.

    ``flat`` are the readings minus the zero of their run (label, reading), ``planes`` the same by channel and taxel
    (label, channel, *array). ``known`` has force, place and ball radius of each frame, NaN where unknown.
    """

    flat: Floats
    planes: Floats
    known: Mapping[str, Floats]
    std: Floats
    time: Floats | None
    run: npt.NDArray[np.int64]
    press: npt.NDArray[np.int64]
    rest: Floats

    def over(self, gains: Floats) -> Labelled:
        """Return the same frames with the readings of the planes divided by their gains (channel, *array)."""
        return replace(self, planes=self.planes / gains, rest=self.rest / gains)
