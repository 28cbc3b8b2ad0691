"""Compute touches with a calibrated skin."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from palpate._arrays import from_numpy
from palpate.calibrate.applied import with_constants, with_force_scale
from palpate.calibrate.calibrating import flat_readings, unflat
from palpate.calibrate.calibration import SkinCalibration
from palpate.elastic.pad import Floats
from palpate.sensing.labels import is_labelled
from palpate.sensing.readings import checked_planes
from palpate.sensing.times import as_seconds
from palpate.touch import Touch

__all__ = ["at_calibrated_zero", "calibrated_touch", "elastic_skin", "skin_for_pad", "with_calibration"]


def calibrated_touch(
    found: SkinCalibration, skin: Any, plain: Any, readings: Any, time: Any, options: dict[str, Any]
) -> Touch:
    """Return the touch for readings from which the zero is subtracted: the result of the elastic model ``plain`` with
    the calibrated force, or the force alone if the elastic model was rejected.
    """
    flat, zero = flat_readings(skin.planes, readings), skin._problem.zero
    standing = None if zero is None else found.standing(np.concatenate(zero))
    if plain is None:
        found.check_options(options)
        like = readings if hasattr(readings, "dtype") and not is_labelled(readings) else np.zeros(0)
        touch = found.alone(flat, skin.surface, like, time=None if time is None else np.asarray(as_seconds(time)))
    else:
        parts = for_pad(found, skin.planes, checked_planes(readings, skin.planes))
        touch = found.attach(plain.reconstruct(parts[0] if len(parts) == 1 else parts, time=time, **options), flat)
    return touch if standing is None else replace(touch, assumptions=(*touch.assumptions, standing))


def skin_for_pad(skin: Any, found: SkinCalibration) -> Any:
    """Return the skin for readings times the factors of its calibration: noise, limits and zero are in that unit."""
    zero = skin._problem.zero
    if zero is None and all(plane.noise is None and plane.limits is None for plane in skin.planes):
        return skin

    def made() -> Any:
        factors = planewise(skin.planes, found.factors)
        out = skin._with(skin.pad, [plane.rescaled(each) for plane, each in zip(skin.planes, factors)])
        out._problem.zero = None if zero is None else [np.nan_to_num(part * f) for part, f in zip(zero, factors)]
        return out

    return skin._rests.get(found.factors.tobytes(), made)


def elastic_skin(skin: Any, found: SkinCalibration) -> Any:
    """Return the skin of the elastic model: without the calibration, for readings in the unit of the pad."""
    plain = skin_for_pad(skin, found)._uncalibrated()
    if skin._problem.zeroed or found.rest is None:
        return plain
    return plain.at_rest(found.rest * unflat(skin.planes, found.factors))


def planewise(planes: Sequence[Any], flat: Floats) -> list[Floats]:
    """Return values of all readings (reading,) as one array (channel, *array) for each plane; NaN where a taxel is missing."""
    ends = np.cumsum([int(p.valid.sum()) * len(p.channels) for p in planes])
    return [unflat([p], part) for p, part in zip(planes, np.split(flat, ends[:-1]))]


def for_pad(found: SkinCalibration, planes: Sequence[Any], parts: Sequence[Any]) -> list[Any]:
    """Multiply the readings of each plane (*batch, channel, *array) by the factors of the calibration, so that they have
    the unit of the pad.
    """
    return [part * from_numpy(each, part) for part, each in zip(parts, planewise(planes, found.factors))]


def at_calibrated_zero(skin: Any) -> Any:
    """Return the skin for readings minus the zero of its calibration; its intervals include the error of that zero."""
    out = copy.copy(skin)
    out._calibration, out._plain = skin.calibration.opened(), None
    return out


def with_calibration(skin: Any, found: SkinCalibration | None) -> Any:
    """Return the skin that uses a calibration: its pad with the fitted constants (`with_constants`), and the error of
    its scale from the forces of the presses. Return the same skin if ``found`` is None.
    """
    if found is None:
        return skin
    out = with_constants(skin, found.constants)
    if found.elastic:
        out = with_force_scale(out, math.hypot(found.unit_std, found.elastic_error))
    out._calibration = found
    return out
