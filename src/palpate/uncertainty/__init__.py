"""How the errors of each quantity are distributed: generated constants with the population they come from."""

from palpate.uncertainty.calibration import (
    Calibration,
    Case,
    Constants,
    calibrated,
    calibrated_methods,
    constants,
    contact_kind,
)

__all__ = ["Calibration", "Case", "Constants", "calibrated", "calibrated_methods", "constants", "contact_kind"]
