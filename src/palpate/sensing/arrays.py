"""Arrays of sensing elements (taxels, markers, beads): channels, positions, noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from palpate._arrays import as_double
from palpate._threads import cached_property
from palpate.elastic.channels import check_channels
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput
from palpate.sensing.grids import AreaGrid, LineGrid, check_center, check_count, check_length, pair
from palpate.sensing.limits import check_limits, of_readings

__all__ = ["AreaArray", "Array", "LineArray", "ScatteredArray"]

#: A taxel this many times further from its neighbours than usual is a mistake in the positions: at 20 the cells of the surface are still fine enough.
MAX_SPACING_RATIO = 20.0
Mask = npt.NDArray[np.bool_]
#: Smallest noise in any unit; its inverse is the largest. Squares of more extreme numbers overflow.
SMALLEST = 1e-60
#: Largest correlation length and aperture relative to the array's extent. Noise with a longer correlation is an offset:
#: on 6 x 6 x 3 the force is right up to 2000 times, and nonsense at 2e5 times. A taxel with a wider aperture cannot
#: locate contacts.
LONGEST_CORRELATION, WIDEST_APERTURE = 1e3, 4.0
Noise = float | Sequence[float] | None


def check_noise(noise: Noise, channels: Sequence[str]) -> tuple[float, ...] | None:
    """Return the standard deviation of each channel, or None if none is given; `InvalidInput` if the noise is not valid."""
    if noise is None:
        return None
    try:
        stds = np.asarray(noise)
    except ValueError:  # lists of different lengths
        stds = np.asarray(None)
    truths = isinstance(noise, list | tuple) and any(isinstance(v, bool | np.bool_) for v in noise)
    if stds.dtype.kind not in "iuf" or truths or np.ma.is_masked(noise):
        raise InvalidInput(
            f"noise must be a number in the unit of the channel, or one for each channel; got {noise!r}."
        )
    values = tuple(map(float, np.full(len(channels), stds) if stds.ndim == 0 else stds.ravel()))
    if stds.ndim > 1 or len(values) != len(channels):
        raise InvalidInput(
            f"noise must be one standard deviation or one per channel ({len(channels)}: {', '.join(channels)}); "
            f"got {len(values)}."
        )
    if not all(SMALLEST < v < 1.0 / SMALLEST for v in values):
        raise InvalidInput(
            f"noise must be a positive standard deviation in the unit of the channel; got {noise!r}. "
            "Leave it out where it is not known."
        )
    return values


def _check_depth(depth: object) -> None:
    if depth != "base":
        check_length("depth", depth, zero=True)


def _check_extent(array: _Common) -> None:
    """Raise an error for lengths out of proportion to the array: usually a wrong unit, and minutes of work."""
    extent, aperture = float(np.ptp(array.points, axis=0).max()), max(array.apertures)
    if array.noise_correlation > LONGEST_CORRELATION * extent:
        raise InvalidInput(
            f"noise_correlation = {array.noise_correlation:g} m is {array.noise_correlation / extent:.3g} times the array's extent of {extent:.3g} m: such noise "
            "is an offset of all readings, which skins allow for by themselves. Leave noise_correlation out, or give it in metres."
        )
    if aperture > WIDEST_APERTURE * extent:
        raise InvalidInput(
            f"aperture = {aperture:g} m is {aperture / extent:.3g} times the array's extent of {extent:.3g} m (at most {WIDEST_APERTURE:g} times): "
            "it is the width over which one taxel averages, in metres."
        )


def _check_mask(mask: Any, shape: tuple[int, ...]) -> Mask | None:
    if mask is None:
        return None
    working = np.array(mask)
    if working.dtype != np.bool_ or working.shape != shape:
        raise InvalidInput(
            f"mask must be a boolean array of shape {shape}, True where a taxel works; got {working.dtype} {working.shape}."
        )
    if not working.any():
        raise InvalidInput("mask leaves no working taxel.")
    working.setflags(write=False)
    return working


def _check_distinct(positions: Floats) -> None:
    """Raise an error if a few positions are far from all others: the surface would extend to them, with cells as
    coarse.

    The test uses the distance to the third neighbour (second for few positions), so that it finds up to three mistaken
    positions.
    """
    from scipy.spatial import cKDTree

    neighbour = min(3, len(positions) // 4)
    if neighbour < 2:
        return
    distances = cKDTree(positions).query(positions, k=neighbour + 1)[0][:, -1]
    usual = float(np.median(distances))
    worst = int(np.argmax(distances))
    if distances[worst] > MAX_SPACING_RATIO * usual:
        place = ", ".join(f"{v:g}" for v in positions[worst])
        raise InvalidInput(
            f"positions: taxel {worst} at ({place}) m lies {distances[worst]:.3g} m from the others, which lie {usual:.3g} m apart. Correct its position (its unit?), or take it out of positions "
            "and readings."
        )


class _Common:
    """Common part of all arrays; the concrete classes add the positions of the taxels."""

    channels: Sequence[str]
    depth: Any  # metres, or "base" until the array is put into a skin
    noise: Noise
    noise_correlation: float
    limits: Any  # (channel, 2) or (channel, 2, *shape): low and high end, or None
    mask: Any
    aperture: Any
    if TYPE_CHECKING:

        @property
        def points(self) -> Floats:
            """Positions (taxel, axis) [m]."""
            ...

        @property
        def shape(self) -> tuple[int, ...]:
            """Shape of one channel of readings."""
            ...

        @property
        def apertures(self) -> tuple[float, ...]:
            """Aperture of each axis [m]."""
            ...

    @property
    def noise_std(self) -> tuple[float, ...] | None:
        """Standard deviation of the noise of each channel, or None if not given."""
        return check_noise(self.noise, tuple(self.channels))

    def sample_noise(self, rng: np.random.Generator, batch: tuple[int, ...] = ()) -> Floats:
        """Random noise (*batch, channel, *shape) with the array's standard deviation and correlation."""
        if self.noise_std is None:
            raise InvalidInput("rng was given but the array has no noise; give the array noise=....")
        out = rng.standard_normal((*batch, len(self.channels), int(np.prod(self.shape))))
        if self.noise_correlation:
            distance = np.abs(self.points[:, None, :] - self.points[None, :, :]).sum(axis=-1)
            out = out @ np.linalg.cholesky(np.exp(-distance / self.noise_correlation)).T
        return (out * np.asarray(self.noise_std)[:, None]).reshape(*batch, len(self.channels), *self.shape)

    @property
    def valid(self) -> Mask:
        """True for working taxels."""
        return np.ones(self.shape, dtype=np.bool_) if self.mask is None else np.asarray(self.mask)

    def at_base(self: Self, thickness: float | None) -> Self:
        """The same array with depth "base" replaced by the pad's ``thickness`` [m] (None: the pad has no base)."""
        if self.depth != "base":
            return self
        if thickness is None:
            raise InvalidInput('depth = "base" needs a pad with a base, such as BondedLayers; a HalfSpace has none.')
        return replace(self, depth=thickness)  # type: ignore[type-var]

    def rezeroed(self: Self, zero: Any) -> Self:
        """The same array for readings minus a zero (channel, *shape): its limits shift by the zero.

        Examples
        --------
        >>> import palpate as pp
        >>> how = {"pitch": 1e-3, "depth": 1e-3, "channels": ["stress_zz"], "limits": (0.0, 3e4)}  # [Pa]
        >>> pp.LineArray(count=2, **how).rezeroed([[500.0, 0.0]]).limits.tolist()  # low and high end of each reading
        [[[-500.0, 0.0], [29500.0, 30000.0]]]
        """
        ends = of_readings(self)
        if ends is None:
            return self
        return replace(self, limits=np.stack(ends, axis=1) - np.nan_to_num(np.asarray(zero))[:, None])  # type: ignore[type-var]

    def rescaled(self: Self, factors: Any) -> Self:
        """The same array for readings times ``factors`` (channel, *shape), NaN where a taxel is missing: with them its
        limits, and the noise of each channel with their root mean square.

        Examples
        --------
        >>> import palpate as pp
        >>> how = {"pitch": 1e-3, "depth": 1e-3, "channels": ["stress_zz"], "limits": (0.0, 4095.0), "noise": 2.0}  # [counts]
        >>> pascals = pp.LineArray(count=2, **how).rescaled([[10.0, 20.0]])
        >>> pascals.limits[0, 1].tolist(), round(pascals.noise[0], 1)  # [Pa]
        ([40950.0, 81900.0], 31.6)
        """
        factors, noise, ends = np.asarray(factors, dtype=np.float64), self.noise_std, of_readings(self)
        if noise is not None:
            size = np.sqrt((factors[:, self.valid] ** 2).mean(axis=1))
            noise = tuple(float(std) for std in size * noise)
        limits = (
            None if ends is None else np.sort(np.stack(ends, axis=1) * np.nan_to_num(factors, nan=1.0)[:, None], axis=1)
        )
        return replace(self, noise=noise, limits=limits)  # type: ignore[type-var]

    def masked(self: Self, mask: Any) -> Self:
        """The same array with only the taxels where ``mask`` is True."""
        both = np.asarray(mask) & self.valid if np.shape(mask) == self.shape else mask
        return replace(self, mask=both)  # type: ignore[type-var]


