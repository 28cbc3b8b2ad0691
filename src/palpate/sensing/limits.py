"""Measuring limits of a channel: a reading at a limit is censored."""

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
#: A reading is saturated if it is within this fraction of the range from either limit: the last count of a 10-bit
#: converter.
SATURATION_TOLERANCE = 1e-3
#: A reading counts as at rest if it is within this fraction of the range from its zero.
RESTING = 0.05


class _Ranged(Protocol):
    """The part of an array that measuring limits need."""

    @property
    def channels(self) -> Sequence[str]: ...
    @property
    def shape(self) -> tuple[int, ...]: ...
    @property
    def limits(self) -> Any: ...
    @property
    def valid(self) -> npt.NDArray[np.bool_]: ...


def check_limits(limits: Any, channels: Sequence[str], shape: tuple[int, ...]) -> Floats | None:
    """Lower and upper limit of each channel (channel, 2) or reading (channel, 2, *shape); infinite if none."""
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
    """The limits as a copy, or None if the value has none of the accepted forms."""
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
    """Lower and upper limit of every reading (channel, *shape)."""
    if array.limits is None:
        return None
    found = array.limits.reshape(*array.limits.shape, *(1,) * (2 + len(array.shape) - array.limits.ndim))
    found = np.broadcast_to(found, (len(array.channels), 2, *array.shape))
    return found[:, 0], found[:, 1]


def check_creep(pad: Viscoelastic, planes: Sequence[_Ranged]) -> Pad:
    """Return the elastic part of a pad that creeps. Raise `InvalidInput` if one of ``planes`` has finite limits for a
    channel whose readings creep.

    Creep is subtracted from the readings before they are solved. After that, a saturated reading no longer equals its
    limit, and nothing is known about its true value.
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
    """Lower and upper limits of all working readings (plane, channel, taxel); None without limits."""
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
    """Masks of readings (..., reading) at the upper and at the lower limit; missing ones (NaN) are at neither.

    A limit at which a reading rests, such as the zero of a range, is ignored. ``zeroed`` are the readings minus their
    zero (default: no zero was subtracted).
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
    """Notes on saturated readings (*batch, channel, *array), one array per plane, for methods that ignore saturation."""
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
    """Clip readings (*batch, channel, *array) at the limits of an array."""
    ends = of_readings(array)
    if ends is None:
        return values
    xp, (low, high) = namespace(values), (from_numpy(np.array(end), values) for end in ends)
    return xp.where(values < low, low, xp.where(values > high, high, values))
