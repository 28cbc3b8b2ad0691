"""The result: traction on the surface, and numbers computed from it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, is_numpy, namespace, to_numpy
from palpate._batches import rebuilt
from palpate._numbers import plain_number
from palpate.errors import InvalidInput
from palpate.touch import intervals
from palpate.touch.counted import for_one_frame
from palpate.touch.numbers import Numbers
from palpate.touch.table import Forces
from palpate.touch.words import assumptions, notes, summary

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from palpate.sensing.arrays import Array

__all__ = ["Touch"]


class Identifier(Protocol):
    """A skin that identifies objects."""

    def identify(self, readings: Any, touch: Touch, **options: Any) -> Any:
        """See `palpate.Skin.identify`."""
        ...


@dataclass(frozen=True, eq=False, repr=False)
class Touch(Numbers):
    """A reconstructed contact.

    Attributes
    ----------
    values : array (*batch, component, *surface)
        Traction [Pa] in the caller's array kind; components ("x", "z") on a line, ("x", "y", "z") on an area.
        Components that were not sought are 0.
    surface : LineGrid or AreaGrid
        Where the traction lives.
    components : tuple of str
        The components that were sought; the others are zero.
    method : str
        The requested method; `methods` names that of each frame.
    assumptions : tuple of str
        Assumptions about all frames, and what the sensor could not see; `notes` adds the outcomes of the frames.
    parameter : array (*batch) or None
        Regularisation parameter: the weight of int |D^m t|^2 [Pa^2 m^(d - 2m)] against the squared residuals, in units of the noise that was given or that a
        discrepancy adds up to (`noise_std`); without any, in the unit of the channels (those of several kinds balanced by their response).
    noise_std : array (*batch, channel) or None
        Standard deviation of the noise of each channel, as given or as estimated from the misfit.
    residual : array (*batch) or None
        Root mean square misfit in units of `noise_std` as used for weighting (1 is perfect where the noise was given).
    unobservable_force : tuple of str
        Components whose net force does not affect the readings; `force` is NaN there.
    time : array (*batch) or None
        Time of each frame [s].
    discrepancy : array (*batch) or None
        Share of the readings (root mean square) that the pad's model leaves unexplained, as learned from the frame; every interval allows for it.
    force_bounds : array (*batch, component, 2) or None
        Other net forces compatible with the readings, such as an offset that could be load, or a load beyond the range of the readings (inf): the
        interval of the force includes them. NaN if there are none.
    strain : array (*batch) or None
        Largest strain at the surface, roughly: peak traction over Young's modulus of the pad there.
    converged : array (*batch) of bool or None
        Whether the optimisation reached its tolerance.
    touching : array (*batch) of bool or None
        False where noise alone explains the frame.
    outliers : array (*batch, reading) of bool or None
        Excluded readings that no contact explains.
    draws : array (*batch, draw, component, *surface) or None
        Samples of the posterior [Pa], if requested.
    resolution : array (*batch) or None
        Finest detail in the readings [m]: the size of a patch with one degree of freedom. Finer detail comes from the prior.
    sliding : array (*batch) or None
        With friction: probability that shear is proportional to pressure everywhere, as when the whole contact slides; NaN without contact.
    drag, drag_std, sticking : array (*batch, tangential component), (*batch), (*batch, candidate) or None
        From a tracker with shear: tangential over normal force, without the bias of the penalty, the standard deviation of its size, and the log
        likelihood of each sticking radius over the contact's (`palpate.inverse.drag.STICK`).
    found_by : array (*batch) of str or None
        The method of each frame, if not ``method`` for all.
    status : array (*batch) of int8 or None
        The outcome of each frame as a code of `palpate.Status`.
    pushing : array (*batch) of bool or None
        False if a contact that only pushes does not explain the frame.
    fit : array (*batch) or None
        Misfit probability: the probability of a residual at least as large and as ordered if pad, array and units are as described. Below 0.01 the
        model does not explain the readings; NaN with too few degrees of freedom
        (`palpate.inverse.fit`).
    nuisance, nuisance_std : array (*batch, term) or None
        Sizes of the nuisances (offsets, of groups of taxels too, ramps, rotation of an image), in the unit of each, and their standard deviations; 0 for frames without evidence of
        them. None where a linear method answered every frame, NaN in a batch for those that it answered: its notes say what it took out.
    nuisance_names : tuple of (str, str)
        Label and unit of each nuisance.
    at_limit : array (*batch, reading) of bool or None
        Readings at an end of their range: the true one is at least that.
    reading_names : mapping of int to str
        Channel and taxel of the readings excluded in some frame.
    calibrated : CalibratedForce or None
        Net force, and centre if labelled places determine it, by the calibration of the skin (`Skin.calibrate`): `force` and
        `center_of_pressure` are these where they are known.
    case : Case or None
        The case of the error bars' constants: contact, kind of channels, body (`palpate.uncertainty`).
    friction : float or None
        The given coefficient of friction.
    view : View or None
        For a camera: position of the picture, pixels to metres and directions of x and y (`palpate.camera.View`).

    Notes
    -----
    A Touch does not change: its NumPy arrays are read-only (copy one to change it). Maps (`traction`, `pressure`, `shear`,
    `variance_reduction`) are labelled xarray objects; `values`, numbers read off them (`force`, `moment`, `center_of_pressure`, `peak_pressure`, ...),
    every `interval` and every `std` are plain arrays of the caller's kind with the batch axes first.
    Positions and vectors are (x, y) or (x, y, z); array axes are (y, x).

    Examples
    --------
    >>> import numpy as np
    >>> import palpate as pp
    >>> grid = pp.LineGrid(count=4, spacing=1e-3)
    >>> shear, pressure = [0.0, 100.0, 200.0, 0.0], [0.0, 500.0, 1000.0, 0.0]
    >>> touch = pp.Touch(np.array([shear, pressure]), grid, ("x", "z"), "tikhonov")  # as a method makes it
    >>> touch.force.round(6).tolist()  # (x, z) [N/m]
    [0.3, 1.5]
    """

    # -- frames --------------------------------------------------------------------------------------------------------

    def __repr__(self) -> str:
        """In a line: frames, surface, method, and the net force of a single frame; `summary` says more.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.AreaGrid(shape=(10, 10), spacing=1e-3)
        >>> pp.Touch(np.full((3, 10, 10), 1000.0), grid, ("x", "y", "z"), "tikhonov")
        <Touch: force (0.1, 0.1, 0.1) N, traction on 10 x 10 cells, by tikhonov>
        >>> pp.Touch(np.zeros((5, 3, 10, 10)), grid, ("x", "y", "z"), "tikhonov")
        <Touch: 5 frames, traction on 10 x 10 cells, by tikhonov>
        """
        cells = " x ".join(map(str, self.surface.shape))
        if self.batch:
            first = f"{' x '.join(map(str, self.batch))} frames"
        else:
            found = np.asarray(to_numpy(self.force), dtype=np.float64)
            faint = 1e-9 * np.abs(found).max(initial=0.0)
            force = ", ".join(plain_number(0.0 if abs(f) < faint else float(f), 3) for f in found)
            first = f"force ({force}) {'N' if self.surface.dimensions == 2 else 'N/m'}"
        return f"<Touch: {first}, traction on {cells} cells, by {self.method}>"

    def __bool__(self) -> bool:
        return True

    def __len__(self) -> int:
        """Number of frames along the first batch axis."""
        if not self.batch:
            raise TypeError("this Touch is one frame and has no length")
        return self.batch[0]

    def __iter__(self) -> Iterator[Touch]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, index: Any) -> Touch:
        """Frames picked along the batch axes, as NumPy picks: ``touch[3]``, ``touch[10:20]``, ``touch[touch.touching]``.

        Raises
        ------
        InvalidInput
            No such frame, or more indices than batch axes.
        """
        picks = index if isinstance(index, tuple) else (index,)
        try:
            where = np.arange(math.prod(self.batch)).reshape(self.batch)[picks]
        except IndexError as error:
            raise InvalidInput(f"no frames {index!r} in a result with the batch axes {self.batch}.") from error
        return self._picked(np.asarray(where))

    def _picked(self, where: npt.NDArray[np.intp]) -> Touch:
        """The frames with these flat indices, shaped as the indices are."""
        lead, count = len(self.batch), math.prod(self.batch)

        def pick(a: Any) -> Any:
            rest = tuple(a.shape[lead:])
            if is_numpy(a) or not hasattr(a, "dtype"):
                return np.asarray(a).reshape(count, *rest)[where]
            xp = namespace(a)
            flat = xp.reshape(a, (count, *rest))
            taken = xp.take(flat, xp.asarray(where.ravel(), device=getattr(a, "device", None)), axis=0)
            return xp.reshape(taken, (*where.shape, *rest))

        found = rebuilt(self, pick)
        return found if where.ndim else replace(found, assumptions=tuple(map(for_one_frame, found.assumptions)))

    def frame(self, index: int) -> Touch:
        """One frame, counted over all batch axes (the touch itself if there is no batch).

        Raises
        ------
        InvalidInput
            No such frame.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> touch = pp.Touch(np.zeros((3, 2, 4)), pp.LineGrid(count=4, spacing=1e-3), ("x", "z"), "tikhonov")
        >>> touch.frame(2).batch, touch.frame(-1).batch, len(touch[1:])
        ((), (), 2)
        """
        if not self.batch:
            return self
        count = math.prod(self.batch)
        if not -count <= index < count:
            raise InvalidInput(f"frame {index} is not among the {count} frames.")
        return self._picked(np.asarray(index % count))

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes to act on: what the sensor could not see, and the outcome of the frames; `assumed` lists the assumptions.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> pp.Touch(np.zeros((2, 4)), grid, ("z",), "tikhonov", assumptions=("shear was taken as zero",)).notes
        ('shear was taken as zero',)
        """
        return notes(self)

    @property
    def assumed(self) -> tuple[str, ...]:
        """Assumptions about the frames, in words: the line "assumed" of `summary`.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=21, pitch=1e-3, depth=1e-3, channels=["stress_zz"]))
        >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
        >>> skin.reconstruct(readings, method="tikhonov").assumed
        ('shear along x taken as zero (the channels cannot tell all components apart)',)
        """
        return assumptions(self)

    # -- labelled views ------------------------------------------------------------------------------------------------

    @property
    def traction(self) -> xarray.DataArray:
        """Traction [Pa] with coordinates: (time, component, y, x), or (component, x) for one frame on a line.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.AreaGrid(shape=(4, 5), spacing=1e-3)
        >>> traction = pp.Touch(np.zeros((7, 3, 4, 5)), grid, ("x", "y", "z"), "tikhonov").traction
        >>> traction.dims, traction.shape, traction.attrs["units"]
        (('time', 'component', 'y', 'x'), (7, 3, 4, 5), 'Pa')

        >>> traction.x.values.round(6).tolist()
        [-0.002, -0.001, 0.0, 0.001, 0.002]
        """
        import xarray

        data = to_numpy(self.values)
        d = self.surface.dimensions
        batch = data.shape[: -1 - d]
        dims = ["time"] if len(batch) == 1 else [f"batch_{i}" for i in range(len(batch))]
        coords: dict[str, Any] = {"component": list(self.surface.components)}
        if len(batch) == 1:
            coords["time"] = np.arange(batch[0], dtype=np.float64) if self.time is None else self.time
        elif not batch and self.time is not None:
            coords["time"] = float(self.time)
        for name, axis in zip(("x",) if d == 1 else ("y", "x"), self.surface.axes):
            coords[name] = axis
        coords |= self.surface.labels
        out = xarray.DataArray(
            data,
            dims=[*dims, "component", *(("x",) if d == 1 else ("y", "x"))],
            coords=coords,
            name="traction",
            attrs={
                "units": "Pa",
                "long_name": "surface traction",
                "method": self.method,
                "notes": "\n".join(self.notes),
                **({} if self.view is None else {"view": json.dumps(self.view.described())}),
            },
        )
        for name in ("x", "y")[:d]:
            out[name].attrs["units"] = "m"
        if len(batch) == 1:
            out["time"].attrs["units"] = "frame" if self.time is None else "s"
        return out

    @property
    def pressure(self) -> xarray.DataArray:
        """Pressure p [Pa], positive into the pad.

        Raises
        ------
        NotObservable
            Pressure was not sought.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> touch = pp.Touch(np.array([[0.0] * 4, [0.0, 500.0, 1000.0, 0.0]]), grid, ("x", "z"), "tikhonov")
        >>> touch.pressure.dims, touch.pressure.values.tolist()
        (('x',), [0.0, 500.0, 1000.0, 0.0])
        """
        return self._sought("z").sel(component="z", drop=True).rename("pressure")

    @property
    def shear(self) -> xarray.DataArray:
        """Shear traction [Pa]: component "x", or "x" and "y".

        Raises
        ------
        NotObservable
            Shear was not sought.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> shear, pressure = [0.0, 100.0, 200.0, 0.0], [0.0, 500.0, 1000.0, 0.0]
        >>> touch = pp.Touch(np.array([shear, pressure]), grid, ("x", "z"), "tikhonov")
        >>> touch.shear.dims, touch.shear.sel(component="x").values.tolist()
        (('component', 'x'), [0.0, 100.0, 200.0, 0.0])
        """
        names = [c for c in self.surface.components if c != "z"]
        return self._sought(*names).sel(component=names).rename("shear")

    def _sought(self, *names: str) -> xarray.DataArray:
        self._require(*names)
        return self.traction

    # -- how sure ------------------------------------------------------------------------------------------------------

    def std(self, of: str = "traction", *, friction: float | None = None) -> Any:
        """Standard deviation of a quantity: half the width of its 68 % `interval`, which here may reach below 0.

        Takes and returns what `interval` does. It is infinite where the interval has no end.

        Raises
        ------
        Unsupported
            The method gives no error bars.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=5.0))
        >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
        >>> touch = skin.reconstruct(readings, method="adaptive")
        >>> bool(touch.std("force")[1] < 0.5), touch.std().shape == touch.values.shape  # of 10 N/m; of every cell
        (True, True)
        """
        return from_numpy(intervals.std(self, of, friction), self.values)

    @property
    def variance_reduction(self) -> xarray.DataArray:
        """Fraction of the prior uncertainty that the readings remove in each cell: 1 - posterior over prior variance;
        1 is measured, 0 is assumed.

        NaN outside the contact. Where it is low, the map shows the prior, not data: features much finer than the depth, and cells beyond the array.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=5.0))
        >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
        >>> part = skin.reconstruct(readings, method="adaptive").variance_reduction.sel(component="z")
        >>> bool(part.sel(x=0.0) > 0.5)  # most of it is measured, not assumed
        True

        >>> bool(part.isel(x=0).isnull())  # nothing touches there
        True
        """
        return self._map(intervals.errors(self).variance_reduction, "variance_reduction", unit="1")

    def interval(self, level: float = 0.95, of: str = "traction", *, friction: float | None = None) -> tuple[Any, Any]:
        """Lower and upper bound of the interval that contains the true value with probability ``level``.

        Parameters
        ----------
        level : float
            Between 0 and 1, e.g. 0.5 or 0.95.
        of : str
            "traction" (every cell and component), "force", "moment", "center_of_pressure", "peak_pressure" or
            "slip_margin" (with ``friction``, by default that of the touch).

        Returns
        -------
        low, high : arrays
            Shaped like the quantity (`values` for "traction"), of the caller's kind. Pressure, normal force and peak pressure of a contact that
            only pushes do not reach below 0. NaN in frames without an answer (missing, capturing zero) and in those whose method gives no error bars.
            ``touch.traction.copy(data=low)`` labels a map.

        Raises
        ------
        InvalidInput
            A level outside 0 to 1, or an unknown quantity.
        Unsupported
            The method gives no error bars (`has_intervals`).

        Notes
        -----
        value + std (b -+ s t), with t the quantile of Student's distribution and b, s and its degrees of freedom fitted for each quantity, method and
        case on simulated contacts (`palpate.uncertainty`), so that 95 % intervals contain the truth in 95 % of them. That is a mean over such
        contacts and noise, not a promise about one. If the case has no constants of its own, `calibration_note` says which are used. Frames that did
        not converge (`converged`) have b = 0: the remaining change may have either sign. Load found beyond the outermost taxels adds a fixed part of
        itself to s std, in quadrature.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=5.0))
        >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
        >>> low, high = skin.reconstruct(readings, method="adaptive").interval(0.95, "force")
        >>> bool(low[1] < 10.0 < high[1])  # the true force
        True
        """
        low, high = intervals.interval(self, level, of, friction)
        return from_numpy(low, self.values), from_numpy(high, self.values)

    def exceeds(self, limit: float, of: str = "peak_pressure") -> Any:
        """Probability (*batch) that the true peak pressure [Pa], or the true normal "force" [N], exceeds ``limit``.

        From the same calibrated distribution as `interval`; at least 2.5 % below an end that `force_bounds` adds. It is 1 for an overload that pushes,
        whose size is unknown, and NaN where the force is.

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=5.0))
        >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
        >>> touch = skin.reconstruct(readings, method="adaptive")
        >>> round(float(touch.exceeds(5.0, "force")), 2), round(float(touch.exceeds(20.0, "force")), 2)
        (1.0, 0.0)
        """
        return from_numpy(intervals.exceeds(self, limit, of), self.values)

    @property
    def calibration_note(self) -> str:
        """Which constants the error bars use if the case has none of its own, else "".

        Examples
        --------
        >>> import palpate as pp
        >>> pad = pp.HalfSpace(youngs_modulus=1e5, poissons_ratio=0.5)
        >>> skin = pp.Skin(pad, pp.LineArray(count=15, pitch=1e-3, depth=1e-3, channels=["stress_zz"], noise=5.0))
        >>> readings = skin.sense(pp.solutions.hertz_line(half_width=3e-3, force=10.0))
        >>> skin.reconstruct(readings, method="adaptive").calibration_note  # the case has constants of its own
        ''
        """
        return intervals.calibration_note(self)

    def _map(self, values: Any, name: str, *, unit: str = "Pa") -> xarray.DataArray:
        """A field labelled like `traction`."""
        out = replace(self, values=from_numpy(np.asarray(values), self.values)).traction.rename(name)
        out.attrs["units"] = unit
        return out

    def identify(self, skin: Identifier, readings: Any, **options: Any) -> Any:
        """Identify what presses: radius of a ball or a flat, patches, stiffness, texture; `palpate.Skin.identify` documents the result and the
        ``options``.

        Parameters
        ----------
        skin : Skin
            That the touch was found with.
        readings : array
            That it was found in: a map is blurred by its penalty, and tells less of an object than they do.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> array = pp.AreaArray(shape=(6, 6), pitch=2e-3, depth=2e-3, channels=["stress_zz"], noise=100.0)
        >>> skin = pp.Skin(pp.HalfSpace(youngs_modulus=2e5, poissons_ratio=0.5), array)
        >>> two = [pp.solutions.hertz_point(contact_radius=1.5e-3, force=1.0).shifted(x, 0.0) for x in (-4e-3, 4e-3)]
        >>> readings = sum(skin.sense(ball) for ball in two)
        >>> touch = skin.reconstruct(readings)
        >>> len(touch.identify(skin, readings).patches)
        2
        """
        return skin.identify(readings, self, **options)

    # -- pictures ------------------------------------------------------------------------------------------------------

    def plot(
        self,
        *,
        frame: int = 0,
        truth: Any = None,
        title: str | None = None,
        ax: Axes | None = None,
        seen_from: str = "inside",
        picture: Any = None,
        taxels: Sequence[Array] = (),
    ) -> Figure:
        """A figure of pressure, shear and their uncertainty (of one ``frame`` of a batch), for a journal's page.

        Parameters
        ----------
        frame : int
            Counted over all batch axes.
        truth : array (component, *surface), optional
            Drawn below, with what was missed.
        title : str, optional
        ax : matplotlib Axes, optional
            Axes of a figure of your own to draw into: pressure in colour, shear as arrows.
        seen_from : str
            "inside" (default): x to the right, y up and z, which points into the pad, towards the viewer, as a camera behind a gel sees it; "outside": y down, as one
            who looks at the surface sees it.
        picture : image or (image, View), optional
            The picture that it was found in, and where that lies (`palpate.camera`; default: `view`): everything is drawn over it, in its pixels.
        taxels : sequence of arrays
            ``skin.planes``: a dot is drawn where each taxel lies.

        Notes
        -----
        On a pad with a curved surface the maps are unrolled, with the coordinates of its chart (`palpate.SolidPad`), and a last panel shows the pressure in
        three dimensions with the net force, in the pad's axes.

        Arrows lie on the strongest cells first, so that none that is small is missed, and a key says their scale. Pressure of both signs has a colour map that is
        centred at zero.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> touch = pp.Touch(np.array([[0.0] * 4, [0.0, 500.0, 1000.0, 0.0]]), grid, ("x", "z"), "tikhonov")
        >>> figure = touch.plot(title="a press")
        >>> len(figure.axes)  # figure.savefig("press.png") keeps it
        1
        """
        from palpate._plot import plot_touch

        return plot_touch(
            self, frame=frame, truth=truth, title=title, ax=ax, seen_from=seen_from, picture=picture, taxels=taxels
        )

    def plot_forces(self, *, ax: Axes | None = None, events: Sequence[Any] = (), title: str | None = None) -> Figure:
        """A figure of the forces over time with their 95 % bands, and of peak pressure and (with `friction`) slip margin.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes of a figure of your own to draw the forces into.
        events : sequence of Event
            Those of a `GraspMonitor`, to be marked where they begin.
        title : str, optional

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> touch = pp.Touch(np.ones((5, 2, 4)), grid, ("x", "z"), "tikhonov", time=np.arange(5) / 10)
        >>> len(touch.plot_forces().axes)  # net force, peak pressure
        2
        """
        from palpate._plot import draw_forces, plot_forces

        if ax is None:
            return plot_forces(self.table(), events=events, title=title)
        draw_forces(ax, self.table(), events=events)
        return cast("Figure", ax.figure)

    def summary(self, *, friction: float | None = None, frame: int = 0) -> str:
        """Force, peak pressure, centre of pressure and (with ``friction``) slip margin in words, one to a line; brackets hold 95 %.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> shear, pressure = [0.0, 100.0, 200.0, 0.0], [0.0, 500.0, 1000.0, 0.0]
        >>> touch = pp.Touch(np.array([shear, pressure]), grid, ("x", "z"), "tikhonov")
        >>> print(touch.summary(friction=0.5))
        net force x     0.3 N/m
        net force z     1.5 N/m
        peak pressure   1 kPa
        centre x        0.1667 mm
        contact width   2 mm
        slip margin     150 Pa, at friction 0.5
        """
        return summary(self.frame(frame), self.friction if friction is None else friction)

    def table(self, *, friction: float | None = None, level: float = 0.95) -> pandas.DataFrame:
        """Numbers over time: one row a frame, each number with its interval.

        Parameters
        ----------
        friction : float, optional
            Coefficient of friction, for the slip margin. Default: `friction`; without any there is no slip margin.
        level : float
            Part of the true values that the intervals hold.

        Returns
        -------
        pandas.DataFrame
            Titles hold the unit (SI): ``time (s)`` (``frame`` where frames have no time) and ``status`` (`Status`); ``force_x``, ``moment_x``, ``center_x``,
            ``peak_pressure``, ``slip_margin``, each followed by its bounds ``_low`` and ``_high``; ``contact_area`` (`contact_area`) without bounds; ``fit``.
            Components that were not sought have no column. Unknown values are NaN. ``to_csv`` writes it; `palpate.recordings.write_touch` does to .csv.

        Raises
        ------
        InvalidInput
            Several batch axes.

        Examples
        --------
        >>> import numpy as np
        >>> import palpate as pp
        >>> grid = pp.LineGrid(count=4, spacing=1e-3)
        >>> press = np.array([[0.0] * 4, [0.0, 500.0, 1000.0, 0.0]])
        >>> touch = pp.Touch(np.stack([press, 2 * press]), grid, ("x", "z"), "tikhonov", time=np.array([0.0, 0.1]))
        >>> touch.table()[["time (s)", "force_z (N/m)", "peak_pressure (Pa)"]].values.tolist()
        [[0.0, 1.5, 1000.0], [0.1, 3.0, 2000.0]]
        """
        forces = Forces(friction=friction, level=level)
        forces.add(self)
        return forces.table()
