"""Ends of the range of a channel: a reading at an end is censored."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, namespace, to_numpy
from palpate.elastic.channels import find_channel
from palpate.elastic.pad import Floats, Pad
from palpate.elastic.viscoelastic import Viscoelastic
from palpate.errors import InvalidInput

__all__ = ["at_ends", "check_creep", "check_limits", "cut", "ends_of", "of_readings", "saturation_notes"]

Flags = npt.NDArray[np.bool_]
#: A reading is saturated within this part of its range from either end: the last count of a converter of 10 bits.
SATURATION_TOLERANCE = 1e-3
#: A reading rests where it is no farther from its zero, as a part of the range.
RESTING = 0.05


class _Ranged(Protocol):
    """A plane of taxels, as the ends of a range need it."""

    @property
    def channels(self) -> Sequence[str]: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def limits(self) -> Any: ...
    @property
    def valid(self) -> npt.NDArray[np.bool_]: ...


def check_limits(limits: Any, channels: Sequence[str], shape: tuple[int, ...]) -> Floats | None:
    """Low and high end (channel, 2) of the range of each channel, or (channel, 2, *shape) of each reading; infinite where there is none."""
    if limits is None:
        return None
    out = _parse_limits(limits, len(channels), shape)
    if out is None or np.isnan(out).any() or not (out[:, 0] < out[:, 1]).all():
        raise InvalidInput(
            "limits must be the largest reading s, for -s to s, or (low, high), or one (low, high) for each channel "
            f"({len(channels)}: {', '.join(channels)}), in the unit of the channel, low below high; got {limits!r}."
        )
    out.setflags(write=False)
    return out


def _parse_limits(limits: Any, channels: int, shape: tuple[int, ...]) -> Floats | None:
    """The ends as a copy, or None if the value has none of the accepted forms."""
    try:
        found = np.array(limits, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    if found.ndim == 0:
        found = np.array([-found, found])
    if found.shape == (2,):
        found = np.tile(found, (channels, 1))
    return found if found.shape in ((channels, 2), (channels, 2, *shape)) else None


def of_readings(array: _Ranged) -> tuple[Floats, Floats] | None:
    """Low and high end (channel, *shape) of every reading."""
    if array.limits is None:
        return None
    found = array.limits.reshape(*array.limits.shape, *(1,) * (2 + len(array.shape) - array.limits.ndim))
    found = np.broadcast_to(found, (len(array.channels), 2, *array.shape))
    return found[:, 0], found[:, 1]


def check_creep(pad: Viscoelastic, planes: Sequence[_Ranged]) -> Pad:
    """The elastic pad of one that creeps.

    Ends of a range are refused if creep is subtracted first: the rest of a saturated reading means nothing.
    """
    for array in planes:
        for i, channel in enumerate(array.channels):
            if array.limits is not None and find_channel(channel).kind.creeps and np.isfinite(array.limits[i]).any():
                raise InvalidInput(
                    f"limits of {channel} cannot be kept where the pad creeps: creep is taken out of its readings before they are solved. "
                    "Give (-inf, inf) for this channel, or leave limits out."
                )
    return pad.elastic


def ends_of(planes: Sequence[_Ranged]) -> tuple[Floats, Floats] | None:
    """The low and the high end of all working readings (plane, channel, taxel); None without limits."""
    if all(a.limits is None for a in planes):
        return None
    low, high = [], []
    for a in planes:
        ends = of_readings(a)
        size = len(a.channels), *a.shape
        low.append((np.full(size, -math.inf) if ends is None else ends[0])[:, a.valid].ravel())
        high.append((np.full(size, math.inf) if ends is None else ends[1])[:, a.valid].ravel())
    return np.concatenate(low), np.concatenate(high)


def at_ends(data: Floats, ends: tuple[Floats, Floats] | None, zeroed: Floats | None = None) -> tuple[Flags, Flags]:
    """Which readings (..., reading) lie at the high end, and which at the low one; missing ones (NaN) at neither.

    An end at which a reading rests, such as the zero of a range, is ignored: ``zeroed`` are the readings minus their zero (default: they have none).
    """
    if ends is None:
        return np.zeros(data.shape, dtype=bool), np.zeros(data.shape, dtype=bool)
    low, high = ends
    with np.errstate(invalid="ignore"):
        size = np.where(np.isinf(low), np.abs(high), np.where(np.isinf(high), np.abs(low), high - low))
        size = np.where(np.isfinite(size), size, 0.0)
        away = np.abs(data if zeroed is None else zeroed) > RESTING * size
        return away & (data >= high - SATURATION_TOLERANCE * size), away & (data <= low + SATURATION_TOLERANCE * size)


def saturation_notes(parts: Sequence[Any], planes: Sequence[_Ranged]) -> tuple[str, ...]:
    """What is said of readings (*batch, channel, *array), one array per plane, at an end of their range, by a method that does not heed it."""
    total = 0
    for part, array in zip(parts, planes):
        if array.limits is not None:
            flat = to_numpy(part)[..., array.valid]
            upper, lower = at_ends(flat.reshape(*flat.shape[:-2], -1), ends_of([array]))
            total += int((upper | lower).sum())
    if not total:
        return ()
    return (
        f"{total} readings at the end of their range: this method takes them as they are, so that the load may be larger; method adaptive counts "
        "them as at least that",
    )


def cut(values: Any, array: _Ranged) -> Any:
    """Readings (*batch, channel, *array) as an array with such ends gives them."""
    ends = of_readings(array)
    if ends is None:
        return values
    xp, (low, high) = namespace(values), (from_numpy(np.array(end), values) for end in ends)
    return xp.where(values < low, low, xp.where(values > high, high, values))
