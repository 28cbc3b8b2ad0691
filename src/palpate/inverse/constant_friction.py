"""The founding paper's friction case: pressure plus a constant shear over one symmetric contact, from one channel.

One channel of normal stress or strain mixes pressure and shear. If the contact is symmetric about its middle and slides
with a constant shear q0 = mu P/(2a) over |x - x0| < a, the shear has two unknowns left, x0 and a: pressure is even about
x0 and gives an even reading, the shear gives an odd one. The half-width is the one whose odd reading fits best.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate._arrays import from_numpy, namespace, to_numpy
from palpate.elastic.half_space import Floats, HalfSpace, Pad
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.regularised import Estimate, Regularised
from palpate.sensing.arrays import Array, LineArray
from palpate.sensing.operator import Operator
from palpate.solutions.line import strip

__all__ = ["ConstantFriction"]


class ConstantFriction:
    """method="constant_friction", prepared for a line array with one channel of normal stress or strain.

    Parameters
    ----------
    inner : Regularised
        The inversion for pressure alone, on the same operator.
    friction : float
        Coefficient mu; its sign is the direction of sliding.
    """

    def __init__(self, pad: Pad, planes: Sequence[Array], inner: Regularised, friction: float) -> None:
        array = planes[0]
        if len(planes) != 1 or not isinstance(array, LineArray) or len(array.channels) != 1 or array.mask is not None:
            raise Unsupported(
                'method="constant_friction" needs one complete LineArray with one channel. With two channels or planes '
                'seek both components: method="tikhonov", components=["x", "z"].'
            )
        if array.channels[0] not in ("stress_zz", "strain_zz", "stress_xx", "strain_xx") or not isinstance(pad, HalfSpace):
            raise Unsupported(
                'method="constant_friction" needs a normal stress or strain of a HalfSpace; got '
                f"{array.channels[0]} of a {type(pad).__name__}."
            )
        if not (math.isfinite(friction) and friction != 0):
            raise InvalidInput(f"friction must be a finite number other than 0; got {friction!r}.")
        self.pad, self.array, self.inner, self.friction = pad, array, inner, friction
        self.operator: Operator = inner.operator

    def _shear_reading(self, half_width: float, center: float) -> Floats:
        """Reading of a unit shear force spread evenly over the contact."""
        unit = strip(half_width=half_width, traction=1.0 / (2 * half_width), component="x").shifted(center)
        nodes = [(0.0, 1.0)]
        if self.array.aperture:
            t, w = np.polynomial.legendre.leggauss(8)
            nodes = [(float(a) * self.array.aperture / 2, float(b) / 2) for a, b in zip(t, w)]
        x, depth = self.array.grid.x, max(self.array.depth, 1e-12)
        return np.asarray(sum(w * unit.fields(self.pad, self.array.channels, x + n, depth)[0] for n, w in nodes))

    def solve(self, readings: Sequence[Any]) -> Estimate:
        """Traction (..., component, *surface); the half-widths found are in `half_width` of the last call's estimate."""
        xp = namespace(readings[0])
        flat = to_numpy(readings[0]).astype(np.float64).reshape(-1, self.array.count)
        tractions, parameters, noises, residuals = [], [], [], []
        for frame in flat:
            estimate = self._frame(frame)
            tractions.append(estimate.traction)
            parameters.append(estimate.parameter)
            noises.append(estimate.noise_scale)
            residuals.append(estimate.residual)
        batch = readings[0].shape[:-2]
        stack = np.stack(tractions).reshape(*batch, 2, *self.operator.surface.shape)
        return Estimate(
            xp.asarray(from_numpy(stack, readings[0])),
            np.array(parameters).reshape(batch),
            np.array(noises).reshape(batch),
            np.array(residuals).reshape(batch),
        )

    def _pressure(self, reading: Floats) -> tuple[Estimate, float]:
        estimate = self.inner.solve([reading[None, :]])
        return estimate, float(estimate.traction[1].sum() * self.operator.surface.cell)

    def _frame(self, reading: Floats) -> Estimate:
        from scipy.interpolate import CubicSpline
        from scipy.optimize import minimize

        x, pitch = self.array.grid.x, self.array.pitch
        extent = x[-1] - x[0]
        first, force = self._pressure(reading)
        weight = np.abs(reading)
        start = float((x * weight).sum() / max(weight.sum(), 1e-300))

        def fit(center: float, half_width: float, total: float) -> tuple[Floats, Estimate, float]:
            shear = self.friction * total * self._shear_reading(half_width, center)
            estimate, new_total = self._pressure(reading - shear)
            return shear, estimate, new_total

        def cost(p: Floats, total: float) -> float:
            center, half_width = float(p[0]), float(np.exp(p[1]))
            shear = self.friction * total * self._shear_reading(half_width, center)
            left = reading - shear
            mirrored = CubicSpline(x, left, extrapolate=False)(2 * center - x)
            inside = np.isfinite(mirrored)
            odd = 0.5 * (left - mirrored)[inside]
            return float((odd**2).mean() / max((reading**2).mean(), 1e-300))

        total = force
        guesses = [(start, math.log(w)) for w in np.geomspace(pitch, extent / 4, 6)]
        best = None
        for _ in range(4):
            runs = [minimize(cost, g, args=(total,), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-14}) for g in guesses]
            best = min(runs, key=lambda r: float(r.fun))
            center, half_width = float(best.x[0]), float(np.exp(best.x[1]))
            _, first, new_total = fit(center, half_width, total)
            if abs(new_total - total) <= 1e-6 * abs(new_total):
                break
            total, guesses = new_total, [(center, math.log(half_width))]
        surface = self.operator.surface
        shear = strip(half_width=half_width, traction=self.friction * total / (2 * half_width), component="x")
        traction = np.array(first.traction)
        traction[0] = shear.shifted(center).averages(surface.edges)[0]  # type: ignore[union-attr]
        return Estimate(traction, first.parameter, first.noise_scale, first.residual)
