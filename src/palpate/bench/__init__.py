"""How accurate the inversion is, and whether its error bars are honest: contacts x noise x methods."""

from palpate.bench.accuracy import NOISES, Record, accuracy, coverage, ratios, run, table
from palpate.bench.calibration import calibration, crossing, population, write_constants
from palpate.bench.contacts import FRICTION, Patch, area_contact, line_contact
from palpate.bench.layouts import LAYOUTS, Layout

__all__ = [
    "FRICTION",
    "LAYOUTS",
    "NOISES",
    "Layout",
    "Patch",
    "Record",
    "accuracy",
    "area_contact",
    "calibration",
    "coverage",
    "crossing",
    "line_contact",
    "population",
    "ratios",
    "run",
    "table",
    "write_constants",
]
