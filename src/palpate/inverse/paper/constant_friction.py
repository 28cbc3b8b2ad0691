"""The founding paper's friction case: pressure plus a constant shear over one symmetric contact, from one channel.

One channel of normal stress or strain mixes pressure and shear. If the contact is symmetric about its middle x0 and
slides with a constant shear q0 over |x - x0| < a, the reading due to pressure is even about x0 and the one due to
shear is odd. The middle and half-width are those whose shear explains the odd part best. For stress the size of the
shear follows from friction: 2 a q0 = mu P, where P is the net force of the pressure. The strain of an incompressible
pad does not depend on the net force, so there the odd part gives the shear itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from palpate._arrays import from_numpy, to_numpy
from palpate._threads import cached_property
from palpate.elastic.pad import Floats, Pad, offered
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.estimate import Estimate
from palpate.inverse.linear.matrix_free.path import Linear
from palpate.inverse.linear.methods import Tikhonov
from palpate.inverse.method import Method, choice, number, rule
from palpate.inverse.paper.division import DivisionEstimator
from palpate.inverse.paper.linear_system import LinearSystemEstimator
from palpate.inverse.problem import Problem
from palpate.sensing.arrays import Array, LineArray
from palpate.sensing.kernels import aperture_rule, influence
from palpate.solutions.line import strip

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

__all__ = ["ConstantFriction", "ConstantFrictionEstimator"]

#: Kernels without a closed form are tabulated in steps of STEP depths, over SPANS array widths (to a few 1e-9 of their
#: largest value), in at most POINTS points.
STEP, SPANS, POINTS = 1.0 / 32.0, 4.0, 30_000
#: Contacts narrower than this many steps do not use the table.
MIN_STEPS = 4

Inner = Linear | DivisionEstimator | LinearSystemEstimator


@dataclass(frozen=True, kw_only=True)
class ConstantFriction(Method):
    """The founding paper's sliding contact: pressure and a shear that is uniform over one symmetric contact, from one channel.

    Parameters
    ----------
    friction : float
        Coefficient mu; its sign is the direction of sliding.
    order, parameter, rule
        Options of the inversion for pressure, as for `Tikhonov`.

    Examples
    --------
    >>> import palpate as pp
    >>> pad = pp.HalfSpace(youngs_modulus=1.0, poissons_ratio=0.5)
    >>> skin = pp.Skin(pad, pp.LineArray(count=41, pitch=0.5, depth=1.5, channels=["stress_zz"]))
    >>> normal = pp.solutions.strip(half_width=3.5, traction=0.1)
    >>> shear = pp.solutions.strip(half_width=3.5, traction=0.04, component="x")
    >>> readings = skin.sense(skin.sample(normal) + skin.sample(shear))
    >>> touch = skin.reconstruct(readings, method=pp.paper.ConstantFriction(friction=0.4))
    >>> touch.force.round(2).tolist()
    [0.28, 0.7]
    """

    name: ClassVar[str] = "constant_friction"
    summary: ClassVar[str] = "the founding paper's sliding contact, on a line with one channel"
    seeks: ClassVar[tuple[str, ...] | None] = ("z",)
    rules: ClassVar[tuple[str, ...]] = Tikhonov.rules

    friction: float = number(
        help="the coefficient mu; its sign is the direction of sliding", negative=True, required=True
    )
    order: int = choice(1, (0, 1, 2), help="order of the derivative that is kept small")
    parameter: float | None = number(help="regularisation parameter (default: chosen for each frame)")
    rule: str | None = rule(Tikhonov.rules, help="how the parameter is chosen for each frame")

    def prepare(self, problem: Problem) -> ConstantFrictionEstimator:
        """The inversion for pressure alone."""
        self.check(problem)
        _checked(problem.planes, self.friction)  # before the work
        inner = Tikhonov(order=self.order, parameter=self.parameter, rule=self.rule).prepare(problem)
        return ConstantFrictionEstimator(problem.pad, problem.planes, inner, self.friction)

    def returns(self, components: tuple[str, ...]) -> tuple[str, ...]:
        """Shear follows from the pressure."""
        return ("x", "z")

    def assumptions(self) -> tuple[str, ...]:
        """Notes for every result."""
        return ("shear is uniform over a symmetric contact and follows the net force by the friction given",)


def _checked(planes: Sequence[Array], friction: float) -> tuple[LineArray, str]:
    """The array and its channel; raise an error if the method does not apply to them."""
    array = planes[0]
    if len(planes) != 1 or not isinstance(array, LineArray) or len(array.channels) != 1 or array.mask is not None:
        raise Unsupported(
            'method="constant_friction" needs one complete LineArray with one channel. With two channels or planes '
            'seek both components: method="tikhonov", components=["x", "z"].'
        )
    channel = array.channels[0]
    if channel not in ("stress_zz", "strain_zz", "stress_xx", "strain_xx"):
        raise Unsupported(f'method="constant_friction" needs a normal stress or strain; got {channel}.')
    if not (math.isfinite(friction) and friction != 0):
        raise InvalidInput(f"friction must be a finite number other than 0; got {friction!r}.")
    return array, channel


class ConstantFrictionEstimator:
    """The method, prepared for a line array with one channel of normal stress or strain.

    Parameters
    ----------
    inner : Regularised, MatrixFree, DivisionEstimator or LinearSystemEstimator
        The inversion for pressure alone.
    friction : float
        Coefficient mu; its sign is the direction of sliding.
    """

    def __init__(self, pad: Pad, planes: Sequence[Array], inner: Inner, friction: float) -> None:
        array, channel = _checked(planes, friction)
        self.pad, self.array, self.inner, self.friction = pad, array, inner, friction
        self.grid = inner.grid
        self._weighs = channel == "stress_zz"

    def _shear_reading(self, half_width: float, center: float) -> Floats:
        """Reading of a unit shear force distributed evenly over the contact."""
        width = 2.0 * half_width
        away = self.array.grid.x - center
        table = self._under_half_of_the_plane
        if table is not None and MIN_STEPS * (table.x[1] - table.x[0]) < width:
            left, right = away - half_width, away + half_width
            if table.x[0] <= left[0] and right[-1] <= table.x[-1]:
                return np.asarray((table(right) - table(left)) / width)
        rule = aperture_rule(self.array.aperture, self.array.depth, width, None)
        response = influence(self.pad, [away], [width], self.array.depth, self.array.channels, [rule])
        return np.asarray(response[0, 0] / width)

    @cached_property
    def _under_half_of_the_plane(self) -> CubicSpline | None:
        """Integral of the shear kernel from the left, up to a constant, for pads with a slow kernel: the search for
        the contact needs a thousand widths and middles. None if it is not smooth enough or too long.
        """
        from scipy.interpolate import CubicSpline

        array = self.array
        x, depth = array.grid.x, array.depth
        step = depth * STEP
        if offered(self.pad, "influence") or not depth > 0.5 * array.aperture or step == 0.0:
            return None
        half = math.ceil(SPANS * (x[-1] - x[0] + array.pitch) / step)
        if 2 * half + 1 > POINTS:
            return None
        at = np.arange(-half, half + 1) * step
        rule = aperture_rule(array.aperture, depth, step, None)
        cells = influence(self.pad, [at], [step], depth, array.channels, [rule])[0, 0]
        return CubicSpline(at + 0.5 * step, np.cumsum(cells))

    def solve(self, readings: Sequence[Any], rng: np.random.Generator | None = None) -> Estimate:
        """Traction (..., component, *surface)."""
        flat = to_numpy(readings[0]).astype(np.float64).reshape(-1, self.array.count)
        estimates = [self._frame(frame) for frame in flat]
        batch = readings[0].shape[:-2]
        stack = np.stack([e.traction for e in estimates]).reshape(*batch, 2, *self.grid.shape)

        def gather(name: str) -> Floats | None:
            values = [getattr(e, name) for e in estimates]
            return None if values[0] is None else np.array(values).reshape(batch)

        scale = gather("noise_scale")
        return Estimate(
            from_numpy(stack, readings[0]),
            gather("parameter"),
            scale,
            gather("residual"),
            noise_std=None if scale is None else scale[..., None] * np.concatenate(self.inner.scales),  # type: ignore[union-attr]
        )

    def _frame(self, reading: Floats) -> Estimate:
        from scipy.interpolate import CubicSpline
        from scipy.optimize import minimize

        x, pitch = self.array.grid.x, self.array.pitch
        power = float((reading**2).mean()) or 1.0
        between = CubicSpline(x, reading, extrapolate=False)

        def shear_force(center: float, half_width: float, total: float) -> tuple[float, float]:
            """Net shear and the odd part of the reading that it leaves (mean square, relative)."""
            odd = _odd_part(between, reading, center)
            response = self._shear_reading(half_width, center)
            unit = _odd_part(CubicSpline(x, response, extrapolate=False), response, center)
            if self._weighs:
                force = self.friction * total
            else:
                force = float(odd @ unit) / max(float(unit @ unit), 1e-300)
                if force * self.friction < 0:
                    force = 0.0
            return force, float(((odd - force * unit) ** 2).mean()) / power

        first: Estimate = self.inner.solve([reading[None, :]])
        total = float(first.traction[1].sum() * self.grid.cell)
        # Begin with a coarse search around the middle of the signal: the misfit has several minima.
        weight = reading**2 / max(float((reading**2).sum()), 1e-300)
        middle = float((x * weight).sum())
        deviation = math.sqrt(float(((x - middle) ** 2 * weight).sum())) + pitch
        coarse = [
            (c, math.log(w))
            for c in middle + deviation * np.linspace(-2.0, 2.0, 17)
            for w in np.geomspace(pitch, (x[-1] - x[0]) / 4, 8)
        ]
        guesses = sorted(coarse, key=lambda g: shear_force(g[0], math.exp(g[1]), total)[1])[:3]
        for _ in range(6):
            runs = [
                minimize(
                    lambda p, t=total: shear_force(float(p[0]), math.exp(min(float(p[1]), 50.0)), t)[1],
                    guess,
                    method="Nelder-Mead",
                    options={"xatol": 1e-9, "fatol": 1e-18, "maxiter": 400},
                )
                for guess in guesses
            ]
            best = min(runs, key=lambda r: float(r.fun))
            center, half_width = float(best.x[0]), math.exp(float(best.x[1]))
            force, _ = shear_force(center, half_width, total)
            first = self.inner.solve([(reading - force * self._shear_reading(half_width, center))[None, :]])
            new_total = float(first.traction[1].sum() * self.grid.cell)
            if not self._weighs or abs(new_total - total) <= 1e-9 * abs(new_total):
                break
            total, guesses = new_total, [(center, math.log(half_width))]
        shear = strip(half_width=half_width, traction=force / (2 * half_width), component="x").shifted(center)
        traction = np.array(first.traction)
        traction[0] = shear.averages(self.grid.edges)[0]  # type: ignore[union-attr]
        return Estimate(traction, first.parameter, first.noise_scale, first.residual)


def _odd_part(between: CubicSpline, values: Floats, center: float) -> Floats:
    """Odd part of values about ``center``, using the spline through them. The mirror image is 0 beyond the array, so
    that a middle near its end cannot explain anything.
    """
    mirrored = between(2 * center - between.x)
    return np.asarray(0.5 * (values - np.nan_to_num(mirrored)))
