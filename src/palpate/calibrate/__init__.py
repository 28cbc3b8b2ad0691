"""Newtons from a few known weights: a map from readings to net force, learned from labels.

In: recordings of a sensor and labels (weights, or a force sensor on its own clock).
Out: net force with intervals, `calibrated.toml`, and findings about the sensor.
Open first: `calibrating.py`.
"""

from palpate.calibrate.answer import calibrated_touch, with_calibration
from palpate.calibrate.applied import with_constants
from palpate.calibrate.calibrating import calibrate, flat_readings
from palpate.calibrate.calibration import FORCE_ONLY_NOTE, SkinCalibration
from palpate.calibrate.constants import PadConstants
from palpate.calibrate.files import calibrated_text, read_calibration, write_calibrated
from palpate.calibrate.forcemap import ForceMap
from palpate.calibrate.labels import Weight, find_delay
from palpate.calibrate.prior import likely_maps

__all__ = [
    "FORCE_ONLY_NOTE",
    "ForceMap",
    "PadConstants",
    "SkinCalibration",
    "Weight",
    "calibrate",
    "calibrated_text",
    "calibrated_touch",
    "find_delay",
    "flat_readings",
    "likely_maps",
    "read_calibration",
    "with_calibration",
    "with_constants",
    "write_calibrated",
]
