"""Calibrated error bars of a touch.

Each frame's interval uses the constants of the method that found it; frames of a method without error bars hold NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate._arrays import to_numpy
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.estimate import Errors, Stated
from palpate.inverse.fit import POOR_FIT
from palpate.inverse.registry import methods as known_methods
from palpate.status import Status
from palpate.touch.fields import pulling
from palpate.touch.numbers import Numbers
from palpate.uncertainty import Calibration, Constants, constants
from palpate.units import is_number

__all__ = ["calibration_note", "errors", "exceeds", "interval", "std", "uncalibrated"]


#: Half-width of a 95 % interval for a load known only by sign and size, divided by that size, minus 1. The distribution
#: is exponential, which has the largest entropy (E. T. Jaynes, Physical Review 106, 620, 1957).
OUTSIDE_FACTOR = -math.log(0.025) - 1.0
#: Level of the interval of one standard deviation to either side of a normal distribution.
ONE_STD = math.erf(math.sqrt(0.5))


def errors(touch: Numbers) -> Errors:
    """The closed-form standard deviations; NaN if unknown, `Unsupported` if the method provides none."""
    if touch._errors is not None:
        return touch._errors.posterior
    if not _unknown(touch):
        known = known_methods().get(touch.method)
        if known is not None and known.error_bars:
            raise Unsupported(
                "this touch was made or read back without its error bars; take the one that Skin.reconstruct returns."
            )
        raise Unsupported(
            f'method="{touch.method}" gives no error bars; use method="tikhonov", or leave the method out.'
        )
    line, count = touch.surface.dimensions == 1, len(touch.surface.components)
    sizes = ((count, *touch.surface.shape), (count,), (1 if line else 3,), (1 if line else 2,), ())
    values, force, moment, center, number = (np.full((*touch.batch, *size), math.nan) for size in sizes)
    return Errors(values, force, moment, center, number, values, values, force, moment, center, number, force)


def _unknown(touch: Numbers) -> bool:
    """Whether error bars are only temporarily missing: no frame has a result, or a tracker has not computed them yet."""
    codes = np.ravel(touch.status) if touch.status is not None else ()
    found = [Status.coded(int(code)) for code in codes]
    if not found:
        return False
    if all(not status.known or status is Status.CAPTURING_ZERO for status in found):
        return True
    try:
        constants(touch.method, touch.calibration_case)
    except Unsupported:
        return False
    return True


def _each_method(touch: Numbers, function: Callable[[Constants], tuple[Floats, ...]]) -> tuple[Floats, ...]:
    """``function`` of the constants of each frame's method; NaN for a method without constants."""
    methods = touch.methods
    out: tuple[Floats, ...] | None = None
    for method in dict.fromkeys(methods.ravel().tolist()):
        try:
            known = constants(method, touch.calibration_case)
        except Unsupported:
            continue
        found = function(known)
        if out is None:
            out = tuple(np.full(np.shape(f), math.nan) for f in found)
        for whole, part in zip(out, found):
            mask = np.reshape(methods == method, (*methods.shape, *(1,) * (np.ndim(part) - methods.ndim)))
            np.copyto(whole, part, where=mask)
    if out is None:  # no frame was found by a method with error bars
        shapes = [np.shape(f) for f in function(constants("adaptive", touch.calibration_case))]
        return tuple(np.full(shape, math.nan) for shape in shapes)
    return out


def calibration_note(touch: Numbers) -> str:
    """A note on which constants are used if the case has none of its own."""
    if not touch.has_intervals:
        return ""
    for method in dict.fromkeys(touch.methods.ravel().tolist()):
        try:
            known = constants(method, touch.calibration_case)
        except Unsupported:
            continue
        used = known.case
        if not known.calibrated:
            return f'error bars of method="{method}" are those of its own Gaussian model: no simulated contacts calibrated them'
        if used not in (touch.calibration_case, touch.calibration_case.whatever_size):
            return (
                f"error bars are not calibrated for this case ({touch.calibration_case}); those for {used} are used, and may be too "
                "narrow or too wide"
            )
    return ""


def std(touch: Numbers, of: str, friction: float | None) -> Floats:
    """See `Touch.std`."""
    low, high = interval(touch, ONE_STD, of, friction, floored=False)
    with np.errstate(invalid="ignore"):  # both ends at infinity
        return np.asarray(0.5 * (high - low))


