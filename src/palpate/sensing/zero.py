"""Frames at rest: the zero of the readings and their noise; and a check whether readings lack a zero."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate._arrays import as_double, to_numpy
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.sensing.arrays import Array, check_noise
from palpate.sensing.labels import is_labelled, labelled_readings

__all__ = [
    "FRAMES",
    "FRAMES_FOR_NOISE",
    "MOVED",
    "OFFSETS",
    "STANDS",
    "STILL",
    "Levels",
    "Rest",
    "far_frames",
    "given_rest",
    "moved",
    "rest_frames",
    "with_noise",
    "zero_of",
]

#: Fewest frames at rest to estimate the noise: with 5, and some hundred readings that share it, its error is a few per cent.
FRAMES_FOR_NOISE = 5

#: A frame this many times farther from the median frame than half of the frames are is excluded from the zero: a glitch
#: or a touch. (Noise gives up to 1.5 times, for twenty readings; a drift during the capture twice.)
MAX_DEVIATION = 5.0
#: Readings farther from 0 than this many times the range over which any of them moves have offsets: contact changes the
#: readings that it loads.
STANDING = 2.0
#: Fraction of the readings for which this must hold.
MOST = 0.75
#: The note for that case.
OFFSETS = (
    "most readings are far from 0 and hardly vary, as raw counts with offsets do, and these offsets are taken for load: if nothing touches in the "
    "first frames, make them the zero, such as the first ten with --baseline 10 (baseline=10)"
)

#: Readings without contact farther from 0 than this many times their variation between frames are not noise. (If a
#: sensor averages over n frames, they vary by about 1/sqrt(n) of the noise: this allows a hundred.)
STILL = 10.0
#: Fewest frames to estimate the variation.
FRAMES = 8
#: The note for that case.
STANDS = (
    "readings without contact are far from 0 and hardly vary from frame to frame, as raw counts with offsets do: contact may be missed, or its force wrong. If nothing "
    "touches in the first frames, make them the zero, such as the first ten with --baseline 10 (baseline=10); or take a new zero while nothing touches (Z on "
    "the page, Tracker.rezero)"
)
#: Smallest number of frames for a test of whether they move.
FRAMES_THAT_MOVE = 5
#: They move if the mean of the later half of one reading differs from that of the earlier half by this many standard
#: deviations, ...
ONE_MOVED = 7.0
#: ... or those of all readings of a channel together, as a root mean square, ...
MANY_MOVED = 4.0
#: ... with this significance, ...
SURE = 4.0
#: ... and by more than this many of the smallest steps seen, because counts toggle by one.
COUNTS = 2.0
#: The note for that case.
MOVED = (
    "the readings moved while the zero was taken, by more than their noise: something touched, or they drift, and every later force has this error. Use fewer frames "
    "(baseline=, --baseline), or take a new zero while nothing touches (Z on the page, Tracker.rezero)"
)


def moved(frames: Floats, index: Any) -> bool:
    """Whether ``frames`` (frame, reading) of a zero drift or begin to be touched; ``index`` (reading,) is the channel
    of each reading.

    The mean of the later half is compared with that of the earlier half, in units of the noise estimated from
    neighbouring frames: a trend is visible in the first but not in the second. False for fewer than five frames.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.zero import moved
    >>> rest = 500.0 + np.random.default_rng(0).standard_normal((12, 48))
    >>> finger = np.maximum(np.arange(12.0) - 5.0, 0.0)[:, None] * np.where(np.arange(48) < 6, 1.0, 0.0)
    >>> moved(rest, np.zeros(48)), moved(rest + finger, np.zeros(48))
    (False, True)
    """
    frames, index = np.asarray(frames, dtype=np.float64), np.asarray(index)
    kept = frames[~far_frames(frames)]
    if len(kept) < FRAMES_THAT_MOVE:
        return False
    known = np.isfinite(kept).all(axis=0)
    kept, index = kept[:, known], index[known]
    half = len(kept) // 2
    steps = np.diff(kept, axis=0)
    shift = np.abs(kept[-half:].mean(axis=0) - kept[:half].mean(axis=0))
    of_one = (steps**2).mean(axis=0) / 2.0
    for channel in np.unique(index):
        mine = index == channel
        sizes = np.abs(steps[:, mine])
        least = float(sizes.min(initial=math.inf, where=sizes > 0))
        # A reading noisier than its channel uses its own noise; one that is quiet by chance uses the channel's.
        std = np.sqrt(np.maximum(of_one[mine], of_one[mine].mean()) * 2.0 / half)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = np.where(shift[mine] > COUNTS * least, shift[mine] / std, 0.0)
        z = np.nan_to_num(z)
        count = len(z)
        together = max(MANY_MOVED, 1.0 + SURE * math.sqrt(2.0 / count) + SURE**2 / count)
        if z.max() > ONE_MOVED or float((z**2).mean()) > together:
            return True
    return False


def zero_of(frames: Floats) -> Floats:
    """The zero (channel, *array) of ``frames`` (frame, channel, *array) without contact: their mean, without outlying frames.

    NaN for a reading missing in all of them.

    Raises
    ------
    InvalidInput
        No frames.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.zero import zero_of
    >>> zero_of(np.array([[[7.0, 5.0]], [[7.2, 5.2]], [[6.8, 4.8]], [[9.9, 8.8]]])).round(3).tolist()  # the last one is a touch
    [[7.0, 5.0]]
    """
    frames = as_double(frames)
    if not len(frames):
        raise InvalidInput("the zero is the mean of some frames; got none.")
    flat = frames.reshape(len(frames), -1)
    good = np.isfinite(flat) & ~far_frames(flat)[:, None]
    count = good.sum(axis=0)
    mean = np.where(good, flat, 0.0).sum(axis=0) / np.maximum(count, 1)
    return np.where(count > 0, mean, math.nan).reshape(frames.shape[1:])


def far_frames(frames: Floats) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Mask of the frames (frame, reading; NaN if missing) that differ from most others."""
    there = frames[:, np.isfinite(frames).any(axis=0)]
    if len(frames) < 3 or not there.size:
        return np.zeros(len(frames), dtype=bool)
    away = np.nan_to_num(there - np.nanmedian(there, axis=0))
    with np.errstate(over="ignore"):
        sizes = np.sqrt((away**2).mean(axis=1))
    typical = float(np.median(sizes))
    return np.asarray(sizes > MAX_DEVIATION * typical) if typical > 0 else np.zeros(len(frames), dtype=bool)


