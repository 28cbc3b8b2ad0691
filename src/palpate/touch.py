"""The result: traction on the surface, and what can be read off it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from palpate._arrays import from_numpy, namespace, to_numpy
from palpate.elastic.half_space import Floats
from palpate.errors import InvalidInput, NotObservable, Unsupported
from palpate.inverse.account import Errors
from palpate.sensing.grids import Grid

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

__all__ = ["CALIBRATION", "Calibration", "Touch", "calibrated", "calibration_case", "joined"]


@dataclass(frozen=True)
class Calibration:
    """How a quantity's error, in units of the model's standard deviation, is really distributed: b + s t_nu."""

    shift: float = 0.0
    scale: float = 1.0
    freedom: float = 1e6

    @property
    def std(self) -> float:
        """Half the central 68 % of the distribution."""
        return self.scale * self._quantile(0.5 * (1.0 + 0.6827))

    def _quantile(self, probability: float) -> float:
        import scipy.special

        return float(scipy.special.stdtrit(self.freedom, probability))

    def above(self, limit: float, value: Floats, std: Floats, outer: Floats) -> Floats:
        """Probability that the true value lies above ``limit``."""
        import scipy.special

        size = np.hypot(self.scale * std, outer)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (limit - value - self.shift * std) / size
        return np.asarray(np.where(size > 0, scipy.special.stdtr(self.freedom, -z), value > limit), dtype=np.float64)

    def bounds(
        self, level: float, value: Floats, std: Floats, outer: Floats, floor: Floats, *, away: bool = False
    ) -> tuple[Floats, Floats]:
        """Ends of the central interval, none below ``floor``; with ``away`` the shift is away from zero."""
        half = self._quantile(0.5 * (1.0 + level)) * np.hypot(self.scale * std, outer)
        middle = value + std * (self.shift * np.sign(value) if away else self.shift)
        return np.maximum(middle - half, floor), np.maximum(middle + half, floor)

    def standardised(self, truth: Floats, value: Floats, std: Floats, outer: Floats) -> Floats:
        """(truth - value)/std, such that `bounds` for a value of 0 and a std of 1 hold it where the true ones hold the truth."""
        with np.errstate(divide="ignore", invalid="ignore"):
            far = self.shift + (truth - value - self.shift * std) * self.scale / np.hypot(self.scale * std, outer)
            return np.asarray(np.where(outer > 0, far, (truth - value) / std))


#: (method, what is sought); fixed by ``palpate bench calibration --frames 2400 [--method constrained]``.
CALIBRATION: dict[tuple[str, str], dict[str, Calibration]] = {
    ("adaptive", "line"): {
        "traction": Calibration(0.0, 0.637, 2.10),
        "force": Calibration(-0.431, 0.856, 20.01),
        "moment": Calibration(0.0, 1.024, 12.87),
        "center_of_pressure": Calibration(0.0, 0.772, 0.86),
        "peak_pressure": Calibration(0.695, 1.451, 2.83),
        # few arrays see shear on a line: as on an area
        "shear_force": Calibration(-0.521, 0.564, 2.27),
        "slip_margin": Calibration(0.139, 0.160, 1.05),
    },
    ("adaptive", "area"): {
        "traction": Calibration(0.0, 0.792, 2.54),
        "force": Calibration(-1.218, 0.611, 3.09),
        "moment": Calibration(0.0, 0.406, 1.33),
        "center_of_pressure": Calibration(0.0, 0.792, 0.88),
        "peak_pressure": Calibration(-0.079, 1.615, 16.76),
    },
    ("adaptive", "area with shear"): {
        "traction": Calibration(0.0, 0.560, 1.72),
        "force": Calibration(-1.136, 0.519, 2.66),
        "shear_force": Calibration(-0.521, 0.564, 2.27),
        "moment": Calibration(0.0, 0.723, 1.66),
        "center_of_pressure": Calibration(0.0, 0.400, 0.72),
        "peak_pressure": Calibration(-0.579, 1.584, 7.69),
        "slip_margin": Calibration(0.139, 0.160, 1.05),
    },
    ("constrained", "line"): {
        "traction": Calibration(0.000, 0.718, 1.19),
        "force": Calibration(-0.736, 1.021, 26.48),
        "moment": Calibration(0.000, 1.264, 5.72),
        "center_of_pressure": Calibration(0.000, 1.617, 0.93),
        "peak_pressure": Calibration(0.054, 1.701, 1.51),
        "shear_force": Calibration(0.375, 1.691, 4.75),
        "slip_margin": Calibration(0.384, 0.435, 1.44),
    },
    ("constrained", "area"): {
        "traction": Calibration(0.0, 0.998, 1.38),
        "force": Calibration(-4.132, 2.089, 4.73),
        "moment": Calibration(0.0, 1.214, 1.56),
        "center_of_pressure": Calibration(0.0, 1.811, 0.96),
        "peak_pressure": Calibration(-2.155, 2.716, 2.89),
    },
    ("constrained", "area with shear"): {
        "traction": Calibration(0.0, 0.598, 1.07),
        "force": Calibration(-4.425, 2.543, 6.50),
        "shear_force": Calibration(0.375, 1.691, 4.75),
        "moment": Calibration(0.0, 2.447, 2.94),
        "center_of_pressure": Calibration(0.0, 2.485, 1.20),
        "peak_pressure": Calibration(-2.898, 3.227, 2.68),
        "slip_margin": Calibration(0.384, 0.435, 1.44),
    },
}


#: Part of itself to which what lies beyond the outermost taxels is known (`benchmarks/validation.py crossing`).
BEYOND = {
    ("adaptive", "line"): 0.25,
    ("adaptive", "area"): 0.35,
    ("adaptive", "area with shear"): 0.15,
    ("constrained", "line"): 0.42,
    ("constrained", "area"): 0.35,
    ("constrained", "area with shear"): 0.15,
}

#: Part of the normal force beyond the array from which on a summary says so.
OUTER = 0.05


def calibration_case(dimensions: int, components: Sequence[str]) -> str:
    """Which of the constants concern a result: "line", "area" (pressure alone) or "area with shear"."""
    if dimensions == 1:
        return "line"
    return "area with shear" if len(components) > 1 else "area"


def calibrated(method: str, case: str, quantity: str) -> Calibration:
    """How the errors of a quantity found by a method are distributed."""
    return CALIBRATION[method, case][quantity]


@dataclass(frozen=True, eq=False)
class Touch:
    """What touches the pad.

    Attributes
    ----------
    values : array (*batch, component, *surface)
        Traction [Pa] in the caller's array kind; components ("x", "z") on a line, ("x", "y", "z") on an area.
        Components that were not sought are 0.
    surface : LineGrid or AreaGrid
        Where the traction lives.
    components : tuple of str
        The components that were sought; the others were taken as zero.
    method : str
        How it was found.
    notes : tuple of str
        What was assumed and what could not be seen.
    parameter : array (*batch) or None
        Regularisation parameter: the weight of int |D^m t|^2 [Pa^2 m^(d - 2m)] against the squared, noise-scaled residuals.
    noise_std : array (*batch, channel) or None
        Standard deviation of the noise of each channel, as given or as estimated from the misfit.
    residual : array (*batch) or None
        Root mean square misfit in units of `noise_std` as used for weighting (1 is perfect where the noise was given).
    unseen_force : tuple of str
        Components whose net force leaves no trace in the readings; `force` is NaN there.
    time : array (*batch) or None
        Time of each frame [s].
    errors : Errors or None
        Standard deviations in closed form, as the model gives them; `std` and `interval` put them to use.
    converged : array (*batch) of bool or None
        Whether the optimisation reached its tolerance.
    touching : array (*batch) of bool or None
        False where noise alone explains the frame.
    outliers : array (*batch, reading) of bool or None
        Readings that were left out because no contact explains them.
    draws : array (*batch, draw, component, *surface) or None
        Samples of the posterior [Pa], where asked for.
    resolution : array (*batch) or None
        Finest detail that the readings tell [m]: the size of the patch that has one degree of freedom of its own. What is finer
        is the prior's.
    sliding : array (*batch) or None
        Where friction was given: probability that shear is in one proportion to pressure all over, as where the contact slides as a whole;
        NaN where nothing touches.
    """

    values: Any
    surface: Grid
    components: tuple[str, ...]
    method: str
    notes: tuple[str, ...] = ()
    parameter: Floats | None = None
    noise_std: Floats | None = None
    residual: Floats | None = None
    unseen_force: tuple[str, ...] = ()
    time: Floats | None = None
    meta: dict[str, str] = field(default_factory=dict)
    errors: Errors | None = None
    converged: npt.NDArray[np.bool_] | None = None
    touching: npt.NDArray[np.bool_] | None = None
    outliers: npt.NDArray[np.bool_] | None = None
    draws: Floats | None = None
    resolution: Floats | None = None
    sliding: Floats | None = None

    # -- labelled views ------------------------------------------------------------------------------------------------

    @property
    def traction(self) -> xarray.DataArray:
        """Traction [Pa] with coordinates: (time, component, y, x), or (component, x) for one frame on a line."""
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
            },
        )
        for name in ("x", "y")[:d]:
            out[name].attrs["units"] = "m"
        if len(batch) == 1:
            out["time"].attrs["units"] = "frame" if self.time is None else "s"
        return out

    @property
    def pressure(self) -> xarray.DataArray:
        """Pressure p [Pa], positive into the pad."""
        return self._sought("z").sel(component="z", drop=True).rename("pressure")

    @property
    def shear(self) -> xarray.DataArray:
        """Shear traction [Pa]: component "x", or "x" and "y"."""
        names = [c for c in self.surface.components if c != "z"]
        return self._sought(*names).sel(component=names).rename("shear")

    def _sought(self, *names: str) -> xarray.DataArray:
        self._require(*names)
        return self.traction

    def _require(self, *names: str) -> None:
        missing = [n for n in names if n not in self.components]
        if missing:
            raise NotObservable(
                f"the component{'s' if len(missing) > 1 else ''} {', '.join(missing)} of the traction was not sought: "
                f"only {', '.join(self.components)} {'was' if len(self.components) == 1 else 'were'}, and the rest taken as "
                "zero. Measure more channels or another plane, and ask for it with components=[...]."
            )

    # -- numbers -------------------------------------------------------------------------------------------------------

    def _component(self, name: str) -> Any:
        d = self.surface.dimensions
        return self.values[(..., self.surface.components.index(name), *(slice(None),) * d)]

    def _integral(self, x: Any) -> Any:
        xp = namespace(x)
        return xp.sum(x, axis=tuple(range(-self.surface.dimensions, 0))) * self.surface.cell

    def _coordinate(self, name: str) -> Any:
        """x or y [m], shaped to multiply a component."""
        if name == "x":
            return from_numpy(self.surface.x, self.values)
        return from_numpy(self.surface.axes[0][:, None], self.values)

    @property
    def force(self) -> Any:
        """Net force (*batch, component) [N], or [N/m] on a line; NaN where `unseen_force` says it cannot be known."""
        xp = namespace(self.values)
        total = self._integral(self.values)
        if self.unseen_force:
            lost = np.array([math.nan if c in self.unseen_force else 0.0 for c in self.surface.components])
            total = total + from_numpy(lost, self.values)
        return xp.asarray(total)

    @property
    def moment(self) -> Any:
        """Moment about the origin of the surface coordinates.

        On an area (*batch, 3) [N m]: (int y p, -int x p, int (x q_y - y q_x)). On a line (*batch, 1) [N]: about y, -int x p.
        NaN where it involves a component of `unseen_force`.
        """
        xp = namespace(self.values)
        x, p = self._coordinate("x"), self._component("z")
        about_y = -self._integral(x * p)
        if self.surface.dimensions == 1:
            parts, needs = [about_y], ["z"]
        else:
            y = self._coordinate("y")
            spin = self._integral(x * self._component("y") - y * self._component("x"))
            parts, needs = [self._integral(y * p), about_y, spin], ["z", "z", "xy"]
        out = xp.stack(parts, axis=-1)
        lost = np.array([math.nan if any(c in self.unseen_force for c in n) else 0.0 for n in needs])
        return out + from_numpy(lost, self.values)

    @property
    def center_of_pressure(self) -> Any:
        """(*batch, 2) as (x, y), or (*batch, 1) on a line [m]: int x p / int p over the `contact`; NaN without contact.

        Only the contact counts: far from it the recovered pressure is noise around zero, which a long lever would amplify.
        """
        self._require("z")
        xp = namespace(self.values)
        p = xp.where(self.contact(), self._component("z"), xp.zeros_like(self._component("z")))
        total = self._integral(p)
        safe = xp.where(total > 0, total, xp.ones_like(total) * math.nan)
        names = ("x",) if self.surface.dimensions == 1 else ("x", "y")
        return xp.stack([self._integral(self._coordinate(n) * p) / safe for n in names], axis=-1)

    @property
    def peak_pressure(self) -> Any:
        """Largest pressure (*batch) [Pa]."""
        self._require("z")
        return self._largest(self._component("z"))

    def _largest(self, x: Any) -> Any:
        return namespace(x).max(x, axis=tuple(range(-self.surface.dimensions, 0)))

    def contact(self, *, threshold: float = 0.1) -> Any:
        """True (*batch, *surface) where the pressure exceeds ``threshold`` times its peak."""
        self._require("z")
        if not 0 < threshold < 1:
            raise InvalidInput(f"threshold must lie between 0 and 1; got {threshold!r}.")
        p = self._component("z")
        peak = self.peak_pressure[(..., *(None,) * self.surface.dimensions)]
        return (p > threshold * peak) & (peak > 0)

    def contact_area(self, *, threshold: float = 0.1) -> Any:
        """Area (*batch) [m^2] (a width [m] on a line) where the pressure exceeds ``threshold`` times its peak."""
        xp = namespace(self.values)
        return self._integral(xp.astype(self.contact(threshold=threshold), self.values.dtype))

    def slip_margin(self, friction: float, *, threshold: float = 0.1) -> Any:
        """Grasp stability (*batch) [Pa]: the smallest friction * p - |q| over the contact.

        Positive: every point of the contact could bear more shear. Negative: some point is beyond the friction limit, so it
        slides, or the friction is higher than said. ``threshold`` delimits the contact as in `contact`, because at its
        edge both p and q vanish. NaN without contact.
        """
        self._require(*self.surface.components)
        if not (isinstance(friction, int | float) and math.isfinite(friction) and friction > 0):
            raise InvalidInput(f"friction must be a positive number; got {friction!r}.")
        xp = namespace(self.values)
        margin = friction * self._component("z") - self._shear_size()
        inside = self.contact(threshold=threshold)
        margin = xp.where(inside, margin, xp.ones_like(margin) * math.inf)
        smallest = -self._largest(-margin)
        return xp.where(xp.isfinite(smallest), smallest, xp.ones_like(smallest) * math.nan)

    def _shear_size(self) -> Any:
        xp = namespace(self.values)
        if self.surface.dimensions == 1:
            return xp.abs(self._component("x"))
        return xp.sqrt(self._component("x") ** 2 + self._component("y") ** 2)

    # -- how sure ------------------------------------------------------------------------------------------------------

    def _errors(self) -> Errors:
        if self.errors is None:
            raise Unsupported(
                f'method="{self.method}" gives no error bars; use method="adaptive" (the default where pressure is sought).'
            )
        return self.errors

    @property
    def _case(self) -> str:
        return calibration_case(self.surface.dimensions, self.components)

    @property
    def std(self) -> xarray.DataArray:
        """Standard deviation of the traction [Pa], labelled like `traction`."""
        _, raw, outer, _ = self.uncalibrated("traction")
        known = calibrated(self.method, self._case, "traction")
        spread = from_numpy(known.std * np.hypot(raw, outer / known.scale), self.values)
        return replace(self, values=spread).traction.rename("std")

    @property
    def detail(self) -> xarray.DataArray:
        """How much of the traction in each cell is measured (1) rather than assumed (0): 1 - posterior over prior variance.

        NaN where there is no contact. Low values are where the map shows what the prior expects between what the data fix:
        features much finer than the depth, and cells beyond the array.
        """
        return replace(self, values=from_numpy(self._errors().detail, self.values)).traction.rename("detail")

    def interval(self, level: float = 0.95, of: str = "traction", *, friction: float | None = None) -> tuple[Any, Any]:
        """Lower and upper end of the interval that holds the true value with probability ``level``.

        Parameters
        ----------
        level : float
            Between 0 and 1, e.g. 0.5 or 0.95.
        of : str
            "traction" (every cell and component), "force", "moment", "center_of_pressure", "peak_pressure" or
            "slip_margin" (which needs ``friction``).

        Returns
        -------
        low, high : arrays
            Shaped like the quantity (labelled, for "traction"). Pressure, normal force and peak pressure do not reach below 0.

        Notes
        -----
        value + std (b -+ s t), with t the quantile of Student's distribution and b, s and its degrees of freedom fixed
        once for each quantity on simulated contacts (`palpate bench calibration --frames 2400`), so that the intervals hold the truth as often
        as they say. That is a statement about contacts like those: a mean over contacts and noise, not a promise about one. What a
        quantity owes to contact found beyond the outermost taxels adds a fixed part of itself (`BEYOND`) to s std, in quadrature.
        """
        if not (isinstance(level, int | float) and 0 < level < 1):
            raise InvalidInput(f"level must lie between 0 and 1; got {level!r}.")
        self._errors()  # says which methods have error bars
        table = CALIBRATION[self.method, self._case]
        known = [q for q in table if q != "shear_force"]
        if of not in known:
            raise InvalidInput(f"of must be one of {', '.join(known)}; got {of!r}.")
        if (friction is not None) != (of == "slip_margin"):
            raise InvalidInput('friction=... belongs to interval(of="slip_margin"), and is needed there.')
        value, std, outer, floor = self.uncalibrated(of, friction)
        low, high = table[of].bounds(level, value, std, outer, floor)
        if of == "force" and "shear_force" in table:
            # pressure only adds up, so that its sum is biased where that of shear is not
            sides = table["shear_force"].bounds(level, value, std, outer, floor, away=True)
            for side, shear in zip((low, high), sides):
                side[..., :-1] = shear[..., :-1]
        if self.touching is not None and not self.touching.all():
            # an empty frame's error is that of what would not show: nothing was found that could be biased
            empty = ~self.touching.reshape((*self.touching.shape, *(1,) * (low.ndim - self.touching.ndim)))
            plain = Calibration().bounds(level, value, std, outer, floor)
            low, high = np.where(empty, plain[0], low), np.where(empty, plain[1], high)
        if of != "traction":
            return low, high
        return tuple(
            replace(self, values=from_numpy(side, self.values)).traction.rename(name)
            for side, name in ((low, "low"), (high, "high"))
        )  # type: ignore[return-value]

    def exceeds(self, limit: float, of: str = "peak_pressure") -> Floats:
        """Probability (*batch) that the true peak pressure [Pa], or the true normal "force" [N], exceeds ``limit``.

        From the same calibrated distribution as `interval`.
        """
        if of not in ("peak_pressure", "force"):
            raise InvalidInput(f'of must be "peak_pressure" or "force" (the normal force); got {of!r}.')
        value, std, outer, _ = self.uncalibrated(of)
        if of == "force":
            value, std, outer = value[..., -1], std[..., -1], outer[..., -1]
        return calibrated(self.method, self._case, of).above(limit, value, std, outer)

    def uncalibrated(self, of: str, friction: float | None = None) -> tuple[Floats, Floats, Floats, Floats]:
        """Of a quantity of `interval`: value, standard deviation by the model, error of what lies beyond the array, and what it cannot go below."""
        errors = self._errors()
        beyond = BEYOND[self.method, self._case]
        sign = np.full(len(self.surface.components), -math.inf)
        sign[-1] = 0.0 if "z" in self.components else -math.inf
        none = np.asarray(-math.inf)
        if of == "traction":
            floor = sign.reshape(-1, *(1,) * self.surface.dimensions)
            return to_numpy(self.values), errors.traction, beyond * errors.outer_traction, floor
        if of == "force":
            return to_numpy(self.force), errors.force, beyond * errors.outer_force, sign
        if of == "moment":
            return to_numpy(self.moment), errors.moment, beyond * errors.outer_moment, none
        if of == "center_of_pressure":
            return to_numpy(self.center_of_pressure), errors.center, beyond * errors.outer_center, none
        if of == "peak_pressure":
            return to_numpy(self.peak_pressure), errors.peak, beyond * errors.outer_peak, np.asarray(sign[-1])
        value, std = self._slip(float(friction or 0.0))
        return value, std, np.zeros_like(std), none

    def _slip(self, friction: float) -> tuple[Floats, Floats]:
        """Slip margin and its standard deviation, that of mu p - |q| in the cell that is nearest to slip."""
        value = to_numpy(self.slip_margin(friction))
        d = self.surface.dimensions
        tail: tuple[Any, ...] = (slice(None),) * d
        components: tuple[Any, ...] = (..., slice(0, -1), *tail)
        variance = self._errors().traction ** 2
        shear = to_numpy(self.values)[components]
        size = np.sqrt((shear**2).sum(axis=-1 - d))
        along = (shear**2 * variance[components]).sum(axis=-1 - d)
        across = variance[components].mean(axis=-1 - d)
        with np.errstate(divide="ignore", invalid="ignore"):
            along = np.where(size > 0, along / size**2, across)
        last: tuple[Any, ...] = (..., -1, *tail)
        total = friction**2 * variance[last] + along
        p = to_numpy(self._component("z"))
        margin = np.where(to_numpy(self.contact()), friction * p - size, math.inf)
        flat = margin.reshape(*margin.shape[: margin.ndim - d], -1)
        index = np.argmin(flat, axis=-1)[..., None]
        spread = np.take_along_axis(total.reshape(flat.shape), index, axis=-1)[..., 0]
        return value, np.where(np.isfinite(value), np.sqrt(spread), math.nan)

    # -- pictures ------------------------------------------------------------------------------------------------------

    def plot(self, *, frame: int = 0, truth: Any = None, title: str | None = None) -> Figure:
        """A figure of pressure and shear (of one ``frame`` of a batch); ``truth`` (component, *surface) is drawn beside it."""
        from palpate._plot import plot_touch

        return plot_touch(self, frame=frame, truth=truth, title=title)

    def summary(self, *, friction: float | None = None, frame: int = 0) -> str:
        """Force, peak pressure, centre of pressure and (with ``friction``) slip margin in words, one to a line."""
        one = self.frame(frame)
        line = self.surface.dimensions == 1
        force = to_numpy(one.force)
        unit = "N/m" if line else "N"
        lines = ["net force       " + ", ".join(f"{c} {v:.4g} {unit}" for c, v in zip(self.surface.components, force))]
        if "z" in self.components:
            lines.append(f"peak pressure   {float(one.peak_pressure):.4g} Pa")
            if one.errors is not None:
                low, high = one.interval(0.95, "force")
                ends = ", ".join(
                    f"{c} {a:.3g} to {b:.3g}"
                    for c, a, b in zip(self.surface.components, low, high)
                    if c in self.components
                )
                lines.insert(1, f"  95 %          {ends} {unit}")
                low, high = one.interval(0.95, "peak_pressure")
                lines.append(f"  95 %          {float(low):.3g} to {float(high):.3g} Pa")
            lines.append(
                "centre          " + ", ".join(f"{1e3 * float(v):.4g} mm" for v in to_numpy(one.center_of_pressure))
            )
            if one.errors is not None and float(one.errors.outer_force[-1]) > OUTER * abs(float(force[-1])):
                lines.append(
                    f"beyond array    {float(one.errors.outer_force[-1]):.3g} {unit} of the normal force, where nothing is measured"
                )
            size = float(one.contact_area())
            lines.append(f"contact         {1e3 * size:.4g} mm" if line else f"contact area    {1e6 * size:.4g} mm^2")
        if friction is not None and set(self.components) == set(self.surface.components):
            lines.append(f"slip margin     {float(one.slip_margin(friction)):.4g} Pa at friction {friction:g}")
        if one.sliding is not None and float(one.sliding) > 0.5:
            sure = 100 * float(one.sliding)
            lines.append(
                f"shear           in one proportion to pressure, as where all of it slides: sure to {sure:.0f} %"
            )
        return "\n".join([*lines, *(f"note: {n}" for n in self.notes)])

    def frame(self, index: int) -> Touch:
        """One frame of a batch (the touch itself where there is no batch)."""
        d = self.surface.dimensions
        batch = self.values.shape[: -1 - d]
        if not batch:
            return self
        namespace(self.values)
        count = math.prod(batch)
        if not -count <= index < count:
            raise InvalidInput(f"frame {index} is not among the {count} frames.")
        xp = namespace(self.values)
        flat = xp.reshape(self.values, (count, *self.values.shape[len(batch) :]))

        def pick(a: Any) -> Any:
            return None if a is None else a.reshape(count, *a.shape[len(batch) :])[index]

        return Touch(
            flat[index, ...],
            self.surface,
            self.components,
            self.method,
            self.notes,
            pick(self.parameter),
            pick(self.noise_std),
            pick(self.residual),
            self.unseen_force,
            None,
            self.meta,
            None if self.errors is None else Errors.gathered([self.errors], lambda parts: pick(parts[0])),
            pick(self.converged),
            pick(self.touching),
            pick(self.outliers),
            pick(self.draws),
            pick(self.resolution),
            pick(self.sliding),
        )


def joined(touches: Sequence[Touch]) -> Touch:
    """One touch of many frames, from batches (frame, ...) or from single frames of one skin and method.

    Notes are those of any; of what only some have (error bars, where a stream has not got to them yet) the rest is NaN.
    """
    first = touches[0]
    d = first.surface.dimensions
    single = first.values.ndim == 1 + d
    frames = [1 if single else len(t.values) for t in touches]

    def join(parts: Sequence[Any]) -> Any:
        known = next((p for p in parts if p is not None), None)
        if known is None:
            return None
        shape = np.shape(known) if single else np.shape(known)[1:]
        filled = [
            np.full(shape if single else (n, *shape), math.nan) if p is None else p for p, n in zip(parts, frames)
        ]
        arrays = [to_numpy(p) for p in filled]
        return np.stack(arrays) if single else np.concatenate(arrays)

    def field_of(name: str) -> Any:
        parts = [getattr(t, name) for t in touches]
        return (
            join(parts) if all(p is not None for p in parts) or name in ("parameter", "noise_std", "residual") else None
        )

    errors = None
    if any(t.errors is not None for t in touches):
        errors = Errors.gathered([t.errors for t in touches], join)
    return Touch(
        join([t.values for t in touches]),
        first.surface,
        first.components,
        first.method,
        tuple(dict.fromkeys(n for t in touches for n in t.notes)),
        field_of("parameter"),
        field_of("noise_std"),
        field_of("residual"),
        first.unseen_force,
        field_of("time"),
        errors=errors,
        converged=field_of("converged"),
        touching=field_of("touching"),
        outliers=field_of("outliers"),
        resolution=field_of("resolution"),
        sliding=field_of("sliding"),
    )
