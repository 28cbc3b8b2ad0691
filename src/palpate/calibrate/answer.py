"""Compute touches with a calibrated skin."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate._arrays import from_numpy
from palpate.calibrate.applied import with_constants, with_force_scale
from palpate.calibrate.calibrating import flat_readings, unflat
from palpate.calibrate.calibration import SkinCalibration
from palpate.sensing.labels import is_labelled
from palpate.sensing.readings import checked_planes
from palpate.sensing.times import as_seconds
from palpate.touch import Touch

__all__ = ["at_calibrated_zero", "calibrated_touch", "for_pad", "with_calibration"]


def calibrated_touch(
    found: SkinCalibration, skin: Any, plain: Any, readings: Any, time: Any, options: dict[str, Any]
) -> Touch:
    """Return the touch for readings from which the zero is subtracted: the result of the elastic model ``plain`` with
    the calibrated force, or the force alone if the elastic model was rejected.
    """
    flat = flat_readings(skin.planes, readings)
    if plain is None:
        found.check_options(options)
        like = readings if hasattr(readings, "dtype") and not is_labelled(readings) else np.zeros(0)
        return found.alone(flat, skin.surface, like, time=None if time is None else np.asarray(as_seconds(time)))
    parts = for_pad(found, skin.planes, checked_planes(readings, skin.planes))
    touch: Touch = plain.reconstruct(parts[0] if len(parts) == 1 else parts, time=time, **options)
    return found.attach(touch, flat)


def for_pad(found: SkinCalibration, planes: Sequence[Any], parts: Sequence[Any]) -> list[Any]:
    """Divide the readings of each plane (*batch, channel, *array) by the fitted gains (of one plane), so that they
    have the unit of the pad.
    """
    if found.gains is None:
        return [found.unit * part for part in parts]
    return [part * from_numpy(unflat(planes, found.factors), part) for part in parts]


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