def interval(
    touch: Numbers, level: float, of: str, friction: float | None, *, floored: bool = True
) -> tuple[Floats, Floats]:
    """See `Touch.interval`; without ``floored`` pressure may reach below 0."""
    if not (is_number(level) and 0 < level < 1):
        raise InvalidInput(f"level must lie between 0 and 1; got {level!r}.")
    errors(touch)
    if of == "slip_margin" and friction is None:
        friction = touch.friction

    def bounds(known: Constants) -> tuple[Floats, Floats]:
        table = known.quantities
        names = [q for q in table if q != "shear_force"]
        if of not in names:
            raise InvalidInput(f"of must be one of {', '.join(names)}; got {of!r}.")
        if (friction is not None) != (of == "slip_margin"):
            raise InvalidInput('friction=... belongs to interval(of="slip_margin"), and is needed there.')
        value, deviation, outside, floor = uncalibrated(touch, known, of, friction)
        floor = floor if floored else np.full_like(floor, -math.inf)
        more = named(touch, of, value, friction)
        beyond = _outside_load(touch) if of == "force" else 0.0
        # A pull is a push with the opposite sign, and so are its error bars.
        pulls = pulling(touch)
        mirrored = pulls.any() and of not in ("slip_margin", "center_of_pressure")
        turned = np.reshape(pulls, (*pulls.shape, *(1,) * (np.ndim(value) - pulls.ndim)))
        if mirrored:
            value = np.where(turned, -value, value)
            if touch.fit is not None:
                # If the model does not explain the readings, the sign of a pull is uncertain.
                doubted = turned & np.reshape(np.asarray(touch.fit) < POOR_FIT, turned.shape)
                floor = np.where(doubted, -math.inf, floor)
        low, high = table[of].bounds(level, value, deviation, outside, floor, stated=more, beyond=beyond)
        if of == "force" and "shear_force" in table:
            # The sum of non-negative pressure is biased, that of shear is not.
            sides = table["shear_force"].bounds(
                level, value, deviation, outside, floor, stated=more, away=True, beyond=beyond
            )
            for side, shear in zip((low, high), sides):
                side[..., :-1] = shear[..., :-1]
        if touch.converged is not None and not touch.converged.all():
            # The remaining change of an iteration may have either sign.
            ended = touch.converged.reshape((*touch.converged.shape, *(1,) * (low.ndim - touch.converged.ndim)))
            whole = replace(table[of], shift=0.0).bounds(
                level, value, deviation, outside, floor, stated=more, beyond=beyond
            )
            low, high = np.where(ended, low, whole[0]), np.where(ended, high, whole[1])
        if touch.pushing is not None and not touch.pushing.all():
            # Traction of either sign is neither biased, as non-negative pressure is, nor bounded by zero.
            both = ~touch.pushing & ~pulls
            free = both.reshape((*both.shape, *(1,) * (low.ndim - both.ndim)))
            either = replace(table[of], shift=0.0).bounds(
                level, value, deviation, outside, np.asarray(-math.inf), stated=more, beyond=beyond
            )
            low, high = np.where(free, either[0], low), np.where(free, either[1], high)
        if touch.touching is not None and not touch.touching.all():
            # In a frame without contact the error is that of the largest undetected load: there is no biased value, and
            # a pull would not be detected either.
            empty = ~touch.touching.reshape((*touch.touching.shape, *(1,) * (low.ndim - touch.touching.ndim)))
            plain = Calibration().bounds(level, value, deviation, outside, np.asarray(-math.inf), stated=more)
            low, high = np.where(empty, plain[0], low), np.where(empty, plain[1], high)
        if mirrored:
            low, high = np.where(turned, -high, low), np.where(turned, -low, high)
        return low, high

    try:
        low, high = _each_method(touch, bounds)
    except Unsupported:
        if touch.calibrated is None:
            raise
        low, high = (np.full(np.shape(touch.calibrated.force), math.nan) for _ in range(2))
    if touch.force_bounds is not None and of in ("force", "peak_pressure"):
        ends = np.asarray(touch.force_bounds, dtype=np.float64)
        if of == "force":
            low, high = np.fmin(low, ends[..., 0]), np.fmax(high, ends[..., 1])
        else:
            high = np.where(np.isposinf(ends[..., -1, 1]), math.inf, high)
            low = np.where(np.isneginf(ends[..., -1, 0]) & pulling(touch), -math.inf, low)
    by_calibration = None if touch.calibrated is None else touch.calibrated.interval(level, of)
    if by_calibration is None:
        return low, high
    known = np.isfinite(by_calibration[0])
    return np.where(known, by_calibration[0], low), np.where(known, by_calibration[1], high)


