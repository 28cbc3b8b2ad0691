"""One recording: frames of readings with their time, channels, positions and units."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import as_double, as_real
from palpate._numbers import plain_time
from palpate.elastic.channels import channel_unit, find_channel
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.recordings.meta import plain_meta
from palpate.sensing.labels import is_labelled
from palpate.sensing.times import as_seconds

__all__ = ["Recording", "checked_time"]


def checked_time(time: Any, count: int) -> Floats:
    """Times of ``count`` frames [s], finite and increasing; None: frame numbers."""
    found = np.arange(count, dtype=np.float64) if time is None else as_seconds(time)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise InvalidInput(f"time must be {count} finite seconds; got shape {found.shape}.")
    if np.any(np.diff(found) <= 0):
        first = int(np.argmax(np.diff(found) <= 0)) + 1
        raise InvalidInput(
            f"time must increase; frame {first} is at {plain_time(found[first])} s after {plain_time(found[first - 1])} s. "
            "Where the clock restarted or stamps are wrong, palpate.recordings.read_clock(time).time goes on."
        )
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording:
    """Frames of readings, in SI units.

    Parameters
    ----------
    readings : array (time, channel, *array)
        One or two array axes: (taxel,) or (y, x). NaN marks a reading that is missing.
    channels : sequence of str
        Names from `palpate.AREA_CHANNELS`.
    time : array (time,), optional
        Seconds, increasing, or dates and differences of times (``datetime64``, ``timedelta64``, those of pandas); default: frame numbers.
    positions : array (taxel, 2) or (taxel,), optional
        Positions (x, y) [m] of scattered taxels; only with one array axis.
    meta : mapping
        Anything worth keeping, by names: text, numbers, truth values, None, and lists and mappings of them. Every format keeps their types.

    Raises
    ------
    InvalidInput
        Labelled readings, a shape that does not fit channels, times or positions, infinite values, times that do not increase.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> readings = np.ones((2, 1, 3))  # 2 frames, 1 channel, 3 taxels
    >>> readings[1, 0, 2] = np.nan
    >>> recording = pp.Recording(readings=readings, channels=["stress_zz"], time=[0.0, 0.01])
    >>> recording.units, recording.missing.tolist()
    (('Pa',), [False, False, True])

    >>> beads = [(x * 1e-3, y * 1e-3) for y in range(3) for x in range(4)]  # (x, y)
    >>> u = np.array([[[x for x, _ in beads]]]) * 0.01  # stretched by 1 % along x
    >>> scattered = pp.Recording(readings=u, channels=["displacement_x"], positions=beads)
    >>> scattered.gridded(1e-3).readings.shape  # (frame, channel, y, x)
    (1, 1, 2, 3)
    """

    readings: Any
    channels: tuple[str, ...]
    time: Any = None
    positions: Any = None
    meta: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if is_labelled(self.readings):
            raise InvalidInput(
                f"a Recording takes its readings without labels; got dimensions ({', '.join(map(str, self.readings.dims))}). Put them "
                'in order and take the values: x.transpose("time", "channel", "y", "x").values (scattered: "taxel"), with SI units.'
            )
        readings = self.readings
        known = isinstance(readings, np.ndarray | list | tuple)
        readings = as_real(readings if known else np.asarray(readings), "readings")
        if readings.ndim not in (3, 4):
            raise InvalidInput(
                f"readings must have axes (time, channel, taxel) or (time, channel, y, x); got shape {readings.shape}."
            )
        if 0 in readings.shape:
            raise InvalidInput(f"the recording is empty: readings have shape {readings.shape}.")
        channels = tuple(self.channels)
        for channel in channels:
            find_channel(channel)
        if len(channels) != readings.shape[1]:
            raise InvalidInput(f"{len(channels)} channels are named but readings have {readings.shape[1]}: {channels}.")
        if np.isinf(readings).any():
            raise InvalidInput("readings hold infinite values; mark missing readings as NaN.")
        time = checked_time(self.time, len(readings))
        positions = self.positions
        if positions is not None:
            positions = as_double(positions)
            if readings.ndim != 3 or positions.shape not in ((readings.shape[2],), (readings.shape[2], 2)):
                raise InvalidInput(
                    f"positions must have shape ({readings.shape[2]}, 2) or ({readings.shape[2]},), one per taxel; got "
                    f"{positions.shape} for readings {readings.shape}."
                )
            if not np.isfinite(positions).all():
                raise InvalidInput("positions hold values that are not finite.")
        object.__setattr__(self, "readings", readings)
        object.__setattr__(self, "channels", channels)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "meta", plain_meta(self.meta))

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each channel."""
        return tuple(channel_unit(c) for c in self.channels)

    @property
    def missing(self) -> npt.NDArray[np.bool_]:
        """True (*array) where a taxel has a missing reading in any frame or channel."""
        return np.asarray(np.isnan(self.readings).any(axis=(0, 1)))

    def gridded(self, pitch: float) -> Recording:
        """Scattered readings interpolated (cubic, Clough-Tocher) to a regular grid of ``pitch`` [m].

        The grid is made of the square cells that fit the bounding box of the taxels with readings, from its lower left corner, with a
        point in the middle of each; outside the convex hull of the positions it takes the nearest taxel. A missing reading is interpolated from the
        others of its frame and channel; without at least three that span an area, all points of the frame are missing. ``meta`` of the new
        recording states the position of its first point ("x0", "y0", "pitch", in metres).

        Raises
        ------
        InvalidInput
            Positions that are not scattered on an area, taxels with readings that do not span one, or a pitch that is not positive, wider than the positions, or so fine that it makes millions of points.

        Examples
        --------
        >>> import palpate as pp
        >>> beads = [(x * 1e-3, y * 1e-3) for y in range(3) for x in range(4)]  # (x, y)
        >>> scattered = pp.Recording(readings=[[[0.0] * 12]], channels=["displacement_x"], positions=beads)
        >>> scattered.gridded(1e-3).readings.shape  # (frame, channel, y, x)
        (1, 1, 2, 3)
        """
        from scipy.interpolate import CloughTocher2DInterpolator, NearestNDInterpolator

        if self.positions is None or self.positions.ndim != 2:
            raise InvalidInput("gridded needs a recording with scattered positions (taxel, 2).")
        if not (np.isfinite(pitch) and pitch > 0):
            raise InvalidInput(f"pitch must be a positive number of metres; got {pitch!r}.")
        works = ~np.isnan(self.readings).all(axis=(0, 1))
        points = self.positions[works]
        if not _spans_an_area(points):
            raise InvalidInput(
                f"gridded needs readings at positions that span an area; the {len(points)} taxels with readings do not."
            )
        low, high = points.min(axis=0), points.max(axis=0)
        origin, scale = points.mean(axis=0), float(np.ptp(points))
        fitting = np.floor((high - low) / pitch + 1e-9).astype(int)
        if fitting.min() < 1:
            width, height = high - low
            raise InvalidInput(
                f"no cell of a pitch of {pitch:g} m fits the positions, which cover {width:g} x {height:g} m; take a finer one."
            )
        counts = np.maximum(2, fitting)
        if counts.prod() > 4_000_000:
            raise InvalidInput(
                f"a pitch of {pitch:g} m makes a grid of {counts[1]} x {counts[0]} points; take a wider one."
            )
        x, y = (c + (np.arange(n) + 0.5) * pitch for c, n in zip(low, counts))
        xx, yy = np.meshgrid(x, y)
        at = np.stack([xx, yy], axis=-1)
        rows = self.readings[..., works].reshape(-1, len(points)).astype(np.float64)
        filled = np.full((len(rows), *xx.shape), np.nan)
        patterns, which = np.unique(np.isfinite(rows), axis=0, return_inverse=True)
        for i, good in enumerate(patterns):
            if not _spans_an_area(points[good]):
                continue
            same = np.ravel(which) == i
            values = rows[same][:, good].T
            smooth = CloughTocher2DInterpolator((points[good] - origin) / scale, values)((at - origin) / scale)
            nearest = NearestNDInterpolator(points[good], values)(at)
            filled[same] = np.moveaxis(np.where(np.isnan(smooth), nearest, smooth), -1, 0)
        readings = filled.reshape(*self.readings.shape[:2], *xx.shape)
        meta = {**self.meta, "pitch": repr(float(pitch)), "x0": repr(float(x[0])), "y0": repr(float(y[0]))}
        return replace(self, readings=readings, positions=None, meta=meta)


def _spans_an_area(points: Floats) -> bool:
    """Whether points (n, 2) do not all lie on one line."""
    if len(points) < 3:
        return False
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(sizes[1] > 1e-9 * sizes[0])
