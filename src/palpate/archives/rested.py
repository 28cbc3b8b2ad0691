"""A recording whose first frames are known to be at rest: they tell the zero, and the noise by which frames without contact are known."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.elastic.pad import Floats
from palpate.sensing.zero import far_frames, moved, zero_of
from palpate.touch import Touch, joined

if TYPE_CHECKING:
    from palpate.skin import Skin

__all__ = ["Rest"]

#: Frames from which the noise is taken with the zero: with 5, and some hundred readings that share it, it is known to a few per cent.
FRAMES_FOR_NOISE = 5
#: A frame is at rest where the mean square of its readings over the noise is above 1 by less than so many standard deviations, ...
LIKELY = 4.0
#: ... and none of them is so many times the noise.
FARTHEST = 5.0


@dataclass(frozen=True)
class Rest:
    """Frames in which nothing touches.

    Attributes
    ----------
    zero : array (channel, *array)
        Their mean.
    noise : array (channel,) or None
        Standard deviation of one frame less the zero, of each channel; None where they do not tell it.
    wanders : bool
        Whether they drift, or something begins to touch (`palpate.sensing.zero.moved`).

    Examples
    --------
    >>> import numpy as np
    >>> from palpate.archives.rested import Rest
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
        """From frames (frame, channel, *array)."""
        frames = np.asarray(frames, dtype=np.float64)
        flat = frames.reshape(*frames.shape[:2], -1)
        kept = flat[~far_frames(flat.reshape(len(flat), -1))]
        zero = zero_of(frames)
        if len(kept) < FRAMES_FOR_NOISE:
            return cls(zero, None, False)
        steps = np.sqrt(np.nanmean(np.diff(kept, axis=0) ** 2, axis=(0, 2)) / 2.0)
        known = bool(np.isfinite(steps).all() and (steps > 0).all())
        noise = steps * np.sqrt(1.0 + 1.0 / len(kept)) if known else None
        index = np.repeat(np.arange(flat.shape[1]), flat.shape[2])
        return cls(zero, noise, moved(flat.reshape(len(flat), -1), index))

    def quiet(self, readings: Floats) -> Any:
        """Which frames, less the zero, are at rest: nothing but noise."""
        if self.noise is None:
            return np.zeros(len(readings), dtype=bool)
        sizes = np.abs(readings.reshape(*readings.shape[:2], -1)) / self.noise[:, None]
        sizes = sizes.reshape(len(sizes), -1)
        limit = 1.0 + LIKELY * np.sqrt(2.0 / sizes.shape[1])
        return (np.mean(sizes**2, axis=1) < limit) & (sizes.max(axis=1) < FARTHEST)

    def zeroed(self, skin: Skin) -> Skin:
        """The skin for readings less the zero: the ends of their range are as much lower."""
        if all(p.limits is None for p in skin.planes):
            return skin
        at, planes = 0, []
        for plane in skin.planes:
            planes.append(plane.rezeroed(self.zero[at : at + len(plane.channels)]))
            at += len(plane.channels)
        return skin._with(skin.pad, planes)

    def at_rest(self, skin: Skin) -> AtRest | None:
        """The skin with this noise beside itself; None where its noise is given, or not known from these frames."""
        if self.noise is None or any(p.noise is not None for p in skin.planes):
            return None
        planes, at = [], 0
        for plane in skin.planes:
            count = len(plane.channels)
            planes.append(dataclasses.replace(plane, noise=[float(n) for n in self.noise[at : at + count]]))
            at += count
        return AtRest(skin, skin._with(skin.pad, planes), self)


@dataclass(frozen=True)
class AtRest:
    """A skin for frames with contact, whose noise is learned from each, and the same with the noise at rest for frames of nothing but that.

    Noise that is learned from a frame without contact may leave room for a faint contact beyond the array; and it takes seconds.
    """

    skin: Skin
    resting: Skin
    rest: Rest

    def reconstruct(self, readings: Floats, *, time: Floats, **options: Any) -> Touch:
        """As `Skin.reconstruct`, of frames less their zero."""
        quiet = self.rest.quiet(np.asarray(readings, dtype=np.float64))
        parts, order = [], []
        for skin, which in ((self.resting, np.flatnonzero(quiet)), (self.skin, np.flatnonzero(~quiet))):
            if len(which):
                parts.append(skin.reconstruct(readings[which], time=time[which], **options))
                order.append(which)
        if len(parts) == 1:
            return parts[0]
        return joined(parts)[np.argsort(np.concatenate(order))]
