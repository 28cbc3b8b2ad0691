"""Check readings and bring them into order, for skins and trackers.

Input: an array of any kind, a list with one array for each plane, or a labelled array. Output: one real floating array
(*batch, channel, *array) for each plane, in SI units and in the order of the arrays' own channels and taxels;
otherwise an error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from palpate._arrays import as_real, from_numpy, namespace, to_numpy
from palpate._memory import SHARE, SMALL, available, require
from palpate._numbers import plain_number
from palpate.elastic.channels import channel_unit, find_channel
from palpate.elastic.pad import Floats, Pad, isotropic_constants
from palpate.elastic.viscoelastic import CreepFilter
from palpate.errors import InvalidInput
from palpate.sensing.arrays import Array, ScatteredArray
from palpate.sensing.grids import Grid
from palpate.sensing.labels import is_labelled, labelled_readings, labelled_time, labelled_traction
from palpate.sensing.limits import cut
from palpate.sensing.times import as_seconds

__all__ = [
    "Creep",
    "Layout",
    "as_sensed",
    "check_finite",
    "check_size",
    "checked_planes",
    "checked_traction",
    "creeping",
    "frame_times",
    "joined_planes",
    "plausible",
    "with_creep",
]


#: Smallest number of copies of a batch's readings and of its traction that any method needs. The largest factor
#: measured (Tikhonov's method for 32 x 32 x 3, dense) is 4.8; recommended batches are smaller by MOST.
FRAME_READINGS, FRAME_CELLS, MOST = 3, 1, 5.0


#: Noise below this fraction of the readings is less than their rounding error.
ROUNDING = 1e-14


# -- properties of channels, one function each
# --------------------------------------------------------------------------


def creeping(array: Array) -> npt.NDArray[np.bool_]:
    """(channel,): True where a channel creeps with the pad (strain and displacement do, stress does not)."""
    return np.array([find_channel(c).kind.creeps for c in array.channels])


def plausible(pad: Pad, array: Array) -> list[tuple[float, str]]:
    """The largest possible reading of each channel in an elastic pad, with the reason."""
    modulus, _ = isotropic_constants(pad, array.depth)
    axes = array.points.T if isinstance(array, ScatteredArray) else array.grid.axes
    extent = max(float(np.ptp(x)) for x in axes)
    return [find_channel(c).kind.limit(modulus, extent) for c in array.channels]


# -- layout ----------------------------------------------------------------------------------------------------------------


def joined_planes(parts: Sequence[Any], planes: Sequence[Array]) -> Any:
    """Planes of one shape joined along the channel axis; planes of different shapes as a list."""
    if len(parts) == 1:
        return parts[0]
    if len({p.shape for p in planes}) == 1:
        return namespace(parts[0]).concat(list(parts), axis=-1 - len(planes[0].shape))
    return list(parts)


def as_sensed(parts: Sequence[Any], planes: Sequence[Array], rng: np.random.Generator | None) -> Any:
    """Exact readings of each plane as its sensor gives them: with noise (``rng``), gaps and limits; joined."""
    out = []
    for array, part in zip(planes, parts):
        if rng is not None:
            noise = array.sample_noise(rng, tuple(part.shape[: -1 - len(array.shape)]))
            part = part + from_numpy(noise, part)
        gaps = None if array.mask is None else np.where(array.valid, 0.0, np.nan)
        out.append(cut(part if gaps is None else part + from_numpy(gaps, part), array))
    return joined_planes(out, planes)


def checked_planes(readings: Any, planes: Sequence[Array], *, single: bool = False) -> list[Any]:
    """One array (*batch, channel, *array) per plane; missing readings are NaN. ``single``: one frame, no batch axes."""
    several = len(planes) > 1 and isinstance(readings, list | tuple) and len(readings) == len(planes)
    if several:
        # One array per plane; the rows of a nested list of numbers have fewer axes.
        ranks = [_rank(r) for r in readings]
        if all(rank >= 1 + len(p.shape) for rank, p in zip(ranks, planes)):
            return [_part(r, p, single) for r, p in zip(readings, planes)]
    if len(planes) == 1:
        return [_part(readings, planes[0], single)]
    if len({p.shape for p in planes}) != 1:
        raise InvalidInput(f"the {len(planes)} planes differ in shape: pass a list with one array per plane.")
    values: Any = labelled_readings(readings, planes) if is_labelled(readings) else as_real(readings, "readings")
    d = len(planes[0].shape)
    counts = [len(p.channels) for p in planes]
    if values.ndim < 1 + d or values.shape[-1 - d] != sum(counts):
        raise InvalidInput(
            f"readings must have shape (*batch, channel, *array) with {sum(counts)} channels over all {len(planes)} planes "
            f"({', '.join(c for p in planes for c in p.channels)}), or be a list with one array per plane; got "
            f"{tuple(values.shape)}."
        )
    out, start = [], 0
    for plane, count in zip(planes, counts):
        rows = slice(start, start + count)
        out.append(_shaped(values[(..., rows, *(slice(None),) * d)], plane, single))
        start += count
    return out


def _rank(x: Any) -> int:
    rank = getattr(x, "ndim", None)
    if rank is not None:
        return int(rank)
    depth = 0
    while isinstance(x, list | tuple) and x:
        x, depth = x[0], depth + 1
    return depth + int(getattr(x, "ndim", 0))


def _part(readings: Any, array: Array, single: bool) -> Any:
    values = labelled_readings(readings, [array]) if is_labelled(readings) else as_real(readings, "readings")
    return _shaped(values, array, single)


def _shaped(values: Any, array: Array, single: bool) -> Any:
    expected = (len(array.channels), *array.shape)
    shape = tuple(values.shape)
    if single and shape != expected:
        raise InvalidInput(
            f"a frame must have shape (channel, *array) = {expected} with channels {', '.join(array.channels)}; got "
            f"{shape}. A Tracker takes one frame at a time."
        )
    if shape[-len(expected) :] != expected:
        raise InvalidInput(
            f"readings must have shape (*batch, channel, *array) = (..., {', '.join(map(str, expected))}) with channels "
            f"{', '.join(array.channels)}; got {shape}."
        )
    if 0 in shape:
        raise InvalidInput(f"readings are empty: shape {shape}.")
    return values


def checked_traction(traction: Any, surface: Grid) -> Any:
    """Checked traction (*batch, component, *surface) [Pa]."""
    values = labelled_traction(traction, surface) if is_labelled(traction) else as_real(traction, "traction")
    expected = (len(surface.components), *surface.shape)
    if values.ndim < len(expected) or tuple(values.shape[-len(expected) :]) != expected:
        raise InvalidInput(
            f"traction must have shape (*batch, component, *surface) = (..., {', '.join(map(str, expected))}) with "
            f"components {', '.join(surface.components)}; got {tuple(values.shape)}."
        )
    xp = namespace(values)
    if not bool(xp.all(xp.isfinite(values))):
        raise InvalidInput(
            "traction contains values that are not finite (a flat punch is infinite at its edge: use sample())."
        )
    return values


# -- checks ----------------------------------------------------------------------------------------------------------------


def check_finite(values: Any, array: Array) -> Any:
    """Readings with 0 at masked taxels; raise an error if others are not finite."""
    xp = namespace(values)
    if array.mask is not None:
        values = xp.where(from_numpy(array.valid, values), values, xp.zeros_like(values))
    bad = ~xp.isfinite(values)
    if bool(xp.any(bad)):
        where = to_numpy(bad)
        taxels = where.reshape(-1, *array.shape).any(axis=0)
        raise InvalidInput(
            f"readings hold {int(where.sum())} values that are missing or not finite, at {int(taxels.sum())} of {taxels.size} "
            f"taxels (first at index {tuple(int(i) for i in np.argwhere(taxels)[0])}). Leave dead taxels out: "
            "array.masked(working), or palpate reconstruct --drop-missing."
        )
    return values


def check_frames(readings: Any, planes: Sequence[Array], surface: Grid, draws: int = 0) -> None:
    """Raise an error for a batch that does not fit into memory with any method, and say how many frames do; before
    anything is copied.

    ``draws`` (draw, component, *surface) per frame are included.
    """
    several = isinstance(readings, list | tuple) and len(planes) > 1 and len(readings) > 0
    first = readings[0] if several else readings
    shape = getattr(first, "shape", None)
    if shape is None or str(getattr(first, "device", "cpu")) != "cpu":
        return
    frames = math.prod(shape) // sum(len(a.channels) * math.prod(a.shape) for a in (planes[:1] if several else planes))
    count = sum(len(a.channels) * math.prod(a.shape) for a in planes)
    cells = len(surface.components) * math.prod(surface.shape)
    each = (4.0 if str(getattr(first, "dtype", "")).endswith("float32") else 8.0) * (
        FRAME_READINGS * count + FRAME_CELLS * cells
    )
    each += 8.0 * draws * cells
    if frames * each < SMALL:
        return  # what is free stands in a dozen files: a third of a fast frame
    free = available()
    fewer = 0 if free is None else int(SHARE * free / (MOST * each))
    fewer -= fewer % 10 ** (len(str(fewer)) - 1)
    remedy = f"Reconstruct {fewer} frames at a time" if fewer > 1 else "Reconstruct one frame at a time"
    require(
        frames * each,
        f"{frames} frames of {count} readings{f' with {draws} draws each' if draws else ''}",
        f"{remedy if frames > 1 else 'Give fewer draws'}, or save them as a recording: palpate reconstruct takes it through in chunks.",
    )


def check_size(values: Any, array: Array, limits: Sequence[tuple[float, str]]) -> None:
    """Refuse readings far outside linear elasticity (wrong units), and noise below the readings' rounding."""
    xp = namespace(values)
    d, noise = len(array.shape), array.noise_std
    for i, (channel, (limit, what)) in enumerate(zip(array.channels, limits)):
        largest = float(xp.max(xp.abs(values[(..., i, *(slice(None),) * d)])))
        if largest > limit:
            raise InvalidInput(
                f"{channel} reaches {plain_number(largest)} {channel_unit(channel)}, more than {what}: no elastic pad does that. Check the "
                f"units: readings are in {channel_unit(channel)}, lengths in m, moduli in Pa."
            )
        if noise is not None and noise[i] < ROUNDING * largest:
            raise InvalidInput(
                f"the noise of {channel}, {noise[i]:g} {channel_unit(channel)}, is {largest / noise[i]:.1g} times less than its readings, which reach "
                f"{largest:g}: their numbers are rounded more. Give noise= in {channel_unit(channel)}, or leave it out."
            )


