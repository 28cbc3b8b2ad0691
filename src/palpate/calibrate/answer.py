"""Touches of a calibrated skin."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from palpate.calibrate.calibrating import flat_readings
from palpate.calibrate.calibration import SkinCalibration
from palpate.calibrate.constants import with_constants
from palpate.sensing.labels import is_labelled
from palpate.sensing.readings import checked_planes
from palpate.sensing.times import as_seconds
from palpate.touch import Touch

__all__ = ["at_calibrated_zero", "calibrated_touch", "with_calibration"]


def calibrated_touch(
    found: SkinCalibration, skin: Any, plain: Any, readings: Any, time: Any, options: dict[str, Any]
) -> Touch:
    """The touch of readings without their zero: of the elastic model ``plain`` with the calibrated force, or force alone where it was rejected."""
    flat = flat_readings(skin.planes, readings)
    if plain is None:
        found.check_options(options)
        like = readings if hasattr(readings, "dtype") and not is_labelled(readings) else np.zeros(0)
        return found.alone(flat, skin.surface, like, time=None if time is None else np.asarray(as_seconds(time)))
    parts = [found.unit * part for part in checked_planes(readings, skin.planes)]
    touch: Touch = plain.reconstruct(parts[0] if len(parts) == 1 else parts, time=time, **options)
    return found.attach(touch, flat)


def at_calibrated_zero(skin: Any) -> Any:
    """The skin for readings minus the zero of its calibration; that zero's error is in the intervals."""
    out = copy.copy(skin)
    out._calibration, out._plain = skin.calibration.opened(), None
    return out


def with_calibration(skin: Any, found: SkinCalibration | None) -> Any:
    """The skin with a calibration, and its pad with the fitted constants (`with_constants`); the same skin for None."""
    out = skin if found is None else with_constants(skin, found.constants)
    out._calibration = found
    return out