@dataclass(frozen=True)
class Rest:
    """The zero and the noise from frames at rest.

    Attributes
    ----------
    zero : array (channel, *array)
        Mean of the frames.
    noise : array (channel,) or None
        Standard deviation of a frame minus the zero, for each channel; None if the frames do not show it (fewer than
        five, or all equal in some channel).
    wanders : bool
        Whether the readings drift, or something begins to touch (`moved`).

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.zero import Rest
    >>> frames = 500.0 + np.random.default_rng(0).standard_normal((30, 1, 4, 4))
    >>> rest = Rest.of(frames)
    >>> rest.zero.shape, round(float(rest.noise[0]), 1), rest.wanders
    ((1, 4, 4), 1.0, False)
    """

    zero: Floats
    noise: Floats | None
    wanders: bool

    @classmethod
    def of(cls, frames: Floats) -> Rest:
        """Zero and noise from frames (frame, channel, *array)."""
        frames = np.asarray(frames, dtype=np.float64)
        flat = frames.reshape(*frames.shape[:2], -1)
        kept = flat[~far_frames(flat.reshape(len(flat), -1))]
        zero = zero_of(frames)
        if len(kept) < FRAMES_FOR_NOISE:
            return cls(zero, None, False)
        there = np.isfinite(kept)
        away = np.where(there, kept - zero.reshape(1, *flat.shape[1:]), 0.0)
        # Deviations from the mean, not between frames: a sensor that smooths its readings changes slowly.
        freedom = np.maximum(there.sum(axis=(0, 2)) - there.any(axis=0).sum(axis=1), 1)
        std = np.sqrt(np.nansum(away**2, axis=(0, 2)) / freedom)
        known = bool(np.isfinite(std).all() and (std > 0).all())
        noise = std * math.sqrt(1.0 + 1.0 / len(kept)) if known else None
        index = np.repeat(np.arange(flat.shape[1]), flat.shape[2])
        return cls(zero, noise, moved(flat.reshape(len(flat), -1), index))

    def taken_from(self, planes: Sequence[Array]) -> list[Array]:
        """Arrays for readings minus the zero: noise of frames at rest if none is stated, limits less the zero."""
        ends = np.cumsum([len(p.channels) for p in planes])
        zeros = np.split(self.zero, ends[:-1])
        return [p.rezeroed(zero) for p, zero in zip(self.with_noise(planes), zeros)]

    def with_noise(self, planes: Sequence[Array]) -> list[Array]:
        """The arrays with the noise of the frames at rest if none is stated."""
        if self.noise is None:
            return list(planes)
        return [p if p.noise is not None else q for p, q in zip(planes, with_noise(planes, self.noise))]


def with_noise(planes: Sequence[Array], noise: Any) -> list[Array]:
    """Return the arrays with this noise: one standard deviation for all channels, or one per channel of all planes in order.

    Raises
    ------
    InvalidInput
        Standard deviations that are not positive, or not one per channel.

    Examples
    --------
    >>> import palpate as pp
    >>> from palpate.sensing.zero import with_noise
    >>> planes = [pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_xz", "stress_zz"])]
    >>> with_noise(planes, [3.0, 5.0])[0].noise_std
    (3.0, 5.0)
    """
    stds = check_noise(noise, [c for p in planes for c in p.channels]) or ()
    ends = np.cumsum([len(p.channels) for p in planes])
    return [replace(p, noise=stds[end - len(p.channels) : end]) for p, end in zip(planes, ends)]


