"""How the errors of each quantity are distributed.

In: a method and the case of a frame (line or area, many or few taxels).
Out: constants that scale error bars, with the population that they come from (`constants.json`).
Open first: `calibration.py`.
"""

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
