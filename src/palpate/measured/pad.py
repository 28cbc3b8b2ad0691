"""`Measured`: a pad whose maps come from a table of presses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import namespace
from palpate._memory import require
from palpate._threads import cached_property
from palpate.elastic.half_space import HalfSpace
from palpate.elastic.pad import Complexes, Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.measured.files import read_table, write_table
from palpate.measured.response import Response, fitted
from palpate.measured.table import Table
from palpate.sensing.arrays import AreaArray, Array, ScatteredArray
from palpate.sensing.grids import AreaGrid, Grid
from palpate.sensing.maps import Among, LinearMap, MatrixMap
from palpate.sensing.surface import default_surface
from palpate.sensing.uncertainty import Uncertainty

__all__ = ["Measured"]

#: Largest number of cells along an axis of a patch that is chosen automatically.
CELLS = 48
#: Largest distance between a taxel of an array and one of the table, as a fraction of the distance of neighbouring
#: taxels.
MAX_OFFSET = 0.05
#: Modulus [Pa] of the half-space that stands in for the pad where an elastic model is needed. It is so stiff that no
#: reading, in any unit, exceeds what an elastic pad can bear.
STIFF = 1e12
#: A table is refused if presses that are left out are predicted with a larger relative error than this, and noise does
#: not explain it: the places are farther apart than the response is wide, or readings are assigned to the wrong
#: presses.
USELESS = 0.6
#: A table is refused if this relative error is exceeded, whatever the noise: the prediction is then hardly better than
#: zero.
NOTHING = 0.85


@dataclass(frozen=True, eq=False)
class Measured:
    """A pad known by a table: every reading for presses of known size at known places.

    It replaces `HalfSpace` or `BondedLayers`. It needs no elastic model: any shape of pad and any sensor serves whose readings grow with the load.
    The response is interpolated between the places and corrected for the indenter's size; the error bars include the error of the interpolation
    (`uncertainty`), as `palpate.measured.response` explains. Contact is sought only on the rectangle that was pressed.

    A table of normal presses has no shear: only pressure is then sought, and shear appears as pressure if it moves the readings. Press sideways too
    (`force` with x and y) to measure it.

    Parameters
    ----------
    table : str, Path or palpate.measured.Table
        A .nc or .csv (see the page on measured responses), or the numbers themselves; `of` takes them with an array.
    radius : float, optional
        Radius of the disc that the indenter touched [m], if the file does not state it.
    indenter : str, optional
        "hertz" (a ball), "disc" or "punch", if the file does not state it.

    Raises
    ------
    InvalidInput
        An invalid file or table; the message says what is accepted.

    Examples
    --------
    A robot pressed a ball on 49 places (here simulated).

    >>> import numpy as np
    >>> import palpate as pp
    >>> gel = pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5)
    >>> array = pp.AreaArray(shape=(5, 5), pitch=3e-3, depth=2e-3, channels=["stress_zz"])
    >>> real = pp.Skin(gel, array)
    >>> places = [(x, y) for y in np.linspace(-6e-3, 6e-3, 7) for x in np.linspace(-6e-3, 6e-3, 7)]
    >>> ball = pp.solutions.hertz_point(contact_radius=1e-3, force=1.0)
    >>> readings = np.stack([real.sense(ball.shifted(*place)) for place in places])
    >>> pad = pp.Measured.of(array, places=places, force=np.ones(49), readings=readings, radius=1e-3)
    >>> skin = pp.Skin(pad, pad.array)
    >>> skin.components  # nothing was pressed sideways
    ('z',)
    >>> touch = skin.reconstruct(real.sense(ball.shifted(1e-3, -2e-3)))
    >>> round(float(touch.force[2]), 1)
    1.0

    The table gives its own noise (none was simulated), and the relative error of the response between the places.

    >>> bool(pad.fit.noise[0] < 1.0), round(pad.uncertainty.gain, 2)  # less than 1 Pa; 1 %
    (True, 0.01)

    Properties of an elastic model that a table lacks; for observability a half-space replaces the pad.

    >>> pad.modelled, pad.thickness, pad.mean_compliance(0.0), pad.compliance(0.0).shape
    (False, None, None, (6, 6))

    >>> pad.states(np.array([1e3]), np.array([[1.0, 0.0]]), 1e-3).shape
    (1, 6, 3)

    Contact is sought on the rectangle that was pressed. If 1 kPa presses all of it, the taxel in the middle reads about 1 kPa.

    >>> surface = pad.patch([array])
    >>> pressed = np.zeros((3, *surface.shape))
    >>> pressed[2] = 1000.0
    >>> surface.shape, round(float(pad.response(array, surface).forward(pressed)[0, 2, 2]), -2)  # [Pa]
    ((9, 9), 1000.0)
    """

    table: Any
    radius: float | None = field(default=None, kw_only=True)
    indenter: str | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if isinstance(self.table, Table):
            if self.radius is not None or self.indenter is not None:
                raise InvalidInput("radius and indenter belong to the Table; leave them out here.")
            return
        if not isinstance(self.table, str | Path):
            raise InvalidInput(
                f"Measured takes a file or a palpate.measured.Table; got {type(self.table).__name__}. Of numbers make one with Measured.of(array, "
                "places=..., force=..., readings=..., radius=...)."
            )
        object.__setattr__(self, "table", read_table(Path(self.table), self.radius, self.indenter))
        object.__setattr__(self, "radius", None)
        object.__setattr__(self, "indenter", None)

    @classmethod
    def of(
        cls,
        array: AreaArray | ScatteredArray,
        *,
        places: npt.ArrayLike,
        force: npt.ArrayLike,
        readings: npt.ArrayLike,
        radius: npt.ArrayLike,
        indenter: str = "hertz",
    ) -> Measured:
        """The pad of readings of an array.

        Parameters
        ----------
        array : AreaArray or ScatteredArray
            Where the taxels are and what they read; taxels that it masks are dead.
        places : array (press, 2)
            (x, y) of each press [m].
        force : array (press,) or (press, 3)
            Normal force, or (x, y, z) [N].
        readings : array (press, channel, *array)
        radius, indenter
            As for `palpate.measured.Table`.

        Raises
        ------
        InvalidInput
            As `palpate.measured.Table`.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> array = pp.AreaArray(shape=(2, 2), pitch=3e-3, depth=2e-3, channels=["stress_zz"])
        >>> places = [(x, y) for y in np.linspace(-2e-3, 2e-3, 4) for x in np.linspace(-2e-3, 2e-3, 4)]
        >>> readings = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5), array).sense(np.ones((16, 3, *pp.Skin(
        ...     pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5), array).surface.shape)))
        >>> pp.Measured.of(array, places=places, force=np.ones(16), readings=readings * np.arange(16)[:, None, None, None], radius=1e-3).table.places.shape
        (16, 2)
        """
        if not isinstance(array, AreaArray | ScatteredArray) or array.dimensions != 2:
            raise InvalidInput(
                f"a measured pad is touched on an area; got a {type(array).__name__}. Use AreaArray or ScatteredArray."
            )
        found = np.array(readings, dtype=np.float64)
        shape = (len(array.channels), *array.shape)
        if found.ndim != 1 + len(shape) or found.shape[1:] != shape:
            raise InvalidInput(
                f"readings must have the shape (press, {', '.join(map(str, shape))}) of this array; got {found.shape}."
            )
        found = found.reshape(len(found), len(array.channels), -1)
        found[:, :, ~array.valid.ravel()] = np.nan
        table = Table(
            places=places,
            force=force,
            readings=found,
            positions=array.points[:, ::-1],
            channels=array.channels,
            radius=radius,
            indenter=indenter,
        )
        return cls(table)

    def save(self, path: str | Path) -> None:
        """Write the table as NetCDF, for ``Measured(path)`` and ``kind = "measured"`` of a skin.toml.

        Examples
        --------
        >>> import tempfile
        >>> import numpy as np
        >>> import palpate as pp
        >>> from palpate.measured import Table
        >>> xy = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), -1).reshape(-1, 2) * 1e-3
        >>> table = Table(places=xy, force=np.ones(16), readings=np.random.default_rng(0).random((16, 1, 2)),
        ...     positions=[(0.0, 0.0), (3e-3, 3e-3)], channels=["stress_zz"], radius=0.5e-3)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     pp.Measured(table).save(f"{folder}/responses.nc")
        ...     pp.Measured(f"{folder}/responses.nc").table.places.shape
        (16, 2)
        """
        if Path(path).exists():
            raise InvalidInput(f"{path} exists, and may hold what was measured; give another name.")
        write_table(self.table, Path(path))

    # -- results of the table ------------------------------------------------------------------------------------------

    @cached_property
    def fit(self) -> Response:
        """The posterior of the response: ``length`` is roughly the depth of the sensing elements, ``noise`` the noise
        of the table, ``error`` the error of the predictions.

        Raises
        ------
        InvalidInput
            A table that does not separate its own presses.
        """
        t = self.table
        found = fitted(
            t.places[:, ::-1], self._force, t.radius, t.indenter, t.readings[:, :, t.working], t.positions[t.working][:, ::-1],
            t.channels, t.components,
        )  # fmt: skip
        if self._excess(found).min() > USELESS or found.held_out.min() > NOTHING:
            raise InvalidInput(
                f"the table does not determine its response: presses that are left out are predicted {100 * found.held_out.min():.0f} % off from the others. Its places are "
                f"{1e3 * t.spacing:.3g} mm apart: press about as close as the sensors are deep, and check that places, forces and readings belong together."
            )
        return found

    @property
    def _force(self) -> Floats:
        return np.asarray(self.table.force[:, ["xyz".index(c) for c in self.table.components]])

    def _excess(self, found: Response) -> Floats:
        """Return the cross-validation error in excess of the noise of the table, relative to the readings."""
        readings = self.table.readings[:, :, self.table.working]
        size = np.sqrt((readings**2).mean(axis=(0, 2)))
        return np.asarray(np.sqrt(np.maximum(found.held_out**2 - (found.noise / size) ** 2, 0.0)))

    @property
    def components(self) -> tuple[str, ...]:
        """Components of the traction whose response was measured.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> from palpate.measured import Table
        >>> xy = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0)), -1).reshape(-1, 2) * 1e-3
        >>> pp.Measured(Table(places=xy, force=np.ones(16), readings=np.random.default_rng(0).random((16, 1, 2)),
        ...     positions=[(0.0, 0.0), (3e-3, 3e-3)], channels=["stress_zz"], radius=0.5e-3)).components
        ('z',)
        """
        return tuple(self.table.components)

    @cached_property
    def uncertainty(self) -> Uncertainty:
        """The default uncertainty: no modulus, depth or thickness enters; the gain is the error of each reading between places of the table.

        The error is that of presses as in the table at places between, with all readings taken together; `Uncertainty.scale` is how well the force of the
        presses was known.
        """
        error = float(np.sqrt(np.mean(self.fit.error**2)))
        return Uncertainty(youngs_modulus=0.0, thickness=0.0, depth=0.0, gain=min(error, 0.99))

    @cached_property
    def array(self) -> AreaArray | ScatteredArray:
        """The array that was pressed, for ``Skin(pad, pad.array)``: a regular one where the taxels lie row by row; its depth is the length of the response."""
        t = self.table
        mask = None if t.working.all() else t.working
        regular = _regular(t.positions)
        if regular is None:
            return ScatteredArray(positions=t.positions, depth=self.fit.length, channels=t.channels, mask=mask)
        shape, pitch, center = regular
        return AreaArray(
            shape=shape,
            pitch=pitch,
            depth=self.fit.length,
            channels=t.channels,
            center=center,
            mask=None if mask is None else mask.reshape(shape),
        )

    @property
    def modelled(self) -> bool:
        """False: functions that need an elastic model refuse (`palpate.Skin.design`, `palpate.Skin.observability`)."""
        return False

    # -- as every pad --------------------------------------------------------------------------------------------------

    @property
    def thickness(self) -> float | None:
        """None: a table has no base."""
        return None

    def states(self, wavenumber: Floats, direction: Floats, depth: float) -> Complexes:
        """Return the fields of one wavevector in a half-space that stands in for the pad, for the measured components;
        they decide which loads can be observed.
        """
        out = _STANDS_FOR.states(wavenumber, direction, depth).copy()
        for i, c in enumerate("xyz"):
            if c not in self.components:
                out[..., i] = 0.0
        return out

    def compliance(self, depth: float) -> Floats:
        """Compliance (6, 6) [1/Pa] of that half-space, which is so stiff that no warnings about strain are given."""
        return _STANDS_FOR.compliance(depth)

    def mean_compliance(self, depth: float) -> Floats | None:
        """None: the displacement of an infinite pad per mean traction has no meaning for a measured pad."""
        return None

    # -- as a pad that makes its maps ----------------------------------------------------------------------------------

    def patch(self, planes: Sequence[Array]) -> AreaGrid:
        """Return the rectangle that was pressed plus half a spacing on each side, in cells about as wide as an
        infinite pad would have.
        """
        for array in planes:
            self._check(array)
        usual = default_surface(planes)
        places = self.table.places
        margin = 0.5 * self.table.spacing
        counts, widths, middles = [], [], []
        for axis, spacing in zip((1, 0), usual.spacings):
            low, high = float(places[:, axis].min()) - margin, float(places[:, axis].max()) + margin
            count = min(max(2, round((high - low) / spacing)), CELLS)
            counts.append(count)
            widths.append((high - low) / count)
            middles.append(0.5 * (low + high))
        return AreaGrid(shape=(counts[0], counts[1]), spacing=(widths[0], widths[1]), center=(middles[1], middles[0]))

    def response(self, array: Array, surface: Grid) -> LinearMap:
        """The map of an array, from traction on the cells of a surface."""
        self._check(array)
        if not isinstance(surface, AreaGrid):
            raise InvalidInput(
                f"the surface of a measured pad is an AreaGrid; got a {type(surface).__name__}. Leave surface out."
            )
        if not isinstance(array, AreaArray | ScatteredArray):
            raise TypeError("checked above")
        rows = self._rows(array)
        unknown = [c for c in array.channels if c not in self.table.channels]
        if unknown:
            raise InvalidInput(
                f"{', '.join(unknown)} was not measured; the table has {', '.join(self.table.channels)}. Leave it out of channels."
            )
        size = len(rows) * len(array.channels) * 3 * math.prod(surface.shape)
        require(16.0 * size, f"{size} influences of a measured pad", "Give a coarser surface.")
        out = np.zeros((len(array.channels), len(rows), 3, *surface.shape))
        there = np.flatnonzero(rows >= 0)
        columns = ["xyz".index(c) for c in self.components]
        for i, name in enumerate(array.channels):
            channel = list(self.table.channels).index(name)
            found = self.fit.cells(surface, channel, rows[there].tolist())
            for at, column in enumerate(columns):
                out[i, there, column] = found[:, at]
        return _MeasuredMap(out, array.shape, self.components)

    def _check(self, array: Array) -> None:
        if not isinstance(array, AreaArray | ScatteredArray) or array.dimensions != 2:
            raise Unsupported(
                f"a measured pad needs taxels spread over an area, and a {type(array).__name__} is a line of taxels. Use the array of the table (Measured.array)."
            )

    def _rows(self, array: AreaArray | ScatteredArray) -> npt.NDArray[np.intp]:
        """Return the index of each taxel among the working taxels of the table; -1 for a taxel that the array masks."""
        from scipy.spatial import cKDTree

        t = self.table
        near = cKDTree(t.positions)
        apart = float(np.median(near.query(t.positions, k=2)[0][:, 1]))
        distance, found = near.query(array.points[:, ::-1])
        valid = array.valid.ravel()
        beside = valid & (distance > MAX_OFFSET * apart)
        if beside.any():
            y, x = array.points[int(np.argmax(beside))]
            raise InvalidInput(
                f"{int(beside.sum())} of {int(valid.sum())} taxels are not in the table, the first at x = {x:g}, y = {y:g} m. Use the array of the table "
                "(Measured.array; leave [[plane]] out of a skin.toml), or give the positions as in the table."
            )
        dead = valid & ~t.working[found]
        if dead.any():
            raise InvalidInput(
                f"{int(dead.sum())} taxels are dead in the table, the first number {int(np.argmax(dead))}. Mask them (mask= of the array), or use the array of "
                "the table (Measured.array; leave [[plane]] out of a skin.toml)."
            )
        place = np.cumsum(t.working) - 1
        return np.where(valid, place[found], -1)


_STANDS_FOR = HalfSpace(youngs_modulus=STIFF, poissons_ratio=0.5)


class _MeasuredMap(MatrixMap):
    """A linear map that raises an error for traction components whose response was not measured."""

    def __init__(self, matrix: Floats, taxels: tuple[int, ...], components: tuple[str, ...]) -> None:
        super().__init__(matrix, taxels)
        self.components = components

    def forward(self, traction: Any, among: Among = None) -> Any:
        """Readings (..., channel, *array) of a traction."""
        xp, d = namespace(traction), len(self.cells)
        for place, component in enumerate(range(self.count) if among is None else among):
            if "xyz"[component] in self.components:
                continue
            if bool(xp.any(traction[(..., place, *(slice(None),) * d)] != 0)):
                raise Unsupported(
                    f"the traction has a component {'xyz'[component]}, and the table of this pad has no press along {'xyz'[component]}: what it does to "
                    "the readings was not measured. Leave shear out, or press sideways too and give force with x, y and z."
                )
        return super().forward(traction, among)


def _regular(positions: Floats) -> tuple[tuple[int, int], tuple[float, float], tuple[float, float]] | None:
    """Shape, pitch (y, x) and center (x, y) of positions (taxel, (x, y)) that lie on a grid, row by row."""
    x, y = positions[:, 0], positions[:, 1]
    scale = float(np.ptp(positions, axis=0).max())
    across = int(np.argmax(np.append(np.abs(y - y[0]) > 1e-6 * scale, True)))
    if across < 2 or len(x) % across or len(x) // across < 2:
        return None
    shape = (len(x) // across, across)
    xs, ys = x[:across], y[::across]
    dx, dy = (xs[-1] - xs[0]) / (across - 1), (ys[-1] - ys[0]) / (shape[0] - 1)
    if dx <= 0 or dy <= 0:
        return None
    gx = xs[0] + dx * np.arange(across)
    gy = ys[0] + dy * np.arange(shape[0])
    if (
        np.abs(x.reshape(shape) - gx).max() > 1e-6 * scale
        or np.abs(y.reshape(shape) - gy[:, None]).max() > 1e-6 * scale
    ):
        return None
    return shape, (float(dy), float(dx)), (float(0.5 * (xs[0] + xs[-1])), float(0.5 * (ys[0] + ys[-1])))