def exceeds(touch: Numbers, limit: float, of: str) -> Floats:
    """See `Touch.exceeds`."""
    if of not in ("peak_pressure", "force"):
        raise InvalidInput(f'of must be "peak_pressure" or "force" (the normal force); got {of!r}.')
    errors(touch)
    calibrated = touch.calibrated if of == "force" else None
    if calibrated is not None and np.isfinite(calibrated.force[..., -1]).all():
        return calibrated.chance_above(limit)
    pulls = pulling(touch)

    def chance(known: Constants) -> tuple[Floats, ...]:
        value, deviation, outside, _ = uncalibrated(touch, known, of)
        more = named(touch, of, value)
        if of == "force":
            value, deviation, outside, more = (part[..., -1] for part in (value, deviation, outside, more))
        beyond = _outside_load(touch)[..., -1] if of == "force" else 0.0
        # A pull is a push with the opposite sign.
        value, bound = np.where(pulls, -value, value), np.where(pulls, -limit, limit)
        table = known.quantities[of]
        found = table.above(bound, value, deviation, outside, more, beyond)
        unbiased = np.zeros(touch.batch, dtype=bool)
        if touch.converged is not None:
            unbiased |= ~touch.converged
        if touch.pushing is not None:
            unbiased |= ~touch.pushing & ~pulls
        if unbiased.any():
            either = replace(table, shift=0.0).above(bound, value, deviation, outside, more, beyond)
            found = np.where(unbiased, either, found)
        if touch.touching is not None and not touch.touching.all():
            plain = Calibration().above(bound, value, deviation, outside, more)
            found = np.where(touch.touching, found, plain)
        return (np.where(pulls, 1.0 - found, found),)

    found = _each_method(touch, chance)[0]
    ends = np.full((*touch.batch, 2), math.nan) if touch.force_bounds is None else touch.force_bounds[..., -1, :]
    # The 95 % interval reaches to these ends.
    reach = ends if of == "force" else np.where(np.isinf(ends), ends, math.nan)
    above, below = reach[..., 1] > limit, reach[..., 0] < limit
    found = np.where(above, np.maximum(found, 0.025), found)
    found = np.where(below & (pulls | (of == "force")), np.minimum(found, 0.975), found)
    if touch.status is not None:
        # the size of an overload is unknown; one that pulls is at least as far below
        overload = (np.asarray(touch.status) == int(Status.OVERLOAD)) & ~np.isneginf(ends[..., 0])
        found = np.where(overload, 1.0, found)
    if calibrated is not None:
        found = np.where(np.isfinite(calibrated.force[..., -1]), calibrated.chance_above(limit), found)
    return np.asarray(found)


def uncalibrated(
    touch: Numbers, known: Constants, of: str, friction: float | None = None
) -> tuple[Floats, Floats, Floats, Floats]:
    """For a quantity: value, standard deviation by the model, error due to load outside the array, and lower bound."""
    found = errors(touch)
    sign = np.full(len(touch.surface.components), -math.inf)
    sign[-1] = 0.0 if "z" in touch.components and not known.signed else -math.inf
    none = np.asarray(-math.inf)
    if of == "traction":
        floor = sign.reshape(-1, *(1,) * touch.surface.dimensions)
        return to_numpy(touch.values), found.traction, known.outside * found.outside_traction, floor
    if of == "force":
        return to_numpy(touch.force), found.force, known.outside * found.outside_force, sign
    if of == "moment":
        return to_numpy(touch.moment), found.moment, known.outside * found.outside_moment, none
    if of == "center_of_pressure":
        return to_numpy(touch.center_of_pressure), found.center, known.outside * found.outside_center, none
    if of == "peak_pressure":
        return to_numpy(touch.peak_pressure), found.peak, known.outside * found.outside_peak, np.asarray(sign[-1])
    value, deviation = _slip(touch, found, float(friction or 0.0))
    return value, deviation, np.zeros_like(deviation), none


