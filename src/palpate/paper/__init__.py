"""The founding paper, figure by figure and formula by formula, and our extensions.

R. Yang's and P. S. Krishnaprasad's group, University of Maryland, late 1980s: line contact on a half-space, the traction
found from normal stress or strain at depth by dividing Fourier transforms. Depth 1.5, sampling 0.5, E = 1, nu = 0.5,
121 sensors. The paper writes x for depth, y for our x and z for our y.

    cases       its numbers, loads, data and measure of error
    formulas    its sections 2 and 3.1 in the continuum; every equation with the function that computes it
    algorithm   its sections 3.1 and 3.2 on samples: division, and the half-width of a contact with friction
    pictures    its figures 1 to 22, as data and as pictures (sketches 1 and 8 in `sketches`), and ours (`beyond`)
    studies     ours: errors, friction, noise, truncation, speed, two planes, three dimensions, an analog network
    findings    what it says, and what we find
    page        all of it on one page; `tables` are those of the page and of the documentation

In: the paper's numbers and loads, kept in `cases.py`.
Out: its figures, its formulas checked, and a page with our extensions.
Open first: `page.py`.
"""

from palpate.inverse import ConstantFriction, Division, LinearSystem
from palpate.paper.algorithm import sliding
from palpate.paper.cases import (
    CASES,
    DEPTH,
    EPS,
    FRICTION,
    HALF_WIDTH,
    LOAD,
    PAD,
    PAPER_ERRORS,
    PITCH,
    SENSORS,
    array,
    data,
    mean_error,
)
from palpate.paper.findings import claims
from palpate.paper.formulas import EQUATIONS
from palpate.paper.page import report
from palpate.paper.pictures import PaperFigure, figures
from palpate.paper.studies import error_table, friction_table, noise_study, speed_study, truncation_study

__all__ = [
    "CASES",
    "DEPTH",
    "EPS",
    "EQUATIONS",
    "FRICTION",
    "HALF_WIDTH",
    "LOAD",
    "PAD",
    "PAPER_ERRORS",
    "PITCH",
    "SENSORS",
    "ConstantFriction",
    "Division",
    "LinearSystem",
    "PaperFigure",
    "array",
    "claims",
    "data",
    "error_table",
    "figures",
    "friction_table",
    "mean_error",
    "noise_study",
    "report",
    "sliding",
    "speed_study",
    "truncation_study",
]