Self = TypeVar("Self", bound=_Common)


@dataclass(frozen=True, kw_only=True, eq=False)
class LineArray(_Common):
    """A line of taxels at one depth (line contact, plane strain).

    Parameters
    ----------
    count : int
        Number of taxels.
    pitch : float
        Distance between them [m].
    depth : float or "base"
        Depth below the surface [m]; 0 is the surface itself, "base" the base of a pad of `BondedLayers`.
    channels : sequence of str
        What each taxel measures, from `palpate.elastic.LINE_CHANNELS`.
    aperture : float
        Width over which a taxel averages [m]; 0 samples a point.
    noise : float or sequence of float, optional
        Standard deviation of the noise in the unit of the channel, one for all channels or one each.
    noise_correlation : float
        Correlation length l [m] of the noise of neighbouring taxels, as for overlapping image windows: its correlation is
        exp(-(|dx| + |dy|)/l). 0 (default): independent.
    limits : float, (low, high), or one (low, high) per channel, optional
        Ends of the range of a reading, in the unit of the channel, as the readings are given; one number s means -s to s. A reading at an end
        (within a thousandth of the range) is censored: the true one is at least, or at most, that. An end at which readings rest, as 0 of a range
        that begins there, is ignored (within 5 % of the range). Without limits, saturation is found only if several neighbours read the same largest
        value.
    center : float
        Position of the middle of the array [m].
    mask : boolean array (count,), optional
        True where a taxel works.

    Raises
    ------
    InvalidInput
        An impossible count, length, noise, mask or channel; the message says what is accepted.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> array = pp.LineArray(count=3, pitch=1e-3, depth="base", channels=["stress_xz", "stress_zz"], noise=50.0)
    >>> array.dimensions, array.shape, array.noise_std, array.apertures
    (1, (3,), (50.0, 50.0), (0.0,))

    >>> array.points.round(6).tolist(), array.grid.spacing
    ([[-0.001], [0.0], [0.001]], 0.001)

    >>> array.masked([True, False, True]).valid.tolist()  # the middle taxel is dead
    [True, False, True]

    >>> array.at_base(2e-3).depth
    0.002

    >>> array.sample_noise(np.random.default_rng(0), (10,)).shape  # 10 frames
    (10, 2, 3)

    >>> cut = pp.LineArray(count=3, pitch=1e-3, depth=1e-3, channels=["stress_zz"], limits=(0.0, 3e4))
    >>> cut.limits.tolist(), cut.rezeroed([[500.0, 0.0, 0.0]]).limits[0, 1].tolist()  # [Pa]
    ([[0.0, 30000.0]], [29500.0, 30000.0, 30000.0])
    """

    count: int
    pitch: float
    depth: Any
    channels: Sequence[str]
    aperture: float = 0.0
    noise: Noise = None
    noise_correlation: float = 0.0
    center: float = 0.0
    limits: Any = None
    mask: Any = None

    def __post_init__(self) -> None:
        check_count("count", self.count)
        check_length("pitch", self.pitch)
        _check_depth(self.depth)
        check_length("aperture", self.aperture, zero=True)
        check_length("center", self.center, sign=True)
        object.__setattr__(self, "channels", check_channels(self.channels, 1))
        check_noise(self.noise, tuple(self.channels))
        check_length("noise_correlation", self.noise_correlation, zero=True)
        object.__setattr__(self, "limits", check_limits(self.limits, self.channels, self.shape))
        object.__setattr__(self, "mask", _check_mask(self.mask, (self.count,)))
        _check_extent(self)

    @property
    def dimensions(self) -> int:
        """Number of axes: 1."""
        return 1

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one channel of readings: (count,)."""
        return (self.count,)

    @property
    def grid(self) -> LineGrid:
        """The taxel positions as a grid."""
        return LineGrid(count=self.count, spacing=self.pitch, center=self.center)

    @property
    def points(self) -> Floats:
        """Positions (taxel, 1) [m]."""
        return self.grid.x[:, None]

    @property
    def apertures(self) -> tuple[float, ...]:
        """Aperture of each axis [m]."""
        return (self.aperture,)


@dataclass(frozen=True, kw_only=True, eq=False)
class AreaArray(_Common):
    """A regular grid of taxels at one depth (area contact).

    Parameters
    ----------
    shape : (int, int)
        Rows and columns (ny, nx); one of them may be 1, a single row of taxels on a pad that is pressed anywhere.
    pitch : float or (float, float)
        Distance between taxels [m], one or (dy, dx).
    depth : float or "base"
        Depth below the surface [m], or "base".
    channels : sequence of str
        From `palpate.elastic.AREA_CHANNELS`.
    aperture : float or (float, float)
        Side of the square, or (y, x) sides of the rectangle, over which a taxel averages [m]. For a round taxel take
        0.886 of its diameter (equal area).
    noise, noise_correlation, limits, mask
        As for `LineArray`; ``mask`` has shape (ny, nx).
    center : (float, float)
        Position (x, y) of the middle of the array [m].

    Raises
    ------
    InvalidInput
        An impossible count, length, noise, mask or channel; the message says what is accepted.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> array = pp.AreaArray(
    ...     shape=(2, 3), pitch=1e-3, depth="base", channels=["stress_zz"], aperture=0.8e-3, noise=50.0
    ... )
    >>> array.dimensions, array.noise_std, array.apertures
    (2, (50.0,), (0.0008, 0.0008))

    >>> array.points[0].round(6).tolist(), array.grid.shape  # (y, x) of the first taxel
    ([-0.0005, -0.001], (2, 3))

    >>> array.masked([[True, True, False], [True, True, True]]).valid.sum().item()  # one taxel is dead
    5

    >>> array.at_base(2e-3).depth
    0.002

    >>> array.sample_noise(np.random.default_rng(0), (10,)).shape  # 10 frames
    (10, 1, 2, 3)
    """

    shape: tuple[int, int]
    pitch: float | tuple[float, float]
    depth: Any
    channels: Sequence[str]
    aperture: float | tuple[float, float] = 0.0
    noise: Noise = None
    noise_correlation: float = 0.0
    center: tuple[float, float] = (0.0, 0.0)
    limits: Any = None
    mask: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.shape, tuple | list) or len(self.shape) != 2:
            raise InvalidInput(f"shape must be (rows, columns); got {self.shape!r}.")
        object.__setattr__(self, "shape", tuple(check_count("shape", n, 1) for n in self.shape))
        if max(self.shape) < 2:
            raise InvalidInput("shape must have at least 2 taxels; got 1 x 1.")
        pair("pitch", self.pitch)
        _check_depth(self.depth)
        pair("aperture", self.aperture, zero=True)
        check_center(self.center)
        object.__setattr__(self, "channels", check_channels(self.channels, 2))
        check_noise(self.noise, tuple(self.channels))
        check_length("noise_correlation", self.noise_correlation, zero=True)
        object.__setattr__(self, "limits", check_limits(self.limits, self.channels, self.shape))
        object.__setattr__(self, "mask", _check_mask(self.mask, self.shape))
        _check_extent(self)

    @property
    def dimensions(self) -> int:
        """Number of axes: 2."""
        return 2

    @property
    def grid(self) -> AreaGrid:
        """The taxel positions as a grid."""
        return AreaGrid(shape=self.shape, spacing=self.pitch, center=self.center)

    @property
    def points(self) -> Floats:
        """Positions (taxel, 2) as (y, x) [m], row by row."""
        return self._points.copy()

    @cached_property
    def _points(self) -> Floats:
        y, x = np.meshgrid(*self.grid.axes, indexing="ij")
        return np.stack([y.ravel(), x.ravel()], axis=1)

    @property
    def apertures(self) -> tuple[float, ...]:
        """Aperture of each axis (y, x) [m]."""
        return pair("aperture", self.aperture, zero=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatteredArray(_Common):
    """Taxels, markers or beads anywhere, at one depth.

    Parameters
    ----------
    positions : array (n, 2) or (n,)
        Positions (x, y) [m] for area contact, or x [m] for line contact.
    depth, channels, aperture, noise, noise_correlation, limits
        As for `AreaArray`.
    mask : boolean array (n,), optional
        True where a marker is good.

    Raises
    ------
    InvalidInput
        An impossible count, length, noise, mask or channel; the message says what is accepted.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> beads = [(0.0, 0.0), (2e-3, 0.0), (0.0, 1e-3)]  # (x, y)
    >>> array = pp.ScatteredArray(positions=beads, depth="base", channels=["displacement_x"], noise=2e-6)
    >>> array.dimensions, array.shape, array.noise_std, array.apertures
    (2, (3,), (2e-06,), (0.0, 0.0))

    >>> array.points[1].tolist()  # (y, x)
    [0.0, 0.002]

    >>> array.masked([True, True, False]).valid.tolist(), array.at_base(2e-3).depth
    ([True, True, False], 0.002)

    >>> array.sample_noise(np.random.default_rng(0)).shape
    (1, 3)
    """

    positions: Any = field(repr=False)
    depth: Any
    channels: Sequence[str]
    aperture: float | tuple[float, float] = 0.0
    noise: Noise = None
    noise_correlation: float = 0.0
    limits: Any = None
    mask: Any = None

    def __post_init__(self) -> None:
        found = as_double(self.positions)
        if found.ndim == 1:
            found = found[:, None]
        if found.ndim != 2 or found.shape[1] not in (1, 2) or found.shape[0] < 2:
            raise InvalidInput(
                f"positions must have shape (n, 2) for area contact or (n,) for line contact, n >= 2; got {found.shape}."
            )
        if not np.isfinite(found).all():
            raise InvalidInput(f"positions contain {np.count_nonzero(~np.isfinite(found))} values that are not finite.")
        if len(np.unique(found, axis=0)) != len(found):
            raise InvalidInput("positions name one place twice: average such markers before you pass them.")
        _check_distinct(found)
        found.setflags(write=False)
        object.__setattr__(self, "positions", found)
        _check_depth(self.depth)
        object.__setattr__(self, "channels", check_channels(self.channels, found.shape[1]))
        pair("aperture", self.aperture, zero=True)
        check_noise(self.noise, tuple(self.channels))
        check_length("noise_correlation", self.noise_correlation, zero=True)
        object.__setattr__(self, "limits", check_limits(self.limits, self.channels, self.shape))
        object.__setattr__(self, "mask", _check_mask(self.mask, (len(found),)))
        _check_extent(self)

    @property
    def dimensions(self) -> int:
        """1 for line contact, 2 for area contact."""
        return int(self.positions.shape[1])

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one channel of readings: (n,)."""
        return (len(self.positions),)

    @property
    def points(self) -> Floats:
        """Positions (taxel, axis) [m], axes in the order (y, x)."""
        return np.asarray(self.positions[:, ::-1])

    @property
    def apertures(self) -> tuple[float, ...]:
        """Aperture of each axis [m]."""
        return pair("aperture", self.aperture, zero=True)[: self.dimensions]


#: Any kind of array of taxels.
Array = LineArray | AreaArray | ScatteredArray