def rest_frames(rest: Any, planes: Sequence[Array]) -> Floats:
    """Frames (frame, channel, *array) at rest of these arrays, checked.

    Raises
    ------
    InvalidInput
        No frames, or frames of another shape.
    Unsupported
        Arrays of different shapes.
    """
    shapes = {p.shape for p in planes}
    if len(shapes) > 1:
        raise Unsupported(
            "planes of different shapes have no common frames: take the zero from the readings yourself, and give noise= to each array."
        )
    if is_labelled(rest):
        rest = labelled_readings(rest, planes)
    plain = rest if isinstance(rest, list | tuple | np.ndarray) else to_numpy(rest)
    try:
        frames = as_double(plain if np.asarray(plain).dtype.kind in "iuf" else None)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"zero must hold numbers, frames at rest (frame, channel, *array); got {type(rest).__name__}."
        ) from error
    expected = (sum(len(p.channels) for p in planes), *shapes.pop())
    if frames.shape == expected:
        frames = frames[None]
    if frames.shape[1:] != expected or not len(frames):
        raise InvalidInput(
            f"zero must hold frames at rest of shape (frame, {', '.join(map(str, expected))}); got {frames.shape}."
        )
    start = 0
    for plane in planes:
        stop = start + len(plane.channels)
        if plane.mask is not None:  # missing taxels may hold anything
            frames[:, start:stop, ~plane.valid] = math.nan
        start = stop
    return frames


def given_rest(zero: Any, baseline: int, planes: Sequence[Array]) -> Rest | None:
    """Return zero and noise of the given frames at rest, or None if the first ``baseline`` frames of a stream become the zero.

    Raises
    ------
    InvalidInput
        Frames of another shape, or both ``zero`` and ``baseline``.
    """
    if isinstance(baseline, bool) or not isinstance(baseline, int | np.integer) or baseline < 0:
        got = repr(baseline) if np.ndim(baseline) == 0 else f"an array of shape {np.shape(baseline)}"
        raise InvalidInput(f"baseline must be a number of frames >= 0; got {got}. Readings at rest go into zero=.")
    if zero is None:
        return None
    if baseline:
        raise InvalidInput(f"zero= and baseline={baseline!r} both state the zero: leave one out.")
    return Rest.of(rest_frames(zero, planes))


class Levels:
    """Range over which each reading of a recording moves, collected while its frames are read.

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.sensing.zero import Levels
    >>> press = np.linspace(0.0, 100.0, 10)[:, None, None] * np.array([[1.0, 0.3]])
    >>> levels = Levels()
    >>> levels.look(press + 5000.0)
    >>> levels.standing()
    True
    """

    def __init__(self) -> None:
        self._low: Floats | None = None
        self._high: Floats | None = None
        self._frames = 0
        self._last: Floats | None = None
        self._sizes: list[
            Floats
        ] = []  # of each frame (channel,): mean square of its readings, and half that of the step from the frame before
        self._steps: list[Floats] = []

    def look(self, frames: Floats) -> None:
        """Add frames (frame, channel, *array)."""
        low, high = np.fmin.reduce(frames, axis=0), np.fmax.reduce(frames, axis=0)
        self._low = low if self._low is None else np.fmin(self._low, low)
        self._high = high if self._high is None else np.fmax(self._high, high)
        self._frames += len(frames)
        flat = np.asarray(frames, dtype=np.float64).reshape(*np.shape(frames)[:2], -1)
        before = np.full_like(flat[:1], math.nan) if self._last is None else self._last
        self._last = flat[-1:]
        self._sizes.append(_mean_square(flat))
        self._steps.append(0.5 * _mean_square(np.diff(flat, axis=0, prepend=before)))

    def standing(self) -> bool:
        """Whether most readings are far from 0 and move little, as raw counts with offsets do.

        False for fewer than three frames.
        """
        if self._low is None or self._high is None or self._frames < 3:
            return False
        moved = self._high - self._low
        nearest = np.where(self._low * self._high > 0, np.minimum(abs(self._low), abs(self._high)), 0.0)
        known = np.isfinite(moved)
        largest = float(moved[known].max(initial=0.0))
        return bool(known.any() and largest > 0 and (nearest[known] > STANDING * largest).mean() > MOST)

    def still(self, nothing: np.ndarray[Any, np.dtype[np.bool_]]) -> bool:
        """Whether some channel's frames (frame,) without contact are far from 0 and vary little between frames."""
        if not self._sizes:
            return False
        sizes, steps = np.concatenate(self._sizes), np.concatenate(self._steps)
        follows = nothing & np.r_[False, nothing[:-1]]
        known = follows & np.isfinite(steps).all(axis=1)
        if known.sum() < FRAMES:
            return False
        return bool((np.median(sizes[known], axis=0) > STILL**2 * np.median(steps[known], axis=0)).any())


def _mean_square(values: Floats) -> Floats:
    """Mean square over the last axis, without missing values; NaN if all are missing."""
    there = np.isfinite(values)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return np.asarray((np.where(there, values, 0.0) ** 2).sum(axis=-1) / there.sum(axis=-1))
