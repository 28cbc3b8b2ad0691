"""Measure how accurate the inversion is and whether its error bars hold.

In: a method and a population of contacts, layouts and noise with known truth.
Out: tables of error, coverage and silent failures; constants for the room `uncertainty`.
Open first: `accuracy.py`.
"""

from palpate.bench.ablation import ablation, as_markdown, summary
from palpate.bench.accuracy import (
    DEFAULT,
    NOISES,
    Record,
    accuracy,
    accuracy_markdown,
    coverage,
    measured,
    ratios,
    run,
    table,
)
from palpate.bench.calibration import beyond, calibration, crossing, population, write_constants
from palpate.bench.contacts import FRICTION, Patch, area_contact, line_contact
from palpate.bench.layouts import LAYOUTS, Layout
from palpate.bench.patches import PulledFrame, pulled
from palpate.bench.unseen import CONTACT_KINDS, unseen

__all__ = [
    "CONTACT_KINDS",
    "DEFAULT",
    "FRICTION",
    "LAYOUTS",
    "NOISES",
    "Layout",
    "Patch",
    "PulledFrame",
    "Record",
    "ablation",
    "accuracy",
    "accuracy_markdown",
    "area_contact",
    "as_markdown",
    "beyond",
    "calibration",
    "coverage",
    "crossing",
    "line_contact",
    "measured",
    "population",
    "pulled",
    "ratios",
    "run",
    "summary",
    "table",
    "unseen",
    "write_constants",
]