@dataclass(frozen=True)
class Layout:
    """Checks and orders readings of some planes in a pad. With ``gaps``, readings may be missing (NaN)."""

    planes: tuple[Array, ...]
    pad: Pad
    gaps: bool = False

    def checked(self, readings: Any, surface: Grid | None = None, *, draws: int = 0) -> list[Any]:
        """One array (*batch, channel, *array) per plane, finite (but for ``gaps``) and within the range of an elastic pad.

        A batch whose results on ``surface``, with ``draws`` samples, do not fit into memory raises an error first.
        """
        if surface is not None:
            check_frames(readings, self.planes, surface, draws)
        parts, out = checked_planes(readings, self.planes), []
        for values, array in zip(parts, self.planes):
            finite = np.nan_to_num(values) if self.gaps else check_finite(values, array)
            check_size(finite, array, plausible(self.pad, array))
            out.append(values if self.gaps else finite)
        return out

    def without_zero(self, readings: Any, zero: Floats, time: Any) -> tuple[Any, Any]:
        """Readings minus a zero (channel, *array), for planes of one shape; and the time of their frames [s], from their
        labels if not given.
        """
        values = joined_planes(checked_planes(readings, self.planes), self.planes)
        return values - from_numpy(zero, values), labelled_time(readings) if time is None else time

    def frame(self, reading: Any) -> tuple[list[Floats], Any]:
        """One frame (channel, *array) per plane in double precision, NaN where missing; and an array of the caller's kind."""
        parts = checked_planes(reading, self.planes, single=True)
        return [to_numpy(p).astype(np.float64) for p in parts], parts[0]

    def limits(self) -> Floats:
        """Largest possible reading (reading,), working taxels in the order plane, channel, taxel."""
        return self.over_readings([np.array([limit for limit, _ in plausible(self.pad, a)]) for a in self.planes])

    def creeping(self) -> npt.NDArray[np.bool_]:
        """Mask (reading,) of the readings that creep with the pad."""
        return self.over_readings([creeping(a) for a in self.planes])

    def over_readings(self, per_channel: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """One value per reading from one per channel of each plane."""
        return np.concatenate([np.repeat(v, int(a.valid.sum())) for v, a in zip(per_channel, self.planes)])

    def reading_name(self, row: int) -> str:
        """Channel and taxel of a reading, counted as in `limits`."""
        for i, array in enumerate(self.planes):
            working = np.flatnonzero(array.valid.ravel())
            size = len(working) * len(array.channels)
            if row < size:
                index = np.unravel_index(working[row % len(working)], array.shape)
                plane = f" of plane {i}" if len(self.planes) > 1 else ""
                return f"{array.channels[row // len(working)]} at taxel {tuple(int(k) for k in index)}{plane}"
            row -= size
        raise IndexError(row)


# -- time ------------------------------------------------------------------------------------------------------------------


def frame_times(
    readings: Any, parts: Sequence[Any], planes: Sequence[Array], time: npt.ArrayLike | None
) -> Floats | None:
    """Checked time of each frame [s], as given or from the readings' labels, or None."""
    if time is None:
        time = labelled_time(readings)
        if time is None:
            return None
    found = as_seconds(time)
    d = len(planes[0].shape)
    frames = tuple(parts[0].shape[: -1 - d])
    if len(frames) != 1 or found.shape != frames:
        raise InvalidInput(
            f"time must have one entry for each frame of (frame, channel, *array); got {found.shape} for {frames}."
        )
    if not np.isfinite(found).all() or np.any(np.diff(found) <= 0):
        raise InvalidInput(
            "time must be finite and increase from frame to frame. Where the clock restarted or stamps are wrong, palpate.recordings.read_clock(time).time goes on."
        )
    return found


def with_creep(
    parts: Sequence[Any],
    planes: Sequence[Array],
    prony: Sequence[tuple[float, float]],
    time: Floats | None,
    direction: Literal["add", "remove"],
) -> list[Any]:
    """Add creep to, or remove it from, the strains and displacements of each plane, frame by frame."""
    if time is None:
        raise InvalidInput("the pad creeps (Viscoelastic): give time=..., the time of each frame in seconds.")
    return Creep(planes, prony, direction)(parts, time)


class Creep:
    """Add creep to readings or remove it, one batch of frames after another; the memory is kept between calls."""

    def __init__(
        self, planes: Sequence[Array], prony: Sequence[tuple[float, float]], direction: Literal["add", "remove"]
    ) -> None:
        self._planes, self._direction = tuple(planes), direction
        self._filters = [CreepFilter(prony) for _ in planes]

    def __call__(self, parts: Sequence[Any], time: Floats) -> list[Any]:
        """Readings (frame, channel, *array) per plane at these times [s]."""
        out = []
        for array, part, one in zip(self._planes, parts, self._filters):
            creeps = creeping(array)
            if not creeps.any():
                out.append(part)
                continue
            xp = namespace(part)
            weight = from_numpy(creeps.astype(np.float64).reshape(-1, *(1,) * len(array.shape)), part)
            step = one.add if self._direction == "add" else one.remove
            frames = [step(part[i, ...], float(t)) for i, t in enumerate(time)]
            out.append(weight * xp.stack(frames, axis=0) + (1.0 - weight) * part)
        return out
