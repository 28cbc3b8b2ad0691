"""How often is a result wrong without a note? Violations x sensors x contacts, and the library's notes on each frame."""

from palpate.bench.trust.judge import Verdict, judge, verdict
from palpate.bench.trust.rows import ROWS, Frame, make_frame
from palpate.bench.trust.table import HEADER, Line, by_sensor, cases, cells, lines, markdown, sentence, trust

__all__ = [
    "HEADER",
    "ROWS",
    "Frame",
    "Line",
    "Verdict",
    "by_sensor",
    "cases",
    "cells",
    "judge",
    "lines",
    "make_frame",
    "markdown",
    "sentence",
    "trust",
    "verdict",
]
