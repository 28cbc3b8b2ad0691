"""How the errors of each quantity are distributed: generated constants with the population they come from."""

from palpate.uncertainty.calibration import (
    AMBIGUOUS,
    FEW,
    FEW_TAXELS,
    GAUSSIAN,
    Calibration,
    Case,
    Constants,
    calibrated,
    calibrated_methods,
    constants,
    contact_kind,
)

__all__ = [
    "AMBIGUOUS",
    "FEW",
    "FEW_TAXELS",
    "GAUSSIAN",
    "Calibration",
    "Case",
    "Constants",
    "calibrated",
    "calibrated_methods",
    "constants",
    "contact_kind",
]