def named(touch: Numbers, of: str, value: Floats, friction: float | None = None) -> Floats:
    """Standard deviation of a quantity of this ``value`` due to an uncertain pad; no constant of the method scales it."""
    common = np.zeros(np.shape(value)) if of == "center_of_pressure" else touch._scale_std * np.abs(value)
    if touch.discrepancy is not None and np.any(touch.discrepancy):
        common = np.hypot(common, _by_discrepancy(touch, of, value))
    pad = None if touch._errors is None else touch._errors.pad
    if pad is None:
        return np.asarray(common)
    if of == "slip_margin":
        return np.hypot(common, _slip(touch, pad, float(friction or 0.0))[1])
    name = {"center_of_pressure": "center", "peak_pressure": "peak"}.get(of, of)
    return np.hypot(common, getattr(pad, name))


def _by_discrepancy(touch: Numbers, of: str, value: Floats) -> Floats:
    """Standard deviation of a quantity due to the discrepancy of the pad's model: that fraction of the quantity
    itself; of the load for a component of the force; of the contact's radius (root mean square) for its centre.
    `_outside_load` adds load beyond the outermost taxels.
    """
    share = np.asarray(touch.discrepancy, dtype=np.float64)
    share = share.reshape((*share.shape, *(1,) * (np.ndim(value) - share.ndim)))
    if of not in ("force", "center_of_pressure"):
        return np.asarray(share * np.abs(value))
    d = touch.surface.dimensions
    size = np.sqrt((to_numpy(touch.values).astype(np.float64) ** 2).sum(axis=-1 - d))
    axes = tuple(range(-d, 0))
    total = size.sum(axis=axes)[..., None]
    if of == "force":
        return np.asarray(share * touch.surface.integral(size)[..., None])
    spreads = []
    for i, along in enumerate(reversed(touch.surface.axes)):  # x, then y
        place = along.reshape(-1, *(1,) * i)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = (size * place).sum(axis=axes) / total[..., 0]
            spreads.append((size * place**2).sum(axis=axes) / total[..., 0] - mean**2)
    return np.asarray(share * np.sqrt(np.maximum(np.nan_to_num(np.stack(spreads, axis=-1)), 0.0)))


def _outside_load(touch: Numbers) -> Floats:
    """Additional half-width of the 95 % interval of a net force, away from zero: for contact beyond the outermost
    taxels, and for more load there than was found.

    If the pad's model has a discrepancy, nothing verifies it beyond the outermost taxels, where pads also end: only
    the sign and the size of that load are known. The interval grows on one side only: on four real skins
    (`benchmarks/real.py`) all forces outside their intervals were above them.
    """
    found = errors(touch)
    if touch.discrepancy is None:
        return found.beyond_force
    outside = np.where(np.asarray(touch.discrepancy)[..., None] > 0.0, found.outside_force, 0.0)
    return np.hypot(found.beyond_force, OUTSIDE_FACTOR * outside)


def _slip(touch: Numbers, found: Errors | Stated, friction: float) -> tuple[Floats, Floats]:
    """Slip margin and its standard deviation: that of mu p - |q| in the cell nearest to slip."""
    value = to_numpy(touch.slip_margin(friction))
    d = touch.surface.dimensions
    variance = np.moveaxis(found.traction**2, -1 - d, 0)
    shear, size = np.moveaxis(to_numpy(touch.values), -1 - d, 0)[:-1], to_numpy(touch._shear_size())
    along = (shear**2 * variance[:-1]).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.where(size > 0, along / size**2, variance[:-1].mean(axis=0))
    total = friction**2 * variance[-1] + along
    margin = to_numpy(touch._margins(friction))
    flat = margin.reshape(*margin.shape[: margin.ndim - d], -1)
    index = np.argmin(flat, axis=-1)[..., None]
    variance_there = np.take_along_axis(total.reshape(flat.shape), index, axis=-1)[..., 0]
    return value, np.where(np.isfinite(value), np.sqrt(variance_there), math.nan)
